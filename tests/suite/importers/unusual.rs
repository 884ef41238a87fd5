//! Folders as people keep them: other endings, files of editors and systems between the data, no images at all.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use lgs_tests::layouts::{Foreign, foreign};
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;

/// Where the importers look for images themselves, without a table that names them.
const LISTED: [(&str, &str); 3] = [
    ("kitti-raw", "2020_09_13/2020_09_13_drive_0001_sync/image_02/data"),
    ("av2", "sensors/cameras/ring_front_center"),
    ("pandaset", "camera/front_camera"),
];

pub(crate) fn cases() -> Vec<Trial> {
    let listed = |(layout, images): (&'static str, &'static str)| {
        case(format!("importers::unusual::{layout}_images_by_other_endings"), move || other_endings(layout, images))
    };
    let mut cases: Vec<Trial> = LISTED.into_iter().map(listed).collect();
    cases.extend([
        case("importers::unusual::files_between_the_data", files_between_the_data),
        case("importers::unusual::texts_with_a_mark_of_utf8", texts_with_a_mark),
        case("importers::unusual::a_folder_without_images", a_folder_without_images),
        case("importers::unusual::another_layout_is_named", another_layout_is_named),
        case("importers::unusual::two_drives_are_named", two_drives_are_named),
        case("importers::unusual::a_file_is_no_folder", a_file_is_no_folder),
        case("importers::unusual::a_folder_within_itself", a_folder_within_itself),
        case("importers::unusual::outputs_that_cannot_be", outputs_that_cannot_be),
        case("importers::unusual::a_scene_becomes_a_page", a_scene_becomes_a_page),
    ]);
    cases
}

/// A copy of a folder of `layout` in `place`, and the layout.
fn copied(layout: &str, place: &Path) -> Result<(Foreign, PathBuf), Box<dyn std::error::Error>> {
    let (foreign, source) = (foreign(layout)?, place.join("source"));
    clips::copy(&foreign.path(), &source)?;
    Ok((foreign, source))
}

fn clip_program(arguments: &[&OsStr], place: &Path) -> Result<Finished, String> {
    run(&binary("lgs-clip")?, arguments, place)
}

fn import(layout: &str, source: &Path, out: &Path) -> Result<Finished, String> {
    let arguments = ["import".as_ref(), layout.as_ref(), source.as_os_str(), "--out".as_ref(), out.as_os_str()];
    clip_program(&arguments, source.parent().unwrap_or(source))
}

/// Fails unless an import took the three images and said nothing else.
fn expect_images(finished: &Finished) -> Outcome {
    finished.expect_success()?;
    let took = finished.stdout.contains("3 frames, 3 images") && finished.stderr.is_empty();
    if took { Ok(()) } else { Err(format!("{}{}", finished.stdout, finished.stderr).into()) }
}

fn other_endings(layout: &str, images: &str) -> Outcome {
    for ending in ["PNG", "JPEG", "Jpg"] {
        let place = tempfile::tempdir()?;
        let (_, source) = copied(layout, place.path())?;
        for entry in fs::read_dir(source.join(images))? {
            let path = entry?.path();
            if path.extension().is_some_and(|found| found == "png" || found == "jpg") {
                fs::rename(&path, path.with_extension(ending))?;
            }
        }
        expect_images(&import(layout, &source, &place.path().join("out"))?)?;
    }
    Ok(())
}

fn files_between_the_data() -> Outcome {
    let place = tempfile::tempdir()?;
    for (layout, images) in LISTED {
        let (_, source) = copied(layout, place.path())?;
        let images = source.join(images);
        let above = images.parent().ok_or("no folder above")?.to_owned();
        for stray in [above.join(".DS_Store"), above.join("image_02.zip"), above.join("notes.txt")] {
            fs::write(stray, "x")?;
        }
        for stray in ["._0000000000.png", "Thumbs.db", ".1600000000030000000.png", "._00.jpg"] {
            fs::write(images.join(stray), "x")?;
        }
        expect_images(&import(layout, &source, &place.path().join("out"))?)?;
        fs::remove_dir_all(source)?;
        fs::remove_dir_all(place.path().join("out"))?;
    }
    Ok(())
}

/// Editors of one system put three bytes before every text.
fn texts_with_a_mark() -> Outcome {
    let mark = |path: PathBuf| {
        let bytes = fs::read(&path)?;
        fs::write(path, [b"\xef\xbb\xbf".as_slice(), &bytes].concat())
    };
    let place = tempfile::tempdir()?;
    for (layout, text) in
        [("dgp", "scene_0.json"), ("kitti-raw", "2020_09_13/2020_09_13_drive_0001_sync/velodyne_points/timestamps.txt")]
    {
        let (_, source) = copied(layout, place.path())?;
        mark(source.join(text))?;
        expect_images(&import(layout, &source, &place.path().join("out"))?)?;
        fs::remove_dir_all(source)?;
        mark(place.path().join("out/clip.json"))?;
        let arguments = ["inspect".as_ref(), "out".as_ref()];
        clip_program(&arguments, place.path())?.expect_success()?;
        fs::remove_dir_all(place.path().join("out"))?;
    }
    Ok(())
}

