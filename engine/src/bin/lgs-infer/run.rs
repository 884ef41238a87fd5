//! A run: clip in, files out.

use std::{num::NonZeroUsize, path::Path, time::Instant};

use anyhow::{Context, Result, anyhow, bail};
use lgs_engine::{
    allocator,
    calibration::{Believed, Findings, calibrated},
    densify::{DensityMap, Thresholds},
    evaluate::{ViewFigures, copying, lpips::Lpips},
    export::{Shown, stop, to_cloud},
    gaussians::{GaussianSet, physical::to_physical},
    network::{
        describe::describe,
        source::{ModelSource, config_of},
    },
    photometry::{Colours, Photometry},
    pipeline::{
        Drawing, Figures, Flags, Inputs, NetworkSettings, RenderedView, Stage, Watch, begin, check_memory,
        evaluate_views, optimise,
    },
    plan::Recipe,
    refine::Turns,
    report::{Config, METRICS_FORMAT, Metrics, MovingShares, Page, PageView, RoleMeans, ViewRecord, html},
    threads,
    views::{ClipFrame, Role, SelectedFrames, Selection, View, load_views},
};
use lgs_formats::{
    clip_dir::{ClipDir, Needed},
    digest::sha256,
    exports::num_files,
    importers,
    ply::Higher,
    program::Outcome,
    viewer,
};

use crate::{
    args::{Args, ViewsArg, word},
    film::Film,
    output::{Exports, Output, ViewPictures, output_dir, pictures_of, report_width},
    plan,
    progress::Bars,
    summary::{notes, summary},
};

/// Does what the command line asks for and returns what to print.
pub(crate) fn run(args: &Args) -> Result<Outcome> {
    match (&args.describe, &args.clip_dir) {
        (Some(file), _) => Ok(describe(&config_of(file)?)?.into()),
        (None, Some(clip)) => infer(args, clip),
        (None, None) => bail!("CLIP_DIR: expected a clip directory, found nothing"),
    }
}

