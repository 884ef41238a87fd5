//! The output directory: everything is made first and written in the end, file by file, each at once or not at all.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, bail};
use lgs_engine::{
    pipeline::{Figures, RenderedView},
    report::{PageView, Picture, PictureKind, ScoreKind},
    views::View,
};
use lgs_formats::{
    cloud::SplatCloud,
    digest::sha256,
    exports::{write_sequence, write_spz, write_stg},
    ply::{Higher, write_plain_ply, write_ply},
    write::{check_writable, write_atomic},
};
use rayon::prelude::*;

/// Widest picture in the report, pixels, as long as there are few.
const REPORT_WIDTH_PX: u32 = 640;
/// Number of views up to which pictures in the report stay that wide; beyond it the page keeps its size.
const WIDE_VIEWS: u32 = 16;
/// Longest camera name that becomes part of a file's name as it is, bytes.
const MAX_NAME: usize = 80;

/// The pictures of one view, encoded.
#[derive(Debug)]
pub(crate) struct ViewPictures {
    /// Names below `views/` and the bytes of PNG files.
    files: Vec<(String, Vec<u8>)>,
    /// The same, smaller, for the report.
    pub(crate) page: PageView,
}

/// The pictures of a rendered view, of which at most `max_width` pixels go into the report.
pub(crate) fn pictures_of(drawn: RenderedView<'_>, figures: Figures<'_>, max_width: u32) -> Result<ViewPictures> {
    let RenderedView { view, rendered, scores, .. } = drawn;
    let mut pictures = match figures {
        Figures::OfTruth { .. } => vec![
            Picture::of_truth(&view.image),
            Picture::of_render(rendered),
            Picture::of_error(rendered, view),
            Picture::of_depth(rendered),
        ],
        Figures::AtTime(_) => vec![Picture::of_render(rendered), Picture::of_depth(rendered)],
    };
    if let Some(scores) = scores {
        pictures.extend([ScoreKind::Prune, ScoreKind::Add].map(|kind| Picture::of_score(kind, rendered, scores)));
    }
    let encoded = |picture: &Picture| -> Result<_> {
        let name = picture_name(view, picture.kind);
        let context = || format!("views/{name}: encode");
        let (png, jpeg) = rayon::join(|| picture.png(), || picture.jpeg(max_width));
        let (png, jpeg) = (png.with_context(context)?, jpeg.with_context(context)?);
        Ok(((name, png), (picture.kind, jpeg)))
    };
    let (files, embedded) = pictures.par_iter().map(encoded).collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let size = pictures.first().map_or([0, 0], Picture::size);
    Ok(ViewPictures { files, page: PageView { size, pictures: embedded } })
}

/// How wide pictures in the report may be, pixels, so that it stays a few megabytes with any number of views.
pub(crate) fn report_width(num_views: usize) -> u32 {
    let num_views = u32::try_from(num_views).unwrap_or(u32::MAX);
    (REPORT_WIDTH_PX * REPORT_WIDTH_PX / num_views.max(1)).saturating_mul(WIDE_VIEWS).isqrt().clamp(96, REPORT_WIDTH_PX)
}

fn picture_name(view: &View, kind: PictureKind) -> String {
    format!("f{}_{}_{}.png", view.frame, safe_name(&view.camera), kind.name())
}

/// The name as part of a file's name: as it is when every system takes it, else cleaned, cut, and told apart by a hash.
pub(crate) fn safe_name(name: &str) -> String {
    let safe = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    if !name.is_empty() && name.len() <= MAX_NAME && name.chars().all(safe) && !name.starts_with('.') {
        return name.to_owned();
    }
    let cleaned: String = name.chars().take(MAX_NAME).map(|c| if safe(c) && c != '.' { c } else { '_' }).collect();
    let digest = sha256(name.as_bytes());
    format!("{cleaned}-{}", &digest[..8])
}

/// The output directory, once it is known that it is one or can become one and takes files. Nothing is made yet.
pub(crate) fn output_dir(asked: Option<&Path>, clip_name: &str) -> Result<PathBuf> {
    let out = asked.map_or_else(|| Path::new("out").join(safe_name(clip_name)), Path::to_owned);
    let existing = out.ancestors().find(|path| !path.as_os_str().is_empty() && path.exists());
    if let Some(other) = existing.filter(|path| !path.is_dir()) {
        bail!("--out: expected a directory, found another kind of file at {}", other.display());
    }
    check_writable(existing.unwrap_or_else(|| Path::new("."))).context("--out")?;
    Ok(out)
}

