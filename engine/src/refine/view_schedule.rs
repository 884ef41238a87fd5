//! Which views a step looks at.

use std::num::NonZeroUsize;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::views::View;

/// How many views a step looks at, in turns each of which shows every view once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViewSchedule {
    /// Most views of a step; `None` for all of them.
    pub views_per_step: Option<NonZeroUsize>,
    /// Decides on the order of each turn.
    pub seed: u64,
}

impl ViewSchedule {
    /// The views of a step, in their order: all, or the next ones of its turn.
    pub(crate) fn of_step<'a>(&self, step: usize, views: &[&'a View]) -> Vec<&'a View> {
        self.indices(step, views.len()).into_iter().map(|k| views[k]).collect()
    }

    /// Whether every step looks at all of so many views.
    pub(crate) fn take_all(&self, num_views: usize) -> bool {
        self.views_per_step.is_none_or(|count| count.get() >= num_views)
    }

    /// Steps of a turn.
    pub(crate) fn steps_of_turn(&self, num_views: usize) -> usize {
        self.views_per_step.map_or(1, |count| num_views.div_ceil(count.get())).max(1)
    }

    fn indices(&self, step: usize, num_views: usize) -> Vec<usize> {
        let Some(per_step) = self.views_per_step.map(NonZeroUsize::get).filter(|&count| count < num_views) else {
            return (0..num_views).collect();
        };
        let steps = self.steps_of_turn(num_views);
        let mut chosen: Vec<usize> =
            self.order(step / steps, num_views).into_iter().skip(step % steps * per_step).take(per_step).collect();
        chosen.sort_unstable();
        chosen
    }

    fn order(&self, turn: usize, num_views: usize) -> Vec<usize> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(turn as u64);
        let mut order: Vec<(u64, usize)> = (0..num_views).map(|view| (rng.next_u64(), view)).collect();
        order.sort_unstable();
        order.into_iter().map(|(_, view)| view).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::ViewSchedule;

    fn schedule(views_per_step: usize, seed: u64) -> ViewSchedule {
        ViewSchedule { views_per_step: std::num::NonZeroUsize::new(views_per_step), seed }
    }

    #[test]
    fn every_view_has_its_turn() {
        let mut counts = [0; 6];
        for step in 0..20 {
            let views = schedule(3, 4).indices(step, 6);
            assert!(views.is_sorted() && views.len() == 3, "{views:?}");
            views.into_iter().for_each(|view| counts[view] += 1);
        }
        assert_eq!(counts, [10; 6]);
        let first = |seed| (0..9).map(|step| schedule(3, seed).indices(step, 6)).collect::<Vec<_>>();
        assert_eq!(first(4), first(4));
        assert_ne!(first(4), first(5));
        assert!(!schedule(3, 4).take_all(6));
    }

    #[test]
    fn no_limit_or_one_that_is_no_less_means_all() {
        for limit in [0, 4, 9] {
            assert_eq!(schedule(limit, 0).indices(3, 4), [0, 1, 2, 3]);
            assert!(schedule(limit, 0).take_all(4));
        }
    }

    #[test]
    fn the_last_step_of_a_turn_has_what_is_left() {
        let turn = |number: usize| [0, 1, 2].map(|step| schedule(3, 1).indices(3 * number + step, 7));
        for number in 0..4 {
            assert_eq!(turn(number).each_ref().map(Vec::len), [3, 3, 1]);
            let mut views = turn(number).concat();
            views.sort_unstable();
            assert_eq!(views, [0, 1, 2, 3, 4, 5, 6]);
        }
        assert_eq!([0, 3, 7, 9].map(|limit| schedule(limit, 1).steps_of_turn(7)), [1, 3, 1, 1]);
    }
}
