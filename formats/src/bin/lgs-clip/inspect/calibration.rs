//! Whether a calibration is that of the camera that took the images: sweeps are laid over images at the clip's pose and at others beside
//! it, and their edges compared.
//!
//! # Source
//! After J. Levinson and S. Thrun, "Automatic Online Calibration of Cameras and Lasers", 2013; shifts and turns to the side alone, which
//! are what a row of beams tells, and mirrored worlds.

use anyhow::Result;
use glam::DVec3;
use lgs_formats::{camera::Camera, clip_dir::ClipDir, image::ImageSize};

use super::{
    edges::{Edge, of_image, of_sweep},
    project::camera_from_lidar,
};

/// Width at which images are compared, pixels.
const WIDTH: usize = 621;
/// Most frames that are compared of a camera: more are spread evenly.
const MAX_FRAMES: usize = 6;
/// Steps of the shift and of the turn on either side, and their sizes, metres and degrees.
const NUM_SHIFTS: i32 = 10;
const SHIFT: f64 = 0.08;
const NUM_TURNS: i32 = 6;
const TURN_DEG: f64 = 0.25;
/// The same in a mirrored world, whose mirror image fits as it is or nowhere.
const MIRRORED: [i32; 2] = [1, 1];
/// Parts of the image's width, each of which has a say of its own.
const NUM_PARTS: usize = 16;
/// Least weight of the edges of a part that has a say, and of all of them, and fewest parts.
const MIN_PART_EDGES: f64 = 3.0;
const MIN_EDGES: f64 = 300.0;
const MIN_PARTS: usize = 4;
/// Smallest shift and turn that are worth saying, metres and degrees: cars that turn between sweep and exposure make smaller ones.
const MIN_SHIFT: f64 = 0.3;
const MIN_TURN_DEG: f64 = 1.0;
/// Largest share of the best agreement that a pose has which is not the camera's.
const MAX_SHARE: f64 = 0.5;
/// Smallest agreement that says anything.
const MIN_AGREEMENT: f64 = 0.012;
/// Times its standard error that an improvement is larger than.
const MIN_ERRORS: f64 = 2.0;

/// Another pose of the camera, or another world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Other {
    /// Metres to the right.
    shift: f64,
    /// Degrees to the right.
    turn_deg: f64,
    /// Whether left and right are taken for each other.
    mirrored: bool,
}

impl Other {
    fn all() -> Vec<Self> {
        let steps = |count: i32, size: f64| (-count..=count).map(move |step| f64::from(step) * size);
        let poses = |[shifts, turns]: [i32; 2], mirrored: bool| {
            steps(shifts, SHIFT)
                .flat_map(move |shift| steps(turns, TURN_DEG).map(move |turn_deg| Self { shift, turn_deg, mirrored }))
        };
        let beside = poses([NUM_SHIFTS, NUM_TURNS], false);
        std::iter::once(Self::default()).chain(beside).chain(poses(MIRRORED, true)).collect()
    }

    /// A place in the frame of the camera there.
    fn place(&self, p: DVec3) -> DVec3 {
        let (sin, cos) = self.turn_deg.to_radians().sin_cos();
        let x = if self.mirrored { -p.x } else { p.x } - self.shift;
        DVec3::new(cos * x - sin * p.z, p.y, sin * x + cos * p.z)
    }

    /// Whether the difference to the clip's pose is worth saying.
    fn is_far(&self) -> bool {
        self.mirrored || self.shift.abs() >= MIN_SHIFT || self.turn_deg.abs() >= MIN_TURN_DEG
    }
}

/// Agreement of edges in the parts of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Agreement {
    sums: [f64; NUM_PARTS],
    weights: [f64; NUM_PARTS],
}

impl Agreement {
    fn mean(&self, part: usize) -> f64 {
        self.sums[part] / self.weights[part].max(MIN_PART_EDGES)
    }
}

/// One sentence for each camera whose images fit the sweeps clearly better elsewhere.
pub(super) fn warnings(dir: &ClipDir) -> Result<Vec<String>> {
    let mut names: Vec<&str> = Vec::new();
    for record in dir.clip().frames.iter().flat_map(|frame| &frame.cameras) {
        if !names.contains(&record.camera.name.as_str()) {
            names.push(&record.camera.name);
        }
    }
    let mut found = Vec::new();
    for name in names {
        found.extend(verdict(&compared(dir, name)?).map(|other| format!("{name}: {}", words(&other))));
    }
    Ok(found)
}

