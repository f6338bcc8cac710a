//! Runs of depthloom 0.1 that contain reused values: its reuse could take a value that was stored under another key.

use std::collections::BTreeMap;
use std::path::Path;

use depthloom_analysis::{RowKeys, Timing, read_timings};
use depthloom_graphs::plan::{NodeId, RunId};
use depthloom_recording::Recording;

use crate::files::TIMINGS;

const REMEDY: &str = "may belong to another variant; run again with --fresh";

/// A warning if depthloom 0.1 wrote the recording and some of its values were reused, or that cannot be determined.
pub(crate) fn warning(recording: &Recording, run: &Path) -> Option<String> {
    // Earlier formats are those of depthloom 0.1.
    if recording.is_of_this_format() {
        return None;
    }
    match read_timings(&run.join(TIMINGS)) {
        Ok(timings) => {
            has_reused(recording, &timings).then(|| format!("contains reused values of depthloom 0.1: {REMEDY}"))
        }
        Err(_) => Some(format!("may contain reused values of depthloom 0.1 ({TIMINGS} cannot be read): {REMEDY}")),
    }
}

/// A node as timings name it: stage, variant and name.
type NodeName = (String, Option<String>, String);

/// Whether a node has values on more frames than it ran on; of an aggregate node, whether it has values and did not
/// run.
fn has_reused(recording: &Recording, timings: &[Timing]) -> bool {
    let plan = recording.plan();
    let row_keys = RowKeys::new(plan);
    let mut stored: BTreeMap<(NodeName, &str), u64> = BTreeMap::new();
    for (run, planned) in RunId::enumerate(&plan.runs) {
        let name = |node: NodeId| -> Option<NodeName> {
            let node = planned.nodes.get(node.0)?;
            let row_key = row_keys.for_variants(&planned.stage, &node.variants);
            Some((row_key.stage, row_key.variant, node.name.clone()))
        };
        let keys = recording.frames(run).iter().flat_map(|frame| &frame.keys);
        for name in keys.filter_map(|key| name(key.node)) {
            *stored.entry((name, "process")).or_default() += 1;
        }
        for name in
            recording.aggregate_values().iter().filter(|once| once.run == run).filter_map(|once| name(once.node))
        {
            stored.insert((name, "once"), 1);
        }
    }
    stored.into_iter().any(|(((stage, variant, node), phase), count)| {
        let is_of = |timing: &&Timing| {
            timing.row_key.stage == stage
                && timing.row_key.variant == variant
                && timing.node == node
                && timing.phase == phase
        };
        timings.iter().filter(is_of).map(|timing| timing.frames).sum::<u64>() < count
    })
}
