//! `ros2/bag` on bags that were written by software that is not ours (`tests/python/write_bag.py`).

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Pixels};
use depthloom_test_needs::{python, shared, workspace};
use serde_json::{Value as Json, json};

use crate::bag_writer::{LEFT, LEFT_INFO, MS, RIGHT, RIGHT_INFO, T0};
use crate::call::{Values, metres, open, value};

/// Runs the writer.
fn write(python: &Path, spec: &Json, out: &Path) {
    let file = out.with_extension("json");
    fs::write(&file, serde_json::to_vec(spec).unwrap()).unwrap();
    let mut command = Command::new(python);
    let output = command.arg(workspace().join("tests/python/write_bag.py")).arg(&file).arg(out).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Three frames as PNG files in KITTI's layout: real ones where they are there, a rendered street otherwise.
fn pairs(folder: &Path, test: &str) -> (PathBuf, Vec<String>) {
    if let Some(shared) = shared(test) {
        return (
            shared.join("data/kitti_stereo_2015"),
            ["000150_10", "000151_10", "000152_10"].map(str::to_owned).to_vec(),
        );
    }
    let street = open("synthetic/road", &json!({ "frames": "0..3", "width": 320, "height": 96 })).unwrap();
    let mut stems = Vec::new();
    for position in 0..3 {
        let (values, _) = street.read(FrameIndex(position)).unwrap();
        let stem = format!("{position:06}_10");
        for (port, into) in [("left", "image_2"), ("right", "image_3")] {
            let Value::Image(image) = &values[port] else { panic!() };
            let Pixels::Rgb(rgb) = image.pixels() else { panic!() };
            let path = folder.join("training").join(into).join(format!("{stem}.png"));
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            rgb.save(path).unwrap();
        }
        let Calibration { focal_px: f, cx_px: cx, cy_px: cy, baseline_m, .. } = calibration(&values);
        let line = |name: &str, shift: f64| format!("{name}: {f} 0 {cx} {shift} 0 {f} {cy} 0 0 0 1 0\n");
        let path = folder.join(format!("training/calib_cam_to_cam/{position:06}.txt"));
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, line("P_rect_02", 0.0) + &line("P_rect_03", -f * baseline_m)).unwrap();
        stems.push(stem);
    }
    (folder.to_owned(), stems)
}

fn calibration(values: &Values) -> Calibration {
    let Value::Calibration(calibration) = &values["calibration"] else { panic!() };
    (**calibration).clone()
}

fn disparities(values: &Values) -> Vec<i16> {
    let found = value("stereo/sgbm", &json!({}), &[("left", &values["left"]), ("right", &values["right"])]);
    let Value::Disparity(disparity) = found else { panic!() };
    disparity.sixteenths_px.as_raw().clone()
}

