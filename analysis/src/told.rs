//! What nodes and sources told of without failing, as the recording keeps it: a calibration that was assumed, a frame that was left out.

use std::collections::BTreeMap;

use depthloom_recording::{RecordedRun, Recording};

/// All of it, in words, each once with on how many frames; of these stage runs alone, where some are named.
pub(crate) fn warnings(recording: &Recording, run: Option<usize>) -> Vec<String> {
    let plan = recording.plan();
    let mut told: BTreeMap<String, u64> = BTreeMap::new();
    let mut order: Vec<String> = Vec::new();
    for of in (0..plan.runs.len()).filter(|of| run.is_none_or(|run| run == *of)) {
        for frame in recording.frames(of) {
            for warned in &frame.warnings {
                let counted = if warned.count > 0 { format!("{} ", warned.count) } else { String::new() };
                let text = format!("{}: {counted}{}", name(&plan.runs[of], warned.node), warned.what);
                let times = told.entry(text.clone()).or_insert(0);
                if *times == 0 {
                    order.push(text);
                }
                *times += 1;
            }
        }
    }
    let often = |text: String| {
        let times = told[&text];
        format!("{text}, on {times} frame{}", if times == 1 { "" } else { "s" })
    };
    order.into_iter().map(often).collect()
}

/// `stage.node`, or `stage.source`.
fn name(run: &RecordedRun, node: Option<usize>) -> String {
    let name = node.and_then(|node| run.nodes.get(node)).map_or(&run.source.name, |node| &node.name);
    format!("{}.{name}", run.stage)
}
