//! `lgs-infer --density`: pruning, adding, budgets and the map of scores, with a policy whose scores spread.

use std::fs;
use std::path::PathBuf;

use lgs_formats::cloud::SplatCloud;
use lgs_formats::ply::read_ply;
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case, clips, metrics};
use libtest_mimic::{Failed, Trial};
use serde_json::Value;

use super::infer::{files, same_results};

const HEADS: Heads = Heads { residuals: 0.0, scores: 1.5 };

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("cli::densify::policy_prunes_and_adds_by_strict_thresholds", policy),
        case("cli::densify::thresholds_at_their_ends", ends),
        case("cli::densify::random_at_matched_rates", random),
        case("cli::densify::off_leaves_the_set_alone", off),
        case("cli::densify::budget_is_met", budget),
        case("cli::densify::a_budget_that_nobody_can_meet_is_refused", refused),
        case("cli::densify::scores_are_drawn_in_input_views", pictures),
        case("cli::densify::same_bytes_for_any_number_of_threads", threads),
    ]
}

/// A folder with a weights file, to run in.
struct Place(tempfile::TempDir);

/// A run: counts, scene, page.
struct Run {
    page: Value,
    scene: SplatCloud,
    out: PathBuf,
}

impl Place {
    fn new() -> Result<Self, Failed> {
        let place = tempfile::tempdir()?;
        Weights::seeded(SMALL, 2, HEADS)?.write(&place.path().join("w.safetensors"))?;
        Ok(Self(place))
    }

    fn finish(&self, out: &str, flags: &[&str]) -> Result<Finished, Failed> {
        let street = clips::street();
        let mut arguments = vec![street.as_os_str(), "--out".as_ref(), out.as_ref()];
        let common = ["--frames", "0..2", "--hold-out", "1", "--image-size", "48x80"];
        arguments.extend(common.iter().chain(flags).map(|flag| flag.as_ref() as &std::ffi::OsStr));
        for [flag, usual] in [["--weights", "w.safetensors"], ["--refine-steps", "0"]] {
            if !flags.contains(&flag) {
                arguments.extend([flag, usual].map(|word| word.as_ref() as &std::ffi::OsStr));
            }
        }
        Ok(run(&binary("lgs-infer")?, &arguments, self.0.path())?)
    }

    fn run(&self, out: &str, flags: &[&str]) -> Result<Run, Failed> {
        self.finish(out, flags)?.expect_success()?;
        let out = self.0.path().join(out);
        Ok(Run { page: metrics::read(&out)?, scene: read_ply(&out.join("scene.ply"))?, out })
    }
}

impl Run {
    fn count(&self, key: &str) -> Result<usize, Failed> {
        Ok(usize::try_from(self.page["gaussians"][key].as_u64().ok_or(format!("no count of {key}"))?)?)
    }

    /// Scores of the `LiDAR` branch, after checking that counts and columns belong together.
    fn scores(&self) -> Result<[&[f32]; 2], Failed> {
        let (last, background) = (self.count("final")?, self.count("background")?);
        let added_up = self.count("initial")? - self.count("pruned")? + self.count("added")?;
        let names: Vec<&str> = self.scene.extra.iter().map(|(name, _)| name.as_str()).collect();
        if last != added_up || self.scene.len() != last + background || names != ["p_prune", "p_add"] {
            return Err(
                format!("{}, {} in scene.ply, columns {names:?}", self.page["gaussians"], self.scene.len()).into()
            );
        }
        let sound = |column: &[f32]| {
            column[..last].iter().all(|s| (0.0..=1.0).contains(s)) && column[last..].iter().all(|&s| s == 0.0)
        };
        let [prune, add] = [&self.scene.extra[0].1, &self.scene.extra[1].1];
        if !sound(prune) || !sound(add) {
            return Err("scores outside 0..=1, or of the background".into());
        }
        Ok([&prune[..last], &add[..last]])
    }
}

fn expect(holds: bool, what: &str, run: &Run) -> Outcome {
    if holds {
        Ok(())
    } else {
        Err(format!("expected {what}, found {} {}", run.page["gaussians"], run.page["network"]).into())
    }
}

