//! Where the page can stand: the cameras of the clip.

use crate::cloud::SplatCloud;

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

impl Stop {
    /// A camera at the origin, where the first sweep of our scenes was taken, that looks along x, z up.
    pub fn forward(cloud: &SplatCloud) -> Self {
        #[rustfmt::skip]
        let scene_from_camera = [
            0.0,  0.0, 1.0, 0.0,
           -1.0,  0.0, 0.0, 0.0,
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
