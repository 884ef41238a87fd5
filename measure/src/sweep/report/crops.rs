//! The same part of a held-out view as some configurations draw it.

use base64::{Engine, engine::general_purpose::STANDARD};
use lgs_pages::escape;

use super::Chapter;
use crate::{
    error::Result,
    sweep::{record::read_crop, table::PointRow},
};

/// Most configurations without a reference that are shown.
const MOST: usize = 4;

/// The pictures side by side: the truth, configurations from one end of the front to the other, and the reference after as long as the
/// last of them, and where it is best.
pub(super) fn crops(chapter: &Chapter<'_>, out: &std::path::Path) -> Result<String> {
    let mut figures = String::new();
    if let Some(truth) = &chapter.record.truth {
        figures += &figure("", "truth", &read_crop(out, truth)?);
    }
    for number in chosen(chapter.rows) {
        let row = &chapter.rows[number - 1];
        let Some(name) = &row.crop else { continue };
        let psnr = row.figures.psnr.map_or("–".to_owned(), |psnr| format!("{psnr:.2}"));
        let caption = format!("#{number} {}: {psnr} dB, {:.2} s", row.name, row.seconds.median);
        figures += &figure(&format!(" data-row=\"{number}\""), &caption, &read_crop(out, name)?);
    }
    Ok(format!("<div class=\"crops\">\n{figures}</div>\n"))
}

fn figure(attribute: &str, caption: &str, bytes: &[u8]) -> String {
    let (data, caption) = (STANDARD.encode(bytes), escape(caption));
    format!(
        "<figure{attribute}><img src=\"data:image/jpeg;base64,{data}\" alt=\"{caption}\"><figcaption>{caption}</figcaption></figure>\n"
    )
}

/// Numbers of the rows that are shown.
fn chosen(rows: &[PointRow]) -> Vec<usize> {
    let with = |keep: &dyn Fn(&PointRow) -> bool| -> Vec<usize> {
        let mut found: Vec<usize> = (1..=rows.len()).filter(|&number| keep(&rows[number - 1])).collect();
        found.sort_by(|&a, &b| rows[a - 1].seconds.median.total_cmp(&rows[b - 1].seconds.median));
        found
    };
    let best = |reference: bool| {
        let psnr = |number: usize| rows[number - 1].figures.psnr.unwrap_or(f64::NEG_INFINITY);
        with(&|row| row.setting.is_reference() == reference).into_iter().max_by(|&a, &b| psnr(a).total_cmp(&psnr(b)))
    };
    let mut learned = with(&|row| row.on_front && !row.setting.is_reference());
    if learned.is_empty() {
        learned.extend(best(false));
    }
    let (last, count) = (learned.len().saturating_sub(1), learned.len().min(MOST));
    let mut shown: Vec<usize> = (0..count).map(|k| learned[k * last / (count - 1).max(1)]).collect();
    let time = |number: usize| rows[number - 1].seconds.median;
    let as_long = shown.last().and_then(|&learned| {
        let apart = |number: usize| (time(number) - time(learned)).abs();
        let reference = with(&|row| row.setting.is_reference());
        reference.into_iter().min_by(|&a, &b| apart(a).total_cmp(&apart(b)))
    });
    shown.extend(as_long);
    shown.extend(best(true).filter(|best| as_long != Some(*best)));
    shown
}
