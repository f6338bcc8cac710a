//! The schemas of a recording: Foxglove's, with complete descriptor sets, and depthloom's own five.
//!
//! Foxglove's `RawImage` and `CameraCalibration` get fields beyond Foxglove's own, declared in the descriptor that the
//! recording carries and skipped by readers that do not know them: the smallest disparity searched, without which a
//! fixed-point map cannot be read back, and the pair's baseline, which `P` holds only as a rounded product, with what
//! the right camera's principal point differs, which only its own `P` contains.

use std::sync::OnceLock;

use depthloom_scores::{DEPTH, DISPARITY, Metric};
use foxglove::Encode;
use foxglove::messages::{CameraCalibration, CompressedImage, FrameTransform, PointCloud, RawImage};
use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet, OneofDescriptorProto,
};

use crate::messages::{LOG_MEAN, TRUTH, VALID, ZONE};

/// `RawImage`: the smallest disparity searched, whole pixels; of disparity maps only, whose numbers count from a pixel
/// below it.
pub(crate) const MIN_DISPARITY_PX: u32 = 1001;
/// `CameraCalibration`: the distance between the two cameras' centres, metres.
pub const BASELINE_M: u32 = 1001;
/// `CameraCalibration`: column of the right principal point minus that of the left, pixels; absent if it is 0.
pub const DOFFS_PX: u32 = 1002;

/// `FloatMap`: inverse depth, 1/m, of depths that do not hold it; NaN where they do.
pub(crate) const INVERSE: u32 = 10;

/// A schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Schema {
    /// An image, in its file's own bytes.
    CompressedImage,
    /// Pixels.
    RawImage,
    /// Intrinsics and baseline.
    CameraCalibration,
    /// A row of scores.
    Score,
    /// What closes a frame.
    Commit,
    /// A point of a learning curve.
    CurvePoint,
    /// Depths or weights.
    FloatMap,
    /// Position of a camera.
    FrameTransform,
    /// Points of a depth.
    PointCloud,
    /// What closes a frame of a live run: [`Schema::Commit`], which other recordings keep unchanged, with `live`.
    LiveCommit,
    /// A number of a frame.
    Number,
}

impl Schema {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::CompressedImage,
        Self::RawImage,
        Self::CameraCalibration,
        Self::Score,
        Self::Commit,
        Self::CurvePoint,
        Self::FloatMap,
        Self::FrameTransform,
        Self::PointCloud,
        Self::LiveCommit,
        Self::Number,
    ];

    /// Its id in every recording; zero is reserved by the format.
    #[must_use]
    pub const fn id(self) -> u16 {
        self as u16 + 1
    }

    /// Its full name in protobuf.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::CompressedImage => "foxglove.CompressedImage",
            Self::RawImage => "foxglove.RawImage",
            Self::CameraCalibration => "foxglove.CameraCalibration",
            Self::Score => "depthloom.Score",
            Self::Commit | Self::LiveCommit => "depthloom.Commit",
            Self::CurvePoint => "depthloom.CurvePoint",
            Self::FloatMap => "depthloom.FloatMap",
            Self::FrameTransform => "foxglove.FrameTransform",
            Self::PointCloud => "foxglove.PointCloud",
            Self::Number => "depthloom.Number",
        }
    }

    /// The schema with that id.
    #[must_use]
    pub fn with_id(id: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|schema| schema.id() == id)
    }

    /// The schema of that name; of commits, the one without `live`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|schema| schema.name() == name)
    }

    /// Whether its messages are a few hundred bytes.
    #[must_use]
    pub const fn is_small(self) -> bool {
        match self {
            Self::CompressedImage | Self::RawImage | Self::FloatMap | Self::PointCloud => false,
            Self::CameraCalibration
            | Self::Score
            | Self::Commit
            | Self::LiveCommit
            | Self::CurvePoint
            | Self::FrameTransform
            | Self::Number => true,
        }
    }

    /// The serialized `FileDescriptorSet`.
    #[must_use]
    pub fn descriptor_set(self) -> &'static [u8] {
        static SETS: OnceLock<[Vec<u8>; Schema::ALL.len()]> = OnceLock::new();
        let sets = SETS.get_or_init(|| Self::ALL.map(|schema| schema.build().encode_to_vec()));
        &sets[self as usize]
    }

    fn build(self) -> FileDescriptorSet {
        match self {
            Self::CompressedImage => foxglove_set::<CompressedImage>(),
            Self::RawImage => {
                let field = field("min_disparity_px", MIN_DISPARITY_PX, Type::Sint32);
                extended(foxglove_set::<RawImage>(), "RawImage", field)
            }
            Self::CameraCalibration => {
                let set = foxglove_set::<CameraCalibration>();
                let set = extended(set, "CameraCalibration", field("baseline_m", BASELINE_M, Type::Double));
                extended(set, "CameraCalibration", field("doffs_px", DOFFS_PX, Type::Double))
            }
            Self::FrameTransform => foxglove_set::<FrameTransform>(),
            Self::PointCloud => foxglove_set::<PointCloud>(),
            Self::Score => own_set("depthloom/Score.proto", vec![score()]),
            Self::Commit => own_set("depthloom/Commit.proto", commit()),
            Self::LiveCommit => own_set("depthloom/Commit.proto", live_commit()),
            Self::CurvePoint => own_set("depthloom/CurvePoint.proto", vec![curve_point()]),
            Self::FloatMap => own_set("depthloom/FloatMap.proto", vec![float_map(), instant()]),
            Self::Number => own_set("depthloom/Number.proto", vec![number()]),
        }
    }
}

