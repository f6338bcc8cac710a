//! `synthetic/road`, and the data set written from it.

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::path::Path;

use depthloom_graphs::Value;
use depthloom_graphs::contracts::{Host, InlineHost};
use depthloom_graphs::values::Pixels;
use depthloom_nodes::kitti_layout;
use depthloom_nodes::sources::SyntheticRoadParams;
use serde_json::{Value as Json, json};

use crate::call::{Values, metres, open};

fn params() -> Json {
    json!({ "frames": [0, 3], "seed": 5, "width": 160, "height": 48 })
}

fn pixels(value: &Value) -> &Pixels {
    let Value::Image(image) = value else { panic!("{} is no image", value.value_type()) };
    image.pixels()
}

fn write(out: &Path, params: &Json) -> Result<u64, depthloom_graphs::Fault> {
    kitti_layout::write(out, &serde_json::from_value::<SyntheticRoadParams>(params.clone()).unwrap(), &InlineHost)
}

fn disparity_difference_px(ours: &Values, read: &Values) -> f64 {
    let Value::Calibration(calibration) = &ours["calibration"] else { panic!("calibration") };
    let disparity = |metres: &f32| calibration.focal_baseline_px_m() / f64::from(*metres);
    let mut worst = 0.0_f64;
    for (ours, read) in metres(&ours["depth"]).iter().zip(metres(&read["depth"])) {
        assert_eq!(ours.is_nan(), read.is_nan(), "a true pixel was lost or made");
        if !ours.is_nan() {
            worst = worst.max((disparity(ours) - disparity(read)).abs());
        }
    }
    worst
}

#[test]
fn a_written_data_set_reads_back_as_it_was_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("road");
    assert_eq!(write(&out, &params()).unwrap(), 2);
    for truth in ["noc", "occ"] {
        let mut rendering = params();
        rendering["truth"] = json!(truth);
        let rendered = open("synthetic/road", &rendering).unwrap();
        let written = open("kitti/stereo2015", &json!({ "root": out, "truth": truth })).unwrap();
        assert_eq!(written.source.frames(), rendered.source.frames());
        for position in 0..2 {
            let ((ours, _), (read, _)) =
                (rendered.read(FrameIndex(position)).unwrap(), written.read(FrameIndex(position)).unwrap());
            for port in ["left", "right"] {
                assert!(pixels(&ours[port]) == pixels(&read[port]), "{port} differs");
            }
            let off = disparity_difference_px(&ours, &read);
            assert!(off <= 0.51 / 256.0, "a true disparity is off by {off} px");
            let (Value::Calibration(ours), Value::Calibration(read)) = (&ours["calibration"], &read["calibration"])
            else {
                panic!("calibration")
            };
            assert_eq!((ours.focal_px, ours.cx_px, ours.cy_px), (read.focal_px, read.cx_px, read.cy_px));
            assert!((ours.baseline_m - read.baseline_m).abs() < 1e-15);
        }
    }
}

#[test]
fn a_written_data_set_gives_the_disparities_and_cars_that_were_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("road");
    write(&out, &params()).unwrap();
    let mut rendering = params();
    rendering["disparities"] = json!(true);
    let rendered = open("synthetic/road", &rendering).unwrap();
    let written = open("kitti/stereo2015", &json!({ "root": out, "disparities": true })).unwrap();
    for position in 0..2 {
        let ((ours, _), (read, _)) =
            (rendered.read(FrameIndex(position)).unwrap(), written.read(FrameIndex(position)).unwrap());
        for port in ["disp_noc", "disp_occ"] {
            let (Value::TrueDisparity(ours), Value::TrueDisparity(read)) = (&ours[port], &read[port]) else { panic!() };
            assert!(ours.px_256().unwrap() == read.px_256().unwrap(), "{port} differs");
        }
        let mask = |values: &Values, port: &str| match &values[port] {
            Value::Mask(mask) => mask.set.as_raw().clone(),
            other => panic!("{port} is {}", other.value_type()),
        };
        assert!(mask(&ours, "obj_map") == mask(&read, "obj_map"), "cars differ");
        // Of files, what is occluded is known where there is a truth.
        let Value::TrueDisparity(occ) = &ours["disp_occ"] else { panic!() };
        let hidden = mask(&ours, "occluded");
        let known = hidden.iter().zip(occ.px.iter()).map(|(&set, &v)| if v > 0.0 { set } else { 0 });
        assert!(mask(&read, "occluded") == known.collect::<Vec<u8>>(), "what is occluded differs");
    }
}

