//! A plan with an output port of every type, and frames of made values for it.
#![expect(clippy::unwrap_used, reason = "a fixture fails as a test does")]

use std::path::Path;
use std::sync::Arc;

use depthloom_graphs::contracts::{Commit, Contract, Failure, LiveCommit, Sink, Slot, SlotKey};
use depthloom_graphs::plan::{
    Estimate, FrameIndex, NodeId, Origin, PartId, Plan, PlannedInput, PlannedNode, PlannedOutput, PlannedSource,
    PortId, Record, RunId, SourcePart, StageRun, VariantId,
};
use depthloom_graphs::values::{
    Artifact, Calibration, Curve, CurvePoint, Depth, Disparity, Encoded, Image, ImageFormat, Mask, Pixels, Raster,
    Weight,
};
use depthloom_graphs::{Frame, Key, Port, Value, ValueType};
use depthloom_recording::{Attachment, Recorder};
use depthloom_scores::{Family, Metric, PixelSet, ScoreRow};
use image::{GrayImage, RgbImage};
use serde_json::json;

/// When stages begin whose frames have no clock: 2000-01-01T00:00:00Z.
pub(crate) const BEGINNING_NS: u64 = 946_684_800_000_000_000;

/// What a node of the fixture reads and gives.
struct NodeSpec {
    name: &'static str,
    inputs: &'static [(&'static str, Slot)],
    outputs: &'static [Port],
}

const LEFT: Slot = Slot::Source { port: PortId(0) };
const NODES: &[NodeSpec] = &[
    NodeSpec {
        name: "stereo",
        inputs: &[("left", LEFT), ("right", Slot::Source { port: PortId(1) })],
        outputs: &[Port::frame("disparity", ValueType::Disparity, "Fixed-point disparity.")],
    },
    NodeSpec {
        name: "depth",
        inputs: &[("disparity", Slot::Node { node: NodeId(0), port: PortId(0) })],
        outputs: &[Port::frame("depth", ValueType::Depth, "Depth of the disparity.")],
    },
    NodeSpec {
        name: "edges",
        inputs: &[("image", LEFT)],
        outputs: &[
            Port::frame("weight", ValueType::Weight, "Confidence."),
            Port::frame("mask", ValueType::Mask, "Edges."),
        ],
    },
    NodeSpec {
        name: "fused",
        inputs: &[
            ("stereo", Slot::Node { node: NodeId(1), port: PortId(0) }),
            ("weight", Slot::Node { node: NodeId(2), port: PortId(0) }),
        ],
        outputs: &[Port::frame("depth", ValueType::Depth, "Fused depth.")],
    },
    NodeSpec {
        name: "score_fused",
        inputs: &[
            ("estimate", Slot::Node { node: NodeId(3), port: PortId(0) }),
            ("ground_truth", Slot::Source { port: PortId(2) }),
        ],
        outputs: &[Port::frame("scores", ValueType::Scores, "Scores.")],
    },
    NodeSpec {
        name: "train",
        inputs: &[],
        outputs: &[
            Port::once("model", ValueType::Model, "A network."),
            Port::once("curve", ValueType::Curve, "How it learned."),
        ],
    },
];

/// The source's ports.
const SOURCE: [Port; 4] = [
    Port::frame("left", ValueType::Image, "Left image."),
    Port::frame("right", ValueType::Image, "Right image."),
    Port::frame("depth", ValueType::Depth, "Ground-truth depth.").optional(),
    Port::frame("calibration", ValueType::Calibration, "Calibration."),
];

fn port_type(slot: Slot) -> ValueType {
    match slot {
        Slot::Source { port } => SOURCE[port].value_type,
        Slot::Node { node, port } => NODES[node].outputs[port].value_type,
    }
}

/// A plan of one stage run, `/compare`.
pub(crate) fn plan() -> Plan {
    plan_of(&["compare"])
}

