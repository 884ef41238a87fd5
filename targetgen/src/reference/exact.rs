//! The slow twin of the exact signal: every primitive is taken out in turn, and every halving is projected by hand.

use glam::{DMat3, DQuat, DVec3};
use lgs_engine::gaussians::physical::{Splat, to_physical};
use lgs_engine::gaussians::split::Halving;
use lgs_engine::loss::pixel_costs;
use lgs_engine::render::{PixelCosts, Projection, Rendered, constants::UNSEEN, longest_axes};
use lgs_engine::views::{PinholeView, View};

use crate::branches::{BEHIND, Problem, Round};
use crate::delta::ActionDeltas;

/// A square of blending weights below which a Gaussian counts less, pixels.
const FAINT: f64 = 0.05;

pub(super) fn deltas(problem: &Problem<'_>, round: &Round) -> ActionDeltas {
    let splats = to_physical(problem.set);
    let axes = longest_axes(&splats, &problem.views.iter().map(|view| &view.pinhole).collect::<Vec<_>>());
    let drawn: Vec<(Rendered, PixelCosts)> = problem
        .views
        .iter()
        .map(|view| {
            let images = draw(&splats, &view.pinhole);
            let costs = pixel_costs(&images, view, &problem.weights);
            (images, costs)
        })
        .collect();
    let total = |of: fn(&PixelCosts) -> f64| drawn.iter().map(|(_, costs)| of(costs)).sum::<f64>();
    let counted = total(|costs| costs.counted.iter().map(|&c| f64::from(c)).sum());
    let squared = total(|costs| costs.residual.iter().map(|&r| f64::from(r).powi(2)).sum()) / counted;
    let loss = total(|costs| costs.loss) / problem.views.len() as f64;
    let pixels: usize = problem.views.iter().map(|view| view.pinhole.num_pixels()).sum();
    let effects = |&i: &u32| {
        let (i, views) = (i as usize, problem.views.iter().zip(&drawn));
        let (mut removal, mut sums) = (0.0, Sums::default());
        for (view, (images, costs)) in views {
            let rest: Vec<Splat> = (0..splats.len()).filter(|&k| k != i).map(|k| splats[k]).collect();
            removal += change(costs, images, &draw(&rest, &view.pinhole)) / problem.views.len() as f64;
            sums.add(&splats, i, usize::from(axes[i]), view, costs);
        }
        let known = |value: f64| Some(value).filter(|value| sums.shown && value.is_finite());
        (known(removal * pixels as f64 / loss), known(-sums.gain() / squared))
    };
    let (prune, add) = round.chosen.iter().map(effects).unzip();
    ActionDeltas { prune, add }
}

fn draw(splats: &[Splat], view: &PinholeView) -> Rendered {
    Projection::new(splats, view).render_through(view, BEHIND, UNSEEN).images
}

/// What the costs say of a picture in place of another, pixel by pixel.
fn change(costs: &PixelCosts, before: &Rendered, after: &Rendered) -> f64 {
    let expected = [before, after].map(Rendered::expected_depth);
    let pixel = |p: usize| {
        let colours = (3 * p..3 * p + 3).map(|k| {
            let (old, step) = (f64::from(costs.residual[k]), f64::from(after.rgb[k]) - f64::from(before.rgb[k]));
            let size = f64::from(costs.per_colour) * f64::from(costs.counted[p]) * ((old + step).abs() - old.abs());
            size + f64::from(costs.slopes[k]) * step
        });
        let error = |depth: f32| (f64::from(depth) - f64::from(costs.depth[p])).abs();
        let depth = if costs.depth[p] > 0.0 { error(expected[1][p]) - error(expected[0][p]) } else { 0.0 };
        colours.sum::<f64>() + f64::from(costs.per_depth) * depth
    };
    (0..before.alpha.len()).map(pixel).sum()
}

/// Sums over pixels of the halves' weights: with the residual by channel, and with each other.
#[derive(Default)]
struct Sums {
    residual: [[f64; 3]; 2],
    squares: [[f64; 2]; 2],
    shown: bool,
}

