//! What viewers go by: names, frames, calibrations, times.
#![expect(clippy::unwrap_used, reason = "what is read here is read as a test does")]

use std::collections::{BTreeMap, BTreeSet};

use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{NodeId, OutputPattern, PortId, RunId};
use depthloom_graphs::values::Pixels;
use depthloom_graphs::{Frame, Value};
use depthloom_recording::{Recorder, Recording};
use foxglove::Decode;
use foxglove::messages::{CameraCalibration, CompressedImage, FrameTransform, PointCloud, RawImage};
use mcap::MessageStream;

use crate::fixture::{BEGINNING_NS, frame, plan_of, record_aggregate_values, record_frame, record_frame_at, values};

const WIDTH: u32 = 70;
const HEIGHT: u32 = 41;

/// Two stages, each with two frames and what it learnt.
fn recorded(frames: impl Fn(u64) -> Frame) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &plan_of(&["learn", "compare"])).unwrap();
    for run in 0..2 {
        for position in 0..2 {
            let index = position as u64 + 3;
            let values = values(&frame(index), WIDTH, HEIGHT);
            record_frame_at(&recorder, RunId(run), (position, &frames(index)), &values, false);
        }
        record_aggregate_values(&recorder, RunId(run));
    }
    recorder.finish(&[]).unwrap();
    std::fs::read(&path).unwrap()
}

/// A description of the last message of each topic: its frame, and for images the size.
struct Shown {
    frame_id: String,
    size: Option<(u32, u32)>,
    calibration: Option<CameraCalibration>,
}

fn shown(bytes: &[u8]) -> BTreeMap<String, Shown> {
    let mut shown = BTreeMap::new();
    for message in MessageStream::new(bytes).unwrap().map(Result::unwrap) {
        let schema = message.channel.schema.as_ref().unwrap().name.clone();
        let (frame_id, size, calibration) = match schema.as_str() {
            "foxglove.RawImage" => {
                let image = RawImage::decode(&*message.data).unwrap();
                (image.frame_id, Some((image.width, image.height)), None)
            }
            "foxglove.CompressedImage" => {
                let image = CompressedImage::decode(&*message.data).unwrap();
                assert!(["png", "jpeg"].contains(&image.format.as_str()), "{}", image.format);
                let decoded = image::load_from_memory(&image.data).ok();
                (image.frame_id, decoded.map(|image| (image.width(), image.height())), None)
            }
            "foxglove.CameraCalibration" => {
                let calibration = CameraCalibration::decode(&*message.data).unwrap();
                (calibration.frame_id.clone(), None, Some(calibration))
            }
            _ => continue,
        };
        shown.insert(message.channel.topic.clone(), Shown { frame_id, size, calibration });
    }
    shown
}

/// Foxglove's rule: of the calibrations whose topics begin as the image's does, up to its last `/`, any may be taken.
fn matching<'a>(shown: &'a BTreeMap<String, Shown>, image: &str) -> Vec<&'a CameraCalibration> {
    let prefix = &image[..=image.rfind('/').unwrap()];
    let of_prefix = shown.iter().filter(|(topic, _)| topic.starts_with(prefix));
    of_prefix.filter_map(|(_, shown)| shown.calibration.as_ref()).collect()
}

#[test]
fn every_camera_and_every_picture_finds_its_calibration() {
    let shown = shown(&recorded(frame));
    let mut pictures = 0;
    for (topic, image) in &shown {
        let is_looked_at = topic.contains("/view/") || topic.ends_with("/image");
        if image.calibration.is_some() || !is_looked_at {
            continue;
        }
        let [calibration] = matching(&shown, topic)[..] else { panic!("{topic} has one calibration") };
        assert_eq!(calibration.frame_id, image.frame_id, "{topic}");
        // The fixture's left image is not a complete file.
        if let Some(size) = image.size {
            assert_eq!((calibration.width, calibration.height), size, "{topic}");
        }
        pictures += usize::from(topic.contains("/view/"));
    }
    assert_eq!(pictures, 2 * 5, "disparity, two depths, a weight, the truth");
    for (topic, right) in shown.iter().filter(|(topic, _)| topic.ends_with("/right/calibration")) {
        let right = right.calibration.as_ref().unwrap();
        let left = shown[&topic.replace("right", "left")].calibration.as_ref().unwrap();
        assert_eq!((&left.k, left.p[3]), (&right.k, 0.0));
        assert!(right.p[3] < 0.0);
        assert_eq!([left.p[0], left.p[2], left.p[6]], [left.k[0], left.k[2], left.k[5]]);
        assert_eq!([right.p[0], right.p[2], right.p[6]], [left.p[0], left.p[2], left.p[6]]);
    }
}

/// Rerun's rule: a frame is defined by one topic.
#[test]
fn no_two_topics_define_a_frame() {
    let bytes = recorded(frame);
    let mut defined: BTreeMap<String, String> = BTreeMap::new();
    let mut parents = BTreeSet::new();
    for message in MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        let child = match message.channel.schema.as_ref().unwrap().name.as_str() {
            "foxglove.CameraCalibration" => {
                format!("{}_image_plane", CameraCalibration::decode(&*message.data).unwrap().frame_id)
            }
            "foxglove.FrameTransform" => {
                let transform = FrameTransform::decode(&*message.data).unwrap();
                let turned = transform.rotation.unwrap();
                let length = turned.x.powi(2) + turned.y.powi(2) + turned.z.powi(2) + turned.w.powi(2);
                assert!((length - 1.0).abs() < 1e-12);
                parents.insert(transform.parent_frame_id);
                transform.child_frame_id
            }
            _ => continue,
        };
        let by = defined.entry(child).or_insert_with(|| message.channel.topic.clone());
        assert_eq!(*by, message.channel.topic);
    }
    assert_eq!(defined.len(), 2 * 6, "three cameras of two stages: where they stand, and their planes");
    assert_eq!(parents, ["learn", "learn/left", "compare", "compare/left"].map(str::to_owned).into());
}

