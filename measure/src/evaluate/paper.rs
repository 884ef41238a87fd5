//! The rows of the paper's tables.
//!
//! # Source
//! "Learning Gaussian Structure for feed-forward driving scene reconstruction", the comparisons on Waymo and on `PandaSet`.

use serde::Serialize;

use super::protocol::Name;

/// A row.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PaperRow {
    /// The method.
    pub method: &'static str,
    /// Values in the order of the columns; `None` where the paper has none.
    pub values: &'static [Option<f64>],
}

/// A table of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PaperTable {
    /// What was measured.
    pub data: &'static str,
    /// Keys of figures; [`SECONDS`] for the time of a reconstruction.
    pub columns: &'static [&'static str],
    /// The rows.
    pub rows: &'static [PaperRow],
}

/// The column of the seconds of a reconstruction.
pub const SECONDS: &str = "reconstruction_s";

const WAYMO: PaperTable = PaperTable {
    data: "Waymo Open Dataset, the scenes of DrivingRecon; other hardware",
    columns: &["psnr", "ssim", "lpips", "psnr_dynamic", "ssim_dynamic", "psnr_static", "ssim_static"],
    rows: &[
        row("LGM", &[Some(17.49), Some(0.47), Some(0.33), Some(17.79), Some(0.49), Some(15.37), Some(0.39)]),
        row("PixelSplat", &[Some(18.24), Some(0.56), Some(0.30), Some(18.63), Some(0.58), Some(16.96), Some(0.44)]),
        row("MVSplat", &[Some(19.00), Some(0.57), Some(0.28), Some(19.29), Some(0.58), Some(17.35), Some(0.47)]),
        row("L4GM", &[Some(17.63), Some(0.54), Some(0.31), Some(18.58), Some(0.56), Some(16.78), Some(0.43)]),
        row("DrivingRecon", &[Some(20.63), Some(0.61), Some(0.21), Some(20.97), Some(0.62), Some(19.70), Some(0.51)]),
        row(
            "GaussianSTORM",
            &[Some(25.40), Some(0.779), Some(0.189), Some(22.82), Some(0.635), Some(25.67), Some(0.785)],
        ),
        row("UniSplat", &[Some(26.28), Some(0.818), Some(0.150), Some(24.37), Some(0.711), Some(26.83), Some(0.825)]),
        row("LGS base", &[Some(23.40), Some(0.712), Some(0.207), Some(21.07), Some(0.614), Some(23.64), Some(0.743)]),
        row("LGS", &[Some(28.04), Some(0.885), Some(0.113), Some(26.54), Some(0.848), Some(28.22), Some(0.910)]),
    ],
};

const PANDASET: PaperTable = PaperTable {
    data: "PandaSet, the ten test logs of Flux4D; other hardware",
    columns: &["psnr_dynamic", "ssim_dynamic", "dmae_dynamic", "psnr", "ssim", "dmae", SECONDS],
    rows: &[
        row("EmerNeRF", &[Some(17.79), Some(0.411), Some(6.09), Some(22.80), Some(0.624), Some(4.24), Some(6000.0)]),
        row("DeSiRe-GS", &[Some(19.08), Some(0.477), Some(3.36), Some(22.25), Some(0.608), Some(24.89), Some(7200.0)]),
        row("DepthSplat", &[Some(16.87), Some(0.425), Some(6.18), Some(21.40), Some(0.595), Some(2.73), Some(0.87)]),
        row("L4GM", &[Some(17.36), Some(0.343), None, Some(19.38), Some(0.465), None, Some(0.32)]),
        row("STORM", &[Some(17.65), Some(0.367), Some(5.24), Some(20.79), Some(0.508), Some(4.80), Some(0.08)]),
        row("LGS base", &[Some(19.56), Some(0.500), Some(3.95), Some(21.23), Some(0.644), Some(2.35), Some(0.37)]),
        row("LGS", &[Some(22.43), Some(0.678), Some(2.06), Some(25.03), Some(0.762), Some(1.52), Some(1.92)]),
    ],
};

const OWN: &[&str] =
    &["psnr", "ssim", "lpips", "dmae", "psnr_dynamic", "ssim_dynamic", "psnr_static", "ssim_static", SECONDS];

const fn row(method: &'static str, values: &'static [Option<f64>]) -> PaperRow {
    PaperRow { method, values }
}

/// The paper's table of a protocol; `None` for one's own.
pub const fn paper_table(name: Name) -> Option<&'static PaperTable> {
    match name {
        Name::Waymo => Some(&WAYMO),
        Name::PandaSet => Some(&PANDASET),
        Name::Own => None,
    }
}

/// Keys of the columns of a protocol's table: those of the paper, and the seconds.
pub fn columns(name: Name) -> Vec<&'static str> {
    let mut columns = paper_table(name).map_or(OWN, |table| table.columns).to_vec();
    if !columns.contains(&SECONDS) {
        columns.push(SECONDS);
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::figures::kinds;

    #[test]
    fn every_row_has_a_value_or_none_for_each_column_and_every_column_is_known() {
        for table in [WAYMO, PANDASET] {
            assert!(table.rows.iter().all(|row| row.values.len() == table.columns.len()));
        }
        for name in [Name::Waymo, Name::PandaSet, Name::Own] {
            let known = |column: &&str| *column == SECONDS || kinds().iter().any(|kind| kind.key == *column);
            assert!(columns(name).iter().all(known));
        }
    }
}
