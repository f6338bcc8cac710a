//! What a recording decodes to, in few numbers: to be compared with what other readers decode.

use std::path::Path;

use crc32fast::Hasher;
use depthloom_recording::{Recording, StoredMessage};
use depthloom_scores::{DEPTH, DISPARITY};
use foxglove::messages::{CameraCalibration, FrameTransform, Quaternion, Vector3};
use prost::Message;
use serde_json::{Map, Value as Json, json};

use depthloom_codecs::decode::{float_map, inverse_bytes};
use depthloom_codecs::messages::{CurvePointMessage, ScoreMessage};
use depthloom_codecs::schema::{BASELINE_M, DOFFS_PX, Schema};
use depthloom_codecs::wire_format::{Content, Fields};

/// What the messages of a topic decode to.
struct Topic {
    /// That of the first message.
    schema: Schema,
    count: u64,
    first_ns: u64,
    last_ns: u64,
    crc: Hasher,
    numbers: Option<Numbers>,
}

/// What the pixels of a map of floats amount to.
#[derive(Default)]
struct Numbers {
    sum: f64,
    nan: u64,
    infinite: u64,
}

/// Of each topic of a recording its schema, how many messages it has, its first and last time, and a CRC-32 of what
/// they decode to; of maps of floats also the sum of the finite numbers, as text, and how many are NaN and infinite.
///
/// `tests/python/read_recording.py` computes the same object with Python's readers.
pub(crate) fn digest(path: impl AsRef<Path>) -> Json {
    let recording = Recording::open(path).expect("a recording");
    let mut topics: Vec<(String, Topic)> = Vec::new();
    let read = recording.each_message(|StoredMessage { topic: name, schema, time_ns, data }| {
        let schema = Schema::named(schema).ok_or("a channel is of an unknown schema")?;
        let known = topics.iter().position(|(of, _)| of == name);
        let topic = known.unwrap_or_else(|| {
            topics.push((name.to_owned(), Topic::new(schema, time_ns)));
            topics.len() - 1
        });
        topics[topic].1.take(schema, time_ns, data)
    });
    read.expect("its messages");
    let topics: Map<String, Json> = topics.into_iter().map(|(name, topic)| (name, topic.into_json())).collect();
    json!({ "topics": topics })
}

/// `depthloom.Commit`, without what only depthloom reads.
#[derive(Clone, PartialEq, prost::Message)]
struct Commit {
    #[prost(uint32, tag = "1")]
    run: u32,
    #[prost(string, tag = "2")]
    frame: String,
    #[prost(uint64, tag = "3")]
    index: u64,
    #[prost(string, tag = "4")]
    source_key: String,
    #[prost(message, repeated, tag = "5")]
    keys: Vec<NodeText>,
    #[prost(message, repeated, tag = "6")]
    failures: Vec<NodeText>,
    #[prost(fixed32, tag = "7")]
    crc32_before: u32,
}

/// `depthloom.NodeKey` or `depthloom.Failure`.
#[derive(Clone, PartialEq, prost::Message)]
struct NodeText {
    #[prost(uint32, optional, tag = "1")]
    node: Option<u32>,
    #[prost(string, tag = "2")]
    text: String,
}

impl Topic {
    fn new(schema: Schema, time_ns: u64) -> Self {
        Self { schema, count: 0, first_ns: time_ns, last_ns: time_ns, crc: Hasher::new(), numbers: None }
    }

    /// Takes a message: the topic's others may be of another schema.
    fn take(&mut self, schema: Schema, time_ns: u64, message: &[u8]) -> Result<(), String> {
        self.count += 1;
        self.last_ns = time_ns;
        match schema {
            Schema::RawImage | Schema::PointCloud => self.take_image(schema, message, 6),
            Schema::CompressedImage => self.take_image(schema, message, 2),
            Schema::CameraCalibration => self.take_calibration(message),
            Schema::Score => self.take_score(message),
            Schema::Commit | Schema::LiveCommit => self.take_commit(message),
            Schema::CurvePoint => self.take_curve_point(message),
            Schema::FloatMap => self.take_floats(message),
            Schema::FrameTransform => self.take_transform(message),
            Schema::Number => {
                self.crc.update(message);
                Ok(())
            }
        }
    }

