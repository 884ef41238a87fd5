//! Rolling shutters: when each part of an image is exposed, and where the camera is then.

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use lgs_formats::casts::to_f32;
use lgs_formats::{camera_motion::CameraMotion, pose::Pose};

use super::PinholeView;

/// How far beyond its image a camera is followed, in readouts.
const BEYOND: f64 = 0.5;
/// Lines that a point moves over while the shutter goes over one, at most: what is faster is beside the camera and out of its image.
pub(crate) const FASTEST: f64 = 0.5;
/// Half an angle up to which five terms of a sine and a cosine are exact in f64, radians: the sixth is below 1e-17.
const SMALL_TURN: f64 = 0.1;

/// The rolling shutter of a view, and how its camera moves meanwhile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shutter {
    /// Seconds after the view's time at the upper left corner of the image.
    pub(crate) first: f64,
    /// Seconds a pixel to the right, and a pixel down.
    pub(crate) by_pixel: DVec2,
    /// Earliest and latest moment at which the camera is followed, seconds.
    pub(crate) limits: [f64; 2],
    /// Rotation vector of the camera a second, radians, in its own axes at the view's time.
    pub(crate) turn: DVec3,
    /// Velocity of the camera, metres a second, in the same axes.
    pub(crate) drift: DVec3,
}

/// What a shutter makes of a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taken {
    /// Seconds after the view's time at which the point is exposed.
    pub(crate) seconds: f64,
    /// How places around its image are drawn apart, since they are exposed at other moments.
    pub(crate) bend: DMat2,
}

impl Shutter {
    /// The shutter of an image of a size in pixels: `moments` as a loaded image has them, the motion by its camera, whose pose is given.
    pub fn new(
        moments: [f64; 3],
        [width, height]: [usize; 2],
        motion: &CameraMotion,
        world_from_camera: &Pose,
    ) -> Self {
        let [first, across, down] = moments;
        let corners = [first, first + across, first + down, first + across + down];
        let least = corners.into_iter().fold(f64::INFINITY, f64::min);
        let most = corners.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let room = BEYOND * (most - least);
        Self {
            first,
            by_pixel: DVec2::new(across / width as f64, down / height as f64),
            limits: [least - room, most + room],
            turn: motion.turn,
            drift: world_from_camera.rotation().transpose() * motion.velocity,
        }
    }

    /// Seconds after the view's time at which an image position (pixels) is exposed.
    pub fn moment(&self, [u, v]: [f32; 2]) -> f64 {
        let at = DVec2::new(f64::from(u), f64::from(v));
        self.limited(self.first + self.by_pixel.dot(at))
    }

    #[inline(always)]
    fn limited(&self, seconds: f64) -> f64 {
        seconds.clamp(self.limits[0], self.limits[1])
    }

    /// When a point is exposed that is at `point / weight` in the camera's axes at the view's time and moves there with `velocity`, metres a second.
    ///
    /// # Formula
    /// With `m(x)` the moment of image position x, `x_0` and `r` the point's at the view's time and its rate there: the solution
    /// `m(x_0) / (1 - grad m r)` of `s = m(x_0 + r s)`, a Newton step. Around it, places are drawn apart by `I + r grad m^T / (1 - grad m r)`.
    #[inline(always)]
    pub(crate) fn taken(&self, view: &Lens, point: DVec3, weight: f64, velocity: DVec3) -> Taken {
        let nearness = 1.0 / point.z;
        let slope = DVec2::new(point.x, point.y) * nearness;
        let moves = weight * (velocity - self.drift) - self.turn.cross(point);
        let rate = view.focal * (DVec2::new(moves.x, moves.y) - slope * moves.z) * nearness;
        let swift = rate.length_squared() * self.by_pixel.length_squared();
        let rate = if swift > FASTEST * FASTEST { rate * (FASTEST / swift.sqrt()) } else { rate };
        let start = self.limited(self.first + self.by_pixel.dot(view.focal * slope + view.centre));
        let newton = 1.0 / (1.0 - self.by_pixel.dot(rate));
        let r = rate * newton;
        Taken {
            seconds: self.limited(start * newton),
            bend: DMat2::IDENTITY + DMat2::from_cols(r * self.by_pixel.x, r * self.by_pixel.y),
        }
    }

    /// How far a standing point that is at `point / weight` in the camera's axes at the view's time has moved in these when it is exposed, times the
    /// weight; to first order in the motion.
    pub(crate) fn shift(&self, view: &Lens, point: [f32; 3], weight: f32) -> [f32; 3] {
        let (p, weight) = (DVec3::from(point.map(f64::from)), f64::from(weight));
        let seconds = self.taken(view, p, weight, DVec3::ZERO).seconds;
        (-seconds * (weight * self.drift + self.turn.cross(p))).to_array().map(to_f32)
    }

    /// The camera `seconds` after the view's time: what turns its axes at the view's time, and what is added to translations before that.
    #[inline(always)]
    pub(crate) fn carried(&self, seconds: f64) -> (DMat3, DVec3) {
        (DMat3::from_quat(turned(-self.turn * seconds)), -self.drift * seconds)
    }

