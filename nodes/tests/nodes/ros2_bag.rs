//! `ros2/bag`: what is read of bags of either storage, which messages are a frame, known points by hand, and what is
//! said of broken ones.

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use depthloom_graphs::Value;
use depthloom_graphs::values::Pixels;
use depthloom_test_needs::workspace;
use mcap::{Compression, WriteOptions};
use proptest::prelude::{ProptestConfig, any, prop, proptest};
use proptest::{collection, prop_assert};
use serde_json::{Value as Json, json};
use tempfile::TempDir;

use crate::bag_writer::{
    Cdr, Info, LEFT, LEFT_INFO, LEFT_P, MS, RIGHT, RIGHT_INFO, RIGHT_P, Raw, SIZE, T0, Written, cloud, frame, frames,
    grey, image, mcap, raw_image, sqlite, transforms,
};
use crate::call::{Opened, Values, metres, open};

/// A folder with a bag.
pub(crate) struct Bench(TempDir);

impl Bench {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes an MCAP file.
    pub(crate) fn mcap(&self, messages: &[Written]) -> PathBuf {
        let path = self.path("bag.mcap");
        mcap(&path, messages, WriteOptions::new());
        path
    }

    /// The message at opening or of the first frame that fails.
    pub(crate) fn report(&self, path: &Path, more: &Json) -> String {
        let opened_or_read = match open("ros2/bag", &params(path, more)) {
            Err(fault) => Ok(fault),
            Ok(opened) => {
                let failed = (0..opened.source.frames().len()).find_map(|at| opened.read(FrameIndex(at)).err());
                failed.ok_or_else(|| {
                    format!("{} frames; {}", opened.source.frames().len(), opened.source.warnings().join("; "))
                })
            }
        };
        let text = match opened_or_read {
            Ok(fault) => match fault.remedy_text() {
                Some(remedy) => format!("{}\n  remedy: {remedy}", fault.chain()),
                None => fault.chain(),
            },
            Err(whole) => whole,
        };
        text.replace(&self.0.path().display().to_string(), "ROOT")
    }
}

pub(crate) fn params(path: &Path, more: &Json) -> Json {
    let mut params = json!({ "path": path });
    params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    params
}

pub(crate) fn opened(path: &Path, more: &Json) -> Opened {
    open("ros2/bag", &params(path, more))
        .unwrap_or_else(|fault| panic!("{} ({:?})", fault.chain(), fault.remedy_text()))
}

/// A small bag in a folder, as parameters.
pub(crate) fn small(root: &Path) -> Json {
    let path = root.join("small.mcap");
    mcap(&path, &with_points(), WriteOptions::new());
    json!({ "path": path, "points": "/lidar/points" })
}

fn ids(opened: &Opened) -> Vec<u64> {
    opened.source.frames().iter().map(|frame| frame.id.parse::<u64>().unwrap() - T0).collect()
}

fn samples(value: &Value) -> &[u8] {
    let Value::Image(image) = value else { panic!() };
    match image.pixels() {
        Pixels::Grey(grey) => grey.as_raw(),
        Pixels::Rgb(rgb) => rgb.as_raw(),
    }
}

/// Of every frame its id, left and right pixels, and key.
fn all(opened: &Opened) -> Vec<(u64, Vec<u8>, Vec<u8>, String)> {
    let read = |at: usize| {
        let (values, key) = opened.read(FrameIndex(at)).unwrap_or_else(|fault| panic!("{}", fault.chain()));
        (ids(opened)[at], samples(&values["left"]).to_vec(), samples(&values["right"]).to_vec(), format!("{key:?}"))
    };
    (0..opened.source.frames().len()).map(read).collect()
}