#[test]
fn records_of_metadata_have_names_of_their_own() {
    let bytes = recorded(frame);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let names: BTreeSet<&str> = summary.metadata_indexes.iter().map(|index| index.name.as_str()).collect();
    assert_eq!(names.len(), summary.metadata_indexes.len(), "{names:?}");
    assert_eq!(names.len(), 5, "{names:?}");
}

#[test]
fn stages_begin_together_where_a_viewer_opens_and_clocks_stay() {
    let first_of = |bytes: &[u8], stage: &str| {
        let mut messages = MessageStream::new(bytes).unwrap().map(Result::unwrap);
        messages.find(|message| message.channel.topic.starts_with(stage)).unwrap().log_time
    };
    let bytes = recorded(frame);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.stats.unwrap().message_start_time, BEGINNING_NS);
    assert_eq!([first_of(&bytes, "/learn/"), first_of(&bytes, "/compare/")], [BEGINNING_NS; 2]);
    // A recording that is a source: the times that it has, though it begins in the middle.
    let again = recorded(|index| Frame { time_ns: BEGINNING_NS + index * 100_000_000, ..frame(index) });
    assert_eq!(first_of(&again, "/compare/"), BEGINNING_NS);
    let in_2011 = 1_317_000_000_000_000_000;
    let real = recorded(|index| Frame { time_ns: in_2011 + index, ..frame(index) });
    assert_eq!(first_of(&real, "/compare/"), in_2011 + 3);
}

#[test]
fn pictures_lie_apart_and_are_left_out_where_they_are_not_wanted() {
    let bytes = recorded(frame);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let is_picture = |id: &u16| {
        let channel = &summary.channels[id];
        channel.topic.contains("/view/") && channel.schema.as_ref().unwrap().name == "foxglove.CompressedImage"
    };
    for chunk in &summary.chunk_indexes {
        let pictures = chunk.message_index_offsets.keys().filter(|id| is_picture(id)).count();
        assert!(pictures == 0 || pictures == chunk.message_index_offsets.len());
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = plan_of(&["compare"]);
    plan.record.view = false;
    let recorder = Recorder::create(&path, &plan).unwrap();
    record_frame(&recorder, RunId(0), &frame(0), &values(&frame(0), WIDTH, HEIGHT), false);
    recorder.finish(&[]).unwrap();
    let without = std::fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&without).unwrap().unwrap();
    assert!(summary.channels.values().all(|channel| !channel.topic.contains("/view/")));
    // Readers of values find no more topics than before.
    let recording = Recording::open(&path).unwrap();
    assert!(recording.reader(RunId(0), &["/compare/source/left", "/compare/source/calibration"]).is_ok());
    assert!(recording.reader(RunId(0), &["/compare/source/left/image"]).is_err());
}

#[test]
fn points_of_a_depth_are_where_its_pixels_were_seen() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = plan_of(&["compare"]);
    let fused = || OutputPattern { stage: "*".to_owned(), node: "fused".to_owned(), port: "depth".to_owned() };
    plan.record.points = vec![fused()];
    let recorder = Recorder::create(&path, &plan).unwrap();
    let values = values(&frame(0), WIDTH, HEIGHT);
    record_frame(&recorder, RunId(0), &frame(0), &values, false);
    recorder.finish(&[]).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let mut messages = MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let message = messages.find(|of| of.channel.topic == "/compare/points/fused.depth").unwrap();
    let cloud = PointCloud::decode(&*message.data).unwrap();
    assert_eq!((cloud.frame_id.as_str(), cloud.point_stride), ("compare/left", 16));
    let fields: Vec<(&str, u32)> = cloud.fields.iter().map(|field| (field.name.as_str(), field.offset)).collect();
    let names = ["x", "y", "z", "red", "green", "blue", "alpha"];
    assert_eq!(fields, names.into_iter().zip([0, 4, 8, 12, 13, 14, 15]).collect::<Vec<_>>());
    let value_of = |slot: Slot| values.iter().find(|(other, _)| *other == slot).map(|(_, value)| value).unwrap();
    let (Value::Depth(depth), Value::Calibration(calibration), Value::Image(image)) = (
        value_of(Slot::Node { node: NodeId(3), port: PortId(0) }),
        value_of(Slot::Source { port: PortId(3) }),
        value_of(Slot::Source { port: PortId(0) }),
    ) else {
        panic!("the fixture's values")
    };
    let Pixels::Rgb(rgb) = image.pixels() else { panic!("the fixture's left image") };
    let mut expected = Vec::new();
    for (column, row, metres) in depth.metres.enumerate_pixels() {
        let z = f64::from(metres.0[0]);
        if column % 4 != 0 || row % 4 != 0 || !(z > 0.0 && z <= 100.0) {
            continue;
        }
        let x = (f64::from(column) - calibration.cx_px) * z / calibration.focal_px;
        let y = (f64::from(row) - calibration.cy_px) * z / calibration.focal_px;
        expected.extend([x, y, z].iter().flat_map(|metres| (*metres as f32).to_le_bytes()));
        expected.extend(rgb[(column, row)].0);
        expected.push(255);
    }
    assert!(expected.len() > 16 * 50);
    assert_eq!(cloud.data, expected);
}
