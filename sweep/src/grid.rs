//! From values along several axes to the configurations that differ.

use std::num::NonZeroUsize;

use super::setting::{Background, DensityBy, Network, Refiner, Setting, Switch, THETA, Weights};

/// What is tried along each axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// Backgrounds.
    pub background: Vec<Background>,
    /// Steps of the learned refinement.
    pub refine_steps: Vec<usize>,
    /// Whether the query runs.
    pub query: Vec<Switch>,
    /// Who prunes and adds.
    pub density: Vec<DensityBy>,
    /// Scores above which the policy acts.
    pub theta: Vec<f32>,
    /// Budgets of the set update; `None` for none.
    pub max_gaussians: Vec<Option<usize>>,
    /// Numbers of steps of per-scene optimisation from the initial Gaussians.
    pub adam: Vec<usize>,
    /// Views that a step of it looks at; `None` for all.
    pub adam_views: Vec<Option<NonZeroUsize>>,
}

/// Weights, and which of the optional parts their model has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parts {
    /// The weights.
    pub weights: Weights,
    /// Whether there is a query.
    pub query: bool,
    /// Whether there is a policy.
    pub policy: bool,
}

/// Configurations that one run of the pipeline passes through: a single one, or per-scene optimisation after ascending numbers of steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Which of the networks it uses; `None` for none.
    pub network: Option<usize>,
    /// The configurations, in the order in which the run comes to them.
    pub settings: Vec<Setting>,
}

impl Run {
    /// About what it costs, to weigh progress: steps of refinement, and what comes before them.
    pub fn weight(&self) -> u64 {
        3 + self.settings.iter().map(Setting::steps).max().unwrap_or(0) as u64
    }
}

/// The runs that come to every configuration of the grid once: what a model has no part for is not told apart.
pub fn runs(axes: &Axes, models: &[Parts]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for &background in &axes.background {
        for (index, model) in models.iter().enumerate() {
            for network in networks(axes, model) {
                let settings = axes.refine_steps.iter().map(|&steps| Setting {
                    background,
                    network: Some(network.clone()),
                    refiner: Refiner::Learned { steps },
                });
                let new = settings.map(|setting| Run { network: Some(index), settings: vec![setting] });
                push_new(&mut runs, new);
            }
        }
        let mut marks = axes.adam.clone();
        marks.sort_unstable();
        marks.dedup();
        if marks.is_empty() {
            continue;
        }
        let reference = axes.adam_views.iter().map(|&views| {
            let of = |&steps: &usize| Setting { background, network: None, refiner: Refiner::Adam { steps, views } };
            Run { network: None, settings: marks.iter().map(of).collect() }
        });
        push_new(&mut runs, reference);
    }
    runs
}

fn push_new(runs: &mut Vec<Run>, new: impl Iterator<Item = Run>) {
    for run in new {
        if !runs.contains(&run) {
            runs.push(run);
        }
    }
}

/// The ways to use a model that differ.
fn networks(axes: &Axes, model: &Parts) -> Vec<Network> {
    let mut found: Vec<Network> = Vec::new();
    for &query in &axes.query {
        for &density in &axes.density {
            for &theta in &axes.theta {
                for &max_gaussians in &axes.max_gaussians {
                    let acts = model.policy && density != DensityBy::Off;
                    let network = Network {
                        weights: model.weights.clone(),
                        query: if model.query { query } else { Switch::Off },
                        density: if acts { density } else { DensityBy::Off },
                        theta: if acts { theta } else { THETA },
                        max_gaussians: max_gaussians.filter(|_| acts),
                    };
                    if !found.contains(&network) {
                        found.push(network);
                    }
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes() -> Axes {
        Axes {
            background: vec![Background::Auto, Background::Off],
            refine_steps: vec![0, 3],
            query: vec![Switch::On, Switch::Off],
            density: vec![DensityBy::Policy, DensityBy::Off],
            theta: vec![0.5, 0.7],
            max_gaussians: vec![None, Some(100)],
            adam: vec![30, 10, 10],
            adam_views: vec![None],
        }
    }

    fn model(query: bool, policy: bool) -> Parts {
        Parts { weights: Weights { name: "w".to_owned(), sha256: "00".to_owned() }, query, policy }
    }

    #[test]
    fn what_a_model_lacks_is_not_told_apart() {
        let learned = |model| runs(&axes(), &[model]).iter().filter(|run| run.network.is_some()).count();
        // Of the policy's four ways and the one without it.
        assert_eq!(learned(model(true, true)), 2 * 2 * 2 * (4 + 1));
        assert_eq!(learned(model(true, false)), 2 * 2 * 2);
        assert_eq!(learned(model(false, false)), 2 * 2);
    }

    #[test]
    fn the_reference_is_one_run_for_all_of_its_marks() {
        let all = runs(&axes(), &[]);
        assert_eq!(all.len(), 2);
        assert_eq!(all[0].settings.iter().map(Setting::steps).collect::<Vec<_>>(), [10, 30]);
        assert!(runs(&Axes { adam: Vec::new(), ..axes() }, &[]).is_empty());
    }
}
