//! `depthloom runs rm`: removes runs.

use std::path::Path;

use serde_json::{Value as Json, json};

use crate::args::{RmArgs, RunsArgs};
use crate::diagnostics::{error_json, print_stop};
use crate::exit::{Exit, Stop};
use crate::outputs::Output;
use crate::run_folder::Removal;
use crate::runs::{bytes_in, named_in_full};
use crate::sizes::size;
use crate::streams::{print, print_output};

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
    let mut done = Removed::default();
    removals.into_iter().try_for_each(|removal| done.remove(removal, args.json))?;
    done.tell(args, Output::RunsRm, json!({}))
}

fn same(one: &Path, other: &Path) -> bool {
    one.canonicalize().is_ok_and(|one| other.canonicalize().is_ok_and(|other| one == other))
}

/// What was removed.
#[derive(Default)]
pub(super) struct Removed {
    runs: Vec<Json>,
    bytes: u64,
    failed: Vec<Stop>,
}

impl Removed {
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
        self.runs.push(json!({ "path": folder.to_string_lossy(), "bytes": bytes }));
        if as_json { Ok(()) } else { print(format!("{what} {} ({})\n", folder.display(), size(bytes))) }
    }

    /// How many, and how many bytes they had.
    pub(super) const fn sum(&self) -> (usize, u64) {
        (self.runs.len(), self.bytes)
    }

    /// Tells programs what was removed, besides what `told` holds, and everybody what could not be.
    pub(super) fn tell(self, args: &RunsArgs, output: Output, mut told: Json) -> Result<Exit, Stop> {
        let exit = self.failed.first().map_or(Exit::Whole, |stop| stop.exit);
        self.failed.iter().for_each(print_stop);
        if args.json {
            told["removed"] = self.runs.into();
            told["bytes"] = self.bytes.into();
            if let Some(stop) = self.failed.first() {
                told["error"] = error_json(stop);
            }
            print_output(output, told)?;
        }
        Ok(exit)
    }
}