fn policy() -> Outcome {
    let place = Place::new()?;
    let found = place
        .run("policy", &["--density", "policy", "--theta-prune", "0.4", "--theta-add", "0.5", "--views", "none"])?;
    let (pruned, added) = (found.count("pruned")?, found.count("added")?);
    expect(pruned > 100 && added > 100, "some pruned and some added", &found)?;
    let [prune, add] = found.scores()?;
    let num_kept = prune.len() - added;
    let above: usize = add[..num_kept].iter().filter(|&&score| score > 0.5).count();
    let kept_are_below = prune.iter().all(|&score| score <= 0.4);
    let copies_are_above = add[num_kept..].iter().all(|&score| score > 0.5);
    expect(kept_are_below && copies_are_above && above == added, "the paper's rule", &found)?;
    // A copy has all of its original but the place, which is near.
    let originals: Vec<usize> = (0..num_kept).filter(|&i| add[i] > 0.5).collect();
    let near = |(copy, &i): (usize, &usize)| {
        let (a, b) = (found.scene.means[num_kept + copy], found.scene.means[i]);
        let far = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        far > 0.0 && far < 0.1 && found.scene.log_scales[num_kept + copy] == found.scene.log_scales[i]
    };
    expect(originals.iter().enumerate().all(near), "copies beside their originals", &found)
}

/// Scores lie inside 0..1 and the comparison is strict: 1 decides nothing, 0 everything.
fn ends() -> Outcome {
    let place = Place::new()?;
    let none =
        place.run("none", &["--density", "policy", "--theta-prune", "1", "--theta-add", "1", "--views", "none"])?;
    expect(none.count("pruned")? == 0 && none.count("added")? == 0, "no change", &none)?;
    let all =
        place.run("all", &["--density", "policy", "--theta-prune", "1", "--theta-add", "0", "--views", "none"])?;
    expect(all.count("added")? == all.count("initial")?, "a copy of each", &all)?;
    let empty = place.run("empty", &["--density", "policy", "--theta-prune", "0", "--theta-add", "0"])?;
    expect(empty.count("final")? == 0 && empty.count("added")? == 0, "nothing left of the LiDAR branch", &empty)?;
    expect(empty.scene.len() == empty.count("background")?, "the background", &empty)
}

fn random() -> Outcome {
    let place = Place::new()?;
    let flags = |density, seed| {
        ["--theta-prune", "0.4", "--theta-add", "0.5", "--views", "none", "--density", density, "--seed", seed]
    };
    let policy = place.run("policy", &flags("policy", "0"))?;
    let random = place.run("random", &flags("random", "0"))?;
    let again = place.run("again", &flags("random", "0"))?;
    let other = place.run("other", &flags("random", "1"))?;
    expect(random.page["gaussians"] == policy.page["gaussians"], "the counts of the policy", &random)?;
    random.scores()?;
    expect(random.scene == again.scene, "the same for a seed", &again)?;
    expect(random.scene != policy.scene && random.scene != other.scene, "another choice than by scores or seed", &other)
}

fn off() -> Outcome {
    let place = Place::new()?;
    let off = place.run("off", &["--density", "off"])?;
    expect(
        off.count("pruned")? + off.count("added")? == 0 && off.scene.extra.is_empty(),
        "no change, no scores",
        &off,
    )?;
    expect(
        off.page["network"]["set_update_skipped"] == "off" && off.page["stages_s"]["policy"] == 0.0,
        "no policy",
        &off,
    )?;
    let drawn = files(&off.out)?.iter().any(|name| name.to_string_lossy().contains("_prune"));
    expect(!drawn, "no pictures of scores", &off)
}

fn budget() -> Outcome {
    let place = Place::new()?;
    let thresholds = ["--theta-prune", "0.4", "--theta-add", "0.5", "--views", "none"];
    let free = place.run("free", &[thresholds.as_slice(), &["--density", "policy"]].concat())?;
    let (initial, last, added) = (free.count("initial")?, free.count("final")?, free.count("added")?);
    for density in ["policy", "random"] {
        for n in [0, 1, initial / 3, last - added / 2, last, 100 * last] {
            let text = n.to_string();
            let flags = [thresholds.as_slice(), &["--density", density, "--max-gaussians", &text]].concat();
            let held = place.run("held", &flags)?;
            expect(held.count("final")? == n.min(last), &format!("{} by {density}", n.min(last)), &held)?;
            held.scores()?;
            if density == "policy" && n >= last {
                expect(held.scene == free.scene, "what no budget gives", &held)?;
            }
        }
    }
    Ok(())
}