    /// A point in the axes of the camera at the moment at which an image position (pixels) is exposed, in those at the view's time.
    pub(super) fn carried_back(&self, position: [f32; 2], point: [f32; 3]) -> [f32; 3] {
        let (turn, shift) = self.carried(self.moment(position));
        (turn.transpose() * DVec3::from(point.map(f64::from)) - shift).to_array().map(to_f32)
    }

    /// The shutter of a part of the image whose upper left corner is at a place of it, pixels.
    #[must_use]
    pub fn cropped(&self, corner: [f32; 2]) -> Self {
        let corner = DVec2::new(f64::from(corner[0]), f64::from(corner[1]));
        Self { first: self.first + self.by_pixel.dot(corner), ..*self }
    }

    /// The shutter of what a mirror shows in which left is right; the image is so many pixels wide.
    #[must_use]
    pub fn mirrored(&self, width: usize) -> Self {
        Self {
            first: self.first + self.by_pixel.x * width as f64,
            by_pixel: self.by_pixel * DVec2::new(-1.0, 1.0),
            turn: self.turn * DVec3::new(1.0, -1.0, -1.0),
            drift: self.drift * DVec3::new(-1.0, 1.0, 1.0),
            ..*self
        }
    }

    /// The shutter of the image reduced by a factor.
    pub(super) fn reduced(&self, factor: f32) -> Self {
        Self { by_pixel: self.by_pixel * f64::from(factor), ..*self }
    }
}

/// The rotation by a rotation vector, radians. Within a readout it is small, and the series of sine and cosine are exact.
#[inline(always)]
fn turned(by: DVec3) -> DQuat {
    let half = 0.5 * by;
    let square = half.length_squared();
    if square > SMALL_TURN * SMALL_TURN {
        return DQuat::from_scaled_axis(by);
    }
    let axis = half * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0))));
    let cosine = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0)));
    DQuat::from_xyzw(axis.x, axis.y, axis.z, cosine)
}

/// Focal lengths and principal point, pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lens {
    pub(crate) focal: DVec2,
    pub(crate) centre: DVec2,
}

impl PinholeView {
    pub(crate) fn lens(&self) -> Lens {
        let pair = |x: f32, y: f32| DVec2::new(f64::from(x), f64::from(y));
        Lens { focal: pair(self.fx, self.fy), centre: pair(self.cx, self.cy) }
    }

    /// The camera at the moment at which an image position (pixels) is exposed: the view itself, where its shutter does not roll.
    pub fn exposing(&self, position: [f32; 2]) -> Self {
        self.shutter.map_or(*self, |shutter| self.after(&shutter, shutter.moment(position)))
    }

    /// The moment at which an image position (pixels) is exposed, seconds since time zero.
    pub(crate) fn time_at(&self, position: [f32; 2]) -> f32 {
        self.shutter.map_or(self.time, |shutter| to_f32(f64::from(self.time) + shutter.moment(position)))
    }

    /// The moment at which a standing point of the clip frame is exposed, seconds since time zero; that of the view where it is outside.
    pub(crate) fn exposed_at(&self, point: [f32; 3]) -> f32 {
        if self.shutter.is_none() {
            return self.time;
        }
        self.project(point).map_or(self.time, |at| self.time_at([at.u, at.v]))
    }

    /// The camera at the moment at which a point of the clip frame (at the view's time; metres) that moves with `velocity` (metres a second) is
    /// exposed.
    pub(crate) fn taking(&self, shutter: &Shutter, point: [f32; 3], velocity: [f32; 3]) -> Self {
        let (_, _, seconds) = self.taken(shutter, point, velocity);
        self.after(shutter, seconds)
    }

    /// A point in the camera's axes at the view's time, its velocity there, and the seconds after it at which it is exposed.
    #[inline(always)]
    fn taken(&self, shutter: &Shutter, point: [f32; 3], velocity: [f32; 3]) -> (DVec3, DVec3, f64) {
        let in_camera = DVec3::from(self.to_camera(point).map(f64::from));
        let [x, y, z] = velocity.map(f64::from);
        let moves = self.camera_from_clip.map(|[a, b, c, _]| f64::from(a) * x + f64::from(b) * y + f64::from(c) * z);
        let moves = DVec3::from(moves);
        (in_camera, moves, shutter.taken(&self.lens(), in_camera, 1.0, moves).seconds)
    }

    /// Where a point of the clip frame (at the view's time; metres) that moves with `velocity` (metres a second) is in the camera's axes, both at
    /// the moment at which it is exposed.
    pub(super) fn when_exposed(&self, shutter: &Shutter, point: [f32; 3], velocity: [f32; 3]) -> [f32; 3] {
        let (in_camera, moves, seconds) = self.taken(shutter, point, velocity);
        let (turn, shift) = shutter.carried(seconds);
        (turn * (in_camera + shift + moves * seconds)).to_array().map(to_f32)
    }

