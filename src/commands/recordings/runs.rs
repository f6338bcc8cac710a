//! `depthloom runs`: the folder of runs.

mod diff;
mod list;
mod notes;
mod prune;
mod recover;
mod rm;
mod show;
mod timings;

use std::path::Path;

use depthloom_runs::{FoundRun, all, bytes_in, run_folder::Removal};
use depthloom_terminal::{CliError, ExitCode, print, size};
use schemars::JsonSchema;
use serde::Serialize;

pub(crate) use list::RunsList;
pub(crate) use notes::RunsNotes;
pub(crate) use prune::RunsPrune;
pub(crate) use recover::Recover;
pub(crate) use rm::RunsRm;
pub(crate) use show::RunsShow;
pub(crate) use timings::Timings;

use crate::args::{ListFilter, RunsArgs, RunsCommand};
use crate::output::diagnostics::{Error, print_stop};
use crate::output::{self, CommandOutput};

/// Lists runs, or executes one of the commands for runs.
pub(crate) fn runs(args: &RunsArgs) -> Result<ExitCode, CliError> {
    if args.command.is_some() && args.filter != ListFilter::default() {
        let what = "`--where` and `--names` go after `list`, and not before another command";
        return Err(CliError::usage(what, "write `depthloom runs list --where CONDITION`"));
    }
    match &args.command {
        None => list::list(args, &args.filter),
        Some(RunsCommand::List(command)) => list::list(args, &command.filter),
        Some(RunsCommand::Tag(command)) => notes::tag(args, command),
        Some(RunsCommand::Note(command)) => notes::note(args, command),
        Some(RunsCommand::Show(command)) => show::show(args, command),
        Some(RunsCommand::Diff(command)) => diff::diff(args, command),
        Some(RunsCommand::Timings(command)) => timings::timings(args, command),
        Some(RunsCommand::Recover(command)) => recover::recover(args, command),
        Some(RunsCommand::Rm(command)) => rm::rm(args, command),
        Some(RunsCommand::Prune(rules)) => prune::prune(args, rules),
    }
}

fn all_in(args: &RunsArgs) -> Result<Vec<FoundRun>, CliError> {
    let folder = args.folder.path();
    all(&folder).map_err(|error| {
        let stop = CliError::because(ExitCode::Usage, format_args!("failed to list {}", folder.display()), &error);
        stop.remedy("without --out, `depthloom run` writes to `runs`; name another folder with --runs")
    })
}

/// A run that was removed.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Removed {
    path: String,
    bytes: u64,
}

#[derive(Default)]
struct RemovedRuns {
    runs: Vec<Removed>,
    bytes: u64,
    failed: Vec<CliError>,
}

impl RemovedRuns {
    /// Removes a run and prints it; a failure is reported at the end.
    fn remove(&mut self, removal: Removal, as_json: bool) -> Result<(), CliError> {
        let (folder, bytes) = (removal.folder().to_owned(), bytes_in(removal.folder()));
        match removal.remove() {
            Ok(()) => self.add("removed", &folder, bytes, as_json)?,
            Err(stop) => self.failed.push(stop),
        }
        Ok(())
    }

    fn add(&mut self, what: &str, folder: &Path, bytes: u64, as_json: bool) -> Result<(), CliError> {
        self.bytes += bytes;
        self.runs.push(Removed { path: folder.to_string_lossy().into_owned(), bytes });
        if as_json { Ok(()) } else { print(format!("{what} {} ({})\n", folder.display(), size(bytes))) }
    }

    /// The number of runs, and of their bytes.
    const fn sum(&self) -> (usize, u64) {
        (self.runs.len(), self.bytes)
    }

    /// Prints errors, and with `--json` the output that `output` makes.
    fn finish<T: CommandOutput>(
        self,
        args: &RunsArgs,
        output: impl FnOnce(Vec<Removed>, u64, Option<Error>) -> T,
    ) -> Result<ExitCode, CliError> {
        let exit = self.failed.first().map_or(ExitCode::Success, |stop| stop.exit);
        self.failed.iter().for_each(print_stop);
        if args.json {
            output::print(&output(self.runs, self.bytes, self.failed.first().map(Error::from)))?;
        }
        Ok(exit)
    }
}
