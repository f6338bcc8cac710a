//! `depthloom explain`: where a number comes from.

use depthloom_runs::{end, failed, open_frames};
use depthloom_terminal::{CliError, ExitCode, print};

use crate::args::{ExplainArgs, PixelsOption};
use crate::output;
use crate::results::frames::note_frames_beyond;
use crate::signals;

/// Prints how a metric of an estimate was computed.
pub(crate) fn explain(args: &ExplainArgs) -> Result<ExitCode, CliError> {
    if args.scores.pixels == Some(PixelsOption::Common) {
        return Err(CliError::usage(
            "`explain` does not support `--pixels common`: that pixel set depends on which estimates are compared",
            "use `depthloom table RUN --pixels common`, or `explain --pixels valid`",
        ));
    }
    let path = args.run.recording("explain")?;
    let interrupt = signals::listen("stopping")?;
    let recording = open_frames(&path)?;
    let selection = args.scores.selection();
    let stop = || interrupt.stops_admission();
    let explanation = depthloom_analysis::explain(&recording, &args.metric, &args.estimate, &selection, &stop);
    let explanation = explanation.map_err(failed)?;
    note_frames_beyond([&recording], args.scores.frames.as_ref());
    if args.output.json {
        output::print(&explanation)?;
    } else {
        print(explanation.text())?;
    }
    Ok(end([&recording]))
}
