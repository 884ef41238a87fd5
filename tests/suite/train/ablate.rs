//! The ablation on small clips and a small model: what `lgs-infer` finds, and what is measured once only.

use std::cell::RefCell;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use lgs_engine::densify::Limit;
use lgs_engine::network::source::{LoadedModel, load_model};
use lgs_measure::ablate::job::{AblationJob, Hashed, Observer};
use lgs_measure::ablate::record::AblationRecord;
use lgs_measure::ablate::settings::Settings;
use lgs_measure::ablate::ways::names;
use lgs_measure::clips::Choice;
use lgs_tests::process::{binary, run};
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case, clips, metrics};
use lgs_train::ship::{CardSource, card, weights};
use lgs_train::stages::weights::Precision;
use libtest_mimic::{Failed, Trial};

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("train::ablate::figures_are_those_of_inference", figures_are_those_of_inference),
        case("train::ablate::what_was_measured_is_kept", what_was_measured_is_kept),
        case("train::ablate::a_trained_policy_is_compared_with_chance", trained_policy),
        case("train::ship::a_card_is_of_the_weights_that_were_measured", ship),
    ]
}

fn failed(error: impl std::fmt::Display) -> Failed {
    error.to_string().into()
}

/// A folder with weights whose heads are not zero.
struct Place {
    dir: tempfile::TempDir,
    loaded: LoadedModel,
}

#[derive(Default)]
struct Notes(RefCell<Vec<bool>>);

impl Observer for Notes {
    fn begin(&self, _: &Path, there: bool) {
        self.0.borrow_mut().push(there);
    }

    fn step(&self, _: u64) {}

    fn end(&self, _: &AblationRecord, _: u64) {}
}

impl Place {
    fn new(heads: Heads) -> Result<Self, Failed> {
        let dir = tempfile::tempdir()?;
        let file = dir.path().join("w.safetensors");
        Weights::seeded(SMALL, 2, heads)?.write(&file)?;
        Ok(Self { loaded: load_model(&file).map_err(failed)?, dir })
    }

    fn weights(&self) -> PathBuf {
        self.dir.path().join("w.safetensors")
    }

    fn job(&self, adam: &[usize]) -> Result<AblationJob<'_>, Failed> {
        let text = format!("{};hold-out=1;frames=3;image-size=48x80", clips::street().display());
        let choice: Choice = text.parse().map_err(failed)?;
        Ok(AblationJob {
            scenes: vec![choice.clone()],
            clips: vec![choice],
            model: Hashed { value: &self.loaded.model, sha256: &self.loaded.digest },
            lpips: None,
            settings: Settings {
                refine_steps: 3,
                adam: adam.to_vec(),
                adam_from_start: false,
                adam_views: None,
                thresholds: vec![0.5],
                limits: vec![Limit::Percent(60)],
                seed: 0,
            },
            short: None,
            out: self.dir.path().join("ablation"),
        })
    }

    /// The record of the clip that stands for itself.
    fn record(&self) -> Result<AblationRecord, Failed> {
        let mut files: Vec<PathBuf> = fs::read_dir(self.dir.path().join("ablation/clips"))?
            .map(|e| e.map(|e| e.path()))
            .collect::<Result<_, _>>()?;
        files.sort();
        let first = files.first().ok_or("no record")?;
        serde_json::from_str(&fs::read_to_string(first)?).map_err(failed)
    }

    /// PSNR of the held-out views as `lgs-infer` says, by the policy unless the flags say otherwise.
    fn inferred(&self, flags: &[&str]) -> Result<f64, Failed> {
        let by_policy: &[&str] = if flags.contains(&"--density") { &[] } else { &["--density", "policy"] };
        let (street, weights) = (clips::street(), self.weights());
        let mut arguments = vec![street.as_os_str(), OsStr::new("--weights"), weights.as_os_str()];
        let common =
            ["--out", "out", "--image-size", "48x80", "--frames", "0..2", "--hold-out", "1", "--views", "held-out"];
        arguments.extend(common.iter().chain(by_policy).chain(flags).map(|flag| OsStr::new(*flag)));
        run(&binary("lgs-infer")?, &arguments, self.dir.path())?.expect_success()?;
        Ok(metrics::number(&metrics::read(&self.dir.path().join("out"))?, &["mean", "held_out", "psnr"])?)
    }
}

const UNTRAINED_POLICY: Heads = Heads { residuals: 1e-4, scores: 0.0 };

fn same(what: &str, got: Option<f64>, want: f64) -> Outcome {
    if got == Some(want) { Ok(()) } else { Err(format!("{what}: got {got:?}, lgs-infer says {want}").into()) }
}

