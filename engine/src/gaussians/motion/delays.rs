//! How much later than their times say the returns of what moves were measured, as its outlines in the images tell.

use std::collections::BTreeMap;

use super::{
    Movement,
    outlines::{FEWEST, Outermost, outermosts},
};
use crate::{points::PointCloud, views::View};

/// Turns of a camera that are allowed for, as many on either side and so many radians apart: a wrong mount moves outlines like a delay, but
/// those of fast things no farther than those of slow ones.
const TURNS: (i32, f32) = (4, 1e-3);
/// Seconds before and after a delay whose edges count too: edges of other things come and go within less.
const BESIDE: f32 = 0.01;
/// How many beams an outline must move between the longest delay and its opposite: all others say nothing.
const PASSES: f32 = 2.0;
/// Contrast from which on an edge is plain: the strongest edges of an image are not to outweigh all others.
const PLAIN: f32 = 0.1;
/// How many times as strong edges must be than without a delay ...
const STRONGER: f64 = 1.1;
/// ... and by how many standard errors stronger. What is seen of one thing in one image counts as one observation.
const SURE: f64 = 1.75;

/// Which of some delays (seconds) of the returns the outlines of what moves fit best; `None` where none fits plainly better than no delay.
///
/// # Formula
/// The largest `sum over cameras, max over turns, sum over outermost returns and over times at most 0.01 s beside` of `min(contrast, 0.1)`
/// across the outline. It must be 1.1 times that of no delay, and what it has more, `d` for each thing in each image, at least
/// `1.75 sqrt(sum d^2)` in all.
pub(crate) fn best_delay(cloud: &PointCloud, movement: &Movement, views: &[View], delays: &[f32]) -> Option<usize> {
    let longest = delays.iter().map(|delay| delay.abs()).fold(0.0, f32::max);
    let passes = |end: &Outermost<'_>| {
        let column = |delay: f32| end.column(cloud, movement, cloud.times[end.point] + delay);
        column(-longest).zip(column(longest)).is_some_and(|(a, b)| (a - b).abs() >= PASSES * end.beam())
    };
    let mut cameras: BTreeMap<&str, Vec<Outermost<'_>>> = BTreeMap::new();
    for end in outermosts(cloud, movement, views).into_iter().filter(passes) {
        cameras.entry(&end.view.camera).or_default().push(end);
    }
    if cameras.values().map(Vec::len).sum::<usize>() < FEWEST {
        return None;
    }
    let strength = |end: &Outermost<'_>, delay: f32, turn: f32| -> f64 {
        let time = cloud.times[end.point] + delay;
        let contrast = |beside: f32| f64::from(end.contrast(cloud, movement, time + beside, turn).min(PLAIN));
        [-BESIDE, 0.0, BESIDE].map(contrast).iter().sum()
    };
    let turned = |ends: &[Outermost<'_>], delay: f32, turn: i32| -> Vec<f64> {
        ends.iter().map(|end| strength(end, delay, turn as f32 * TURNS.1)).collect()
    };
    // The strength of every end, camera after camera, each turned as it fits best.
    let fit = |delay: f32| -> Vec<f64> {
        let best = |ends: &Vec<Outermost<'_>>| {
            let fits = (-TURNS.0..=TURNS.0).map(|turn| turned(ends, delay, turn));
            fits.reduce(|a, b| if total(&b) > total(&a) { b } else { a }).unwrap_or_default()
        };
        cameras.values().flat_map(best).collect()
    };
    let found = delays.iter().map(|&delay| fit(delay)).enumerate();
    let (index, best) = found.reduce(|a, b| if total(&b.1) > total(&a.1) { b } else { a })?;
    let as_it_is = fit(0.0);
    let mut observations: BTreeMap<(usize, &str, u32), f64> = BTreeMap::new();
    for ((end, with), without) in cameras.values().flatten().zip(&best).zip(&as_it_is) {
        let seen = (end.view.frame, end.view.camera.as_str(), movement.things[end.point]);
        *observations.entry(seen).or_default() += with - without;
    }
    let error = observations.values().map(|d| d * d).sum::<f64>().sqrt();
    let stronger = total(&best) - total(&as_it_is);
    (stronger >= SURE * error && total(&best) >= STRONGER * total(&as_it_is)).then_some(index)
}

