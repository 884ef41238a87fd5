//! A run: clip in, files out.

use std::{path::Path, sync::Arc, time::Instant};

use anyhow::{Context, Result, anyhow, bail};
use lgs_cli::{Outcome, threads};
use lgs_engine::{
    allocator,
    densify::{Density, DensityMap},
    evaluate::{ViewFigures, copying, lpips::Lpips},
    export::{Shown, stop, to_cloud},
    gaussians::{GaussianSet, physical::to_physical},
    network::{
        describe::describe,
        source::{ModelSource, config_of},
    },
    photometry::Photometry,
    pipeline::{Drawing, Figures, Opening, RenderedView, Session, Stage, Watch, begin, evaluate_views},
    recipe::Recipe,
    render::devices,
    report::{Config, METRICS_FORMAT, Metrics, MovingShares, Page, PageView, RoleMeans, ViewRecord, html},
    views::{SelectedFrames, Selection, View},
};
use lgs_formats::{
    clip::Clip,
    clip_dir::{ClipDir, Needed},
    digest::sha256,
    exports::num_files,
    importers,
    ply::Higher,
    viewer,
};

use crate::{
    args::{Args, ViewsArg, word},
    film::Film,
    output::{Exports, Output, ViewPictures, output_dir, pictures_of, report_width},
    plan,
    progress::StageBars,
    summary::{notes, summary},
};

/// Does what the command line asks for and returns what to print.
pub(crate) fn run(args: &Args) -> Result<Outcome> {
    if args.devices {
        return Ok((devices().join("\n") + "\n").into());
    }
    match (&args.describe, &args.clip_dir) {
        (Some(file), _) => Ok(describe(&config_of(file)?)?.into()),
        (None, Some(clip)) => infer(args, clip),
        (None, None) => bail!("CLIP_DIR: expected a clip directory, found nothing"),
    }
}

/// Reconstructs a clip, writes the output and returns what to print.
fn infer(args: &Args, clip: &Path) -> Result<Outcome> {
    let start = Instant::now();
    let prunes = if args.recipe.value("max-gaussians").is_some() {
        Some("--max-gaussians")
    } else {
        (args.recipe.value("density") == Some("exact")).then_some("--density exact")
    };
    if let Some(flag) = prunes.filter(|_| args.weights == ModelSource::None) {
        bail!(
            "{flag}: expected --weights of a network, behind whose first prediction Gaussians are pruned, found --weights none"
        );
    }
    plan::check(args)?;
    let threads = threads::set_num_threads(args.threads())?;
    // A GPU that the processor plays brings threads of its own.
    args.recipe.of(Recipe::default()).device.check()?;
    let bars = StageBars::default();
    let mut watch = Watch::new(&bars);
    let dir = watch.time(Stage::Load, |_| importers::open_part(clip, &needed(args)))?;
    let out = output_dir(args.out.as_deref(), &dir.clip().name)?;
    let lpips = args.lpips_weights.as_deref().map(PerceptualDistance::load).transpose()?;
    let session = opened(args, dir, &mut watch)?;
    let (run_of, inputs) = (OpenedRun { args, session: &session, lpips }, session.inputs());
    let exports = exports(args, inputs.views())?;
    let film = Film::plan(args, session.clip(), session.clip_frame(), inputs.views())?;
    let model = watch.time(Stage::Load, |_| args.weights.load(args.seed))?;
    let begun = begin(inputs, &mut watch)?;
    let mut plan = plan::plan(args, start, &begun, inputs.views(), &watch)?;
    // A limit that a preset asks for is nothing to a model without a policy.
    let has_policy = model.as_ref().is_some_and(|loaded| loaded.model.policy.is_some());
    if args.recipe.value("max-gaussians").is_none() && plan.recipe.density != Density::Exact && !has_policy {
        plan.recipe.max_gaussians = None;
    }
    let model = model.filter(|_| plan.recipe.network);
    let run = plan.run(model.as_ref().map(|loaded| &loaded.model), args.seed);
    let reconstruction = begun.run(&run, &mut watch, &[], &mut |_, _| ())?;
    plan.record_run(&reconstruction, start);
    let shown = run_of.shown();
    let scene = to_cloud(&reconstruction.scene, reconstruction.density.as_ref(), shown)?;
    let drawn = run_of.draw(&reconstruction.scene, reconstruction.density.as_ref(), &mut watch)?;

    let (records, pictures): (Vec<_>, Vec<_>) = drawn.into_iter().unzip();
    let metrics = Metrics {
        format: METRICS_FORMAT,
        clip: session.clip().name.clone(),
        config: run_of.config(&plan.recipe),
        budget: plan.budget,
        weights: model.map(|loaded| loaded.digest),
        threads,
        drawn_on: plan.recipe.device().drawn_on(),
        seed: args.seed,
        gaussians: reconstruction.counts,
        moving: MovingShares::of(&reconstruction.scene),
        network: reconstruction.network,
        optimisation: reconstruction.optimisation,
        depth_maps: reconstruction.depth_maps,
        lidar_turn: reconstruction.timing.turn,
        lidar_stamp: reconstruction.timing.stamp,
        lenses: session.findings().lenses.clone(),
        calibration: Some(session.findings().cameras.clone()).filter(|cameras| !cameras.is_empty()),
        mounts: session.findings().mounts.clone(),
        photometry: inputs.colours().photometry.clone(),
        dropped_returns: Some(reconstruction.dropped).filter(|dropped| dropped.total() > 0),
        stages_s: watch.times,
        reconstruction_s: reconstruction.seconds,
        peak_rss_mb: allocator::peak_rss_mb(),
        mean: RoleMeans::of(&records),
        views: records,
    };
    let json = serde_json::to_string_pretty(&metrics).context("metrics.json: encode")? + "\n";
    let notes = notes(&metrics, inputs.colours());
    let report = report(&metrics, &pictures, session.clip(), &notes);
    let stops = || inputs.views().iter().map(|view| stop(view, shown)).collect::<Vec<_>>();
    let viewer = args.viewer.then(|| viewer::html(&scene, &stops(), &session.clip().name));
    let viewer = viewer.as_deref();
    if let Some(film) = &film {
        let plain = inputs.colours().photometry.as_ref().map(Photometry::plain);
        film.write(&to_physical(&reconstruction.scene), plain, &out, &bars)?;
    }
    Output { scene: &scene, views: &pictures, report: &report, viewer, exports, metrics: &json }.write(&out)?;
    let text = if args.json { json } else { summary(&metrics, start.elapsed().as_secs_f64(), &out, film.as_ref()) };
    Ok(Outcome { text, notes, has_findings: false })
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

/// The clip, opened as it is asked for.
fn opened(args: &Args, dir: ClipDir, watch: &mut Watch<'_>) -> Result<Session> {
    let frames = args.frames.as_ref().map(|list| list.0.clone());
    let hold_out = args.hold_out.indices(dir.clip().frames.len(), frames.as_deref())?;
    let opening = Opening {
        selection: Selection { cameras: args.cameras.clone(), frames, hold_out, image_size: args.image_size },
        motion: args.motion,
        lenses: args.lenses,
        mounts: args.mounts,
        shutters: args.shutters,
        colours: args.colours,
        reference_camera: args.reference_camera.clone(),
        ..Opening::default()
    };
    Ok(Session::open(Arc::new(dir), opening, watch)?)
}

/// A run of an opened clip.
#[derive(Debug)]
struct OpenedRun<'a> {
    args: &'a Args,
    session: &'a Session,
    lpips: Option<PerceptualDistance>,
}

