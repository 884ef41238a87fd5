//! What the command line says; nothing here acts.

use std::{ops::RangeInclusive, path::PathBuf};

use clap::{Args, Parser, Subcommand, ValueEnum};
use lgs_formats::{
    camera::{Readout, ReadoutDirection},
    image::ImageSize,
};
use lgs_train::scenes::{
    SceneConfig, Split,
    config::MAX_EGO_DISTANCE,
    depth_map::DepthMaps,
    export::{Export, ImageFormat},
    presets,
    rig::{CAMERA_PLACES, CameraSpec, Rig},
};

use crate::{backbone_args::BackboneArgs, finetune_args::FinetuneArgs, policy_args::PolicyArgs, ship::ShipArgs};

/// The coefficients of the lenses that `--fisheye` asks for.
const FISHEYE: [f64; 4] = [0.02, -0.004, 0.0, 0.0];

/// Makes scenes to train and measure on, and trains.
#[derive(Clone, Debug, Parser)]
#[command(name = "lgs-train", version, about)]
pub(crate) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What to do.
#[derive(Clone, Debug, Subcommand)]
pub(crate) enum Command {
    /// Makes procedural street clips (lgs-clip/1 directories)
    Scenes(ScenesArgs),
    /// Trains prediction, query and refinement by the rendering loss (stage 1)
    Backbone(Box<BackboneArgs>),
    /// Trains the densify policy on targets that lgs-targetgen made (stage 2)
    Policy(Box<PolicyArgs>),
    /// Trains prediction, query and refinement again with the policy's decisions applied (stage 3)
    Finetune(Box<FinetuneArgs>),
    /// Writes a copy of a weights file
    Export(ExportArgs),
    /// Writes weights, or their card, to where builds take from what ships in the programs
    Ship(ShipArgs),
}

/// Flags of `export`.
#[derive(Clone, Debug, Args)]
pub(crate) struct ExportArgs {
    /// Weights file to copy
    #[arg(value_name = "WEIGHTS")]
    pub(crate) weights: PathBuf,
    /// File to write
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    /// Stores what convolutions and linear layers multiply by in 16 bits: half the size; another SHA-256, so targets
    /// are to be made with the file that ships
    #[arg(long)]
    pub(crate) half: bool,
}

const CAMERAS_HELP: &str =
    "Cameras, 1..=6: front, front_left, front_right, side_left, side_right, rear [default: the preset's]";

