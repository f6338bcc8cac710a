//! Metrics without ground truth: a warning before anything is computed.

use std::collections::BTreeSet;

use depthloom_graphs::Source;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{FrameIndex, StageRun};
use depthloom_graphs::ready::Ready;

pub(crate) const REMEDY: &str = "name the ground truth in the source's parameters (depths from disparities also need a calibration), select frames that have it (`frames:`), or leave out `score:`";

/// The output ports of a stage's source that are ground truth of its metrics.
pub(crate) fn of_source(run: &StageRun) -> BTreeSet<&'static str> {
    let port = |slot: &Slot| match slot {
        Slot::Source { port } => run.source.outputs.get(port.0).map(|output| output.port.name),
        Slot::Node { .. } => None,
    };
    run.estimates.iter().filter_map(|estimate| port(&estimate.truth)).collect()
}

/// Whether a file of a frame is ground truth, by its part: neither an image nor a calibration.
pub(crate) fn is_of_truth(part: &str) -> bool {
    !matches!(part, "left" | "right") && !part.starts_with("calibration")
}

/// Warnings for stages that score against a source without any file of ground truth.
pub(crate) fn missing(ready: &Ready) -> Vec<String> {
    let one = |(run, of): (&StageRun, &dyn Source)| {
        let port = of_source(run).into_iter().next()?;
        let count = of.frames().len();
        // Frames without files are known only after they are read.
        let lacks = |position| {
            let files = of.files(position);
            !files.is_empty() && !files.iter().any(|(part, _)| is_of_truth(part))
        };
        (count > 0 && FrameIndex::all(count).all(lacks)).then(|| {
            let (stage, source) = (&run.stage, &run.source.name);
            format!(
                "stage `{stage}` scores against `source/{port}`, but no frame of source `{source}` has a file of ground truth, so nothing will be scored; {REMEDY}"
            )
        })
    };
    let runs = ready.plan.runs.iter().zip(ready.runs.iter().map(|run| &*run.source));
    let mut warnings: Vec<String> = runs.filter_map(one).collect();
    warnings.dedup();
    warnings
}
