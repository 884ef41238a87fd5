//! Every figure of every clip as one table of comma-separated values.

use std::fmt::Write as _;

use super::record::{ClipRecord, Means, Point};

/// The columns.
const HEAD: &str = "clip,what,steps,psnr,ssim,lpips,dmae,psnr_dynamic,psnr_static,loss,pruned,added,seconds";

/// The table; what is not defined is an empty field.
pub fn csv(records: &[&ClipRecord]) -> String {
    let mut text = format!("{HEAD}\n");
    for record in records {
        row(&mut text, &record.clip, ["initial Gaussians", "0"], &record.start, [None; 4]);
        let curves =
            [("learned", &record.learned), ("adam", &record.adam), ("adam from start", &record.adam_from_start)];
        for (what, curve) in curves {
            for point in curve {
                let Point { steps, figures, loss, seconds } = point;
                row(&mut text, &record.clip, [what, &steps.to_string()], figures, [*loss, None, None, Some(*seconds)]);
            }
        }
        for variant in &record.variants {
            let [pruned, added] = [variant.pruned, variant.added].map(|count| Some(count as f64));
            let steps = super::settings::STEPS.to_string();
            let rest = [None, pruned, added, Some(variant.seconds)];
            row(&mut text, &record.clip, [&variant.name, &steps], &variant.figures, rest);
        }
    }
    text
}

fn row(text: &mut String, clip: &str, [what, steps]: [&str; 2], means: &Means, rest: [Option<f64>; 4]) {
    let Means { psnr, ssim, lpips, dmae, psnr_dynamic, psnr_static } = *means;
    let quoted =
        if clip.contains([',', '"', '\n']) { format!("\"{}\"", clip.replace('"', "\"\"")) } else { clip.to_owned() };
    // Writing to a string cannot fail.
    let _ = write!(text, "{quoted},{what},{steps}");
    for value in [psnr, ssim, lpips, dmae, psnr_dynamic, psnr_static].into_iter().chain(rest) {
        let _ = write!(text, ",{}", value.map_or(String::new(), |value| value.to_string()));
    }
    text.push('\n');
}
