//! Bags of a few small messages, as ROS 2 and Foxglove write them, and invalid ones.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use mcap::WriteOptions;
use mcap::records::MessageHeader;

/// Size of the images.
pub(crate) const SIZE: (u32, u32) = (40, 30);

/// Focal length 20 px, principal point (20, 15), baseline 0.5 m: `f * B` is 10 px m.
pub(crate) const LEFT_P: [f64; 12] = [20.0, 0.0, 20.0, 0.0, 0.0, 20.0, 15.0, 0.0, 0.0, 0.0, 1.0, 0.0];
pub(crate) const RIGHT_P: [f64; 12] = [20.0, 0.0, 20.0, -10.0, 0.0, 20.0, 15.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// When the first frame is.
pub(crate) const T0: u64 = 1_700_000_000_000_000_000;

/// Nanoseconds of a millisecond.
pub(crate) const MS: u64 = 1_000_000;

pub(crate) const LEFT: &str = "/stereo/left/image_rect";
pub(crate) const RIGHT: &str = "/stereo/right/image_rect";
pub(crate) const LEFT_INFO: &str = "/stereo/left/camera_info";
pub(crate) const RIGHT_INFO: &str = "/stereo/right/camera_info";

/// A message in XCDR1.
pub(crate) struct Cdr {
    bytes: Vec<u8>,
    big: bool,
}

impl Cdr {
    pub(crate) fn new(big: bool) -> Self {
        Self { bytes: vec![0, u8::from(!big), 0, 0], big }
    }

    pub(crate) fn raw(mut self, bytes: &[u8]) -> Self {
        self.bytes.extend_from_slice(bytes);
        self
    }

    fn number<const N: usize>(mut self, mut little: [u8; N]) -> Self {
        while !(self.bytes.len() - 4).is_multiple_of(N) {
            self.bytes.push(0);
        }
        if self.big {
            little.reverse();
        }
        self.raw(&little)
    }

    pub(crate) fn u8(self, value: u8) -> Self {
        self.number([value])
    }

    pub(crate) fn u32(self, value: u32) -> Self {
        self.number(value.to_le_bytes())
    }

    pub(crate) fn f64s(self, values: &[f64]) -> Self {
        values.iter().fold(self, |cdr, value| cdr.number(value.to_le_bytes()))
    }

    pub(crate) fn text(self, text: &str) -> Self {
        self.u32(text.len() as u32 + 1).raw(text.as_bytes()).raw(&[0])
    }

    pub(crate) fn header(self, stamp_ns: u64, frame: &str) -> Self {
        self.u32((stamp_ns / 1_000_000_000) as u32).u32((stamp_ns % 1_000_000_000) as u32).text(frame)
    }

    pub(crate) fn end(self) -> Vec<u8> {
        self.bytes
    }
}

/// A message, and the topic that it is on.
#[derive(Clone)]
pub(crate) struct Written {
    pub topic: String,
    pub message_type: String,
    pub encoding: String,
    pub log_ns: u64,
    pub bytes: Vec<u8>,
}

impl Written {
    pub(crate) fn new(topic: &str, message_type: &str, log_ns: u64, bytes: Vec<u8>) -> Self {
        Self {
            topic: topic.to_owned(),
            message_type: message_type.to_owned(),
            encoding: "cdr".to_owned(),
            log_ns,
            bytes,
        }
    }
}

/// A raw image with arbitrary fields.
pub(crate) struct Raw<'a> {
    pub size: (u32, u32),
    pub encoding: &'a str,
    pub step: u32,
    pub data: &'a [u8],
}

pub(crate) fn raw_image(big: bool, stamp_ns: u64, frame: &str, image: &Raw<'_>) -> Vec<u8> {
    let cdr = Cdr::new(big).header(stamp_ns, frame).u32(image.size.1).u32(image.size.0).text(image.encoding);
    cdr.u8(u8::from(big)).u32(image.step).u32(image.data.len() as u32).raw(image.data).end()
}

/// Grey pixels: column, row and a number all enter.
pub(crate) fn grey(number: u64) -> Vec<u8> {
    (0..SIZE.0 * SIZE.1).map(|at| (at as u64 * 7 + number * 31) as u8).collect()
}

pub(crate) fn image(topic: &str, frame: &str, stamp_ns: u64, number: u64) -> Written {
    let data = grey(number);
    let raw = Raw { size: SIZE, encoding: "mono8", step: SIZE.0, data: &data };
    Written::new(topic, "sensor_msgs/msg/Image", stamp_ns, raw_image(false, stamp_ns, frame, &raw))
}

/// A camera info.
#[derive(Clone, Copy)]
pub(crate) struct Info<'a> {
    pub size: (u32, u32),
    pub model: &'a str,
    pub d: &'a [f64],
    pub r: [f64; 9],
    pub p: [f64; 12],
    pub binning: u32,
    /// Column, row, width, height.
    pub part: [u32; 4],
}

pub(crate) const IDENTITY: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

