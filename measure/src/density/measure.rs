//! Everything that is measured on one clip.

use lgs_engine::{
    densify::{Density, Scope},
    gaussians::GaussianSet,
    network::model::Model,
    pipeline::{NetworkSettings, Pruning, Silent, Watch, run_network},
    recipe::Recipe,
    refine::{
        adam::{Adam, AdamSettings},
        refine,
    },
    views::View,
};

use super::{
    record::{DensityKey, DensityPoint, DensityRecord},
    signal::{Seen, Signal},
};
use crate::{ablate::subject::Subject, error::Result, means::Means};

/// One clip under measurement.
struct Bench<'a> {
    subject: &'a Subject<'a>,
    model: &'a Model,
    refine_steps: usize,
    adam: usize,
}

/// Everything about the clip that `key` asks for; `told` hears of every point.
///
/// # Errors
/// Whatever is wrong with the clip; a scene that draws what is not finite.
pub fn measure(
    subject: &Subject<'_>,
    model: &Model,
    key: DensityKey,
    told: &mut dyn FnMut(&DensityPoint),
) -> Result<DensityRecord> {
    let views = subject.views();
    let settings = key.settings.clone();
    let mut scene = predicted(subject, model, &views)?;
    let pruning = Pruning { scope: Scope::All, limit: None, refine: settings.refine_steps.into() };
    pruning.advance(&mut scene, &views, model, &mut || ())?;
    let bench = Bench { subject, model, refine_steps: settings.refine_steps, adam: settings.adam };
    let mut points = vec![bench.point(&scene, None, 100)?];
    points.iter().for_each(&mut *told);
    for &signal in &settings.signals {
        for &percent in &settings.percents {
            let seen = Seen { scene: &scene, inputs: &views, held_out: subject.held_out(), seed: settings.seed };
            let kept = signal.survivors(seen, percent);
            let left = scene.select(&kept, kept.partition_point(|&i| i < scene.num_lidar));
            let point = bench.point(&left, Some(signal), percent)?;
            told(&point);
            points.push(point);
        }
    }
    let pixels = views.iter().map(|view| view.pinhole.num_pixels()).sum();
    Ok(DensityRecord { key, clip: subject.session().clip().name.clone(), pixels, points })
}

/// What the network makes of the initial Gaussians before it refines.
fn predicted(subject: &Subject<'_>, model: &Model, views: &[&View]) -> Result<GaussianSet> {
    let mut scene = subject.start()?.scene;
    let recipe = Recipe { refine_steps: 0, ..Recipe::default().with_density(Density::Off) };
    let settings = NetworkSettings::of(&recipe, model, 0, None);
    run_network(&mut scene, views, &settings, &mut Watch::new(&Silent))?;
    Ok(scene)
}

impl Bench<'_> {
    fn point(&self, from: &GaussianSet, signal: Option<Signal>, percent: u32) -> Result<DensityPoint> {
        let views = self.subject.views();
        let mut learned = from.clone();
        refine(&mut learned, &views, self.model, self.refine_steps, || ())?;
        let adam = (self.adam > 0).then(|| {
            let mut scene = from.clone();
            let mut adam = Adam::new(scene.len(), AdamSettings::default());
            (0..self.adam).for_each(|_| {
                adam.pass(&mut scene, &views);
            });
            scene
        });
        Ok(DensityPoint {
            signal,
            percent,
            gaussians: from.len(),
            learned: Means::from(self.subject.figures(&learned)?),
            adam: adam
                .map(|scene| Ok::<_, crate::error::MeasureError>(self.subject.figures(&scene)?.into()))
                .transpose()?,
        })
    }
}
