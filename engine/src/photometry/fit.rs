//! The responses under which all images agree best about the places that they share.

use std::ops::Range;

use super::observations::{Observation, Observations};
use crate::cholesky::cholesky;

/// Rounds of re-weighted least squares, at most, and the change of a parameter below which they end.
const ROUNDS: usize = 40;
const SETTLED: f64 = 1e-4;
/// Error of a logarithm that is believed at first, before the responses are known; it shrinks by [`SHRINK`] a round down to what the places show.
const FIRST_ERROR: f64 = 0.5;
const SHRINK: f64 = 0.8;
/// Least error of a logarithm: pixels are bytes, and surfaces are no mirrors of themselves.
const LEAST_ERROR: f64 = 0.01;
/// Standard deviations of what is believed before anything is seen: logarithm of a camera's gain, tone, vignetting a square of the tangent,
/// logarithm of the gain of one image against its camera's.
const GAIN: f64 = 1.0;
const TONE: f64 = 0.1;
const VIGNETTING: f64 = 0.2;
const EXPOSURE: f64 = 0.1;
/// Places beside one another share their errors: so many say as much as one.
const ALIKE: f64 = 30.0;
/// Stands for a belief that nothing changes.
const FIXED: f64 = 1e12;

/// The logarithm of what a camera shows of a common colour: `offset + exposure + slope * log + v1 t + v2 t^2`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shown {
    pub(super) offset: [f64; 3],
    pub(super) slope: f64,
    pub(super) vignetting: [f64; 2],
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fit {
    /// One for each camera.
    pub(super) cameras: Vec<Shown>,
    /// `[views]` what is added for a single image.
    pub(super) exposures: Vec<f64>,
    /// Typical error of a logarithm at the places that are judged, as the cameras are and with their responses.
    pub(super) errors: [f64; 2],
    /// Number of these places.
    pub(super) judged: usize,
    /// `[cameras]` mean change of the logarithm by the response, over what the camera shows of these places.
    pub(super) changes: Vec<f64>,
}

/// Where parameters stand in a vector.
#[derive(Clone, Copy)]
struct Layout {
    cameras: usize,
    views: usize,
}

impl Layout {
    const fn len(self) -> usize {
        6 * self.cameras + self.views
    }

    /// Places and derivatives of the terms of an observation's logarithm in one channel, where the common one is `log`.
    fn terms(self, camera: usize, channel: usize, seen: &Observation, log: f64) -> [(usize, f64); 5] {
        let own = 6 * camera;
        let t = seen.off_axis;
        [(own + channel, 1.0), (own + 3, log), (own + 4, t), (own + 5, t * t), (6 * self.cameras + seen.view, 1.0)]
    }
}

/// Which places the responses are judged by; all are fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Judged {
    /// Those that several cameras show.
    BetweenCameras,
    /// All of them.
    All,
}

/// The best responses; the camera `reference` keeps its gain and its tone.
///
/// # Shapes
/// `cameras` `[views]` the camera of each view.
pub(super) fn fit(
    observed: &Observations,
    cameras: &[usize],
    num_cameras: usize,
    reference: usize,
    judged: Judged,
) -> Fit {
    let layout = Layout { cameras: num_cameras, views: cameras.len() };
    let identity: Vec<f64> =
        (0..layout.len()).map(|i| if i < 6 * num_cameras && i % 6 == 3 { 1.0 } else { 0.0 }).collect();
    let counts = |run: &&Range<usize>| judged == Judged::All || differ(&observed.all[(*run).clone()], cameras);
    let counted: Vec<&Range<usize>> = observed.places.iter().filter(counts).collect();
    let mut errors = vec![0.0; observed.all.len()];
    let spread = |parameters: &[f64], errors: &mut [f64]| {
        for run in &observed.places {
            deviations(&observed.all[run.clone()], cameras, layout, parameters, &mut errors[run.clone()]);
        }
    };
    let typical = |errors: &[f64]| {
        let mut all: Vec<f64> = counted.iter().flat_map(|run| errors[(*run).clone()].iter().copied()).collect();
        let middle = all.len() / 2;
        all.sort_unstable_by(f64::total_cmp);
        all.get(middle).copied().unwrap_or(0.0)
    };
    spread(&identity, &mut errors);
    let before = typical(&errors);
    let mut parameters = identity.clone();
    let mut believed = FIRST_ERROR;
    for _ in 0..ROUNDS {
        let error = (1.5 * typical(&errors)).max(LEAST_ERROR).max(believed);
        believed *= SHRINK;
        let weights: Vec<f64> =
            observed.all.iter().zip(&errors).map(|(seen, e)| seen.weight / (1.0 + (e / error).powi(2))).collect();
        let weight = |i: usize| ALIKE * (error / belief(i, layout, reference)).powi(2);
        let beliefs: Vec<(f64, f64)> = identity.iter().enumerate().map(|(i, &value)| (value, weight(i))).collect();
        let next = step(observed, cameras, layout, &weights, &beliefs, &parameters);
        let change = next.iter().zip(&parameters).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        parameters = next;
        spread(&parameters, &mut errors);
        if change < SETTLED && believed < error {
            break;
        }
    }
    let common = |seen: &Observation, channel: usize| {
        let run = std::slice::from_ref(seen);
        Place { seen: run, cameras, layout, parameters: &parameters, channel }.common(std::iter::once(1.0))
    };
    let mut changes = vec![(0.0, 0.0); num_cameras];
    for seen in counted.iter().flat_map(|run| &observed.all[(*run).clone()]) {
        let change = (0..3).map(|k| (common(seen, k) - seen.log[k]).abs()).sum::<f64>() / 3.0;
        let (sum, weight) = &mut changes[cameras[seen.view]];
        *sum += seen.weight * change;
        *weight += seen.weight;
    }
    let camera = |c: usize| {
        let own = &parameters[6 * c..6 * c + 6];
        Shown { offset: [own[0], own[1], own[2]], slope: own[3], vignetting: [own[4], own[5]] }
    };
    Fit {
        cameras: (0..num_cameras).map(camera).collect(),
        exposures: parameters[6 * num_cameras..].to_vec(),
        errors: [before, typical(&errors)],
        judged: counted.len(),
        changes: changes.into_iter().map(|(sum, weight)| if weight > 0.0 { sum / weight } else { 0.0 }).collect(),
    }
}

