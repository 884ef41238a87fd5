//! Whether time budgets are kept, and well spent: beside the points that were measured.

use serde::Serialize;

use super::{
    budget_run::BudgetRun,
    record::{PointRecord, SweepRecord},
};
use crate::statistics::Quartiles;

/// A run that ends after more than so many times its budget has not kept it.
const KEPT: f64 = 1.15;

/// What came of a budget.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BudgetRow {
    /// The budget, seconds.
    pub budget_s: f64,
    /// Runs.
    pub runs: usize,
    /// Seconds until the scene was finished.
    pub finished_s: Quartiles,
    /// Whether the median kept the budget.
    pub kept: bool,
    /// Whether the program knew something that fits, in most runs.
    pub fits: bool,
    /// Flags of what ran when it took the median.
    pub flags: String,
    /// PSNR over the held-out views, the median, dB.
    pub psnr: Option<f64>,
    /// The best measured point that would have kept the budget; `None` where none would.
    pub best: Option<Rival>,
}

/// A measured point beside a budget.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rival {
    /// Its name.
    pub name: String,
    /// Seconds until its scene would be finished.
    pub finished_s: f64,
    /// Its PSNR, dB.
    pub psnr: f64,
}

/// What came of each of `budgets` on a clip, where it was run.
pub fn budget_rows(record: &SweepRecord, budgets: &[f64]) -> Vec<BudgetRow> {
    budgets.iter().filter_map(|&budget_s| budget_row(record, budget_s)).collect()
}

fn budget_row(record: &SweepRecord, budget_s: f64) -> Option<BudgetRow> {
    let rival = |point: &PointRecord| {
        let finished_s = Quartiles::of(point.repeats.iter().map(|repeat| repeat.cost.seconds))?.median;
        Some(Rival { name: point.setting.name(), finished_s, psnr: point.accuracy.figures.psnr? })
    };
    let rivals: Vec<Rival> = record.points.iter().filter_map(rival).collect();
    of_runs(record.runs_of_budget(budget_s).collect(), &rivals, budget_s)
}

/// What came of a budget; `rivals` are finished so long after their reconstruction began. `None` without a run.
fn of_runs(mut runs: Vec<&BudgetRun>, rivals: &[Rival], budget_s: f64) -> Option<BudgetRow> {
    runs.sort_by(|a, b| a.finished_s.total_cmp(&b.finished_s));
    let finished_s = Quartiles::of(runs.iter().map(|run| run.finished_s))?;
    let before_s = Quartiles::of(runs.iter().map(|run| run.before_s))?.median;
    let rivals = rivals.iter().map(|rival| Rival { finished_s: before_s + rival.finished_s, ..rival.clone() });
    Some(BudgetRow {
        budget_s,
        runs: runs.len(),
        finished_s,
        kept: finished_s.median <= KEPT * budget_s,
        fits: 2 * runs.iter().filter(|run| run.fits).count() > runs.len(),
        flags: runs[runs.len() / 2].recipe.flags(),
        psnr: Quartiles::of(runs.iter().filter_map(|run| run.psnr)).map(|spread| spread.median),
        best: rivals.filter(|rival| rival.finished_s <= budget_s).max_by(|a, b| a.psnr.total_cmp(&b.psnr)),
    })
}

#[cfg(test)]
mod tests {
    use lgs_engine::recipe::Recipe;

    use super::*;

    fn run(finished_s: f64, psnr: f64, adam_passes: usize) -> BudgetRun {
        let recipe = Recipe { adam_passes, ..Recipe::default() };
        BudgetRun { budget_s: 2.0, finished_s, before_s: 0.5, fits: true, recipe, psnr: Some(psnr) }
    }

    #[test]
    fn the_median_run_stands_for_a_budget() {
        let runs = [run(1.5, 20.0, 1), run(2.35, 22.0, 3), run(2.2, 21.0, 2)];
        let row = of_runs(runs.iter().collect(), &[], 2.0).unwrap();
        assert!(row.kept && row.fits && row.flags.contains("adam:2"), "{row:?}");
        assert_eq!((row.runs, row.finished_s.median, row.psnr, row.best.is_none()), (3, 2.2, Some(21.0), true));
        assert!(!of_runs(vec![&run(2.31, 20.0, 1)], &[], 2.0).unwrap().kept);
        assert!(of_runs(Vec::new(), &[], 2.0).is_none());
    }

    #[test]
    fn the_best_rival_is_one_that_would_have_been_finished() {
        let rival = |seconds, psnr| Rival { name: String::new(), finished_s: seconds, psnr };
        let rivals = [rival(0.4, 19.0), rival(1.5, 22.0), rival(1.51, 23.0)];
        let row = of_runs(vec![&run(1.9, 21.0, 1)], &rivals, 2.0).unwrap();
        assert_eq!(row.best, Some(rival(2.0, 22.0)));
    }
}
