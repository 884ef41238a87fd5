//! Every figure of every clip as one table of comma-separated values.

use lgs_pages::csv;

use super::{
    record::{AblationRecord, Point},
    settings::STEPS,
};
use crate::means::Means;

/// The columns.
const HEAD: [&str; 13] = [
    "clip",
    "what",
    "steps",
    "psnr",
    "ssim",
    "lpips",
    "dmae",
    "psnr_dynamic",
    "psnr_static",
    "loss",
    "pruned",
    "added",
    "seconds",
];

/// The table; what is not defined is an empty field.
pub fn figures(records: &[&AblationRecord]) -> String {
    csv(&HEAD, records.iter().flat_map(|record| lines(record)))
}

fn lines(record: &AblationRecord) -> Vec<Vec<String>> {
    let mut lines = vec![line(&record.clip, ["initial Gaussians", "0"], &record.start, [None; 4])];
    let curves = [("learned", &record.learned), ("adam", &record.adam), ("adam from start", &record.adam_from_start)];
    for (what, curve) in curves {
        lines.extend(curve.iter().map(|point| {
            let Point { steps, figures, loss, seconds } = point;
            line(&record.clip, [what, &steps.to_string()], figures, [*loss, None, None, Some(*seconds)])
        }));
    }
    lines.extend(record.variants.iter().map(|variant| {
        let [pruned, added] = [variant.pruned, variant.added].map(|count| Some(count as f64));
        let rest = [None, pruned, added, Some(variant.seconds)];
        line(&record.clip, [&variant.name, &STEPS.to_string()], &variant.figures, rest)
    }));
    lines
}

fn line(clip: &str, [what, steps]: [&str; 2], means: &Means, rest: [Option<f64>; 4]) -> Vec<String> {
    let Means { psnr, ssim, lpips, dmae, psnr_dynamic, psnr_static } = *means;
    let values = [psnr, ssim, lpips, dmae, psnr_dynamic, psnr_static].into_iter().chain(rest);
    let texts = values.map(|value| value.map_or(String::new(), |value| value.to_string()));
    [clip, what, steps].map(str::to_owned).into_iter().chain(texts).collect()
}