/// Reconstructs a clip, writes the output and returns what to print.
fn infer(args: &Args, clip: &Path) -> Result<Outcome> {
    let start = Instant::now();
    if args.max_gaussians.is_some() && args.weights == ModelSource::None {
        bail!("--max-gaussians: expected --weights with a policy that scores the primitives, found --weights none");
    }
    plan::check(args)?;
    let threads = threads::set_num_threads(args.threads())?;
    let bars = Bars::new();
    let mut watch = Watch::new(&bars);
    let dir = watch.time(Stage::Load, |_| importers::open_part(clip, &needed(args)))?;
    let out = output_dir(args.out.as_deref(), &dir.clip().name)?;
    let (dir, selection, found) = watch.time(Stage::Load, |_| selected(args, dir))?;
    let job = Job::new(args, &dir, selection)?;
    check_memory(&dir, &job.selection, Flags::default())?;

    let inputs = job.inputs(&mut watch)?;
    let exports = exports(args, inputs.views())?;
    let film = Film::plan(args, dir.clip(), &job.clip_frame, inputs.views())?;
    let model = watch.time(Stage::Load, |_| args.weights.load(args.seed))?;
    let begun = begin(&inputs, &mut watch)?;
    let mut plan = plan::plan(args, start, &begun, inputs.views(), &watch)?;
    // A limit that a preset asks for is nothing to a model without a policy.
    if args.max_gaussians.is_none() && model.as_ref().is_none_or(|loaded| loaded.model.policy.is_none()) {
        plan.recipe.max_gaussians = None;
    }
    let recipe = plan.recipe;
    let model = model.filter(|_| recipe.network);
    let turns = Turns { views_per_step: recipe.refine_views, seed: args.seed };
    let network = model.as_ref().map(|loaded| NetworkSettings {
        model: &loaded.model,
        refine: plan.refinement(turns),
        query: recipe.query,
        density: recipe.density,
        thresholds: Thresholds { prune: args.theta_prune, add: args.theta_add },
        max_gaussians: recipe.max_gaussians,
        seed: args.seed,
    });
    let mut reconstruction = begun.finish(recipe.start(), network.as_ref(), &mut watch)?;
    let steps = plan.most_adam_steps();
    if steps > 0 {
        optimise(&mut reconstruction, &inputs, plan.optimisation(steps, turns), &mut watch)?;
    }
    plan.spent(&reconstruction, start);
    let shown = job.shown(&inputs);
    let scene = to_cloud(&reconstruction.scene, reconstruction.density.as_ref(), shown)?;
    let drawn = job.draw((&reconstruction.scene, reconstruction.density.as_ref()), &inputs, &mut watch)?;

    let (records, pictures): (Vec<_>, Vec<_>) = drawn.into_iter().unzip();
    let metrics = Metrics {
        format: METRICS_FORMAT,
        clip: dir.clip().name.clone(),
        config: job.config(&inputs, &plan.recipe),
        budget: plan.budget,
        weights: model.map(|loaded| loaded.digest),
        threads,
        seed: args.seed,
        gaussians: reconstruction.counts,
        moving: MovingShares::of(&reconstruction.scene),
        network: reconstruction.network,
        optimisation: reconstruction.optimisation,
        depth_maps: reconstruction.depth_maps,
        lidar_turn: reconstruction.turn,
        lenses: found.lenses,
        mounts: found.mounts,
        photometry: inputs.colours().photometry.clone(),
        dropped_returns: Some(reconstruction.dropped).filter(|dropped| dropped.total() > 0),
        stages_s: watch.times,
        reconstruction_s: reconstruction.seconds,
        peak_rss_mb: allocator::peak_rss_mb(),
        mean: RoleMeans::of(&records),
        views: records,
    };
    let json = serde_json::to_string_pretty(&metrics).context("metrics.json: encode")? + "\n";
    let report = report(&metrics, &pictures, &dir);
    let stops = || inputs.views().iter().map(|view| stop(view, shown)).collect::<Vec<_>>();
    let viewer = args.viewer.then(|| viewer::html(&scene, &stops(), &dir.clip().name));
    let viewer = viewer.as_deref();
    if let Some(film) = &film {
        let plain = inputs.colours().photometry.as_ref().map(Photometry::plain);
        film.write(&to_physical(&reconstruction.scene), plain, &out, &bars)?;
    }
    Output { scene: &scene, views: &pictures, report: &report, viewer, exports, metrics: &json }.write(&out)?;
    let text = if args.json { json } else { summary(&metrics, start.elapsed().as_secs_f64(), &out, film.as_ref()) };
    Ok(Outcome { text, notes: notes(&metrics, inputs.colours()), has_findings: false })
}

/// What of the clip's files the run reads.
fn needed(args: &Args) -> Needed {
    Needed { frames: args.frames.as_ref().map(|list| list.0.clone()), cameras: args.cameras.clone() }
}

/// The files for other programs that are wanted of a scene that was seen in `views`, once it is known that they can be written.
fn exports(args: &Args, views: &[View]) -> Result<Exports> {
    let times = || views.iter().map(|view| view.pinhole.time);
    let span = [times().reduce(f32::min), times().reduce(f32::max)].map(|moment| moment.unwrap_or(0.0));
    let Args { plain, f_rest, sequence, stg, spz, .. } = *args;
    let plain = if f_rest { Some(Higher::Zeros) } else { plain.then_some(Higher::None) };
    if stg && span[0] >= span[1] {
        bail!("--stg: expected input images of more than one moment, found {} s only", span[0]);
    }
    if let Some(rate) = sequence {
        num_files(span, rate).map_err(|expected| anyhow!("--sequence: expected {expected}, found {rate}"))?;
    }
    Ok(Exports { plain, moment: args.at_time.unwrap_or(0.0), span, sequence, stg, spz })
}

