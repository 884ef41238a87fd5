//! The command line, as users type it.

use clap::CommandFactory;

use lgs_engine::{densify::Density, gaussians::background::Mode, recipe::Recipe};

use super::*;

fn parse(line: &str) -> Result<Args, clap::Error> {
    Args::try_parse_from(std::iter::once("lgs-infer").chain(line.split(' ')))
}

#[test]
fn the_definition_is_sound_and_every_flag_says_its_default_or_needs_none() {
    Args::command().debug_assert();
    assert_eq!(lgs_cli::flags_without_default(&Args::command()), [""; 0]);
}

#[test]
fn defaults_are_as_the_help_says() {
    let args = parse("clip").unwrap();
    assert_eq!((&args.out, &args.cameras, &args.frames, &args.hold_out), (&None, &None, &None, &HoldOut::Nothing));
    let weights = if shipped::BYTES.is_some() { ModelSource::Shipped } else { ModelSource::None };
    assert_eq!((args.views, &args.weights, args.preset, args.time_budget), (ViewsArg::All, &weights, None, None));
    assert_eq!(args.recipe.of(Recipe::default()), Recipe::default());
    assert_eq!((args.threads, args.seed, args.json), (None, 0, false));
}

#[test]
fn weights_are_a_file_a_config_or_none() {
    let weights = |line: &str| parse(line).unwrap().weights;
    assert_eq!(weights("c --weights tiny.safetensors"), ModelSource::File("tiny.safetensors".into()));
    assert_eq!((weights("c --weights tiny"), weights("c --weights none")), (ModelSource::Shipped, ModelSource::None));
    assert_eq!(weights("c --weights random:full.json"), ModelSource::Random("full.json".into()));
    assert_eq!(parse("--describe full.json").unwrap().describe, Some("full.json".into()));
}

#[test]
fn lists_and_rules_are_read() {
    let args = parse("c --frames 0,2,5..8 --hold-out 2,6 --cameras A,B --image-size 304x484 --at-time -0.5").unwrap();
    assert_eq!(args.frames, Some(FrameList(vec![0, 2, 5, 6, 7, 8])));
    assert_eq!(args.hold_out, HoldOut::List(vec![2, 6]));
    assert_eq!(args.cameras, Some(vec!["A".to_owned(), "B".to_owned()]));
    assert_eq!(args.image_size.map(|size| [size.height, size.width]), Some([304, 484]));
    assert_eq!(args.at_time, Some(-0.5));
    assert_eq!(parse("c --hold-out odd").unwrap().hold_out, HoldOut::Odd);
    let every = parse("c --hold-out every:10 --threads 3 --views held-out").unwrap();
    assert_eq!(every.hold_out, HoldOut::Every(NonZeroUsize::new(10).unwrap()));
    assert_eq!((every.threads().map(NonZeroUsize::get), every.views), (Some(3), ViewsArg::HeldOut));
}

#[test]
fn one_of_two_refines() {
    let steps = |line: &str, base: Recipe| {
        let recipe = parse(line).unwrap().recipe.of(base);
        [recipe.refine_steps, recipe.adam_passes]
    };
    let usual = Recipe::default();
    assert_eq!(steps("c", usual), [3, 0]);
    assert_eq!(steps("c --refine-with adam:30", usual), [0, 30]);
    assert_eq!(steps("c --refine-with adam:30 --refine-steps 2", usual), [2, 30]);
    let both = Recipe { refine_steps: 2, adam_passes: 10, ..usual };
    assert_eq!(steps("c --preset accurate", both), [2, 10]);
    assert_eq!(steps("c --preset accurate --refine-with learned", both), [2, 0]);
    let looks = parse("c --refine-views 4 --pixel-stride 2 --background gaps --query off").unwrap().recipe.of(usual);
    assert_eq!((looks.refine_views, looks.pixel_stride), (NonZeroUsize::new(4), "2".parse().unwrap()));
    assert_eq!((looks.background, looks.query, looks.density), (Mode::Gaps, false, Density::Exact));
}

#[test]
fn what_makes_no_sense_is_refused() {
    for line in [
        "c --frames 5..2",
        "c --frames -1",
        "c --frames 0..99999999999",
        "c --frames 1,,2",
        "c --sequence 0",
        "c --sequence inf",
        "c --hold-out every:0",
        "c --hold-out even",
        "c --at-time inf",
        "c --at-time NaN",
        "c --threads 0",
        "c --threads 5000",
        "c --image-size 304",
        "c --image-size 0x10",
        "c --weights random:",
        "c --refine-steps -1",
        "c --refine-with adam",
        "c --refine-with adam:-1",
        "c --refine-with adam:1000000",
        "c --refine-with nobody",
        "c --refine-views 0",
        "c --pixel-stride 0",
        "c --pixel-stride 65",
        "c --query maybe",
        "c --preset slow",
        "c --time-budget 0",
        "c --time-budget NaN",
        "c --time-budget 3 --preset fast",
        "c --time-budget 3 --refine-steps 1",
        "c --theta-add 1.5",
        "c --theta-prune NaN",
        "c --describe models/tiny.json",
        "--json",
        "c --seed -1",
        "c --unknown 1",
        "c another",
    ] {
        assert!(parse(line).is_err(), "{line}");
    }
}

#[test]
fn a_film_has_a_path_and_its_own_flags_need_one() {
    let args_of = |line: &str| parse(line).unwrap();
    assert_eq!((args_of("c").path, args_of("c --path between-inputs").path), (None, Some(PathArg::BetweenInputs)));
    let args = args_of("c --path p.json --path-frames 7 --path-camera A --path-fps 24");
    assert_eq!((args.path, args.path_frames), (Some(PathArg::File("p.json".into())), Some(7)));
    assert_eq!((args.path_camera.as_deref(), args.path_fps), (Some("A"), Some(24.0)));
    for line in ["c --path-frames 3", "c --path-fps 3", "c --path-camera A", "c --path p --path-frames 0"] {
        assert!(parse(line).is_err(), "{line}");
    }
    assert!(parse("c --path p --path-frames 10001").is_err() && parse("c --path p --path-fps 0").is_err());
}
