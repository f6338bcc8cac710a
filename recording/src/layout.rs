//! Where each output port of a plan goes: its channel, its camera, and the part of a frame it shares chunks with.
//!
//! Which part a topic belongs to follows from the types of ports and wires alone, never from a node's name or kind or from
//! the first frame's bytes, so that an interrupted and resumed run places everything as an uninterrupted one.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{Origin, Plan, PlannedNode, PlannedOutput, StageRun};
use depthloom_graphs::{Rate, ValueType};

use crate::error::RecordingError;
use crate::plan::planned_output;
use depthloom_codecs::schema::Schema;

/// The topics that share chunks: what is replayed together lies together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Class {
    /// The source's images and calibrations.
    Camera,
    /// Everything else the source gives: truth, its masks.
    Truth,
    /// Disparities, masks, and depths made of nothing but fixed-point disparities: few distinct numbers, packed well.
    FixedPoint,
    /// The depths, weights and images that nodes compute.
    Maps,
    /// Scores; kept of every frame.
    Rows,
}

impl Class {
    const ALL: [Self; 5] = [Self::Camera, Self::Truth, Self::FixedPoint, Self::Maps, Self::Rows];

    /// The name under which a run's timings list it.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Truth => "truth",
            Self::FixedPoint => "fixed-point",
            Self::Maps => "maps",
            Self::Rows => "scores",
        }
    }
}

/// An output port that is recorded.
#[derive(Clone, Debug)]
pub(crate) struct PortLayout {
    pub(crate) part: usize,
    pub(crate) class: Class,
    pub(crate) topic: Arc<str>,
    pub(crate) channel: u16,
    /// The channel of images that come with a file's own bytes.
    pub(crate) compressed_channel: Option<u16>,
    /// The channel of the depth for looking at.
    pub(crate) view_channel: Option<u16>,
    /// The camera whose pixels these are.
    pub(crate) frame_id: Arc<str>,
}

/// A stage run.
#[derive(Clone, Debug)]
pub(crate) struct RunLayout {
    pub(crate) parts: usize,
    /// The class of each part.
    pub(crate) classes: Vec<Class>,
    /// The source's output ports, by which cameras are named.
    pub(crate) source_ports: Vec<(String, ValueType)>,
    source: Vec<Option<PortLayout>>,
    nodes: Vec<Vec<Option<PortLayout>>>,
    /// The channels of the learning curves.
    curves: BTreeMap<Slot, u16>,
    pub(crate) commit_channel: u16,
}

impl RunLayout {
    pub(crate) fn port(&self, slot: Slot) -> Option<&PortLayout> {
        match slot {
            Slot::Source { port } => self.source.get(port)?.as_ref(),
            Slot::Node { node, port } => self.nodes.get(node)?.get(port)?.as_ref(),
        }
    }

    /// The channel of a learning curve that is recorded.
    pub(crate) fn curve_channel(&self, slot: Slot) -> Option<u16> {
        self.curves.get(&slot).copied()
    }
}

/// A channel, not yet written.
#[derive(Clone, Debug)]
pub(crate) struct ChannelLayout {
    pub(crate) schema: Schema,
    pub(crate) topic: String,
    pub(crate) metadata: BTreeMap<String, String>,
}

/// A plan's channels and parts. A channel's id is its index plus one.
#[derive(Clone, Debug, Default)]
pub(crate) struct FileLayout {
    pub(crate) runs: Vec<RunLayout>,
    pub(crate) channels: Vec<ChannelLayout>,
}

impl FileLayout {
    pub(crate) fn of(plan: &Plan) -> Result<Self, RecordingError> {
        let mut layout = Self::default();
        let mut topics = BTreeSet::new();
        for run in &plan.runs {
            let run_layout = layout.run(plan, run, &mut topics)?;
            layout.runs.push(run_layout);
        }
        Ok(layout)
    }

