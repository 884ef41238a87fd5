//! Paired comparisons of what was found on several clips.

use serde::Serialize;

use super::{record::AblationRecord, settings::STEPS, ways::names};
use crate::{
    means::Means,
    statistics::{Paired, Spread},
};

/// Two ways to reconstruct, compared by the PSNR of the held-out views of each scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// What is compared with what.
    pub what: String,
    /// The first less the second, decibels.
    pub paired: Paired,
}

/// The comparisons that the records allow.
pub fn comparisons(records: &[AblationRecord]) -> Vec<Comparison> {
    let learned = |steps: usize| move |r: &AblationRecord| r.learned_at(steps)?.figures.psnr;
    let variant = |name: &'static str| move |r: &AblationRecord| r.variant(name)?.figures.psnr;
    let mut all = Vec::new();
    let mut add = |what: String, of: &dyn Fn(&AblationRecord) -> Option<f64>| {
        let differences: Vec<f64> = records.iter().filter_map(of).collect();
        if let Some(paired) = Paired::of(&differences) {
            all.push(Comparison { what, paired });
        }
    };
    let refined = learned(STEPS);
    add(format!("{STEPS} learned steps - none"), &|r| Some(refined(r)? - learned(0)(r)?));
    add(format!("{STEPS} learned steps - initial Gaussians"), &|r| Some(refined(r)? - r.start.psnr?));
    for steps in adam_passes(records) {
        let adam = |r: &AblationRecord| AblationRecord::at(&r.adam, steps)?.figures.psnr;
        add(format!("{STEPS} learned steps - {steps} Adam"), &|r| Some(refined(r)? - adam(r)?));
    }
    for steps in adam_passes(records) {
        let adam = |r: &AblationRecord| AblationRecord::at(&r.adam_from_start, steps)?.figures.psnr;
        add(format!("{STEPS} learned steps - {steps} Adam from the initial Gaussians"), &|r| {
            Some(refined(r)? - adam(r)?)
        });
    }
    let main = variant(names::MAIN);
    for (what, other) in [
        ("query on - off", names::QUERY_OFF),
        ("policy on - off", names::POLICY_OFF),
        ("policy - random at its rates", names::RANDOM),
        ("query and policy - neither", names::NEITHER),
    ] {
        add(what.to_owned(), &|r| Some(main(r)? - variant(other)(r)?));
    }
    let Some(settings) = records.first().map(|record| &record.key.settings) else { return all };
    let psnr_of = |name: String| move |r: &AblationRecord| r.variant(&name)?.figures.psnr;
    let without = variant(names::POLICY_OFF);
    for &limit in &settings.limits {
        let (ranked, by_chance) = (psnr_of(names::limited(limit)), psnr_of(names::limited_by_chance(limit)));
        add(format!("{} - policy off", names::limited(limit)), &|r| Some(ranked(r)? - without(r)?));
        add(format!("at most {limit}, by rank - by chance"), &|r| Some(ranked(r)? - by_chance(r)?));
    }
    for &theta in &settings.thresholds {
        let (ranked, fixed) = (psnr_of(names::as_many(theta)), psnr_of(names::threshold(theta)));
        add(format!("{} - theta {theta}", names::as_many(theta)), &|r| Some(ranked(r)? - fixed(r)?));
    }
    all
}

/// Numbers of passes of per-scene optimisation that any record has, ascending, without 0.
pub fn adam_passes(records: &[AblationRecord]) -> Vec<usize> {
    let mut steps: Vec<usize> = records.iter().flat_map(|r| &r.adam).map(|point| point.steps).collect();
    steps.sort_unstable();
    steps.dedup();
    steps.retain(|&count| count > 0);
    steps
}

/// Mean and spread of a figure over the records that have it.
pub fn spread<'a>(
    records: &'a [AblationRecord],
    of: impl Fn(&'a AblationRecord) -> Option<Means>,
    figure: fn(&Means) -> Option<f64>,
) -> Option<Spread> {
    let values: Vec<f64> = records.iter().filter_map(|r| figure(&of(r)?)).collect();
    Spread::of(&values)
}
