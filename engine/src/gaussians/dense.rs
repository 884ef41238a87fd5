//! Returns denser than the pixels of their images, together.

use rayon::prelude::*;

use super::{
    Coarseness, GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, NUM_ATTRIBUTES,
    disc::{Plane, put, sigmas},
    initial::row,
    physical::{MAX_SCALE, MIN_SCALE, sigmoid},
};
use crate::{
    parallel,
    views::{Projected, Role, View},
};

/// Sides of the rectangles whose returns become one, width and height in pixels, in the order in which they are tried.
const SHAPES: [[usize; 2]; 12] =
    [[8, 8], [6, 6], [4, 4], [3, 3], [3, 2], [2, 3], [2, 2], [3, 1], [1, 3], [2, 1], [1, 2], [1, 1]];
/// Longest side up to a coarseness of 1, pixels.
const LONGEST: f32 = 3.0;
/// Root mean square of the colours around their mean, of the returns and of the pixels, that rectangles of four pixels may have.
const COLOUR: f32 = 0.026;
/// Inverse depths may be away from their mean by this share.
const DEPTH: f32 = 0.06;
/// Standard deviation of a drawn Gaussian over the sides of its rectangle.
const SIGMA_SHARE: f32 = 0.4;
/// Largest opacity of returns that became one.
const OPACITY: f32 = 0.7;
/// What keeps a slope that few returns tell from being anything, square pixels.
const RIDGE: f32 = 0.1;
/// Gaussians that a thread looks for at once.
const GRAIN: usize = 1024;

/// A return in an image.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// Index of its Gaussian.
    index: usize,
    at: Projected,
    pixel: usize,
    colour: [f32; 3],
}

/// A rectangle of pixels: its first column and row, and its sides.
type Rectangle = ([usize; 2], [usize; 2]);

/// Makes one Gaussian of initial ones of the same sweep that share a few pixels of an image of their own frame, show the same
/// colour, lie on one plane and move alike. It stands where the first of them stood in the order of the set, at the mean of their times.
/// All of `set` is the `LiDAR` branch.
pub(crate) fn merge_dense(set: &mut GaussianSet, views: &[View], coarseness: Coarseness) {
    if coarseness == Coarseness::FINEST {
        return;
    }
    let mut fate = vec![Fate::Stays; set.len()];
    for view in views.iter().filter(|view| view.role == Role::Input) {
        of_view(set, view, &finer(view, views), coarseness, &mut fate);
    }
    let kept: Vec<usize> = (0..set.len()).filter(|&i| !matches!(fate[i], Fate::Goes)).collect();
    for (i, fate) in fate.iter().enumerate() {
        if let Fate::Becomes(row, time) = *fate {
            (set.attributes[i], set.times[i]) = (row, time);
        }
    }
    *set = set.select(&kept, kept.len());
}

/// What becomes of a Gaussian.
#[derive(Clone, Copy, Debug)]
enum Fate {
    Stays,
    Goes,
    /// The one of several, with these attributes and at this time.
    Becomes([f32; NUM_ATTRIBUTES], f32),
}

/// The input views of the same frame that resolve finer.
fn finer<'a>(view: &View, views: &'a [View]) -> Vec<&'a View> {
    let finer = |other: &&View| {
        other.role == Role::Input && other.frame == view.frame && other.pinhole.resolution() > view.pinhole.resolution()
    };
    views.iter().filter(finer).collect()
}

