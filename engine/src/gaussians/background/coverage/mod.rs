//! How much of a view a set of Gaussians covers, whatever their order.

mod drawn;

use glam::{Quat, Vec3};

use self::drawn::Drawn;
use crate::{
    gaussians::{GaussianSet, LOG_SCALE, LOGIT_OPACITY, NUM_ATTRIBUTES, QUAT, disc::BLUR, mean_of, physical::sigmoid},
    parallel,
    views::PinholeView,
};

/// Weight below which the renderer skips a Gaussian.
const MIN_ALPHA: f32 = 1.0 / 255.0;
/// Shapes are projected as in the image widened by this share of the tangent of half the field of view, as the renderer does.
const JACOBIAN_MARGIN: f32 = 0.3;

/// A pixel needs a background when at least this share of it shows through.
const SHOWS: f32 = 0.3;
/// Logarithm of a transmittance that is surely below [`SHOWS`], by more than rounding: nothing that is added brings it back.
const SURELY_COVERED: f32 = -1.21;
/// Shapes that are projected before they are added, and how many of them a thread projects at once.
const PROJECTED: (usize, usize) = (1 << 15, 512);
/// Rows of pixels that a thread adds to at once.
const BAND: usize = 32;

/// Transmittance of a view's pixels through everything that was added, as its logarithm.
#[derive(Clone, Debug)]
pub(super) struct Coverage {
    width: usize,
    height: usize,
    /// `[H, W]` sum of `ln(1 - alpha)`, taken no further where the pixel is [`SURELY_COVERED`].
    log_transmittance: Vec<f32>,
}

impl Coverage {
    /// A view that nothing covers.
    pub(super) fn new(view: &PinholeView) -> Self {
        Self { width: view.width, height: view.height, log_transmittance: vec![0.0; view.num_pixels()] }
    }

    /// Whether so much of a pixel (row-major index) shows through that it needs a background.
    pub(super) fn shows(&self, pixel: usize) -> bool {
        self.log_transmittance[pixel].exp() >= SHOWS
    }

    /// Adds Gaussians, to every pixel in their order.
    pub(super) fn add(&mut self, view: &PinholeView, shapes: &[Shape]) {
        let (camera, size) = (Camera::new(view), [self.width, self.height]);
        let drawn = |shape: &Shape| Drawn::new(camera.ellipse(shape)?, shape, size);
        for some in shapes.chunks(PROJECTED.0) {
            let drawn: Vec<Drawn> = parallel::filter_map(some.len(), PROJECTED.1, &|i| drawn(&some[i]));
            if drawn.is_empty() {
                continue;
            }
            parallel::for_chunks(&mut self.log_transmittance, (BAND * self.width).max(1), &|k, band| {
                drawn.iter().for_each(|drawn| drawn.add(band, k * BAND, self.width));
            });
        }
    }
}

/// A view's camera as the renderer projects with it.
struct Camera<'a> {
    view: &'a PinholeView,
    /// Smallest and largest `x / z` and `y / z` at which shapes are projected.
    limits: [[f32; 2]; 2],
}

/// What a Gaussian covers of an image: its middle and the covariance (xx, xy, yy) around it, pixels.
struct Ellipse {
    centre: [f32; 2],
    covariance: [f32; 3],
}

impl<'a> Camera<'a> {
    fn new(view: &'a PinholeView) -> Self {
        let limits = |centre: f32, focal: f32, size: usize| {
            let margin = JACOBIAN_MARGIN * 0.5 * size as f32 / focal;
            [-centre / focal - margin, (size as f32 - centre) / focal + margin]
        };
        Self { view, limits: [limits(view.cx, view.fx, view.width), limits(view.cy, view.fy, view.height)] }
    }

