//! A recording of two variants and three estimates on small synthetic maps.
#![expect(clippy::unwrap_used, reason = "a fixture fails as a test does")]

use std::path::Path;

use depthloom_graphs::contracts::{Commit, Contract, Failure, Sink, Slot, SlotKey};
use depthloom_graphs::plan::{
    Estimate, FrameIndex, NodeId, PartId, Plan, PlannedNode, PlannedOutput, PlannedSource, PortId, Record, RunId,
    SourcePart, StageRun, VariantId,
};
use depthloom_graphs::values::{Curve, CurvePoint, Depth, Raster};
use depthloom_graphs::{Frame, Key, Port, Value, ValueType};
use depthloom_recording::Recorder;
use depthloom_scores::{PixelSet, ScoreRow, Settings, score};
use serde_json::json;

/// Width and height of the maps.
pub(crate) const SIZE: (u32, u32) = (40, 30);
/// The number of frames. The last has no ground truth; on the one before it `b/mono` failed.
pub(crate) const FRAMES: u64 = 9;
/// The number of frames with a value of every estimate.
const COMPLETE: u64 = FRAMES - 2;
/// The estimates of the plan: label, name, variant, pixel sets.
pub(crate) const ESTIMATES: [(&str, &str, Option<usize>, &[PixelSet]); 3] = [
    ("a/mono", "mono", Some(0), &[PixelSet::All]),
    ("b/mono", "mono", Some(1), &[PixelSet::All]),
    ("stereo", "stereo", None, &[PixelSet::Valid, PixelSet::All]),
];

/// A node for each estimate, then one for each of their scores.
pub(crate) fn plan(every: u64, keep_b: bool) -> Plan {
    let output = |node: &str, port: Port, recorded| PlannedOutput {
        topic: format!("/compare/{node}/{}", port.name),
        port,
        aliases: Vec::new(),
        recorded,
    };
    let node = |name: String, port: Port, params: serde_json::Value, recorded| PlannedNode {
        kind: format!("test/{name}"),
        version: 1,
        contract: Contract::Pure,
        portable: params.clone(),
        shown: params.clone(),
        params,
        auto: Vec::new(),
        inputs: Vec::new(),
        outputs: vec![output(&name.replace('/', "_"), port, recorded)],
        observes: None,
        node_hash: Key::of_content(name.as_bytes()),
        variants: vec![VariantId(0), VariantId(1)],
        name,
    };
    let depths = ESTIMATES.map(|(label, ..)| {
        let depth = Port::frame("depth", ValueType::Depth, "Depth.");
        node(label.to_owned(), depth, json!({}), keep_b || label != "b/mono")
    });
    let scores = ESTIMATES.map(|(label, .., sets)| {
        let sets: Vec<&str> = sets.iter().map(|set| set.name()).collect();
        let scores = Port::frame("rows", ValueType::Scores, "Scores.");
        node(format!("score_{label}"), scores, json!({ "preset": "martins2018", "sets": sets }), true)
    });
    let estimates = (0..ESTIMATES.len()).map(|i| Estimate {
        label: ESTIMATES[i].0.to_owned(),
        name: ESTIMATES[i].1.to_owned(),
        variant: ESTIMATES[i].2.map(VariantId),
        estimate: Slot::Node { node: NodeId(i), port: PortId(0) },
        truth: Slot::Source { port: PortId(0) },
        score_node: NodeId(ESTIMATES.len() + i),
    });
    let truth = Port::frame("depth", ValueType::Depth, "Ground-truth depth.").optional();
    Plan {
        experiment: "fixture".to_owned(),
        description: String::new(),
        variants: vec!["a".to_owned(), "b".to_owned()],
        factors: Vec::new(),
        labels: depthloom_graphs::plan::Labels::default(),
        runs: vec![StageRun {
            stage: "compare".to_owned(),
            prefix: "/compare".to_owned(),
            source: PlannedSource {
                name: "test".to_owned(),
                parts: vec![SourcePart {
                    kind: "test/source".to_owned(),
                    version: 1,
                    params: json!({}),
                    shown: json!({}),
                    portable: json!({}),
                }],
                outputs: vec![output("source", truth, true)],
            },
            estimates: estimates.collect(),
            nodes: depths.into_iter().chain(scores).collect(),
            variants: vec![VariantId(0), VariantId(1)],
        }],
        record: Record { every, view: false, points: Vec::new() },
        written: vec![("fixture.yaml".to_owned(), "experiment: fixture\n".to_owned())],
        resolved: "experiment: fixture\n".to_owned(),
    }
}