/// It can be imported and looked at, and every program says in one line that there is nothing to colour with.
fn a_folder_without_images() -> Outcome {
    let place = tempfile::tempdir()?;
    let (_, source) = copied("av2", place.path())?;
    fs::remove_dir_all(source.join("sensors/cameras"))?;
    let imported = import("av2", &source, &place.path().join("out"))?;
    imported.expect_success()?;
    if imported.stderr.lines().count() != 1 || !imported.stderr.contains("no images") {
        return Err(format!("an import of no images said {:?}", imported.stderr).into());
    }
    if imported.stdout.contains("contact-sheet") {
        return Err(format!("a sheet of no images is proposed: {}", imported.stdout).into());
    }
    let arguments = ["inspect", "out", "--contact-sheet", "sheet.png"].map(OsStr::new);
    let inspected = clip_program(&arguments, place.path())?;
    let says = ["LiDAR", "no images", "not written"].iter().all(|word| inspected.stdout.contains(word));
    if inspected.code != Some(1) || !says || place.path().join("sheet.png").exists() {
        return Err(format!("exit {:?}: {}{}", inspected.code, inspected.stdout, inspected.stderr).into());
    }
    let arguments = ["out", "--out", "scene", "--weights", "none"];
    run(&binary("lgs-infer")?, &arguments, place.path())?.expect_refusal(&["an image in an input frame"])
}

fn another_layout_is_named() -> Outcome {
    let place = tempfile::tempdir()?;
    let (_, source) = copied("kitti-raw", place.path())?;
    let finished = import("pandaset", &source, &place.path().join("out"))?;
    finished.expect_refusal(&["source", "layout", "those of kitti-raw"])
}

fn two_drives_are_named() -> Outcome {
    let place = tempfile::tempdir()?;
    let (_, source) = copied("kitti-raw", place.path())?;
    let date = source.join("2020_09_13");
    clips::copy(&date.join("2020_09_13_drive_0001_sync"), &date.join("2020_09_13_drive_0002_sync"))?;
    let names = ["drive_0001_sync", "drive_0002_sync", "found 2"];
    let arguments = ["inspect".as_ref(), date.as_os_str()];
    clip_program(&arguments, place.path())?.expect_refusal(&names)?;
    expect_images(&import("kitti-raw", &date.join("2020_09_13_drive_0002_sync"), &place.path().join("out"))?)
}

fn a_file_is_no_folder() -> Outcome {
    let place = tempfile::tempdir()?;
    fs::write(place.path().join("clip"), "x")?;
    let arguments = ["inspect".as_ref(), "clip".as_ref()];
    clip_program(&arguments, place.path())?.expect_refusal(&["clip", "expected a folder", "found a file"])
}

#[cfg(unix)]
fn a_folder_within_itself() -> Outcome {
    let place = tempfile::tempdir()?;
    let (_, source) = copied("kitti-raw", place.path())?;
    std::os::unix::fs::symlink(&source, source.join("again"))?;
    std::os::unix::fs::symlink(&source, source.join("2020_09_13/again"))?;
    expect_images(&import("kitti-raw", &source, &place.path().join("out"))?)?;
    let own = place.path().join("own");
    std::os::unix::fs::symlink(&own, &own)?;
    import("av2", &own, &place.path().join("other"))?.expect_refusal(&["own"])
}

#[cfg(not(unix))]
fn a_folder_within_itself() -> Outcome {
    Ok(())
}

/// A file, what is below one, a link to nowhere, and a device as a picture.
fn outputs_that_cannot_be() -> Outcome {
    let place = tempfile::tempdir()?;
    let (_, source) = copied("dgp", place.path())?;
    fs::write(place.path().join("file"), "mine")?;
    import("dgp", &source, &place.path().join("file"))?.expect_refusal(&["--out", "found a file"])?;
    import("dgp", &source, &place.path().join("file/below"))?.expect_refusal(&["file"])?;
    if fs::read_to_string(place.path().join("file"))? != "mine" {
        return Err("the refused import changed a file".into());
    }
    #[cfg(unix)]
    {
        let link = place.path().join("link");
        std::os::unix::fs::symlink(place.path().join("nowhere"), &link)?;
        import("dgp", &source, &link)?.expect_refusal(&["link", "--out", "found a link"])?;
        let socket = place.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket)?;
        let arguments = ["inspect".as_ref(), source.as_os_str(), "--contact-sheet".as_ref(), socket.as_os_str()];
        clip_program(&arguments, place.path())?.expect_refusal(&["socket", "special file"])?;
    }
    Ok(())
}

fn a_scene_becomes_a_page() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = clips::street();
    let flags = ["--weights", "none", "--frames", "0", "--views", "none", "--background", "off", "--out", "scene"];
    let arguments: Vec<&OsStr> = std::iter::once(clip.as_os_str()).chain(flags.map(OsStr::new)).collect();
    run(&binary("lgs-infer")?, &arguments, place.path())?.expect_success()?;
    let view = |words: &[&str]| clip_program(&words.iter().map(OsStr::new).collect::<Vec<_>>(), place.path());
    view(&["view", "scene/scene.ply"])?.expect_success()?;
    view(&["view", "scene/scene.ply", "--out", "page.html"])?.expect_success()?;
    let page = fs::read_to_string(place.path().join("page.html"))?;
    let complete = ["forward", "overview"].iter().all(|stop| page.contains(stop));
    if !complete || fs::read_to_string(place.path().join("scene/scene.html"))? != page {
        return Err("no page, or two pages of one scene".into());
    }
    view(&["view", "scene/scene.ply", "--out", "scene/scene.ply"])?.expect_refusal(&["--out", "another file"])?;
    view(&["view", "page.html"])?.expect_refusal(&["page.html"])?;
    view(&["view", "none.ply"])?.expect_refusal(&["none.ply"])
}