    /// Where the shape is drawn; `None` behind the camera.
    fn ellipse(&self, shape: &Shape) -> Option<Ellipse> {
        let place = shape.at(self.view.time);
        let taking = self.view.shutter.map(|shutter| self.view.taking(&shutter, place, shape.velocity));
        let view = taking.as_ref().unwrap_or(self.view);
        let [x, y, z] = view.to_camera(shape.at(view.time));
        if z.is_nan() || z <= crate::views::NEAR {
            return None;
        }
        let [p, q] = [x / z, y / z];
        let centre = [view.fx * p + view.cx, view.fy * q + view.cy];
        let [p, q] = [p.clamp(self.limits[0][0], self.limits[0][1]), q.clamp(self.limits[1][0], self.limits[1][1])];
        let [fx, fy] = [view.fx / z, view.fy / z];
        let mut covariance = [BLUR, 0.0, BLUR];
        match shape.axes {
            Axes::Round(scale) => {
                let [u, v] = [fx * scale, fy * scale];
                covariance[0] += u * u * (1.0 + p * p);
                covariance[1] += u * v * p * q;
                covariance[2] += v * v * (1.0 + q * q);
            }
            Axes::Long(axes) => {
                for axis in axes {
                    let [a, b, c] = view.camera_from_clip.map(|m| m[0] * axis[0] + m[1] * axis[1] + m[2] * axis[2]);
                    let [u, v] = [fx * (a - p * c), fy * (b - q * c)];
                    covariance[0] += u * u;
                    covariance[1] += u * v;
                    covariance[2] += v * v;
                }
            }
        }
        Some(Ellipse { centre, covariance })
    }
}

/// Extent of a Gaussian, metres.
#[derive(Clone, Copy, Debug)]
enum Axes {
    /// The same in all directions: the standard deviation.
    Round(f32),
    /// Its own axes in the clip frame, each as long as the standard deviation along it.
    Long([[f32; 3]; 3]),
}

/// What of a Gaussian decides what it covers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    mean: [f32; 3],
    /// Moment at which it is there, seconds, and its velocity, metres a second.
    time: f32,
    velocity: [f32; 3],
    axes: Axes,
    opacity: f32,
    /// Logarithm of the opacity over the smallest weight.
    log_opacity: f32,
}

impl Shape {
    /// Those of a set, which move.
    pub(super) fn moving(set: &GaussianSet) -> Vec<Self> {
        let mut shapes = Self::of(&set.attributes);
        for (shape, (&time, &velocity)) in shapes.iter_mut().zip(set.times.iter().zip(&set.velocities)) {
            shape.move_as(time, velocity);
        }
        shapes
    }

    /// Says that it stands where it is at a moment (seconds) and moves (metres a second).
    pub(super) const fn move_as(&mut self, time: f32, velocity: [f32; 3]) {
        (self.time, self.velocity) = (time, velocity);
    }

    /// Its mean at a moment, metres.
    fn at(&self, time: f32) -> [f32; 3] {
        std::array::from_fn(|k| self.mean[k] + self.velocity[k] * (time - self.time))
    }

    /// Those of raw attributes, which stand still.
    pub(super) fn of(rows: &[[f32; NUM_ATTRIBUTES]]) -> Vec<Self> {
        let standing = |row: &[f32; NUM_ATTRIBUTES]| {
            let opacity = sigmoid(row[LOGIT_OPACITY]);
            Self {
                mean: mean_of(row),
                time: 0.0,
                velocity: [0.0; 3],
                axes: axes(row),
                opacity,
                log_opacity: (opacity / MIN_ALPHA).ln(),
            }
        };
        parallel::map(rows.len(), 4096, &|i| standing(&rows[i]))
    }
}

