//! The command line, parsed without side effects.

mod recipe;
#[cfg(test)]
mod tests;
mod values;

use std::{num::NonZeroUsize, path::PathBuf};

use clap::{Parser, builder::RangedU64ValueParser};
use lgs_cli::words;
use lgs_engine::{
    calibration::{Lenses, Mounts, Shutters},
    gaussians::motion::Motion,
    network::{shipped, source::ModelSource},
    photometry::Colours,
    pipeline::HoldOut,
    plan::Named,
    words::Words,
};
use lgs_formats::{frame_list::FrameList, image::ImageSize};

pub(crate) use recipe::RecipeArgs;
pub(crate) use values::{PathArg, ViewsArg, word};
use values::{budget, pictures, rate, seconds};

/// Largest number of threads that may be asked for.
const MAX_THREADS: u64 = 1024;

/// Reconstruct a driving clip as a dynamic 3D Gaussian scene, draw its views and measure them.
///
/// Reads a clip directory (`clip.json`, LiDAR sweeps, images) and writes `scene.ply`, `metrics.json`, pictures of the
/// views under `views/` and `report.html`.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(name = "lgs-infer", version, max_term_width = 110)]
pub(crate) struct Args {
    /// Clip directory: a folder with a `clip.json` of format lgs-clip/1, or a folder that `lgs-clip import` knows
    #[arg(value_name = "CLIP_DIR", required_unless_present_any = ["describe", "devices"])]
    pub(crate) clip_dir: Option<PathBuf>,

    /// Print the model of a config or of a weights file as a table and do nothing else [default: none]
    #[arg(long, value_name = "FILE", conflicts_with = "clip_dir")]
    pub(crate) describe: Option<PathBuf>,

    /// Print what can draw, a line each, as --device takes it, and do nothing else
    #[arg(long, conflicts_with_all = ["clip_dir", "describe"])]
    pub(crate) devices: bool,

    /// Folder to write to, made when it is missing [default: out/<name of the clip>]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,

    /// Network weights, a safetensors file; `tiny`: those that ship in the program, where it was built with some;
    /// `random:FILE.json`: weights of a model config drawn from --seed, for size and speed work; `none`: the scene is what the
    /// sweeps and the images say by themselves
    #[arg(long, value_name = "FILE|tiny|random:FILE.json|none", default_value = shipped::DEFAULT)]
    pub(crate) weights: ModelSource,

    /// A point on the measured front of speed and accuracy, which the flags given beside it change [default: what each flag says]
    #[arg(long, value_parser = words(Named::WORDS))]
    pub(crate) preset: Option<Named>,

    /// Seconds from the start of the program until the scene is finished: picks what is probably the best that fits, from recorded times;
    /// views are drawn and files written after it; with --weights tiny or none [default: none]
    #[arg(long, value_name = "S", value_parser = budget, conflicts_with = "preset")]
    pub(crate) time_budget: Option<f64>,

    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,

    /// Names of the cameras to use, separated by commas [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    pub(crate) cameras: Option<Vec<String>>,

    /// Size to which every image is brought: height x width, pixels [default: each image's own]
    #[arg(long, value_name = "HxW")]
    pub(crate) image_size: Option<ImageSize>,

    /// Frames to use: indices of the clip from 0 on and ranges with both ends, such as 0,2,5..8 [default: all]
    #[arg(long, value_name = "LIST")]
    pub(crate) frames: Option<FrameList>,

    /// Frames whose images and sweeps only the figures may see: a list as for --frames; `odd`: indices 1, 3, 5, ...;
    /// `every:N`: the N-th frame of the clip, the 2N-th and so on, which are the indices N-1, 2N-1, ...; `none`
    #[arg(long, value_name = "LIST|odd|every:N|none", default_value_t = HoldOut::Nothing)]
    pub(crate) hold_out: HoldOut,

    /// Where the velocities of the LiDAR Gaussians come from at first
    #[arg(long, value_parser = words(Motion::WORDS), default_value = Motion::default().word())]
    pub(crate) motion: Motion,

    /// Which lens distortion the images have: `auto`, what the clip states unless the returns say that the images were rectified before;
    /// `stated`
    #[arg(long, value_parser = words(Lenses::WORDS), default_value = Lenses::default().word())]
    pub(crate) lenses: Lenses,

