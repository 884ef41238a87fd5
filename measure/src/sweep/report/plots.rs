//! The plots of a clip.

use lgs_pages::{Axis, Scale, or_dash};

use super::plot::{Better, Dot, Plot};
use crate::{means::Means, sweep::table::PointRow};

/// A value of a row, where it is known.
type Value = fn(&PointRow) -> Option<f64>;

/// The plots of some rows, of figures that are known.
pub(super) fn plots(rows: &[PointRow]) -> String {
    let seconds = Axis::new("seconds of a reconstruction", Scale::Logarithmic);
    let even = |label| Axis::new(label, Scale::Even);
    let psnr: Value = |row| row.figures.psnr;
    let figures: [(&str, Value, Better); 3] = [
        ("PSNR (dB)", psnr, Better::Up),
        ("SSIM", |row| row.figures.ssim, Better::Up),
        ("LPIPS", |row| row.figures.lpips, Better::Down),
    ];
    let mut all = String::new();
    for (label, value, better) in figures {
        let title = format!("Time against {label}");
        let dots = dots(rows, |row| Some(row.seconds.median), value, |row| Some([row.seconds.q1, row.seconds.q3]));
        all += &Plot { title: &title, x: seconds, y: even(label), better, dots }.svg();
    }
    let costs: [(&str, &str, Value); 2] = [
        ("Memory against PSNR", "peak memory (MB)", |row| row.peak_rss_mb),
        ("Gaussians against PSNR", "Gaussians (thousands)", |row| Some(row.gaussians / 1e3)),
    ];
    for (title, label, cost) in costs {
        let dots = dots(rows, cost, psnr, |_| None);
        all += &Plot { title, x: even(label), y: even("PSNR (dB)"), better: Better::Up, dots }.svg();
    }
    format!("<div class=\"plots\">\n{all}</div>\n")
}

fn dots(rows: &[PointRow], x: Value, y: Value, spread: fn(&PointRow) -> Option<[f64; 2]>) -> Vec<Dot> {
    let dot = |(row, number): (&PointRow, usize)| {
        let (at_x, at_y) = (x(row)?, y(row)?);
        let reference_steps = row.setting.is_reference().then_some(row.setting.recipe.adam_passes);
        let name = format!("#{number} {}: {}", row.name, says(row));
        let series = rows.iter().position(|other| other.setting.differs_in_steps_only(&row.setting)).unwrap_or(0);
        Some(Dot { x: at_x, y: at_y, spread: spread(row), row: number, reference_steps, series, name })
    };
    rows.iter().zip(1..).filter_map(dot).collect()
}

fn says(row: &PointRow) -> String {
    let Means { psnr, ssim, .. } = row.figures;
    format!("{:.3} s, PSNR {} dB, SSIM {}", row.seconds.median, or_dash(psnr, 2), or_dash(ssim, 3))
}
