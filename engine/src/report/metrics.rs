//! `metrics.json`: every figure of a run, in one page that programs read.

use serde::{Serialize, Serializer};

use super::moving::MovingShares;
use crate::{
    calibration::{CameraFinding, LensFinding, Lenses, MountFinding, Mounts, Shutters},
    evaluate::ViewFigures,
    gaussians::{background::MapFit, motion::Motion},
    photometry::{Colours, Photometry},
    pipeline::{GaussianCounts, NetworkSummary, StageTimes},
    plan::Chosen,
    points::{Dropped, Stamp, Turn},
    recipe::{KNOBS, Recipe},
    refine::adam::AdamSummary,
    render::DrawnOn,
    views::Role,
};

/// The value of `format` in `metrics.json`.
pub const METRICS_FORMAT: &str = "lgs-metrics/1";

/// What `metrics.json` says. Keys as the fields are named; a figure that is not defined is `null`, and an infinite one
/// (the PSNR of equal images) is the string `"inf"`.
#[derive(Clone, Debug, Serialize)]
pub struct Metrics {
    /// [`METRICS_FORMAT`].
    pub format: &'static str,
    /// Name of the clip.
    pub clip: String,
    /// Everything that was asked for and changes the result.
    pub config: Config,
    /// How a time budget was spent; `None`, and no key, without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget: Option<BudgetRecord>,
    /// SHA-256 of the weights file; for seeded weights `random:` and the config file's; `None` without a network.
    pub weights: Option<String>,
    /// Threads that worked.
    pub threads: usize,
    /// Where views were drawn.
    pub drawn_on: DrawnOn,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// How many Gaussians there were.
    pub gaussians: GaussianCounts,
    /// Which share of them moves in the finished scene.
    pub moving: MovingShares,
    /// What the network did and left out; `None`, and no key, without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub network: Option<NetworkSummary>,
    /// What a per-scene optimisation did; `None`, and no key, without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub optimisation: Option<AdamSummary>,
    /// How the clip's depth maps were brought to metres; no key where none was used for the background.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub depth_maps: Vec<MapFit>,
    /// How the `LiDAR` turned while it measured a sweep, where the clip does not say and the sweeps tell; no key elsewhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lidar_turn: Option<Turn>,
    /// Which moment of a sweep its timestamp is, where the clip does not say when returns were measured and the images tell; no key elsewhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lidar_stamp: Option<Stamp>,
    /// What the returns said of the lenses; no key where it is what the clip states.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lenses: Option<LensFinding>,
    /// The cameras whose own images say that they are mounted or exposed otherwise than the clip states; no key where there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Vec<CameraFinding>>,
    /// The cameras of a rig that are mounted otherwise against one another than the clip states.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mounts: Option<MountFinding>,
    /// How the cameras show the scene's colours; no key where these are the images' own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub photometry: Option<Photometry>,
    /// Returns that are no surface and were left out; no key where there was none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dropped_returns: Option<Dropped>,
    /// Seconds of each stage; 0 for one that did not run.
    pub stages_s: StageTimes,
    /// Seconds from the loaded input views to the finished scene.
    pub reconstruction_s: f64,
    /// Largest resident memory, 10^6 bytes; `None` where the system does not say.
    pub peak_rss_mb: Option<f64>,
    /// The rendered views.
    pub views: Vec<ViewRecord>,
    /// Mean figures of the views of each role.
    pub mean: RoleMeans,
}

/// A time budget, and how it was spent.
#[derive(Clone, Debug, Serialize)]
pub struct BudgetRecord {
    /// What was asked for: seconds from the start of the program until the scene is finished.
    pub budget_s: f64,
    /// Seconds until the choice.
    pub before_s: f64,
    /// What was chosen, and why.
    #[serde(flatten)]
    pub chosen: Chosen,
    /// Seconds until the scene was finished.
    pub finished_s: f64,
}

/// The settings of a run, as they turned out for its clip.
#[derive(Clone, Debug, Serialize)]
pub struct Config {
    /// Names of the cameras.
    pub cameras: Vec<String>,
    /// Height and width of every view, pixels; `None` when images kept their own size.
    pub image_size: Option<[usize; 2]>,
    /// Frames that took part, held-out ones included.
    pub frames: Vec<usize>,
    /// Frames that were held out.
    pub hold_out: Vec<usize>,
    /// Where the initial velocities came from.
    pub motion: Motion,
    /// Which lens distortion was taken.
    pub lenses: Lenses,
    /// Which mounts of cameras were taken.
    pub mounts: Mounts,
    /// Which statements on the moments of images were believed.
    pub shutters: Shutters,
    /// Whether cameras were to be brought to common colours.
    pub colours: Colours,
    /// The camera whose colours these were to be; `None` for the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_camera: Option<String>,
    /// The recipe: every option of it that says anything.
    #[serde(flatten, serialize_with = "options")]
    pub recipe: Recipe,
    /// Which views were rendered.
    pub views: String,
    /// Moment of every rendered view, seconds since time zero; `None` for each view's own.
    pub at_time: Option<f32>,
    /// SHA-256 of the file with the weights of LPIPS; `None` without it.
    pub lpips_weights: Option<String>,
}

/// Every option of a recipe by its key, `null` where it says nothing.
fn options<S: Serializer>(recipe: &Recipe, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(KNOBS.iter().map(|knob| (knob.key(), (knob.get)(recipe))))
}

/// The figures of one view.
#[derive(Clone, Debug, Serialize)]
pub struct ViewRecord {
    /// Index of the frame in the clip.
    pub frame: usize,
    /// Name of the camera.
    pub camera: String,
    /// Whether the reconstruction read it.
    #[serde(serialize_with = "role")]
    pub role: Role,
    /// The figures.
    #[serde(flatten, serialize_with = "figures")]
    pub figures: ViewFigures,
}

