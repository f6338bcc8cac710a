//! `depthloom run`: from an experiment file to a recording, a table and plots.

use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::Ready;
use depthloom_graphs::{Registry, counted};
use depthloom_jobs::{Fraction, Shard, ShardFolder};
use depthloom_runner::Unwatched;
use depthloom_terminal::{CliError, ExitCode, say};

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
    if shard.is_some() || args.require_shards {
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
    if !is_silent(args) {
        say(match missing {
            0 => "all shards are complete: the same command without --shard joins them".to_owned(),
            1 => "one shard is missing; then the same command without --shard joins all".to_owned(),
            _ => format!("{missing} shards are missing; then the same command without --shard joins all"),
        });
    }
    computed.print()
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
    match missing.first() {
        Some(first) if args.require_shards => {
            let others = missing.len() - 1;
            let more = if others > 0 { format!(", and {others} more") } else { String::new() };
            let what = format!("shard {} cannot be used: {}{more} (--require-shards)", first.name, first.damage);
            let by = if first.name.starts_with("variants") { " --by variants" } else { "" };
            let command = format!("the same command with `--shard {}{by}` instead of --require-shards", first.part);
            Err(CliError::usage(what, format!("{command} computes it; without either, this command does")))
        }
        None if args.require_shards && !shards.has_shards() => {
            let what = "there are no shards of this experiment with these options (--require-shards)";
            Err(CliError::usage(what, "the same command with `--shard 1/N` instead of --require-shards computes one"))
        }
        Some(first) => {
            let (count, name) = (counted(missing.len() as u64, "shard"), &first.name);
            Ok(vec![format!(
                "{count} cannot be used, the first is {name}: {}; this run computes their values",
                first.damage
            )])
        }
        None => Ok(Vec::new()),
    }
}
