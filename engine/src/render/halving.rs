//! How a Gaussian that is split in two shares its pixels between the halves.

use glam::DVec3;

use super::RenderedWithState;
use super::project::Projector;
use crate::gaussians::physical::Splat;
use crate::gaussians::split::{Halving, axis_of};
use crate::parallel;
use crate::views::PinholeView;

/// The axis (0 to 2) of each Gaussian that looks longest in all views together; the longest of its own axes where no view shows it.
///
/// # Formula
/// The largest `sum_v |J W a_k|^2 s_k^2` over the axes k, over the views in front of which it stands.
pub fn longest_axes(splats: &[Splat], views: &[&PinholeView]) -> Vec<u8> {
    let projectors: Vec<Projector> = views.iter().map(|view| Projector::new(view)).collect();
    let axis = |splat: &Splat| {
        let mut seen = [0.0_f64; 3];
        for projected in projectors.iter().filter_map(|projector| projector.project(splat)) {
            for (k, seen) in seen.iter_mut().enumerate() {
                let axis = projected.axes.col(k) * f64::from(splat.scale[k]);
                *seen += projected.image_from_world.iter().map(|row| row.dot(axis).powi(2)).sum::<f64>();
            }
        }
        if seen == [0.0; 3] {
            seen = splat.scale.map(f64::from);
        }
        (0_u8..3).max_by(|&a, &b| seen[usize::from(a)].total_cmp(&seen[usize::from(b)])).unwrap_or(0)
    };
    parallel::map(splats.len(), 1024, &|i| axis(&splats[i]))
}

/// How the halves along `axes` share the pixels of each visible Gaussian: what [`effects`](super::effects) takes.
///
/// # Shapes
/// `splats` and `axes` `[N]`; result `[num_visible]`, in the order of [`RenderedWithState::visible`], 1 / pixel.
///
/// # Formula
/// Two halves of one shape, `2 o` apart in the image: `log2 a_1 - log2 a_2 = h . (p - centre)`, linear in the pixel.
pub fn halving(splats: &[Splat], axes: &[u8], view: &PinholeView, state: &RenderedWithState) -> Vec<[f32; 2]> {
    let projector = Projector::new(view);
    let visible: Vec<usize> = state.visible().collect();
    let of = |i: usize| halving_of(&projector, &splats[i], usize::from(axes[i])).unwrap_or_default();
    parallel::map(visible.len(), 1024, &|v| of(visible[v]))
}

#[expect(clippy::cast_possible_truncation, reason = "f64 to f32 is the purpose")]
fn halving_of(projector: &Projector, splat: &Splat, axis: usize) -> Option<[f32; 2]> {
    let (half, step) = half_of(splat, axis);
    let projected = projector.project(&half)?;
    let [x, y] = projected.image_from_world.map(|row| row.dot(step));
    let [xx, xy, yy] = projected.covariance;
    // 2 cov^-1 o, to base 2
    let scale = 2.0 * std::f64::consts::LOG2_E / projected.determinant;
    let halving = [scale * (yy * x - xy * y), scale * (xx * y - xy * x)].map(|value| value as f32);
    halving.iter().all(|value| value.is_finite()).then_some(halving)
}

/// The shape of a half of a Gaussian, where the whole stands, and how far from there the first half stands, metres, clip frame.
#[expect(clippy::cast_possible_truncation, reason = "f64 to f32 is the purpose")]
fn half_of(splat: &Splat, axis: usize) -> (Splat, DVec3) {
    let halving = Halving::of(f64::from(splat.opacity));
    let step = halving.offset * f64::from(splat.scale[axis]) * axis_of(splat, axis);
    let mut half = Splat { opacity: halving.opacity as f32, ..*splat };
    for (k, scale) in half.scale.iter_mut().enumerate() {
        *scale = (f64::from(*scale) * if k == axis { halving.along } else { halving.across }) as f32;
    }
    (half, step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::render_for_gradient;
    use crate::views::samples::ahead;

    #[test]
    #[expect(clippy::cast_possible_truncation, reason = "f64 to f32 is the purpose")]
    fn halves_share_pixels_as_their_alphas_do() {
        let view = ahead(80, 60, 700.0);
        let splat = Splat {
            mean: [0.3, -0.2, 50.0],
            quat: [0.9, 0.2, -0.3, 0.25],
            scale: [0.5, 0.2, 0.05],
            opacity: 0.8,
            ..Splat::default()
        };
        let axes = longest_axes(&[splat], &[&view]);
        assert_eq!(axes, [0]);
        let state = render_for_gradient(&[splat], &view, [0.0; 3]);
        let [[right, down]] = halving(&[splat], &axes, &view, &state)[..] else { panic!("one is visible") };
        let (half, step) = half_of(&splat, 0);
        let projector = Projector::new(&view);
        let at = |side: f64| {
            let mean: [f32; 3] = std::array::from_fn(|k| (f64::from(splat.mean[k]) + side * step[k]) as f32);
            projector.footprint(&Splat { mean, ..half }, 0).unwrap()
        };
        let (first, second) = (at(1.0), at(-1.0));
        let centre = [0.5 * (first.mean_x + second.mean_x), 0.5 * (first.mean_y + second.mean_y)];
        for (dx, dy) in [(0.0, 0.0), (3.0, 0.0), (-4.0, 2.0), (1.0, -5.0)] {
            let log2 = |f: &super::super::project::Footprint| {
                let y = centre[1] + dy - f.mean_y;
                let u = centre[0] + dx - f.mean_x - f.shear * y;
                f.curve_u * u * u + f.curve_y * y * y
            };
            let (got, want) = (right * dx + down * dy, log2(&first) - log2(&second));
            // The halves are not quite of one shape: one of them is nearer.
            assert!((got - want).abs() < 0.02 + 0.03 * want.abs(), "{dx} {dy}: {got} {want}");
        }
        assert!(right.hypot(down) > 0.1);
    }
}
