//! `depthloom runs rm`: removes runs.

use std::path::Path;

use depthloom_runs::{bytes_in, named_in_full, run_folder::Removal};
use depthloom_terminal::{Exit, Stop, print};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::{RmArgs, RunsArgs};
use crate::diagnostics::{Error, print_stop};
use crate::outputs::{self, CommandOutput, Output};
use crate::sizes::size;

/// Of `runs rm`: what was removed.
#[derive(JsonSchema, Serialize)]
pub struct RunsRm {
    removed: Vec<Removed>,
    bytes: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

impl CommandOutput for RunsRm {
    const OUTPUT: Output = Output::RunsRm;
}

/// A run that was removed.
#[derive(JsonSchema, Serialize)]
pub struct Removed {
    path: String,
    bytes: u64,
}

/// Removes the runs that are named: all of them, or none if one may not be removed.
pub fn rm(args: &RunsArgs, asked: &RmArgs) -> Result<Exit, Stop> {
    let mut removals: Vec<Removal> = Vec::new();
    for run in &asked.runs {
        let folder = named_in_full(run, &args.folder)?;
        // A run may be named twice.
        let is_taken = |removal: &Removal| same(removal.folder(), &folder);
        if !removals.iter().any(is_taken) {
            removals.push(Removal::of(&folder)?);
        }
    }
    let mut done = RemovedRuns::default();
    removals.into_iter().try_for_each(|removal| done.remove(removal, args.json))?;
    done.tell(args, |removed, bytes, error| RunsRm { removed, bytes, error })
}

fn same(one: &Path, other: &Path) -> bool {
    one.canonicalize().is_ok_and(|one| other.canonicalize().is_ok_and(|other| one == other))
}

/// What was removed.
#[derive(Default)]
pub(super) struct RemovedRuns {
    runs: Vec<Removed>,
    bytes: u64,
    failed: Vec<Stop>,
}

impl RemovedRuns {
    /// Removes a run and says so; what fails is kept to be told, and the others go on.
    pub(super) fn remove(&mut self, removal: Removal, as_json: bool) -> Result<(), Stop> {
        let (folder, bytes) = (removal.folder().to_owned(), bytes_in(removal.folder()));
        match removal.remove() {
            Ok(()) => self.add("removed", &folder, bytes, as_json)?,
            Err(stop) => self.failed.push(stop),
        }
        Ok(())
    }

    /// Says what was done, or would be.
    pub(super) fn add(&mut self, what: &str, folder: &Path, bytes: u64, as_json: bool) -> Result<(), Stop> {
        self.bytes += bytes;
        self.runs.push(Removed { path: folder.to_string_lossy().into_owned(), bytes });
        if as_json { Ok(()) } else { print(format!("{what} {} ({})\n", folder.display(), size(bytes))) }
    }

    /// How many, and how many bytes they had.
    pub(super) const fn sum(&self) -> (usize, u64) {
        (self.runs.len(), self.bytes)
    }

    /// Tells programs what was removed, in the output that `output` makes of it, and everybody what could not be.
    pub(super) fn tell<T: CommandOutput>(
        self,
        args: &RunsArgs,
        output: impl FnOnce(Vec<Removed>, u64, Option<Error>) -> T,
    ) -> Result<Exit, Stop> {
        let exit = self.failed.first().map_or(Exit::Whole, |stop| stop.exit);
        self.failed.iter().for_each(print_stop);
        if args.json {
            outputs::print(&output(self.runs, self.bytes, self.failed.first().map(Error::from)))?;
        }
        Ok(exit)
    }
}