/// Flags of `scenes`.
#[derive(Clone, Debug, Args)]
pub(crate) struct ScenesArgs {
    /// Directory that receives one clip directory per scene; a clip directory that exists and is not empty is refused
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Number of scenes
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub(crate) count: u64,
    /// Number of the first scene in its split; the others follow it
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..=Split::MAX_NUMBER / 2))]
    pub(crate) seed: u64,
    /// Set that the scenes belong to; no two sets share a scene
    #[arg(long, value_enum, default_value_t = SplitArg::Train)]
    pub(crate) split: SplitArg,
    /// What scenes are like: varied draws every aspect from the seed, traffic adds what real streets have, street is the small clip that
    /// ships [default: varied; traffic for the splits traffic and traffic-test]
    #[arg(long, value_enum)]
    pub(crate) preset: Option<Preset>,
    /// Name of the clip and of its directory [default: split and scene number, as train-000007]; needs --count 1
    #[arg(long, value_name = "NAME", value_parser = parse_name)]
    pub(crate) name: Option<String>,
    /// Timestamps per clip, 1..=1000; in long clips the vehicle drives more slowly, to stay on the street [default: the
    /// preset's]
    #[arg(long, value_name = "N")]
    pub(crate) frames: Option<usize>,
    /// Time between timestamps, seconds, 0.01..=2 [default: the preset's]
    #[arg(long, value_name = "S")]
    pub(crate) interval: Option<f64>,
    #[arg(long, value_name = "N", value_parser = parse_cameras, help = CAMERAS_HELP)]
    pub(crate) cameras: Option<usize>,
    /// Size of all images, pixels [default: the preset's: 256x512, 192x320 for street]
    #[arg(long, value_name = "HxW")]
    pub(crate) image_size: Option<ImageSize>,
    /// LiDAR beams, 1..=256 [default: the preset's]
    #[arg(long, value_name = "N")]
    pub(crate) beams: Option<usize>,
    /// LiDAR rays of a beam and sweep, 1..=8192 [default: the preset's]
    #[arg(long, value_name = "N")]
    pub(crate) azimuths: Option<usize>,
    /// Time over which the rays of a sweep leave while all goes on moving, seconds, 0..=0.5; above 0 the returns have times
    /// [default: the preset's: 0]
    #[arg(long, value_name = "S")]
    pub(crate) sweep: Option<f64>,
    /// Leaves the returns of such a sweep where the LiDAR measured them, not compensated for its own motion
    #[arg(long)]
    pub(crate) uncompensated: bool,
    /// How images are stored: png, or jpeg:Q of quality Q in 1..=100 [default: png, jpeg:80 for street]
    #[arg(long, value_name = "png|jpeg:Q", value_parser = parse_images)]
    pub(crate) images: Option<ImageFormat>,
    /// Writes a mask of moving pixels beside every image
    #[arg(long)]
    pub(crate) masks: bool,
    /// Speed of the vehicle with the sensors, m/s, 0 to 20, less where a clip would be longer than its street [default: drawn from the seed]
    #[arg(long, value_name = "M/S", value_parser = parse_speed)]
    pub(crate) speed: Option<f64>,
    /// Rolling shutters: seconds from the first line of every image to the last one, 0 to 0.2, and which way they go: `top_to_bottom` (where
    /// none is given), `bottom_to_top`, `left_to_right` or `right_to_left` [default: 0, all lines at once]
    #[arg(long, value_name = "SECONDS[:WAY]", value_parser = parse_readout)]
    pub(crate) readout: Option<Readout>,
    /// Fisheye lenses: horizontal field of view of every camera, degrees, 10 to 220 [default: pinholes]
    #[arg(long, value_name = "DEGREES", value_parser = parse_fisheye)]
    pub(crate) fisheye: Option<f64>,
    /// Writes a depth map beside every image [default: none]
    #[arg(long, value_enum)]
    pub(crate) depth: Option<DepthArg>,
    /// Threads [default: all cores]; the clips do not depend on it
    #[arg(long, value_name = "N", value_parser = parse_threads)]
    pub(crate) threads: Option<usize>,
    /// Prints the summary as one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

/// A set of scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SplitArg {
    /// Scenes to learn from
    Train,
    /// Scenes to choose by
    Validation,
    /// Scenes to measure on
    Test,
    /// Streets with real traffic to learn from
    Traffic,
    /// Streets with real traffic to measure on
    TrafficTest,
}

impl From<SplitArg> for Split {
    fn from(split: SplitArg) -> Self {
        match split {
            SplitArg::Train => Self::Train,
            SplitArg::Validation => Self::Validation,
            SplitArg::Test => Self::Test,
            SplitArg::Traffic => Self::Traffic,
            SplitArg::TrafficTest => Self::TrafficTest,
        }
    }
}

/// Depth maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DepthArg {
    /// Exact, in metres
    Metric,
    /// Inverse, with the errors of a monocular network, its scale and shift unknown
    Relative,
}

impl From<DepthArg> for DepthMaps {
    fn from(arg: DepthArg) -> Self {
        match arg {
            DepthArg::Metric => Self::Metric,
            DepthArg::Relative => Self::Relative,
        }
    }
}

/// A family of configurations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// Every aspect drawn from the seed
    Varied,
    /// As varied, with lorries, queues, crossing and turning cars, cyclists, people who cross, cameras off the sweep's time
    Traffic,
    /// The small clip that ships
    Street,
}

/// A clip to be made.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PlannedScene {
    /// The scene.
    pub(crate) config: SceneConfig,
    /// How it is written.
    pub(crate) export: Export,
    /// Where to.
    pub(crate) dir: PathBuf,
}

impl ScenesArgs {
    /// The clips that the flags ask for, in order.
    ///
    /// # Errors
    /// `--name` with several scenes.
    pub(crate) fn plan(&self) -> Result<Vec<PlannedScene>, String> {
        if self.name.is_some() && self.count > 1 {
            return Err(format!("--name: expected --count 1, found --count {}", self.count));
        }
        Ok((self.seed..self.seed + self.count).map(|number| self.scene(number)).collect())
    }

