//! The renderer's f64 twin: the same function written to be read, not to be fast. It is the oracle of the fast path and
//! therefore shares nothing with it, not even constants: every pixel looks at every Gaussian, and the derivatives of the
//! projection come from dual numbers instead of formulas.

mod composite;
mod dual;
mod project;

use composite::{Footprint, PixelGradient, composite_pixel, contributions, is_fragile, pixel_backward};
use project::{Projection, project};

/// One Gaussian in physical values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gaussian {
    /// Where it stands at `time`, metres, world frame.
    pub mean: [f64; 3],
    /// Rotation (w, x, y, z), not normalised.
    pub quat: [f64; 4],
    /// Standard deviations along its own axes, metres.
    pub scale: [f64; 3],
    /// Opacity in 0..=1.
    pub opacity: f64,
    /// Colour.
    pub colour: [f64; 3],
    /// Velocity, metres a second.
    pub velocity: [f64; 3],
    /// Moment at which it stands at `mean`, seconds.
    pub time: f64,
}

/// Gradient of a scalar by the values of one Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gradient {
    /// By the mean.
    pub mean: [f64; 3],
    /// By the unnormalised quaternion.
    pub quat: [f64; 4],
    /// By the linear scale.
    pub scale: [f64; 3],
    /// By the opacity.
    pub opacity: f64,
    /// By the colour.
    pub colour: [f64; 3],
    /// By the velocity.
    pub velocity: [f64; 3],
}

impl Gradient {
    fn add(&mut self, other: &Self) {
        let sum = |a: &mut [f64], b: &[f64]| a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        sum(&mut self.mean, &other.mean);
        sum(&mut self.quat, &other.quat);
        sum(&mut self.scale, &other.scale);
        self.opacity += other.opacity;
        sum(&mut self.colour, &other.colour);
        sum(&mut self.velocity, &other.velocity);
    }
}

/// A pinhole camera at one moment. Axes: x right, y down, z forward; a pixel's centre is at +0.5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels.
    pub cx: f64,
    /// Principal point y, pixels.
    pub cy: f64,
    /// Rows of `camera_from_world`, rotation and translation (metres).
    pub camera_from_world: [[f64; 4]; 3],
    /// Moment to render, seconds.
    pub time: f64,
}

/// What is rendered, or the gradient of a scalar by it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Images {
    /// `[H, W, 3]` colours over the background colour.
    pub rgb: Vec<f64>,
    /// `[H, W]` accumulated alpha, `1 - T`.
    pub alpha: Vec<f64>,
    /// `[H, W]` accumulated depth, `sum w z`, metres.
    pub depth: Vec<f64>,
    /// `[H, W]` expected depth, `depth / max(alpha, 1e-10)`, metres.
    pub expected_depth: Vec<f64>,
}

impl Images {
    /// Images of `num_pixels` zeros.
    pub fn zeros(num_pixels: usize) -> Self {
        let plane = vec![0.0; num_pixels];
        Self { rgb: vec![0.0; 3 * num_pixels], alpha: plane.clone(), depth: plane.clone(), expected_depth: plane }
    }
}

/// The images that `camera` takes of the Gaussians.
///
/// # Formula
/// Front to back over the Gaussians in front of the near plane, by depth and then by index:
/// `w_i = alpha_i T_i`, `T_{i+1} = T_i (1 - alpha_i)`, `rgb = sum w_i c_i + T background`, `depth = sum w_i z_i`.
///
/// # Source
/// Zwicker et al., EWA Splatting (2002); Kerbl et al., 3D Gaussian Splatting (2023), section 4; thresholds as gsplat 1.5.3.
pub fn render(gaussians: &[Gaussian], camera: &Camera, background: [f64; 3]) -> Images {
    render_rolling(gaussians, camera, |_| *camera, background)
}

/// As [`render`], through a rolling shutter: `exposing` tells the camera at the moment at which a place of the image (pixels) is exposed.
pub fn render_rolling(
    gaussians: &[Gaussian],
    camera: &Camera,
    exposing: impl Fn([f64; 2]) -> Camera,
    background: [f64; 3],
) -> Images {
    let mut images = Images::zeros(camera.width * camera.height);
    let mut scene = Scene::new(gaussians, *camera);
    for pixel in 0..camera.width * camera.height {
        let centre = pixel_centre(camera, pixel);
        scene.see(gaussians, exposing(centre));
        let stack = contributions(&scene.footprints, centre);
        let value = composite_pixel(&stack, background);
        images.rgb[3 * pixel..][..3].copy_from_slice(&value.rgb);
        images.alpha[pixel] = value.alpha;
        images.depth[pixel] = value.depth;
        images.expected_depth[pixel] = value.expected_depth;
    }
    images
}

/// What a camera sees of the Gaussians.
struct Scene {
    camera: Camera,
    projections: Vec<Option<Projection>>,
    footprints: Vec<Footprint>,
}

impl Scene {
    fn new(gaussians: &[Gaussian], camera: Camera) -> Self {
        let projections = project_all(gaussians, &camera);
        let footprints = sorted_footprints(gaussians, &projections);
        Self { camera, projections, footprints }
    }

