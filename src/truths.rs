//! Scores whose frames have no truth, told before anything is computed.

use std::collections::BTreeSet;

use depthloom_graphs::Source;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{FrameIndex, StageRun};
use depthloom_graphs::ready::Ready;

pub(crate) const REMEDY: &str = "say in the source's parameters where the truth lies (depths of disparities need a calibration too), choose frames that have it (`frames:`), or leave `score:` out";

/// The output ports of a stage's source that it scores against.
pub(crate) fn of_source(run: &StageRun) -> BTreeSet<&'static str> {
    let port = |slot: &Slot| match slot {
        Slot::Source { port } => run.source.outputs.get(port.0).map(|output| output.port.name),
        Slot::Node { .. } => None,
    };
    run.estimates.iter().filter_map(|estimate| port(&estimate.truth)).collect()
}

/// Whether a file of a frame, by the part it plays, is of its truth: what is neither image nor calibration.
pub(crate) fn is_of_truth(part: &str) -> bool {
    !matches!(part, "left" | "right") && !part.starts_with("calibration")
}

/// Stages that score against a source of which no frame has a file of truth, as warnings.
pub(crate) fn missing(ready: &Ready) -> Vec<String> {
    let one = |(run, of): (&StageRun, &dyn Source)| {
        let port = of_source(run).into_iter().next()?;
        let count = of.frames().len();
        // Of what is made of no files nothing is known before it is read.
        let lacks = |position| {
            let files = of.files(position);
            !files.is_empty() && !files.iter().any(|(part, _)| is_of_truth(part))
        };
        (count > 0 && FrameIndex::all(count).all(lacks)).then(|| {
            let (stage, source) = (&run.stage, &run.source.name);
            format!(
                "stage `{stage}` scores against `source/{port}`, and no frame of source `{source}` has a file of truth: nothing will be scored; {REMEDY}"
            )
        })
    };
    let runs = ready.plan.runs.iter().zip(ready.runs.iter().map(|run| &*run.source));
    let mut told: Vec<String> = runs.filter_map(one).collect();
    told.dedup();
    told
}
