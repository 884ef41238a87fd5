//! A film of the scene: pictures from places on a path.

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use lgs_engine::{
    allocator::available_bytes,
    gaussians::physical::Splat,
    pipeline::{MemorySettings, Need, Progress, Stage},
    recipe::Recipe,
    render::{Device, MemoryEstimate, Pass},
    views::{ClipFrame, PinholeView, Response, View, between, keys_of_camera, path_views},
};
use lgs_formats::casts::to_u32;
use lgs_formats::{
    camera::Camera,
    camera_path::{PathKey, PathLens, read_path},
    clip::Clip,
    exports::{self, write_animation},
    image::{RgbImage, write_png},
    pose::Pose,
};

use crate::args::{Args, PathArg};

/// Pictures of a path between input images when nobody says.
const PICTURES: usize = 48;
/// Pictures per second when nobody says.
const RATE: f32 = 12.0;
/// Colour behind all Gaussians.
const BEHIND: [f32; 3] = [0.0; 3];

/// A film that is to be taken.
#[derive(Clone, Debug)]
pub(crate) struct Film {
    views: Vec<PinholeView>,
    /// Pictures per second.
    rate: f32,
    /// Where they are drawn.
    device: Device,
}

impl Film {
    /// The film that the flags ask for, once it is known that it can be taken; `None` when they ask for none.
    pub(crate) fn plan(args: &Args, clip: &Clip, frame: &ClipFrame, inputs: &[View]) -> Result<Option<Self>> {
        let Some(path) = &args.path else { return Ok(None) };
        let camera = match &args.path_camera {
            Some(name) => name.clone(),
            None => inputs.first().map(|view| view.camera.clone()).unwrap_or_default(),
        };
        let Some(own) = inputs.iter().find(|view| view.camera == camera) else {
            let mut known: Vec<&str> = inputs.iter().map(|view| view.camera.as_str()).collect();
            known.sort_unstable();
            known.dedup();
            bail!("--path-camera: expected a camera of the input images ({}), found {camera}", known.join(", "));
        };
        let (keys, lens) = match path {
            PathArg::BetweenInputs => {
                let frames: Vec<usize> =
                    inputs.iter().filter(|view| view.camera == camera).map(|view| view.frame).collect();
                let keys = keys_of_camera(clip, &frames, &camera);
                if keys.len() < 2 {
                    bail!("--path: expected input images of {camera} at two moments or more, found {}", keys.len());
                }
                (between(&keys, args.path_frames.unwrap_or(PICTURES)), own.pinhole)
            }
            PathArg::File(file) => {
                let path = read_path(file)?;
                let keys = args.path_frames.map_or_else(|| path.keys.clone(), |count| between(&path.keys, count));
                (keys, path.lens.map_or(own.pinhole, |lens| pinhole(frame, lens, &path.keys[0])))
            }
        };
        check_size(&lens)?;
        let views = path_views(&keys, &lens, frame, args.at_time);
        let device = args.recipe.of(Recipe::default()).device();
        Ok(Some(Self { views, rate: args.path_fps.unwrap_or(RATE), device }))
    }

    /// Number of pictures.
    pub(crate) fn len(&self) -> usize {
        self.views.len()
    }

    /// Writes `path/00000.png`, `path/00001.png`, ... and all of them as `path.png`, which moves.
    pub(crate) fn write(
        &self,
        scene: &[Splat],
        shown: Option<Response>,
        out: &Path,
        progress: &dyn Progress,
    ) -> Result<()> {
        let Some(first) = self.views.first() else { return Ok(()) };
        if MemoryEstimate::of_splats(scene).check(&self.views, Pass::Images).is_err() {
            return Err(too_large(first));
        }
        let folder = out.join("path");
        std::fs::create_dir_all(&folder).with_context(|| format!("{}: make", folder.display()))?;
        let film = exports::Film {
            width: to_u32(first.width),
            height: to_u32(first.height),
            count: to_u32(self.views.len()),
            rate: self.rate,
        };
        progress.begin(Stage::Render, self.views.len());
        let written = write_animation(&out.join("path.png"), film, &mut |index| {
            let view = &self.views[index as usize];
            let mut drawn = self.device.render(scene, view, BEHIND);
            if let Some(response) = shown {
                response.show(&mut drawn.rgb, view);
            }
            let image = RgbImage { width: drawn.width, height: drawn.height, data: drawn.rgb };
            write_png(&folder.join(format!("{index:05}.png")), &image)?;
            progress.step(Stage::Render);
            Ok(image)
        });
        progress.end(Stage::Render);
        Ok(written?)
    }
}

/// The view of a camera that only its path knows.
fn pinhole(frame: &ClipFrame, lens: PathLens, key: &PathKey) -> PinholeView {
    frame.pinhole(&Camera {
        name: String::new(),
        timestamp: key.timestamp,
        width: lens.width,
        height: lens.height,
        intrinsics: lens.intrinsics,
        distortion: None,
        readout: None,
        world_from_camera: Pose::IDENTITY,
    })
}

/// Fails unless one picture fits into the memory that is free.
fn check_size(lens: &PinholeView) -> Result<()> {
    let need = Need::of(&[[lens.height, lens.width]], 0);
    if available_bytes().is_some_and(|available| need.check(available, MemorySettings::default()).is_err()) {
        return Err(too_large(lens));
    }
    Ok(())
}

fn too_large(lens: &PinholeView) -> anyhow::Error {
    let (h, w) = (lens.height, lens.width);
    anyhow!("--path: expected pictures that fit into the memory that is free, found {h}x{w} pixels")
}
