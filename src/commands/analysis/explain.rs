//! `depthloom explain`: where a number comes from.

use depthloom_runs::{end, failed, open_frames, recording_of};
use depthloom_terminal::{CliError, ExitCode, print};

use crate::args::{ExplainArgs, SetOption};
use crate::output;
use crate::signals;

/// Says where a score of an estimate comes from.
pub(crate) fn explain(args: &ExplainArgs) -> Result<ExitCode, CliError> {
    if args.scores.set == Some(SetOption::Common) {
        return Err(CliError::usage(
            "`explain` does not support `--set common`: that pixel set depends on which estimates are compared",
            "`depthloom table RUN --set common` compares; explain one of another --set",
        ));
    }
    let path = recording_of(&args.run, "explain")?;
    let interrupt = signals::listen("stopping")?;
    let recording = open_frames(&path)?;
    let selection = args.scores.selection();
    let stop = || interrupt.stops_admission();
    let explanation = depthloom_analysis::explain(&recording, &args.score, &args.estimate, &selection, &stop);
    let explanation = explanation.map_err(failed)?;
    if args.output.json {
        output::print(&explanation)?;
    } else {
        print(explanation.text())?;
    }
    Ok(end([&recording]))
}
