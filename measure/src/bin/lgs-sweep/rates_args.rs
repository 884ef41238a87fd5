//! Flags of `rates`.

use std::path::PathBuf;

use clap::Args;
use lgs_engine::{network::source::ModelSource, refine::adam::AdamRates};
use lgs_formats::image::ImageSize;
use lgs_measure::{ablate::rates::SearchSettings, clips::Choice};

/// Flags of `rates`.
#[derive(Clone, Debug, Args)]
pub(crate) struct RatesArgs {
    /// Clips to search on: clip directories, or directories of such; their odd frames are held out. Not those that results are told of
    #[arg(long, value_name = "DIR", required = true, num_args = 1..)]
    pub(crate) clips: Vec<PathBuf>,
    /// At most so many clips
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub(crate) count: usize,
    /// Size of their images
    #[arg(long, value_name = "HxW", default_value = "96x192")]
    pub(crate) image_size: ImageSize,
    /// At most so many frames of a clip
    #[arg(long, value_name = "N", default_value_t = 5)]
    pub(crate) frames: usize,
    /// At most so many cameras of a clip
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub(crate) cameras: usize,
    /// Weights whose prediction is optimised; `none`: the initial Gaussians are
    #[arg(long, value_name = "FILE|tiny|none", default_value = "none")]
    pub(crate) weights: ModelSource,
    /// Numbers of steps after which the held-out views are measured, ascending from 1 on
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_values_t = [30, 100])]
    pub(crate) marks: Vec<usize>,
    /// Factors by which rates are changed, one round for each
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_values_t = [3.0, 1.7])]
    pub(crate) factors: Vec<f64>,
    /// Directory of the record; a search that it holds goes on
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Threads [default: all cores]; the result does not depend on it
    #[arg(long, value_name = "N")]
    pub(crate) threads: Option<std::num::NonZeroUsize>,
}

impl RatesArgs {
    /// How a clip is read.
    pub(crate) fn choice(&self, dir: PathBuf) -> Choice {
        Choice {
            image_size: Some(self.image_size),
            num_frames: Some(self.frames),
            num_cameras: Some(self.cameras),
            ..Choice::new(dir)
        }
    }

    /// How the search goes, over scenes of these names.
    pub(crate) fn settings(&self, scenes: Vec<String>) -> SearchSettings {
        SearchSettings { marks: self.marks.clone(), factors: self.factors.clone(), begin: AdamRates::default(), scenes }
    }
}