fn foxglove_set<T: Encode>() -> FileDescriptorSet {
    let schema = T::get_schema().expect("foxglove's messages have schemas");
    FileDescriptorSet::decode(&*schema.data).expect("foxglove's schemas are descriptor sets")
}

/// The set with one more field in one of its messages.
fn extended(mut set: FileDescriptorSet, message: &str, field: FieldDescriptorProto) -> FileDescriptorSet {
    let messages = set.file.iter_mut().flat_map(|file| &mut file.message_type);
    let found = messages.into_iter().find(|descriptor| descriptor.name() == message);
    found.expect("a descriptor set holds its message").field.push(field);
    set
}

fn own_set(file: &str, messages: Vec<DescriptorProto>) -> FileDescriptorSet {
    let file = FileDescriptorProto {
        name: Some(file.to_owned()),
        package: Some("depthloom".to_owned()),
        message_type: messages,
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    };
    FileDescriptorSet { file: vec![file] }
}

fn field(name: &str, number: u32, kind: Type) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number as i32),
        label: Some(Label::Optional.into()),
        r#type: Some(kind.into()),
        ..FieldDescriptorProto::default()
    }
}

fn message(name: &str, fields: Vec<FieldDescriptorProto>) -> DescriptorProto {
    DescriptorProto { name: Some(name.to_owned()), field: fields, ..DescriptorProto::default() }
}

/// Marks a field as optional; proto3 does so by a `oneof` for it.
fn optional(mut message: DescriptorProto, field: &str) -> DescriptorProto {
    let index = message.oneof_decl.len() as i32;
    message.oneof_decl.push(OneofDescriptorProto { name: Some(format!("_{field}")), options: None });
    let found = message.field.iter_mut().find(|descriptor| descriptor.name() == field);
    let found = found.expect("the field is declared");
    found.oneof_index = Some(index);
    found.proto3_optional = Some(true);
    message
}

fn nested(name: &str, number: u32, type_name: &str) -> FieldDescriptorProto {
    FieldDescriptorProto { type_name: Some(format!(".depthloom.{type_name}")), ..field(name, number, Type::Message) }
}

fn repeated(name: &str, number: u32, type_name: &str) -> FieldDescriptorProto {
    FieldDescriptorProto {
        label: Some(Label::Repeated.into()),
        type_name: Some(format!(".depthloom.{type_name}")),
        ..field(name, number, Type::Message)
    }
}