/// The clip with its lenses and mounts, and the cameras, frames and size that are asked for.
fn selected(args: &Args, dir: ClipDir) -> Result<(ClipDir, Selection, Findings)> {
    let frames = args.frames.as_ref().map(|list| list.0.clone());
    let hold_out = args.hold_out.indices(dir.clip().frames.len(), frames.as_deref())?;
    let selection = Selection { cameras: args.cameras.clone(), frames, hold_out, image_size: args.image_size };
    let reference = args.reference_camera.as_deref();
    let believed = Believed { lenses: args.lenses, mounts: args.mounts, reference };
    let (dir, found) = calibrated(dir, &selection, believed)?;
    Ok((dir, selection, found))
}

/// The settings of a run, checked against its clip.
#[derive(Debug)]
struct Job<'a> {
    args: &'a Args,
    dir: &'a ClipDir,
    selection: Selection,
    frames: SelectedFrames,
    clip_frame: ClipFrame,
    lpips: Option<PerceptualDistance>,
}

/// LPIPS and the file that it came from.
#[derive(Debug)]
struct PerceptualDistance {
    lpips: Lpips,
    sha256: String,
}

impl<'a> Job<'a> {
    fn new(args: &'a Args, dir: &'a ClipDir, selection: Selection) -> Result<Self> {
        let frames = selection.frames(dir.clip())?;
        let clip_frame = ClipFrame::of(dir.clip(), frames.input.first().copied().unwrap_or(0));
        let lpips = args.lpips_weights.as_deref().map(PerceptualDistance::load).transpose()?;
        Ok(Self { args, dir, selection, frames, clip_frame, lpips })
    }

    /// What the reconstruction reads.
    fn inputs(&self, watch: &mut Watch<'_>) -> Result<Inputs<'a>> {
        let views = self.load(Role::Input, watch)?;
        let inputs = Inputs::new(self.dir, &self.frames, self.clip_frame, views)?.with_motion(self.args.motion);
        let reference = self.args.reference_camera.as_deref();
        if let Some(name) = reference.filter(|&name| inputs.views().iter().all(|view| view.camera != name)) {
            bail!("--reference-camera: expected a camera with input images, found {name}");
        }
        Ok(match self.args.colours {
            Colours::Auto => watch.time(Stage::Load, |_| inputs.with_common_colours(reference)),
            Colours::AsTaken => inputs,
        })
    }

    /// In which colours and axes files hold the scene.
    fn shown(&self, inputs: &Inputs<'_>) -> Shown {
        let first = self.frames.input.first().copied().unwrap_or(0);
        Shown {
            brightness: inputs.colours().photometry.as_ref().map_or(1.0, |photometry| photometry.brightness),
            turn: self.clip_frame.lidar_from_clip(self.dir.clip(), first),
        }
    }

    /// The views of one role.
    fn load(&self, role: Role, watch: &mut Watch<'_>) -> Result<Vec<View>> {
        let num_images = self.selection.num_images(self.dir.clip(), role)?;
        let views = watch.stage(Stage::Load, num_images, |progress| {
            load_views(self.dir, &self.selection, role, &self.clip_frame, &|| progress.step(Stage::Load))
        })?;
        Ok(views)
    }

    /// Figures and pictures of the views that are wanted, frame by frame. Here, where the scene is final, the held-out
    /// images are read.
    fn draw(
        &self,
        (scene, density): (&GaussianSet, Option<&DensityMap>),
        inputs: &Inputs<'_>,
        watch: &mut Watch<'_>,
    ) -> Result<Vec<(ViewRecord, ViewPictures)>> {
        if self.args.views == ViewsArg::None {
            return Ok(Vec::new());
        }
        let mut held_out = self.load(Role::HeldOut, watch)?;
        inputs.colours().apply(&mut held_out);
        let all = self.args.views == ViewsArg::All;
        let seen = inputs.views().iter().chain(inputs.aside()).filter(|_| all);
        let figures = self.args.at_time.map_or_else(|| self.figures(), Figures::AtTime);
        let mut views: Vec<&View> = held_out.iter().chain(seen).collect();
        views.sort_by_key(|view| view.frame);
        let width = report_width(views.len());
        let keep = |drawn: RenderedView<'_>| -> Result<(ViewRecord, ViewPictures)> {
            let RenderedView { view, figures: measured, .. } = drawn;
            let with_copy = |of: &ViewFigures| ViewFigures {
                psnr_copying: copying(view, inputs.views().iter().chain(inputs.aside())),
                ..*of
            };
            let measured = measured.map(with_copy).unwrap_or_default();
            let View { frame, camera, role, .. } = view;
            let record = ViewRecord { frame: *frame, camera: camera.clone(), role: *role, figures: measured };
            Ok((record, pictures_of(drawn, figures, width)?))
        };
        let (scene, scores) = (to_physical(scene), density.map(DensityMap::splats));
        evaluate_views(Drawing { scene: &scene, scores: scores.as_deref() }, &views, figures, watch, &keep)
    }