#[test]
fn every_storage_gives_the_same_frames_and_keys() {
    let bench = Bench::new();
    let messages = frames();
    let options = WriteOptions::new;
    let mut reports = Vec::new();
    for (name, options) in [
        ("zstd", options().compression(Some(Compression::Zstd))),
        ("lz4", options().compression(Some(Compression::Lz4))),
        ("plain", options().compression(None)),
        ("small-chunks", options().compression(Some(Compression::Zstd)).chunk_size(Some(500))),
        ("no-chunks", options().use_chunks(false)),
        ("no-summary", options().emit_summary_records(false).emit_summary_offsets(false)),
        ("no-message-indexes", options().emit_message_indexes(false)),
        ("no-chunk-indexes", options().emit_chunk_indexes(false)),
        ("no-channels-in-summary", options().repeat_channels(false).repeat_schemas(false)),
        ("no-statistics", options().emit_statistics(false)),
    ] {
        let path = bench.path(&format!("{name}.mcap"));
        mcap(&path, &messages, options);
        reports.push((name, opened(&path, &json!({}))));
    }
    sqlite(&bench.path("bag.db3"), &messages);
    reports.push(("sqlite", opened(&bench.path("bag.db3"), &json!({}))));
    // In a folder: two files, the later one first; with metadata and without.
    let folder = bench.path("folder");
    fs::create_dir(&folder).unwrap();
    sqlite(&folder.join("drive_0.db3"), &messages[6..]);
    sqlite(&folder.join("drive_1.db3"), &messages[..6]);
    let bare = opened(&folder, &json!({}));
    assert_eq!(bare.source.warnings(), ["folder has no metadata.yaml: the 2 files that it holds are read"]);
    let metadata = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  relative_file_paths:\n    - drive_0.db3\n    - folder/drive_1.db3\n  compression_mode: \"\"\n";
    fs::write(folder.join("metadata.yaml"), metadata).unwrap();
    reports.push(("folder", opened(&folder, &json!({}))));
    reports.push(("metadata", opened(&folder.join("metadata.yaml"), &json!({ "clock": "log" }))));

    let expected: Vec<_> = (0..3).map(|number| (number * 100 * MS, grey(number), grey(number + 100))).collect();
    let first = all(&bare);
    assert_eq!(
        first.iter().map(|(id, left, right, _)| (*id, left.clone(), right.clone())).collect::<Vec<_>>(),
        expected
    );
    for (name, opened) in reports {
        assert!(all(&opened) == first, "{name}");
        assert_eq!(opened.source.warnings(), [""; 0], "{name}");
        let times: Vec<u64> = opened.source.frames().iter().map(|frame| frame.time_ns - T0).collect();
        assert_eq!(times, [0, 100 * MS, 200 * MS]);
    }
}

#[test]
fn partners_are_found_by_their_headers_whatever_the_order_in_the_file() {
    let bench = Bench::new();
    // Recorded 40 ms later and in reverse; the right camera 3 ms late, 9 ms at the last frame; one image of each lost.
    let mut messages: Vec<Written> = Vec::new();
    for number in 0..6_u64 {
        let stamp = T0 + number * 100 * MS;
        let late = if number == 5 { 9 * MS } else { 3 * MS };
        if number != 1 {
            messages.push(image(LEFT, "camera_left", stamp, number));
        }
        if number != 3 {
            messages.push(image(RIGHT, "camera_right", stamp + late, number + 100));
        }
    }
    messages.reverse();
    for (at, message) in (0..).zip(&mut messages) {
        message.log_ns = T0 + 40 * MS + at * 20 * MS;
    }
    messages.push(Info::with_projection(LEFT_P).on(LEFT_INFO, T0));
    messages.push(Info::with_projection(RIGHT_P).on(RIGHT_INFO, T0));
    let path = bench.mcap(&messages);
    let found = opened(&path, &json!({}));
    assert_eq!(ids(&found), [0, 2, 4, 5].map(|number| number * 100 * MS));
    let reports = "1 of 5 left images and 1 of 5 right ones have no partner within 10 ms: they are left out";
    assert_eq!(found.source.warnings(), [reports]);
    assert_eq!(all(&found)[2].2, grey(104));
    assert_eq!(found.source.frames()[3].index, 3);
    assert_eq!(ids(&opened(&path, &json!({ "tolerance_ms": 5.0 }))), [0, 2, 4].map(|number| number * 100 * MS));
    assert_eq!(ids(&opened(&path, &json!({ "every": 2 }))), [0, 4].map(|number| number * 100 * MS));
    assert_eq!(ids(&opened(&path, &json!({ "frames": [3, 1] }))), [5, 2].map(|number| number * 100 * MS));
    // By the time of recording: it began with the last.
    let late = opened(&path, &json!({ "start_s": 0.1, "end_s": 0.17, "tolerance_ms": 25.0 }));
    assert_eq!(ids(&late).len(), 1);
}