    fn after(&self, shutter: &Shutter, seconds: f64) -> Self {
        let (turn, shift) = shutter.carried(seconds);
        let rows = self.camera_from_clip;
        let column = |c: usize| DVec3::new(f64::from(rows[0][c]), f64::from(rows[1][c]), f64::from(rows[2][c]));
        let (x, y, z, t) = (turn * column(0), turn * column(1), turn * column(2), turn * (column(3) + shift));
        let row = |k: usize| [to_f32(x[k]), to_f32(y[k]), to_f32(z[k]), to_f32(t[k])];
        let camera_from_clip = [row(0), row(1), row(2)];
        Self { camera_from_clip, time: to_f32(f64::from(self.time) + seconds), shutter: None, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::views::samples::ahead;

    const READOUT: f64 = 0.03;

    /// A camera that drives ahead at 15 m/s and turns, whose rows are read from the top down.
    fn view() -> PinholeView {
        let motion = CameraMotion { turn: DVec3::new(0.0, 0.3, 0.1), velocity: DVec3::new(1.0, 0.0, 15.0) };
        let shutter = Shutter::new([-0.5 * READOUT, 0.0, READOUT], [80, 60], &motion, &Pose::IDENTITY);
        PinholeView { shutter: Some(shutter), ..ahead(80, 60, 70.0) }
    }

    #[test]
    fn small_turns_are_turns() {
        for length in [0.0, 1e-200, 1e-9, 0.01, 0.1999, 0.2001, 3.0] {
            let by = length * DVec3::new(0.6, -0.48, 0.64);
            let (got, want) = (turned(by), DQuat::from_scaled_axis(by));
            assert!((got - want).length() < 4e-16, "{length}: {got:?} {want:?}");
        }
    }

    #[test]
    fn a_point_is_where_the_camera_of_its_own_moment_sees_it() {
        let view = view();
        let mut farthest = 0.0_f32;
        for point in [[2.0, 1.0, 4.0], [-3.0, -2.0, 8.0], [0.1, 1.4, 3.5], [10.0, -5.0, 40.0], [0.2, 0.6, 2.0]] {
            let at = view.project(point).unwrap();
            // The fixed point, by iteration.
            let mut moment = 0.0;
            for _ in 0..50 {
                let seen = view.after(&view.shutter.unwrap(), moment).project(point).unwrap();
                moment = view.shutter.unwrap().moment([seen.u, seen.v]);
            }
            let exact = view.after(&view.shutter.unwrap(), moment).project(point).unwrap();
            farthest = farthest.max((at.u - exact.u).hypot(at.v - exact.v));
            let back = view.unproject(at);
            assert!((0..3).all(|k| (back[k] - point[k]).abs() < 2e-3 * point[2]), "{back:?} {point:?}");
            let still = PinholeView { shutter: None, ..view };
            assert!(still.project(point).unwrap() != at);
        }
        assert!(farthest < 0.02, "{farthest}");
    }

    #[test]
    fn what_moves_along_with_the_camera_stays_where_it_is() {
        let motion = CameraMotion { turn: DVec3::ZERO, velocity: DVec3::new(0.0, 0.0, 15.0) };
        let shutter = Shutter::new([-0.02, 0.04, 0.0], [80, 60], &motion, &Pose::IDENTITY);
        let view = PinholeView { shutter: Some(shutter), ..ahead(80, 60, 70.0) };
        let (point, velocity) = ([3.0, 1.0, 7.0], [0.0, 0.0, 15.0]);
        let still = PinholeView { shutter: None, ..view }.project(point).unwrap();
        let seen = view.project_moving(point, velocity).unwrap();
        assert!((seen.u - still.u).hypot(seen.v - still.v) < 1e-3, "{seen:?} {still:?}");
        assert!(view.project(point).unwrap().u > still.u + 0.5);
    }

    #[test]
    fn a_reduced_image_is_exposed_at_the_same_moments() {
        let (full, half) = (view(), view().reduced(2));
        assert_eq!(full.shutter.unwrap().moment([30.0, 20.0]), half.shutter.unwrap().moment([15.0, 10.0]));
        let (a, b) = (full.project([2.0, 1.0, 4.0]).unwrap(), half.project([2.0, 1.0, 4.0]).unwrap());
        assert!((a.u - 2.0 * b.u).hypot(a.v - 2.0 * b.v) < 1e-3);
    }

    #[test]
    fn no_readout_changes_no_bit() {
        let plain = PinholeView { shutter: None, ..view() };
        assert_eq!(plain.exposing([3.0, 4.0]), plain);
        assert_eq!(plain.time_at([3.0, 4.0]), plain.time);
        assert_eq!(view().time_at([3.0, 4.0]), view().exposing([3.0, 4.0]).time);
        assert_eq!(plain.project_moving([2.0, 1.0, 4.0], [9.0, 0.0, 1.0]), plain.project([2.0, 1.0, 4.0]));
    }
}
