//! Where the page can stand: the cameras of the clip.

use crate::cloud::SplatCloud;

/// Least share of the Gaussians by which one side outweighs the other for a scene to have a front.
const LEAST_BEARING: f64 = 0.01;

/// A camera at one moment, in the frame of the scene.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Stop {
    /// What the page calls it.
    pub name: String,
    /// Moment, seconds on the scene's clock.
    pub time: f64,
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels (centre of a pixel at +0.5).
    pub cx: f64,
    /// Principal point y, pixels.
    pub cy: f64,
    /// Rows of the 4x4 matrix `scene_from_camera`, metres; camera axes x right, y down, z forward.
    pub scene_from_camera: [f64; 16],
}

/// The first moment of a cloud, seconds.
fn first_moment(cloud: &SplatCloud) -> f64 {
    cloud.times.iter().copied().filter(|t| t.is_finite()).reduce(f32::min).map_or(0.0, f64::from)
}

/// The level direction, of length 1, in which most Gaussians stand from the origin; along x where they stand all around.
///
/// # Formula
/// The sum of the level unit vectors to all of them, where it is at least a hundredth of their number long.
fn bearing(cloud: &SplatCloud) -> [f64; 2] {
    let (mut sum, mut count) = ([0.0; 2], 0.0);
    for mean in &cloud.means {
        let [x, y] = [f64::from(mean[0]), f64::from(mean[1])];
        let length = x.hypot(y);
        if length.is_finite() && length > 0.0 {
            sum = [sum[0] + x / length, sum[1] + y / length];
            count += 1.0;
        }
    }
    let length = sum[0].hypot(sum[1]);
    if length > LEAST_BEARING * count { sum.map(|part| part / length) } else { [1.0, 0.0] }
}

impl Stop {
    /// A camera at the origin, where the first sweep of our scenes was taken, that looks level, z up, to where most of the scene is.
    pub fn forward(cloud: &SplatCloud) -> Self {
        let [x, y] = bearing(cloud);
        #[rustfmt::skip]
        let scene_from_camera = [
             y,   0.0,  x,  0.0,
            -x,   0.0,  y,  0.0,
            0.0, -1.0, 0.0, 0.0,
            0.0,  0.0, 0.0, 1.0,
        ];
        let (name, width, height) = ("forward".to_owned(), 1280, 720);
        let time = first_moment(cloud);
        Self { name, time, width, height, fx: 720.0, fy: 720.0, cx: 640.0, cy: 360.0, scene_from_camera }
    }

    /// A camera above the scene that looks down on its middle half.
    pub fn overview(cloud: &SplatCloud) -> Self {
        let middle = |k: usize, share: usize| {
            let mut values: Vec<f32> = cloud.means.iter().map(|mean| mean[k]).filter(|v| v.is_finite()).collect();
            values.sort_by(f32::total_cmp);
            values.get(values.len() * share / 4).copied().map_or(0.0, f64::from)
        };
        let [x, y, z] = [0, 1, 2].map(|k| middle(k, 2));
        let extent = (middle(0, 3) - middle(0, 1)).max(middle(1, 3) - middle(1, 1)).max(10.0);
        #[rustfmt::skip]
        let scene_from_camera = [
            0.0, -1.0,  0.0, x,
           -1.0,  0.0,  0.0, y,
            0.0,  0.0, -1.0, z + extent,
            0.0,  0.0,  0.0, 1.0,
        ];
        let time = first_moment(cloud);
        let (name, width, height) = ("overview".to_owned(), 1280, 720);
        Self { name, time, width, height, fx: 720.0, fy: 720.0, cx: 640.0, cy: 360.0, scene_from_camera }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(means: Vec<[f32; 3]>) -> SplatCloud {
        SplatCloud { means, ..SplatCloud::default() }
    }

    /// Where the camera looks, and what is to its right and below.
    fn axes(stop: &Stop) -> [[f64; 3]; 3] {
        let m = &stop.scene_from_camera;
        [2, 0, 1].map(|column| [0, 1, 2].map(|row| m[4 * row + column]))
    }

    #[test]
    fn the_first_view_looks_to_where_the_scene_is() {
        let ahead = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
        assert_eq!(axes(&Stop::forward(&cloud(Vec::new()))), ahead);
        let around = [[9.0, 0.0, 1.0], [-9.0, 0.0, 1.0], [0.0, 5.0, 0.0], [0.0, -5.0, 0.0]];
        assert_eq!(axes(&Stop::forward(&cloud(around.to_vec()))), ahead);
        let left = [[1.0, 9.0, 0.0], [-1.0, 9.0, 3.0], [f32::NAN, 1.0, 0.0], [0.0, 0.0, 2.0]];
        assert_eq!(axes(&Stop::forward(&cloud(left.to_vec()))), [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]);
    }
}
