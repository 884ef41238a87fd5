//! Means over images, over snippets and over logs: which of them a protocol means matters where figures are not defined everywhere, or logs
//! have different numbers of snippets.

use serde::Serialize;

use super::{
    figures::{Figures, kinds},
    record::{RunRecord, SnippetRecord, ViewRecord},
};

/// The means of a recipe.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Averages {
    /// Every image weighs alike: what tables show.
    pub image: Figures,
    /// Every snippet weighs alike: means of the means over its images.
    pub snippet: Figures,
    /// Every log weighs alike: means of the means over its snippets.
    pub log: Figures,
    /// In how many images each figure is defined.
    pub images: std::collections::BTreeMap<&'static str, usize>,
}

/// The means of the recipe of a number over snippets.
pub fn averages(records: &[&SnippetRecord], recipe: usize) -> Averages {
    let of_recipe = |record: &SnippetRecord| record.runs.get(recipe).map(|run| (record.log.clone(), run.clone()));
    let runs: Vec<(String, RunRecord)> = records.iter().filter_map(|record| of_recipe(record)).collect();
    let views: Vec<&ViewRecord> = runs.iter().flat_map(|(_, run)| &run.views).collect();
    let snippets: Vec<(&str, Figures)> = runs.iter().map(|(log, run)| (log.as_str(), run.mean())).collect();
    let mut names: Vec<&str> = Vec::new();
    for (log, _) in &snippets {
        if !names.contains(log) {
            names.push(log);
        }
    }
    let of_log = |name: &&str| {
        let own = snippets.iter().filter(move |(log, _)| log == name).map(|(_, figures)| figures);
        Figures::mean(own)
    };
    let logs: Vec<Figures> = names.iter().map(of_log).collect();
    let defined = |key: &str| views.iter().filter(|view| view.figures.get(key).is_some()).count();
    Averages {
        image: Figures::mean(views.iter().map(|view| &view.figures)),
        snippet: Figures::mean(snippets.iter().map(|(_, figures)| figures)),
        log: Figures::mean(logs.iter()),
        images: kinds().iter().map(|kind| (kind.key, defined(kind.key))).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::samples::snippet;

    #[test]
    fn images_snippets_and_logs_weigh_alike_each_in_their_own_mean() {
        let all = [
            snippet("a", &[20.0, 24.0], &[10.0]),
            snippet("a", &[30.0], &[]),
            snippet("b", &[40.0, 40.0, 40.0], &[16.0, 18.0, 20.0]),
        ];
        let found = averages(&all.iter().collect::<Vec<_>>(), 0);
        let psnr = |figures: &Figures| figures.get("psnr");
        assert_eq!(psnr(&found.image), Some(194.0 / 6.0));
        assert_eq!(psnr(&found.snippet), Some((22.0 + 30.0 + 40.0) / 3.0));
        assert_eq!(psnr(&found.log), Some((26.0 + 40.0) / 2.0));
        let dynamic = [&found.image, &found.snippet, &found.log].map(|figures| figures.get("psnr_dynamic"));
        assert_eq!(dynamic, [Some(16.0), Some(14.0), Some(14.0)], "snippets without what moves do not count");
        assert_eq!((found.images["psnr"], found.images["psnr_dynamic"], found.images["lpips"]), (6, 4, 0));
        assert_eq!(averages(&all.iter().collect::<Vec<_>>(), 1).image, Figures::default());
    }
}
