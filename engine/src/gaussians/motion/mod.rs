//! What moves, and how.
//!
//! Returns that other sweeps see through say that something moves. From such seeds a velocity is searched by which what is seen lands on what other
//! sweeps see, and keeps its colours in the images at their own moments; around them grows the region that this explains better than standing
//! still. Tracked boxes, where a clip has them, may say it instead.

mod boxes;
mod delays;
mod eyes;
mod grid;
mod ground;
mod masks;
mod movers;
mod outlines;
mod own_vehicle;
mod rays;
mod region;
mod rigid;
mod score;
mod search;
mod sites;
mod spread;
mod sweeps;
#[cfg(test)]
mod tests;

pub use self::boxes::MovingBox;
pub(crate) use self::{boxes::boxed, delays::best_delay, outlines::best_times};
use serde::{Deserialize, Serialize};

use crate::{parallel, points::PointCloud, views::View, words::Words};

/// Where the velocities of the initial Gaussians come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// All are zero.
    None,
    /// From what sweeps and images say together.
    ///
    /// Held-out PSNR over ten procedural scenes (128x256, odd frames held out) without a
    /// network, all at rest, registered and by the true boxes: 24.59, 25.03 and 25.10 dB, over moving pixels 20.34, 23.28 and 23.82 dB.
    #[default]
    Registered,
    /// What is inside a tracked box of an input frame moves as the box does, its rotation included; all else stands still.
    Boxes,
}

impl Words for Motion {
    const WORDS: &[(&str, Self, &str)] = &[
        ("none", Self::None, "All are zero"),
        ("registered", Self::Registered, "From what sweeps and images say together"),
        (
            "boxes",
            Self::Boxes,
            "What is inside a tracked box of an input frame moves as the box does, its rotation included; all else stands still",
        ),
    ];
}

/// Images that are farther apart in time are not compared, seconds.
const STEADY: f32 = 0.65;

/// No thing: what stands still.
pub const STANDS: u32 = u32::MAX;

/// What moves, and how.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Movement {
    /// `[N]` velocity of every return, metres a second, clip frame.
    pub velocities: Vec<[f32; 3]>,
    /// `[N]` index of the thing that a return belongs to; [`STANDS`] where nothing says that it moves.
    pub things: Vec<u32>,
    /// How each thing moves; one that several sweeps see is several things.
    pub flows: Vec<Flow>,
}

/// How a thing moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flow {
    /// Index in the clip of the frame whose sweep sees it.
    pub frame: u32,
    /// Rows of the linear map from a position (metres, clip frame) of the thing at its sweep to its velocity (metres a second).
    pub rows: [[f32; 4]; 3],
}

impl Flow {
    /// One in the plane.
    fn planar(frame: u32, rigid: &rigid::Rigid) -> Self {
        let [x, y] = rigid.at(0.0, 0.0);
        Self { frame, rows: [[0.0, -rigid.turn, 0.0, x], [rigid.turn, 0.0, 0.0, y], [0.0; 4]] }
    }

    /// The velocity of a point of it, metres a second.
    pub fn at(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        self.rows.map(|[a, b, c, d]| a * x + b * y + c * z + d)
    }
}

impl Movement {
    /// Of `count` returns that stand still.
    pub fn none(count: usize) -> Self {
        Self { velocities: vec![[0.0; 3]; count], things: vec![STANDS; count], flows: Vec::new() }
    }

    /// Adds a new thing, to which these returns belong.
    fn add(&mut self, cloud: &PointCloud, flow: Flow, returns: impl Iterator<Item = usize>) {
        let thing = u32::try_from(self.flows.len()).unwrap_or(STANDS);
        for point in returns {
            self.things[point] = thing;
            self.velocities[point] = flow.at(cloud.positions[point]);
        }
        self.flows.push(flow);
    }
}

/// What moves, as sweeps and images say together; nothing where there are no two sweeps.
///
/// # Shapes
/// The cloud sweep by sweep; `views` input views, of which those of the sweeps' own frames and the same cameras are compared.
pub fn registered(cloud: &PointCloud, views: &[View]) -> Movement {
    let mut runs = Vec::new();
    let mut start = 0;
    for run in cloud.frames.chunk_by(|a, b| a == b) {
        runs.push(start..start + run.len());
        start += run.len();
    }
    let mut movement = Movement::none(cloud.len());
    if runs.len() < 2 {
        return movement;
    }
    let sweeps = sweeps::prepare(cloud, &runs);
    let frames: Vec<u32> = runs.iter().map(|run| cloud.frames[run.start]).collect();
    let eyes = eyes::Eyes::of(views, &frames, STEADY);
    let movers = movers::movers(&score::Scorer { sweeps: &sweeps, eyes: &eyes });
    let own = own_vehicle::own(cloud, &runs, &sweeps);
    let spread = |index: usize| spread::spread(&cloud.positions[runs[index].clone()], &sweeps[index], &movers, index);
    let of_returns: Vec<Vec<Option<usize>>> = parallel::map(runs.len(), 1, &spread);
    for ((index, run), of_return) in runs.iter().enumerate().zip(of_returns) {
        for (label, mover) in movers.iter().enumerate() {
            let own = || (run.start..run.end).filter(|&point| of_return[point - run.start] == Some(label));
            if own().next().is_some() {
                movement.add(cloud, Flow::planar(frames[index], &mover.parts[index].1), own());
            }
        }
        let own_vehicle::Own { returns, velocity } = &own[index];
        if !returns.is_empty() {
            let rigid = rigid::Rigid { velocity: *velocity, turn: 0.0, middle: [0.0; 2] };
            movement.add(cloud, Flow::planar(frames[index], &rigid), returns.iter().copied());
        }
    }
    movement
}
