//! The primitives whose single actions are tried, and what the signals say of them.

use lgs_engine::gaussians::GaussianSet;
use lgs_engine::gaussians::physical::to_physical;
use lgs_engine::render::{blended_sums, render_for_gradient};
use lgs_formats::targets::{Normalise, TargetsConfig};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::branches::{BEHIND, Problem, Round, branch_gradients};
use crate::delta::{Deltas, NeighbourSets, footprint_deltas, magnitude_deltas, merge_rounds, response_deltas};
use crate::error::{Result, TargetError};
use crate::exact::{exact, of_rounds};
use crate::footprint::footprints;

/// A signal with its normalisation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignalName {
    /// Responses, each branch by its own largest gradients.
    ResponseBranch,
    /// Responses, all branches by the original's.
    ResponseOriginal,
    /// The loss under the blending weights; it has no maxima, so one normalisation is as the other.
    Footprint,
    /// The response of the original branch alone; one normalisation is as the other.
    Magnitude,
    /// The exact effect of taking it out, and what its halves could gain; it has no maxima either.
    Exact,
}

/// Every signal, in the order of the tables.
pub const SIGNALS: [SignalName; 5] = [
    SignalName::ResponseBranch,
    SignalName::ResponseOriginal,
    SignalName::Footprint,
    SignalName::Magnitude,
    SignalName::Exact,
];

impl SignalName {
    /// How tables call it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ResponseBranch => "response, branch",
            Self::ResponseOriginal => "response, original",
            Self::Footprint => "footprint",
            Self::Magnitude => "magnitude",
            Self::Exact => "exact",
        }
    }

    /// The part of a file's name.
    pub const fn key(self) -> &'static str {
        match self {
            Self::ResponseBranch => "response-branch",
            Self::ResponseOriginal => "response-original",
            Self::Footprint => "footprint",
            Self::Magnitude => "magnitude",
            Self::Exact => "exact",
        }
    }
}

/// What one signal says of the sampled primitives.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalDeltas {
    /// The signal.
    pub signal: SignalName,
    /// `[M]` deltas of taking the primitive out.
    pub prune: Vec<f64>,
    /// `[M]` deltas of a copy.
    pub add: Vec<f64>,
}

/// Primitives to try.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// `[M]` the primitives, in a random order.
    pub chosen: Vec<usize>,
    /// `[M]` their copies: those of the first round that sampled each.
    pub copies: GaussianSet,
    /// `[M]` sums of their blending weights over all views, pixels.
    pub visible_px: Vec<f64>,
    /// What the signals say.
    pub signals: Vec<SignalDeltas>,
}

impl Sample {
    /// `size` of the primitives that the rounds sampled and that every signal has a target for, drawn by the seed; fewer when there are
    /// fewer.
    ///
    /// # Errors
    /// When a position is not finite, or fewer than four primitives can be tried.
    pub fn new(problem: &Problem<'_>, config: &TargetsConfig, seed: u64, size: usize) -> Result<Self> {
        let rounds = Round::all(problem.set, config, seed);
        let neighbours = NeighbourSets::new(problem.set, &rounds, config.neighbours)?;
        let gradients = branch_gradients(problem, &rounds);
        let with = |normalise| {
            response_deltas(&gradients, &rounds, &neighbours, &TargetsConfig { normalise, ..config.clone() })
        };
        let by_signal: Vec<Deltas> = [
            with(Normalise::Branch),
            with(Normalise::Original),
            footprint_deltas(footprints(problem, &rounds)),
            magnitude_deltas(&gradients.original, &rounds),
            of_rounds(&exact(problem), &rounds),
        ]
        .iter()
        .map(|deltas| merge_rounds(&rounds, deltas))
        .collect();
        let known = |k: &usize| by_signal.iter().all(|d| d.actions.prune[*k].is_some() && d.actions.add[*k].is_some());
        let mut drawn: Vec<(u64, usize)> =
            (0..by_signal[0].index.len()).filter(known).map(|k| (order_key(seed, k), k)).collect();
        drawn.sort_unstable();
        drawn.truncate(size);
        if drawn.len() < 4 {
            return Err(TargetError::unfit("CLIP", "4 primitives with targets or more", drawn.len().to_string()));
        }
        let places: Vec<usize> = drawn.into_iter().map(|(_, k)| k).collect();
        let chosen: Vec<usize> = places.iter().map(|&k| by_signal[0].index[k] as usize).collect();
        let pick = |deltas: &[Option<f64>]| places.iter().filter_map(|&k| deltas[k]).collect();
        let measured = |(&signal, deltas): (&SignalName, &Deltas)| SignalDeltas {
            signal,
            prune: pick(&deltas.actions.prune),
            add: pick(&deltas.actions.add),
        };
        Ok(Self {
            copies: first_copies(&rounds, &chosen),
            visible_px: visible_px(problem, &chosen),
            signals: SIGNALS.iter().zip(&by_signal).map(measured).collect(),
            chosen,
        })
    }

    /// The first `size` of them.
    pub fn first(&self, size: usize) -> Self {
        let size = size.min(self.chosen.len());
        let cut = |values: &[f64]| values[..size].to_vec();
        let measured = |m: &SignalDeltas| SignalDeltas { signal: m.signal, prune: cut(&m.prune), add: cut(&m.add) };
        Self {
            chosen: self.chosen[..size].to_vec(),
            copies: self.copies.select(&(0..size).collect::<Vec<_>>(), size),
            visible_px: cut(&self.visible_px),
            signals: self.signals.iter().map(measured).collect(),
        }
    }
}

fn visible_px(problem: &Problem<'_>, chosen: &[usize]) -> Vec<f64> {
    let splats = to_physical(problem.set);
    let mut sums = vec![0.0; splats.len()];
    for view in problem.views {
        let state = render_for_gradient(&splats, &view.pinhole, BEHIND);
        let blended = blended_sums::<1>(&state, &[&vec![1.0; view.pinhole.num_pixels()]]);
        state.visible().zip(blended).for_each(|(i, blended)| sums[i] += blended[0]);
    }
    chosen.iter().map(|&i| sums[i]).collect()
}

fn order_key(seed: u64, k: usize) -> u64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // Beyond every stream that sampling draws from.
    rng.set_stream((k as u64) << 16 | 0xffff);
    rng.next_u64()
}

fn first_copies(rounds: &[Round], chosen: &[usize]) -> GaussianSet {
    let mut copies = GaussianSet { num_lidar: chosen.len(), ..GaussianSet::default() };
    for &i in chosen {
        let found = rounds.iter().find_map(|round| {
            let place = round.chosen.iter().position(|&c| c as usize == i)?;
            Some((&round.copies, place))
        });
        if let Some((from, place)) = found {
            copies.append(&from.select(&[place], 1));
        }
    }
    copies
}
