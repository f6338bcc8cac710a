//! Data for viewers besides the values: a camera's calibration where they look for it, coloured maps, a start time.
//!
//! Foxglove uses for an image the calibration whose topic has the same prefix up to the last `/`, so each camera has a
//! folder of topics. Rerun refuses a coordinate frame that two topics define, so each camera of each stage run has its
//! own frame.

use crate::write::part::{Messages, Packing, Unkept};
use depthloom_codecs::encode::{Stamp, put_camera, put_compressed_image, put_points, put_transform};
use depthloom_codecs::files::Cloud;
use depthloom_codecs::picture::{picture, reduced};
use depthloom_graphs::Frame;
use depthloom_graphs::Value;
use depthloom_graphs::ValueType;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{FrameIndex, Plan, PortId, StageRun};
use depthloom_graphs::values::{Encoded, ImageFormat};

/// A year, nanoseconds.
const YEAR_NS: u64 = 365 * 24 * 3600 * 1_000_000_000;
/// The start of stages whose frames have no clock, nanoseconds since 1970: 2000-01-01T00:00:00Z.
pub(crate) const BEGINNING_NS: u64 = 946_684_800 * 1_000_000_000;
/// The time between two frames without a clock, nanoseconds.
const FRAME_NS: u64 = 100_000_000;

/// A point cloud has one point per this many pixels of a row and of a column. Its points are at most this far away,
/// metres.
const POINT_STEP: u32 = 4;
const FARTHEST_M: f64 = 100.0;

/// The frame with the time at which viewers show it: its own if its source has a clock. Frames of a source that counts
/// from zero follow each other in steps of 0.1 s, whatever their numbers are: then all stages begin with their first
/// frame where a viewer opens.
///
/// A recording as a source reproduces these times.
pub(crate) fn at_the_time_shown(position: FrameIndex, frame: &Frame) -> Frame {
    let has_clock = frame.time_ns >= YEAR_NS && !(BEGINNING_NS..BEGINNING_NS + YEAR_NS).contains(&frame.time_ns);
    let time_ns = if has_clock { frame.time_ns } else { BEGINNING_NS + FRAME_NS * position.0 as u64 };
    Frame { time_ns, ..frame.clone() }
}

/// A camera of a stage run: a folder of topics, and a coordinate frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Camera<'a> {
    /// The source's first image, in whose pixels all maps are; `None` if the source has no image.
    Reference(Option<&'a str>),
    /// The other camera of the pair: the source's second image.
    Right(&'a str),
    Other(&'a str),
    /// The reference camera with every second pixel and row: for previews of maps.
    View,
}

impl<'a> Camera<'a> {
    /// The camera with the pixels of a slot's values.
    pub(crate) fn of_slot(run: &'a StageRun, slot: Slot) -> Self {
        let outputs = &run.source.outputs;
        // A recording as a source may also have outputs of nodes: `node.output`.
        let is_camera =
            |port: PortId| outputs[port].port.value_type == ValueType::Image && !outputs[port].port.name.contains('.');
        let mut cameras = PortId::all(outputs.len()).filter(|port| is_camera(*port));
        let (reference, right) = (cameras.next(), cameras.next());
        let name = |port: PortId| outputs[port].port.name;
        match slot {
            Slot::Source { port } if Some(port) == right => Self::Right(name(port)),
            Slot::Source { port } if is_camera(port) && Some(port) != reference => Self::Other(name(port)),
            _ => Self::Reference(reference.map(name)),
        }
    }

    /// The other camera of the pair, if the source has one.
    pub(crate) fn right_of(run: &'a StageRun) -> Option<Self> {
        let ports = PortId::all(run.source.outputs.len());
        ports.map(|port| Self::of_slot(run, Slot::Source { port })).find(|camera| matches!(camera, Self::Right(_)))
    }

    pub(crate) fn folder(self, run: &StageRun) -> String {
        match self {
            Self::Reference(None) => format!("{}/source", run.prefix),
            Self::Reference(Some(name)) | Self::Right(name) | Self::Other(name) => {
                format!("{}/source/{name}", run.prefix)
            }
            Self::View => format!("{}/view", run.prefix),
        }
    }

    /// Its coordinate frame: x to the right, y down, z forward.
    pub(crate) fn frame_id(self, run: &StageRun) -> String {
        let stage = run.prefix.trim_start_matches('/');
        match self {
            Self::Reference(None) => format!("{stage}/{}", run.source.name),
            Self::Reference(Some(name)) | Self::Right(name) | Self::Other(name) => format!("{stage}/{name}"),
            Self::View => format!("{stage}/view"),
        }
    }
}

/// The topic under which viewers find a value with its camera; `None` if that is its own topic.
pub(crate) fn topic_shown(run: &StageRun, slot: Slot) -> Option<String> {
    let Slot::Source { port } = slot else { return None };
    let output = &run.source.outputs[port];
    let of_type =
        |value_type| move |other: &&depthloom_graphs::plan::PlannedOutput| other.port.value_type == value_type;
    let folder = Camera::of_slot(run, slot).folder(run);
    match output.port.value_type {
        ValueType::Image if !output.port.name.contains('.') => Some(format!("{folder}/image")),
        ValueType::Calibration => {
            let first = run.source.outputs.iter().find(of_type(ValueType::Calibration));
            (first.map(|first| first.port.name) == Some(output.port.name)).then(|| format!("{folder}/calibration"))
        }
        _ => None,
    }
}

pub(crate) fn picture_topic(run: &StageRun, topic: &str) -> String {
    format!("{}/{}", Camera::View.folder(run), within(run, topic))
}

pub(crate) fn points_topic(run: &StageRun, topic: &str) -> String {
    format!("{}/points/{}", run.prefix, within(run, topic))
}

/// A topic of a stage run as one segment of a topic.
fn within(run: &StageRun, topic: &str) -> String {
    topic.strip_prefix(&run.prefix).unwrap_or(topic).trim_start_matches('/').replace('/', ".")
}

/// The inputs of the point cloud of a slot's values, if it is recorded: it is in the same part of the frame as these.
pub(crate) fn points_of(plan: &Plan, run: &StageRun, slot: Slot) -> Option<Companion> {
    let output = run.output(slot);
    let node = match slot {
        Slot::Source { .. } => "source",
        Slot::Node { node, .. } => run.nodes[node].name.as_str(),
    };
    let is_requested = || plan.record.points.iter().any(|points| points.names(&run.stage, node, output.port.name));
    if !output.recorded || output.port.value_type != ValueType::Depth || !is_requested() {
        return None;
    }
    let first = |value_type| {
        let of_type = |port: &PortId| run.source.outputs[*port].port.value_type == value_type;
        let port = PortId::all(run.source.outputs.len()).find(of_type)?;
        run.source.outputs[port].recorded.then_some(Slot::Source { port })
    };
    Some(Companion::Points { calibration: first(ValueType::Calibration)?, image: first(ValueType::Image) })
}

/// A message besides that of a value. It is computed from the value (points: also from the source's values), so it is
/// stored and reproduced together with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Companion {
    Picture,
    /// For a depth: its points, from the calibration and coloured by the image in that part of the frame.
    Points {
        calibration: Slot,
        image: Option<Slot>,
    },
    /// For a calibration: that of the right camera of the pair.
    RightCalibration,
    /// For a calibration: that of the previews' camera.
    ViewCalibration,
    /// For a calibration: the pose of a camera in another one's frame.
    Transform {
        parent: String,
        pose: Pose,
    },
}

/// The pose of a camera in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pose {
    /// A camera that looks along x, in a frame whose z points up.
    Level,
    /// The same pose as the other camera.
    Same,
    /// One baseline to the right of the other camera.
    Right,
}

