//! The flags of `--scaling`, parsed without side effects.

use std::path::PathBuf;

use clap::{Args, builder::RangedU64ValueParser};
use lgs_formats::image::ImageSize;
use lgs_measure::scaling::plan::Plan;

/// Flags of the sweep that decide what `--scaling` fixes.
const OTHERS: [&str; 23] = [
    "clips",
    "refine-steps",
    "query",
    "density",
    "density-scope",
    "theta",
    "max-gaussians",
    "background",
    "coarseness",
    "also",
    "adam",
    "no_adam",
    "then_adam",
    "refine-views",
    "pixel-stride",
    "line-search",
    "device",
    "budgets",
    "hold_out",
    "image_size",
    "frames",
    "lpips_weights",
    "warm_up",
];
/// Fewest and most points of a clip.
const POINTS: std::ops::RangeInclusive<u64> = 300..=5_000_000;

/// How cost grows.
#[derive(Clone, Debug, Args)]
pub(crate) struct ScalingArgs {
    /// Measure how each stage's time and memory grow with the number of points and of pixels instead: on procedural clips, with the
    /// defaults of `lgs-infer`; writes `scaling.html`, `scaling.csv`, `exponents.csv`, `sizes.csv` and `scaling.json`
    #[arg(long, conflicts_with_all = OTHERS)]
    pub(crate) scaling: bool,

    /// Numbers of LiDAR points, of clips with images of --fixed-image-size
    #[arg(
        long, value_name = "A,B", value_delimiter = ',', requires = "scaling", conflicts_with = "clips", value_parser = points(),
        default_value = "10000,30000,100000,300000,1000000,2000000"
    )]
    points: Vec<u32>,

    /// Sizes of images, height x width, of clips with --fixed-points
    #[arg(
        long,
        value_name = "HxW,HxW",
        value_delimiter = ',',
        requires = "scaling",
        conflicts_with = "clips",
        default_value = "128x256,256x512,540x960,1080x1920"
    )]
    image_sizes: Vec<ImageSize>,

    /// Number of LiDAR points of the clips whose images grow
    #[arg(long, value_name = "N", requires = "scaling", conflicts_with = "clips", value_parser = points(), default_value = "100000")]
    fixed_points: u32,

    /// Size of the images of the clips whose points grow
    #[arg(long, value_name = "HxW", requires = "scaling", conflicts_with = "clips", default_value = "256x512")]
    fixed_image_size: ImageSize,

    /// What this program starts itself with: a clip whose times are to be found out, for one line of JSON
    #[arg(long, value_name = "DIR", requires = "scaling", conflicts_with = "clips", hide = true)]
    pub(crate) times_of: Option<PathBuf>,

    /// The same for what it needs
    #[arg(long, value_name = "DIR", requires = "scaling", conflicts_with_all = ["clips", "times_of"], hide = true)]
    pub(crate) space_of: Option<PathBuf>,
}

fn points() -> RangedU64ValueParser<u32> {
    RangedU64ValueParser::new().range(POINTS)
}

impl ScalingArgs {
    /// What is measured.
    pub(crate) fn plan(&self) -> Plan {
        Plan {
            points: self.points.iter().map(|&count| count as usize).collect(),
            image_sizes: self.image_sizes.clone(),
            num_points: self.fixed_points as usize,
            image_size: self.fixed_image_size,
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};
    use lgs_measure::scaling::plan::Axis;

    use crate::args::Args;

    /// Flags that mean the same with `--scaling` as without.
    const SHARED: [&str; 6] = ["out", "weights", "repeats", "threads", "seed", "scaling"];

    fn parse(line: &str) -> Result<Args, clap::Error> {
        Args::try_parse_from(std::iter::once("lgs-sweep").chain(line.split(' ')))
    }

    #[test]
    fn it_needs_no_clips_and_goes_along_both_axes() {
        let plan = parse("--scaling --out o").unwrap().sweep.scaling.plan();
        let points: Vec<usize> = plan.along(Axis::Points).iter().map(|size| size.points).collect();
        assert_eq!(points, [10_000, 30_000, 100_000, 300_000, 1_000_000, 2_000_000]);
        let heights: Vec<usize> = plan.along(Axis::Pixels).iter().map(|size| size.height).collect();
        assert_eq!((heights, plan.sizes().len()), (vec![128, 256, 540, 1080], 9));
        let line = "--scaling --out o --points 500,300 --image-sizes 16x32 --fixed-points 400 --fixed-image-size 32x64";
        let plan = parse(line).unwrap().sweep.scaling.plan();
        assert_eq!((plan.sizes().len(), plan.num_points, plan.image_size.width), (3, 400, 64));
    }

    #[test]
    fn what_does_not_go_together_is_refused() {
        for line in [
            "--scaling",
            "--scaling --out o a",
            "--scaling --out o --adam 1",
            "--scaling --out o --no-adam",
            "--scaling --out o --refine-steps 1",
            "--scaling --out o --hold-out odd",
            "--scaling --out o --warm-up 0",
            "--scaling --out o --one 0:0",
            "--scaling --out o --points 0",
            "--scaling --out o --points 10,9000000",
            "--scaling --out o --image-sizes 10",
            "--scaling --out o --times-of a --space-of b",
            "a --out o --points 1000",
            "a --out o --image-sizes 16x32",
            "a --out o --times-of a",
            "--out o",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
    }

    /// A flag that is added to the sweep has to be named among those that `--scaling` refuses, or here.
    #[test]
    fn every_flag_of_the_sweep_goes_with_it_or_is_refused() {
        let command = Args::command();
        let scaling = command.get_arguments().find(|flag| flag.get_id() == "scaling").unwrap();
        let refused: Vec<&str> =
            command.get_arg_conflicts_with(scaling).into_iter().map(|flag| flag.get_id().as_str()).collect();
        let own = ["points", "image_sizes", "fixed_points", "fixed_image_size", "times_of", "space_of"];
        for flag in command.get_arguments().map(|flag| flag.get_id().as_str()) {
            let known = refused.contains(&flag) || SHARED.contains(&flag) || own.contains(&flag);
            assert!(known || ["one", "help", "version"].contains(&flag), "{flag}");
        }
    }
}