fn words(other: &Other) -> String {
    let cause = "a calibration that is not this camera's?";
    if other.mirrored {
        return "edges of the sweeps fit those of the images clearly better with left and right exchanged: a left-handed world?".to_owned();
    }
    let side = |value: f64| if value < 0.0 { "left" } else { "right" };
    let Other { shift, turn_deg, .. } = other;
    let mut pose = format!("{:.2} m farther {}", shift.abs(), side(*shift));
    if *turn_deg != 0.0 {
        pose += &format!(" and turned by {:.2} degrees to the {}", turn_deg.abs(), side(*turn_deg));
    }
    format!("edges of the sweeps fit those of the images clearly better with the camera {pose}: {cause}")
}

/// `[others]` the agreement of the edges of a camera's images with those of their sweeps; the first is that at the clip's poses.
fn compared(dir: &ClipDir, name: &str) -> Result<Vec<(Other, Agreement)>> {
    let frames = &dir.clip().frames;
    let place = |f: usize| frames[f].cameras.iter().position(|record| record.camera.name == name);
    let of_camera: Vec<(usize, usize)> = (0..frames.len()).filter_map(|f| Some((f, place(f)?))).collect();
    let count = of_camera.len().min(MAX_FRAMES);
    let mut found: Vec<(Other, Agreement)> = Other::all().into_iter().map(|o| (o, Agreement::default())).collect();
    for k in 0..count {
        let (frame, index) = of_camera[k * (of_camera.len() - 1) / (count - 1).max(1)];
        let declared = &frames[frame].cameras[index].camera;
        let [width, height] = [declared.width, declared.height].map(|side| side as usize);
        if width < NUM_PARTS || height < 2 {
            continue;
        }
        let size = ImageSize { height: (height * WIDTH / width).clamp(1, 4 * WIDTH), width: WIDTH };
        let image = dir.load_image(frame, index, Some(size))?;
        let pose = camera_from_lidar(&image.camera, &frames[frame].lidar.world_from_lidar);
        let edges = of_sweep(&dir.load_sweep(frame)?, &pose);
        let of_image = of_image(&image);
        for (other, agreement) in &mut found {
            add(agreement, &edges, other, &image.camera, &of_image);
        }
    }
    Ok(found)
}

/// Adds the agreement of edges with an image. An edge belongs to the part where the clip's pose sees it, or its mirror image.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels inside of the image")]
fn add(agreement: &mut Agreement, edges: &[Edge], other: &Other, camera: &Camera, of_image: &[f32]) {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let k = camera.intrinsics;
    let home = Other { mirrored: other.mirrored, ..Other::default() };
    for edge in edges {
        let at_home = home.place(edge.place);
        let column = k.fx * at_home.x / at_home.z + k.cx;
        let p = other.place(edge.place);
        let (u, v) = (k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy);
        let inside = p.z > 0.1 && u >= 0.0 && u < width && v >= 0.0 && v < height && column >= 0.0 && column < width;
        if !inside {
            continue;
        }
        let value = f64::from(of_image[v as usize * camera.width as usize + u as usize]);
        if !value.is_nan() {
            let part = ((column / width * NUM_PARTS as f64) as usize).min(NUM_PARTS - 1);
            agreement.sums[part] += edge.weight * value;
            agreement.weights[part] += edge.weight;
        }
    }
}

/// The pose that fits clearly better than the first; `None` where none does.
fn verdict(found: &[(Other, Agreement)]) -> Option<Other> {
    let own = &found.first()?.1;
    let parts: Vec<usize> = (0..NUM_PARTS).filter(|&part| own.weights[part] >= MIN_PART_EDGES).collect();
    if parts.len() < MIN_PARTS || own.weights.iter().sum::<f64>() < MIN_EDGES {
        return None;
    }
    // A part with many edges has more to say, but not as much more as it has edges: they are of the same things.
    let weight = |part: usize| own.weights[part].sqrt();
    let total: f64 = parts.iter().map(|&part| weight(part)).sum();
    let mean = |value: &dyn Fn(usize) -> f64| parts.iter().map(|&part| weight(part) * value(part)).sum::<f64>() / total;
    let score = |agreement: &Agreement| mean(&|part| agreement.mean(part));
    let (best, agreement) = found.iter().max_by(|a, b| score(&a.1).total_cmp(&score(&b.1)))?;
    let gain = |part: usize| agreement.mean(part) - own.mean(part);
    let mean_gain = mean(&gain);
    let spread = mean(&|part| (gain(part) - mean_gain).powi(2)).sqrt();
    let error = spread / ((parts.len() - 1) as f64).sqrt();
    let clearly = score(agreement) >= MIN_AGREEMENT
        && score(own) <= MAX_SHARE * score(agreement)
        && mean_gain >= MIN_ERRORS * error;
    (clearly && best.is_far()).then_some(*best)
}
