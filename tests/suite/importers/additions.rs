//! Masks and depth maps that a user has beside a public data set.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;

use lgs_formats::clip::DepthKind;
use lgs_formats::clip_dir::ClipDir;
use lgs_formats::image::{PixelLabel, write_depth_metres, write_depth_png, write_mask};
use lgs_tests::layouts::{FOREIGN, Foreign};
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;

/// Size of the fixtures' images.
const WIDTH: usize = 16;
const HEIGHT: usize = 12;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("importers::additions::come_into_the_clip_of_every_layout", come_into_the_clip_of_every_layout),
        case("importers::additions::that_fit_no_image_are_refused", that_fit_no_image_are_refused),
        case("importers::additions::that_are_damaged_are_refused", that_are_damaged_are_refused),
    ]
}

fn import(foreign: Foreign, place: &Path, flags: &[&str]) -> Result<Finished, String> {
    let source = foreign.path();
    let mut arguments: Vec<&OsStr> = vec!["import".as_ref(), foreign.layout.as_ref(), source.as_os_str()];
    arguments.extend(["--out", "clip"].iter().chain(flags).map(|flag| OsStr::new(*flag)));
    run(&binary("lgs-clip")?, &arguments, place)
}

/// A mask whose lower half shows the own vehicle, and a depth map for the images of two frames.
fn write_additions(place: &Path, camera: &str) -> Outcome {
    fs::create_dir(place.join("own"))?;
    let labels: Vec<PixelLabel> = (0..WIDTH * HEIGHT)
        .map(|pixel| if pixel / WIDTH >= HEIGHT / 2 { PixelLabel::Ignored } else { PixelLabel::Static })
        .collect();
    write_mask(&place.join(format!("own/{camera}.png")), WIDTH, HEIGHT, &labels)?;
    write_depth_metres(&place.join(format!("own/0000_{camera}.npy")), WIDTH, HEIGHT, &[4.0; WIDTH * HEIGHT])?;
    write_depth_png(&place.join(format!("own/0002_{camera}.png")), WIDTH, HEIGHT, &[8000; WIDTH * HEIGHT])?;
    Ok(())
}

const FLAGS: [&str; 6] = ["--masks", "own", "--depth", "own", "--depth-kind", "metric"];

fn come_into_the_clip_of_every_layout() -> Outcome {
    for foreign in FOREIGN {
        let place = tempfile::tempdir()?;
        write_additions(place.path(), foreign.camera)?;
        import(foreign, place.path(), &FLAGS)?.expect_success()?;
        let clip = ClipDir::open(&place.path().join("clip"))?;
        for frame in 0..3 {
            let labels = clip.load_image(frame, 0, None)?.labels.ok_or("no labels")?;
            let map = clip.load_depth(frame, 0, None)?;
            let inverse = map.as_ref().map(|map| (map.kind, map.inverse[WIDTH * 6 + 8]));
            let want = [Some((DepthKind::Metric, 0.25)), None, Some((DepthKind::Metric, 0.125))][frame];
            let ignored = labels.iter().filter(|label| **label == PixelLabel::Ignored).count();
            if inverse != want || labels[WIDTH * (HEIGHT - 1) + 8] != PixelLabel::Ignored || ignored > WIDTH * 9 {
                return Err(format!("{}, frame {frame}: {inverse:?}, {ignored} pixels ignored", foreign.layout).into());
            }
        }
    }
    Ok(())
}

fn that_fit_no_image_are_refused() -> Outcome {
    let [foreign, ..] = FOREIGN;
    let place = tempfile::tempdir()?;
    fs::create_dir(place.path().join("own"))?;
    let refused = |flags: &[&str], names: &[&str]| import(foreign, place.path(), flags)?.expect_refusal(names);
    refused(&FLAGS[..2], &["--masks", foreign.camera, "none"])?;
    refused(&FLAGS[2..], &["--depth", "0000_", foreign.camera, ".npy"])?;
    refused(&["--masks", "nowhere"], &["--masks", "nowhere"])?;
    refused(&["--depth", "own"], &["--depth-kind"])?;
    if place.path().join("clip").exists() { Err("a refused import left a clip".into()) } else { Ok(()) }
}

fn that_are_damaged_are_refused() -> Outcome {
    let [foreign, ..] = FOREIGN;
    let place = tempfile::tempdir()?;
    let camera = foreign.camera;
    write_additions(place.path(), camera)?;
    let half = |name: &str| {
        let path = place.path().join("own").join(name);
        let bytes = fs::read(&path)?;
        fs::write(path, &bytes[..bytes.len() / 2])
    };
    half(&format!("0002_{camera}.png"))?;
    import(foreign, place.path(), &FLAGS)?.expect_refusal(&["0002_", "image"])?;
    half(&format!("0000_{camera}.npy"))?;
    import(foreign, place.path(), &FLAGS)?.expect_refusal(&["0000_", "depth map", "truncated"])?;
    half(&format!("{camera}.png"))?;
    import(foreign, place.path(), &FLAGS)?.expect_refusal(&[&format!("{camera}.png"), "image"])?;
    let names: Vec<_> = fs::read_dir(place.path())?.flatten().map(|entry| entry.file_name()).collect();
    if names == ["own"] { Ok(()) } else { Err(format!("a refused import left {names:?}").into()) }
}
