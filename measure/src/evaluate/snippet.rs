//! A snippet: opened, reconstructed by each recipe, and, when all scenes are final, drawn and measured on the frames that were held out.

use std::{path::Path, sync::Arc, time::Instant};

use lgs_engine::{
    allocator,
    evaluate::{ViewFigures, copying, dmae::dmae, lpips::Lpips, masks::dynamic_pixels},
    export::{Shown, stop, to_cloud},
    gaussians::physical::to_physical,
    network::model::Model,
    pipeline::{Drawing, Opening, Reconstruction, RenderedView, Run, Session, Silent, Watch, evaluate_views},
    recipe::Recipe,
    render::Device,
    report::{Picture, PictureKind},
    views::{Selection, View},
};
use lgs_formats::{clip_dir::ClipDir, jobs::Made, ply, viewer};

use super::{
    figures::Figures,
    protocol::{Protocol, Snippet},
    record::{RunRecord, ShownView, SnippetRecord, ViewRecord},
    scene_page::{VIEWER, in_a_log},
    times::SnippetTimes,
};
use crate::error::{MeasureError, Result};

/// Widest picture that is kept, pixels.
const WIDTH_PX: u32 = 640;

/// A recipe and what results call it.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedRecipe {
    /// Its name.
    pub name: String,
    /// The recipe.
    pub recipe: Recipe,
}

/// How every snippet is evaluated.
#[derive(Debug)]
pub struct Evaluator<'a> {
    /// The protocol.
    pub protocol: &'a Protocol,
    /// The recipes.
    pub recipes: &'a [NamedRecipe],
    /// The network; `None` without one.
    pub model: Option<&'a Model>,
    /// LPIPS; `None` where it is not measured.
    pub lpips: Option<&'a Lpips>,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// Whether scenes are kept.
    pub scenes: bool,
    /// Whether pages are kept that show the scenes.
    pub viewer: bool,
    /// Threads that work.
    pub threads: usize,
}

/// A view, drawn and measured.
struct Measured {
    record: ViewRecord,
    size: [u32; 2],
    /// Name and bytes of each picture; none where they are not wanted.
    pictures: Vec<(String, Vec<u8>)>,
}

