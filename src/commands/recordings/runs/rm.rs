//! `depthloom runs rm`: removes runs.

use std::path::Path;

use depthloom_runs::{named_in_full, run_folder::Removal};
use depthloom_terminal::{CliError, ExitCode};
use schemars::JsonSchema;
use serde::Serialize;

use super::{Removed, RemovedRuns};
use crate::args::{RmArgs, RunsArgs};
use crate::output::diagnostics::Error;

/// Output of `runs rm`: the runs that were removed.
#[derive(Default, JsonSchema, Serialize)]
pub(crate) struct RunsRm {
    removed: Vec<Removed>,
    bytes: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// Removes the runs that are named: all of them, or none if one may not be removed.
pub(super) fn rm(args: &RunsArgs, named: &RmArgs) -> Result<ExitCode, CliError> {
    let folder_of_runs = args.folder.path();
    // Without this check, names would be looked up in the current directory.
    if folder_of_runs != Path::new(depthloom_runs::FOLDER) && !folder_of_runs.is_dir() {
        let what = format!("--runs {}: there is no such folder", folder_of_runs.display());
        return Err(CliError::usage(what, "name the folder that holds the runs"));
    }
    let mut removals: Vec<Removal> = Vec::new();
    for run in &named.runs {
        let folder = named_in_full(run, &folder_of_runs)?;
        // A run may be named twice.
        let is_listed = |removal: &Removal| same(removal.folder(), &folder);
        if !removals.iter().any(is_listed) {
            removals.push(Removal::prepare(&folder)?);
        }
    }
    let mut done = RemovedRuns::default();
    removals.into_iter().try_for_each(|removal| done.remove(removal, args.json))?;
    done.finish(args, |removed, bytes, error| RunsRm { removed, bytes, error })
}

fn same(one: &Path, other: &Path) -> bool {
    one.canonicalize().is_ok_and(|one| other.canonicalize().is_ok_and(|other| one == other))
}
