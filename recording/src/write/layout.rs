//! Assigns each output port of a plan a channel, a camera, and the part of a frame in which it shares chunks.
//!
//! The part of a topic follows only from the types of ports and wires, never from a node's name or kind or from the
//! first frame's bytes: so a resumed run places everything like an uninterrupted one.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{Origin, PartId, Plan, PlannedNode, PlannedOutput, RunId, StageRun};
use depthloom_graphs::{Frame, Rate, Value, ValueType};

use crate::TOPIC_IN_PLAN;
use crate::error::RecordingError;
use crate::plan::RecordedPlan;
use crate::write::part::{Messages, Unkept};
use crate::write::viewer::{Camera, Companion, Pose, picture_topic, points_of, points_topic, topic_shown};
use depthloom_codecs::encode::Stamp;
use depthloom_codecs::schema::Schema;

/// A class of topics that share chunks: what is replayed together is stored together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Class {
    Camera,
    /// The other outputs of the source: ground truth, its masks.
    Truth,
    /// Disparities, masks, and depths computed only from fixed-point disparities: few distinct numbers, which compress
    /// well.
    FixedPoint,
    /// The depths, confidences and images that nodes compute.
    Maps,
    /// Scores; recorded for every frame.
    Rows,
}

impl Class {
    const ALL: [Self; 5] = [Self::Camera, Self::Truth, Self::FixedPoint, Self::Maps, Self::Rows];

    /// The name in a run's timings.
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

#[derive(Clone, Debug)]
pub(crate) struct PortLayout {
    pub(crate) part: PartId,
    pub(crate) class: Class,
    pub(crate) topic: Arc<str>,
    pub(crate) channel: u16,
    /// The channel of values in the second form: images with their file's bytes, ground-truth disparities that do not
    /// fit into 16 bits.
    pub(crate) other_channel: Option<u16>,
    /// The messages that viewers need besides the value's.
    pub(crate) companions: Vec<CompanionLayout>,
    /// The camera with these pixels.
    pub(crate) frame_id: Arc<str>,
}

impl PortLayout {
    /// The other values that this port's companions are computed from.
    pub(crate) fn needed(&self) -> impl Iterator<Item = Slot> + '_ {
        let inputs = |companion: &CompanionLayout| match companion.what {
            Companion::Points { calibration, image } => [Some(calibration), image],
            _ => [None, None],
        };
        self.companions.iter().flat_map(inputs).flatten()
    }
}

#[derive(Clone, Debug)]
pub(crate) struct CompanionLayout {
    pub(crate) what: Companion,
    pub(crate) channel: u16,
    /// The camera with these pixels.
    pub(crate) frame_id: Arc<str>,
}

impl CompanionLayout {
    /// Adds the companion message of a value to a part.
    pub(crate) fn put(
        &self,
        part: &mut impl Messages,
        frame: &Frame,
        value: &Value,
        others: &[(Slot, Value)],
    ) -> Result<(), Unkept> {
        let stamp = Stamp { time_ns: frame.time_ns, frame_id: &self.frame_id };
        self.what.put(part, (self.channel, stamp), value, others)
    }
}

#[derive(Clone, Debug)]
pub(crate) struct RunLayout {
    pub(crate) parts: usize,
    pub(crate) classes: Vec<Class>,
    /// The source's output ports, which determine the cameras' names.
    pub(crate) source_ports: Vec<(String, ValueType)>,
    /// The source's name, which names the coordinate frames if it has no image.
    pub(crate) source_name: String,
    /// The prefix of its topics, with which the names of coordinate frames begin.
    pub(crate) prefix: String,
    source: Vec<Option<PortLayout>>,
    nodes: Vec<Vec<Option<PortLayout>>>,
    curves: BTreeMap<Slot, u16>,
    once: BTreeMap<Slot, String>,
    pub(crate) commit_channel: u16,
}

impl RunLayout {
    pub(crate) fn port(&self, slot: Slot) -> Option<&PortLayout> {
        match slot {
            Slot::Source { port } => self.source.get(port.0)?.as_ref(),
            Slot::Node { node, port } => self.nodes.get(node.0)?.get(port.0)?.as_ref(),
        }
    }

    fn port_mut(&mut self, slot: Slot) -> Option<&mut PortLayout> {
        match slot {
            Slot::Source { port } => self.source.get_mut(port.0)?.as_mut(),
            Slot::Node { node, port } => self.nodes.get_mut(node.0)?.get_mut(port.0)?.as_mut(),
        }
    }

    /// The topic of an aggregate value; empty for other slots.
    pub(crate) fn aggregate_topic(&self, slot: Slot) -> &str {
        self.once.get(&slot).map_or("", String::as_str)
    }