#[test]
fn encodings_orders_and_rows_with_room_at_their_end_are_one_image() {
    let bench = Bench::new();
    let rgb: Vec<u8> = (0..SIZE.0 * SIZE.1 * 3).map(|at| (at * 11 % 251) as u8).collect();
    let pixels = || rgb.chunks_exact(3);
    let step = |row: usize| row as u32 + 8;
    // Rows with 8 bytes more each.
    let with_room = |row: usize, data: &[u8]| {
        data.chunks_exact(row).flat_map(|line| [line, &[99; 8]].concat()).collect::<Vec<u8>>()
    };
    let width = SIZE.0 as usize;
    let bgr: Vec<u8> = pixels().flat_map(|p| [p[2], p[1], p[0]]).collect();
    let bgra: Vec<u8> = pixels().flat_map(|p| [p[2], p[1], p[0], 7]).collect();
    let rgba: Vec<u8> = pixels().flat_map(|p| [p[0], p[1], p[2], 7]).collect();
    for (encoding, row, data) in
        [("rgb8", 3 * width, &rgb), ("bgr8", 3 * width, &bgr), ("bgra8", 4 * width, &bgra), ("rgba8", 4 * width, &rgba)]
    {
        let data = with_room(row, data);
        let raw = Raw { size: SIZE, encoding, step: step(row), data: &data };
        assert_eq!(samples(&with_left(&bench, raw_image(false, T0, "camera_left", &raw))["left"]), rgb, "{encoding}");
    }
    let grey = grey(5);
    for big in [false, true] {
        let deep: Vec<u8> = grey.iter().flat_map(|sample| if big { [*sample, 3] } else { [3, *sample] }).collect();
        let raw = Raw { size: SIZE, encoding: "mono16", step: 2 * SIZE.0, data: &deep };
        assert_eq!(samples(&with_left(&bench, raw_image(big, T0, "camera_left", &raw))["left"]), grey, "{big}");
    }
    // Fault 52: a camera of 12 bits.
    let deep: Vec<u8> = grey.iter().flat_map(|sample| (u16::from(*sample) << 4).to_le_bytes()).collect();
    let raw = Raw { size: SIZE, encoding: "mono16", step: 2 * SIZE.0, data: &deep };
    let mut messages = frame(T0, 0);
    messages[0].bytes = raw_image(false, T0, "camera_left", &raw);
    let bag = bench.mcap(&messages);
    let (usual, of_12) = (opened(&bag, &json!({})), opened(&bag, &json!({ "bits": 12 })));
    assert_eq!(samples(&of_12.read(FrameIndex(0)).unwrap().0["left"]), grey);
    let collapsed: Vec<u8> = grey.iter().map(|sample| sample >> 4).collect();
    assert_eq!(samples(&usual.read(FrameIndex(0)).unwrap().0["left"]), collapsed);
    assert_ne!(usual.source.key(FrameIndex(0)).unwrap(), of_12.source.key(FrameIndex(0)).unwrap());
}

#[test]
fn fault_63_with_a_baseline_the_left_cameras_info_is_enough_for_rectified_images() {
    let bench = Bench::new();
    let mut messages = frames();
    messages.retain(|message| message.topic != RIGHT_INFO);
    let bag = bench.mcap(&messages);
    assert!(bench.report(&bag, &json!({})).contains("has no camera_info beside"));
    let numbers = calibration(&opened(&bag, &json!({ "baseline_m": 0.25 })).read(FrameIndex(0)).unwrap().0);
    assert_eq!((numbers[3], numbers[4]), (0.25, 0.0));
    let raw = bench.report(&bag, &json!({ "baseline_m": 0.25, "rectified": false }));
    assert!(raw.contains("the right camera has no camera_info"), "{raw}");
}

#[test]
fn fault_64_colours_of_16_bits_are_read_and_files_that_were_unpacked() {
    let bench = Bench::new();
    let rgb: Vec<u8> = (0..3 * SIZE.0 * SIZE.1).map(|at| at as u8).collect();
    for (encoding, order) in [("rgb16", [0, 1, 2]), ("bgr16", [2, 1, 0])] {
        let deep: Vec<u8> = rgb
            .as_chunks::<3>()
            .0
            .iter()
            .flat_map(|pixel| order.map(|channel| [7, pixel[channel]]))
            .flatten()
            .collect();
        let raw = Raw { size: SIZE, encoding, step: 6 * SIZE.0, data: &deep };
        assert_eq!(samples(&with_left(&bench, raw_image(false, T0, "camera_left", &raw))["left"]), rgb, "{encoding}");
    }
    let folder = tempfile::tempdir().unwrap();
    mcap(&folder.path().join("bag.mcap"), &frames(), WriteOptions::new());
    let metadata = "rosbag2_bagfile_information:\n  relative_file_paths: [bag.mcap.zstd]\n  compression_mode: FILE\n";
    fs::write(folder.path().join("metadata.yaml"), metadata).unwrap();
    assert!(!opened(folder.path(), &json!({})).source.frames().is_empty());
}

