//! `depthloom runs`: the folder of runs.

mod list;

use crate::args::{RunsArgs, RunsCommand};
use crate::exit::{Exit, Stop};

/// Lists runs, or does what else is asked for with them.
pub fn runs(args: &RunsArgs) -> Result<Exit, Stop> {
    match &args.command {
        None | Some(RunsCommand::List) => list::list(args),
    }
}