    fn run(&mut self, plan: &Plan, run: &StageRun, topics: &mut BTreeSet<String>) -> Result<RunLayout, RecordingError> {
        let slots = of_run(run);
        let used: BTreeSet<Class> = slots.iter().filter_map(|slot| class(run, *slot)).collect();
        let part_of = |class: Class| Class::ALL.iter().filter(|c| used.contains(c)).position(|c| *c == class);
        let mut source = vec![None; run.source.outputs.len()];
        let mut nodes: Vec<_> = run.nodes.iter().map(|node| vec![None; node.outputs.len()]).collect();
        let mut curves = BTreeMap::new();
        for slot in slots {
            let output = planned_output(run, slot);
            if is_recorded_curve(output) {
                let (topic, metadata) = (output.topic.clone(), metadata(run, slot, output));
                let layout = ChannelLayout { schema: Schema::CurvePoint, topic, metadata };
                curves.insert(slot, self.channel(layout, topics)?);
            }
            let Some(class) = class(run, slot) else { continue };
            let Some(part) = part_of(class) else { continue };
            let port = self.port(plan, run, slot, class, part, topics)?;
            match slot {
                Slot::Source { port: index } => source[index] = Some(port),
                Slot::Node { node, port: index } => nodes[node][index] = Some(port),
            }
        }
        let commit = ChannelLayout {
            schema: Schema::Commit,
            topic: format!("{}/commit", run.prefix),
            metadata: BTreeMap::from([("stage".to_owned(), run.stage.clone())]),
        };
        let commit_channel = self.channel(commit, topics)?;
        let classes: Vec<Class> = Class::ALL.into_iter().filter(|class| used.contains(class)).collect();
        let source_ports = run.source.outputs.iter().map(|output| &output.port);
        let source_ports = source_ports.map(|port| (port.name.to_owned(), port.value_type)).collect();
        Ok(RunLayout { parts: classes.len(), classes, source_ports, source, nodes, curves, commit_channel })
    }

    fn port(
        &mut self,
        plan: &Plan,
        run: &StageRun,
        slot: Slot,
        class: Class,
        part: usize,
        topics: &mut BTreeSet<String>,
    ) -> Result<PortLayout, RecordingError> {
        let output = planned_output(run, slot);
        let value_type = output.port.value_type;
        let schema = match value_type {
            ValueType::Image | ValueType::Disparity | ValueType::TrueDisparity | ValueType::Mask => Schema::RawImage,
            ValueType::Depth | ValueType::Weight => Schema::FloatMap,
            ValueType::Calibration => Schema::CameraCalibration,
            ValueType::Scores => Schema::Score,
            ValueType::Samples | ValueType::Model | ValueType::Curve => {
                let what = format!("values of type {value_type} are kept once a stage, not once a frame");
                return Err(RecordingError::Plan { topic: output.topic.clone(), what });
            }
        };
        let metadata = metadata(run, slot, output);
        let channel = ChannelLayout { schema, topic: output.topic.clone(), metadata: metadata.clone() };
        let channel = self.channel(channel, topics)?;
        let mut compressed_channel = None;
        if value_type == ValueType::Image {
            // Whether images come with a file's bytes is known when the first one comes: a topic uses one of its two channels.
            let layout = ChannelLayout { schema: Schema::CompressedImage, topic: output.topic.clone(), metadata };
            compressed_channel = Some(self.numbered(layout)?);
        }
        let mut view_channel = None;
        if plan.record.view && value_type == ValueType::Depth {
            let unit =
                "millimetres, 0 = no answer, 65535 = that far or farther; for looking at, see the topic without _view";
            let metadata = BTreeMap::from([("unit".to_owned(), unit.to_owned())]);
            let topic = format!("{}_view", output.topic);
            view_channel = Some(self.channel(ChannelLayout { schema: Schema::RawImage, topic, metadata }, topics)?);
        }
        Ok(PortLayout {
            part,
            class,
            topic: output.topic.as_str().into(),
            channel,
            compressed_channel,
            view_channel,
            frame_id: camera(run, slot).into(),
        })
    }

    fn channel(&mut self, layout: ChannelLayout, topics: &mut BTreeSet<String>) -> Result<u16, RecordingError> {
        if !topics.insert(layout.topic.clone()) {
            return Err(RecordingError::Plan { topic: layout.topic, what: "two outputs have this topic".to_owned() });
        }
        self.numbered(layout)
    }

    fn numbered(&mut self, layout: ChannelLayout) -> Result<u16, RecordingError> {
        let id = u16::try_from(self.channels.len() + 1).map_err(|_| RecordingError::Plan {
            topic: layout.topic.clone(),
            what: "an MCAP file has at most 65535 channels; record fewer outputs or variants".to_owned(),
        })?;
        self.channels.push(layout);
        Ok(id)
    }
}

