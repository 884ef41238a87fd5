//! The pages that show what was found: for people, for programs, and for `lgs-infer`.

use std::path::Path;

use lgs_engine::{gaussians::motion::Motion, recipe::flags, words::Words};
use lgs_formats::write::write_atomic;
use serde::Serialize;

use super::{
    budget::{BudgetRow, budget_rows},
    case::Work,
    csv::{Table, points},
    presets::presets,
    record::{Failed, PointRecord, SweepRecord},
    report::{Chapter, Page, html},
    setting::{Setting, Weights},
    table::{PointRow, mean_rows, rows},
};
use crate::{clips::Choice, error::Result, machine::Machine, records::json};

/// The value of `format` in `sweep.json`.
pub const FORMAT: &str = "lgs-sweep/1";

/// `sweep.json`.
#[derive(Serialize)]
struct Whole<'a> {
    format: &'static str,
    machine: &'a Machine,
    weights: Vec<&'a Weights>,
    lpips: Option<&'a str>,
    seed: u64,
    clips: Vec<OfClip<'a>>,
    mean: &'a [PointRow],
    failed: &'a [Failed],
}

/// A clip in `sweep.json`.
#[derive(Serialize)]
struct OfClip<'a> {
    clip: &'a str,
    source: &'a str,
    work: &'a Work,
    load_s: Option<f64>,
    rows: &'a [PointRow],
    budgets: &'a [BudgetRow],
    points: Vec<&'a PointRecord>,
}

/// What the pages say of a clip.
#[derive(Clone, Debug)]
pub struct ClipTable {
    /// Its name.
    pub clip: String,
    /// The configurations.
    pub rows: Vec<PointRow>,
    /// Time budgets.
    pub budgets: Vec<BudgetRow>,
}

/// What the pages say beside what was found.
#[derive(Clone, Copy, Debug)]
pub struct Pages<'a> {
    /// The clips.
    pub clips: &'a [Choice],
    /// Every configuration once, in the order of the grid.
    pub settings: &'a [Setting],
    /// Time budgets that were run.
    pub budgets: &'a [f64],
    /// Of each network, its weights as the user names them.
    pub weights: &'a [(Weights, String)],
    /// SHA-256 of the weights of LPIPS; `None` where it is not measured.
    pub lpips: Option<&'a str>,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// What measured.
    pub machine: &'a Machine,
    /// Directory of the results.
    pub out: &'a Path,
}

impl Pages<'_> {
    /// Writes the pages of what was found so far; the rows of each clip.
    ///
    /// # Errors
    /// A file that cannot be written, or a crop that cannot be read.
    pub fn write(&self, records: &[SweepRecord], failed: &[Failed]) -> Result<Vec<ClipTable>> {
        let settings = self.settings;
        let tables: Vec<Vec<PointRow>> = records.iter().map(|record| rows(record, settings)).collect();
        let budgets: Vec<Vec<BudgetRow>> = records.iter().map(|record| budget_rows(record, self.budgets)).collect();
        let mean = if tables.len() > 1 { mean_rows(&tables) } else { Vec::new() };
        let commands: Vec<Vec<String>> = tables
            .iter()
            .zip(self.clips)
            .map(|(rows, choice)| rows.iter().map(|row| self.command(choice, &row.setting)).collect())
            .collect();
        let named = records.iter().zip(&tables).zip(&commands);
        let lines: Vec<Table<'_>> =
            named.map(|((record, rows), commands)| Table { clip: &record.clip, rows, commands }).collect();
        let put = |name: &str, text: &str| write_atomic(&self.out.join(name), text.as_bytes());
        put("points.csv", &points(&lines))?;
        let whole = Whole {
            format: FORMAT,
            machine: self.machine,
            weights: self.weights.iter().map(|(weights, _)| weights).collect(),
            lpips: self.lpips,
            seed: self.seed,
            clips: records
                .iter()
                .zip(tables.iter().zip(&budgets))
                .map(|(record, (rows, budgets))| of_clip(record, rows, budgets, settings))
                .collect(),
            mean: &mean,
            failed,
        };
        put("sweep.json", &json("sweep.json", &whole)?)?;
        let named = records.iter().zip(&tables).zip(commands.iter().zip(&budgets));
        let chapters: Vec<Chapter<'_>> =
            named.map(|((record, rows), (commands, budgets))| Chapter { record, rows, commands, budgets }).collect();
        let page = Page { machine: self.machine, chapters: &chapters, mean: &mean, out: self.out, failed };
        put("report.html", &html(&page)?)?;
        let weights = self.weights.first().map(|(weights, _)| weights);
        let all = records.len() == self.clips.len();
        let summary = if tables.len() > 1 { Some(&mean) } else { tables.first() };
        if let Some(record) = summary.filter(|_| all).and_then(|rows| presets(records, rows, weights, self.machine)) {
            put("presets.json", &json("presets.json", &record)?)?;
        }
        let of_clips = records.iter().zip(tables).zip(budgets);
        Ok(of_clips.map(|((record, rows), budgets)| ClipTable { clip: record.clip.clone(), rows, budgets }).collect())
    }

    /// The command that runs a configuration on a clip.
    fn command(&self, choice: &Choice, setting: &Setting) -> String {
        let mut words = vec!["lgs-infer".to_owned(), choice.dir.display().to_string()];
        let named = setting.weights.as_ref().and_then(|own| self.weights.iter().find(|(weights, _)| weights == own));
        let mut options = vec![("weights", named.map_or("none", |(_, text)| text).to_owned())];
        options.extend(setting.recipe.options());
        options.extend(clip_options(choice));
        options.extend((self.seed != 0).then(|| ("seed", self.seed.to_string())));
        words.extend(flags(options));
        words.join(" ")
    }
}

/// The options of `lgs-infer` that read a clip as `choice` says, but for its directory.
pub fn clip_options(choice: &Choice) -> Vec<(&'static str, String)> {
    let given = [
        ("hold-out", Some(choice.hold_out.to_string())),
        ("cameras", choice.cameras.as_ref().map(|cameras| cameras.join(","))),
        ("image-size", choice.image_size.map(|size| size.to_string())),
        ("frames", choice.num_frames.map(|count| format!("0..{}", count.saturating_sub(1)))),
        ("motion", (choice.motion != Motion::default()).then(|| choice.motion.word().to_owned())),
    ];
    given.into_iter().filter_map(|(name, value)| Some((name, value?))).collect()
}

fn of_clip<'a>(
    record: &'a SweepRecord,
    rows: &'a [PointRow],
    budgets: &'a [BudgetRow],
    settings: &[Setting],
) -> OfClip<'a> {
    OfClip {
        clip: &record.clip,
        source: &record.key.source,
        work: &record.work,
        load_s: record.load_s,
        rows,
        budgets,
        points: settings.iter().filter_map(|setting| record.point(setting)).collect(),
    }
}
