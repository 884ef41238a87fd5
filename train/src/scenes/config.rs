//! What a scene is made from: everything that is not drawn from the seed while the street is laid out.

use super::{
    check::{Range, check},
    rig::Rig,
};
use crate::error::Result;

/// Distance after which the built-up part of the street comes to its end (metres).
pub const MAX_EGO_DISTANCE: f64 = 150.0;

/// The sets that scenes belong to; no two share a seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Scenes that weights learn from.
    Train,
    /// Scenes that decide when to stop and what to keep.
    Validation,
    /// Scenes that are only measured on.
    Test,
    /// Streets with real traffic that weights learn from.
    Traffic,
    /// Streets with real traffic that are only measured on.
    TrafficTest,
}

impl Split {
    /// Largest scene number of a split.
    pub const MAX_NUMBER: u64 = (1 << 60) - 1;

    /// The seed of scene `number` of this split.
    pub const fn seed(self, number: u64) -> u64 {
        let block = match self {
            Self::Train => 0,
            Self::Validation => 1,
            Self::Test => 2,
            Self::Traffic => 3,
            Self::TrafficTest => 4,
        };
        (block << 60) | (number & Self::MAX_NUMBER)
    }

    /// The name of the split.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
            Self::Traffic => "traffic",
            Self::TrafficTest => "traffic-test",
        }
    }
}

/// The shape of a street.
#[derive(Clone, Debug, PartialEq)]
pub struct StreetSpec {
    /// Curvature of the middle line, 1/m, positive to the left, -0.008..=0.008.
    pub curvature: f64,
    /// Width of a lane, metres, 2.6..=4.5.
    pub lane_width_m: f64,
    /// Lanes in each direction, 1..=3.
    pub num_lanes: usize,
    /// Whether cars park at both sides.
    pub parking: bool,
    /// Width of each pavement, metres, 1.5..=8.
    pub pavement_m: f64,
    /// Lowest and highest number of upper floors of houses, 0..=10.
    pub floors: [usize; 2],
    /// Share of house plots that stay open, 0..=1.
    pub open_plots: f64,
    /// Mean distance of trees along a pavement, metres, 4..=100.
    pub tree_spacing_m: f64,
    /// Size of texture features relative to the usual, 0.3..=4.
    pub texture_scale: f64,
}

/// Who moves.
#[derive(Clone, Debug, PartialEq)]
pub struct TrafficSpec {
    /// Speed of the vehicle that carries the sensors, m/s, 0..=20; it drives 150 m in a clip at most.
    pub ego_speed: f64,
    /// Moving cars, 0..=30; fewer where no gap is left for one.
    pub num_cars: usize,
    /// Slowest and fastest speed of moving cars, m/s, 0..=20.
    pub speeds: [f64; 2],
    /// Walking people, 0..=30.
    pub num_people: usize,
    /// Share of parking slots that are taken, 0..=1.
    pub parked: f64,
    /// What real streets have beyond that.
    pub busy: Option<BusySpec>,
}

/// Traffic as real streets have it. Each number is of things that are tried to be placed, 0..=12; fewer come where no gap is left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BusySpec {
    /// Place of a side street along the street, metres, 5..=100; without one nobody crosses or turns.
    pub side_street: Option<f64>,
    /// Lorries with trailers.
    pub lorries: usize,
    /// Cars of a queue at walking pace.
    pub queue: usize,
    /// Cars on the side street, across the street.
    pub crossing: usize,
    /// Cars that turn from one into the other.
    pub turning: usize,
    /// Cyclists.
    pub cyclists: usize,
    /// People who walk across the street.
    pub people_across: usize,
}

impl BusySpec {
    fn validate(&self) -> Result<()> {
        if let Some(place) = self.side_street {
            check("traffic.busy.side_street", place, Range(5.0, 100.0))?;
        }
        let numbers = [
            ("lorries", self.lorries),
            ("queue", self.queue),
            ("crossing", self.crossing),
            ("turning", self.turning),
            ("cyclists", self.cyclists),
            ("people_across", self.people_across),
        ];
        numbers
            .iter()
            .try_for_each(|(name, number)| check(format!("traffic.busy.{name}"), *number as f64, Range(0.0, 12.0)))
    }
}

/// Sun, sky and air.
#[derive(Clone, Debug, PartialEq)]
pub struct LightSpec {
    /// Direction of the sun to the left of the start of the street, degrees, -360..=360.
    pub sun_azimuth_deg: f64,
    /// Height of the sun above the horizon, degrees, 5..=90.
    pub sun_elevation_deg: f64,
    /// Share of the sun's light that clouds take away, 0..=1.
    pub overcast: f64,
    /// Share of the sky that shows clouds, 0..=1.
    pub clouds: f64,
    /// Distance over which haze takes about half of the contrast, metres, 50..=100000.
    pub haze_m: f64,
}