/// A plan of these stages, all alike.
pub(crate) fn plan_of(stages: &[&str]) -> Plan {
    Plan {
        experiment: "fixture".to_owned(),
        description: "Every type of value.".to_owned(),
        variants: vec!["full".to_owned(), "plain".to_owned()],
        factors: Vec::new(),
        labels: depthloom_graphs::plan::Labels::default(),
        runs: stages.iter().map(|stage| stage_run(stage)).collect(),
        record: Record { every: 1, view: true, points: Vec::new() },
        written: vec![("/somewhere/fixture.yaml".to_owned(), "experiment: fixture\n".to_owned())],
        resolved: "experiment: fixture\nvariants: {}\n".to_owned(),
    }
}

fn stage_run(stage: &str) -> StageRun {
    let output = |folder: &str, port: &Port| PlannedOutput {
        port: port.clone(),
        topic: format!("/{stage}/{folder}/{}", port.name),
        aliases: vec![format!("/{stage}/full/{folder}/{}", port.name)],
        recorded: true,
    };
    let nodes = NODES.iter().map(|spec| PlannedNode {
        name: spec.name.to_owned(),
        kind: format!("test/{}", spec.name),
        version: 1,
        contract: if spec.name == "train" { Contract::Once } else { Contract::Pure },
        params: json!({ "sets": ["valid", "all"], "preset": "martins2018" }),
        shown: json!({}),
        portable: json!({ "sets": ["valid", "all"], "preset": "martins2018" }),
        auto: Vec::new(),
        inputs: spec
            .inputs
            .iter()
            .map(|(name, from)| PlannedInput {
                port: Port::frame(name, port_type(*from), ""),
                from: Some(Origin::Here(*from)),
                shown: None,
            })
            .collect(),
        outputs: spec.outputs.iter().map(|port| output(spec.name, port)).collect(),
        observes: None,
        node_hash: Key::of_content(spec.name.as_bytes()),
        variants: [0, 1].map(VariantId).to_vec(),
    });
    StageRun {
        stage: stage.to_owned(),
        prefix: format!("/{stage}"),
        source: PlannedSource {
            name: "test".to_owned(),
            parts: vec![SourcePart {
                kind: "test/source".to_owned(),
                version: 3,
                params: json!({ "seed": 1 }),
                shown: json!({ "seed": 1 }),
                portable: json!({ "seed": 1 }),
            }],
            outputs: SOURCE.iter().map(|port| output("source", port)).collect(),
        },
        nodes: nodes.collect(),
        estimates: vec![Estimate {
            label: "fused".to_owned(),
            name: "fused".to_owned(),
            variant: None,
            estimate: Slot::Node { node: NodeId(3), port: PortId(0) },
            truth: Slot::Source { port: PortId(2) },
            score_node: NodeId(4),
        }],
        variants: [0, 1].map(VariantId).to_vec(),
    }
}

/// Numbers that look like noise, the same on every machine.
pub(crate) struct Noise(pub u64);

impl Noise {
    /// The next 32 bits.
    pub(crate) fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 32) as u32
    }

    /// A share in [0, 1).
    pub(crate) fn share(&mut self) -> f32 {
        (self.bits() >> 8) as f32 / (1 << 24) as f32
    }
}

/// A raster of made samples.
pub(crate) fn raster<T: Copy>(width: u32, height: u32, mut sample: impl FnMut() -> T) -> Raster<T>
where
    image::Luma<T>: image::Pixel<Subpixel = T>,
{
    let samples = (0..width * height).map(|_| sample()).collect();
    Raster::from_raw(width, height, samples).unwrap()
}

