//! What a topic's messages are, and how they are written.

use depthloom_codecs::wire_format::{Content, Fields};
use depthloom_graphs::ErrorMessage;
use depthloom_graphs::Fault;

use crate::Topic;
use crate::cdr::Cdr;

/// The content of messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sort {
    /// An uncompressed image: `sensor_msgs/msg/Image`, `foxglove.RawImage`.
    Image,
    /// An image as JPEG or PNG: `sensor_msgs/msg/CompressedImage`, `foxglove.CompressedImage`.
    CompressedImage,
    /// A camera: `sensor_msgs/msg/CameraInfo`, `foxglove.CameraCalibration`.
    CameraInfo,
    /// Points: `sensor_msgs/msg/PointCloud2`.
    PointCloud,
    /// Transforms: `tf2_msgs/msg/TFMessage`.
    Transforms,
}

impl Sort {
    /// Whether it is an image, of either form.
    #[must_use]
    pub const fn is_image(self) -> bool {
        matches!(self, Self::Image | Self::CompressedImage)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wire {
    Cdr,
    Protobuf,
}

/// What a topic's messages are, and how they are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Form {
    /// Their content.
    pub sort: Sort,
    pub(crate) wire: Wire,
}

const TYPES: [(&str, Sort); 5] = [
    ("sensor_msgs/msg/Image", Sort::Image),
    ("sensor_msgs/msg/CompressedImage", Sort::CompressedImage),
    ("sensor_msgs/msg/CameraInfo", Sort::CameraInfo),
    ("sensor_msgs/msg/PointCloud2", Sort::PointCloud),
    ("tf2_msgs/msg/TFMessage", Sort::Transforms),
];
const FOXGLOVE_TYPES: [(&str, Sort); 3] = [
    ("foxglove.RawImage", Sort::Image),
    ("foxglove.CompressedImage", Sort::CompressedImage),
    ("foxglove.CameraCalibration", Sort::CameraInfo),
];

impl Form {
    /// The content of a topic's messages, in any encoding; `None` for types that are not read.
    #[must_use]
    pub fn sort_of(topic: &Topic) -> Option<Sort> {
        TYPES.iter().chain(&FOXGLOVE_TYPES).find(|(name, _)| *name == topic.message_type).map(|(_, sort)| *sort)
    }

    /// How a topic's messages are read.
    pub fn from_topic(topic: &Topic) -> Result<Self, Fault> {
        let Topic { name, message_type, encoding, .. } = topic;
        let (known, wire, written) = match encoding.as_str() {
            "cdr" => (&TYPES[..], Wire::Cdr, "CDR"),
            "protobuf" => (&FOXGLOVE_TYPES[..], Wire::Protobuf, "protobuf"),
            _ => {
                let fault = Fault::new(format!("{name} has messages {message_type} written as `{encoding}`"));
                return Err(fault.remedy(match encoding.as_str() {
                    "ros1" => "messages of ROS 1 are converted by `rosbags-convert` (PyPI, rosbags)",
                    "json" => "images in JSON are not read: record them as protobuf (foxglove.*) or CDR (sensor_msgs)",
                    _ => "`cdr` (ROS 2) and `protobuf` (foxglove.*) are read",
                }));
            }
        };
        let found = known.iter().find(|(name, _)| name == message_type);
        found.map(|(_, sort)| Self { sort: *sort, wire }).ok_or_else(|| {
            let types: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
            Fault::new(format!("{name} has messages {message_type}, which are not read"))
                .remedy(format!("in {written} these are read: {}", types.join(", ")))
        })
    }
}

/// How a message begins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// Capture time, nanoseconds; 0 if the sender did not set it.
    pub stamp_ns: u64,
    /// The coordinate frame: of an image, the camera's. Without the `/` that ROS 1 put first.
    pub frame_id: String,
}

impl Header {
    pub(crate) fn cdr(cdr: &mut Cdr<'_>) -> Result<Self, ErrorMessage> {
        let stamp_ns = cdr_stamp(cdr)?;
        Ok(Self { stamp_ns, frame_id: frame(cdr.text("header.frame_id")?) })
    }
}

pub(crate) fn frame(name: &str) -> String {
    name.strip_prefix('/').unwrap_or(name).to_owned()
}

fn cdr_stamp(cdr: &mut Cdr<'_>) -> Result<u64, ErrorMessage> {
    stamp(cdr.i32("header.stamp.sec")?.into(), cdr.u32("header.stamp.nanosec")?.into())
}

fn stamp(seconds: i64, nanoseconds: u64) -> Result<u64, ErrorMessage> {
    let whole = u64::try_from(seconds).ok().and_then(|seconds| seconds.checked_mul(1_000_000_000));
    let sum = whole.filter(|_| nanoseconds < 1_000_000_000).and_then(|whole| whole.checked_add(nanoseconds));
    sum.ok_or_else(|| ErrorMessage::new(format!("its stamp is {seconds} s and {nanoseconds} ns, which is not a time")))
}

/// The bytes of a protobuf message that surely hold its first field, and of a CDR message its stamp.
pub(crate) const HEAD: usize = 64;

/// The stamp in a message's first bytes; `None` where they do not contain it.
pub(crate) fn stamp_of(wire: Wire, head: &[u8], is_whole: bool) -> Result<Option<u64>, ErrorMessage> {
    match wire {
        Wire::Cdr => cdr_stamp(&mut Cdr::new(head)?).map(Some),
        Wire::Protobuf => {
            for field in Fields(head) {
                match field {
                    Ok((1, content)) => return timestamp(content).map(Some),
                    Ok(_) => {}
                    Err(_) if !is_whole => return Ok(None),
                    Err(error) => return Err(ErrorMessage::new(error.to_string())),
                }
            }
            Ok(is_whole.then_some(0))
        }
    }
}

/// `google.protobuf.Timestamp`.
pub(crate) fn timestamp(content: Content<'_>) -> Result<u64, ErrorMessage> {
    let (mut seconds, mut nanoseconds) = (0, 0);
    for field in Fields(content.bytes()) {
        match field.map_err(|error| ErrorMessage::new(error.to_string()))? {
            (1, Content::Varint(value)) => seconds = value.cast_signed(),
            (2, Content::Varint(value)) => nanoseconds = value,
            _ => {}
        }
    }
    stamp(seconds, nanoseconds)
}
