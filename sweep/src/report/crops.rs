//! The same part of a held-out view as some configurations draw it.

use base64::{Engine, engine::general_purpose::STANDARD};
use lgs_targetgen::picture::escape;

use super::Chapter;
use crate::{error::Result, record::read_crop, table::Row};

/// Most configurations without a reference that are shown.
const MOST: usize = 4;

/// The pictures side by side: the truth, configurations from one end of the front to the other, and the reference after as long as the
/// last of them, and at its end.
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
fn chosen(rows: &[Row]) -> Vec<usize> {
    let with = |keep: &dyn Fn(&Row) -> bool| -> Vec<usize> {
        let mut found: Vec<usize> = (1..=rows.len()).filter(|&number| keep(&rows[number - 1])).collect();
        found.sort_by(|&a, &b| rows[a - 1].seconds.median.total_cmp(&rows[b - 1].seconds.median));
        found
    };
    let front = with(&|row| row.on_front && !row.setting.is_reference());
    let last = front.len().saturating_sub(1);
    let count = front.len().min(MOST);
    let mut shown: Vec<usize> = (0..count).map(|k| front[if count > 1 { k * last / (count - 1) } else { 0 }]).collect();
    let reference = with(&|row| row.setting.is_reference());
    let time = |number: usize| rows[number - 1].seconds.median;
    let as_long = shown.last().and_then(|&learned| {
        reference
            .iter()
            .copied()
            .min_by(|&a, &b| (time(a) - time(learned)).abs().total_cmp(&(time(b) - time(learned)).abs()))
    });
    shown.extend(as_long);
    shown.extend(reference.last().filter(|last| as_long != Some(**last)));
    shown
}
