//! Poses over time.

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat};

use crate::{
    error::{FormatError, Result},
    pose::Pose,
};

/// Farthest that a moment may lie outside the poses, seconds: it then takes the nearest pair's motion on.
const MAX_BEYOND: f64 = 0.2;

/// A pose and its moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    /// Seconds.
    pub(super) time: f64,
    pub(super) pose: Pose,
}

/// Poses of one body, sorted by time.
#[derive(Clone, Debug)]
pub(super) struct Trajectory {
    file: PathBuf,
    moments: Vec<Moment>,
}

impl Trajectory {
    /// The trajectory of poses that were read from `file`.
    ///
    /// # Errors
    /// No poses, or a time that is no number.
    pub(super) fn new(file: &Path, mut moments: Vec<Moment>) -> Result<Self> {
        if moments.is_empty() {
            return Err(FormatError::invalid(file, "poses", "at least one", "none"));
        }
        if let Some(index) = moments.iter().position(|moment| !moment.time.is_finite()) {
            return Err(FormatError::invalid(file, format!("poses[{index}]"), "a finite time", "none"));
        }
        moments.sort_by(|a, b| a.time.total_cmp(&b.time));
        moments.dedup_by(|b, a| a.time >= b.time);
        Ok(Self { file: file.to_owned(), moments })
    }

    /// The pose at `time`: between two poses, linear in translation and spherical in rotation. Where poses are missing, the motion goes on
    /// as beside the hole, as far as beyond the first and the last pose.
    ///
    /// # Errors
    /// A time too far from all poses, or beside a pose that stands alone between holes.
    pub(super) fn at(&self, time: f64) -> Result<Pose> {
        let after = self.moments.partition_point(|moment| moment.time < time);
        if let Some(moment) = self.moments.get(after).filter(|moment| moment.time <= time) {
            return Ok(moment.pose);
        }
        let before = after.checked_sub(1).and_then(|index| self.moments.get(index));
        let next = self.moments.get(after);
        let away = |moment: Option<&Moment>| moment.map_or(f64::INFINITY, |moment| (moment.time - time).abs());
        let joined = |second: usize| {
            let pair = self.moments.get(second.checked_sub(1)?..=second)?;
            (pair[1].time - pair[0].time <= 2.0 * MAX_BEYOND).then_some(second)
        };
        let nearest = if away(before) <= away(next) { before } else { next };
        let second = match nearest {
            Some(only) if self.moments.len() == 1 && away(nearest) <= MAX_BEYOND => return Ok(only.pose),
            Some(_) if away(nearest) <= MAX_BEYOND => joined(after)
                .or_else(|| if away(before) <= away(next) { joined(after.checked_sub(1)?) } else { joined(after + 1) }),
            _ => None,
        };
        let Some(second) = second else {
            let expected = format!("a pose within {MAX_BEYOND} s of {time} s");
            return Err(FormatError::invalid(&self.file, "poses", expected, self.around(before, next)));
        };
        let (a, b) = (self.moments[second - 1], self.moments[second]);
        Ok(between(&a.pose, &b.pose, (time - a.time) / (b.time - a.time)))
    }

    /// Which poses there are, in words.
    fn around(&self, before: Option<&Moment>, next: Option<&Moment>) -> String {
        match (before, next) {
            (Some(a), Some(b)) => format!("none between {} and {} s", a.time, b.time),
            _ => format!("{} to {} s", self.moments[0].time, self.moments[self.moments.len() - 1].time),
        }
    }
}

/// The pose a share of the way from `a` to `b`.
pub(super) fn between(a: &Pose, b: &Pose, share: f64) -> Pose {
    let turn = DQuat::from_mat3(&(a.rotation().transpose() * b.rotation()));
    let turn = if turn.w < 0.0 { -turn } else { turn };
    let rotation = a.rotation() * DMat3::from_quat(DQuat::from_scaled_axis(turn.to_scaled_axis() * share));
    Pose::new(rotation, a.translation().lerp(b.translation(), share))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn poses_turn_and_move_evenly_between_their_moments() {
        let pose = |angle: f64, x: f64| Pose::new(DMat3::from_rotation_z(angle), DVec3::new(x, 0.0, 0.0));
        let moments = vec![Moment { time: 1.4, pose: pose(0.28, 2.8) }, Moment { time: 1.0, pose: pose(0.2, 2.0) }];
        let trajectory = Trajectory::new(Path::new("poses"), moments).unwrap();
        for time in [1.0, 1.15, 1.4, 1.5, 0.9] {
            let got = trajectory.at(time).unwrap();
            let want = pose(0.2 * time, 2.0 * time);
            assert!(got.translation().distance(want.translation()) < 1e-12);
            assert!((got.rotation() - want.rotation()).to_cols_array().iter().all(|d| d.abs() < 1e-12), "{time}");
        }
        let message = trajectory.at(1.7).unwrap_err().to_string();
        assert_eq!(message, "poses: poses: expected a pose within 0.2 s of 1.7 s, found 1 to 1.4 s");
        assert!(trajectory.at(f64::NAN).is_err());
        assert!(Trajectory::new(Path::new("p"), Vec::new()).is_err());
    }

    #[test]
    fn a_hole_between_poses_is_as_wide_as_beyond_the_ends() {
        // A turn within the hole: what is beside it goes on, nothing is bridged.
        let place = |time: f64| DVec3::new(if time < 2.0 { time } else { 100.0 - time }, 0.0, 0.0);
        let moment = |time: f64| Moment { time, pose: Pose::new(DMat3::IDENTITY, place(time)) };
        let moments = [0.0, 0.1, 0.2, 2.3, 2.4, 9.0].map(moment).to_vec();
        let trajectory = Trajectory::new(Path::new("poses"), moments).unwrap();
        for time in [0.15, 0.3, 0.39, 2.2, 2.35] {
            let got = trajectory.at(time).unwrap().translation();
            assert!(got.distance(place(time)) < 1e-9, "{time}: {got}");
        }
        let message = trajectory.at(1.25).unwrap_err().to_string();
        assert_eq!(message, "poses: poses: expected a pose within 0.2 s of 1.25 s, found none between 0.2 and 2.3 s");
        assert!(trajectory.at(0.41).is_err() && trajectory.at(2.0).is_err() && trajectory.at(8.95).is_err());
        assert!(trajectory.at(9.0).is_ok() && trajectory.at(9.1).is_err());
    }
}
