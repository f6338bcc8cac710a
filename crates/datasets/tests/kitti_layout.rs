//! A data set that is written from the synthetic street.
#![expect(clippy::unwrap_used, reason = "a test that cannot continue panics")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use depthloom_datasets::kitti_layout;
use depthloom_graphs::contracts::{Host, InlineHost};
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::values::Pixels;
use depthloom_graphs::{Context, Frame, Scratch, Value};
use depthloom_nodes::sources::SyntheticRoadParams;
use serde_json::{Value as Json, json};

type Values = BTreeMap<&'static str, Value>;

/// The frames of a source, each with its values by port.
fn frames(kind: &str, params: &Json) -> Vec<(Frame, Values)> {
    let registry = depthloom_nodes::registry();
    let kind = registry.source_kind(kind).unwrap();
    let resolved = kind.resolve(params).unwrap();
    let ports = kind.outputs(&resolved).unwrap();
    let source = kind.open(&resolved).unwrap();
    let read = |(position, frame): (usize, &Frame)| {
        let mut scratch = Scratch::default();
        let read = source.read(FrameIndex(position), &mut Context::new(&InlineHost, &mut scratch)).unwrap();
        let values = ports.iter().zip(read.outputs.in_order_of(&ports).unwrap());
        (frame.clone(), values.filter_map(|(port, value)| Some((port.name, value?))).collect())
    };
    source.frames().iter().enumerate().map(read).collect()
}

fn metres(value: &Value) -> &[f32] {
    value.metres().unwrap().as_raw()
}

fn params() -> Json {
    json!({ "frames": [0, 3], "seed": 5, "width": 160, "height": 48 })
}

fn pixels(value: &Value) -> &Pixels {
    let Value::Image(image) = value else { panic!("{} is not an image", value.value_type()) };
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
        assert_eq!(ours.is_nan(), read.is_nan(), "a pixel with ground truth was lost or added");
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
        rendering["ground_truth"] = json!(truth);
        let rendered = frames("synthetic/road", &rendering);
        let written = frames("kitti/stereo2015", &json!({ "root": out, "ground_truth": truth }));
        assert_eq!((rendered.len(), written.len()), (2, 2));
        for ((rendered, ours), (written, read)) in rendered.iter().zip(&written) {
            assert_eq!(written, rendered);
            for port in ["left", "right"] {
                assert!(pixels(&ours[port]) == pixels(&read[port]), "{port} differs");
            }
            let off = disparity_difference_px(ours, read);
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
    let rendered = frames("synthetic/road", &rendering);
    let written = frames("kitti/stereo2015", &json!({ "root": out, "disparities": true }));
    assert_eq!((rendered.len(), written.len()), (2, 2));
    for ((_, ours), (_, read)) in rendered.iter().zip(&written) {
        for port in ["disp_noc", "disp_occ"] {
            let (Value::TrueDisparity(ours), Value::TrueDisparity(read)) = (&ours[port], &read[port]) else { panic!() };
            assert!(ours.px_256().unwrap() == read.px_256().unwrap(), "{port} differs");
        }
        let mask = |values: &Values, port: &str| match &values[port] {
            Value::Mask(mask) => mask.set.as_raw().clone(),
            other => panic!("{port} is {}", other.value_type()),
        };
        assert!(mask(ours, "obj_map") == mask(read, "obj_map"), "cars differ");
        // Of files, what is occluded is known where there is a truth.
        let Value::TrueDisparity(occ) = &ours["disp_occ"] else { panic!() };
        let hidden = mask(ours, "occluded");
        let known = hidden.iter().zip(occ.px.iter()).map(|(&set, &v)| if v > 0.0 { set } else { 0 });
        assert!(mask(read, "occluded") == known.collect::<Vec<u8>>(), "what is occluded differs");
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
fn fault_06_an_unfinished_folder_of_another_program_is_not_removed() {
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