#[test]
fn fault_64_mosaics_and_yuv_become_the_colours_of_opencv() {
    let bench = Bench::new();
    let golden = workspace().join("tests/fixtures/golden/raw-images");
    let orders = ["rggb", "bggr", "gbrg", "grbg"];
    let mosaics = orders.into_iter().flat_map(|order| [8, 16].map(|bits| (format!("bayer_{order}{bits}"), bits / 8)));
    let yuv = [("uyvy", 2), ("yuyv", 2), ("nv21", 1)].map(|(encoding, bytes)| (encoding.to_owned(), bytes));
    for (encoding, bytes) in mosaics.chain(yuv) {
        let data = fs::read(golden.join(format!("{encoding}.bin"))).unwrap();
        let expected = image::open(golden.join(format!("{encoding}.png"))).unwrap().into_rgb8();
        let raw = Raw { size: expected.dimensions(), encoding: &encoding, step: bytes * expected.width(), data: &data };
        let values = with_left(&bench, raw_image(false, T0, "camera_left", &raw));
        assert_eq!(samples(&values["left"]), expected.into_raw(), "{encoding}");
    }
}

#[test]
fn fault_65_git_lfs_pointers_and_damaged_heads_of_bags_are_named() {
    let bench = Bench::new();
    let folder = tempfile::tempdir().unwrap();
    let pointer = folder.path().join("pointer.mcap");
    fs::write(&pointer, "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12\n").unwrap();
    let reports = bench.report(&pointer, &json!({}));
    assert!(reports.contains("is a pointer of Git LFS") && reports.contains("git lfs pull"), "{reports}");
    let mut bytes = fs::read(bench.mcap(&frames())).unwrap();
    bytes[3] ^= 1;
    let damaged = folder.path().join("damaged.mcap");
    fs::write(&damaged, bytes).unwrap();
    let reports = bench.report(&damaged, &json!({}));
    assert!(reports.contains("it does not begin as an MCAP file, and ends as one"), "{reports}");
}

/// The values of a frame whose left image is this message.
fn with_left(bench: &Bench, bytes: Vec<u8>) -> Values {
    let mut messages = frame(T0, 0);
    messages[0].bytes = bytes;
    opened(&bench.mcap(&messages), &json!({})).read(FrameIndex(0)).unwrap_or_else(|fault| panic!("{}", fault.chain())).0
}

/// An image's size of 16-bit numbers: `value` in column 3 of row 2, 0 elsewhere.
fn map(value: u16) -> Vec<u16> {
    (0..SIZE.0 * SIZE.1).map(|at| if at == 2 * SIZE.0 + 3 { value } else { 0 }).collect()
}

fn known(values: &Values) -> (f32, usize) {
    let metres = metres(&values["depth"]);
    (metres[2 * 40 + 3], metres.iter().filter(|metres| metres.is_finite()).count())
}

fn calibration(values: &Values) -> [f64; 5] {
    let Value::Calibration(found) = &values["calibration"] else { panic!() };
    [found.focal_px, found.cx_px, found.cy_px, found.baseline_m, found.doffs_px]
}

