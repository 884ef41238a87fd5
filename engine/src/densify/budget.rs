//! The actions that meet a budget.

use super::{Action, Scores, Thresholds, by_thresholds};
use crate::error::Result;

/// The actions that thresholds decide, held to at most `budget` primitives by rank: first the worst are pruned, then the best
/// additions are made. Equal scores go in an order that leaves gaps of even size between the indices, which follow frames and beams: a policy
/// that tells nothing apart thins the scene instead of taking its first frames out.
///
/// # Errors
/// When a score is not finite.
pub fn by_budget(scores: &Scores, thresholds: Thresholds, budget: usize) -> Result<Vec<Action>> {
    let mut actions = by_thresholds(scores, thresholds)?;
    let by_score = |scores: &[f32], of: &[usize]| {
        let mut order = of.to_vec();
        order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]).then(spread(a).cmp(&spread(b))));
        order
    };
    let kept: Vec<usize> = (0..actions.len()).filter(|&i| actions[i] != Action::Prune).collect();
    if kept.len() > budget {
        for &i in &by_score(&scores.prune, &kept)[..kept.len() - budget] {
            actions[i] = Action::Prune;
        }
    }
    let kept = actions.iter().filter(|&&a| a != Action::Prune).count();
    let copies: Vec<usize> = (0..actions.len()).filter(|&i| actions[i] == Action::Copy).collect();
    for &i in by_score(&scores.add, &copies).iter().skip(budget - kept) {
        actions[i] = Action::Keep;
    }
    Ok(actions)
}

/// The place of an index in an order of which every beginning lies evenly among the indices (multiples of the golden ratio, modulo 1).
pub(super) const fn spread(index: usize) -> u64 {
    (index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

#[cfg(test)]
mod tests {
    use super::{Action, Scores, Thresholds, by_budget};

    #[test]
    fn equal_scores_thin_evenly() {
        let scores = Scores { prune: vec![0.5; 1000], add: vec![0.5; 1000] };
        for budget in [999, 700, 500, 100] {
            let actions = by_budget(&scores, Thresholds::default(), budget).unwrap();
            let of = |part: &[Action]| part.iter().filter(|&&a| a == Action::Prune).count();
            assert_eq!(of(&actions), 1000 - budget);
            let share = (1000 - budget) / 10;
            assert!(actions.chunks(100).all(|part| of(part).abs_diff(share) <= 2), "{budget}");
        }
    }
}