impl Info<'_> {
    pub(crate) const fn with_projection(p: [f64; 12]) -> Self {
        Self { size: SIZE, model: "plumb_bob", d: &[0.0; 5], r: IDENTITY, p, binning: 0, part: [0; 4] }
    }

    pub(crate) fn message(&self, big: bool, stamp_ns: u64, frame: &str) -> Vec<u8> {
        let p = &self.p;
        let k = [p[0], p[1], p[2], p[4], p[5], p[6], p[8], p[9], p[10]];
        let [x, y, width, height] = self.part;
        let cdr = Cdr::new(big).header(stamp_ns, frame).u32(self.size.1).u32(self.size.0).text(self.model);
        let cdr = cdr.u32(self.d.len() as u32).f64s(self.d).f64s(&k).f64s(&self.r).f64s(p);
        cdr.u32(self.binning).u32(self.binning).u32(x).u32(y).u32(height).u32(width).u8(0).end()
    }

    pub(crate) fn on(&self, topic: &str, stamp_ns: u64) -> Written {
        Written::new(topic, "sensor_msgs/msg/CameraInfo", stamp_ns, self.message(false, stamp_ns, "camera_left"))
    }
}

/// Points as little-endian f32 x, y, z and an intensity, in one row.
pub(crate) fn cloud(stamp_ns: u64, frame: &str, points: &[[f32; 3]], fields: &[&str]) -> Vec<u8> {
    let data: Vec<u8> = points.iter().flat_map(|[x, y, z]| [*x, *y, *z, 1.0]).flat_map(f32::to_le_bytes).collect();
    let cdr = Cdr::new(false).header(stamp_ns, frame).u32(1).u32(points.len() as u32).u32(fields.len() as u32);
    let field = |cdr: Cdr, (at, name): (usize, &&str)| cdr.text(name).u32(at as u32 * 4).u8(7).u32(1);
    let cdr = fields.iter().enumerate().fold(cdr, field);
    cdr.u8(0).u32(16).u32(data.len() as u32).u32(data.len() as u32).raw(&data).u8(1).end()
}

/// Transforms: parent, child, translation, quaternion.
pub(crate) fn transforms(entries: &[(&str, &str, [f64; 3], [f64; 4])]) -> Vec<u8> {
    let one = |cdr: Cdr, (parent, child, t, q): &(&str, &str, [f64; 3], [f64; 4])| {
        cdr.header(T0, parent).text(child).f64s(t).f64s(q)
    };
    entries.iter().fold(Cdr::new(false).u32(entries.len() as u32), one).end()
}

/// A stereo pair with its cameras.
pub(crate) fn frame(stamp_ns: u64, number: u64) -> Vec<Written> {
    vec![
        image(LEFT, "camera_left", stamp_ns, number),
        image(RIGHT, "camera_right", stamp_ns, number + 100),
        Info::with_projection(LEFT_P).on(LEFT_INFO, stamp_ns),
        Info::with_projection(RIGHT_P).on(RIGHT_INFO, stamp_ns),
    ]
}

/// Three frames, 100 ms apart.
pub(crate) fn frames() -> Vec<Written> {
    (0..3).flat_map(|number| frame(T0 + number * 100 * MS, number)).collect()
}

/// Writes an MCAP file.
pub(crate) fn mcap(path: &Path, messages: &[Written], options: WriteOptions) {
    let mut writer = options.create(BufWriter::new(File::create(path).unwrap())).unwrap();
    for (sequence, message) in (0..).zip(messages) {
        let schema = writer.add_schema(&message.message_type, "ros2msg", b"").unwrap();
        let channel_id = writer.add_channel(schema, &message.topic, &message.encoding, &Default::default()).unwrap();
        let header = MessageHeader { channel_id, sequence, log_time: message.log_ns, publish_time: message.log_ns };
        writer.write_to_known_channel(&header, &message.bytes).unwrap();
    }
    writer.finish().unwrap();
}

/// Writes a file of rosbag2's SQLite storage.
pub(crate) fn sqlite(path: &Path, messages: &[Written]) {
    let database = rusqlite::Connection::open(path).unwrap();
    let tables = "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,serialization_format TEXT NOT NULL,offered_qos_profiles TEXT NOT NULL);
        CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL, data BLOB NOT NULL);
        CREATE INDEX timestamp_idx ON messages (timestamp ASC);";
    database.execute_batch(tables).unwrap();
    let mut topics: Vec<&str> = Vec::new();
    for message in messages {
        let id = topics.iter().position(|topic| *topic == message.topic).unwrap_or_else(|| {
            topics.push(&message.topic);
            let row = (topics.len() as i64 - 1, &message.topic, &message.message_type, &message.encoding);
            database.execute("INSERT INTO topics VALUES (?1, ?2, ?3, ?4, '')", row).unwrap();
            topics.len() - 1
        });
        let row = (id as i64, message.log_ns as i64, &message.bytes);
        database.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?1, ?2, ?3)", row).unwrap();
    }
}
