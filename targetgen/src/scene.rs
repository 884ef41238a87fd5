//! From a clip directory to the scene as predicted before the policy, with the views that it is compared with.

use std::path::Path;
use std::sync::Arc;

use half::f16;
use lgs_engine::error::EngineError;
use lgs_engine::gaussians::{GaussianSet, background::Mode};
use lgs_engine::network::model::Model;
use lgs_engine::ops::tensors::with_values;
use lgs_engine::pipeline::{MemorySettings, Opening, Run, Session, Silent, Watch};
use lgs_engine::predict::{backbone, predict, query};
use lgs_engine::render::{MemoryEstimate, Pass};
use lgs_engine::views::{Selection, View};
use lgs_formats::clip_dir::{ClipDir, Needed};
use lgs_formats::image::ImageSize;
use lgs_formats::targets::{HalfFeatures, TargetsConfig};

use crate::error::{Result, TargetError};

/// A scene before the policy.
#[derive(Clone, Debug)]
pub struct PredictedScene {
    /// The Gaussians of both branches.
    pub set: GaussianSet,
    /// Every view of the clip, all of them inputs.
    pub views: Vec<View>,
    /// Decoder features of the `LiDAR` branch, when they were asked for.
    pub features: Option<HalfFeatures>,
}

/// The scene of a clip: the initial set or, with a model, what its first pass predicts from it.
///
/// # Errors
/// Whatever is wrong with the clip, features that are asked for without a model, and more work than there is memory for.
pub fn load_scene(clip: &Path, config: &TargetsConfig, model: Option<&Model>) -> Result<PredictedScene> {
    let needed = Needed { frames: None, cameras: config.cameras.clone() };
    let dir = ClipDir::open_part(clip, &needed).map_err(TargetError::Format)?;
    let image_size = config.image_size.map(|[height, width]| ImageSize { height, width });
    let selection = Selection { cameras: config.cameras.clone(), image_size, ..Selection::default() };
    let memory = MemorySettings { images: "image-size", returns: "CLIPS" };
    let mut watch = Watch::new(&Silent);
    let session = Session::open(Arc::new(dir), Opening { memory, ..Opening::of(selection) }, &mut watch)?;
    let mut set = session.run(&Run::initial(Mode::Auto.into()), &mut watch)?.scene;
    let features = match model {
        Some(model) => predict_in_place(&mut set, model, config.with_features)?,
        None if config.with_features => {
            return Err(TargetError::unfit("with-features", "`weights` of a network", "none"));
        }
        None => None,
    };
    let views = session.into_views();
    MemoryEstimate::of_set(&set).check(views.iter().map(|view| &view.pinhole), Pass::Gradient)?;
    Ok(PredictedScene { set, views, features })
}

/// The network's first prediction; the policy and the refinement do not run.
fn predict_in_place(set: &mut GaussianSet, model: &Model, keep: bool) -> Result<Option<HalfFeatures>> {
    let mut features = backbone(set, model)?;
    query(&mut features, set, model)?;
    let kept = keep.then(|| -> Result<HalfFeatures> {
        let bits = with_values([&features], |[values]| {
            Ok(values.iter().map(|&value| f16::from_f32(value).to_bits()).collect())
        });
        Ok(HalfFeatures { width: model.config.unet.width(), bits: bits.map_err(EngineError::from)? })
    });
    let kept = kept.transpose()?;
    predict(set, &features, model)?;
    Ok(kept)
}