/// Mean figures by role.
#[derive(Clone, Debug, Serialize)]
pub struct RoleMeans {
    /// Over the views that the reconstruction read.
    #[serde(serialize_with = "figures")]
    pub input: ViewFigures,
    /// Over the views that it did not see.
    #[serde(serialize_with = "figures")]
    pub held_out: ViewFigures,
}

impl RoleMeans {
    /// The means over `views`, each figure over those of a role that have it.
    pub fn of(views: &[ViewRecord]) -> Self {
        let of_role = |role: Role| views.iter().filter(move |view| view.role == role).map(|view| &view.figures);
        Self { input: ViewFigures::mean(of_role(Role::Input)), held_out: ViewFigures::mean(of_role(Role::HeldOut)) }
    }
}

/// A figure as people and programs know it.
#[derive(Clone, Copy, Debug)]
pub struct FigureKind {
    /// Key in `metrics.json`.
    pub key: &'static str,
    /// Heading for people, with the unit.
    pub label: &'static str,
    /// The better side; empty for a figure that others are compared with.
    pub better: &'static str,
    /// Digits after the point that people are shown.
    pub digits: usize,
    /// The figure's value.
    pub get: fn(&ViewFigures) -> Option<f64>,
}

impl FigureKind {
    /// The heading with its better side.
    pub fn heading(&self) -> String {
        format!("{} {}", self.label, self.better).trim_end().to_owned()
    }

    /// The value as people are shown it; a dash when it is not defined.
    pub fn text(&self, figures: &ViewFigures) -> String {
        match (self.get)(figures) {
            Some(value) if value == f64::INFINITY => "∞".to_owned(),
            Some(value) if value.is_finite() => format!("{value:.*}", self.digits),
            _ => "–".to_owned(),
        }
    }
}

/// How many of [`FIGURES`], from the first, are of the full image; the others are of its moving and its static pixels.
pub const NUM_FULL_IMAGE: usize = 5;

/// Every figure, in the order of `metrics.json`.
pub const FIGURES: [FigureKind; 9] = [
    FigureKind { key: "psnr", label: "PSNR (dB)", better: "↑", digits: 2, get: |f| f.psnr },
    FigureKind { key: "psnr_copying", label: "copying (dB)", better: "", digits: 2, get: |f| f.psnr_copying },
    FigureKind { key: "ssim", label: "SSIM", better: "↑", digits: 3, get: |f| f.ssim },
    FigureKind { key: "lpips", label: "LPIPS", better: "↓", digits: 3, get: |f| f.lpips },
    FigureKind { key: "dmae", label: "DMAE (m)", better: "↓", digits: 2, get: |f| f.dmae },
    FigureKind { key: "psnr_dynamic", label: "PSNR, dynamic", better: "↑", digits: 2, get: |f| f.psnr_dynamic },
    FigureKind { key: "ssim_dynamic", label: "SSIM, dynamic", better: "↑", digits: 3, get: |f| f.ssim_dynamic },
    FigureKind { key: "psnr_static", label: "PSNR, static", better: "↑", digits: 2, get: |f| f.psnr_static },
    FigureKind { key: "ssim_static", label: "SSIM, static", better: "↑", digits: 3, get: |f| f.ssim_static },
];

/// The name of a role in `metrics.json`.
pub const fn role_name(role: Role) -> &'static str {
    match role {
        Role::Input => "input",
        Role::HeldOut => "held-out",
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde calls")]
fn role<S: Serializer>(role: &Role, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(role_name(*role))
}

fn figures<S: Serializer>(figures: &ViewFigures, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(FIGURES.map(|kind| (kind.key, Figure((kind.get)(figures)))))
}

/// A number as it is, infinity as `"inf"`, what is not a number as `null`.
struct Figure(Option<f64>);

impl Serialize for Figure {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            Some(value) if value.is_finite() => serializer.serialize_f64(value),
            Some(value) if value == f64::INFINITY => serializer.serialize_str("inf"),
            _ => serializer.serialize_none(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(frame: usize, role: Role, psnr: Option<f64>, dmae: Option<f64>) -> ViewRecord {
        ViewRecord { frame, camera: "a".into(), role, figures: ViewFigures { psnr, dmae, ..ViewFigures::default() } }
    }

    #[test]
    fn a_mean_is_over_the_views_of_its_role_that_have_the_figure() {
        let views = [
            view(0, Role::Input, Some(30.0), None),
            view(1, Role::HeldOut, Some(20.0), Some(1.0)),
            view(3, Role::HeldOut, Some(10.0), None),
        ];
        let means = RoleMeans::of(&views);
        assert_eq!((means.input.psnr, means.input.dmae), (Some(30.0), None));
        assert_eq!((means.held_out.psnr, means.held_out.dmae), (Some(15.0), Some(1.0)));
        assert_eq!(RoleMeans::of(&views[..1]).held_out, ViewFigures::default());
    }

    #[test]
    fn a_view_is_flat_and_parses_whatever_its_figures_are() {
        let json = |psnr| serde_json::to_value(view(2, Role::HeldOut, psnr, Some(0.5))).unwrap();
        let plain = json(Some(17.25));
        let keys: Vec<&String> = plain.as_object().unwrap().keys().collect();
        assert_eq!(keys.len(), 12);
        assert_eq!((&plain["frame"], &plain["role"], &plain["psnr"]), (&2.into(), &"held-out".into(), &17.25.into()));
        assert!(plain["lpips"].is_null());
        assert_eq!(json(Some(f64::INFINITY))["psnr"], "inf");
        assert!(json(Some(f64::NAN))["psnr"].is_null());
    }
}
