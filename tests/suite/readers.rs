//! What we write, read by programs that are not ours: plyfile and gsply from the Python package index.
//!
//! They run where `$LGS_PYTHON` names an interpreter that has both.

use std::collections::BTreeMap;
use std::path::Path;

use lgs_formats::cloud::{SH_DC, SplatCloud};
use lgs_formats::ply::read_ply;
use lgs_tests::process::{binary, run};
use lgs_tests::{Needed, Outcome, case_if, clips, places};
use libtest_mimic::Trial;
use serde_json::Value;

/// The steps of SPZ: positions (metres), log scales, opacities and colours after activation, components of a rotation.
const SPZ_STEPS: Steps = Steps { position: 1.3e-4, log_scale: 1.0 / 32.0, shade: 1.0 / 255.0, rotation: 0.01 };
/// SPZ holds colours from -2.9 to 3.9 only, and opacities from 0 to 1.
const SPZ_SHADES: std::ops::RangeInclusive<f32> = -2.8..=3.8;
/// Files of the sequence per second.
const RATE: f64 = 10.0;

struct Steps {
    position: f32,
    log_scale: f32,
    shade: f32,
    rotation: f32,
}

pub(crate) fn cases() -> Vec<Trial> {
    let python = places::python_with_readers();
    let needed = match &python {
        Some(path) if path.exists() => Needed::Here,
        _ => Needed::Missing("LGS_PYTHON, an interpreter with plyfile and gsply".to_owned()),
    };
    vec![case_if(&needed, "readers::plyfile_and_gsply_read_what_was_written", move || {
        python.map_or_else(|| Err("no interpreter".into()), |python| read_back(&python))
    })]
}

/// Columns by name.
type Columns = BTreeMap<String, Vec<f32>>;

fn read_back(python: &Path) -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    let (clip, words) =
        (clips::street(), ["--image-size", "96x160", "--views", "none", "--stg", "--spz", "--sequence", "10"]);
    let arguments = [clip.as_os_str(), "--out".as_ref(), out.as_os_str()].into_iter().chain(words.map(AsRef::as_ref));
    run(&binary("lgs-infer")?, &arguments.collect::<Vec<_>>(), place.path())?.expect_success()?;
    let script = places::repository().join("tests/support/readers.py");
    let finished = run(python, &[script.as_os_str(), out.as_os_str()], place.path())?;
    finished.expect_success()?;
    let said: Value = serde_json::from_str(&finished.stdout)?;
    let files = said["files"].as_object().ok_or("no files")?;
    let cloud = read_ply(&out.join("scene.ply"))?;
    let span = span_of(&clip)?;
    let times: Vec<f32> = (0_u8..5).map(|k| narrow(f64::from(span[0]) + f64::from(k) / RATE)).collect();
    let mut seen = 0;
    for (name, readers) in files {
        for (reader, names) in readers.as_object().into_iter().flatten() {
            let found = columns(&out.join(name), reader, names)?;
            let context = |e: String| format!("{name}, {reader}: {e}");
            match name.as_str() {
                "scene.ply" => equal(&found, &written(&cloud)).map_err(context)?,
                "scene_stg.ply" => equal(&found, &spacetime(&cloud, span)).map_err(context)?,
                "scene.spz" => near(&found, &cloud.at(0.0)).map_err(context)?,
                numbered => {
                    let index: usize = numbered.trim_start_matches("sequence/").trim_end_matches(".ply").parse()?;
                    equal(&found, &written(&cloud.at(times[index]))).map_err(context)?;
                }
            }
            seen += 1;
        }
    }
    if seen == 2 * (2 + times.len()) + 1 { Ok(()) } else { Err(format!("{seen} files were read: {files:?}").into()) }
}

/// What a reader found in a file.
fn columns(file: &Path, reader: &str, names: &Value) -> Result<Columns, String> {
    let path = format!("{}.{reader}.f32", file.display());
    let bytes = std::fs::read(&path).map_err(|e| format!("{path}: {e}"))?;
    let values: Vec<f32> = bytes.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
    let names: Vec<&str> = names.as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let length = values.len() / names.len().max(1);
    Ok(names
        .iter()
        .zip(values.chunks(length.max(1)))
        .map(|(name, column)| ((*name).to_owned(), column.to_vec()))
        .collect())
}

/// The columns that a cloud has in a file.
fn written(cloud: &SplatCloud) -> Columns {
    let mut all = Columns::new();
    let mut put = |names: &[&str], column: &dyn Fn(usize, usize) -> f32| {
        for (k, name) in names.iter().enumerate() {
            all.insert((*name).to_owned(), (0..cloud.len()).map(|i| column(i, k)).collect());
        }
    };
    put(&["x", "y", "z"], &|i, k| cloud.means[i][k]);
    put(&["nx", "ny", "nz"], &|_, _| 0.0);
    put(&["f_dc_0", "f_dc_1", "f_dc_2"], &|i, k| cloud.sh_dc[i][k]);
    put(&["opacity"], &|i, _| cloud.logit_opacities[i]);
    put(&["scale_0", "scale_1", "scale_2"], &|i, k| cloud.log_scales[i][k]);
    put(&["rot_0", "rot_1", "rot_2", "rot_3"], &|i, k| cloud.quats[i][k]);
    put(&["vx", "vy", "vz"], &|i, k| cloud.velocities[i][k]);
    put(&["t"], &|i, _| cloud.times[i]);
    put(&["frame"], &|i, _| cloud.frames.as_ref().map_or(f32::NAN, |frames| frames[i] as f32));
    all.extend(cloud.extra.iter().cloned());
    all
}