fn of_view(set: &GaussianSet, view: &View, finer: &[&View], coarseness: Coarseness, fate: &mut [Fate]) {
    let (width, height) = (view.pinhole.width, view.pinhole.height);
    let coarseness = coarseness.of_image(width * height);
    let all = seen_in(set, view, finer, fate);
    let first = first_by_pixel(&all, view.pinhole.num_pixels());
    // A rectangle takes all returns of its pixels that are left, so that pixels are taken as a whole.
    let mut taken = vec![false; view.pinhole.num_pixels()];
    let pixels: Vec<usize> = all.chunk_by(|a, b| a.pixel == b.pixel).map(|run| run[0].pixel).collect();
    let mut group: Vec<Seen> = Vec::new();
    for size in SHAPES {
        if size[0].max(size[1]) as f32 > coarseness.most(LONGEST) {
            continue;
        }
        for &pixel in &pixels {
            let [column, line] = [pixel % width, pixel / width];
            // Every place of the rectangle in whose first row this pixel is.
            for left in (column.saturating_sub(size[0] - 1)..=column).rev() {
                if taken[pixel] {
                    break;
                }
                if left + size[0] > width || line + size[1] > height {
                    continue;
                }
                let inside = || (line..line + size[1]).flat_map(|r| r * width + left..r * width + left + size[0]);
                group.clear();
                inside().filter(|&p| !taken[p]).for_each(|p| group.extend(&all[first[p]..first[p + 1]]));
                if group.len() < 2 {
                    continue;
                }
                if let Some((row, time)) = together(set, view, &group, ([left, line], size), coarseness) {
                    inside().for_each(|p| taken[p] = true);
                    group.iter().for_each(|seen| fate[seen.index] = Fate::Goes);
                    let place = group.iter().map(|seen| seen.index).min();
                    place.into_iter().for_each(|index| fate[index] = Fate::Becomes(row, time));
                }
            }
        }
    }
}

/// The returns of a view's own frame that it shows, that no finer one does and that are still what they were, by pixel.
fn seen_in(set: &GaussianSet, view: &View, finer: &[&View], fate: &[Fate]) -> Vec<Seen> {
    let seen = |index: usize| {
        let own = u32::try_from(view.frame).is_ok_and(|frame| frame == set.frames[index]);
        if !own || !matches!(fate[index], Fate::Stays) {
            return None;
        }
        let (row, elapsed) = (&set.attributes[index], view.pinhole.time - set.times[index]);
        let velocity = set.velocities[index];
        let place = [0, 1, 2].map(|k| row[MEAN.start + k] + velocity[k] * elapsed);
        let at = view.pinhole.project_moving(place, velocity)?;
        if finer.iter().any(|finer| finer.pinhole.project_moving(place, velocity).is_some()) {
            return None;
        }
        let colour = [0, 1, 2].map(|k| sigmoid(row[LOGIT_COLOUR.start + k]));
        Some(Seen { index, at, pixel: at.pixel(view.pinhole.width), colour })
    };
    let mut all: Vec<Seen> = parallel::filter_map(set.len(), GRAIN, &seen);
    all.par_sort_unstable_by_key(|seen| (seen.pixel, seen.index));
    all
}

/// Index of the first of `all` in each pixel or behind it, and their number at the end.
fn first_by_pixel(all: &[Seen], num_pixels: usize) -> Vec<usize> {
    let mut first = vec![0; num_pixels + 1];
    all.iter().for_each(|seen| first[seen.pixel + 1] += 1);
    let mut sum = 0;
    first.iter_mut().for_each(|count| {
        sum += *count;
        *count = sum;
    });
    first
}

/// The Gaussian of at least two returns in a rectangle, and its time (seconds); `None` where they are not alike.
fn together(
    set: &GaussianSet,
    view: &View,
    returns: &[Seen],
    (corner, size): Rectangle,
    coarseness: Coarseness,
) -> Option<([f32; NUM_ATTRIBUTES], f32)> {
    let lead = returns.first()?.index;
    let alike = |seen: &Seen| set.velocities[seen.index] == set.velocities[lead];
    let colour = returns.iter().all(alike).then(|| colour(view, returns, (corner, size), coarseness))??;
    let middle = [0, 1].map(|k| corner[k] as f32 + 0.5 * size[k] as f32);
    let plane = plane(returns, middle, coarseness.factor() * DEPTH)?;
    let shines_through: f32 =
        returns.iter().map(|seen| 1.0 - sigmoid(set.attributes[seen.index][LOGIT_OPACITY])).product();
    let mut made = row([0.0; 3], 1.0, (1.0 - shines_through).min(OPACITY), colour);
    put(&mut made, &view.pinhole, middle, plane, sigmas(size, SIGMA_SHARE));
    // From the first one's time, so that the mean of equal times is that time.
    let later: f32 = returns.iter().map(|seen| set.times[seen.index] - set.times[lead]).sum();
    let time = set.times[lead] + later / returns.len() as f32;
    let elapsed = view.pinhole.time_at(middle) - time;
    made[MEAN].iter_mut().zip(set.velocities[lead]).for_each(|(x, v)| *x -= v * elapsed);
    made[LOG_SCALE].iter_mut().for_each(|s| *s = s.clamp(MIN_SCALE.ln(), MAX_SCALE.ln()));
    Some((made, time))
}