impl Companion {
    /// Adds the message of a value to a part; a map without pixels has no preview.
    pub(crate) fn put(
        &self,
        part: &mut impl Messages,
        (channel, stamp): (u16, Stamp<'_>),
        value: &Value,
        others: &[(Slot, Value)],
    ) -> Result<(), Unkept> {
        let mut message = Vec::new();
        match (self, value) {
            (Self::Picture, value) => {
                let Some(bytes) = picture(value) else { return Ok(()) };
                let encoded = Encoded { format: ImageFormat::Png, bytes: bytes.into() };
                let put = |out: &mut Vec<u8>| put_compressed_image(out, stamp, &encoded);
                return part.alone(channel, Packing::Plain, encoded.bytes.len(), put);
            }
            (Self::Points { calibration, image }, value) => {
                let value_of = |input: Slot| others.iter().find(|(slot, _)| *slot == input).map(|(_, value)| value);
                let Some(Value::Calibration(calibration)) = value_of(*calibration) else { return Ok(()) };
                let image = match image.and_then(value_of) {
                    Some(Value::Image(image)) => Some(&**image),
                    _ => None,
                };
                // A map of another size than the image has no points.
                let Ok(cloud) = Cloud::of_each(POINT_STEP, value, calibration, image, (0.0, FARTHEST_M)) else {
                    return Ok(());
                };
                let size = 16 * cloud.points.len();
                return part.alone(channel, Packing::Compressed, size, |out| put_points(out, stamp, &cloud));
            }
            (Self::RightCalibration, Value::Calibration(calibration)) => {
                put_camera(&mut message, stamp, calibration, true);
            }
            (Self::ViewCalibration, Value::Calibration(calibration)) => {
                put_camera(&mut message, stamp, &reduced(calibration), false);
            }
            (Self::Transform { parent, pose }, Value::Calibration(calibration)) => {
                let same = [0.0, 0.0, 0.0, 1.0];
                let (x, rotation) = match pose {
                    Pose::Level => (0.0, [-0.5, 0.5, -0.5, 0.5]),
                    Pose::Same => (0.0, same),
                    Pose::Right => (calibration.baseline_m, same),
                };
                put_transform(&mut message, stamp, parent, [x, 0.0, 0.0], rotation);
            }
            _ => return Ok(()),
        }
        part.small(channel, &message)
    }
}