impl Sums {
    fn add(&mut self, splats: &[Splat], i: usize, axis: usize, view: &View, costs: &PixelCosts) {
        // The picture of this colour alone is the map of its weights.
        let only = |k: usize| if k == i { [1.0, 0.0, 0.0] } else { [0.0; 3] };
        let marked: Vec<Splat> = (0..splats.len()).map(|k| Splat { colour: only(k), ..splats[k] }).collect();
        let weights = draw(&marked, &view.pinhole).rgb;
        let Some(halving) = by_hand(&splats[i], axis, &view.pinhole) else { return };
        for p in 0..view.pinhole.num_pixels() {
            let weight = f64::from(weights[3 * p]) * f64::from(costs.counted[p]);
            let centre = [p % view.pinhole.width, p / view.pinhole.width].map(|k| k as f64 + 0.5);
            let exponent = (0..2).map(|k| halving[1][k] * (centre[k] - halving[0][k])).sum::<f64>();
            let share = 1.0 / (1.0 + (-exponent).exp());
            let halves = [share * weight, (1.0 - share) * weight];
            self.shown |= weight > 0.0;
            for a in 0..2 {
                for c in 0..3 {
                    self.residual[a][c] += halves[a] * f64::from(costs.residual[3 * p + c]);
                }
                (0..2).for_each(|b| self.squares[a][b] += halves[a] * halves[b]);
            }
        }
    }

    fn gain(&self) -> f64 {
        let [[aa, ab], [_, bb]] = self.squares;
        let whole = aa + 2.0 * ab + bb + FAINT;
        let (aa, bb) = (aa + FAINT, bb + FAINT);
        let channel = |c: usize| {
            let (a, b) = (self.residual[0][c], self.residual[1][c]);
            let fit = (bb * a * a - 2.0 * ab * a * b + aa * b * b) / (aa * bb - ab * ab);
            (fit - (a + b) * (a + b) / whole).max(0.0)
        };
        (0..3).map(channel).sum()
    }
}

/// Where a Gaussian stands in the image, and by how much the logarithm of its first half's alpha over the second's grows by pixel.
fn by_hand(splat: &Splat, axis: usize, view: &PinholeView) -> Option<[[f64; 2]; 2]> {
    let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    let rows = view.camera_from_clip.map(|row| row.map(f64::from));
    let rotation = DMat3::from_cols_array(&[0, 1, 2].map(|c| [0, 1, 2].map(|r| rows[r][c])).concat().try_into().ok()?);
    let elapsed = f64::from(view.time) - f64::from(splat.time);
    let shift = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
    let mean = rotation * (vector(splat.mean) + elapsed * vector(splat.velocity)) + shift;
    let (focal, centre) = ([view.fx, view.fy].map(f64::from), [view.cx, view.cy].map(f64::from));
    let size = [view.width, view.height].map(|s| s as f64);
    let slope = [mean.x / mean.z, mean.y / mean.z];
    // The Jacobian is taken inside the image widened by 15 % of its size to each side.
    let kept = [0, 1].map(|k| {
        let margin = 0.15 * size[k] / focal[k];
        slope[k].clamp(-centre[k] / focal[k] - margin, (size[k] - centre[k]) / focal[k] + margin)
    });
    let [w, x, y, z] = splat.quat.map(f64::from);
    let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let halving = Halving::of(f64::from(splat.opacity));
    let seen = |v: DVec3| {
        let v = rotation * v;
        [focal[0] * (v.x - kept[0] * v.z) / mean.z, focal[1] * (v.y - kept[1] * v.z) / mean.z]
    };
    let sides = [0, 1, 2].map(|k| {
        let factor = if k == axis { halving.along } else { halving.across };
        seen(axes.col(k) * f64::from(splat.scale[k]) * factor)
    });
    let covariance = |a: usize, b: usize| {
        let blur = if a == b { 0.3 } else { 0.0 };
        sides.iter().map(|side| side[a] * side[b]).sum::<f64>() + blur
    };
    let (xx, xy, yy) = (covariance(0, 0), covariance(0, 1), covariance(1, 1));
    let step = seen(axes.col(axis) * f64::from(splat.scale[axis]) * halving.offset);
    let scale = 2.0 / (xx * yy - xy * xy);
    let place = [0, 1].map(|k| focal[k] * slope[k] + centre[k]);
    (mean.z > 0.0).then(|| [place, [scale * (yy * step[0] - xy * step[1]), scale * (xx * step[1] - xy * step[0])]])
}
