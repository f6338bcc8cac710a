//! The frames of a run and their failures, for JSON.

use depthloom_analysis::RowKeys;
use depthloom_graphs::plan::RunId;
use depthloom_recording::Recording;
use schemars::JsonSchema;
use serde::Serialize;

/// The frames of a stage.
#[derive(JsonSchema, Serialize)]
pub struct Frames {
    stage: String,
    /// If variants have different sources, the first variant with this one.
    variant: Option<String>,
    /// The frames' ids; the place in this list is `position` in tables.
    ids: Vec<String>,
    /// The number of frames with a failure.
    failed: u64,
}

/// A failure on a frame.
#[derive(JsonSchema, Serialize)]
pub struct FrameFailure {
    stage: String,
    /// Null if all variants share the node; of several, the first.
    variant: Option<String>,
    position: u64,
    frame: String,
    /// Null if the source failed.
    node: Option<String>,
    message: String,
}

/// Per stage, the ids of its frames and how many of them failed; then every failure.
pub fn frames_and_failures(recording: &Recording) -> (Vec<Frames>, Vec<FrameFailure>) {
    let plan = recording.plan();
    let row_keys = RowKeys::new(plan);
    let (mut frames, mut failures) = (Vec::new(), Vec::new());
    for (run, planned) in RunId::enumerate(&plan.runs) {
        let of_run = recording.frames(run);
        let row_key = row_keys.for_variants(&planned.stage, &planned.variants);
        frames.push(Frames {
            stage: row_key.stage.clone(),
            variant: row_key.variant.clone(),
            ids: of_run.iter().map(|frame| frame.id.to_string()).collect(),
            failed: of_run.iter().filter(|frame| !frame.failures.is_empty()).count() as u64,
        });
        for (position, frame) in of_run.iter().enumerate() {
            for failure in &frame.failures {
                let node = failure.node.and_then(|node| planned.nodes.get(node.0));
                let of_node = node.map(|node| row_keys.for_variants(&planned.stage, &node.variants));
                failures.push(FrameFailure {
                    stage: row_key.stage.clone(),
                    variant: of_node.as_ref().unwrap_or(&row_key).variant.clone(),
                    position: position as u64,
                    frame: frame.id.to_string(),
                    node: node.map(|node| node.name.clone()),
                    message: failure.what.clone(),
                });
            }
        }
    }
    (frames, failures)
}
