//! `depthloom runs why`: why the values of two runs differ.

use std::path::Path;

use depthloom_runs::{open, recording_in};
use depthloom_terminal::{CliError, ExitCode, print};
use depthloom_verify::RunDifference;

use crate::args::{RunsArgs, WhyArgs};
use crate::output;

/// Prints what differs between two runs, the first of which counts as the earlier.
pub(super) fn why(args: &RunsArgs, why: &WhyArgs) -> Result<ExitCode, CliError> {
    let recording = |run: &Path| open(&recording_in(&args.folder, run, "runs show")?);
    let difference = RunDifference::new(&recording(&why.before)?, &recording(&why.after)?)?;
    if args.json {
        output::print(&difference)?;
    } else {
        print(difference.text())?;
    }
    Ok(ExitCode::Success)
}