fn score() -> DescriptorProto {
    let mut fields = vec![
        field("frame", 1, Type::String),
        field("set", 2, Type::String),
        field("pixels", 3, Type::Uint64),
        field("zone", ZONE, Type::String),
        field("truth", TRUTH, Type::Uint64),
        field("valid", VALID, Type::Uint64),
        field("log_mean", LOG_MEAN, Type::Double),
    ];
    let metrics = || DEPTH.iter().chain(&DISPARITY);
    fields.extend(metrics().map(|metric| field(&metric.field_name(), metric.field, Type::Double)));
    let absent = std::iter::once("log_mean".to_owned()).chain(metrics().map(Metric::field_name));
    absent.fold(message("Score", fields), |message, field| optional(message, &field))
}

/// The messages of a commit record.
fn commit() -> Vec<DescriptorProto> {
    let node = || field("node", 1, Type::Uint32);
    let fields = vec![
        field("run", 1, Type::Uint32),
        field("frame", 2, Type::String),
        field("index", 3, Type::Uint64),
        field("source_key", 4, Type::String),
        repeated("keys", 5, "NodeKey"),
        repeated("failures", 6, "Failure"),
        field("crc32_before", 7, Type::Fixed32),
        repeated("warnings", 8, "Warning"),
        nested("absent", 9, "Absent"),
    ];
    vec![
        message("Commit", fields),
        message("NodeKey", vec![node(), field("key", 2, Type::String)]),
        optional(message("Failure", vec![node(), field("what", 2, Type::String)]), "node"),
        optional(
            message("Warning", vec![node(), field("what", 2, Type::String), field("count", 3, Type::Uint64)]),
            "node",
        ),
        message("Absent", vec![repeated("ports", 1, "AbsentPort")]),
        optional(message("AbsentPort", vec![node(), field("port", 2, Type::Uint32)]), "node"),
    ]
}

fn live_commit() -> Vec<DescriptorProto> {
    let mut messages = commit();
    messages[0].field.push(nested("live", 10, "Live"));
    let counts = ["dropped_graph", "dropped_recording", "dropped_source", "latency_ns"];
    let counts = counts.iter().zip(1..).map(|(name, number)| field(name, number, Type::Uint64));
    messages.push(message("Live", counts.collect()));
    messages
}

fn curve_point() -> DescriptorProto {
    let numbers = ["loss", "validation", "learning_rate"];
    let mut fields = vec![field("step", 1, Type::Uint64)];
    fields.extend(numbers.iter().zip(2..).map(|(name, number)| field(name, number, Type::Double)));
    numbers.into_iter().fold(message("CurvePoint", fields), optional)
}

/// Its presence is declared, so that 0 is written too.
fn number() -> DescriptorProto {
    optional(message("Number", vec![field("value", 1, Type::Double)]), "value")
}

/// Fields as those of `foxglove.RawImage`, as far as that has them.
fn float_map() -> DescriptorProto {
    let fields = vec![
        nested("timestamp", 1, "Instant"),
        field("width", 2, Type::Fixed32),
        field("height", 3, Type::Fixed32),
        field("data", 6, Type::Bytes),
        field("frame_id", 7, Type::String),
        field("codes", 8, Type::Bytes),
        field("lows", 9, Type::Bytes),
        field("inverse", INVERSE, Type::Bytes),
    ];
    message("FloatMap", fields)
}

/// As `google.protobuf.Timestamp`.
fn instant() -> DescriptorProto {
    message("Instant", vec![field("seconds", 1, Type::Int64), field("nanos", 2, Type::Int32)])
}

#[cfg(test)]
mod tests {
    use prost::Message;
    use prost_types::FileDescriptorSet;

    use super::Schema;

    #[test]
    fn every_data_set_is_complete() {
        for schema in Schema::ALL {
            let set = FileDescriptorSet::decode(schema.descriptor_set()).unwrap();
            let files: Vec<_> = set.file.iter().map(|file| file.name().to_owned()).collect();
            for file in &set.file {
                for dependency in &file.dependency {
                    assert!(files.contains(dependency), "{}: {dependency} is missing", schema.name());
                }
            }
            let (package, message) = schema.name().split_once('.').unwrap();
            let found = set.file.iter().any(|file| {
                file.package() == package && file.message_type.iter().any(|descriptor| descriptor.name() == message)
            });
            assert!(found, "{} is in its own set", schema.name());
        }
    }
}