impl Evaluator<'_> {
    /// What is kept of a snippet, and what it took.
    ///
    /// # Errors
    /// Whatever is wrong with its files; those of the pipeline; a scene that draws a value that is not finite.
    pub fn evaluate(&self, log: &str, dir: Arc<ClipDir>, snippet: &Snippet) -> Result<(Made, SnippetTimes)> {
        let start = Instant::now();
        let Protocol { cameras, image_size, .. } = self.protocol;
        let selection = Selection {
            cameras: cameras.clone(),
            frames: Some(snippet.frames()),
            hold_out: snippet.targets.clone(),
            image_size: *image_size,
        };
        let session = Session::open(dir, Opening::of(selection), &mut Watch::new(&Silent))?;
        let load_s = start.elapsed().as_secs_f64();
        let scenes: Vec<Reconstruction> =
            self.recipes.iter().map(|named| self.run(&session, named)).collect::<Result<_>>()?;
        let start = Instant::now();
        let held_out = session.held_out(&mut Watch::new(&Silent))?;
        let (mut runs, mut files, mut shown) = (Vec::new(), Vec::new(), None);
        for (index, (named, made)) in self.recipes.iter().zip(&scenes).enumerate() {
            let is_last = index + 1 == self.recipes.len();
            let measured = self.measure(&session, made, &held_out, is_last)?;
            if let Some(worst) = worst(&measured).filter(|_| is_last) {
                files.extend(worst.pictures.iter().cloned());
                let ViewRecord { frame, camera, .. } = worst.record.clone();
                shown = Some(ShownView { frame, camera, size: worst.size });
            }
            let views = measured.into_iter().map(|measured| measured.record).collect();
            runs.push(RunRecord { recipe: named.name.clone(), gaussians: made.counts.into(), views });
            files.extend(self.files_of_scene(&session, named, made, is_last)?);
        }
        let record = SnippetRecord {
            log: log.to_owned(),
            inputs: snippet.inputs.clone(),
            targets: snippet.targets.clone(),
            runs,
            shown,
        };
        let times = SnippetTimes {
            load_s,
            reconstruction_s: scenes.iter().map(|made| made.seconds).collect(),
            evaluate_s: start.elapsed().as_secs_f64(),
            peak_rss_mb: allocator::peak_rss_mb(),
            threads: self.threads,
            drawn_on: self.recipes.iter().map(|named| named.recipe.device().drawn_on()).collect(),
        };
        let record = serde_json::to_value(record).map_err(|source| MeasureError::Json { what: "snippet", source })?;
        Ok((Made { record, files }, times))
    }

    fn run(&self, session: &Session, named: &NamedRecipe) -> Result<Reconstruction> {
        let run = Run {
            recipe: named.recipe,
            model: self.model.filter(|_| named.recipe.network),
            seed: self.seed,
            deadline: None,
        };
        Ok(session.run(&run, &mut Watch::new(&Silent))?)
    }

    /// The held-out views of a scene.
    fn measure(
        &self,
        session: &Session,
        made: &Reconstruction,
        held_out: &[View],
        with_pictures: bool,
    ) -> Result<Vec<Measured>> {
        let inputs = session.inputs();
        let keep = |drawn: RenderedView<'_>| -> Result<Measured> {
            let RenderedView { view, rendered, figures, .. } = drawn;
            let copied = copying(view, inputs.views().iter().chain(inputs.aside()));
            let figures = ViewFigures { psnr_copying: copied, ..figures.copied().unwrap_or_default() };
            let dynamic = dynamic_pixels(session.clip(), view, session.clip_frame());
            let dmae_dynamic = dynamic.and_then(|dynamic| {
                let is_dynamic = |pixel: u32| dynamic.get(pixel as usize).copied().unwrap_or(false);
                let samples: Vec<_> =
                    view.depth_samples.iter().copied().filter(|sample| is_dynamic(sample.pixel)).collect();
                dmae(rendered, &samples, view.labels.as_deref())
            });
            let record = ViewRecord {
                frame: view.frame,
                camera: view.camera.clone(),
                figures: Figures::of(&figures, dmae_dynamic),
            };
            let truth = Picture::of_truth(&view.image);
            let size = truth.size();
            let pictures = if with_pictures {
                let all = [truth, Picture::of_render(rendered), Picture::of_error(rendered, view)];
                all.iter().map(|picture| encoded(view, picture)).collect::<Result<_>>()?
            } else {
                Vec::new()
            };
            Ok(Measured { record, size, pictures })
        };
        let views: Vec<&View> = held_out.iter().collect();
        // Figures are those of the processor, whatever made the scene.
        let drawing = Drawing { scene: &to_physical(&made.scene), scores: None, device: Device::Cpu };
        evaluate_views(drawing, &views, session.truth(self.lpips), &mut Watch::new(&Silent), &keep)
    }

    /// The files of a scene that are wanted.
    fn files_of_scene(
        &self,
        session: &Session,
        named: &NamedRecipe,
        made: &Reconstruction,
        is_last: bool,
    ) -> Result<Vec<(String, Vec<u8>)>> {
        let mut files = Vec::new();
        if !(self.scenes || self.viewer) {
            return Ok(files);
        }
        let inputs = session.inputs();
        let first = session.frames().input.first().copied().unwrap_or(0);
        let shown = Shown {
            brightness: inputs.colours().photometry.as_ref().map_or(1.0, |photometry| photometry.brightness),
            turn: session.clip_frame().lidar_from_clip(session.clip(), first),
        };
        let cloud = to_cloud(&made.scene, made.density.as_ref(), shown)?;
        if self.scenes {
            let name =
                if self.recipes.len() == 1 { "scene.ply".to_owned() } else { format!("scene-{}.ply", named.name) };
            let bytes = ply::to_bytes(Path::new(&name), &cloud)?;
            files.push((name, bytes));
        }
        if self.viewer && is_last {
            let stops: Vec<_> = inputs.views().iter().map(|view| stop(view, shown)).collect();
            let title = format!("{}, frame {first}", session.clip().name);
            files.push((VIEWER.to_owned(), in_a_log(&viewer::html(&cloud, &stops, &title)).into_bytes()));
        }
        Ok(files)
    }
}

/// The file of a snippet's picture.
pub fn picture_file(kind: PictureKind) -> String {
    format!("{}.jpg", kind.name())
}

fn encoded(view: &View, picture: &Picture) -> Result<(String, Vec<u8>)> {
    let name = picture_file(picture.kind);
    let what = || format!("frame {} {}: {name}", view.frame, view.camera);
    let bytes = picture.jpeg(WIDTH_PX).map_err(|source| MeasureError::Encode { what: what(), source })?;
    Ok((name, bytes))
}

/// The view of the lowest PSNR; the first of equal ones.
fn worst(all: &[Measured]) -> Option<&Measured> {
    let psnr = |measured: &Measured| measured.record.figures.get("psnr").unwrap_or(f64::INFINITY);
    all.iter().min_by(|a, b| psnr(a).total_cmp(&psnr(b)))
}