#[test]
fn depths_are_in_millimetres_metres_or_the_given_unit() {
    let bench = Bench::new();
    let depth = |message_type: &str, bytes: Vec<u8>, more: Json| {
        let mut messages = frames();
        messages.push(Written::new("/depth", message_type, T0 + MS, bytes));
        let path = bench.mcap(&messages);
        let mut with = json!({ "depth": "/depth" });
        with.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let found = opened(&path, &with);
        let reports = ["2 of 3 frames have no message of /depth within 10 ms, and so no ground truth"];
        assert_eq!(found.source.warnings(), reports);
        assert!(!found.read(FrameIndex(1)).unwrap().0.contains_key("depth"));
        let (values, _) = found.read(FrameIndex(0)).unwrap_or_else(|fault| panic!("{}", fault.chain()));
        // A disparity of 4 px: 2.5 m.
        assert_eq!(calibration(&values), [20.0, 20.0, 15.0, 0.5, 0.0]);
        known(&values)
    };
    let image = "sensor_msgs/msg/Image";
    for big in [false, true] {
        let bytes_of = |bytes: fn(u16) -> [u8; 2]| map(2500).into_iter().flat_map(bytes).collect::<Vec<u8>>();
        let data = bytes_of(if big { u16::to_be_bytes } else { u16::to_le_bytes });
        let raw = Raw { size: SIZE, encoding: "16UC1", step: 80, data: &data };
        let message = raw_image(big, T0 + MS, "camera_left", &raw);
        assert_eq!(depth(image, message.clone(), json!({})), (2.5, 1));
        assert_eq!(depth(image, message, json!({ "depth_unit_m": 0.0001 })), (0.25, 1));
    }
    let float = |value: f32| {
        map(1).into_iter().flat_map(|is| if is == 1 { value } else { f32::NAN }.to_le_bytes()).collect::<Vec<u8>>()
    };
    let raw =
        |data: &[u8]| raw_image(false, T0 + MS, "camera_left", &Raw { size: SIZE, encoding: "32FC1", step: 160, data });
    assert_eq!(depth(image, raw(&float(2.5)), json!({})), (2.5, 1));
    assert_eq!(depth(image, raw(&float(-2.5)), json!({})).1, 0);
    assert_eq!(depth(image, raw(&float(f32::INFINITY)), json!({})).1, 0);
    // As compressed_depth_image_transport: twelve bytes, then a PNG; of floats A / (v - B).
    let png = |value: u16| {
        let map = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(SIZE.0, SIZE.1, map(value)).unwrap();
        let mut bytes = std::io::Cursor::new(Vec::new());
        image::DynamicImage::ImageLuma16(map).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    };
    let compressed = |format: &str, value: u16| {
        let data = [&0_u32.to_le_bytes()[..], &100_f32.to_le_bytes(), &(-8_f32).to_le_bytes(), &png(value)].concat();
        Cdr::new(false).header(T0 + MS, "camera_left").text(format).u32(data.len() as u32).raw(&data).end()
    };
    let message_type = "sensor_msgs/msg/CompressedImage";
    assert_eq!(depth(message_type, compressed("16UC1; compressedDepth png", 2500), json!({})), (2.5, 1));
    // 100 / (32 + 8) = 2.5
    assert_eq!(depth(message_type, compressed("32FC1; compressedDepth png", 32), json!({})), (2.5, 1));
}

/// Three frames, and points of a scanner that looks along x: 1 m behind the camera, 0.3 m to the left of it and 0.5 m
/// above.
pub(crate) fn with_points() -> Vec<Written> {
    let mut messages = frames();
    // x forward, y left, z up becomes z forward, x right, y down: the usual quaternion of optical frames.
    let optical = [-0.5, 0.5, -0.5, 0.5];
    let tree =
        [("base", "lidar", [-1.0, 0.3, 0.5], [0.0, 0.0, 0.0, 1.0]), ("base", "mast", [0.0; 3], [0.0, 0.0, 0.0, 1.0])];
    messages.push(Written::new("/tf_static", "tf2_msgs/msg/TFMessage", T0, transforms(&tree)));
    let camera = [("mast", "camera_left", [0.0; 3], optical)];
    messages.push(Written::new("/tf_static", "tf2_msgs/msg/TFMessage", T0 + 1, transforms(&camera)));
    // (3.5, 1.825, 0.8) of the scanner is (2.5, 2.125, 1.3) of base and (-2.125, -1.3, 2.5) of the camera: column 20 -
    // 17 = 3, row 15 - 10.4 = 4.6.
    let points = [[3.5, 1.825, 0.8], [6.0, 3.95, 2.1], [-3.0, 0.0, 0.0], [f32::NAN, 0.0, 0.0]];
    let bytes = cloud(T0 + 4 * MS, "/lidar", &points, &["x", "y", "z", "intensity"]);
    messages.push(Written::new("/lidar/points", "sensor_msgs/msg/PointCloud2", T0 + 50 * MS, bytes));
    messages
}

