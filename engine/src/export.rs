//! A scene as a splat cloud, the form in which files hold it.

use glam::{DMat3, DQuat, DVec3};
use lgs_formats::casts::to_f32;
use lgs_formats::{
    cloud::{SH_DC, SplatCloud},
    viewer::Stop,
};

use crate::{
    densify::DensityMap,
    error::Result,
    gaussians::{GaussianSet, LOGIT_OPACITY, mean_of, physical::to_physical},
    views::View,
};

/// Columns of a policy's scores: how much pruning and how much a copy would help, 0 to 1.
pub(crate) const SCORE_COLUMNS: [&str; 2] = ["p_prune", "p_add"];

/// In which colours and axes files hold a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// What brings the scene's colours to those of a camera.
    pub brightness: f32,
    /// The axes of the clip frame in those of the file; `None` where they are the same.
    pub turn: Option<DMat3>,
}

impl Shown {
    /// As the scene is.
    pub const AS_IT_IS: Self = Self { brightness: 1.0, turn: None };

    fn place(self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let Some(turn) = self.turn else { return [x, y, z] };
        (turn * DVec3::new(f64::from(x), f64::from(y), f64::from(z))).to_array().map(to_f32)
    }

    fn quat(self, [w, x, y, z]: [f32; 4]) -> [f32; 4] {
        let Some(turn) = self.turn else { return [w, x, y, z] };
        let own = DQuat::from_xyzw(f64::from(x), f64::from(y), f64::from(z), f64::from(w));
        let turned = DQuat::from_mat3(&turn) * own;
        [turned.w, turned.x, turned.y, turned.z].map(to_f32)
    }
}

/// The scene as a splat cloud, Gaussian by Gaussian in the order of the set, as it is drawn: scales inside their clamp,
/// quaternions of length one (the identity for one without direction), velocities, times and frames beside the usual properties. With a
/// policy's scores two further columns, `SCORE_COLUMNS`, which are 0 for the background.
///
/// # Formula
/// `sh_dc = (brightness * colour - 0.5) / Y_0`, `Y_0 = 1 / (2 sqrt(pi))`, where `brightness` brings the scene's colours to those of a camera: see
/// [`Photometry::brightness`](crate::photometry::Photometry::brightness). Places, orientations and velocities are turned as `shown` says.
///
/// # Errors
/// [`crate::error::EngineError::NonFinite`] for the first Gaussian with a value that is not finite.
pub fn to_cloud(set: &GaussianSet, density: Option<&DensityMap>, shown: Shown) -> Result<SplatCloud> {
    let brightness = shown.brightness;
    set.check_finite()?;
    let physical = to_physical(set);
    let rows = &set.attributes;
    Ok(SplatCloud {
        means: rows.iter().map(|row| shown.place(mean_of(row))).collect(),
        log_scales: physical.iter().map(|splat| splat.scale.map(f32::ln)).collect(),
        quats: physical.iter().map(|splat| shown.quat(normalised(splat.quat))).collect(),
        logit_opacities: rows.iter().map(|row| row[LOGIT_OPACITY]).collect(),
        sh_dc: physical.iter().map(|splat| splat.colour.map(|c| (brightness * c - 0.5) / SH_DC)).collect(),
        velocities: set.velocities.iter().map(|&velocity| shown.place(velocity)).collect(),
        times: set.times.clone(),
        frames: Some(set.frames.clone()),
        extra: density.map(|map| score_columns(map, set.len())).unwrap_or_default(),
    })
}

/// The camera of a view as a place to stand at in the viewer of a scene in the axes of `shown`.
pub fn stop(view: &View, shown: Shown) -> Stop {
    let pinhole = &view.pinhole;
    let rows = pinhole.camera_from_clip.map(|row| {
        let [x, y, z, w] = row.map(f64::from);
        let [x, y, z] = shown.turn.map_or([x, y, z], |turn| (turn * DVec3::new(x, y, z)).to_array());
        [x, y, z, w]
    });
    // the inverse of a rigid transform: transposed rotation, and the camera's centre
    let centre = |k: usize| -(0..3).map(|r| rows[r][k] * rows[r][3]).sum::<f64>();
    let scene_from_camera = std::array::from_fn(|i| match (i / 4, i % 4) {
        (3, 3) => 1.0,
        (3, _) => 0.0,
        (k, 3) => centre(k),
        (k, r) => rows[r][k],
    });
    Stop {
        name: format!("frame {} {}", view.frame, view.camera),
        time: f64::from(pinhole.time),
        width: pinhole.width,
        height: pinhole.height,
        fx: f64::from(pinhole.fx),
        fy: f64::from(pinhole.fy),
        cx: f64::from(pinhole.cx),
        cy: f64::from(pinhole.cy),
        scene_from_camera,
    }
}

/// Scores by column, of the `LiDAR` branch and zeros behind it.
fn score_columns(map: &DensityMap, len: usize) -> Vec<(String, Vec<f32>)> {
    let column = |scores: &[f32]| scores.iter().copied().chain(std::iter::repeat(0.0)).take(len).collect();
    let columns = [column(&map.updated.prune), column(&map.updated.add)];
    SCORE_COLUMNS.map(str::to_owned).into_iter().zip(columns).collect()
}

