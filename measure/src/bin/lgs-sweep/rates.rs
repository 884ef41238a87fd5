//! Acts on the flags of `rates`.

use std::io::Write;

use anyhow::{Context, Result, bail};
use lgs_cli::threads;
use lgs_engine::{
    densify::Density,
    pipeline::{NetworkSettings, Silent, Watch, run_network},
    recipe::Recipe,
};
use lgs_measure::{
    ablate::{
        rates::{SEARCH_FILE, Search, Start, Trial, psnr_after},
        subject::Subject,
    },
    clips::open,
};
use lgs_train::stages::clips::find;

use crate::rates_args::RatesArgs;

/// The text for standard output.
pub(crate) fn rates(args: &RatesArgs) -> Result<String> {
    if !args.marks.is_sorted_by(|a, b| a < b) || args.marks.first() == Some(&0) {
        bail!("--marks: expected ascending numbers from 1 on, found {:?}", args.marks);
    }
    threads::set_num_threads(args.threads)?;
    std::fs::create_dir_all(&args.out).with_context(|| format!("{}: create", args.out.display()))?;
    let model = args.weights.load(0)?;
    let mut dirs = Vec::new();
    for path in &args.clips {
        dirs.extend(find(path)?);
    }
    let choices: Vec<_> = dirs.into_iter().take(args.count).map(|dir| args.choice(dir)).collect();
    let subject = |choice| Subject::load(open(choice)?, choice, None);
    let subjects = choices.iter().map(subject).collect::<Result<Vec<_>, _>>()?;
    let (mut starts, mut names) = (Vec::new(), Vec::new());
    for (subject, choice) in subjects.iter().zip(&choices) {
        let mut scene = subject.start()?.scene;
        if let Some(loaded) = &model {
            let recipe = Recipe { refine_steps: 0, ..Recipe::default().with_density(Density::Off) };
            let settings = NetworkSettings::of(&recipe, &loaded.model, 0, None);
            run_network(&mut scene, &subject.views(), &settings, &mut Watch::new(&Silent))?;
        }
        let recorded = serde_json::to_string(&choice.recorded()).context("encode a choice")?;
        let [inputs, held_out] = subject.num_views();
        names.push(format!(
            "{} {recorded}: {inputs} input and {held_out} held-out views",
            subject.session().clip().name
        ));
        starts.push(Start { subject, scene });
    }
    if let Some(loaded) = &model {
        names.push(format!("predicted with weights {}", loaded.digest));
    }
    let mut search = Search::open(&args.out, args.settings(names))?;
    let mut measure = |rates, marks: &[usize]| psnr_after(&starts, rates, marks);
    let best = search.run(&args.out, &mut measure, &mut told)?;
    Ok(format!("{} trials, {best:?}, {}", search.trials.len(), args.out.join(SEARCH_FILE).display()))
}

/// A line on standard error for a trial.
fn told(trial: &Trial) {
    let psnr: Vec<String> = trial.psnr.iter().map(|psnr| format!("{psnr:.3}")).collect();
    // Nobody reads what cannot be written.
    let _ = writeln!(std::io::stderr(), "{:.4} dB ({}) with {:?}", trial.score, psnr.join(", "), trial.rates);
}
