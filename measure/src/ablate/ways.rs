//! The ways to use the network that are compared.

use lgs_engine::densify::{Density, Limit, Thresholds};

/// Names of the ways to use the network.
pub mod names {
    use lgs_engine::densify::Limit;

    /// As the system is used.
    pub const MAIN: &str = "main";
    /// Without the query.
    pub const QUERY_OFF: &str = "query off";
    /// Without the policy.
    pub const POLICY_OFF: &str = "policy off";
    /// Without both.
    pub const NEITHER: &str = "query and policy off";
    /// Chance decides, at the rates of the policy.
    pub const RANDOM: &str = "random";

    /// Both thresholds at this score.
    pub fn threshold(theta: f32) -> String {
        format!("theta {theta}")
    }

    /// As many primitives as with both thresholds at this score, but chosen by rank.
    pub fn as_many(theta: f32) -> String {
        format!("as many as with theta {theta}, by rank")
    }

    /// At most so many primitives, chosen by the policy's rank.
    pub fn limited(limit: Limit) -> String {
        format!("at most {limit}, by rank")
    }

    /// At most so many primitives, chosen by chance.
    pub fn limited_by_chance(limit: Limit) -> String {
        format!("at most {limit}, by chance")
    }
}

/// Thresholds that leave everything to the rank.
pub(super) const ANY: Thresholds = Thresholds { prune: 1.0, add: 0.0 };

/// A way to use the network.
#[derive(Clone, Copy, Debug)]
pub(super) struct Way {
    pub(super) query: bool,
    pub(super) density: Density,
    pub(super) thresholds: Thresholds,
    pub(super) limit: Option<Limit>,
}

/// The other ways to use the network.
pub(super) fn ways(main: Way, without_policy: bool, limits: &[Limit]) -> Vec<(String, Way)> {
    let mut ways = vec![(names::QUERY_OFF.to_owned(), Way { query: false, ..main })];
    if without_policy {
        return ways;
    }
    ways.push((names::POLICY_OFF.to_owned(), Way { density: Density::Off, ..main }));
    ways.push((names::NEITHER.to_owned(), Way { query: false, density: Density::Off, ..main }));
    ways.push((names::RANDOM.to_owned(), Way { density: Density::Random, ..main }));
    for &limit in limits {
        let limited = Way { thresholds: ANY, limit: Some(limit), ..main };
        ways.push((names::limited(limit), limited));
        ways.push((names::limited_by_chance(limit), Way { density: Density::Random, ..limited }));
    }
    ways
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_policy_only_the_query_is_left_to_switch() {
        let main = Way { query: true, density: Density::Policy, thresholds: Thresholds::default(), limit: None };
        let limits = [Limit::Percent(60)];
        let names_of = |without| ways(main, without, &limits).into_iter().map(|(name, _)| name).collect::<Vec<_>>();
        assert_eq!(names_of(true), [names::QUERY_OFF]);
        assert_eq!(names_of(false).len(), 6);
        assert_eq!(names_of(false)[4..], ["at most 60%, by rank", "at most 60%, by chance"]);
    }
}
