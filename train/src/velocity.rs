//! Errors of the velocities of primitives whose true motion is known from tracked boxes.

use glam::DVec3;
use lgs_engine::{gaussians::GaussianSet, views::ClipFrame};
use lgs_formats::casts::to_f32;
use lgs_formats::{
    clip::{Clip, TrackedBox},
    pose::Pose,
};
use serde::{Deserialize, Serialize};

/// A track moves when it is faster than this, metres a second.
const MOVING_SPEED: f64 = 1.0;
/// Returns up to this height above a box's bottom may be of the ground, metres.
const ABOVE_GROUND: f64 = 0.15;
/// Returns this near to a moving box count neither as moving nor as static, metres.
const MARGIN: f64 = 0.3;

/// So many primitives have together the weight of a whole kind.
const FEW: f64 = 100.0;
/// Errors below this are as good as none, metres a second.
const ROUND: f64 = 0.1;

/// Errors of velocities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VelocityErrors {
    /// Primitives of moving things.
    pub moving: usize,
    /// Their mean true speed, metres a second.
    pub speed: f64,
    /// Their mean error `|v - truth|`, metres a second.
    pub error: f64,
    /// Their mean error relative to their own speed.
    pub relative: f64,
    /// Primitives of what stands still.
    pub resting: usize,
    /// Their mean speed, which should be zero, metres a second.
    pub resting_speed: f64,
}

/// The truth of one primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Truth {
    /// It moves so, metres a second, clip frame.
    Moving(DVec3),
    /// It stands still.
    Resting,
    /// Nobody knows.
    Unknown,
}

/// A moving thing at the moment of a sweep.
struct MovingBox {
    box_from_world: Pose,
    half: DVec3,
    /// Pose before and after, and the seconds between.
    motion: [Pose; 2],
    seconds: f64,
}

/// True velocities of the primitives of the `LiDAR` branch.
#[derive(Clone, Debug)]
pub struct TrueVelocities {
    truths: Vec<Truth>,
}

impl TrueVelocities {
    /// Those of the initial Gaussians `start` of the frames `inputs`; `None` where none of these has boxes.
    ///
    /// Boxes of the frames `known` alone are read.
    pub fn of(clip: &Clip, frame: &ClipFrame, inputs: &[usize], known: &[usize], start: &GaussianSet) -> Option<Self> {
        let inputs = inputs.iter().filter(|input| clip.frames[**input].boxes.is_some() && known.contains(input));
        let moving =
            |input: usize| (input, frame.time(clip.frames[input].lidar.timestamp), moving_boxes(clip, input, known));
        let known: Vec<(usize, f32, Vec<MovingBox>)> = inputs.map(|&input| moving(input)).collect();
        if known.is_empty() {
            return None;
        }
        let world_from_clip = frame.clip_from_world.inverse();
        let truth = |i: usize| {
            let Some((_, time, boxes)) = known.iter().find(|(input, ..)| *input == start.frames[i] as usize) else {
                return Truth::Unknown;
            };
            let place = start.mean(i).map(f64::from);
            let here = world_from_clip.transform_point(place.into());
            let later = f64::from(start.times[i] - time);
            match boxes.iter().map(|moving| moving.truth(here, later)).find(|truth| *truth != Truth::Resting) {
                Some(Truth::Moving(v)) => Truth::Moving(frame.clip_from_world.rotation() * v),
                Some(other) => other,
                None => Truth::Resting,
            }
        };
        Some(Self { truths: (0..start.num_lidar).map(truth).collect() })
    }

    /// Those of a scene whose primitives come from these: `sources` `[N]`.
    #[must_use]
    pub fn of_sources(&self, sources: &[usize]) -> Self {
        let truth = |&source: &usize| self.truths.get(source).copied().unwrap_or(Truth::Unknown);
        Self { truths: sources.iter().map(truth).collect() }
    }

    /// As seen in an upright mirror along the x axis of the clip frame.
    pub fn mirror(&mut self) {
        for truth in &mut self.truths {
            if let Truth::Moving(v) = truth {
                v.y = -v.y;
            }
        }
    }

    /// Gradient by the velocities `[N, 3]` of `weight` times the loss of a scene with these primitives.
    ///
    /// # Formula
    /// `sum_moving sqrt(|v - truth|^2 + 0.1^2) / max(count, 100) + mean_resting sqrt(|v|^2 + 0.1^2)`: what moves counts as much as what
    /// stands still, however little it is, and the square root keeps one wrong box from deciding everything.
    pub fn gradient(&self, scene: &GaussianSet, weight: f64) -> Vec<[f32; 3]> {
        let count = |wanted: fn(&Truth) -> bool| self.truths.iter().filter(|t| wanted(t)).count() as f64;
        let moving = weight / count(|t| matches!(t, Truth::Moving(_))).max(FEW);
        let resting = weight / count(|t| *t == Truth::Resting).max(FEW);
        let gradient = |(truth, velocity): (&Truth, &[f32; 3])| {
            let velocity = DVec3::from(velocity.map(f64::from));
            let (error, share) = match truth {
                Truth::Moving(v) => (velocity - v, moving),
                Truth::Resting => (velocity, resting),
                Truth::Unknown => return [0.0; 3],
            };
            (error * (share / (error.length_squared() + ROUND * ROUND).sqrt())).to_array().map(to_f32)
        };
        self.truths.iter().zip(&scene.velocities).map(gradient).collect()
    }