    fn figures(&self) -> Figures<'_> {
        let lpips = self.lpips.as_ref().map(|distance| &distance.lpips);
        Figures::OfTruth { clip: self.dir.clip(), frame: &self.clip_frame, lpips }
    }

    fn config(&self, inputs: &Inputs<'_>, recipe: &Recipe) -> Config {
        let mut cameras: Vec<String> = Vec::new();
        for view in inputs.views().iter().chain(inputs.aside()) {
            if !cameras.contains(&view.camera) {
                cameras.push(view.camera.clone());
            }
        }
        let mut frames = [self.frames.input.as_slice(), &self.frames.held_out].concat();
        frames.sort_unstable();
        Config {
            cameras,
            image_size: self.selection.image_size.map(|size| [size.height, size.width]),
            frames,
            hold_out: self.frames.held_out.clone(),
            background: recipe.background,
            coarseness: recipe.coarseness,
            motion: inputs.motion(),
            lenses: self.args.lenses,
            mounts: self.args.mounts,
            colours: self.args.colours,
            reference_camera: self.args.reference_camera.clone(),
            refine_with: (recipe.network || recipe.adam_steps > 0).then(|| match recipe.adam_steps {
                0 => "learned".to_owned(),
                steps => format!("adam:{steps}"),
            }),
            refine_steps: recipe.network.then_some(recipe.refine_steps),
            refine_views: recipe.refine_views.filter(|_| recipe.refines()).map(NonZeroUsize::get),
            refine_reduce: recipe.refines().then_some(recipe.refine_reduce),
            line_search: (recipe.network && recipe.refine_steps > 0).then_some(recipe.line_search),
            query: recipe.network.then_some(recipe.query),
            density: recipe.network.then_some(recipe.density),
            theta_prune: recipe.network.then_some(self.args.theta_prune),
            theta_add: recipe.network.then_some(self.args.theta_add),
            max_gaussians: recipe.max_gaussians.filter(|_| recipe.network),
            views: word(&self.args.views),
            at_time: self.args.at_time,
            lpips_weights: self.lpips.as_ref().map(|distance| distance.sha256.clone()),
        }
    }
}

impl PerceptualDistance {
    fn load(path: &Path) -> Result<Self> {
        let lpips = Lpips::load(path)?;
        let bytes = std::fs::read(path).with_context(|| format!("{}: read", path.display()))?;
        let sha256 = sha256(&bytes);
        Ok(Self { lpips, sha256 })
    }
}

fn report(metrics: &Metrics, pictures: &[ViewPictures], dir: &ClipDir) -> String {
    let views: Vec<PageView> = pictures.iter().map(|pictures| pictures.page.clone()).collect();
    let command: Vec<String> = std::env::args_os().map(|word| quoted(&word.to_string_lossy())).collect();
    let clip = dir.clip();
    html(&Page { metrics, views: &views, source: &clip.source, licence: &clip.licence, command: &command.join(" ") })
}

/// The word as a shell takes it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn words_are_quoted_where_a_shell_needs_it() {
        assert_eq!(quoted("--hold-out"), "--hold-out");
        assert_eq!(quoted("a b"), "'a b'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
    }
}