/// The first and the last moment of the clip's images, seconds since its first sweep.
fn span_of(clip: &Path) -> Result<[f32; 2], String> {
    let description = clips::description(clip)?;
    let frames = description["frames"].as_array().ok_or("no frames")?;
    let zero = frames[0]["lidar"]["timestamp"].as_f64().ok_or("no time")?;
    let images = frames.iter().flat_map(|frame| frame["cameras"].as_array().into_iter().flatten());
    let times: Vec<f32> = images.filter_map(|image| Some(narrow(image["timestamp"].as_f64()? - zero))).collect();
    Ok([times.iter().copied().fold(f32::INFINITY, f32::min), times.iter().copied().fold(f32::NEG_INFINITY, f32::max)])
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is the purpose")]
fn narrow(value: f64) -> f32 {
    value as f32
}

/// The columns of Spacetime Gaussians, whose time runs from 0 to 1 over the span.
fn spacetime(cloud: &SplatCloud, span: [f32; 2]) -> Columns {
    let length = span[1] - span[0];
    let mut all = written(cloud);
    all.insert("trbf_center".to_owned(), cloud.times.iter().map(|t| (t - span[0]) / length).collect());
    all.insert("trbf_scale".to_owned(), vec![5.0; cloud.len()]);
    let motion = |k: usize| cloud.velocities.iter().map(|v| if k < 3 { v[k] * length } else { 0.0 }).collect();
    all.extend((0..9).map(|k| (format!("motion_{k}"), motion(k))));
    all.extend((0..4).map(|k| (format!("omega_{k}"), vec![0.0; cloud.len()])));
    all
}

/// Fails unless every column that was found has the values that were written, to the bit.
fn equal(found: &Columns, want: &Columns) -> Result<(), String> {
    if found.len() < 14 {
        return Err(format!("columns {:?}", found.keys()));
    }
    for (name, column) in found {
        let want = want.get(name).ok_or_else(|| format!("a column {name}"))?;
        let same = |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits() || a == b;
        if column.len() != want.len() || !column.iter().zip(want).all(same) {
            let first = column.iter().zip(want).position(|pair| !same(pair));
            let values = first.map(|i| (i, column[i], want[i]));
            return Err(format!("{name}: {} values, want {}; first other: {values:?}", column.len(), want.len()));
        }
    }
    Ok(())
}

/// Fails unless an SPZ file has the splats of `cloud` that it can hold, in its own axes and within its steps.
fn near(found: &Columns, cloud: &SplatCloud) -> Result<(), String> {
    let column = |name: &str| found.get(name).ok_or_else(|| format!("no column {name}"));
    let [x, y, z] = [column("x")?, column("y")?, column("z")?];
    let scales = [column("scale_0")?, column("scale_1")?, column("scale_2")?];
    let colours = [column("f_dc_0")?, column("f_dc_1")?, column("f_dc_2")?];
    let opacities = column("opacity")?;
    let kept: Vec<usize> = (0..cloud.len()).filter(|&i| cloud.means[i].iter().all(|v| v.abs() <= 2047.0)).collect();
    if x.len() != kept.len() {
        return Err(format!("{} splats, want {}", x.len(), kept.len()));
    }
    let quats = [column("rot_0")?, column("rot_1")?, column("rot_2")?, column("rot_3")?];
    let sigmoid = |v: f32| 1.0 / (1.0 + (-v).exp());
    let within = |what: &str, i: usize, got: f32, want: f32, step: f32| {
        // what lies in the middle of two steps may go either way
        if (got - want).abs() <= 1.001 * step {
            Ok(())
        } else {
            Err(format!("{what} of {i}: got {got}, want {want} ± {step}"))
        }
    };
    for (k, &i) in kept.iter().enumerate() {
        for (got, want) in [x[k], y[k], z[k]].into_iter().zip(in_spz(cloud.means[i])) {
            within("position", i, got, want, SPZ_STEPS.position)?;
        }
        for axis in 0..3 {
            within("log scale", i, scales[axis][k], cloud.log_scales[i][axis].clamp(-10.0, 5.9), SPZ_STEPS.log_scale)?;
            let (got, want) = (colours[axis][k], cloud.sh_dc[i][axis]);
            if SPZ_SHADES.contains(&want) {
                within("colour", i, got * SH_DC, want * SH_DC, SPZ_STEPS.shade)?;
            }
        }
        within("opacity", i, sigmoid(opacities[k]), sigmoid(cloud.logit_opacities[i]), SPZ_STEPS.shade)?;
        let quat = quats.map(|part| part[k]);
        for axis in 0..3 {
            let (got, want) = (turned_axis(quat, axis), in_spz(turned_axis(cloud.quats[i], axis)));
            for (got, want) in got.into_iter().zip(want) {
                within("rotation", i, got, want, SPZ_STEPS.rotation)?;
            }
        }
    }
    Ok(())
}

/// A vector of the clip's axes (forward, left, up) in those of SPZ (right, up, back).
fn in_spz([forward, left, up]: [f32; 3]) -> [f32; 3] {
    [-left, up, -forward]
}

/// Where a rotation (w, x, y, z), of any length, takes an axis.
fn turned_axis([w, x, y, z]: [f32; 4], axis: usize) -> [f32; 3] {
    let square = w * w + x * x + y * y + z * z;
    let rows = [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ];
    rows.map(|row| row[axis] / square)
}
