//! `depthloom run`: from an experiment file to a recording, a table and plots.

use depthloom_graphs::Registry;
use depthloom_graphs::ready::Ready;
use depthloom_terminal::{CliError, ExitCode};

use crate::allow_exec;
use crate::args::RunArgs;
use crate::execution::{carry_out, is_silent};
use crate::experiment::{is_file, load};
use crate::signals;

/// Loads, plans, opens, runs, records, scores and prints.
pub(crate) fn run(args: &RunArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    is_file(&args.experiment)?;
    let loaded = load(&args.experiment, registry, is_silent(args))?;
    allow_exec::decide(args.exec, Some((&args.experiment.experiment, &loaded)))?;
    let ready = Ready::new(loaded.plan.clone(), registry).map_err(|missing| CliError::of_missing(&missing))?;
    let interrupt = signals::listen("stopping: frames in flight are finished, training is checkpointed")?;
    carry_out(args, loaded, ready, &interrupt, None, &[]).map(|(exit, _)| exit)
}