#[test]
fn points_go_through_the_transforms_to_the_nearest_pixel() {
    let bench = Bench::new();
    let found = opened(&bench.mcap(&with_points()), &json!({ "points": "/lidar/points" }));
    let (values, key) = found.read(FrameIndex(0)).unwrap();
    let map = metres(&values["depth"]);
    // The second is twice as far on the same ray: the nearest wins. Points behind the camera and NaN are ignored.
    assert_eq!((map[5 * 40 + 3], map.iter().filter(|metres| metres.is_finite()).count()), (2.5, 1));
    assert!(!found.read(FrameIndex(1)).unwrap().0.contains_key("depth"));
    // Other transforms are other depths: another key.
    let mut moved = with_points();
    let at = moved.iter().position(|message| message.topic == "/tf_static").unwrap();
    moved[at].bytes = transforms(&[
        ("base", "lidar", [-1.0, 0.3, 0.6], [0.0, 0.0, 0.0, 1.0]),
        ("base", "mast", [0.0; 3], [0.0, 0.0, 0.0, 1.0]),
    ]);
    let found = opened(&bench.mcap(&moved), &json!({ "points": "/lidar/points" }));
    assert_ne!(found.read(FrameIndex(0)).unwrap().1, key);
}

#[test]
fn r_rotates_points_on_request() {
    let bench = Bench::new();
    // A quarter turn about the optical axis: right becomes down.
    let turned = Info { r: [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0], ..Info::with_projection(LEFT_P) };
    let mut messages = frame(T0, 0);
    messages[2] = turned.on(LEFT_INFO, T0);
    let points = cloud(T0, "camera_left", &[[0.5, 0.0, 2.0]], &["x", "y", "z"]);
    messages.push(Written::new("/points", "sensor_msgs/msg/PointCloud2", T0, points));
    let path = bench.mcap(&messages);
    let at = |more: Json| {
        let found = opened(&path, &more);
        let (values, _) = found.read(FrameIndex(0)).unwrap();
        (metres(&values["depth"]).iter().position(|metres| *metres == 2.0).unwrap(), found.source.warnings().len())
    };
    assert_eq!(at(json!({ "points": "/points" })), (15 * 40 + 25, 1));
    assert_eq!(at(json!({ "points": "/points", "points_rotation": "never" })), (15 * 40 + 25, 0));
    assert_eq!(at(json!({ "points": "/points", "points_rotation": "always" })), (20 * 40 + 20, 0));
}

#[test]
fn roi_binning_and_different_principal_points_are_used() {
    let bench = Bench::new();
    // The 80x60 px from (10, 20) of a sensor of 100x100, two by two: f 40 -> 20, centre (50, 50) -> (20, 15), f * B
    // 20 -> 10.
    let part = |shift: f64| Info {
        size: (100, 100),
        binning: 2,
        part: [10, 20, 80, 60],
        ..Info::with_projection([40.0, 0.0, 50.0, shift, 0.0, 40.0, 50.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    };
    let mut messages = frame(T0, 0);
    messages[2] = part(0.0).on(LEFT_INFO, T0);
    messages[3] = part(-20.0).on(RIGHT_INFO, T0);
    let (values, _) = opened(&bench.mcap(&messages), &json!({})).read(FrameIndex(0)).unwrap();
    assert_eq!(calibration(&values), [20.0, 20.0, 15.0, 0.5, 0.0]);
    // Of cameras whose axes do not look at one point: `cx_right - cx_left`.
    let mut p = RIGHT_P;
    p[2] = 25.5;
    messages[2] = Info::with_projection(LEFT_P).on(LEFT_INFO, T0);
    messages[3] = Info::with_projection(p).on(RIGHT_INFO, T0);
    let (values, _) = opened(&bench.mcap(&messages), &json!({})).read(FrameIndex(0)).unwrap();
    assert_eq!(calibration(&values), [20.0, 20.0, 15.0, 0.5, 5.5]);
    messages[2] = part(0.0).on(LEFT_INFO, T0);
    // Where the driver does not say the baseline.
    messages[3] = part(0.0).on(RIGHT_INFO, T0);
    let (values, _) = opened(&bench.mcap(&messages), &json!({ "baseline_m": 0.25 })).read(FrameIndex(0)).unwrap();
    assert_eq!(calibration(&values), [20.0, 20.0, 15.0, 0.25, 0.0]);
}

#[test]
fn raw_images_are_rectified_and_rectified_ones_are_left_alone() {
    let bench = Bench::new();
    let raw = |topic: &str, d: &'static [f64]| {
        let mut messages = frame(T0, 0);
        for (message, p) in [(2, LEFT_P), (3, RIGHT_P)] {
            messages[message] =
                Info { d, ..Info::with_projection(p) }.on(if message == 2 { LEFT_INFO } else { RIGHT_INFO }, T0);
        }
        for message in &mut messages {
            message.topic = message.topic.replace("image_rect", topic);
        }
        messages
    };
    let left = |messages: &[Written], more: Json| {
        samples(&opened(&bench.mcap(messages), &more).read(FrameIndex(0)).unwrap().0["left"]).to_vec()
    };
    const BENT: &[f64] = &[-0.2, 0.05, 0.0, 0.0, 0.0];
    assert_eq!(left(&raw("image_rect", BENT), json!({})), grey(0));
    assert_eq!(left(&raw("image_raw", &[0.0; 5]), json!({})), grey(0));
    assert_eq!(left(&raw("image_raw", BENT), json!({ "rectified": true })), grey(0));
    let bent = left(&raw("image_raw", BENT), json!({}));
    assert_ne!(bent, grey(0));
    assert_eq!(left(&raw("image_rect", BENT), json!({ "rectified": false })), bent);
    // The lens leaves the centre where it is.
    assert_eq!(bent[15 * 40 + 20], grey(0)[15 * 40 + 20]);
    use depthloom_kernels::rectify::{Camera, Interpolation, Lens, Map, View, remap};
    let lens = Lens::Polynomial([-0.2, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let camera = Camera { focal_px: [20.0; 2], centre_px: [20.0, 15.0], lens };
    let view = View {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        focal_px: [20.0; 2],
        centre_px: [20.0, 15.0],
    };
    let mut expected = vec![0; 40 * 30];
    remap::<1>(&grey(0), (40, 30), &Map::new(&camera, &view, SIZE, Interpolation::Float), &mut expected);
    assert_eq!(bent, expected);
}

#[test]
fn several_workers_read_one_bag() {
    let bench = Bench::new();
    let messages: Vec<Written> = (0..40).flat_map(|number| frame(T0 + number * 100 * MS, number)).collect();
    let path = bench.path("bag.mcap");
    mcap(&path, &messages, WriteOptions::new().chunk_size(Some(8000)));
    sqlite(&bench.path("bag.db3"), &messages);
    for path in [path, bench.path("bag.db3")] {
        let found = opened(&path, &json!({}));
        let one_by_one = all(&found);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| assert!(all(&found) == one_by_one));
            }
        });
    }
}