#[test]
fn bags_give_the_disparities_of_the_png_files_they_were_made_from() {
    const TEST: &str = "bags_give_the_disparities_of_the_png_files_they_were_made_from";
    let Some(python) = python(TEST) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (root, stems) = pairs(folder.path(), TEST);
    let numbers: Vec<u64> = stems.iter().map(|stem| stem[..6].parse().unwrap()).collect();
    let files = open("kitti/stereo2015", &json!({ "root": root, "ground_truth": "none", "frames": numbers })).unwrap();
    let expected: Vec<(Calibration, Vec<i16>)> = (0..3)
        .map(|at| {
            let (values, _) = files.read(FrameIndex(at)).unwrap();
            (calibration(&values), disparities(&values))
        })
        .collect();
    // Five instants, of which the second lost its right image and the fourth its left one; the clocks of the cameras
    // are some milliseconds apart, and messages are written in an order of their own.
    let messages = |image: &Json| {
        let mut messages = Vec::new();
        for (instant, jitter_ms) in [0_i64, 3, -4, 2, 4].into_iter().enumerate() {
            let stamp = T0 + instant as u64 * 100 * MS;
            let late = stamp.checked_add_signed(jitter_ms * MS as i64).unwrap();
            let stem = &stems[instant / 2];
            let Calibration { width, height, focal_px: f, cx_px: cx, cy_px: cy, baseline_m, .. } =
                expected[instant / 2].0;
            for (topic, side, stamp) in [(LEFT, "image_2", stamp), (RIGHT, "image_3", late)] {
                let is_lost = (instant, topic) == (1, RIGHT) || (instant, topic) == (3, LEFT);
                let file = root.join("training").join(side).join(format!("{stem}.png"));
                let mut message =
                    json!({ "topic": topic, "stamp_ns": stamp, "frame_id": "camera_left", "image": file });
                message.as_object_mut().unwrap().extend(image.as_object().unwrap().clone());
                messages.extend((!is_lost).then_some(message));
            }
            for (topic, shift) in [(LEFT_INFO, 0.0), (RIGHT_INFO, -f * baseline_m)] {
                let p = [f, 0.0, cx, shift, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
                let camera = json!({ "size": [width, height], "p": p });
                messages
                    .push(json!({ "topic": topic, "stamp_ns": stamp, "frame_id": "camera_left", "camera": camera }));
            }
        }
        let count = messages.len();
        let mut mixed: Vec<Json> = (0..count).map(|at| messages[at * 7 % count].clone()).collect();
        assert!(!count.is_multiple_of(7));
        for (at, message) in (0_u64..).zip(&mut mixed) {
            message["log_ns"] = json!(T0 + 70 * MS + at * 11 * MS);
        }
        mixed
    };
    let rosbags = |storage: &str, compression: &str, files: u32, image: Json| json!({ "writer": "rosbags", "storage": storage, "compression": compression, "files": files, "messages": messages(&image) });
    let other = |writer: &str, options: Json, image: Json| json!({ "writer": writer, "options": options, "messages": messages(&image) });
    let specs = [
        ("sqlite3", rosbags("sqlite3", "none", 1, json!({ "encoding": "bgr8" }))),
        ("sqlite3-messages", rosbags("sqlite3", "message", 2, json!({ "compressed": "png" }))),
        ("mcap", rosbags("mcap", "none", 1, json!({ "encoding": "bgra8" }))),
        ("mcap-chunks", rosbags("mcap", "storage", 3, json!({ "encoding": "rgb8" }))),
        ("mcap-messages", rosbags("mcap", "message", 1, json!({ "encoding": "mono8" }))),
        ("lz4.mcap", other("mcap", json!({ "compression": "lz4" }), json!({ "encoding": "mono16" }))),
        ("loose.mcap", other("mcap", json!({ "use_chunking": false }), json!({ "encoding": "rgba8" }))),
        ("foxglove.mcap", other("foxglove", json!({ "chunk_size": 100_000 }), json!({ "encoding": "rgb8" }))),
        ("foxglove-png.mcap", other("foxglove", json!({}), json!({ "compressed": "png" }))),
    ];
    for (name, spec) in specs {
        let path = folder.path().join(name);
        write(&python, &spec, &path);
        let bag =
            open("ros2/bag", &json!({ "path": path })).unwrap_or_else(|fault| panic!("{name}: {}", fault.chain()));
        let ids: Vec<String> = bag.source.frames().iter().map(|frame| frame.id.to_string()).collect();
        assert_eq!(ids, [0, 2, 4].map(|instant| (T0 + instant * 100 * MS).to_string()), "{name}");
        assert_eq!(
            bag.source.warnings(),
            ["1 of 4 left images and 1 of 4 right ones have no partner within 10 ms: they are left out"]
        );
        for (at, (calibrated, expected)) in expected.iter().enumerate() {
            let (values, _) = bag.read(FrameIndex(at)).unwrap_or_else(|fault| panic!("{name}: {}", fault.chain()));
            assert!(disparities(&values) == *expected, "{name}: frame {at} has other disparities");
            let found = calibration(&values);
            assert!((found.baseline_m - calibrated.baseline_m).abs() < 1e-12, "{name}");
            assert_eq!(
                Calibration { baseline_m: 0.0, ..found },
                Calibration { baseline_m: 0.0, ..calibrated.clone() },
                "{name}"
            );
        }
    }
}

#[test]
fn depths_points_and_photographs_of_another_writer_are_read() {
    let Some(python) = python("depths_points_and_photographs_of_another_writer_are_read") else { return };
    let folder = tempfile::tempdir().unwrap();
    let jpeg = folder.path().join("left.jpg");
    image::RgbImage::from_fn(40, 30, |x, y| image::Rgb([x as u8 * 5, y as u8 * 8, 90])).save(&jpeg).unwrap();
    // Focal length 20 px, principal point (20, 15), baseline 0.5 m.
    let camera = |shift: f64| json!({ "size": [40, 30], "p": [20.0, 0.0, 20.0, shift, 0.0, 20.0, 15.0, 0.0, 0.0, 0.0, 1.0, 0.0] });
    let depth = |value: Json| {
        (0..30)
            .map(|y| (0..40).map(|x| if (x, y) == (3, 2) { value.clone() } else { json!(0) }).collect())
            .collect::<Vec<Json>>()
    };
    let message = |topic: &str, frame: &str, more: Json| {
        let mut message = json!({ "topic": topic, "stamp_ns": T0, "log_ns": T0, "frame_id": frame });
        message.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        message
    };
    let transforms = json!([
        { "parent": "base", "child": "lidar", "translation": [-1.0, 0.3, 0.5], "rotation": [0.0, 0.0, 0.0, 1.0] },
        { "parent": "base", "child": "camera", "translation": [0.0, 0.0, 0.0], "rotation": [-0.5, 0.5, -0.5, 0.5] }
    ]);
    let messages = [
        message("/left/image_rect/compressed", "camera", json!({ "image": jpeg, "compressed": "jpg" })),
        message("/right/image_rect/compressed", "camera", json!({ "image": jpeg, "compressed": "jpg" })),
        message("/left/camera_info", "camera", json!({ "camera": camera(0.0) })),
        message("/right/camera_info", "camera", json!({ "camera": camera(-10.0) })),
        message("/millimetres", "camera", json!({ "depth": depth(json!(2500)), "encoding": "16UC1" })),
        message("/metres", "camera", json!({ "depth": depth(json!(2.5)), "encoding": "32FC1" })),
        message("/tf_static", "", json!({ "transforms": transforms })),
        message("/points", "lidar", json!({ "points": [[3.5, 1.825, 0.8], [6.0, 3.95, 2.1]] })),
    ];
    for storage in ["sqlite3", "mcap"] {
        let path = folder.path().join(storage);
        write(
            &python,
            &json!({ "writer": "rosbags", "storage": storage, "compression": "none", "messages": messages }),
            &path,
        );
        // By hand: 20 * -2.125 / 2.5 + 20 = 3, 20 * -1.3 / 2.5 + 15 = 4.6 (see `ros2_bag.rs`).
        for (with, at) in [
            (json!({ "depth": "/millimetres" }), 2 * 40 + 3),
            (json!({ "depth": "/metres" }), 2 * 40 + 3),
            (json!({ "points": "/points" }), 5 * 40 + 3),
        ] {
            let mut params = json!({ "path": path });
            params.as_object_mut().unwrap().extend(with.as_object().unwrap().clone());
            let bag = open("ros2/bag", &params).unwrap_or_else(|fault| panic!("{}", fault.chain()));
            let (values, _) = bag.read(FrameIndex(0)).unwrap_or_else(|fault| panic!("{}", fault.chain()));
            let map = metres(&values["depth"]);
            assert_eq!((map[at], map.iter().filter(|metres| metres.is_finite()).count()), (2.5, 1), "{with}");
            let Value::Image(left) = &values["left"] else { panic!() };
            assert_eq!(*left.encoded().unwrap().bytes, *fs::read(&jpeg).unwrap(), "a photograph keeps its bytes");
        }
    }
}