    /// Looks from another camera, if it is another one; the scene as it was before then.
    fn see(&mut self, gaussians: &[Gaussian], camera: Camera) -> Option<Self> {
        (self.camera != camera).then(|| std::mem::replace(self, Self::new(gaussians, camera)))
    }

    /// Adds to the gradients of all Gaussians what those of their footprints say.
    fn add_gradients(
        &self,
        gaussians: &[Gaussian],
        v: &mut [composite::FootprintGradient],
        gradients: &mut [Gradient],
    ) {
        for (i, (projection, v)) in self.projections.iter().zip(v).enumerate() {
            let v = std::mem::take(v);
            if let Some(projection) = projection {
                gradients[i].add(&chain(projection, &v, self.camera.time - gaussians[i].time));
            }
        }
    }
}

/// `[H, W]` pixels in which a threshold nearly decides otherwise: an alpha within `margin`, relative, of its floor or cap, or
/// a transmittance of the end. There, rounding may change the value, and finite differences mean nothing.
pub fn fragile_pixels(gaussians: &[Gaussian], camera: &Camera, margin: f64) -> Vec<bool> {
    let footprints = sorted_footprints(gaussians, &project_all(gaussians, camera));
    let pixels = 0..camera.width * camera.height;
    pixels.map(|pixel| is_fragile(&footprints, pixel_centre(camera, pixel), margin)).collect()
}

/// The gradient of a scalar by every Gaussian, given its gradient by the images that [`render`] returns.
///
/// # Gradient
/// Exact where the function is smooth. The set of Gaussians of a pixel, their order and the caps are constants: an alpha at
/// its cap and a clamped Jacobian entry pass nothing on.
pub fn backward(gaussians: &[Gaussian], camera: &Camera, background: [f64; 3], v_images: &Images) -> Vec<Gradient> {
    backward_rolling(gaussians, camera, |_| *camera, background, v_images)
}

/// As [`backward`], of [`render_rolling`].
pub fn backward_rolling(
    gaussians: &[Gaussian],
    camera: &Camera,
    exposing: impl Fn([f64; 2]) -> Camera,
    background: [f64; 3],
    v_images: &Images,
) -> Vec<Gradient> {
    let mut gradients = vec![Gradient::default(); gaussians.len()];
    let mut v_footprints = vec![composite::FootprintGradient::default(); gaussians.len()];
    let mut scene = Scene::new(gaussians, *camera);
    for pixel in 0..camera.width * camera.height {
        let centre = pixel_centre(camera, pixel);
        if let Some(before) = scene.see(gaussians, exposing(centre)) {
            before.add_gradients(gaussians, &mut v_footprints, &mut gradients);
        }
        let stack = contributions(&scene.footprints, centre);
        let v_pixel = PixelGradient {
            rgb: std::array::from_fn(|k| v_images.rgb[3 * pixel + k]),
            alpha: v_images.alpha[pixel],
            depth: v_images.depth[pixel],
            expected_depth: v_images.expected_depth[pixel],
        };
        pixel_backward(&stack, background, &v_pixel, &mut v_footprints);
    }
    scene.add_gradients(gaussians, &mut v_footprints, &mut gradients);
    gradients
}

fn project_all(gaussians: &[Gaussian], camera: &Camera) -> Vec<Option<Projection>> {
    gaussians.iter().map(|g| project(g, camera)).collect()
}

fn sorted_footprints(gaussians: &[Gaussian], projections: &[Option<Projection>]) -> Vec<Footprint> {
    let mut footprints: Vec<Footprint> = Vec::new();
    for (index, (gaussian, projection)) in gaussians.iter().zip(projections).enumerate() {
        if let Some(p) = projection {
            footprints.push(Footprint {
                index,
                mean2d: p.mean2d.map(|d| d.value),
                conic: p.conic.map(|d| d.value),
                depth: p.depth.value,
                opacity: gaussian.opacity,
                colour: gaussian.colour,
            });
        }
    }
    footprints.sort_by(|a, b| a.depth.total_cmp(&b.depth).then(a.index.cmp(&b.index)));
    footprints
}

fn pixel_centre(camera: &Camera, pixel: usize) -> [f64; 2] {
    [(pixel % camera.width) as f64 + 0.5, (pixel / camera.width) as f64 + 0.5]
}

/// The gradient by one Gaussian from the gradient by its footprint; `elapsed` is the time since it stood at its mean.
fn chain(projection: &Projection, v: &composite::FootprintGradient, elapsed: f64) -> Gradient {
    let by = |parameter: usize| {
        let by_mean2d: f64 = (0..2).map(|k| v.mean2d[k] * projection.mean2d[k].slope[parameter]).sum();
        let by_conic: f64 = (0..3).map(|k| v.conic[k] * projection.conic[k].slope[parameter]).sum();
        by_mean2d + by_conic + v.depth * projection.depth.slope[parameter]
    };
    let mean = std::array::from_fn(|k| by(project::MEAN + k));
    Gradient {
        mean,
        quat: std::array::from_fn(|k| by(project::QUAT + k)),
        scale: std::array::from_fn(|k| by(project::SCALE + k)),
        opacity: v.opacity,
        colour: v.colour,
        velocity: mean.map(|m| m * elapsed),
    }
}