    fn scene(&self, number: u64) -> PlannedScene {
        let split = Split::from(self.split);
        let name = self.name.clone().unwrap_or_else(|| format!("{}-{number:06}", split.name()));
        let preset = self.preset.unwrap_or(match split {
            Split::Traffic | Split::TrafficTest => Preset::Traffic,
            _ => Preset::Varied,
        });
        let (config, default_images) = match preset {
            Preset::Varied => (presets::varied(split.seed(number)), ImageFormat::Png),
            Preset::Traffic => (presets::traffic(split.seed(number)), ImageFormat::Png),
            Preset::Street => (presets::street_clip(split.seed(number)), ImageFormat::Jpeg(80)),
        };
        let images = self.images.unwrap_or(default_images);
        PlannedScene {
            config: self.overridden(config),
            dir: self.out.join(&name),
            export: Export { name, images, masks: self.masks, depth: self.depth.map(DepthMaps::from) },
        }
    }

    fn overridden(&self, mut config: SceneConfig) -> SceneConfig {
        config.num_frames = self.frames.unwrap_or(config.num_frames);
        config.frame_interval_s = self.interval.unwrap_or(config.frame_interval_s);
        let duration = config.frame_time(config.num_frames);
        config.traffic.ego_speed =
            self.speed.unwrap_or(config.traffic.ego_speed).min(MAX_EGO_DISTANCE / duration.max(1e-3));
        if let Some(num) = self.cameras {
            resize_rig(&mut config.rig, num);
        }
        if let Some(size) = self.image_size {
            for camera in &mut config.rig.cameras {
                (camera.height, camera.width) = (size.height, size.width);
            }
        }
        for camera in &mut config.rig.cameras {
            camera.readout = self.readout.or(camera.readout);
            if let Some(fov_deg) = self.fisheye {
                (camera.fov_deg, camera.fisheye) = (fov_deg, Some(FISHEYE));
            }
        }
        let lidar = &mut config.rig.lidar;
        lidar.sweep_s = self.sweep.unwrap_or(lidar.sweep_s);
        lidar.compensated &= !self.uncompensated;
        lidar.num_beams = self.beams.unwrap_or(lidar.num_beams);
        lidar.num_azimuths = self.azimuths.unwrap_or(lidar.num_azimuths);
        config
    }
}

/// Drops the last cameras of a rig, or adds further ones like its first.
fn resize_rig(rig: &mut Rig, num: usize) {
    rig.cameras.truncate(num);
    let first = rig.cameras.first().cloned();
    for (name, yaw) in CAMERA_PLACES.into_iter().take(num).skip(rig.cameras.len()) {
        let mut camera = CameraSpec::at_place((name, yaw), 256, 512, 60.0);
        if let Some(first) = &first {
            camera = CameraSpec {
                position: [camera.position[0], camera.position[1], first.position[2]],
                name: camera.name,
                yaw_deg: yaw,
                ..first.clone()
            };
        }
        rig.cameras.push(camera);
    }
}

fn parse_within(text: &str, range: RangeInclusive<f64>) -> Result<f64, String> {
    let expected = || format!("expected {} to {}", range.start(), range.end());
    text.parse().ok().filter(|value| range.contains(value)).ok_or_else(expected)
}

fn parse_speed(text: &str) -> Result<f64, String> {
    parse_within(text, 0.0..=20.0)
}

fn parse_readout(text: &str) -> Result<Readout, String> {
    let (seconds, way) = text.split_once(':').unwrap_or((text, "top_to_bottom"));
    let direction = match way {
        "top_to_bottom" => ReadoutDirection::TopToBottom,
        "bottom_to_top" => ReadoutDirection::BottomToTop,
        "left_to_right" => ReadoutDirection::LeftToRight,
        "right_to_left" => ReadoutDirection::RightToLeft,
        _ => return Err("expected top_to_bottom, bottom_to_top, left_to_right or right_to_left".to_owned()),
    };
    Ok(Readout { seconds: parse_within(seconds, 0.0..=0.2)?, direction, middle: 0.0 })
}

