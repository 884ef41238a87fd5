//! What an evaluation found: the records of its snippets, what decided them, and what failed.

use lgs_formats::jobs::FailedItem;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{
    averages::{Averages, averages},
    drives::TEST_LOGS,
    protocol::Name,
    record::SnippetRecord,
    times::SnippetTimes,
};

/// Name of the format of what decides the figures.
pub const KEY_FORMAT: &str = "lgs-evaluation/1";

/// What decides the figures beside the snippets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// [`KEY_FORMAT`].
    pub format: String,
    /// The protocol.
    pub protocol: Value,
    /// The recipes.
    pub recipes: Vec<RecordedRecipe>,
    /// SHA-256 of the weights; `None` without a network.
    pub weights: Option<String>,
    /// SHA-256 of the weights of LPIPS; `None` where it is not measured.
    pub lpips_weights: Option<String>,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// Whether scenes are kept.
    pub scenes: bool,
    /// Whether pages are kept that show them.
    pub viewer: bool,
}

/// A recipe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedRecipe {
    /// Its name.
    pub name: String,
    /// Every option that says anything.
    pub options: Map<String, Value>,
}

/// A snippet that was evaluated.
#[derive(Clone, Debug)]
pub struct Found {
    /// Its name.
    pub item: String,
    /// Its figures.
    pub record: SnippetRecord,
    /// What it took; `None` where that is not known.
    pub times: Option<SnippetTimes>,
}

/// Everything that was found.
#[derive(Clone, Debug)]
pub struct Findings {
    /// What decided it.
    pub key: Key,
    /// The snippets, in their order.
    pub snippets: Vec<Found>,
    /// What failed.
    pub failed: Vec<FailedItem>,
}

impl Findings {
    /// The protocol.
    pub fn protocol(&self) -> Name {
        let word = self.key.protocol["name"].as_str().unwrap_or_default();
        [Name::Waymo, Name::PandaSet].into_iter().find(|name| name.word() == word).unwrap_or(Name::Own)
    }

    /// How drives were cut, for people.
    pub fn cutting(&self) -> &str {
        self.key.protocol["in_words"].as_str().unwrap_or_default()
    }

    /// The names of the logs, in their order.
    pub fn logs(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.snippets.iter().map(|found| found.record.log.as_str()).collect();
        names.dedup();
        names
    }

    /// The means of a recipe over all snippets, or over those of a log.
    pub fn averages(&self, recipe: usize, log: Option<&str>) -> Averages {
        let wanted = |found: &&Found| log.is_none_or(|log| log == found.record.log);
        averages(&self.snippets.iter().filter(wanted).map(|found| &found.record).collect::<Vec<_>>(), recipe)
    }

    /// Mean seconds from loaded inputs to a scene, over the snippets of which that is known.
    pub fn seconds(&self, recipe: usize) -> Option<f64> {
        let known =
            self.snippets.iter().filter_map(|found| found.times.as_ref()?.reconstruction_s.get(recipe).copied());
        let known: Vec<f64> = known.collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    }

    /// Number of images that were measured.
    pub fn num_images(&self) -> usize {
        self.snippets.iter().filter_map(|found| found.record.runs.first()).map(|run| run.views.len()).sum()
    }

    /// Whether the figures are of the data of the paper's table: the ten test logs of `PandaSet`, whole. Which scenes of Waymo the paper took it
    /// does not say.
    pub fn is_of_the_papers_data(&self) -> bool {
        let number =
            |name: &str| name.rsplit(|c: char| !c.is_ascii_digit()).next().and_then(|digits| digits.parse().ok());
        let mut found: Vec<u64> = self.logs().into_iter().filter_map(number).collect();
        found.sort_unstable();
        let whole = self.failed.is_empty() && self.snippets.len() == 4 * TEST_LOGS.len();
        self.protocol() == Name::PandaSet && whole && found == TEST_LOGS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{
        protocol::Protocol,
        samples::{findings, snippet},
    };

    /// The ten test logs with four snippets each.
    fn logs() -> Vec<SnippetRecord> {
        TEST_LOGS.iter().flat_map(|log| (0..4).map(move |_| snippet(&format!("{log:03}"), &[20.0], &[]))).collect()
    }

    #[test]
    fn figures_are_of_the_papers_data_for_the_ten_whole_logs_alone() {
        let is_papers = |records: Vec<SnippetRecord>| findings(&Protocol::pandaset(), records).is_of_the_papers_data();
        assert!(is_papers(logs()));
        assert!(!is_papers(logs().split_off(1)), "a snippet is missing");
        let mut other = logs();
        other.iter_mut().filter(|record| record.log == "001").for_each(|record| record.log = "002".to_owned());
        assert!(!is_papers(other), "another log");
        assert!(!findings(&Protocol::waymo(), logs()).is_of_the_papers_data());
        let mut failed = findings(&Protocol::pandaset(), logs());
        failed.failed.push(FailedItem { item: "001-00000".to_owned(), reason: "why".to_owned() });
        assert!(!failed.is_of_the_papers_data());
    }

    #[test]
    fn seconds_are_means_over_the_snippets_of_which_they_are_known() {
        let mut found = findings(&Protocol::pandaset(), vec![snippet("a", &[20.0], &[]); 3]);
        assert_eq!(found.seconds(0), Some(2.0));
        found.snippets[2].times = None;
        assert_eq!((found.seconds(0), found.seconds(1)), (Some(1.5), None));
    }
}