    /// Where cameras are mounted: `auto`, where the clip states unless returns that two images of one camera, or of two of a rig, show look alike
    /// only when it is turned or moved; `stated`
    #[arg(long, value_parser = words(Mounts::WORDS), default_value = Mounts::default().word())]
    pub(crate) mounts: Mounts,

    /// When the rows of images are exposed: `auto`, when the clip states, and where it states no readout of a camera as its images one after
    /// the other tell; `stated`
    #[arg(long, value_parser = words(Shutters::WORDS), default_value = Shutters::default().word())]
    pub(crate) shutters: Shutters,

    /// Whether cameras that show the same places in other colours are brought to common ones: `auto` or `as-taken`
    #[arg(long, value_parser = words(Colours::WORDS), default_value = Colours::default().word())]
    pub(crate) colours: Colours,

    /// The camera to whose colours and mount the others are brought [default: the first; for mounts the one against which the others are
    /// least off]
    #[arg(long, value_name = "NAME")]
    pub(crate) reference_camera: Option<String>,

    /// Views to draw, measure and write: `all`, `held-out` or `none`
    #[arg(long, value_enum, default_value_t = ViewsArg::All)]
    pub(crate) views: ViewsArg,

    /// Write `scene.ply` for viewers that know plain 3D Gaussian splatting only: without velocities, times and scores, everything
    /// where it is at --at-time, or at time 0
    #[arg(long)]
    pub(crate) plain: bool,

    /// As --plain, with 45 further columns `f_rest_0` to `f_rest_44` of zeros, without which SIBR and plugins of Unity read no file
    #[arg(long)]
    pub(crate) f_rest: bool,

    /// Write `sequence/00000.ply`, `00001.ply`, ... too: plain files for players of 4D scenes, this many for each second between
    /// the first and the last input image [default: none]
    #[arg(long, value_name = "FPS", value_parser = rate)]
    pub(crate) sequence: Option<f32>,

    /// Write `scene_stg.ply` too, with the properties of Spacetime Gaussians (`motion_*`, `trbf_*`); needs input images of more
    /// than one moment
    #[arg(long)]
    pub(crate) stg: bool,

    /// Write `scene.spz` too, a small file for web viewers, everything where it is at --at-time, or at time 0
    #[arg(long)]
    pub(crate) spz: bool,

    /// Write `viewer.html` too: one file that shows the scene in a browser, with a time slider and the cameras as stops
    #[arg(long)]
    pub(crate) viewer: bool,

    /// Take a film too, `path.png` (moving, for browsers) and its pictures `path/00000.png`, ...: `between-inputs`: along the input
    /// images of one camera; or the camera path of a JSON file of format lgs-path/1 [default: none]
    #[arg(long, value_name = "FILE|between-inputs")]
    pub(crate) path: Option<PathArg>,

    /// Pictures of the film, 1 to 10000, at even steps along the path, smooth between its places [default: 48 between inputs, one for
    /// each pose of a file]
    #[arg(long, value_name = "N", requires = "path", value_parser = pictures)]
    pub(crate) path_frames: Option<usize>,

    /// Camera whose input images the path goes along, and whose size and lens the film has, unless the file says [default: the first]
    #[arg(long, value_name = "NAME", requires = "path")]
    pub(crate) path_camera: Option<String>,

    /// Pictures per second of the film [default: 12]
    #[arg(long, value_name = "F", requires = "path", value_parser = rate)]
    pub(crate) path_fps: Option<f32>,

    /// Draw every view at this moment, seconds since the first input sweep, instead of at its image's own, and
    /// every picture of a film; there is no truth to measure against then [default: each image's own]
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    pub(crate) at_time: Option<f32>,

    /// Weights of LPIPS v0.1 with its squeeze trunk, a safetensors file [default: none, and LPIPS is not measured]
    #[arg(long, value_name = "FILE")]
    pub(crate) lpips_weights: Option<PathBuf>,

    /// Threads to work with, 1 to 1024; the result does not depend on it [default: one per core]
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(1..=MAX_THREADS))]
    threads: Option<u64>,

    /// Seed of everything that is drawn at random, recorded in metrics.json
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,

    /// Print the content of metrics.json to standard output instead of a summary
    #[arg(long)]
    pub(crate) json: bool,
}

impl Args {
    /// The number of threads that was asked for.
    pub(crate) fn threads(&self) -> Option<NonZeroUsize> {
        self.threads.and_then(|count| usize::try_from(count).ok()).and_then(NonZeroUsize::new)
    }
}