fn axes(row: &[f32; NUM_ATTRIBUTES]) -> Axes {
    let scales: [f32; 3] = std::array::from_fn(|k| row[LOG_SCALE.start + k].exp());
    if scales[0] == scales[1] && scales[0] == scales[2] {
        return Axes::Round(scales[0]);
    }
    let [w, x, y, z] = std::array::from_fn(|k| row[QUAT.start + k]);
    let turn = Quat::from_xyzw(x, y, z, w).normalize();
    Axes::Long([0, 1, 2].map(|k| (turn * (Vec3::AXES[k] * scales[k])).to_array()))
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Quat, Vec3};

    use super::{Coverage, Shape};
    use crate::{
        gaussians::{LOG_SCALE, MEAN, NUM_ATTRIBUTES, QUAT, initial::row},
        views::{PinholeView, samples::ahead},
    };

    /// Opacity that is left of a Gaussian at a pixel's centre, by the covariance in the image.
    fn alpha(of: &[f32; NUM_ATTRIBUTES], opacity: f32, view: &PinholeView, [u, v]: [f32; 2]) -> f32 {
        let [w, x, y, z] = std::array::from_fn(|k| of[QUAT.start + k]);
        let axes = Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize());
        let scales = Vec3::from_slice(&of[LOG_SCALE]).exp();
        let mean = Vec3::from_slice(&of[MEAN]);
        let image = [
            Vec3::new(view.fx / mean.z, 0.0, -view.fx * mean.x / (mean.z * mean.z)),
            Vec3::new(0.0, view.fy / mean.z, -view.fy * mean.y / (mean.z * mean.z)),
        ];
        let m = image.map(|row| axes.transpose() * row * scales);
        let (xx, xy, yy) = (m[0].dot(m[0]) + 0.3, m[0].dot(m[1]), m[1].dot(m[1]) + 0.3);
        let (x, y) = (u - view.fx * mean.x / mean.z - view.cx, v - view.fy * mean.y / mean.z - view.cy);
        opacity * (-0.5 * (x * x * yy - 2.0 * x * y * xy + y * y * xx) / (xx * yy - xy * xy)).exp()
    }

    #[test]
    fn discs_and_balls_cover_what_they_are_drawn_on() {
        let view = ahead(48, 32, 40.0);
        for (k, turn) in [[0.0, 0.0, 0.0], [0.5, -0.4, 0.9], [1.2, 0.3, 0.1]].into_iter().enumerate() {
            let mut of = row([0.4, -0.2, 5.0], 0.3, 0.8, [0.5; 3]);
            if k > 0 {
                of[LOG_SCALE].copy_from_slice(&[-0.7, -1.8, -3.0]);
                let turn = Quat::from_euler(glam::EulerRot::XYZ, turn[0], turn[1], turn[2]);
                of[QUAT].copy_from_slice(&[turn.w, turn.x, turn.y, turn.z].map(|q| 1.7 * q));
            }
            let mut coverage = Coverage::new(&view);
            coverage.add(&view, &Shape::of(&[of]));
            for (pixel, left) in coverage.log_transmittance.iter().enumerate() {
                let at = [(pixel % 48) as f32 + 0.5, (pixel / 48) as f32 + 0.5];
                let want = alpha(&of, 0.8, &view, at);
                let want = if want < 1.0 / 255.0 { 0.0 } else { want };
                assert!(
                    (1.0 - left.exp() - want).abs() < 5e-3,
                    "shape {k}, pixel {pixel}: {} {want}",
                    1.0 - left.exp()
                );
            }
        }
    }

    #[test]
    fn what_is_behind_the_camera_or_no_number_covers_nothing() {
        let view = ahead(8, 8, 10.0);
        let mut coverage = Coverage::new(&view);
        let mut rows = vec![row([0.0, 0.0, -3.0], 1.0, 0.9, [0.5; 3]); 3];
        rows[1][LOG_SCALE.start] = f32::NAN;
        rows[1][MEAN.start + 2] = 3.0;
        rows[2][MEAN.start] = f32::INFINITY;
        coverage.add(&view, &Shape::of(&rows));
        assert!((0..64).all(|pixel| coverage.shows(pixel)));
    }
}