/// The mean colour of returns, where both they and the pixels around them are near it.
fn colour(view: &View, returns: &[Seen], (corner, size): Rectangle, coarseness: Coarseness) -> Option<[f32; 3]> {
    let (count, num_pixels) = (returns.len() as f32, (size[0] * size[1]) as f32);
    let mean: [f32; 3] = [0, 1, 2].map(|k| returns.iter().map(|seen| seen.colour[k]).sum::<f32>() / count);
    let away = |c: [f32; 3]| (0..3).map(|k| (c[k] - mean[k]) * (c[k] - mean[k])).sum::<f32>() / 3.0;
    let rows = corner[1]..corner[1] + size[1];
    let pixels = rows.flat_map(|r| (corner[0]..corner[0] + size[0]).map(move |c| 3 * (r * view.pinhole.width + c)));
    let of_pixels = pixels.map(|at| away([0, 1, 2].map(|k| view.image.data[at + k]))).sum::<f32>() / num_pixels;
    let of_returns = returns.iter().map(|seen| away(seen.colour)).sum::<f32>() / count;
    let most = coarseness.colour_variance(COLOUR, num_pixels);
    (of_pixels <= most && of_returns <= most).then_some(mean)
}

/// The plane around `middle` (pixels) on which returns lie; `None` where their inverse depths are further apart than a share.
fn plane(returns: &[Seen], middle: [f32; 2], share: f32) -> Option<Plane> {
    let values = |seen: &Seen| [seen.at.u - middle[0], seen.at.v - middle[1], 1.0 / seen.at.depth];
    let mean = [0, 1, 2].map(|k| returns.iter().map(|seen| values(seen)[k]).sum::<f32>() / returns.len() as f32);
    let (mut xx, mut xy, mut yy, mut xw, mut yw) = (RIDGE, 0.0, RIDGE, 0.0, 0.0);
    for seen in returns {
        let here = values(seen);
        let [x, y, w] = [0, 1, 2].map(|k| here[k] - mean[k]);
        if w.abs() > share * mean[2] {
            return None;
        }
        xx += x * x;
        xy += x * y;
        yy += y * y;
        xw += x * w;
        yw += y * w;
    }
    let determinant = xx * yy - xy * xy;
    let (by_column, by_row) = ((xw * yy - yw * xy) / determinant, (yw * xx - xw * xy) / determinant);
    let plane = Plane { at: mean[2] - by_column * mean[0] - by_row * mean[1], by_column, by_row };
    (plane.at > 0.0).then_some(plane)
}

#[cfg(test)]
mod tests {
    use super::{Coarseness, GaussianSet, merge_dense, row};
    use crate::{
        gaussians::{LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, physical::sigmoid},
        views::{
            View,
            samples::{ahead, seen},
        },
    };

    const SIZE: usize = 24;

    /// A grey view of a grey set: returns at image positions and depths.
    fn scene(returns: &[([f32; 2], f32)]) -> (GaussianSet, View) {
        let pinhole = ahead(SIZE, SIZE, 20.0);
        let view = seen(pinhole, vec![0.5; 3 * SIZE * SIZE]);
        let attributes_of = |&([u, v], depth): &([f32; 2], f32)| {
            let mean = pinhole.unproject(crate::views::Projected { u, v, depth });
            row(mean, 0.01, 0.5, [0.5; 3])
        };
        let attributes: Vec<_> = returns.iter().map(attributes_of).collect();
        let count = attributes.len();
        let (times, frames, velocities) = (vec![0.0; count], vec![0; count], vec![[0.0; 3]; count]);
        (GaussianSet { attributes, times, frames, velocities, num_lidar: count }, view)
    }