/// A frame's values: the source's, then the nodes', in plan order.
pub(crate) fn values(frame: &Frame, width: u32, height: u32) -> Vec<(Slot, Value)> {
    let mut noise = Noise(frame.index + 1);
    let pixels =
        Pixels::Rgb(RgbImage::from_fn(width, height, |x, y| image::Rgb([x as u8, y as u8, frame.index as u8])));
    let made = Pixels::Grey(GrayImage::from_fn(width, height, |x, y| image::Luma([(x ^ y) as u8])));
    let mut png = std::io::Cursor::new(Vec::new());
    let Pixels::Rgb(rgb) = &pixels else { unreachable!() };
    rgb.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let encoded = Encoded { format: ImageFormat::Png, bytes: png.into_inner().into() };
    let disparity =
        Disparity { sixteenths_px: raster(width, height, || (noise.bits() % 1024) as i16 - 16), min_disparity_px: -3 };
    let metres = disparity.sixteenths_px.iter().map(|&d| if d > 0 { 386.0 * 16.0 / f32::from(d) } else { f32::NAN });
    let stereo = Depth { metres: Raster::from_raw(width, height, metres.collect()).unwrap() };
    let mut fused = raster(width, height, || noise.share() * 80.0);
    // Other NaNs, infinities, zeros of both signs and subnormal numbers come back as they were.
    for (pixel, bits) in fused.iter_mut().zip([0x7fc0_dead, 0xffc0_0001, 0x7f80_0000, 0x8000_0000, 1]) {
        *pixel = f32::from_bits(bits);
    }
    let truth = raster(width, height, || if noise.bits().is_multiple_of(5) { noise.share() * 80.0 } else { f32::NAN });
    let weight = Weight { share: raster(width, height, || noise.share()) };
    let mask = Mask { set: raster(width, height, || if noise.bits().is_multiple_of(2) { 255 } else { 0 }) };
    let calibration = Calibration {
        width,
        height,
        focal_px: 721.5377 + frame.index as f64 / 3.0,
        cx_px: 609.5593,
        cy_px: 172.854,
        baseline_m: 0.532_725_451_7,
        doffs_px: 0.0,
    };
    // One with all metrics of recordings of older versions, one in a zone with others, and numbers that are easily
    // lost.
    let row = |set, a1| {
        let scores = [a1, 0.1 + 0.2, 1.0, f64::NAN, 0.0, 1e-300, -0.0, 0.25];
        let row = ScoreRow { pixels: 7 * frame.index, ..ScoreRow::new(set, "") };
        Family::Depth.defaults().into_iter().zip(scores).fold(row, |row, (metric, score)| row.with(metric, score))
    };
    let zone = |epe: f64| {
        let named = |name: &str| Metric::named(name).unwrap();
        let counts = ScoreRow::new(PixelSet::Filled, "10..20");
        let counts = ScoreRow { pixels: 5, truth: u64::MAX, valid: 3, log_mean: Some(-0.0), ..counts };
        counts.with(named("irmse"), f64::INFINITY).with(named("epe"), epe).with(named("d1"), 0.0)
    };
    let node = |node, port| Slot::Node { node, port };
    let mut values: Vec<(Slot, Value)> = vec![
        (Slot::Source { port: PortId(0) }, Image::with_encoded(pixels, encoded).into()),
        (Slot::Source { port: PortId(1) }, Image::new(made).into()),
    ];
    if frame.index % 3 != 2 {
        values.push((Slot::Source { port: PortId(2) }, Depth { metres: truth }.into()));
    }
    values.extend([
        (Slot::Source { port: PortId(3) }, calibration.into()),
        (node(NodeId(0), PortId(0)), disparity.into()),
        (node(NodeId(1), PortId(0)), stereo.into()),
        (node(NodeId(2), PortId(0)), weight.into()),
        (node(NodeId(2), PortId(1)), mask.into()),
        (node(NodeId(3), PortId(0)), Depth { metres: fused }.into()),
    ]);
    if frame.index % 3 != 2 {
        let rows = vec![row(PixelSet::Valid, 0.5), row(PixelSet::All, f64::NAN), zone(-0.0)];
        values.push((node(NodeId(4), PortId(0)), rows.into()));
    }
    values
}

/// The fixture's frame of that index.
pub(crate) fn frame(index: u64) -> Frame {
    Frame::at_10_hz(format!("{index:06}_10"), index)
}

/// The key of a node's values.
pub(crate) fn key(frame: &Frame, node: NodeId) -> Key {
    Key::build("test").number(frame.index).number(node.0 as u64).finish()
}

/// As [`record_frame_at`], of a source that is read from its first frame on.
pub(crate) fn record_frame(recorder: &Recorder, run: RunId, frame: &Frame, values: &[(Slot, Value)], backwards: bool) {
    record_frame_at(recorder, run, (frame.index as usize, frame), values, backwards);
}

