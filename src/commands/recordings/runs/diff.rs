//! `depthloom runs diff`: why the values of two runs differ.

use std::path::Path;

use depthloom_runs::{end, open};
use depthloom_terminal::{CliError, ExitCode, print};
use depthloom_verify::RunDifference;

use crate::args::{DiffArgs, RunsArgs};
use crate::output;

/// Prints the differences between two runs; the first counts as the earlier one.
pub(super) fn diff(args: &RunsArgs, diff: &DiffArgs) -> Result<ExitCode, CliError> {
    let recording = |run: &Path| open(&args.folder.recording(run, "runs show")?);
    let recordings = [recording(&diff.before)?, recording(&diff.after)?];
    let [before, after] = &recordings;
    let difference = RunDifference::new(before, after)?;
    if args.json {
        output::print(&difference)?;
    } else {
        print(difference.text())?;
    }
    Ok(end(&recordings))
}
