//! The actions that meet a budget.

use super::{Action, Scores, Thresholds, by_thresholds};
use crate::error::Result;

/// The actions that thresholds decide, held to at most `budget` primitives by rank: first the worst are pruned, then the best
/// additions are made. Ties by index.
///
/// # Errors
/// When a score is not finite.
pub fn by_budget(scores: &Scores, thresholds: Thresholds, budget: usize) -> Result<Vec<Action>> {
    let mut actions = by_thresholds(scores, thresholds)?;
    let by_score = |scores: &[f32], of: &[usize]| {
        let mut order = of.to_vec();
        order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]).then(a.cmp(&b)));
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
