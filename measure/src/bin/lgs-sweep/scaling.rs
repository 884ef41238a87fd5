//! Acts on the flags of `--scaling`.

use std::{
    fmt::Write,
    path::{Path, PathBuf},
    sync::Arc,
};

use anyhow::{Context, Result, bail};
use lgs_cli::Outcome;
use lgs_engine::network::source::LoadedModel;
use lgs_formats::clip_dir::ClipDir;
use lgs_measure::{
    error::Result as MeasureResult,
    machine::Machine,
    scaling::{
        fit::{PowerLaw, STEEP},
        job::{Meter, ScalingFindings, ScalingJob},
        measure::{Bench, Space, Times},
        plan::Axis,
        record::{SIZE_FORMAT, ScalingKey},
        table::PartRow,
    },
};

use crate::{apart::ask, args::SweepArgs, progress::Teller, run::output_dir};

/// This program in other processes.
#[derive(Debug)]
struct Others {
    program: PathBuf,
}

impl Meter for Others {
    fn times(&self, dir: &Path) -> MeasureResult<Times> {
        ask(&self.program, &["--times-of".as_ref(), dir.as_os_str()])
    }

    fn space(&self, dir: &Path) -> MeasureResult<Space> {
        ask(&self.program, &["--space-of".as_ref(), dir.as_os_str()])
    }
}

/// Measures how cost grows, or a single clip of those that tell.
pub(crate) fn run(args: &SweepArgs, threads: usize, models: &[LoadedModel]) -> Result<Outcome> {
    let model = match models {
        [] => None,
        [model] => Some(model),
        more => bail!("--weights: expected those of one network with --scaling, found {}", more.len()),
    };
    let [repeats, _] = args.rounds();
    let bench = |dir: &Path, answer: &dyn Fn(&Bench<'_>) -> Result<String>| {
        let dir = Arc::new(ClipDir::open(dir)?);
        Ok(answer(&Bench { dir: &dir, model, seed: args.seed })?.into())
    };
    match (&args.scaling.times_of, &args.scaling.space_of) {
        (Some(dir), _) => bench(dir, &|bench| Ok(serde_json::to_string(&bench.times(repeats)?)?)),
        (_, Some(dir)) => bench(dir, &|bench| Ok(serde_json::to_string(&bench.space()?)?)),
        (None, None) => measure(args, threads, model.map(|model| model.digest.clone())),
    }
}

fn measure(args: &SweepArgs, threads: usize, weights: Option<String>) -> Result<Outcome> {
    let program = std::env::current_exe().context("this program: find")?;
    let [repeats, _] = args.rounds();
    let machine = Machine::this(&program, threads)?;
    let key = ScalingKey { format: SIZE_FORMAT.to_owned(), weights, seed: args.seed, repeats, machine };
    let meter = Others { program };
    let job = ScalingJob { plan: args.scaling.plan(), key, out: output_dir(args.out.as_deref())?, meter: &meter };
    let teller = Teller::new(job.total_weight());
    let found = job.run(&teller)?;
    drop(teller);
    Ok(outcome(&found, &job.out))
}

fn outcome(found: &ScalingFindings, out: &Path) -> Outcome {
    let mut text = String::new();
    for axis in Axis::ALL {
        let rows: Vec<&PartRow> = found.rows.iter().filter(|row| row.axis == axis).collect();
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "more {}: exponents of time and of memory against work, above {STEEP} marked *",
            axis.name()
        );
        for row in rows.into_iter().filter(|row| row.time.law.is_some() || row.memory.law.is_some()) {
            let (time, memory) = (law(row.time.law), law(row.memory.law));
            let _ = writeln!(text, "  {:<15} {time:<14} {memory:<14} {}", row.part.key(), row.time.unit(row.units));
        }
    }
    let _ = writeln!(text, "  to look at  {}", out.join("scaling.html").display());
    Outcome { text, notes: Vec::new(), has_findings: !found.failed.is_empty() }
}

fn law(law: Option<PowerLaw>) -> String {
    law.map_or("–".to_owned(), |law| {
        let mark = if law.is_steep() { " *" } else { "" };
        format!("{:.2} ± {:.2}{mark}", law.exponent, law.standard_error)
    })
}