    fn take_image(&mut self, schema: Schema, message: &[u8], data_field: u32) -> Result<(), String> {
        let (mut encoding, mut data): (&[u8], &[u8]) = (&[], &[]);
        for field in Fields(message) {
            let (number, content) = field.map_err(|error| error.to_string())?;
            if number == data_field {
                data = content.bytes();
            } else if number == 4 {
                encoding = content.bytes();
            }
        }
        self.crc.update(data);
        if schema == Schema::RawImage && encoding == b"32FC1" {
            self.take_numbers(data.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)));
        }
        Ok(())
    }

    fn take_floats(&mut self, message: &[u8]) -> Result<(), String> {
        let map = float_map(message)?;
        map.iter().for_each(|number| self.crc.update(&number.to_le_bytes()));
        self.crc.update(inverse_bytes(message)?);
        self.take_numbers(map.iter().copied());
        Ok(())
    }

    fn take_numbers(&mut self, samples: impl Iterator<Item = f32>) {
        let numbers = self.numbers.get_or_insert_default();
        for number in samples {
            if number.is_finite() {
                numbers.sum += f64::from(number);
            } else if number.is_nan() {
                numbers.nan += 1;
            } else {
                numbers.infinite += 1;
            }
        }
    }

    fn take_calibration(&mut self, message: &[u8]) -> Result<(), String> {
        let calibration = CameraCalibration::decode(message).map_err(|error| error.to_string())?;
        let (mut baseline_m, mut doffs_px) = (0, None);
        for field in Fields(message) {
            match field.map_err(|error| error.to_string())? {
                (BASELINE_M, Content::Fixed64(bits)) => baseline_m = bits,
                (DOFFS_PX, Content::Fixed64(bits)) => doffs_px = Some(bits),
                _ => {}
            }
        }
        self.crc.update(&calibration.width.to_le_bytes());
        self.crc.update(&calibration.height.to_le_bytes());
        for number in [calibration.d, calibration.k, calibration.r, calibration.p].concat() {
            self.crc.update(&number.to_le_bytes());
        }
        self.crc.update(&baseline_m.to_le_bytes());
        // Not present in most pairs, nor in recordings of older versions.
        if let Some(bits) = doffs_px {
            self.crc.update(&bits.to_le_bytes());
        }
        Ok(())
    }

    fn take_score(&mut self, message: &[u8]) -> Result<(), String> {
        let ScoreMessage { frame, row } = ScoreMessage::decode(message)?;
        self.crc.update(frame.as_bytes());
        self.crc.update(row.set.name().as_bytes());
        self.crc.update(row.zone.as_bytes());
        for count in [row.pixels, row.truth, row.valid] {
            self.crc.update(&count.to_le_bytes());
        }
        let metrics = DEPTH.iter().chain(&DISPARITY);
        let numbers = std::iter::once(row.log_mean).chain(metrics.map(|metric| row.get(metric)));
        for number in numbers {
            self.crc.update(&number.unwrap_or_default().to_le_bytes());
            self.crc.update(&[u8::from(number.is_some())]);
        }
        Ok(())
    }

    fn take_commit(&mut self, message: &[u8]) -> Result<(), String> {
        let commit = Commit::decode(message).map_err(|error| error.to_string())?;
        self.crc.update(&commit.run.to_le_bytes());
        self.crc.update(&commit.index.to_le_bytes());
        self.crc.update(commit.frame.as_bytes());
        self.crc.update(commit.source_key.as_bytes());
        for of in &commit.keys {
            self.crc.update(&of.node.unwrap_or_default().to_le_bytes());
            self.crc.update(of.text.as_bytes());
        }
        for of in &commit.failures {
            self.crc.update(&[u8::from(of.node.is_some())]);
            self.crc.update(&of.node.unwrap_or_default().to_le_bytes());
            self.crc.update(of.text.as_bytes());
        }
        self.crc.update(&commit.crc32_before.to_le_bytes());
        Ok(())
    }

    fn take_curve_point(&mut self, message: &[u8]) -> Result<(), String> {
        let point = CurvePointMessage::decode(message).map_err(|error| error.to_string())?;
        self.crc.update(&point.step.to_le_bytes());
        let numbers = [point.loss, point.validation, point.learning_rate];
        numbers.iter().for_each(|number| self.crc.update(&number.unwrap_or_default().to_le_bytes()));
        numbers.iter().for_each(|number| self.crc.update(&[u8::from(number.is_some())]));
        Ok(())
    }

    fn take_transform(&mut self, message: &[u8]) -> Result<(), String> {
        let transform = FrameTransform::decode(message).map_err(|error| error.to_string())?;
        self.crc.update(transform.parent_frame_id.as_bytes());
        self.crc.update(transform.child_frame_id.as_bytes());
        let Vector3 { x, y, z } = transform.translation.unwrap_or_default();
        let Quaternion { x: i, y: j, z: k, w } = transform.rotation.unwrap_or_default();
        [x, y, z, i, j, k, w].iter().for_each(|number| self.crc.update(&number.to_le_bytes()));
        Ok(())
    }

    fn into_json(self) -> Json {
        let mut digest = json!({
            "schema": self.schema.name(),
            "count": self.count,
            "first_ns": self.first_ns,
            "last_ns": self.last_ns,
            "crc32": self.crc.finalize(),
        });
        if let Some(Numbers { sum, nan, infinite }) = self.numbers {
            digest["sum"] = json!(format!("{sum:.9}"));
            digest["nan"] = json!(nan);
            digest["infinite"] = json!(infinite);
        }
        digest
    }
}