/// Whether the observations of a place are of more than one camera.
fn differ(place: &[Observation], cameras: &[usize]) -> bool {
    place.iter().any(|seen| cameras[seen.view] != cameras[place[0].view])
}

/// How far a parameter may be from what it is for a camera that shows colours as they are.
fn belief(index: usize, layout: Layout, reference: usize) -> f64 {
    if index >= 6 * layout.cameras {
        return EXPOSURE;
    }
    match (index % 6, index / 6 == reference) {
        (0..=3, true) => FIXED.recip(),
        (0..=2, false) => GAIN,
        (3, false) => TONE,
        _ => VIGNETTING,
    }
}

/// A place in one channel under given responses.
struct Place<'a> {
    seen: &'a [Observation],
    cameras: &'a [usize],
    layout: Layout,
    parameters: &'a [f64],
    channel: usize,
}

impl Place<'_> {
    fn slope(&self, seen: &Observation) -> f64 {
        self.parameters[6 * self.cameras[seen.view] + 3]
    }

    /// The common logarithm that fits its observations best.
    fn common(&self, weights: impl Iterator<Item = f64>) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for (seen, weight) in self.seen.iter().zip(weights) {
            let slope = self.slope(seen);
            sum += weight * slope * self.rest(seen, 0.0);
            total += weight * slope * slope;
        }
        sum / total
    }

    /// What is left of an observation's logarithm where the common one is `log`.
    fn rest(&self, seen: &Observation, log: f64) -> f64 {
        let terms = self.layout.terms(self.cameras[seen.view], self.channel, seen, log);
        seen.log[self.channel] - terms.iter().map(|&(i, x)| self.parameters[i] * x).sum::<f64>()
    }
}

/// Distance of each observation from what its camera would show of the place, root mean square over channels, logarithms.
fn deviations(place: &[Observation], cameras: &[usize], layout: Layout, parameters: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    for channel in 0..3 {
        let place = Place { seen: place, cameras, layout, parameters, channel };
        let log = place.common(place.seen.iter().map(|seen| seen.weight));
        for (error, seen) in out.iter_mut().zip(place.seen) {
            *error += place.rest(seen, log).powi(2) / 3.0;
        }
    }
    // The mean is nearer to each of few than the truth is.
    let few = place.len() as f64 / (place.len() as f64 - 1.0);
    out.iter_mut().for_each(|error| *error = (*error * few).sqrt());
}

/// The parameters one Gauss-Newton step nearer to the least weighted squares of what is left, and of what is believed; common colours, which
/// every step takes as they fit best, are eliminated.
fn step(
    observed: &Observations,
    cameras: &[usize],
    layout: Layout,
    weights: &[f64],
    beliefs: &[(f64, f64)],
    parameters: &[f64],
) -> Vec<f64> {
    let n = layout.len();
    let (mut system, mut right) = (vec![0.0; n * n], vec![0.0; n]);
    let mut mean: Vec<(usize, f64)> = Vec::new();
    for run in &observed.places {
        let weights = &weights[run.clone()];
        for channel in 0..3 {
            let place = Place { seen: &observed.all[run.clone()], cameras, layout, parameters, channel };
            let log = place.common(weights.iter().copied());
            mean.clear();
            let mut total = 0.0;
            for (seen, &weight) in place.seen.iter().zip(weights) {
                let (terms, rest, slope) =
                    (layout.terms(cameras[seen.view], channel, seen, log), place.rest(seen, log), place.slope(seen));
                total += weight * slope * slope;
                for (i, x) in terms {
                    terms.iter().for_each(|&(j, y)| system[i * n + j] += weight * x * y);
                    right[i] += weight * x * rest;
                    match mean.iter_mut().find(|(index, _)| *index == i) {
                        Some((_, sum)) => *sum += weight * slope * x,
                        None => mean.push((i, weight * slope * x)),
                    }
                }
            }
            for &(i, x) in &mean {
                mean.iter().for_each(|&(j, y)| system[i * n + j] -= x * y / total);
            }
        }
    }
    for (i, &(value, weight)) in beliefs.iter().enumerate() {
        system[i * n + i] += weight;
        right[i] += weight * (value - parameters[i]);
    }
    cholesky(&mut system, &mut right);
    right.iter().zip(parameters).map(|(change, value)| value + change).collect()
}
