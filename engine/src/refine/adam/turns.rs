//! Which views a step looks at.

use std::num::NonZeroUsize;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Indices of the views of a step, ascending: all of `num_views`, or `per_step` of them in turns, each of which has every view once in an
/// order of its own.
pub(super) fn views_of(step: usize, num_views: usize, per_step: Option<NonZeroUsize>, seed: u64) -> Vec<usize> {
    let Some(per_step) = per_step.map(NonZeroUsize::get).filter(|&count| count < num_views) else {
        return (0..num_views).collect();
    };
    let mut orders = Orders { seed, num_views, last: None };
    let mut chosen: Vec<usize> = (step * per_step..(step + 1) * per_step).map(|place| orders.at(place)).collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// The orders of the turns; the last one is kept.
struct Orders {
    seed: u64,
    num_views: usize,
    last: Option<(usize, Vec<usize>)>,
}

impl Orders {
    /// The view at a place of the sequence of all turns.
    fn at(&mut self, place: usize) -> usize {
        let turn = place / self.num_views;
        let order = match self.last.take() {
            Some((of, order)) if of == turn => order,
            _ => self.order(turn),
        };
        let view = order[place % self.num_views];
        self.last = Some((turn, order));
        view
    }

    fn order(&self, turn: usize) -> Vec<usize> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(turn as u64);
        let mut order: Vec<(u64, usize)> = (0..self.num_views).map(|view| (rng.next_u64(), view)).collect();
        order.sort_unstable();
        order.into_iter().map(|(_, view)| view).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::views_of;

    #[test]
    fn every_view_has_its_turn() {
        let three = std::num::NonZeroUsize::new(3);
        let mut counts = [0; 6];
        for step in 0..20 {
            let views = views_of(step, 6, three, 4);
            assert!(views.is_sorted() && views.len() == 3, "{views:?}");
            views.into_iter().for_each(|view| counts[view] += 1);
        }
        assert_eq!(counts, [10; 6]);
        assert_eq!(views_of(7, 6, three, 4), views_of(7, 6, three, 4));
        assert_ne!(
            (0..9).map(|s| views_of(s, 6, three, 4)).collect::<Vec<_>>(),
            (0..9).map(|s| views_of(s, 6, three, 5)).collect::<Vec<_>>()
        );
    }

    #[test]
    fn no_limit_or_one_that_is_no_less_means_all() {
        for limit in [None, std::num::NonZeroUsize::new(4), std::num::NonZeroUsize::new(9)] {
            assert_eq!(views_of(3, 4, limit, 0), [0, 1, 2, 3]);
        }
        // The turns do not fit together with the steps: a view that two turns give to one step counts once.
        let views = views_of(1, 3, std::num::NonZeroUsize::new(2), 1);
        assert!((1..=2).contains(&views.len()));
    }
}