/// Where the exported clip's world and clock start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    /// The start of the street in the clip's world, metres, each within +-1e8.
    pub position: [f64; 3],
    /// Heading of the start of the street in the clip's world, degrees, -360..=360.
    pub heading_deg: f64,
    /// Timestamp of the first sweep, seconds, within +-1e11.
    pub time_s: f64,
}

/// A scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneConfig {
    /// Decides all that the other values leave open.
    pub seed: u64,
    /// Timestamps, 1..=1000.
    pub num_frames: usize,
    /// Time between two timestamps, seconds, 0.01..=2; a clip lasts 20 s at most.
    pub frame_interval_s: f64,
    /// Distance from the LiDAR up to which tracked things get boxes, metres, 0..=500.
    pub box_reach_m: f64,
    /// The sensors.
    pub rig: Rig,
    /// The street.
    pub street: StreetSpec,
    /// The traffic.
    pub traffic: TrafficSpec,
    /// The light.
    pub light: LightSpec,
    /// The clip's world.
    pub origin: Origin,
}

impl SceneConfig {
    /// Time of a frame's sweep after the first one, seconds.
    pub fn frame_time(&self, frame: usize) -> f64 {
        frame as f64 * self.frame_interval_s
    }

    /// Fails for the first value out of its range.
    ///
    /// # Errors
    /// The first value that is out of its range, by its path.
    pub fn validate(&self) -> Result<()> {
        check("num_frames", self.num_frames as f64, Range(1.0, 1000.0))?;
        check("frame_interval_s", self.frame_interval_s, Range(0.01, 2.0))?;
        check("duration_s", self.frame_time(self.num_frames), Range(0.0, 20.0))?;
        check("box_reach_m", self.box_reach_m, Range(0.0, 500.0))?;
        self.rig.validate()?;
        let street = &self.street;
        check("street.curvature", street.curvature, Range(-0.008, 0.008))?;
        check("street.lane_width_m", street.lane_width_m, Range(2.6, 4.5))?;
        check("street.num_lanes", street.num_lanes as f64, Range(1.0, 3.0))?;
        check("street.pavement_m", street.pavement_m, Range(1.5, 8.0))?;
        check("street.floors[1]", street.floors[1] as f64, Range(street.floors[0] as f64, 10.0))?;
        check("street.open_plots", street.open_plots, Range(0.0, 1.0))?;
        check("street.tree_spacing_m", street.tree_spacing_m, Range(4.0, 100.0))?;
        check("street.texture_scale", street.texture_scale, Range(0.3, 4.0))?;
        let traffic = &self.traffic;
        check("traffic.ego_speed", traffic.ego_speed, Range(0.0, 20.0))?;
        let distance = traffic.ego_speed * self.frame_time(self.num_frames);
        check("traffic.ego_speed times duration_s", distance, Range(0.0, MAX_EGO_DISTANCE + 1e-6))?;
        check("traffic.num_cars", traffic.num_cars as f64, Range(0.0, 30.0))?;
        check("traffic.speeds[0]", traffic.speeds[0], Range(0.0, 20.0))?;
        check("traffic.speeds[1]", traffic.speeds[1], Range(traffic.speeds[0], 20.0))?;
        check("traffic.num_people", traffic.num_people as f64, Range(0.0, 30.0))?;
        check("traffic.parked", traffic.parked, Range(0.0, 1.0))?;
        traffic.busy.iter().try_for_each(BusySpec::validate)?;
        check("light.sun_azimuth_deg", self.light.sun_azimuth_deg, Range(-360.0, 360.0))?;
        check("light.sun_elevation_deg", self.light.sun_elevation_deg, Range(5.0, 90.0))?;
        check("light.overcast", self.light.overcast, Range(0.0, 1.0))?;
        check("light.clouds", self.light.clouds, Range(0.0, 1.0))?;
        check("light.haze_m", self.light.haze_m, Range(50.0, 1e5))?;
        for (axis, value) in self.origin.position.into_iter().enumerate() {
            check(format!("origin.position[{axis}]"), value, Range(-1e8, 1e8))?;
        }
        check("origin.heading_deg", self.origin.heading_deg, Range(-360.0, 360.0))?;
        check("origin.time_s", self.origin.time_s, Range(-1e11, 1e11))
    }
}
