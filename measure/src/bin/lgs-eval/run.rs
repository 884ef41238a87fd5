//! Does what the command line asks for.

use std::path::Path;

use anyhow::{Context, Result, bail};
use lgs_cli::{Outcome, threads};
use lgs_engine::{
    evaluate::lpips::Lpips,
    network::source::{LoadedModel, ModelSource},
    pipeline::HoldOut,
    plan::{Named, REFINER, Record, usual},
    recipe::Recipe,
    words::Words,
};
use lgs_formats::{digest::sha256, jobs::choose_part};
use lgs_measure::evaluate::{
    drives::{Logs, TEST_LOGS, find_drives},
    findings::Findings,
    job::{EvaluationJob, merge},
    output,
    protocol::{Cutting, Name, Protocol, Windows},
    snippet::{Evaluator, NamedRecipe},
    table,
};

use crate::{
    args::{Args, Command, JobArgs},
    progress::Teller,
};

/// Does what the command line asks for.
pub(crate) fn run(args: &Args) -> Result<Outcome> {
    match &args.command {
        None => evaluate(&args.job),
        Some(Command::Merge(args)) => {
            let out = args.out.as_ref().unwrap_or(&args.folders[0]);
            let findings = merge(&args.folders, out)?;
            output::write(out, &findings)?;
            outcome(&findings, out, args.json, true)
        }
    }
}

fn evaluate(args: &JobArgs) -> Result<Outcome> {
    let out = args.out.as_deref().context("--out: expected a folder, found nothing")?;
    let protocol = protocol(args)?;
    let presets = args.recipe.first().filter(|_| args.sweep_presets);
    if let Some(flag) = presets {
        bail!("--{flag}: expected no option of a recipe beside --sweep-presets, found one");
    }
    let threads = threads::set_num_threads(args.threads())?;
    let drives = find_drives(&args.drives, &logs(args, protocol.name))?;
    let share = choose_part(out, args.part, &|name| std::env::var(name).ok())?;
    let model = args.weights.load(args.seed)?;
    let recipes = recipes(args, model.as_ref())?;
    recipes.iter().try_for_each(|named| named.recipe.device.check())?;
    let lpips = args.lpips_weights.as_deref().map(lpips).transpose()?;
    let model = model.filter(|_| recipes.iter().any(|named| named.recipe.network));
    let job = EvaluationJob {
        drives: &drives,
        evaluator: Evaluator {
            protocol: &protocol,
            recipes: &recipes,
            model: model.as_ref().map(|loaded| &loaded.model),
            lpips: lpips.as_ref().map(|(lpips, _)| lpips),
            seed: args.seed,
            scenes: args.scenes,
            viewer: args.viewer,
            threads,
        },
        weights: model.as_ref().map(|loaded| loaded.digest.clone()),
        lpips_weights: lpips.as_ref().map(|(_, digest)| digest.clone()),
        part: share.map(|(part, _)| part),
        resume: args.resume,
        out,
    };
    if let Some((_, shares)) = share {
        shares.write(out)?;
    }
    let mut teller = Teller::new();
    let (findings, _) = job.run(&mut |event| teller.tell(event))?;
    drop(teller);
    let is_whole = share.is_none();
    if is_whole {
        output::write(out, &findings)?;
    }
    outcome(&findings, out, args.json, is_whole)
}

/// The protocol that the flags ask for.
fn protocol(args: &JobArgs) -> Result<Protocol> {
    let name = args.protocol.context("--protocol: expected one, found none")?;
    let own = &args.own;
    if let Some(flag) = own.first().filter(|_| name != Name::Own) {
        bail!("--{flag}: expected --protocol own beside it, found {}, which says it itself", name.word());
    }
    let protocol = match name {
        Name::Waymo => Protocol::waymo(),
        Name::PandaSet => Protocol::pandaset(),
        Name::Own => {
            let length = own.length();
            let rule = own.hold_out.clone().unwrap_or(HoldOut::Odd);
            let mut held_out = rule.indices(length, None)?;
            held_out.sort_unstable();
            held_out.dedup();
            if held_out.len() >= length || held_out.iter().any(|&place| place >= length) {
                bail!("--hold-out: expected some of the {length} frames of a snippet, and not all, found {rule}");
            }
            let windows = Windows { length, stride: own.stride(), held_out, most: own.most() };
            Protocol { name, cameras: None, image_size: own.image_size, cutting: Cutting::Windows(windows) }
        }
    };
    Ok(Protocol { cameras: args.cameras.clone().or_else(|| protocol.cameras.clone()), ..protocol })
}

fn logs(args: &JobArgs, name: Name) -> Logs {
    match &args.logs {
        Some(names) if names.as_slice() == ["all"] => Logs::All,
        Some(names) => Logs::Names(names.clone()),
        None if name == Name::PandaSet => Logs::Numbers(TEST_LOGS.to_vec()),
        None => Logs::All,
    }
}

/// The recipes that are evaluated.
fn recipes(args: &JobArgs, model: Option<&LoadedModel>) -> Result<Vec<NamedRecipe>> {
    let has_policy = model.is_some_and(|loaded| loaded.model.policy.is_some());
    let fitted = |recipe: Recipe| {
        let mut recipe = Recipe { network: recipe.network && model.is_some(), ..recipe };
        // A limit that a preset asks for is nothing to a model without a policy.
        if args.recipe.value("max-gaussians").is_none() && !has_policy {
            recipe.max_gaussians = None;
        }
        recipe
    };
    let limit = args.recipe.value("max-gaussians").map(|_| "--max-gaussians");
    let exact = args.recipe.value("density").filter(|word| *word == "exact").map(|_| "--density exact");
    if let Some(flag) = limit.or(exact).filter(|_| args.weights == ModelSource::None) {
        bail!(
            "{flag}: expected --weights of a network, behind whose first prediction Gaussians are pruned, found --weights none"
        );
    }
    let name = |preset: Named| Named::WORDS.iter().find(|(_, value, _)| *value == preset).map_or("", |(word, ..)| word);
    let presets: Vec<Named> = if args.sweep_presets {
        Named::WORDS.iter().map(|&(_, preset, _)| preset).collect()
    } else {
        args.preset.into_iter().collect()
    };
    if presets.is_empty() {
        return Ok(vec![NamedRecipe {
            name: "LGS (here)".to_owned(),
            recipe: fitted(args.recipe.of(usual(&args.weights, args.recipe.any(REFINER)))),
        }]);
    }
    let record = Record::shipped()?;
    let recipe_of = |preset: Named| NamedRecipe {
        name: name(preset).to_owned(),
        recipe: fitted(args.recipe.of(record.preset(preset))),
    };
    Ok(presets.into_iter().map(recipe_of).collect())
}

/// LPIPS, and SHA-256 of its weights.
fn lpips(file: &Path) -> Result<(Lpips, String)> {
    let lpips = Lpips::load(file)?;
    let bytes = std::fs::read(file).with_context(|| format!("{}: read", file.display()))?;
    Ok((lpips, sha256(&bytes)))
}

fn outcome(findings: &Findings, out: &Path, json: bool, is_whole: bool) -> Result<Outcome> {
    let notes = findings.failed.iter().map(|failed| format!("{}: {}", failed.item, failed.reason)).collect();
    let text = if json {
        output::summary_json(findings)?
    } else {
        let place = if is_whole { out.join("report.html") } else { out.to_owned() };
        let what = if is_whole { "to look at" } else { "a part, written to" };
        format!("{}{what}  {}\n", table::text(findings), place.display())
    };
    Ok(Outcome { text, notes, has_findings: !findings.failed.is_empty() })
}