/// The plan with an additional node that trains a network and records its curve.
pub(crate) fn plan_that_learns() -> Plan {
    let mut plan = plan(1, true);
    let mut node = plan.runs[0].nodes[0].clone();
    node.name = "train".to_owned();
    node.contract = Contract::Once;
    node.outputs[0].port = Port::once("curve", ValueType::Curve, "The learning curve.");
    node.outputs[0].topic = "/compare/train/curve".to_owned();
    node.node_hash = Key::of_content(b"train");
    plan.runs[0].nodes.push(node);
    plan
}

/// The curve of `train`.
pub(crate) fn curve() -> Curve {
    let point = |step: u64| CurvePoint {
        step: 50 * step,
        loss: 2.0 / (step + 1) as f64,
        validation: step.is_multiple_of(4).then(|| 2.5 / (step + 1) as f64 + 0.1),
        learning_rate: 1e-3 * 0.99_f64.powi(step as i32),
    };
    Curve { points: (0..40).map(point).collect() }
}

/// The ground truth and the three estimates of a frame.
pub(crate) fn maps(index: u64) -> [Vec<f32>; 4] {
    let mut state = index + 1;
    let mut share = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let pixels = (SIZE.0 * SIZE.1) as usize;
    let truth: Vec<f32> = (0..pixels).map(|_| if share() < 0.4 { 2.0 + 80.0 * share() } else { f32::NAN }).collect();
    let mut estimate = |spread: f32, holes: f32| -> Vec<f32> {
        let base = truth.iter().map(|t| if t.is_nan() { 20.0 } else { *t });
        base.map(|t| if share() < holes { f32::NAN } else { t * (1.0 + spread * (share() - 0.5)) }).collect()
    };
    let (a, b, stereo) = (estimate(0.6, 0.0), estimate(1.0, 0.0), estimate(0.1, 0.15));
    [truth, a, b, stereo]
}

/// The scores of a frame, by estimate, as the engine records them.
pub(crate) fn rows(index: u64) -> [Vec<ScoreRow>; 3] {
    rows_of(&maps(index))
}

fn rows_of([truth, estimates @ ..]: &[Vec<f32>; 4]) -> [Vec<ScoreRow>; 3] {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    std::array::from_fn(|i| score(&estimates[i], truth, width, height, ESTIMATES[i].3, &Settings::default()))
}

/// Whether an estimate has a value and scores on a frame.
pub(crate) const fn valid(index: u64, estimate: usize) -> bool {
    !(index + 2 == FRAMES && estimate == 1)
}

/// Whether a frame has ground truth.
pub(crate) const fn has_truth(index: u64) -> bool {
    index + 1 != FRAMES
}

/// The plan with an additional first stage `learn` on the same source, which scores nothing.
pub(crate) fn plan_of_two_stages() -> Plan {
    let mut plan = plan(1, true);
    let mut learn = plan.runs[0].clone();
    (learn.stage, learn.prefix) = ("learn".to_owned(), "/learn".to_owned());
    learn.estimates.clear();
    let outputs = learn.nodes.iter_mut().flat_map(|node| &mut node.outputs).chain(&mut learn.source.outputs);
    outputs.for_each(|output| output.topic = output.topic.replace("/compare/", "/learn/"));
    plan.runs.insert(0, learn);
    plan
}

/// Records the given number of frames of each stage run, without finishing the recording.
pub(crate) fn record_unfinished(path: &Path, plan: &Plan, frames: &[u64]) {
    let recorder = Recorder::create(path, plan).unwrap();
    for (run, frames) in frames.iter().enumerate() {
        (0..*frames).for_each(|index| record_frame(&recorder, RunId(run), index, true));
    }
}