fn total(fit: &[f64]) -> f64 {
    fit.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::best_delay;
    use crate::{
        gaussians::motion::{Flow, Movement},
        points::PointCloud,
        views::{
            PinholeView, Projected, View,
            samples::{ahead, seen},
        },
    };

    const SIZE: [usize; 2] = [200, 60];
    const DEPTH: f32 = 10.0;
    /// Columns that a thing takes, from which on it stands in the first image.
    const WIDE: usize = 40;

    /// Dark things with a pattern before a bright wall, at some columns.
    fn image(frame: usize, columns: &[f32]) -> View {
        let shade = |i: usize| {
            let (row, column) = (i / SIZE[0], (i % SIZE[0]) as f32);
            let thing = columns.iter().find(|&&left| (left..left + WIDE as f32).contains(&column));
            match thing.filter(|_| (10..50).contains(&row)) {
                Some(left) => 0.2 + 0.1 * ((column - left) * 0.4).sin(),
                None => 0.7 + 0.1 * (column * 0.3).cos(),
            }
        };
        let view = seen(ahead(SIZE[0], SIZE[1], 200.0), (0..SIZE[0] * SIZE[1]).flat_map(|i| [shade(i); 3]).collect());
        View { frame, pinhole: PinholeView { time: 0.2 * frame as f32, ..view.pinhole }, ..view }
    }

    /// Two things that move to the right at such speeds (metres a second) in four images, measured so many seconds after their sweeps'
    /// timestamps, which are the images' times, by a sensor to which the camera is turned by so many pixels.
    fn drive(speeds: [f32; 2], later: f32, pixels: f32) -> (PointCloud, Movement, Vec<View>) {
        let (mut cloud, mut movement) = (PointCloud::default(), Movement::default());
        let mut views = Vec::new();
        for frame in 0..4_u32 {
            let time = 0.2 * frame as f32;
            let lefts = [0, 1].map(|k| (if k == 0 { 20.0 } else { 110.0 }) + speeds[k] * time / DEPTH * 200.0);
            let view = image(frame as usize, &lefts);
            for (k, left) in lefts.iter().enumerate() {
                let thing = u32::try_from(movement.flows.len()).unwrap();
                movement.flows.push(Flow { frame, rows: [[0.0, 0.0, 0.0, speeds[k]], [0.0; 4], [0.0; 4]] });
                for (row, column) in (12..48).flat_map(|row| (1..WIDE).step_by(2).map(move |column| (row, column))) {
                    let u = left + column as f32 + 0.5 - pixels;
                    let [x, y, z] = view.pinhole.unproject(Projected { u, v: row as f32 + 0.5, depth: DEPTH });
                    cloud.positions.push([x + speeds[k] * later, y, z]);
                    cloud.origins.push([0.0; 3]);
                    cloud.times.push(time);
                    cloud.frames.push(frame);
                    movement.velocities.push([speeds[k], 0.0, 0.0]);
                    movement.things.push(thing);
                }
            }
            views.push(view);
        }
        (cloud, movement, views)
    }

    #[test]
    fn outlines_tell_a_delay_from_none_and_from_a_turn_of_the_camera() {
        let delays = [0.05, -0.05];
        for (later, want) in [(0.05, Some(0)), (-0.05, Some(1)), (0.0, None)] {
            for pixels in [0.0, 0.6] {
                let (cloud, movement, views) = drive([5.0, -4.0], later, pixels);
                assert_eq!(best_delay(&cloud, &movement, &views, &delays), want, "{later} s, {pixels} pixels");
            }
        }
        let (cloud, movement, views) = drive([0.3, -0.2], 0.05, 0.0);
        assert_eq!(best_delay(&cloud, &movement, &views, &delays), None, "what hardly moves says nothing");
    }
}
