//! Everything that is measured on one clip.

use std::time::Instant;

use lgs_engine::{
    densify::{Density, DensityMap, Limit, Scope, Thresholds, UpdateCounts},
    gaussians::GaussianSet,
    network::model::Model,
    pipeline::{Marks, NetworkRun, NetworkSettings, Reconstruction, Silent, StageTimes, Watch, run_network},
    recipe::Recipe,
    refine::{adam::AdamRates, refine_showing},
};
use lgs_train::velocity::{TrueVelocities, VelocityErrors};

use super::{
    record::{AblationKey, AblationRecord, Point, Variant},
    settings::{STEPS, Settings},
    subject::Subject,
    ways::{ANY, Way, names, ways},
};
use crate::{error::Result, means::Means};

/// A scene that the network made of the initial Gaussians.
struct Made {
    scene: GaussianSet,
    update: UpdateCounts,
    seconds: f64,
}

/// One clip under measurement.
struct Bench<'a> {
    subject: &'a Subject<'a>,
    model: &'a Model,
    settings: &'a Settings,
    start: GaussianSet,
}

/// How many steps of some kind [`measure`] tells of at most, for who shows progress.
pub fn num_told(settings: &Settings) -> u64 {
    let adam = settings.adam.last().copied().unwrap_or(0) * (1 + usize::from(settings.adam_from_start));
    (adam + settings.refine_steps + (5 + 2 * (settings.thresholds.len() + settings.limits.len())) * STEPS) as u64
}

/// Everything about the clip that `key` ask for; `told` hears how many steps have been done.
///
/// # Errors
/// Whatever is wrong with the clip; a scene that draws what is not finite.
pub fn measure(
    subject: &Subject<'_>,
    model: &Model,
    key: AblationKey,
    told: &mut dyn FnMut(u64),
) -> Result<AblationRecord> {
    let begun = Instant::now();
    let start = subject.start()?.scene;
    let start_seconds = begun.elapsed().as_secs_f64();
    let settings = key.settings.clone();
    let bench = Bench { subject, model, settings: &settings, start };
    let mut way = Way { query: true, density: Density::Policy, thresholds: Thresholds::default(), limit: None };
    let (main, density) = bench.make(way)?;
    let policy_skipped = policy_skipped(density.as_ref());
    if policy_skipped.is_some() {
        way.density = Density::Off;
    }
    let (learned, refined) = bench.learned(&main.scene, settings.refine_steps, told)?;
    let adam = bench.adam(&main.scene, told)?;
    let adam_from_start = if settings.adam_from_start { bench.adam(&bench.start, told)? } else { Vec::new() };
    let mut variants = vec![variant(names::MAIN, &main, learned.get(STEPS.min(learned.len().saturating_sub(1))))];
    let mut measured = |name: String, way: Way| {
        let (made, _) = bench.make(way)?;
        let (points, _) = bench.learned(&made.scene, STEPS, told)?;
        variants.push(variant(&name, &made, points.last()));
        Result::Ok(made.scene.num_lidar)
    };
    for (name, other) in ways(way, policy_skipped.is_some(), &settings.limits) {
        measured(name, other)?;
    }
    for &theta in settings.thresholds.iter().filter(|_| policy_skipped.is_none()) {
        let thresholds = Thresholds { prune: theta, add: theta };
        let count = measured(names::threshold(theta), Way { thresholds, ..way })?;
        measured(names::as_many(theta), Way { thresholds: ANY, limit: Some(Limit::Count(count)), ..way })?;
    }
    let velocity = bench.velocity(policy_skipped.is_some().then_some([&main.scene, &refined]), told)?;
    Ok(AblationRecord {
        key,
        clip: subject.session().clip().name.clone(),
        views: subject.num_views(),
        gaussians: [bench.start.num_lidar, bench.start.num_background()],
        start: subject.figures(&bench.start)?.into(),
        learned,
        adam,
        adam_from_start,
        variants,
        policy_skipped,
        velocity,
        seconds: [start_seconds, main.seconds],
    })
}

/// Why the policy decides nothing; `None` when it does.
fn policy_skipped(density: Option<&DensityMap>) -> Option<String> {
    let Some(map) = density else { return Some("the model has no policy".to_owned()) };
    let scores = map.scores.prune.iter().chain(&map.scores.add);
    let untrained = scores.clone().all(|&score| score == 0.5);
    untrained.then(|| "the policy is not trained: every score is 1/2".to_owned())
}

fn variant(name: &str, made: &Made, point: Option<&Point>) -> Variant {
    Variant {
        name: name.to_owned(),
        figures: point.map(|point| point.figures).unwrap_or_default(),
        pruned: made.update.pruned,
        added: made.update.added,
        seconds: made.seconds + point.map_or(0.0, |point| point.seconds),
    }
}

