//! Recorded warnings of nodes and sources, for example an assumed calibration or a skipped frame.

use std::collections::BTreeMap;

use depthloom_graphs::counted;
use depthloom_graphs::plan::{NodeId, RunId};
use depthloom_recording::{RecordedRun, Recording};

/// The distinct warnings as text, with their total count and number of frames. If `run` is given, only those of this
/// stage run.
pub(crate) fn warnings(recording: &Recording, run: Option<RunId>) -> Vec<String> {
    let plan = recording.plan();
    // By node and warning: the total count, and the number of frames.
    let mut counts: BTreeMap<(String, &str), (u64, u64)> = BTreeMap::new();
    let mut order = Vec::new();
    for own in RunId::all(plan.runs.len()).filter(|own| run.is_none_or(|run| run == *own)) {
        for frame in recording.frames(own) {
            for warning in &frame.warnings {
                let key = (name(&plan.runs[own], warning.node), warning.what.as_str());
                let (count, frames) = counts.entry(key.clone()).or_default();
                if *frames == 0 {
                    order.push(key);
                }
                *count = count.saturating_add(warning.count);
                *frames += 1;
            }
        }
    }
    let text = |(name, what): (String, &str)| {
        let (count, frames) = counts[&(name.clone(), what)];
        let count = if count > 0 { format!("{count} ") } else { String::new() };
        format!("{name}: {count}{what}, on {}", counted(frames, "frame"))
    };
    order.into_iter().map(text).collect()
}

/// `stage.node`, or `stage.source`.
fn name(run: &RecordedRun, node: Option<NodeId>) -> String {
    let name = node.and_then(|node| run.nodes.get(node.0)).map_or(&run.source.name, |node| &node.name);
    format!("{}.{name}", run.stage)
}
