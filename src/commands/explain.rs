//! `depthloom explain`: where a number comes from.

use depthloom_runs::end;
use depthloom_runs::failed;
use depthloom_runs::open;
use depthloom_runs::recording_of;
use depthloom_terminal::{Exit, Stop, print};

use super::table::selection;
use crate::args::{ExplainArgs, SetOption};
use crate::outputs::{self, CommandOutput, Output};
use crate::signals;

impl CommandOutput for depthloom_analysis::Explain {
    const OUTPUT: Output = Output::Explain;
}

/// Says where a score of an estimator comes from.
pub fn explain(args: &ExplainArgs) -> Result<Exit, Stop> {
    if args.scores.set == Some(SetOption::Common) {
        return Err(Stop::new(Exit::Before, "what all answered depends on which estimates are compared")
            .remedy("`depthloom table RUN --set common` compares; explain one of another --set"));
    }
    let path = recording_of(&args.run, "explain")?;
    let interrupt = signals::listen("stopping")?;
    let recording = open(&path)?;
    let selection = selection(&args.scores);
    let stop = || interrupt.stops_admission();
    let explanation = depthloom_analysis::explain(&recording, &args.score, &args.estimator, &selection, &stop);
    let explanation = explanation.map_err(|error| failed(&error))?;
    if args.json {
        outputs::print(&explanation.output())?;
    } else {
        print(explanation.text())?;
    }
    Ok(end([&recording]))
}
