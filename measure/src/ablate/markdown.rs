//! The tables of an ablation for people: one page of Markdown, which goes into the card of the weights.

use std::fmt::Write as _;

use lgs_train::velocity::VelocityErrors;

use super::{
    compare::{adam_passes, comparisons, spread},
    record::{AblationRecord, CurveOf},
    settings::STEPS,
    ways::names,
};
use crate::{means::Means, statistics::Spread};

/// What was found on the scenes that means are taken over, and on clips that stand for themselves.
#[derive(Clone, Copy, Debug)]
pub struct AblationRecords<'a> {
    /// The scenes.
    pub scenes: &'a [AblationRecord],
    /// The clips.
    pub clips: &'a [AblationRecord],
}

/// A row's figures of a record.
type MeansOf<'a> = &'a dyn Fn(&'a AblationRecord) -> Option<Means>;

/// The page.
pub fn markdown(found: AblationRecords<'_>) -> String {
    let mut text = String::new();
    let all = || found.scenes.iter().chain(found.clips);
    let Some(first) = all().next() else { return text };
    line(&mut text, &format!("Weights: SHA-256 `{}`.", first.key.weights));
    let views: [usize; 2] = [0, 1].map(|k| found.scenes.iter().map(|record| record.views[k]).sum());
    let scenes = format!("{} scenes ({} input and {} held-out views)", found.scenes.len(), views[0], views[1]);
    line(
        &mut text,
        &format!("Held-out views only; mean ± standard deviation over {scenes}, then each clip by itself (PSNR, dB)."),
    );
    found.refinement(&mut text);
    found.adam(&mut text);
    found.variants(&mut text);
    found.paired(&mut text);
    found.velocities(&mut text);
    found.seconds(&mut text);
    text
}

fn line(text: &mut String, line: &str) {
    text.push_str(line);
    text.push_str("\n\n");
}

fn mean(spread: Option<Spread>, digits: usize) -> String {
    spread.map_or("–".to_owned(), |s| format!("{:.*} ± {:.*}", digits, s.mean, digits, s.deviation))
}

impl<'a> AblationRecords<'a> {
    fn head(&self, text: &mut String, title: &str, first: &str) {
        line(text, &format!("### {title}"));
        let names: String = self.clips.iter().map(|record| format!(" {} |", record.clip)).collect();
        let _ =
            writeln!(text, "| {first} | scenes | PSNR | SSIM | PSNR, moving | PSNR, static | depth error, m |{names}");
        let _ = writeln!(text, "|---|---|---|---|---|---|---|{}", "---|".repeat(self.clips.len()));
    }

    fn row(&self, text: &mut String, name: &str, means: MeansOf<'a>) {
        let figures: [fn(&Means) -> Option<f64>; 5] =
            [|m| m.psnr, |m| m.ssim, |m| m.psnr_dynamic, |m| m.psnr_static, |m| m.dmae];
        let _ = write!(text, "| {name} | {} |", self.scenes.iter().filter(|r| means(r).is_some()).count());
        for (k, figure) in figures.into_iter().enumerate() {
            let _ = write!(text, " {} |", mean(spread(self.scenes, means, figure), if k == 1 { 3 } else { 2 }));
        }
        for clip in self.clips {
            let psnr = means(clip).and_then(|means| means.psnr);
            let _ = write!(text, " {} |", psnr.map_or("–".to_owned(), |psnr| format!("{psnr:.2}")));
        }
        text.push('\n');
    }

    fn refinement(&self, text: &mut String) {
        self.head(text, "Learned refinement", "steps");
        self.row(text, "initial Gaussians", &|r| Some(r.start));
        let all = self.scenes.iter().chain(self.clips);
        for steps in 0..=all.map(|r| r.key.settings.refine_steps).max().unwrap_or(0) {
            self.row(text, &steps.to_string(), &|r| Some(r.learned_at(steps)?.figures));
        }
        text.push('\n');
    }

    fn adam(&self, text: &mut String) {
        let all: Vec<AblationRecord> = self.scenes.iter().chain(self.clips).cloned().collect();
        let curves: [(&str, CurveOf); 2] = [
            ("Per-scene optimisation (Adam) from the same start", |r| &r.adam),
            ("Per-scene optimisation (Adam) from the initial Gaussians", |r| &r.adam_from_start),
        ];
        for (title, curve) in curves {
            if all.iter().all(|record| curve(record).is_empty()) {
                continue;
            }
            self.head(text, title, "steps");
            for steps in std::iter::once(0).chain(adam_passes(&all)) {
                self.row(text, &steps.to_string(), &|r| Some(AblationRecord::at(curve(r), steps)?.figures));
            }
            text.push('\n');
        }
    }

    fn variants(&self, text: &mut String) {
        self.head(text, &format!("Ways to use the network, {STEPS} learned steps"), "way");
        let all = || self.scenes.iter().chain(self.clips);
        let mut shown: Vec<&str> = Vec::new();
        for name in all().flat_map(|record| &record.variants).map(|variant| variant.name.as_str()) {
            if !shown.contains(&name) {
                shown.push(name);
                let counts = |of: fn(&AblationRecord, &str) -> Option<f64>| {
                    let shares: Vec<f64> = self.scenes.iter().filter_map(|r| of(r, name)).collect();
                    Spread::of(&shares).map(|s| 100.0 * s.mean).filter(|share| *share > 0.0)
                };
                let pruned = counts(|r, name| Some(r.variant(name)?.pruned as f64 / r.gaussians[0].max(1) as f64));
                let added = counts(|r, name| Some(r.variant(name)?.added as f64 / r.gaussians[0].max(1) as f64));
                let shares = match (pruned, added) {
                    (None, None) => String::new(),
                    _ => format!(" (pruned {:.1} %, added {:.1} %)", pruned.unwrap_or(0.0), added.unwrap_or(0.0)),
                };
                self.row(text, &format!("{name}{shares}"), &|r| Some(r.variant(name)?.figures));
            }
        }
        text.push('\n');
        if let Some(reason) = all().find_map(|record| record.policy_skipped.as_ref()) {
            line(
                text,
                &format!(
                    "Policy, random and thresholds were left out: {reason}. `{}` is without a policy.",
                    names::MAIN
                ),
            );
        }
    }

    fn paired(&self, text: &mut String) {
        line(text, "### Paired tests over scenes (PSNR, dB)");
        text.push_str(
            "| difference | scenes | mean ± sd | better in | p, Student's t | p, signs |\n|---|---|---|---|---|---|\n",
        );
        let p = |value: Option<f64>| {
            value.map_or("–".to_owned(), |p| if p < 1e-4 { format!("{p:.0e}") } else { format!("{p:.4}") })
        };
        for comparison in comparisons(self.scenes) {
            let paired = comparison.paired;
            let (count, difference) = (paired.difference.count, mean(Some(paired.difference), 2));
            let _ = writeln!(
                text,
                "| {} | {count} | {difference} | {} | {} | {} |",
                comparison.what,
                paired.wins,
                p(paired.p_t),
                p(paired.p_sign)
            );
        }
        text.push('\n');
    }

    fn velocities(&self, text: &mut String) {
        line(text, "### Velocities against tracked boxes (without a set update)");
        text.push_str("| scenes | state | moving primitives | true speed, m/s | error, m/s | error / speed | resting primitives | their speed, m/s |\n");
        text.push_str("|---|---|---|---|---|---|---|---|\n");
        let own = self.clips.iter().map(|record| (record.clip.clone(), std::slice::from_ref(record)));
        for (name, records) in std::iter::once(("all scenes".to_owned(), self.scenes)).chain(own) {
            for (k, state) in ["predicted".to_owned(), format!("{STEPS} steps")].iter().enumerate() {
                let errors: Vec<_> = records.iter().filter_map(|r| Some(r.velocity?[k])).collect();
                if errors.is_empty() {
                    continue;
                }
                // Over all primitives of all scenes: a scene with a few moving ones counts little.
                let sum = |of: fn(&VelocityErrors) -> f64| errors.iter().map(of).sum::<f64>();
                let (moving, resting) = (sum(|e| e.moving as f64), sum(|e| e.resting as f64));
                let _ = writeln!(
                    text,
                    "| {name} | {state} | {moving} | {:.2} | {:.2} | {:.2} | {resting} | {:.3} |",
                    sum(|e| e.speed * e.moving as f64) / moving.max(1.0),
                    sum(|e| e.error * e.moving as f64) / moving.max(1.0),
                    sum(|e| e.relative * e.moving as f64) / moving.max(1.0),
                    sum(|e| e.resting_speed * e.resting as f64) / resting.max(1.0),
                );
            }
        }
        text.push('\n');
    }

    fn seconds(&self, text: &mut String) {
        line(text, "### Seconds (of the machine that measured, other work beside it)");
        text.push_str(
            "| scenes | initial Gaussians | prediction | 3 learned steps | a pass of Adam |\n|---|---|---|---|---|\n",
        );
        let own = self.clips.iter().map(|record| (record.clip.clone(), std::slice::from_ref(record)));
        for (name, records) in std::iter::once(("mean scene".to_owned(), self.scenes)).chain(own) {
            let mean_seconds = |seconds: &dyn Fn(&AblationRecord) -> Option<f64>| {
                let all: Vec<f64> = records.iter().filter_map(seconds).collect();
                Spread::of(&all).map_or("–".to_owned(), |s| format!("{:.2}", s.mean))
            };
            let _ = writeln!(
                text,
                "| {name} | {} | {} | {} | {} |",
                mean_seconds(&|r| Some(r.seconds[0])),
                mean_seconds(&|r| Some(r.seconds[1])),
                mean_seconds(&|r| Some(r.learned_at(STEPS)?.seconds)),
                mean_seconds(&|r| r.adam.last().filter(|p| p.steps > 0).map(|p| p.seconds / p.steps as f64)),
            );
        }
        text.push('\n');
    }
}