/// LPIPS and the file that it came from.
#[derive(Debug)]
struct PerceptualDistance {
    lpips: Lpips,
    sha256: String,
}

impl OpenedRun<'_> {
    /// In which colours and axes files hold the scene.
    fn shown(&self) -> Shown {
        let first = self.session.frames().input.first().copied().unwrap_or(0);
        let photometry = self.session.inputs().colours().photometry.as_ref();
        Shown {
            brightness: photometry.map_or(1.0, |photometry| photometry.brightness),
            turn: self.session.clip_frame().lidar_from_clip(self.session.clip(), first),
        }
    }

    /// Figures and pictures of the views that are wanted, frame by frame. Here, where the scene is final, the held-out
    /// images are read.
    fn draw(
        &self,
        scene: &GaussianSet,
        density: Option<&DensityMap>,
        watch: &mut Watch<'_>,
    ) -> Result<Vec<(ViewRecord, ViewPictures)>> {
        if self.args.views == ViewsArg::None {
            return Ok(Vec::new());
        }
        let inputs = self.session.inputs();
        let held_out = self.session.held_out(watch)?;
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
        let device = self.args.recipe.of(Recipe::default()).device();
        let drawing = Drawing { scene: &scene, scores: scores.as_deref(), device };
        evaluate_views(drawing, &views, figures, watch, &keep)
    }

    fn figures(&self) -> Figures<'_> {
        self.session.truth(self.lpips.as_ref().map(|distance| &distance.lpips))
    }

    fn config(&self, recipe: &Recipe) -> Config {
        let (inputs, SelectedFrames { input, held_out }) = (self.session.inputs(), self.session.frames());
        let mut cameras: Vec<String> = Vec::new();
        for view in inputs.views().iter().chain(inputs.aside()) {
            if !cameras.contains(&view.camera) {
                cameras.push(view.camera.clone());
            }
        }
        let mut frames = [input.as_slice(), held_out].concat();
        frames.sort_unstable();
        Config {
            cameras,
            image_size: self.args.image_size.map(|size| [size.height, size.width]),
            frames,
            hold_out: held_out.clone(),
            motion: inputs.motion(),
            lenses: self.args.lenses,
            mounts: self.args.mounts,
            shutters: self.args.shutters,
            colours: self.args.colours,
            reference_camera: self.args.reference_camera.clone(),
            recipe: *recipe,
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

fn report(metrics: &Metrics, pictures: &[ViewPictures], clip: &Clip, notes: &[String]) -> String {
    let views: Vec<PageView> = pictures.iter().map(|pictures| pictures.page.clone()).collect();
    let command: Vec<String> = std::env::args_os().map(|word| quoted(&word.to_string_lossy())).collect();
    let (source, licence, command) = (&clip.source, &clip.licence, command.join(" "));
    html(&Page { metrics, views: &views, source, licence, command: &command, notes })
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