/// Encodes a frame's parts in the order given by `order`, and commits it.
pub(crate) fn record_frame_at(
    recorder: &Recorder,
    run: RunId,
    (position, frame): (usize, &Frame),
    values: &[(Slot, Value)],
    backwards: bool,
) {
    record_live_frame(recorder, run, (position, frame), values, backwards, None);
}

/// As [`record_frame_at`], with what a live run knows of the frame, and in any sink.
pub(crate) fn record_live_frame<S: Sink>(
    recorder: &S,
    run: RunId,
    (position, frame): (usize, &Frame),
    values: &[(Slot, Value)],
    backwards: bool,
    live: Option<LiveCommit>,
) {
    let parts = recorder.parts(run);
    let mut order: Vec<usize> = (0..parts).collect();
    if backwards {
        order.reverse();
    }
    let mut encoded: Vec<Option<S::Part>> = (0..parts).map(|_| None).collect();
    for part in order {
        let of_part: Vec<_> =
            values.iter().filter(|(slot, _)| recorder.part(run, *slot) == Some(PartId(part))).cloned().collect();
        encoded[part] = Some(recorder.encode(run, (FrameIndex(position), frame), PartId(part), &of_part).unwrap());
    }
    let nodes = NodeId::all(5);
    let keys: Vec<SlotKey> = nodes
        .filter(|node| values.iter().any(|(slot, _)| matches!(slot, Slot::Node { node: of, .. } if *of == *node)))
        .map(|node| SlotKey { node, key: key(frame, node) })
        .collect();
    let failures = match frame.index % 3 {
        2 => vec![Failure { node: Some(NodeId(4)), what: "score: no truth".to_owned() }],
        _ => Vec::new(),
    };
    let source_key = Some(Key::build("source").number(frame.index).finish());
    let commit = Commit { run, frame, source_key, keys: &keys, failures: &failures, absent: &[], warnings: &[], live };
    recorder.write(&commit, encoded.into_iter().map(Option::unwrap).collect()).unwrap();
}

/// The topic of the fixture's learning curve.
pub(crate) const CURVE: &str = "/compare/train/curve";

/// The model of the fixture.
pub(crate) fn model() -> Value {
    Value::Model(Arc::new(Artifact::model(vec![7_u8; 1000])))
}

/// The learning curve of the fixture: of numbers that are easily lost.
pub(crate) fn curve() -> Curve {
    let point = |step, loss, validation, learning_rate| CurvePoint { step, loss, validation, learning_rate };
    let other_nan = f64::from_bits(0x7ff8_0000_0000_dead);
    let points = vec![
        point(0, 0.1 + 0.2, None, 1e-3),
        point(100, -0.0, Some(f64::INFINITY), 0.0),
        point(200, other_nan, Some(-0.0), 1e-300),
        point(250, f64::from_bits(1), Some(other_nan), 5e-4),
    ];
    Curve { points }
}

/// Records the aggregate values of a stage run.
pub(crate) fn record_aggregate_values(recorder: &impl Sink, run: RunId) {
    let key = Key::of_content(b"train");
    recorder.once(run, Slot::Node { node: NodeId(5), port: PortId(0) }, &key, &model(), &[]).unwrap();
    recorder.once(run, Slot::Node { node: NodeId(5), port: PortId(1) }, &key, &curve().into(), &[]).unwrap();
}

/// Records frames of that size and finishes the file.
pub(crate) fn record(path: &Path, plan: &Plan, frames: std::ops::Range<u64>, width: u32, height: u32) {
    let recorder = Recorder::create(path, plan).unwrap();
    for (position, index) in frames.enumerate() {
        let frame = frame(index);
        record_frame_at(&recorder, RunId(0), (position, &frame), &values(&frame, width, height), index % 2 == 1);
    }
    record_aggregate_values(&recorder, RunId(0));
    let note = Attachment { name: "note.txt".to_owned(), media_type: "text/plain".to_owned(), bytes: b"note".to_vec() };
    recorder.finish(&[note]).unwrap();
}