/// The quaternion at length one; the identity when it has no length.
fn normalised(quat: [f32; 4]) -> [f32; 4] {
    let length = quat.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>().sqrt();
    if length == 0.0 { [1.0, 0.0, 0.0, 0.0] } else { quat.map(|v| to_f32(f64::from(v) / length)) }
}

#[cfg(test)]
mod tests {
    use lgs_formats::image::RgbImage;

    use super::*;
    use crate::gaussians::{LOG_SCALE, LOGIT_COLOUR, MEAN, QUAT};
    use crate::views::{PinholeView, Role};

    /// One Gaussian of the `LiDAR` branch and one of the background, the same but for the branch.
    fn pair() -> GaussianSet {
        let mut row = [0.0; 14];
        row[MEAN].copy_from_slice(&[1.0, -2.0, 3.0]);
        row[QUAT].copy_from_slice(&[0.0, 3.0, 0.0, 4.0]);
        row[LOG_SCALE].copy_from_slice(&[-1.0, 2.0, -20.0]);
        row[LOGIT_OPACITY] = 0.25;
        row[LOGIT_COLOUR].copy_from_slice(&[0.0, 30.0, -30.0]);
        GaussianSet {
            attributes: vec![row; 2],
            times: vec![0.1, 0.0],
            frames: vec![2, 0],
            velocities: vec![[5.0, 0.0, 0.0], [0.0; 3]],
            num_lidar: 1,
        }
    }

    #[test]
    fn the_cloud_is_the_scene_as_it_is_drawn() {
        let cloud = to_cloud(&pair(), None, Shown::AS_IT_IS).unwrap();
        let near = |got: f32, want: f32| assert!((got - want).abs() < 1e-5, "got {got}, want {want}");
        assert_eq!(cloud.means, [[1.0, -2.0, 3.0]; 2]);
        assert_eq!((cloud.times, cloud.velocities), (vec![0.1, 0.0], vec![[5.0, 0.0, 0.0], [0.0; 3]]));
        assert_eq!(cloud.logit_opacities, [0.25; 2]);
        assert_eq!(cloud.frames, Some(vec![2, 0]));
        cloud.quats[0].into_iter().zip([0.0, 0.6, 0.0, 0.8]).for_each(|(got, want)| near(got, want));
        // scales clamped to 1e-4..1 m, in the background below only
        cloud.log_scales[0].into_iter().zip([-1.0, 0.0, 1e-4_f32.ln()]).for_each(|(got, want)| near(got, want));
        near(cloud.log_scales[1][1], 2.0);
        // colours 0.5, 1, 0 stand at 0 and at plus and minus sqrt(pi)
        let end = std::f32::consts::PI.sqrt();
        cloud.sh_dc[0].into_iter().zip([0.0, end, -end]).for_each(|(got, want)| near(got, want));
    }

    #[test]
    fn a_stop_stands_where_its_camera_stood() {
        let camera_from_clip = [[0.0, -1.0, 0.0, 2.0], [0.0, 0.0, -1.0, 1.5], [1.0, 0.0, 0.0, -7.0]];
        let pinhole = PinholeView {
            width: 4,
            height: 2,
            fx: 3.0,
            fy: 3.0,
            cx: 2.0,
            cy: 1.0,
            camera_from_clip,
            time: 0.5,
            shutter: None,
            pixel_side: 1.0,
        };
        let image = RgbImage { width: 4, height: 2, data: vec![0.0; 24] };
        let (camera, role) = ("front".to_owned(), Role::Input);
        let view = View {
            frame: 3,
            camera,
            role,
            pinhole,
            image,
            labels: None,
            response: None,
            depth_map: None,
            depth_samples: Vec::new(),
        };
        let stop = stop(&view, Shown::AS_IT_IS);
        assert_eq!((stop.name.as_str(), stop.time), ("frame 3 front", 0.5));
        let want = [0.0, 0.0, 1.0, 7.0, -1.0, 0.0, 0.0, 2.0, 0.0, -1.0, 0.0, 1.5, 0.0, 0.0, 0.0, 1.0];
        assert_eq!(stop.scene_from_camera, want);
    }

    #[test]
    fn a_value_that_is_not_finite_is_named() {
        let mut set = pair();
        set.attributes[1][LOG_SCALE.start + 2] = f32::NAN;
        let error = to_cloud(&set, None, Shown::AS_IT_IS).unwrap_err().to_string();
        assert_eq!(error, "Gaussian 1, log scale: expected a finite value, found NaN");
        set = pair();
        set.velocities[0][1] = f32::INFINITY;
        assert!(to_cloud(&set, None, Shown::AS_IT_IS).unwrap_err().to_string().starts_with("Gaussian 0, velocity"));
    }

    #[test]
    fn a_quaternion_without_direction_becomes_the_identity_and_a_huge_one_keeps_its_direction() {
        assert_eq!(normalised([0.0; 4]), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(normalised([0.0, 1e30, 0.0, 0.0]), [0.0, 1.0, 0.0, 0.0]);
    }
}