#[test]
fn a_bag_that_was_cut_off_gives_the_frames_before() {
    let bench = Bench::new();
    let messages: Vec<Written> = (0..20).flat_map(|number| frame(T0 + number * 100 * MS, number)).collect();
    for (name, options) in [
        ("chunks", WriteOptions::new().chunk_size(Some(6000))),
        ("plain", WriteOptions::new().compression(None).chunk_size(Some(6000))),
        ("loose", WriteOptions::new().use_chunks(false)),
    ] {
        let path = bench.path(&format!("{name}.mcap"));
        mcap(&path, &messages, options);
        let whole = fs::read(&path).unwrap();
        let expected = all(&opened(&path, &json!({})));
        let mut before = 20;
        for part in (2..10).rev() {
            fs::write(&path, &whole[..whole.len() * part / 10]).unwrap();
            let Ok(found) = open("ros2/bag", &params(&path, &json!({}))) else { panic!("{name} {part}") };
            let frames = all(&found);
            // The camera info of the last frame may be lost and replaced by an earlier one: its key differs.
            let pixels = |(id, left, right, _): &(u64, Vec<u8>, Vec<u8>, String)| (*id, left.clone(), right.clone());
            assert!(frames.iter().map(pixels).eq(expected[..frames.len()].iter().map(pixels)), "{name} {part}");
            assert!(frames.len() <= before && frames.len() + 8 >= 20 * part / 10, "{name} {part} {}", frames.len());
            let reports = &found.source.warnings()[0];
            // The summary of these few frames is a part of the file.
            let cut = format!("{name}.mcap was cut off: its last whole record ends at");
            assert!(reports.starts_with(&cut) || reports.contains("its index cannot be read"), "{reports}");
            before = frames.len();
        }
    }
}

#[test]
fn a_flipped_bit_of_a_chunk_that_is_not_compressed_is_seen() {
    let bench = Bench::new();
    let messages: Vec<Written> = (0..4).flat_map(|number| frame(T0 + number * 100 * MS, number)).collect();
    let path = bench.path("bag.mcap");
    mcap(&path, &messages, WriteOptions::new().compression(None));
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    fs::write(&path, bytes).unwrap();
    // Opening reads a message of each camera.
    let reports: Vec<String> = match open("ros2/bag", &params(&path, &json!({}))) {
        Err(fault) => vec![fault.chain()],
        Ok(found) => {
            let faults = (0..found.source.frames().len()).filter_map(|position| found.read(FrameIndex(position)).err());
            faults.map(|fault| fault.chain()).collect()
        }
    };
    assert!(reports.iter().any(|fault| fault.contains("a chunk's checksum differs")), "{reports:?}");
}