#[test]
fn an_existing_folder_is_not_written_over_and_an_unfinished_one_is() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("road");
    fs::create_dir_all(folder.path().join("road.partial/training/image_2")).unwrap();
    fs::write(folder.path().join("road.partial/training/image_2/000099_10.png"), "half").unwrap();
    let one = json!({ "frames": [1], "width": 64, "height": 32 });
    write(&out, &one).unwrap();
    let written: Vec<_> = fs::read_dir(out.join("training/image_2")).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(written, ["000001_10.png"]);
    assert!(!folder.path().join("road.partial").exists());
    let fault = write(&out, &one).unwrap_err();
    assert!(fault.to_string().ends_with("road exists already"), "{fault}");
}

#[test]
fn fault_06_an_unfinished_folder_of_somebody_else_is_not_removed() {
    let folder = tempfile::tempdir().unwrap();
    let thesis = folder.path().join("road.partial/thesis");
    fs::create_dir_all(thesis.parent().unwrap()).unwrap();
    fs::write(&thesis, "years").unwrap();
    let fault = write(&folder.path().join("road"), &json!({ "frames": [1], "width": 64, "height": 32 })).unwrap_err();
    assert!(fault.to_string().contains("road.partial exists already"), "{fault}");
    assert_eq!(fs::read_to_string(thesis).unwrap(), "years");
}

/// Gives up after the first frame.
struct Impatient(std::sync::atomic::AtomicU64);

impl Host for Impatient {
    fn cancelled(&self) -> bool {
        self.0.load(std::sync::atomic::Ordering::Relaxed) > 0
    }

    fn progress(&self, _: u64, _: u64, _: &str) {
        self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    }

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).for_each(f);
    }

    fn width(&self) -> usize {
        1
    }
}

#[test]
fn a_cancelled_data_set_never_has_its_final_name() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("road");
    let params = serde_json::from_value(json!({ "frames": [1, 2], "width": 64, "height": 32 })).unwrap();
    let fault = kitti_layout::write(&out, &params, &Impatient(0.into())).unwrap_err();
    assert!(matches!(fault, depthloom_graphs::Fault::Cancelled), "{fault}");
    assert!(!out.exists());
}

#[test]
fn a_frame_depends_on_seed_size_and_index_and_on_nothing_else() {
    let key = |params: Json, position| open("synthetic/road", &params).unwrap().read(position).unwrap().1;
    let small = |frames: Json, seed: u64| json!({ "frames": frames, "seed": seed, "width": 64, "height": 32 });
    assert_eq!(key(small(json!("0..4"), 1), FrameIndex(3)), key(small(json!([3]), 1), FrameIndex(0)));
    assert_ne!(key(small(json!([3]), 1), FrameIndex(0)), key(small(json!([3]), 2), FrameIndex(0)));
    assert_ne!(key(small(json!([3]), 1), FrameIndex(0)), key(small(json!([2]), 1), FrameIndex(0)));
    let occ = json!({ "frames": [3], "width": 64, "height": 32, "truth": "occ" });
    assert_ne!(key(small(json!([3]), 1), FrameIndex(0)), key(occ, FrameIndex(0)));
}

#[test]
fn a_street_without_end_wants_to_know_which_frames() {
    for frames in [json!(null), json!("ids.txt"), json!("0..2000000"), json!([1_000_000])] {
        let fault = open("synthetic/road", &json!({ "frames": frames })).err().unwrap().to_string();
        let of_a_street = ["frames: a synthetic street has", "frames: the frames of a synthetic street have numbers"];
        assert!(of_a_street.iter().any(|start| fault.starts_with(start)), "{fault}");
    }
}