    /// The errors of a scene whose `LiDAR` branch has the primitives of the initial one, in their order.
    pub fn errors(&self, scene: &GaussianSet) -> VelocityErrors {
        let mut errors = VelocityErrors::default();
        for (truth, velocity) in self.truths.iter().zip(&scene.velocities) {
            let velocity = DVec3::from(velocity.map(f64::from));
            match truth {
                Truth::Moving(true_velocity) => {
                    let (speed, error) = (true_velocity.length(), velocity.distance(*true_velocity));
                    errors.moving += 1;
                    errors.speed += speed;
                    errors.error += error;
                    errors.relative += error / speed;
                }
                Truth::Resting => {
                    errors.resting += 1;
                    errors.resting_speed += velocity.length();
                }
                Truth::Unknown => {}
            }
        }
        let (moving, resting) = (errors.moving.max(1) as f64, errors.resting.max(1) as f64);
        errors.speed /= moving;
        errors.error /= moving;
        errors.relative /= moving;
        errors.resting_speed /= resting;
        errors
    }
}

impl MovingBox {
    /// The truth of a return at a world point, measured some seconds later than the box stands here, as far as this box knows.
    fn truth(&self, point: DVec3, later: f64) -> Truth {
        let [before, after] = self.motion.map(|pose| pose.translation());
        let local = self.box_from_world.transform_point(point - (after - before) * (later / self.seconds));
        let beyond = (local.abs() - self.half).max_element();
        if beyond > MARGIN {
            return Truth::Resting;
        }
        if beyond > 0.0 || local.z < ABOVE_GROUND - self.half.z {
            return Truth::Unknown;
        }
        let [before, after] = self.motion.map(|pose| pose.transform_point(local));
        Truth::Moving((after - before) / self.seconds)
    }
}

/// The boxes of a frame whose track moves. Its motion is that between its neighbours among the `known` frames of the track.
fn moving_boxes(clip: &Clip, frame: usize, known: &[usize]) -> Vec<MovingBox> {
    let boxes = clip.frames[frame].boxes.iter().flatten();
    let moving_box = |tracked: &TrackedBox| {
        let at = |index: usize| {
            let record = &clip.frames[index];
            let same = record.boxes.iter().flatten().find(|b| b.track == tracked.track)?;
            Some((record.lidar.timestamp, same.world_from_box))
        };
        let here = (clip.frames[frame].lidar.timestamp, tracked.world_from_box);
        let known = || known.iter().copied();
        let before = known().rev().filter(|&other| other < frame).find_map(at).unwrap_or(here);
        let after = known().filter(|&other| other > frame).find_map(at).unwrap_or(here);
        let seconds = after.0 - before.0;
        let moved = after.1.translation() - before.1.translation();
        (seconds > 0.0 && moved.length() > MOVING_SPEED * seconds).then(|| MovingBox {
            box_from_world: tracked.world_from_box.inverse(),
            half: DVec3::from(tracked.size) / 2.0,
            motion: [before.1, after.1],
            seconds,
        })
    };
    boxes.filter_map(moving_box).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moving() -> MovingBox {
        let at = |x: f64| Pose::new(glam::DMat3::IDENTITY, DVec3::new(x, 0.0, 1.0));
        MovingBox {
            box_from_world: at(5.0).inverse(),
            half: DVec3::new(2.0, 1.0, 1.0),
            motion: [at(4.0), at(6.0)],
            seconds: 0.2,
        }
    }

    #[test]
    fn what_lies_in_a_moving_box_moves_as_it_does() {
        let moving = moving();
        let Truth::Moving(v) = moving.truth(DVec3::new(5.5, 0.2, 1.1), 0.0) else { panic!("not moving") };
        assert!((v - DVec3::new(10.0, 0.0, 0.0)).length() < 1e-9, "{v}");
        assert_eq!(moving.truth(DVec3::new(5.5, 0.2, 0.05), 0.0), Truth::Unknown, "the ground below it");
        assert_eq!(moving.truth(DVec3::new(7.2, 0.0, 1.0), 0.0), Truth::Unknown, "beside it");
        assert_eq!(moving.truth(DVec3::new(9.0, 0.0, 1.0), 0.0), Truth::Resting);
        // Ten metres a second later by a fifth of a second it is there.
        assert!(matches!(moving.truth(DVec3::new(7.5, 0.2, 1.1), 0.2), Truth::Moving(_)));
        assert_eq!(moving.truth(DVec3::new(7.5, 0.2, 1.1), -0.2), Truth::Resting);
    }

    #[test]
    fn errors_are_means_over_those_that_are_known() {
        let v = DVec3::new(10.0, 0.0, 0.0);
        let truths = vec![Truth::Moving(v), Truth::Moving(v), Truth::Resting, Truth::Unknown];
        let velocities = vec![[10.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.5, 0.0], [99.0; 3]];
        let (times, frames) = (vec![0.0; 4], vec![0; 4]);
        let scene = GaussianSet { attributes: vec![[0.0; 14]; 4], times, frames, velocities, num_lidar: 4 };
        let errors = TrueVelocities { truths }.errors(&scene);
        let want = VelocityErrors { moving: 2, speed: 10.0, error: 3.0, relative: 0.3, resting: 1, resting_speed: 0.5 };
        assert_eq!(errors, want);
    }
}