#[test]
fn opening_by_the_time_of_recording_reads_the_index_and_one_frame() {
    let bench = Bench::new();
    let messages: Vec<Written> = (0..6).flat_map(|number| frame(T0 + number * 100 * MS, number)).collect();
    let path = bench.path("bag.mcap");
    // One chunk per image.
    mcap(&path, &messages, WriteOptions::new().chunk_size(Some(100)));
    let mut bytes = fs::read(&path).unwrap();
    let last = find(&bytes, &[6], 9, 100..2000).expect("the last frame's chunk");
    let length = usize::from(u16::from_le_bytes([bytes[last + 1], bytes[last + 2]]));
    bytes[last + 9 + 44..last + 9 + length].fill(0);
    fs::write(&path, &bytes).unwrap();
    assert!(bench.report(&path, &json!({})).contains("cannot be decompressed"));
    let found = opened(&path, &json!({ "clock": "log" }));
    assert!(found.read(FrameIndex(0)).is_ok() && found.read(FrameIndex(5)).is_err());
    // Of a range, what lies more than a second away is not read; cameras that spoke once, at the beginning, are known.
    let messages: Vec<Written> = (0..40).flat_map(|number| frame(T0 + number * 100 * MS, number)).collect();
    let is_later_info = |message: &Written| message.topic.ends_with("camera_info") && message.log_ns > T0;
    let messages: Vec<Written> = messages.into_iter().filter(|message| !is_later_info(message)).collect();
    mcap(&path, &messages, WriteOptions::new().chunk_size(Some(100)));
    assert!(bench.report(&path, &json!({})).starts_with("40 frames"));
    let mut bytes = fs::read(&path).unwrap();
    let whole = bytes.len();
    let early = find(&bytes[..whole / 6], &[6], 9, 100..2000).expect("an early chunk");
    let length = usize::from(u16::from_le_bytes([bytes[early + 1], bytes[early + 2]]));
    bytes[early + 9 + 44..early + 9 + length].fill(0);
    fs::write(&path, &bytes).unwrap();
    assert!(bench.report(&path, &json!({})).contains("cannot be decompressed"));
    assert_eq!(bench.report(&path, &json!({ "start_s": 3.0 })), "10 frames; ");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(25))]

    #[test]
    fn a_bag_that_may_hold_anything_is_read_or_refused(
        changes in collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), cut in any::<prop::sample::Index>(), is_cut in any::<bool>()
    ) {
        let bench = Bench::new();
        let messages = with_points();
        let plain = || WriteOptions::new().compression(None).calculate_chunk_crcs(false);
        mcap(&bench.path("packed.mcap"), &messages, WriteOptions::new().calculate_chunk_crcs(false));
        mcap(&bench.path("plain.mcap"), &messages, plain());
        mcap(&bench.path("loose.mcap"), &messages, plain().use_chunks(false));
        sqlite(&bench.path("bag.db3"), &messages);
        for name in ["packed.mcap", "plain.mcap", "loose.mcap", "bag.db3"] {
            let path = bench.path(name);
            let mut bytes = fs::read(&path).unwrap();
            for (at, value) in &changes {
                let at = at.index(bytes.len());
                bytes[at] = *value;
            }
            if is_cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            fs::write(&path, &bytes).unwrap();
            for with in [json!({ "points": "/lidar/points" }), json!({ "clock": "log", "depth": "/stereo/right/image_rect" })] {
                let opened_or_read = bench.report(&path, &with);
                prop_assert!(!opened_or_read.is_empty());
            }
        }
    }
}

/// Where a record of that opcode and of such a length begins: searched from the end.
pub(crate) fn find(bytes: &[u8], opcode: &[u8], header: usize, lengths: Range<u64>) -> Option<usize> {
    (0..bytes.len() - header).rev().find(|at| {
        let length = u64::from_le_bytes(bytes[at + 1..at + header].try_into().unwrap());
        bytes[*at..].starts_with(opcode) && lengths.contains(&length) && at + header + length as usize <= bytes.len()
    })
}