fn figures_are_those_of_inference() -> Outcome {
    let place = Place::new(UNTRAINED_POLICY)?;
    let page = place.job(&[1, 2])?.run(&Notes::default()).map_err(failed)?;
    let record = place.record()?;
    same("3 steps", record.learned_at(3).and_then(|p| p.figures.psnr), place.inferred(&[])?)?;
    same("no step", record.learned_at(0).and_then(|p| p.figures.psnr), place.inferred(&["--refine-steps", "0"])?)?;
    let adam = AblationRecord::at(&record.adam, 2).and_then(|p| p.figures.psnr);
    same("2 of Adam", adam, place.inferred(&["--refine-with", "adam:2"])?)?;
    let off = record.variant(names::QUERY_OFF).and_then(|v| v.figures.psnr);
    same("query off", off, place.inferred(&["--query", "off"])?)?;
    if record.policy_skipped.is_none() || !page.contains("every score is 1/2") {
        return Err("nobody says that the policy is untrained".into());
    }
    if record.velocity.is_none_or(|[_, refined]| refined.moving == 0 || refined.resting == 0) {
        return Err(format!("velocities {:?}", record.velocity).into());
    }
    let lines = fs::read_to_string(place.dir.path().join("ablation/ablation.csv"))?.lines().count();
    let curve = place.dir.path().join("ablation/curve.svg").is_file();
    // A head, and for each of two clips: the start, the learned steps, 0 to 2 of Adam, two ways.
    let want = 1 + 2 * (1 + record.learned.len() + 3 + 2);
    if lines == want && curve { Ok(()) } else { Err(format!("{lines} lines, want {want}; curve {curve}").into()) }
}

fn what_was_measured_is_kept() -> Outcome {
    let place = Place::new(UNTRAINED_POLICY)?;
    let mut seen = Vec::new();
    for adam in [[1], [1], [2]] {
        let notes = Notes::default();
        place.job(&adam)?.run(&notes).map_err(failed)?;
        seen.push(notes.0.into_inner());
    }
    let want = vec![vec![false; 2], vec![true; 2], vec![false; 2]];
    if seen == want { Ok(()) } else { Err(format!("measured already: {seen:?}, want {want:?}").into()) }
}

fn trained_policy() -> Outcome {
    let place = Place::new(Heads { residuals: 1e-4, scores: 2.0 })?;
    place.job(&[])?.run(&Notes::default()).map_err(failed)?;
    let record = place.record()?;
    let counts = |name: &str| record.variant(name).map(|v| [v.pruned, v.added]);
    let (main, random) = (counts(names::MAIN), counts(names::RANDOM));
    if record.policy_skipped.is_some() || main == Some([0, 0]) || main != random {
        return Err(format!("{:?}: {main:?} and at random {random:?}", record.policy_skipped).into());
    }
    same(
        "random",
        record.variant(names::RANDOM).and_then(|v| v.figures.psnr),
        place.inferred(&["--density", "random"])?,
    )?;
    let theta = place.inferred(&["--density", "policy", "--theta-prune", "0.5", "--theta-add", "0.5"])?;
    same("theta 0.5", record.variant("theta 0.5").and_then(|v| v.figures.psnr), theta)?;
    let net = |name: &str| counts(name).map(|[pruned, added]| added as i64 - pruned as i64);
    let as_many = names::as_many(0.5);
    if net("theta 0.5").is_none_or(|change| change == 0) || net("theta 0.5") != net(&as_many) {
        return Err(format!("theta 0.5: {:?}, by rank {:?}", counts("theta 0.5"), counts(&as_many)).into());
    }
    let limit = Limit::Percent(60);
    let (ranked, by_chance) = (names::limited(limit), names::limited_by_chance(limit));
    if counts(&ranked) != counts(&by_chance) || counts(&ranked).is_none_or(|[pruned, _]| pruned == 0) {
        return Err(format!("{limit}: {:?}, by chance {:?}", counts(&ranked), counts(&by_chance)).into());
    }
    let flags = ["--density", "policy", "--theta-prune", "1", "--theta-add", "0", "--max-gaussians", "60%"];
    same(&ranked, record.variant(&ranked).and_then(|v| v.figures.psnr), place.inferred(&flags)?)
}

fn ship() -> Outcome {
    let place = Place::new(UNTRAINED_POLICY)?;
    place.job(&[])?.run(&Notes::default()).map_err(failed)?;
    let (ablation, notes) = (place.dir.path().join("ablation"), place.dir.path().join("notes.md"));
    fs::write(&notes, "## Data\n\nNone.\n")?;
    let same = weights(&place.weights(), Precision::Full, place.dir.path()).map_err(failed)?;
    let written =
        card(CardSource { weights: &same, ablation: &ablation, notes: &notes }, place.dir.path()).map_err(failed)?;
    let text = fs::read_to_string(written)?;
    for wanted in [&place.loaded.digest, "## Data", "## Scores", "## Tensors", "F32", "MIT OR Apache-2.0"] {
        if !text.contains(wanted) {
            return Err(format!("the card lacks {wanted}: {text}").into());
        }
    }
    let half = weights(&same, Precision::Half, place.dir.path()).map_err(failed)?;
    load_model(&half).map_err(failed)?;
    match card(CardSource { weights: &half, ablation: &ablation, notes: &notes }, place.dir.path()) {
        Err(error) if error.to_string().contains("ablation.json") => Ok(()),
        other => Err(format!("an ablation of other weights: {other:?}").into()),
    }
}
