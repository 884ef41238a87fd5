//! Chance: the generator of the set update, and the random twin of its decisions.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::{Action, count};

/// As many prunes and copies as `actions` has, of primitives drawn at random.
pub fn at_random(actions: &[Action], seed: u64) -> Vec<Action> {
    let counts = count(actions);
    let mut order: Vec<(u64, usize)> = (0..actions.len()).map(|i| (generator(seed, i, 1).next_u64(), i)).collect();
    order.sort_unstable();
    let mut drawn = vec![Action::Keep; actions.len()];
    for (rank, &(_, i)) in order.iter().enumerate() {
        if rank < counts.pruned {
            drawn[i] = Action::Prune;
        } else if rank < counts.pruned + counts.added {
            drawn[i] = Action::Copy;
        }
    }
    drawn
}

/// A generator keyed by (seed, primitive, purpose).
pub(super) fn generator(seed: u64, i: usize, purpose: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((i as u64) << 8 | purpose);
    rng
}
