//! What `lgs-infer` knows about speed and accuracy: the page that the repository keeps as `models/presets.json`.

use lgs_engine::{
    densify::Limit,
    plan::{ClipWork, MeasuredRecipe, Named, PRESETS_FORMAT, Preset, Record, RecordedClip},
    recipe::Recipe,
};

use super::{
    front::{Offer, on_front},
    record::{PointRecord, SweepRecord},
    setting::{Setting, Weights},
    table::PointRow,
};
use crate::{machine::Machine, statistics::Quartiles};

/// How many times faster than the best the quick ones have to be.
const QUICKER: [(Named, f64); 2] = [(Named::Fast, 3.5), (Named::Balanced, 2.0)];

impl Setting {
    /// Its recipe, where that makes sense on other clips and with the usual thresholds.
    pub fn recipe(&self) -> Option<Recipe> {
        let limit = self.recipe.max_gaussians;
        let told = self.recipe.thresholds.are_usual() && !matches!(limit, Some(Limit::Count(_)));
        told.then_some(self.recipe)
    }
}

/// The configurations without a network and with `weights` that are on the front of a clip or of the mean, `rows`, and the names of three
/// of them; `None` where a clip has no timed runs or nothing is quick enough for its name.
pub fn presets(
    records: &[SweepRecord],
    rows: &[PointRow],
    weights: Option<&Weights>,
    machine: &Machine,
) -> Option<Record> {
    let known: Vec<(&Setting, MeasuredRecipe)> = rows
        .iter()
        .filter(|row| row.setting.weights.as_ref().is_none_or(|own| Some(own) == weights))
        .filter_map(|row| Some((&row.setting, measured(&row.setting, records)?)))
        .collect();
    let kept = worth_knowing(&known.iter().map(|(_, measured)| measured).collect::<Vec<_>>());
    let recipes: Vec<MeasuredRecipe> =
        known.into_iter().zip(kept).filter(|(_, kept)| *kept).map(|((_, measured), _)| measured).collect();
    Some(Record {
        format: PRESETS_FORMAT.to_owned(),
        weights: weights.map_or(String::new(), |weights| weights.sha256.clone()),
        machine: format!("{}, {} threads", machine.cpu.as_deref().unwrap_or("unknown processor"), machine.threads),
        presets: names(&recipes)?,
        clips: records.iter().map(clip).collect::<Option<_>>()?,
        recipes,
    })
}

fn measured(setting: &Setting, records: &[SweepRecord]) -> Option<MeasuredRecipe> {
    let points: Vec<&PointRecord> = records.iter().map(|record| record.point(setting)).collect::<Option<_>>()?;
    let seconds = |point: &&PointRecord| Quartiles::of(point.repeats.iter().map(|repeat| repeat.cost.seconds));
    Some(MeasuredRecipe {
        recipe: setting.recipe()?,
        psnr: points
            .iter()
            .map(|point| point.accuracy.figures.psnr.filter(|psnr| psnr.is_finite()))
            .collect::<Option<_>>()?,
        seconds: points.iter().map(|point| Some(seconds(point)?.median)).collect::<Option<_>>()?,
    })
}

fn clip(record: &SweepRecord) -> Option<RecordedClip> {
    let begin =
        record.points.iter().flat_map(|point| &point.repeats).filter_map(|repeat| *repeat.cost.stages.get("points")?);
    Some(RecordedClip {
        name: record.clip.clone(),
        work: ClipWork {
            points: record.points.first()?.accuracy.gaussians.returns,
            pixels: record.work.input_pixels,
            views: record.work.input_views,
        },
        begin_s: Quartiles::of(begin)?.median,
    })
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Whether each is on the front of the mean over clips, or of a clip.
fn worth_knowing(all: &[&MeasuredRecipe]) -> Vec<bool> {
    let num_clips = all.first().map_or(0, |row| row.psnr.len());
    let front = |offer: &dyn Fn(&MeasuredRecipe) -> [f64; 2]| {
        let offers: Vec<_> =
            all.iter().map(|row| offer(row)).map(|[cost, quality]| Some(Offer { cost, quality })).collect();
        on_front(&offers)
    };
    let mut kept = front(&|row| [mean(&row.seconds), mean(&row.psnr)]);
    for clip in 0..num_clips {
        kept.iter_mut().zip(front(&|row| [row.seconds[clip], row.psnr[clip]])).for_each(|(kept, on)| *kept |= on);
    }
    kept
}

/// The best, and the best of those that are so many times quicker, by the means over clips; `None` where nothing is that quick.
fn names(recipes: &[MeasuredRecipe]) -> Option<Vec<Preset>> {
    let best = |at_most: f64| {
        let fitting = (0..recipes.len()).filter(|&k| mean(&recipes[k].seconds) <= at_most);
        fitting.max_by(|&a, &b| {
            let order = mean(&recipes[a].psnr).total_cmp(&mean(&recipes[b].psnr));
            order.then(mean(&recipes[b].seconds).total_cmp(&mean(&recipes[a].seconds)))
        })
    };
    let accurate = best(f64::INFINITY)?;
    let limit = mean(&recipes[accurate].seconds);
    let quicker = QUICKER.iter().map(|&(name, times)| Some(Preset { name, recipe: best(limit / times)? }));
    let mut presets = quicker.collect::<Option<Vec<_>>>()?;
    presets.push(Preset { name: Named::Accurate, recipe: accurate });
    Some(presets)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(refine_steps: usize, psnr: [f64; 2], seconds: [f64; 2]) -> MeasuredRecipe {
        let recipe = Recipe { refine_steps, ..Recipe::default() };
        MeasuredRecipe { recipe, psnr: psnr.to_vec(), seconds: seconds.to_vec() }
    }

    #[test]
    fn names_are_points_of_the_front_at_the_promised_speeds() {
        let rows = [
            row(0, [20.0, 20.0], [0.5, 0.5]),
            row(1, [21.0, 21.0], [0.9, 0.9]),
            row(2, [23.0, 23.0], [3.0, 3.0]),
            row(3, [23.5, 23.5], [7.0, 7.0]),
            row(4, [24.0, 24.0], [8.0, 8.0]),
        ];
        let found: Vec<(Named, usize)> = names(&rows).unwrap().iter().map(|p| (p.name, p.recipe)).collect();
        assert_eq!(found, [(Named::Fast, 1), (Named::Balanced, 2), (Named::Accurate, 4)]);
        assert!(names(&rows[2..]).is_none());
        assert!(names(&[]).is_none());
    }

    #[test]
    fn what_is_best_on_one_clip_is_kept() {
        let rows =
            [row(0, [20.0, 20.0], [0.5, 0.5]), row(1, [21.0, 15.0], [0.4, 1.5]), row(2, [19.0, 19.0], [0.6, 0.6])];
        assert_eq!(worth_knowing(&rows.iter().collect::<Vec<_>>()), [true, true, false]);
    }
}
