//! Returns that are of no surface, added to a street, change next to nothing of its scene and figures.

use std::f32::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};

use lgs_formats::clip_dir::ClipDir;
use lgs_formats::sweep::read_sweep;
use lgs_tests::{Outcome, case, clips, metrics};
use libtest_mimic::{Failed, Trial};

use crate::street;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("returns::strays::drops_in_the_air", || changes_nothing("alone", &drops)),
        case("returns::strays::zeros", || changes_nothing("at_sensor", &|_| vec![[0.0; 3]; 100])),
        case("returns::strays::echoes_of_the_own_vehicle", || changes_nothing("at_sensor", &echoes)),
        case("returns::strays::rows_without_a_return", || changes_nothing("missing", &|_| vec![[f32::NAN; 3]; 500])),
        case("returns::strays::returns_from_kilometres_away", || changes_nothing("out_of_reach", &kilometres)),
        case("returns::strays::a_street_has_none", a_street_has_none),
    ]
}

/// Largest loss of PSNR, decibels, and of depth, metres.
const MOST: f64 = 0.1;

/// Numbers from 0 to 1 that look like chance.
fn share(index: usize, step: f32) -> f32 {
    ((index as f32 + 1.0) * step).fract()
}

/// Ten drops between the sensor and what ten of its beams meet, 2 to 12 m away.
fn drops(points: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let range = |p: &[f32; 3]| p.iter().map(|v| v * v).sum::<f32>().sqrt();
    let ahead: Vec<&[f32; 3]> = points.iter().filter(|p| p[0] > p[1].abs() && range(p) > 18.0).collect();
    let drop = |k: usize| {
        let beam = ahead[k * ahead.len() / 10];
        let share = (2.0 + 10.0 * share(k, 0.618_034)) / range(beam);
        beam.map(|v| v * share)
    };
    (0..10).map(drop).collect()
}

/// Thirty echoes around the sensor, nearer than its vehicle's skin.
fn echoes(_: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let echo = |k: usize| {
        let [turn, tilt] = [2.0 * PI * share(k, 0.618_034), 0.5 * PI * (share(k, 0.754_877_7) - 0.5)];
        let range = 0.1 + 0.35 * share(k, 0.569_84);
        [turn.cos() * tilt.cos(), turn.sin() * tilt.cos(), tilt.sin()].map(|v| v * range)
    };
    (0..30).map(echo).collect()
}

/// Five returns at 5 km, along beams that go ahead.
fn kilometres(points: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let ahead: Vec<&[f32; 3]> = points.iter().filter(|p| p[0] > 2.0 * p[1].abs()).collect();
    let far = |k: usize| {
        let beam = ahead[k * ahead.len() / 5];
        let range = beam.iter().map(|v| v * v).sum::<f32>().sqrt();
        beam.map(|v| v * 5000.0 / range)
    };
    (0..5).map(far).collect()
}

/// What is added to the returns of a sweep, or stands in their place.
type More<'a> = &'a dyn Fn(&[[f32; 3]]) -> Vec<[f32; 3]>;

/// A copy of the street whose sweeps, held-out ones included, have more rows, among the others.
fn with(more: More<'_>, place: &Path) -> Result<PathBuf, Failed> {
    let copy = place.join("clip");
    clips::copy(&clips::street(), &copy)?;
    for frame in &ClipDir::open(&copy)?.clip().frames {
        let file = copy.join(&frame.lidar.file);
        let sweep = read_sweep(&file)?;
        let mut rows: Vec<[f32; 3]> = sweep.points.clone();
        let added = more(&sweep.points);
        for (k, row) in added.iter().enumerate() {
            rows.insert(k * rows.len() / added.len(), *row);
        }
        let bytes = rows.iter().flat_map(|&[x, y, z]| [x, y, z, 0.0]).flat_map(f32::to_le_bytes);
        fs::write(&file, bytes.collect::<Vec<u8>>())?;
    }
    Ok(copy)
}

fn changes_nothing(kind: &str, more: More<'_>) -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = with(more, place.path())?;
    for (weights, want) in [("none", street::without_network()?), ("tiny", street::with_network()?)] {
        let got = street::half_size_of(&clip, &["--weights", weights])?;
        let [psnr, dmae] = ["psnr", "dmae"].map(|figure| {
            let value = |found| metrics::number(found, &["mean", "held_out", figure]);
            value(&got).and_then(|got| Ok(got - value(want)?))
        });
        let (psnr, dmae) = (psnr?, dmae?);
        if psnr < -MOST || dmae > MOST {
            return Err(format!("weights {weights}: {psnr} dB, depth error {dmae} m").into());
        }
        let dropped = metrics::number(&got, &["dropped_returns", kind])?;
        if dropped < 1.0 {
            return Err(format!("{dropped} returns are `{kind}` in metrics.json").into());
        }
    }
    Ok(())
}

fn a_street_has_none() -> Outcome {
    let found = street::without_network()?;
    if found["dropped_returns"].is_null() { Ok(()) } else { Err(found["dropped_returns"].to_string().into()) }
}