fn parse_fisheye(text: &str) -> Result<f64, String> {
    parse_within(text, 10.0..=220.0)
}

fn parse_cameras(text: &str) -> Result<usize, String> {
    let most = CAMERA_PLACES.len();
    text.parse().ok().filter(|n| (1..=most).contains(n)).ok_or_else(|| format!("expected 1..={most}"))
}

fn parse_images(text: &str) -> Result<ImageFormat, String> {
    if text == "png" {
        return Ok(ImageFormat::Png);
    }
    let quality = text.strip_prefix("jpeg:").and_then(|q| q.parse().ok()).filter(|q| (1..=100).contains(q));
    quality.map(ImageFormat::Jpeg).ok_or_else(|| "expected png or jpeg:Q with Q in 1..=100".to_owned())
}

fn parse_threads(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| (1..=1024).contains(n)).ok_or_else(|| "expected 1..=1024".to_owned())
}

fn parse_name(text: &str) -> Result<String, String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !text.is_empty() && text.chars().all(plain) {
        return Ok(text.to_owned());
    }
    Err("expected letters, digits, `_` and `-`".to_owned())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn parse(line: &str) -> ScenesArgs {
        match Cli::try_parse_from(line.split(' ')).unwrap().command {
            Command::Scenes(args) => args,
            other => panic!("expected scenes, found {other:?}"),
        }
    }

    #[test]
    fn the_definition_is_sound_and_every_flag_says_its_default_or_needs_none() {
        Cli::command().debug_assert();
        assert_eq!(lgs_cli::flags_without_default(&Cli::command()), [""; 0]);
    }

    #[test]
    fn flags_override_the_preset() {
        let args =
            parse("lgs-train scenes --out o --count 2 --seed 7 --frames 3 --cameras 4 --image-size 64x96 --beams 8");
        let plan = args.plan().unwrap();
        assert_eq!(plan.len(), 2);
        assert_eq!(plan[1].dir, PathBuf::from("o/train-000008"));
        for scene in &plan {
            let rig = &scene.config.rig;
            assert_eq!((scene.config.num_frames, rig.cameras.len(), rig.lidar.num_beams), (3, 4, 8));
            assert!(rig.cameras.iter().all(|c| (c.height, c.width) == (64, 96)));
            scene.config.validate().unwrap();
        }
        assert_ne!(plan[0].config.seed, plan[1].config.seed);
    }

    #[test]
    fn long_clips_stay_on_the_street() {
        for seed in 0..20 {
            let args = parse(&format!("lgs-train scenes --out o --seed {seed} --frames 199 --interval 0.1"));
            args.plan().unwrap()[0].config.validate().unwrap();
        }
    }

    #[test]
    fn splits_share_no_seed() {
        let seed = |split: &str| {
            parse(&format!("lgs-train scenes --out o --seed 3 --split {split}")).plan().unwrap()[0].config.seed
        };
        let seeds: std::collections::BTreeSet<u64> =
            ["train", "validation", "test", "traffic", "traffic-test"].map(seed).into_iter().collect();
        assert_eq!(seeds.len(), 5);
    }

    #[test]
    fn splits_of_traffic_have_it_and_others_do_not() {
        let scene = |flags: &str| parse(&format!("lgs-train scenes --out o {flags}")).plan().unwrap().remove(0);
        let busy = |flags: &str| scene(flags).config.traffic.busy.is_some();
        assert!(busy("--split traffic") && busy("--split traffic-test --seed 4") && busy("--preset traffic"));
        assert!(!busy("--split test") && !busy("--split traffic --preset varied"));
        assert_eq!(scene("--split traffic-test").dir, PathBuf::from("o/traffic-test-000000"));
        assert_eq!(scene("--split traffic --sweep 0.1").config.rig.lidar.sweep_s, 0.1);
    }

    #[test]
    fn bad_flags_are_refused() {
        for flags in
            ["--cameras 9", "--count 0", "--name a/b", "--image-size 3", "--images jpeg:0", "--threads 0", "--nope"]
        {
            let line = format!("lgs-train scenes --out o {flags}");
            assert!(Cli::try_parse_from(line.split(' ')).is_err(), "{flags}");
        }
        assert!(parse("lgs-train scenes --out o --name a --count 2").plan().is_err());
    }
}
