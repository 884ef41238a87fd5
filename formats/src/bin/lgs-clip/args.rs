//! The command line, parsed without side effects.

use std::path::PathBuf;

use clap::{Parser, Subcommand, ValueEnum};
use lgs_formats::{clip::DepthKind, frame_list::FrameList, importers::Layout};

/// Bring driving data into the clip format, and look at what is in a clip.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(name = "lgs-clip", version, max_term_width = 110)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Clone, Debug, PartialEq, Subcommand)]
pub(crate) enum Command {
    /// Copy a folder, or a file, of a public data set's layout into a new clip directory
    Import(Import),
    /// Say what is in a clip directory or a folder of a known layout; exit code 1 when something looks wrong
    Inspect(Inspect),
    /// Write a page that shows a scene in any browser
    View(View),
}

#[derive(Clone, Debug, PartialEq, clap::Args)]
pub(crate) struct Import {
    /// Layout of the folder
    #[arg(value_enum)]
    pub(crate) layout: LayoutArg,

    /// Folder of one scene, drive, log or sequence; of a nuScenes release; of Waymo drives, or a file of records of one
    #[arg(value_name = "SRC")]
    pub(crate) source: PathBuf,

    /// Clip directory to write: a new or an empty folder
    #[arg(long, value_name = "CLIP")]
    pub(crate) out: PathBuf,

    /// Frames to take: indices from 0 on and ranges with both ends, such as 0,2,5..8 [default: all]
    #[arg(long, value_name = "LIST")]
    pub(crate) frames: Option<FrameList>,

    /// Names of the cameras to take, separated by commas [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    pub(crate) cameras: Option<Vec<String>>,

    /// Which LiDAR to take, names separated by commas, where there are several (`pandaset`, `waymo`) [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    pub(crate) lidars: Option<Vec<String>>,

    /// Name of the scene, where the folder holds several (nuScenes, Waymo); `VERSION/NAME` takes it from the tables of that version [default:
    /// the only one]
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,

    /// Folder of masks of the own vehicle, `CAMERA.png` for all images of a camera: 8-bit grey, 0 where it is seen, else 255 [default:
    /// none]
    #[arg(long, value_name = "DIR")]
    pub(crate) masks: Option<PathBuf>,

    /// Folder of depth maps, `FRAME_CAMERA.png` (16-bit grey) or `.npy` (f32, f64), named as the clip's images are: `0000_CAMERA.png`
    /// [default: none]
    #[arg(long, value_name = "DIR", requires = "depth_kind")]
    pub(crate) depth: Option<PathBuf>,

    /// What the depth maps say: `metric`: depth along the camera's axis, millimetres in PNG and metres in npy files; `relative`:
    /// inverse depth up to scale and shift, larger is nearer [default: none]
    #[arg(long, value_enum, requires = "depth")]
    pub(crate) depth_kind: Option<DepthArg>,
}

/// What depth maps say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DepthArg {
    Metric,
    Relative,
}

impl DepthArg {
    /// The library's word for it.
    pub(crate) const fn kind(self) -> DepthKind {
        match self {
            Self::Metric => DepthKind::Metric,
            Self::Relative => DepthKind::Relative,
        }
    }
}

#[derive(Clone, Debug, PartialEq, clap::Args)]
pub(crate) struct Inspect {
    /// Clip directory, or a folder or file of a layout that `import` knows
    #[arg(value_name = "DIR")]
    pub(crate) directory: PathBuf,

    /// Print JSON instead of text
    #[arg(long)]
    pub(crate) json: bool,

    /// Write a picture with the LiDAR, coloured by depth, over images of up to four frames [default: none]
    #[arg(long, value_name = "FILE.png")]
    pub(crate) contact_sheet: Option<PathBuf>,
}

#[derive(Clone, Debug, PartialEq, clap::Args)]
pub(crate) struct View {
    /// Scene of `lgs-infer`, or of another program that writes the properties of 3D Gaussian Splatting
    #[arg(value_name = "SCENE.ply")]
    pub(crate) scene: PathBuf,

    /// Page to write [default: the scene's name with `.html`]
    #[arg(long, value_name = "FILE.html")]
    pub(crate) out: Option<PathBuf>,
}

/// A foreign layout by its word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum LayoutArg {
    Dgp,
    KittiRaw,
    Av2,
    Pandaset,
    Nuscenes,
    Waymo,
}

impl LayoutArg {
    /// The library's word for it.
    pub(crate) const fn layout(self) -> Layout {
        match self {
            Self::Dgp => Layout::Dgp,
            Self::KittiRaw => Layout::KittiRaw,
            Self::Av2 => Layout::Argoverse2,
            Self::Pandaset => Layout::PandaSet,
            Self::Nuscenes => Layout::NuScenes,
            Self::Waymo => Layout::Waymo,
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn parse(line: &str) -> Result<Command, clap::Error> {
        Args::try_parse_from(std::iter::once("lgs-clip").chain(line.split(' '))).map(|args| args.command)
    }

    #[test]
    fn the_definition_is_sound_and_every_flag_says_its_default_or_needs_none() {
        Args::command().debug_assert();
        assert_eq!(lgs_cli::flags_without_default(&Args::command()), [""; 0]);
    }

    #[test]
    fn the_words_of_layouts_are_those_of_the_library() {
        let words = LayoutArg::value_variants().iter().filter_map(|arg| Some((arg.to_possible_value()?, arg.layout())));
        assert!(words.clone().count() == Layout::ALL.len());
        assert!(words.into_iter().all(|(word, layout)| word.get_name() == layout.to_string()));
    }

    #[test]
    fn flags_are_read() {
        let Ok(Command::Import(import)) = parse("import av2 log --out clip --frames 3,5..7 --cameras a,b --lidars c")
        else {
            panic!("no import");
        };
        assert_eq!((import.layout, import.frames), (LayoutArg::Av2, Some(FrameList(vec![3, 5, 6, 7]))));
        assert_eq!((import.cameras, import.scene), (Some(vec!["a".to_owned(), "b".to_owned()]), None));
        assert_eq!(import.lidars, Some(vec!["c".to_owned()]));
        assert!(matches!(parse("inspect d --json"), Ok(Command::Inspect(Inspect { json: true, .. }))));
        assert!(matches!(parse("view a.ply"), Ok(Command::View(View { out: None, .. }))));
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for line in [
            "import",
            "import dgp x",
            "import dgp x --out y --depth d",
            "import dgp x --out y --depth-kind metric",
            "import dgp x --out y --frames 5..2",
            "import dgp x --out y --frames 0..99999999999",
            "inspect",
            "inspect a b",
            "view",
            "view a.ply b.html",
            "other",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
    }
}