fn refused() -> Outcome {
    let place = Place::new()?;
    let flags =
        ["--density", "policy", "--theta-prune", "1", "--theta-add", "1", "--views", "none", "--max-gaussians", "40%"];
    let share = place.run("share", &flags)?;
    expect(share.count("final")? == share.count("initial")? * 40 / 100, "two fifths of those before", &share)?;
    expect(share.page["config"]["max_gaussians"] == "40%", "as it was asked for", &share)?;
    let off = place.finish("out", &["--max-gaussians", "5", "--density", "off"])?;
    off.expect_refusal(&["--max-gaussians", "--density off"])?;
    let scored = place.finish("out", &["--density", "exact", "--theta-prune", "0.5"])?;
    scored.expect_refusal(&["--theta-prune", "--density policy"])?;
    fs::write(place.0.path().join("plain.json"), without_policy()?)?;
    let street = clips::street();
    let run_with = |weights: &str| {
        let flags = ["--out", "out", "--density", "policy", "--max-gaussians", "5", "--weights", weights];
        let mut arguments = vec![street.as_os_str()];
        arguments.extend(flags.iter().map(|flag| flag.as_ref() as &std::ffi::OsStr));
        run(&binary("lgs-infer")?, &arguments, place.0.path())
    };
    run_with("none")?.expect_refusal(&["--max-gaussians", "--weights none"])?;
    run_with("random:plain.json")?.expect_refusal(&["--max-gaussians", "policy"])?;
    if place.0.path().join("out").exists() { Err("a refused run left an output directory".into()) } else { Ok(()) }
}

fn without_policy() -> Result<String, Failed> {
    let mut config: Value = serde_json::from_str(SMALL)?;
    config["policy"] = Value::Null;
    Ok(config.to_string())
}

fn pictures() -> Outcome {
    let place = Place::new()?;
    let found = place.run("out", &["--density", "policy"])?;
    let cameras = ["front", "front_left"];
    let mut want: Vec<String> = Vec::new();
    for (frame, camera) in [0, 2].iter().flat_map(|frame| cameras.map(|camera| (frame, camera))) {
        want.extend(["prune", "add"].map(|kind| format!("views/f{frame}_{camera}_{kind}.png")));
    }
    let is_map = |name: &String| ["_prune.png", "_add.png"].iter().any(|end| name.ends_with(end));
    let mut got: Vec<String> = files(&found.out)?.iter().map(|name| name.to_string_lossy().into_owned()).collect();
    got.retain(is_map);
    want.sort();
    if got != want {
        return Err(format!("got {got:?}, want {want:?}").into());
    }
    for name in &want {
        let picture = image::open(found.out.join(name))?.to_rgb8();
        let colourful =
            picture.pixels().filter(|p| p.0.iter().max() > p.0.iter().min().map(|low| low + 20).as_ref()).count();
        if (picture.height(), picture.width()) != (48, 80) || colourful < 200 {
            return Err(format!("{name}: {colourful} coloured pixels of {:?}", picture.dimensions()).into());
        }
    }
    let report = fs::read_to_string(found.out.join("report.html"))?;
    if report.contains("prune, add") && report.matches("alt=\"prune, ").count() == 4 {
        return Ok(());
    }
    Err("the report has no map of scores or no legend for it".into())
}

fn threads() -> Outcome {
    let place = Place::new()?;
    let flags = |threads| ["--density", "policy", "--theta-prune", "0.4", "--refine-steps", "2", "--threads", threads];
    let weights = Weights::seeded(SMALL, 2, Heads { residuals: 1e-4, scores: 1.5 })?;
    weights.write(&place.0.path().join("moving.safetensors"))?;
    let one = [flags("1").as_slice(), &["--weights", "moving.safetensors"]].concat();
    let two = [flags("2").as_slice(), &["--weights", "moving.safetensors"]].concat();
    let (one, two) = (place.run("one", &one)?, place.run("two", &two)?);
    expect(one.count("pruned")? > 0, "some pruned", &one)?;
    same_results(&one.out, &two.out)
}
