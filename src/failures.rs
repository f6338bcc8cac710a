//! The frames of a run, and what failed on them, for programs.

use depthloom_analysis::Leads;
use depthloom_recording::Recording;
use serde_json::{Value as Json, json};

/// By stage the ids of its frames and how many of them failed; then every failure.
pub fn told(recording: &Recording) -> (Vec<Json>, Vec<Json>) {
    let plan = recording.plan();
    let leads = Leads::new(plan);
    let (mut frames, mut failures) = (Vec::new(), Vec::new());
    for (run, planned) in plan.runs.iter().enumerate() {
        let of_run = recording.frames(run);
        let lead = leads.of_those(&planned.stage, &planned.variants);
        frames.push(json!({
            "stage": lead.stage,
            "variant": lead.variant,
            "ids": of_run.iter().map(|frame| &*frame.id).collect::<Vec<_>>(),
            "failed": of_run.iter().filter(|frame| !frame.failures.is_empty()).count(),
        }));
        for (position, frame) in of_run.iter().enumerate() {
            for failure in &frame.failures {
                let node = failure.node.and_then(|node| planned.nodes.get(node));
                let of_node = node.map(|node| leads.of_those(&planned.stage, &node.variants));
                failures.push(json!({
                    "stage": lead.stage,
                    "variant": of_node.as_ref().unwrap_or(&lead).variant,
                    "position": position,
                    "frame": &*frame.id,
                    "node": node.map(|node| &node.name),
                    "message": failure.what,
                }));
            }
        }
    }
    (frames, failures)
}