/// Records the fixture.
pub(crate) fn record(path: &Path, plan: &Plan) {
    record_with(path, plan, true);
}

/// Records the fixture; `b/mono` is absent instead of failed.
pub(crate) fn record_absent(path: &Path, plan: &Plan) {
    record_with(path, plan, false);
}

fn record_with(path: &Path, plan: &Plan, fails: bool) {
    let recorder = Recorder::create(path, plan).unwrap();
    for index in 0..FRAMES {
        record_frame(&recorder, RunId(0), index, fails);
    }
    for (node, _) in plan.runs[0].nodes.iter().enumerate().filter(|(_, node)| node.contract == Contract::Once) {
        recorder
            .once(
                RunId(0),
                Slot::Node { node: NodeId(node), port: PortId(0) },
                &Key::of_content(b"train"),
                &curve().into(),
                &[],
            )
            .unwrap();
    }
    recorder.finish(&[]).unwrap();
}

/// Records frames with values of all estimates and the cache keys of all values. `change` modifies ground truth and
/// estimates.
pub(crate) fn record_complete(path: &Path, plan: &Plan, change: impl Fn(&mut [Vec<f32>; 4])) {
    let recorder = Recorder::create(path, plan).unwrap();
    for index in 0..COMPLETE {
        let mut maps = maps(index);
        change(&mut maps);
        let key = |map: &[f32]| {
            let bytes: Vec<u8> = map.iter().flat_map(|metres| metres.to_le_bytes()).collect();
            Key::build("map").number(index).bytes(&bytes).finish()
        };
        let estimates = maps[1..].iter().enumerate();
        let keys: Vec<SlotKey> = estimates.map(|(node, map)| SlotKey { node: NodeId(node), key: key(map) }).collect();
        record_maps(&recorder, RunId(0), (index, &maps), (Some(key(&maps[0])), &keys), false);
    }
    recorder.finish(&[]).unwrap();
}

fn record_frame(recorder: &Recorder, run: RunId, index: u64, fails: bool) {
    let source_key = Some(Key::build("source").number(index).finish());
    record_maps(recorder, run, (index, &maps(index)), (source_key, &[]), fails);
}

fn record_maps(
    recorder: &Recorder,
    run: RunId,
    (index, maps): (u64, &[Vec<f32>; 4]),
    (source_key, keys): (Option<Key>, &[SlotKey]),
    fails: bool,
) {
    let frame = Frame::at_10_hz(format!("{index:06}_10"), index);
    let depth = |metres: &[f32]| -> Value {
        Depth { metres: Raster::from_raw(SIZE.0, SIZE.1, metres.to_vec()).unwrap() }.into()
    };
    let [truth, estimates @ ..] = maps;
    let rows = rows_of(maps);
    let mut values = Vec::new();
    if has_truth(index) {
        values.push((Slot::Source { port: PortId(0) }, depth(truth)));
    }
    let there = || (0..ESTIMATES.len()).filter(|&i| valid(index, i));
    values.extend(there().map(|i| (Slot::Node { node: NodeId(i), port: PortId(0) }, depth(&estimates[i]))));
    let scored = there().filter(|_| has_truth(index));
    values.extend(
        scored.map(|i| (Slot::Node { node: NodeId(ESTIMATES.len() + i), port: PortId(0) }, rows[i].clone().into())),
    );
    let parts = (0..recorder.parts(run)).map(|part| {
        let of_part: Vec<_> =
            values.iter().filter(|(slot, _)| recorder.part(run, *slot) == Some(PartId(part))).cloned().collect();
        recorder.encode(run, (FrameIndex(index as usize), &frame), PartId(part), &of_part).unwrap()
    });
    let parts = parts.collect();
    let failed = (0..ESTIMATES.len()).filter(|&i| fails && !valid(index, i));
    let failures: Vec<Failure> =
        failed.map(|node| Failure { node: Some(NodeId(node)), what: "failed".to_owned() }).collect();
    recorder
        .write(
            &Commit {
                run,
                frame: &frame,
                source_key,
                keys,
                failures: &failures,
                absent: &[],
                warnings: &[],
                live: None,
            },
            parts,
        )
        .unwrap();
}