/// All slots of a stage run, in plan order.
fn of_run(run: &StageRun) -> Vec<Slot> {
    let of_source = (0..run.source.outputs.len()).map(|port| Slot::Source { port });
    let of_nodes = run.nodes.iter().enumerate();
    let of_nodes = of_nodes.flat_map(|(node, n)| (0..n.outputs.len()).map(move |port| Slot::Node { node, port }));
    of_source.chain(of_nodes).collect()
}

/// Whether an output is a learning curve, of one point after the other outside frames, and recorded.
fn is_recorded_curve(output: &PlannedOutput) -> bool {
    output.recorded && output.port.rate == Rate::Once && output.port.value_type == ValueType::Curve
}

/// The class of a slot's values; `None` if they are not recorded frame by frame.
fn class(run: &StageRun, slot: Slot) -> Option<Class> {
    let output = planned_output(run, slot);
    if !output.recorded || output.port.rate == Rate::Once {
        return None;
    }
    Some(match (output.port.value_type, slot) {
        (ValueType::Scores, _) => Class::Rows,
        (ValueType::Image | ValueType::Calibration, Slot::Source { .. }) => Class::Camera,
        (_, Slot::Source { .. }) => Class::Truth,
        (ValueType::Disparity | ValueType::TrueDisparity | ValueType::Mask, Slot::Node { .. }) => Class::FixedPoint,
        (ValueType::Depth, Slot::Node { node, .. }) if from_fixed_point(&run.nodes[node]) => Class::FixedPoint,
        _ => Class::Maps,
    })
}

/// Whether a node reads disparities and no other raster, frame by frame: then it gives as few distinct numbers as they have.
fn from_fixed_point(node: &PlannedNode) -> bool {
    let reads = |wanted: &[ValueType]| {
        let mut wired = node.inputs.iter().filter(|input| matches!(input.from, Some(Origin::Here(_))));
        wired.any(|input| wanted.contains(&input.port.value_type))
    };
    reads(&[ValueType::Disparity]) && !reads(&[ValueType::Image, ValueType::Depth, ValueType::Weight])
}

/// The camera whose pixels a slot's values are, as viewers' `frame_id`.
///
/// The source's first image is of the reference camera, and all maps are made in its pixels; each further image of a source
/// is of a camera of its own.
fn camera(run: &StageRun, slot: Slot) -> String {
    let outputs = &run.source.outputs;
    let reference = outputs.iter().find(|output| output.port.value_type == ValueType::Image);
    match slot {
        Slot::Source { port } if outputs[port].port.value_type == ValueType::Image => {
            outputs[port].port.name.to_owned()
        }
        _ => reference.map_or_else(|| run.source.name.clone(), |output| output.port.name.to_owned()),
    }
}

fn metadata(run: &StageRun, slot: Slot, output: &PlannedOutput) -> BTreeMap<String, String> {
    let unit = match output.port.value_type {
        ValueType::Disparity => {
            "0 = nothing found; else disparity in pixels = value / 16 + min_disparity_px - 1, min_disparity_px being a field of the message"
        }
        ValueType::TrueDisparity => "disparity in pixels = value / 256, 0 = unknown",
        ValueType::Depth => "metres, NaN = no answer",
        ValueType::Weight => "share in [0, 1]",
        ValueType::Mask => "255 = set, 0 = not",
        ValueType::Curve => "losses in the unit of the loss that was trained with",
        ValueType::Image | ValueType::Calibration | ValueType::Scores | ValueType::Samples | ValueType::Model => "",
    };
    let mut metadata = BTreeMap::from([
        ("stage".to_owned(), run.stage.clone()),
        ("port".to_owned(), output.port.name.to_owned()),
        ("type".to_owned(), output.port.value_type.name().to_owned()),
        ("about".to_owned(), output.port.doc.to_owned()),
    ]);
    if !unit.is_empty() {
        metadata.insert("unit".to_owned(), unit.to_owned());
    }
    if let Slot::Node { node, .. } = slot {
        metadata.insert("node".to_owned(), run.nodes[node].name.clone());
        metadata.insert("kind".to_owned(), run.nodes[node].kind.clone());
    }
    metadata
}