/// Everything that a run writes.
#[derive(Debug)]
pub(crate) struct Output<'a> {
    /// `scene.ply`.
    pub(crate) scene: &'a SplatCloud,
    /// `views/`.
    pub(crate) views: &'a [ViewPictures],
    /// `report.html`.
    pub(crate) report: &'a str,
    /// `viewer.html`, where it is wanted.
    pub(crate) viewer: Option<&'a str>,
    /// Files for other programs.
    pub(crate) exports: Exports,
    /// `metrics.json`, written last: where it is new, the rest is.
    pub(crate) metrics: &'a str,
}

/// Which files for other programs are wanted, beside or instead of `scene.ply`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Exports {
    /// `scene.ply` has the properties alone that every viewer knows.
    pub(crate) plain: Option<Higher>,
    /// Moment of what holds one moment only, seconds.
    pub(crate) moment: f32,
    /// First and last moment of what holds all, seconds.
    pub(crate) span: [f32; 2],
    /// Files per second of `sequence/`.
    pub(crate) sequence: Option<f32>,
    /// `scene_stg.ply`.
    pub(crate) stg: bool,
    /// `scene.spz`.
    pub(crate) spz: bool,
}

impl Exports {
    fn write(&self, out: &Path, scene: &SplatCloud) -> Result<()> {
        let ply = out.join("scene.ply");
        match self.plain {
            Some(higher) => write_plain_ply(&ply, &scene.at(self.moment), higher)?,
            None => write_ply(&ply, scene)?,
        }
        if let Some(rate) = self.sequence {
            write_sequence(&out.join("sequence"), scene, self.span, rate)?;
        }
        if self.stg {
            write_stg(&out.join("scene_stg.ply"), scene, self.span)?;
        }
        if self.spz {
            write_spz(&out.join("scene.spz"), &scene.at(self.moment))?;
        }
        Ok(())
    }
}

impl Output<'_> {
    /// Writes all files into `out`, which is made with its parents when it is missing.
    pub(crate) fn write(&self, out: &Path) -> Result<()> {
        let make = |path: &Path| fs::create_dir_all(path).with_context(|| format!("{}: make", path.display()));
        make(out)?;
        let views = out.join("views");
        if !self.views.is_empty() {
            make(&views)?;
        }
        let files: Vec<&(String, Vec<u8>)> = self.views.iter().flat_map(|view| &view.files).collect();
        let write_view = |(name, bytes): &&(String, Vec<u8>)| write_atomic(&views.join(name), bytes);
        let write_views = || files.par_iter().try_for_each(write_view);
        let (written, exported) = rayon::join(write_views, || self.exports.write(out, self.scene));
        written?;
        exported?;
        write_atomic(&out.join("report.html"), self.report.as_bytes())?;
        if let Some(viewer) = self.viewer {
            write_atomic(&out.join("viewer.html"), viewer.as_bytes())?;
        }
        write_atomic(&out.join("metrics.json"), self.metrics.as_bytes())?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_safe_and_stay_apart() {
        assert_eq!(safe_name("CAMERA_01"), "CAMERA_01");
        assert_eq!(safe_name("front.left-2"), "front.left-2");
        let strange = ["../../etc", "..", "", "a/b", "a\\b", "a b", "a_b ", "ä", &"x".repeat(300), &"x".repeat(301)];
        let names: std::collections::BTreeSet<String> = strange.iter().map(|name| safe_name(name)).collect();
        assert_eq!(names.len(), strange.len());
        for name in names {
            assert!(name.len() < 100 && !name.contains(['/', '\\', ' ', '.']), "{name}");
        }
    }

    #[test]
    fn the_report_keeps_its_size_when_views_become_many() {
        assert_eq!([1, 16, 64, 1_000_000].map(report_width), [640, 640, 320, 96]);
    }

    #[test]
    fn an_output_that_cannot_be_a_directory_is_refused_before_the_work() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("file");
        fs::write(&file, "x").unwrap();
        for out in [file.clone(), file.join("below")] {
            assert!(output_dir(Some(&out), "clip").unwrap_err().to_string().starts_with("--out: expected a directory"));
        }
        let new = place.path().join("new/out");
        assert_eq!(output_dir(Some(&new), "clip").unwrap(), new);
        assert!(!new.exists());
        assert_eq!(output_dir(None, "a clip").unwrap().parent(), Some(Path::new("out")));
    }
}
