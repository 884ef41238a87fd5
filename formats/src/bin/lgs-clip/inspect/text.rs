//! An inspection for people.

use std::fmt;

use lgs_formats::camera::ReadoutDirection;

use super::{CameraReport, Report, Returns};

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = |f: &mut fmt::Formatter<'_>, name: &str, value: &str| writeln!(f, "  {name:<18} {value}");
        writeln!(f, "{}", self.clip)?;
        line(f, "source", &self.source)?;
        line(f, "licence", &self.licence)?;
        line(
            f,
            "frames",
            &format!("{} over {:.2} s, {:.1} m driven", self.num_frames, self.duration_s, self.lidar.path_m),
        )?;
        let (points, rate) = (self.lidar.num_points, hertz(self.lidar.rate_hz));
        line(f, "LiDAR", &format!("{:.0} to {:.0} points a sweep{rate}", points.min, points.max))?;
        let (min, max) = (self.lidar.extent_min, self.lidar.extent_max);
        let extent = |axis: usize| format!("{:.0} to {:.0}", min[axis], max[axis]);
        line(f, "extent", &format!("x {}, y {}, z {} m", extent(0), extent(1), extent(2)))?;
        if let Some(returns) = &self.lidar.returns {
            line(f, "returns", &of_returns(returns, self.num_frames))?;
        }
        for camera in &self.cameras {
            line(f, &camera.name, &of_camera(camera))?;
        }
        if !self.cameras.is_empty() {
            line(f, "seen by no camera", &format!("{:.0} % of the points", self.unseen_share * 100.0))?;
        }
        match &self.boxes {
            Some(boxes) => {
                let kinds: Vec<String> =
                    boxes.categories.iter().map(|(name, count)| format!("{count} {name}")).collect();
                line(f, "tracks", &format!("{} ({})", boxes.num_tracks, kinds.join(", ")))?;
            }
            None => line(f, "tracks", "none given")?,
        }
        for warning in &self.warnings {
            line(f, "look at", warning)?;
        }
        Ok(())
    }
}

fn hertz(rate: Option<f64>) -> String {
    rate.map_or(String::new(), |rate| format!(", {rate:.1} Hz"))
}

fn of_returns(returns: &Returns, num_frames: usize) -> String {
    let mut text = if returns.num_timed == 0 {
        "without times".to_owned()
    } else {
        format!("{:+.0} to {:+.0} ms from their sweep's timestamp", returns.first_ms.min, returns.last_ms.max)
    };
    if (1..num_frames).contains(&returns.num_timed) {
        text += &format!(" in {} of {num_frames} sweeps", returns.num_timed);
    }
    text +=
        if returns.motion_compensated { ", compensated for the motion" } else { ", not compensated for the motion" };
    if returns.num_sensors > 1 {
        text += &format!(", of {} sensors", returns.num_sensors);
    }
    text
}

/// All sizes of a camera's images, largest last.
fn of_sizes(camera: &CameraReport) -> String {
    let own = [[camera.height, camera.width]];
    let sizes = camera.sizes.as_deref().unwrap_or(&own);
    sizes.iter().map(|[height, width]| format!("{height}x{width}")).collect::<Vec<_>>().join(" and ")
}

fn of_camera(camera: &CameraReport) -> String {
    let (offset, share) = (camera.offset_ms, camera.visible_share.mean * 100.0);
    let mut text = format!(
        "{} images of {}{}, {:+.0} ms to the sweep, sees {share:.0} % of the points",
        camera.num_images,
        of_sizes(camera),
        hertz(camera.rate_hz),
        offset.mean,
    );
    for (has, word) in [(camera.distorted, ", distorted"), (camera.fisheye, ", fisheye"), (camera.masked, ", masked")] {
        if has {
            text += word;
        }
    }
    if let Some(readout) = camera.readout {
        let (from, to) = match readout.direction {
            ReadoutDirection::TopToBottom => ("top", "bottom"),
            ReadoutDirection::BottomToTop => ("bottom", "top"),
            ReadoutDirection::LeftToRight => ("left", "right"),
            ReadoutDirection::RightToLeft => ("right", "left"),
        };
        text += &format!(", read out from {from} to {to} in {:.0} ms", readout.seconds * 1e3);
        if readout.middle != 0.0 {
            text += &format!(", the middle {:+.0} ms after its timestamp", readout.middle * 1e3);
        }
    }
    if let Some(kind) = camera.depth_maps {
        text += &format!(", {kind} depth maps");
    }
    text
}
