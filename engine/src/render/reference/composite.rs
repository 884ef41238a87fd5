//! One pixel: what contributes to it, its value, and the gradient back to the footprints.

/// Largest alpha of one Gaussian.
const ALPHA_CAP: f64 = 0.999;
/// Alphas below this are skipped.
const ALPHA_FLOOR: f64 = 1.0 / 255.0;
/// A Gaussian that would bring the transmittance to this or below is left out and ends the pixel.
const OPAQUE: f64 = 1e-4;
/// Smallest alpha that the expected depth is divided by.
const MIN_ALPHA: f64 = 1e-10;

/// What compositing needs of one Gaussian.
#[derive(Clone, Copy, Debug)]
pub(super) struct Footprint {
    pub(super) index: usize,
    pub(super) mean2d: [f64; 2],
    pub(super) conic: [f64; 3],
    pub(super) depth: f64,
    pub(super) opacity: f64,
    pub(super) colour: [f64; 3],
}

/// Gradient by a [`Footprint`].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FootprintGradient {
    pub(super) mean2d: [f64; 2],
    pub(super) conic: [f64; 3],
    pub(super) depth: f64,
    pub(super) opacity: f64,
    pub(super) colour: [f64; 3],
}

/// One Gaussian's part in one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contribution {
    footprint: Footprint,
    /// `mean2d` minus the pixel's centre.
    offset: [f64; 2],
    /// `exp(-sigma)`.
    falloff: f64,
    alpha: f64,
    /// Transmittance in front of it.
    transmittance: f64,
}

/// The value of one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct PixelValue {
    pub(super) rgb: [f64; 3],
    pub(super) alpha: f64,
    pub(super) depth: f64,
    pub(super) expected_depth: f64,
}

/// Gradient by a [`PixelValue`].
#[derive(Clone, Copy, Debug)]
pub(super) struct PixelGradient {
    pub(super) rgb: [f64; 3],
    pub(super) alpha: f64,
    pub(super) depth: f64,
    pub(super) expected_depth: f64,
}

/// What contributes to the pixel whose centre is `centre`, front to back.
pub(super) fn contributions(footprints: &[Footprint], centre: [f64; 2]) -> Vec<Contribution> {
    let mut stack = Vec::new();
    let mut transmittance = 1.0;
    for &footprint in footprints {
        let sigma = sigma(&footprint, centre);
        let falloff = (-sigma).exp();
        let alpha = (footprint.opacity * falloff).min(ALPHA_CAP);
        if sigma < 0.0 || alpha < ALPHA_FLOOR {
            continue;
        }
        let behind = transmittance * (1.0 - alpha);
        if behind <= OPAQUE {
            break;
        }
        stack.push(Contribution { footprint, offset: offset(&footprint, centre), falloff, alpha, transmittance });
        transmittance = behind;
    }
    stack
}

/// `mean2d` minus the pixel's centre.
fn offset(footprint: &Footprint, centre: [f64; 2]) -> [f64; 2] {
    [footprint.mean2d[0] - centre[0], footprint.mean2d[1] - centre[1]]
}

/// Half the squared Mahalanobis distance of the pixel's centre.
fn sigma(footprint: &Footprint, centre: [f64; 2]) -> f64 {
    let [xx, xy, yy] = footprint.conic;
    let [dx, dy] = offset(footprint, centre);
    0.5 * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
}

/// Whether some threshold nearly decides otherwise in this pixel: an alpha within `margin`, relative, of the floor or the cap,
/// or a transmittance of the end.
pub(super) fn is_fragile(footprints: &[Footprint], centre: [f64; 2], margin: f64) -> bool {
    let near = |value: f64, threshold: f64| (value - threshold).abs() <= margin * threshold;
    let mut transmittance = 1.0;
    for footprint in footprints {
        let raw_alpha = footprint.opacity * (-sigma(footprint, centre)).exp();
        if near(raw_alpha, ALPHA_FLOOR) || near(raw_alpha, ALPHA_CAP) {
            return true;
        }
        if raw_alpha >= ALPHA_FLOOR {
            transmittance *= 1.0 - raw_alpha.min(ALPHA_CAP);
        }
        if transmittance <= OPAQUE * (1.0 + margin) {
            return transmittance >= OPAQUE * (1.0 - margin);
        }
    }
    false
}

/// The value of the pixel.
pub(super) fn composite_pixel(stack: &[Contribution], background: [f64; 3]) -> PixelValue {
    let behind = transmittance_behind(stack);
    let mut rgb = background.map(|b| behind * b);
    let mut depth = 0.0;
    for c in stack {
        let weight = c.alpha * c.transmittance;
        for (value, colour) in rgb.iter_mut().zip(c.footprint.colour) {
            *value += weight * colour;
        }
        depth += weight * c.footprint.depth;
    }
    let alpha = 1.0 - behind;
    PixelValue { rgb, alpha, depth, expected_depth: depth / alpha.max(MIN_ALPHA) }
}

/// Adds the pixel's gradient to the footprints that it shows (`v_footprints` is indexed as the Gaussians are).
///
/// # Formula
/// With `s_i = v_rgb . c_i + v_depth z_i` and `e = v_rgb . background - v_alpha`:
/// `v_alpha_i = T_i s_i - (sum_{j > i} w_j s_j + T e) / (1 - alpha_i)`.
pub(super) fn pixel_backward(
    stack: &[Contribution],
    background: [f64; 3],
    v_pixel: &PixelGradient,
    v_footprints: &mut [FootprintGradient],
) {
    let value = composite_pixel(stack, background);
    let v_depth = v_pixel.depth + v_pixel.expected_depth / value.alpha.max(MIN_ALPHA);
    let mut v_alpha = v_pixel.alpha;
    if value.alpha > MIN_ALPHA {
        v_alpha -= v_pixel.expected_depth * value.depth / (value.alpha * value.alpha);
    }
    let mut later = transmittance_behind(stack) * (dot(v_pixel.rgb, background) - v_alpha);
    for c in stack.iter().rev() {
        let v = &mut v_footprints[c.footprint.index];
        let weight = c.alpha * c.transmittance;
        let score = dot(v_pixel.rgb, c.footprint.colour) + v_depth * c.footprint.depth;
        for (v_colour, v_rgb) in v.colour.iter_mut().zip(v_pixel.rgb) {
            *v_colour += weight * v_rgb;
        }
        v.depth += weight * v_depth;
        let v_own_alpha = c.transmittance * score - later / (1.0 - c.alpha);
        later += weight * score;
        if c.footprint.opacity * c.falloff <= ALPHA_CAP {
            v.opacity += v_own_alpha * c.falloff;
            add_shape_gradient(v, c, -v_own_alpha * c.alpha);
        }
    }
}

/// Adds the gradient that reaches place and shape through `sigma`.
fn add_shape_gradient(v: &mut FootprintGradient, c: &Contribution, v_sigma: f64) {
    let [xx, xy, yy] = c.footprint.conic;
    let [dx, dy] = c.offset;
    v.mean2d[0] += v_sigma * (xx * dx + xy * dy);
    v.mean2d[1] += v_sigma * (xy * dx + yy * dy);
    v.conic[0] += v_sigma * 0.5 * dx * dx;
    v.conic[1] += v_sigma * dx * dy;
    v.conic[2] += v_sigma * 0.5 * dy * dy;
}

fn transmittance_behind(stack: &[Contribution]) -> f64 {
    stack.last().map_or(1.0, |c| c.transmittance * (1.0 - c.alpha))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