    /// The channel of a recorded learning curve.
    pub(crate) fn curve_channel(&self, slot: Slot) -> Option<u16> {
        self.curves.get(&slot).copied()
    }
}

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
    pub(crate) fn new(plan: &Plan) -> Result<Self, RecordingError> {
        let mut layout = Self::default();
        let mut topics = BTreeSet::new();
        for run in &plan.runs {
            let run_layout = layout.run(plan, run, &mut topics)?;
            layout.runs.push(run_layout);
        }
        layout.number_float_disparities(plan)?;
        Ok(layout)
    }

    /// Gives disparities a second channel for maps that do not fit into 16 bits exactly: after all others, whose
    /// numbers stay those of earlier files.
    fn number_float_disparities(&mut self, plan: &Plan) -> Result<(), RecordingError> {
        for (run_id, run) in RunId::enumerate(&plan.runs) {
            for slot in run.slots().filter(|slot| is_disparity(run, *slot)) {
                let Some(port) = self.runs[run_id].port(slot) else { continue };
                let mut layout = self.channels[usize::from(port.channel) - 1].clone();
                layout.schema = Schema::FloatMap;
                layout.metadata.insert("unit".to_owned(), "disparity in pixels, NaN = none".to_owned());
                let id = self.numbered(layout)?;
                if let Some(port) = self.runs[run_id].port_mut(slot) {
                    port.other_channel = Some(id);
                }
            }
        }
        Ok(())
    }

    /// The topics in the file that stand for others: those of variants that share one, and channels with another topic
    /// than in the plan.
    pub(crate) fn aliases(&self, plan: &RecordedPlan) -> BTreeMap<String, String> {
        let renamed =
            |channel: &ChannelLayout| Some((channel.metadata.get(TOPIC_IN_PLAN)?.clone(), channel.topic.clone()));
        let mut aliases: BTreeMap<String, String> = self.channels.iter().filter_map(renamed).collect();
        for (alias, topic) in plan.aliases() {
            let written = aliases.get(topic).cloned().unwrap_or_else(|| topic.to_owned());
            aliases.insert(alias.to_owned(), written);
        }
        aliases
    }

    fn run(&mut self, plan: &Plan, run: &StageRun, topics: &mut BTreeSet<String>) -> Result<RunLayout, RecordingError> {
        let used: BTreeSet<Class> = run.slots().filter_map(|slot| class(run, slot)).collect();
        let part_of =
            |class: Class| Class::ALL.iter().filter(|c| used.contains(c)).position(|c| *c == class).map(PartId);
        let mut source = vec![None; run.source.outputs.len()];
        let mut nodes: Vec<_> = run.nodes.iter().map(|node| vec![None; node.outputs.len()]).collect();
        let (mut curves, mut once) = (BTreeMap::new(), BTreeMap::new());
        for slot in run.slots() {
            let output = run.output(slot);
            if output.port.rate == Rate::Once {
                once.insert(slot, output.topic.clone());
            }
            if is_recorded_curve(output) {
                let (topic, metadata) = (output.topic.clone(), metadata(run, slot, output));
                let layout = ChannelLayout { schema: Schema::CurvePoint, topic, metadata };
                curves.insert(slot, self.channel(layout, topics)?);
            }
            let Some(class) = class(run, slot) else { continue };
            // Points are computed from the source's values too: the encoder of a part must have these.
            let with = if points_of(plan, run, slot).is_some() { Class::Camera } else { class };
            let Some(part) = part_of(with) else { continue };
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
        let source_name = run.source.name.clone();
        Ok(RunLayout {
            parts: classes.len(),
            classes,
            source_ports,
            source_name,
            prefix: run.prefix.clone(),
            source,
            nodes,
            curves,
            once,
            commit_channel,
        })
    }

    fn port(
        &mut self,
        plan: &Plan,
        run: &StageRun,
        slot: Slot,
        class: Class,
        part: PartId,
        topics: &mut BTreeSet<String>,
    ) -> Result<PortLayout, RecordingError> {
        let output = run.output(slot);
        let value_type = output.port.value_type;
        let schema = match value_type {
            ValueType::Image | ValueType::Disparity | ValueType::TrueDisparity | ValueType::Mask => Schema::RawImage,
            ValueType::Depth | ValueType::RelativeInverseDepth | ValueType::Weight => Schema::FloatMap,
            ValueType::Calibration => Schema::CameraCalibration,
            ValueType::Scores => Schema::Score,
            ValueType::Number => Schema::Number,
            ValueType::Samples | ValueType::Model | ValueType::Reliability | ValueType::Curve => {
                let what = format!("values of type {value_type} are kept once a stage, not once a frame");
                return Err(RecordingError::Plan { topic: output.topic.clone(), what });
            }
        };
        let mut metadata = metadata(run, slot, output);
        let mut topic = output.topic.clone();
        if let Some(shown) = topic_shown(run, slot) {
            metadata.insert(TOPIC_IN_PLAN.to_owned(), std::mem::replace(&mut topic, shown));
        }
        let channel = ChannelLayout { schema, topic: topic.clone(), metadata: metadata.clone() };
        let channel = self.channel(channel, topics)?;
        let mut other_channel = None;
        if value_type == ValueType::Image {
            // Whether images have their file's bytes is known only when the first one is written: a topic uses one of
            // its two channels.
            let layout = ChannelLayout { schema: Schema::CompressedImage, topic, metadata };
            other_channel = Some(self.numbered(layout)?);
        }
        let companions = self.companions(plan, run, slot, topics)?;
        Ok(PortLayout {
            part,
            class,
            topic: output.topic.as_str().into(),
            channel,
            other_channel,
            companions,
            frame_id: Camera::of_slot(run, slot).frame_id(run).into(),
        })
    }

    fn companions(
        &mut self,
        plan: &Plan,
        run: &StageRun,
        slot: Slot,
        topics: &mut BTreeSet<String>,
    ) -> Result<Vec<CompanionLayout>, RecordingError> {
        let output = run.output(slot);
        let mut wanted: Vec<(Schema, String, String, Companion)> = Vec::new();
        match output.port.value_type {
            ValueType::Disparity | ValueType::TrueDisparity | ValueType::Depth | ValueType::Weight
                if plan.record.view =>
            {
                let topic = picture_topic(run, &output.topic);
                wanted.push((Schema::CompressedImage, topic, Camera::View.frame_id(run), Companion::Picture));
            }
            ValueType::Calibration if topic_shown(run, slot).is_some() => {
                let reference = Camera::of_slot(run, slot);
                let stage = run.prefix.trim_start_matches('/').to_owned();
                let mut add = |schema, name: &str, camera: Camera<'_>, what| {
                    wanted.push((schema, format!("{}/{name}", camera.folder(run)), camera.frame_id(run), what));
                };
                let transform = |parent: &str, pose| Companion::Transform { parent: parent.to_owned(), pose };
                add(Schema::FrameTransform, "transform", reference, transform(&stage, Pose::Level));
                let reference = reference.frame_id(run);
                if let Some(right) = Camera::right_of(run) {
                    add(Schema::CameraCalibration, "calibration", right, Companion::RightCalibration);
                    add(Schema::FrameTransform, "transform", right, transform(&reference, Pose::Right));
                }
                if plan.record.view {
                    add(Schema::CameraCalibration, "calibration", Camera::View, Companion::ViewCalibration);
                    add(Schema::FrameTransform, "transform", Camera::View, transform(&reference, Pose::Same));
                }
            }
            _ => {}
        }
        if let Some(points) = points_of(plan, run, slot) {
            let frame_id = Camera::of_slot(run, slot).frame_id(run);
            wanted.push((Schema::PointCloud, points_topic(run, &output.topic), frame_id, points));
        }
        let description = |companion: &Companion| match companion {
            Companion::Points { .. } => {
                "a preview point cloud, of every fourth pixel and row, coloured by the image; metres"
            }
            Companion::Picture => "a preview picture, of every second pixel and row; black = invalid",
            Companion::RightCalibration => "the calibration of the pair's right camera",
            Companion::ViewCalibration => "the calibration of the previews",
            Companion::Transform { .. } => "the pose of the camera",
        };
        let mut companions = Vec::new();
        for (schema, topic, frame_id, what) in wanted {
            let entries = [("about", description(&what).to_owned()), ("beside", output.topic.clone())];
            let metadata = entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
            let channel = self.channel(ChannelLayout { schema, topic, metadata }, topics)?;
            companions.push(CompanionLayout { what, channel, frame_id: frame_id.into() });
        }
        Ok(companions)
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

/// Whether an output is a recorded learning curve: points one after the other, outside frames.
fn is_recorded_curve(output: &PlannedOutput) -> bool {
    output.recorded && output.port.rate == Rate::Once && output.port.value_type == ValueType::Curve
}

fn is_disparity(run: &StageRun, slot: Slot) -> bool {
    matches!(run.output(slot).port.value_type, ValueType::Disparity | ValueType::TrueDisparity)
}

/// The class of a slot's values; `None` if they are not recorded per frame.
fn class(run: &StageRun, slot: Slot) -> Option<Class> {
    let output = run.output(slot);
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

/// Whether a node reads disparities and no other raster per frame: then its output has as few distinct numbers.
fn from_fixed_point(node: &PlannedNode) -> bool {
    let reads = |wanted: &[ValueType]| {
        let mut wired = node.inputs.iter().filter(|input| matches!(input.from, Some(Origin::Here(_))));
        wired.any(|input| wanted.contains(&input.port.value_type))
    };
    reads(&[ValueType::Disparity]) && !reads(&[ValueType::Image, ValueType::Depth, ValueType::Weight])
}

fn metadata(run: &StageRun, slot: Slot, output: &PlannedOutput) -> BTreeMap<String, String> {
    let unit = match output.port.value_type {
        ValueType::Disparity => {
            "0 = invalid; else disparity in pixels = value / 16 + min_disparity_px - 1, min_disparity_px being a field of the message"
        }
        ValueType::TrueDisparity => "disparity in pixels = value / 256, 0 = unknown",
        ValueType::Depth => "metres, NaN = invalid",
        ValueType::RelativeInverseDepth => "inverse depth of unknown scale and shift, larger = nearer, NaN = invalid",
        ValueType::Weight => "confidence in [0, 1]",
        ValueType::Mask => "255 = set, 0 = not",
        ValueType::Curve => "losses in the unit of the training loss",
        ValueType::Image
        | ValueType::Calibration
        | ValueType::Scores
        | ValueType::Samples
        | ValueType::Model
        | ValueType::Reliability
        | ValueType::Number => "",
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