    fn merged(set: &GaussianSet, view: &View, factor: f64) -> GaussianSet {
        let mut set = set.clone();
        merge_dense(&mut set, std::slice::from_ref(view), Coarseness::new(factor).unwrap());
        set
    }

    const TWO: [([f32; 2], f32); 3] = [([10.2, 10.2], 8.0), ([18.5, 4.5], 5.0), ([10.8, 11.7], 8.1)];

    #[test]
    fn returns_of_a_few_pixels_become_one_in_the_place_of_the_first() {
        let (set, view) = scene(&TWO);
        let found = merged(&set, &view, 1.0);
        assert_eq!((found.len(), found.num_lidar, found.attributes[1]), (2, 2, set.attributes[1]));
        let at = view.pinhole.project(found.mean(0)).unwrap();
        assert!((at.u - 10.5).abs() < 1.1 && (at.v - 11.0).abs() < 1.1 && (at.depth - 8.05).abs() < 0.1, "{at:?}");
        assert!(sigmoid(found.attributes[0][LOGIT_OPACITY]) > 0.55);
        assert!(found.attributes[0][LOG_SCALE.start] > set.attributes[0][LOG_SCALE.start]);
        assert_eq!(merged(&set, &view, 0.0), set, "the finest stays");
        assert_eq!(merged(&found, &view, 1.0).len(), 2, "nothing more to do");
    }

    #[test]
    fn what_differs_stays_apart() {
        let (mut other, view) = scene(&TWO);
        other.frames[2] = 1;
        assert_eq!(merged(&other, &view, 1.0), other, "another sweep");
        let (mut other, _) = scene(&TWO);
        other.velocities[2] = [3.0, 0.0, 0.0];
        assert_eq!(merged(&other, &view, 1.0), other, "another velocity");
        let (mut other, _) = scene(&TWO);
        other.attributes[2][LOGIT_COLOUR].fill(2.0);
        assert_eq!(merged(&other, &view, 1.0), other, "another colour");
        let (far, view) = scene(&[TWO[0], TWO[1], ([10.8, 11.7], 10.0)]);
        assert_eq!(merged(&far, &view, 1.0), far, "behind an edge");
    }

    #[test]
    fn what_moves_is_where_it_was_at_its_own_moment() {
        let (mut set, mut view) = scene(&TWO);
        set.velocities = vec![[2.0, 0.0, 0.0]; 3];
        set.times = vec![-0.5; 3];
        set.attributes.iter_mut().for_each(|row| row[MEAN.start] -= 1.0);
        view.pinhole.time = 0.0;
        let moved = merged(&set, &view, 1.0);
        let (still, _) = scene(&TWO);
        let still = merged(&still, &view, 1.0);
        assert_eq!(moved.len(), 2);
        assert!((moved.attributes[0][MEAN.start] + 1.0 - still.attributes[0][MEAN.start]).abs() < 1e-5);
    }

    #[test]
    fn returns_of_several_times_become_one_of_their_mean_time() {
        let (mut set, mut view) = scene(&TWO);
        set.velocities = vec![[2.0, 0.0, 0.0]; 3];
        set.times = vec![-0.4, -0.5, -0.6];
        for (row, time) in set.attributes.iter_mut().zip(&set.times) {
            row[MEAN.start] += 2.0 * time;
        }
        view.pinhole.time = 0.0;
        let moved = merged(&set, &view, 1.0);
        let still = merged(&scene(&TWO).0, &view, 1.0);
        assert_eq!((moved.len(), &moved.frames), (2, &vec![0; 2]));
        assert!((moved.times[0] + 0.5).abs() < 1e-6 && moved.times[1] == -0.5, "{:?}", moved.times);
        assert!((moved.attributes[0][MEAN.start] + 1.0 - still.attributes[0][MEAN.start]).abs() < 1e-5);
    }
}
