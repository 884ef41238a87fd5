//! Acts on the flags.

use std::{
    fmt::Write,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail};
use lgs_cli::{Outcome, threads};
use lgs_engine::{
    evaluate::lpips::Lpips,
    network::{config::StepLength, source::LoadedModel},
    recipe::flags,
    refine::LineSearch,
};
use lgs_formats::digest::sha256;
use lgs_measure::{
    clips::open,
    machine::Machine,
    sweep::{
        budget::BudgetRow,
        budget_run::BudgetRun,
        case::Case,
        grid::{Parts, Run, runs_of},
        job::{SweepFindings, SweepJob},
        measure::{RunEvaluation, evaluate},
        pages::{ClipTable, clip_options},
        setting::Weights,
        table::PointRow,
    },
};

use crate::{
    ablate::ablate,
    apart::{answer, ask},
    args::{Args, Command as Task, SweepArgs},
    density::density,
    progress::Teller,
    rates::rates,
    scaling,
    values::{One, WeightsArg},
};

/// The networks that are tried, in the order of their flags.
struct Networks<'a> {
    loaded: Vec<LoadedModel>,
    named: Vec<(Weights, &'a WeightsArg)>,
}

/// Does what the command line asks for.
pub(crate) fn run(args: &Args) -> Result<Outcome> {
    match &args.command {
        Some(Task::Ablate(args)) => Ok(ablate(args)?.into()),
        Some(Task::Rates(args)) => Ok(rates(args)?.into()),
        Some(Task::Density(args)) => Ok(density(args)?.into()),
        None => measure(&args.sweep),
    }
}

fn measure(args: &SweepArgs) -> Result<Outcome> {
    let threads = threads::set_num_threads(args.threads())?;
    let networks = networks(args)?;
    if args.scaling.scaling {
        return scaling::run(args, threads, &networks.loaded);
    }
    let grid = grid(args, &networks);
    for setting in grid.iter().flat_map(|run| &run.settings) {
        setting.recipe.device.check()?;
    }
    match args.one {
        Some(one) => Ok(evaluate_one(args, one, &networks, &grid)?.into()),
        None => sweep(args, threads, &networks, grid),
    }
}

fn networks(args: &SweepArgs) -> Result<Networks<'_>> {
    let mut networks = Networks { loaded: Vec::new(), named: Vec::new() };
    for weights in &args.weights {
        let Some(loaded) = weights.source.load(args.seed)? else { continue };
        if networks.loaded.iter().all(|other| other.digest != loaded.digest) {
            networks.named.push((Weights { name: weights.name(), sha256: loaded.digest.clone() }, weights));
            networks.loaded.push(loaded);
        }
    }
    Ok(networks)
}

fn grid(args: &SweepArgs, networks: &Networks<'_>) -> Vec<Run> {
    let parts = networks.loaded.iter().zip(&networks.named).map(|(loaded, (weights, _))| Parts {
        weights: weights.clone(),
        query: loaded.model.query.is_some(),
        policy: loaded.model.policy.is_some(),
        line_search: match loaded.model.config.step_length {
            StepLength::Local => LineSearch::Every,
            StepLength::Learned => LineSearch::Off,
        },
    });
    runs_of(&args.axes(), &parts.collect::<Vec<_>>())
}

/// One line of JSON: what a run is worth.
fn evaluate_one(args: &SweepArgs, one: One, networks: &Networks<'_>, grid: &[Run]) -> Result<String> {
    let clips = args.clips();
    let (Some(choice), Some(run)) = (clips.get(one.clip), grid.get(one.run)) else {
        bail!("--one: expected numbers of a clip and of a run, found {}:{}", one.clip, one.run);
    };
    let lpips = args.lpips_weights.as_deref().map(Lpips::load).transpose()?;
    let evaluation = evaluate(&Case::new(open(choice)?, choice)?, run, &networks.loaded, args.seed, lpips.as_ref())?;
    Ok(serde_json::to_string(&evaluation)?)
}

