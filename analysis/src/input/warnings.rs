//! What nodes and sources told of without failing, as the recording keeps it: a calibration that was assumed, a frame
//! that was left out.

use std::collections::BTreeMap;

use depthloom_graphs::counted;
use depthloom_graphs::plan::{NodeId, RunId};
use depthloom_recording::{RecordedRun, Recording};

/// All of it, in words, each once with how many things in all and on how many frames; of these stage runs alone, where
/// some are named.
pub(crate) fn warnings(recording: &Recording, run: Option<RunId>) -> Vec<String> {
    let plan = recording.plan();
    // By name and what was told: how many things in all, and on how many frames.
    let mut counts: BTreeMap<(String, &str), (u64, u64)> = BTreeMap::new();
    let mut order = Vec::new();
    for of in RunId::all(plan.runs.len()).filter(|of| run.is_none_or(|run| run == *of)) {
        for frame in recording.frames(of) {
            for warned in &frame.warnings {
                let key = (name(&plan.runs[of], warned.node), warned.what.as_str());
                let (count, frames) = counts.entry(key.clone()).or_default();
                if *frames == 0 {
                    order.push(key);
                }
                *count = count.saturating_add(warned.count);
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
