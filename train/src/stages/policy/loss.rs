//! The loss of scores against their targets.

use lgs_formats::targets::{ActionTargets, ClipTargets};

/// Added to the sum of weights: a clip without a target has no loss.
const EPS: f64 = 1e-8;

/// What the score of a primitive should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Target {
    /// Which score.
    pub(crate) at: usize,
    /// The score.
    pub(crate) y: f64,
    /// How much it counts.
    pub(crate) weight: f64,
}

/// Targets of pruning and of adding.
pub(crate) type Targets = [Vec<Target>; 2];

/// A loss and its gradient by the scores.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Loss {
    /// Of pruning and of adding.
    pub(crate) values: [f64; 2],
    /// `[scores]` of pruning and adding.
    pub(crate) gradient: Vec<[f32; 2]>,
}

/// The targets of a clip that count; `place` gives the score that a primitive has, where it has one.
///
/// # Formula
/// `w = (2 |y - 1/2|)^gamma`, 0 where the mask is not set.
pub(crate) fn targets(clip: &ClipTargets, gamma: f64, place: impl Fn(usize) -> Option<usize>) -> Targets {
    let counted = |action: &ActionTargets| {
        let rows = clip.index.iter().zip(&action.y).zip(&action.mask).filter(|(_, mask)| **mask);
        let target = |((&i, &y), _): ((&u32, &f32), &bool)| {
            let y = f64::from(y);
            let weight = libm::pow(2.0 * (y - 0.5).abs(), gamma);
            place(i as usize).map(|at| Target { at, y, weight })
        };
        rows.filter_map(target).collect()
    };
    [counted(&clip.prune), counted(&clip.add)]
}

/// The loss of scores.
///
/// # Formula
/// `sum_a sum_i w_i (p_i - y_i)^2 / (sum_i w_i + eps)`
///
/// # Gradient
/// `2 w_i (p_i - y_i) / (sum_i w_i + eps)`, summed over the primitives that share a score, in their order.
pub(crate) fn loss(scores: &[[f32; 2]], targets: &Targets) -> Loss {
    let mut gradient = vec![[0.0_f64; 2]; scores.len()];
    let mut values = [0.0; 2];
    for (a, targets) in targets.iter().enumerate() {
        let total = targets.iter().map(|t| t.weight).sum::<f64>() + EPS;
        for Target { at, y, weight } in targets {
            let error = f64::from(scores[*at][a]) - y;
            values[a] += weight * error * error / total;
            gradient[*at][a] += 2.0 * weight * error / total;
        }
    }
    Loss { values, gradient: gradient.into_iter().map(|g| g.map(crate::scenes::maths::narrow)).collect() }
}

#[cfg(test)]
mod tests {
    use lgs_formats::targets::{ActionTargets, ClipTargets};

    use super::{loss, targets};

    #[test]
    fn weights_and_slopes() {
        let prune = ActionTargets { y: vec![1.0, 0.75, 0.5], delta: vec![0.0; 3], mask: vec![true, true, false] };
        let add = ActionTargets { y: vec![0.0, 0.5, 0.25], delta: vec![0.0; 3], mask: vec![true; 3] };
        let clip = ClipTargets { index: vec![0, 2, 5], prune, add, ..ClipTargets::default() };
        let found = targets(&clip, 2.0, |i| (i < 5).then_some(i / 2));
        // Primitives 0 and 2 have the scores 0 and 1; 5 has none.
        let weights = found.clone().map(|t| t.iter().map(|t| (t.at, t.weight)).collect::<Vec<_>>());
        assert_eq!(weights, [vec![(0, 1.0), (1, 0.25)], vec![(0, 1.0), (1, 0.0)]]);
        let scores = [[0.5, 0.5], [0.25, 0.25]];
        let got = loss(&scores, &found);
        assert!((got.values[0] - (0.25 + 0.25 * 0.25) / 1.25).abs() < 1e-7 && (got.values[1] - 0.25).abs() < 1e-7);
        for (i, a) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let at = |by: f32| {
                let mut scores = scores;
                scores[i][a] += by;
                loss(&scores, &found).values.iter().sum::<f64>()
            };
            let slope = (at(0.01) - at(-0.01)) / 0.02;
            assert!((slope - f64::from(got.gradient[i][a])).abs() < 1e-5, "{i} {a}: {slope}");
        }
        assert_eq!(loss(&[], &[Vec::new(), Vec::new()]).values, [0.0; 2]);
    }
}
