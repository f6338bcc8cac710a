//! `depthloom runs`: the folder of runs.

mod list;
mod prune;
mod rm;
mod show;
mod why;

use depthloom_terminal::{Exit, Stop};
pub use list::RunsList;
pub use prune::RunsPrune;
pub use rm::RunsRm;
pub use show::RunsShow;
pub use why::RunsWhy;

use crate::args::{RunsArgs, RunsCommand};

/// Lists runs, or does what else is asked for with them.
pub fn runs(args: &RunsArgs) -> Result<Exit, Stop> {
    match &args.command {
        None | Some(RunsCommand::List) => list::list(args),
        Some(RunsCommand::Show(asked)) => show::show(args, asked),
        Some(RunsCommand::Why(asked)) => why::why(args, asked),
        Some(RunsCommand::Rm(asked)) => rm::rm(args, asked),
        Some(RunsCommand::Prune(rules)) => prune::prune(args, rules),
    }
}