fn sweep(args: &SweepArgs, threads: usize, networks: &Networks<'_>, grid: Vec<Run>) -> Result<Outcome> {
    let program = std::env::current_exe().context("this program: find")?;
    let evaluate = |clip: usize, run: usize| evaluate_apart(&program, One { clip, run });
    let infer = program.with_file_name(format!("lgs-infer{}", std::env::consts::EXE_SUFFIX));
    if !args.budgets.is_empty() && !infer.is_file() {
        bail!("--budgets: expected lgs-infer beside this program, found nothing at {}", infer.display());
    }
    let out = output_dir(args.out.as_deref())?;
    let weights = networks.named.first().map_or("none", |(_, arg)| &arg.text);
    let clips = args.clips();
    let run_budget = |clip: usize, budget_s: f64| {
        let mut command = Command::new(&infer);
        command.arg(&clips[clip].dir).args(flags(clip_options(&clips[clip]))).args(["--weights", weights]);
        command.args(["--seed", &args.seed.to_string(), "--threads", &threads.to_string()]);
        command.args(["--time-budget", &budget_s.to_string(), "--views", "held-out", "--json", "--out"]);
        BudgetRun::of(&answer(command.arg(out.join("budget")))?)
    };
    let [repeats, warm_up] = args.rounds();
    let job = SweepJob {
        clips: clips.clone(),
        models: &networks.loaded,
        weights: networks.named.iter().map(|(weights, arg)| (weights.clone(), arg.text.clone())).collect(),
        runs: grid,
        repeats,
        warm_up,
        lpips: args.lpips_weights.as_deref().map(lpips_digest).transpose()?,
        seed: args.seed,
        machine: Machine::this(&program, threads)?,
        out: out.clone(),
        evaluate: &evaluate,
        budgets: args.budgets.clone(),
        run_budget: &run_budget,
    };
    let teller = Teller::new(job.total_weight());
    let found = job.run(&teller)?;
    drop(teller);
    Ok(outcome(&found, &job.out))
}

/// The output directory, once it is known that it is one or can become one.
pub(crate) fn output_dir(out: Option<&Path>) -> Result<PathBuf> {
    let out = out.context("--out: expected a directory, found nothing")?;
    let existing = out.ancestors().find(|path| !path.as_os_str().is_empty() && path.exists());
    if let Some(other) = existing.filter(|path| !path.is_dir()) {
        bail!("--out: expected a directory, found another kind of file at {}", other.display());
    }
    Ok(out.to_owned())
}

/// SHA-256 of weights of LPIPS that can be used.
fn lpips_digest(file: &Path) -> Result<String> {
    Lpips::load(file)?;
    Ok(sha256(&std::fs::read(file).with_context(|| format!("{}: read", file.display()))?))
}

/// What a run is worth, found out by this program in a process of its own with the same flags.
fn evaluate_apart(program: &Path, one: One) -> lgs_measure::error::Result<RunEvaluation> {
    ask(program, &["--one".as_ref(), format!("{}:{}", one.clip, one.run).as_ref()])
}

fn outcome(found: &SweepFindings, out: &Path) -> Outcome {
    let mut text = String::new();
    for ClipTable { clip, rows, budgets } in &found.tables {
        // Writing to a String cannot fail.
        let _ =
            writeln!(text, "{clip}: {} configurations, of which nothing is both faster and better than", rows.len());
        let mut front: Vec<&PointRow> = rows.iter().filter(|row| row.on_front).collect();
        front.sort_by(|a, b| a.seconds.median.total_cmp(&b.seconds.median));
        for row in front {
            let psnr = row.figures.psnr.map_or("–".to_owned(), |psnr| format!("{psnr:.2}"));
            let adam = row.speed_up().map_or(String::new(), |times| format!("  Adam takes {times:.1} times as long"));
            let _ = writeln!(text, "  {:8.3} s  {psnr} dB  {}{adam}", row.seconds.median, row.name);
        }
        for row in budgets {
            let psnr = row.psnr.map_or("–".to_owned(), |psnr| format!("{psnr:.2}"));
            let best =
                row.best.as_ref().map_or("none".to_owned(), |best| format!("{:.2} dB, {}", best.psnr, best.name));
            let BudgetRow { budget_s, finished_s, flags, .. } = row;
            let _ = writeln!(
                text,
                "  budget {budget_s} s: finished after {:.2} s, {psnr} dB, {flags}; best that fits: {best}",
                finished_s.median
            );
        }
    }
    let _ = writeln!(text, "  to look at  {}", out.join("report.html").display());
    Outcome { text, notes: Vec::new(), has_findings: !found.failed.is_empty() }
}
