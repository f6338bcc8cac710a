//! `depthloom run`: from an experiment file to a recording, a table and plots.

use depthloom_graphs::Registry;
use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::Ready;
use depthloom_jobs::{Fraction, Shard, ShardFolder};
use depthloom_runner::Unwatched;
use depthloom_terminal::{CliError, ExitCode};

use crate::allow_exec;
use crate::args::{RunArgs, SplitBy};
use crate::execution::shard::{compute, needs_reuse, shard_folder};
use crate::execution::{carry_out, is_silent};
use crate::experiment::{is_file, load};
use crate::signals;

/// Loads, plans, opens, runs, records, scores and prints.
pub(crate) fn run(args: &RunArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    is_file(&args.experiment)?;
    let loaded = load(&args.experiment, registry, is_silent(args))?;
    allow_exec::decide(args.exec, Some((&args.experiment.experiment, &loaded)))?;
    let shards = shard_folder(&args.folder.path(), &loaded.plan)?;
    let shard = args.shard.map(|part| shard_of(part, args.by, &loaded.plan)).transpose()?;
    if shard.is_some() {
        needs_reuse()?;
    }
    let ready = Ready::new(loaded.plan.clone(), registry).map_err(|missing| CliError::of_missing(&missing))?;
    let interrupt = signals::listen("stopping: frames in flight are finished, training is checkpointed")?;
    let Some(shard) = shard else {
        let missing = missing_shards(args, &shards)?;
        return carry_out(args, loaded, ready, &interrupt, None, &Unwatched, &missing).map(|(exit, _)| exit);
    };
    let out = shards.shard(&shard.name());
    let computed = compute(args, loaded, ready, &interrupt, &shard, (&shards, &out), &Unwatched)?;
    let missing = shards.missing(false).len();
    let experiment = args.experiment.experiment.display();
    computed.print(
        args,
        &match missing {
            0 => format!("all shards are complete: `depthloom run {experiment}` joins them"),
            1 => format!("one shard is missing; then `depthloom run {experiment}` joins them"),
            _ => format!("{missing} shards are missing; then `depthloom run {experiment}` joins them"),
        },
    )
}

fn shard_of(part: Fraction, by: SplitBy, plan: &Plan) -> Result<Shard, CliError> {
    match by {
        SplitBy::Frames => Ok(Shard::Frames { part, runs: Vec::new() }),
        SplitBy::Variants if plan.variants.len() < part.count() => {
            let variants = plan.variants.len();
            let what = format!("--shard {part} --by variants: the experiment has {variants} variants");
            Err(CliError::usage(what, "use fewer shards, or leave --by out to split the frames"))
        }
        SplitBy::Variants => Ok(Shard::Variants { part }),
    }
}

/// Warnings about shards that are not complete.
///
/// # Errors
/// With `--require-shards`, if there are some.
fn missing_shards(args: &RunArgs, shards: &ShardFolder) -> Result<Vec<String>, CliError> {
    if args.is_fresh() {
        return Ok(Vec::new());
    }
    let missing = shards.missing(args.require_shards);
    let experiment = args.experiment.experiment.display();
    let describe = |missing: &depthloom_jobs::MissingShard| {
        let state =
            missing.damage.as_ref().map_or_else(|| "is missing".to_owned(), |what| format!("is damaged: {what}"));
        let by = if missing.name.starts_with("variants") { " --by variants" } else { "" };
        let part = missing.part;
        (format!("shard {} {state}", missing.name), format!("`depthloom run {experiment} --shard {part}{by}`"))
    };
    let described: Vec<(String, String)> = missing.iter().map(describe).collect();
    match described.first() {
        Some((what, command)) if args.require_shards => {
            let others = described.len() - 1;
            let more = if others > 0 { format!(", and {others} more") } else { String::new() };
            let stop = CliError::new(ExitCode::Usage, format!("{what}{more} (--require-shards)"));
            Err(stop.remedy(format!("{command} computes it; without --require-shards this command does")))
        }
        _ if args.require_shards && !shards.path().exists() => {
            let stop = CliError::new(ExitCode::Usage, "there are no shards of this experiment (--require-shards)");
            Err(stop.remedy(format!("`depthloom run {experiment} --shard 1/N` computes one")))
        }
        _ => {
            let warning = |(what, command)| format!("{what}: it is computed now; {command} computes it elsewhere");
            Ok(described.into_iter().map(warning).collect())
        }
    }
}