impl Bench<'_> {
    /// What the network makes of the initial Gaussians before it refines, and the policy's scores.
    fn make(&self, way: Way) -> Result<(Made, Option<DensityMap>)> {
        let recipe = Recipe {
            query: way.query,
            density: way.density,
            density_scope: Scope::All,
            thresholds: way.thresholds,
            max_gaussians: way.limit,
            refine_steps: 0,
            ..Recipe::default()
        };
        let settings = NetworkSettings::of(&recipe, self.model, self.settings.seed, None);
        let mut scene = self.start.clone();
        let begun = Instant::now();
        let run = run_network(&mut scene, &self.subject.views(), &settings, &mut Watch::new(&Silent))?;
        let NetworkRun { update, density, .. } = run;
        Ok((Made { scene, update, seconds: begun.elapsed().as_secs_f64() }, density))
    }

    fn point(&self, scene: &GaussianSet, steps: usize, loss: Option<f64>, seconds: f64) -> Result<Point> {
        Ok(Point { steps, figures: Means::from(self.subject.figures(scene)?), loss, seconds })
    }

    /// The learned refinement from 0 steps on, and the scene after [`STEPS`] of them (or the last one that helped).
    fn learned(
        &self,
        from: &GaussianSet,
        steps: usize,
        told: &mut dyn FnMut(u64),
    ) -> Result<(Vec<Point>, GaussianSet)> {
        let (mut scene, mut kept) = (from.clone(), from.clone());
        let mut points = vec![self.point(from, 0, None, 0.0)?];
        let (begun, mut paused, mut failed) = (Instant::now(), 0.0, None);
        let refined = refine_showing(&mut scene, &self.subject.views(), self.model, steps, |scene| {
            let seconds = begun.elapsed().as_secs_f64();
            match self.point(scene, points.len(), None, seconds - paused) {
                Ok(point) => points.push(point),
                Err(error) => failed = failed.take().or(Some(error)),
            }
            if points.len() <= STEPS + 1 {
                kept = scene.clone();
            }
            told(1);
            paused += begun.elapsed().as_secs_f64() - seconds;
        })?;
        if let Some(error) = failed {
            return Err(error);
        }
        for (point, loss) in points.iter_mut().zip(refined.losses) {
            point.loss = Some(loss);
        }
        Ok((points, kept))
    }

    /// Per-scene optimisation from 0 steps on.
    fn adam(&self, from: &GaussianSet, told: &mut dyn FnMut(u64)) -> Result<Vec<Point>> {
        let most = self.settings.adam.last().copied().unwrap_or(0);
        let run = self.subject.adam(most, self.settings.adam_views, self.settings.seed);
        let (mut points, mut failed) = (vec![self.point(from, 0, None, 0.0)?], None);
        let (all, mut steps): (Vec<usize>, _) = ((1..=most).collect(), 0);
        let mut done = |made: &Reconstruction, _: &StageTimes| {
            steps += 1;
            told(1);
            if self.settings.adam.contains(&steps) {
                match self.point(&made.scene, steps, None, made.seconds) {
                    Ok(point) => points.push(point),
                    Err(error) => failed = failed.take().or(Some(error)),
                }
            }
        };
        let mut made = Reconstruction::of_scene(from.clone());
        let marks = Marks { steps: &all, done: &mut done };
        let inputs = self.subject.session().inputs();
        made.optimise(inputs, &run, AdamRates::default(), &mut Watch::new(&Silent), marks)?;
        if let Some(error) = failed {
            return Err(error);
        }
        let losses = made.optimisation.map(|summary| summary.losses).unwrap_or_default();
        for point in points.iter_mut().filter(|point| point.steps > 0) {
            point.loss = losses.get(point.steps - 1).copied();
        }
        Ok(points)
    }

    /// Errors of the velocities after prediction and refinement without a set update: the `scenes` that are known already, or made here.
    fn velocity(
        &self,
        scenes: Option<[&GaussianSet; 2]>,
        told: &mut dyn FnMut(u64),
    ) -> Result<Option<[VelocityErrors; 2]>> {
        let (clip, frames) = (self.subject.session().clip(), self.subject.session().frames());
        // The truth may know what is held out.
        let known: Vec<usize> = (0..clip.frames.len()).collect();
        let truth = TrueVelocities::of(clip, self.subject.session().clip_frame(), &frames.input, &known, &self.start);
        let Some(truth) = truth else { return Ok(None) };
        if let Some(scenes) = scenes {
            return Ok(Some(scenes.map(|scene| truth.errors(scene))));
        }
        let (made, _) =
            self.make(Way { query: true, density: Density::Off, thresholds: Thresholds::default(), limit: None })?;
        let (_, refined) = self.learned(&made.scene, STEPS, told)?;
        Ok(Some([&made.scene, &refined].map(|scene| truth.errors(scene))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_policy_that_decides_nothing_is_told() {
        let map = |score: f32| {
            let scores = lgs_engine::densify::Scores { prune: vec![0.5, score], add: vec![0.5; 2] };
            DensityMap { scored: GaussianSet::default(), scores: scores.clone(), updated: scores }
        };
        assert!(policy_skipped(None).unwrap().contains("no policy"));
        assert!(policy_skipped(Some(&map(0.5))).unwrap().contains("not trained"));
        assert_eq!(policy_skipped(Some(&map(0.6))), None);
    }
}
