//! `images`: pairs of one's own: what belongs together, what rectifies them (against OpenCV), and a point of each truth
//! by hand.

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Pixels};
use depthloom_test_needs::{python, workspace};
use image::{DynamicImage, ImageBuffer, Luma, RgbImage};
use serde_json::{Value as Json, json};
use tempfile::TempDir;

use crate::call::{Opened, Values, metres, open};

/// Pairs in a folder of their own.
struct Folder {
    root: PathBuf,
    _folder: Option<TempDir>,
}

/// A small set in a folder, as parameters.
pub(crate) fn small(root: &Path) -> Json {
    let set = pairs(Folder { root: root.to_owned(), _folder: None });
    set.map("depth/1.png", 2500);
    set.map("depth/2.png", 2500);
    set.params(&json!({ "ground_truth": { "files": "depth/*.png", "unit": "millimetres" } }))
}

impl Folder {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self { root: folder.path().to_owned(), _folder: Some(folder) }
    }

    fn path(&self, file: &str) -> PathBuf {
        let path = self.root.join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        path
    }

    fn text(&self, file: &str, text: &str) {
        fs::write(self.path(file), text).unwrap();
    }

    fn image(&self, file: &str, width: u32) {
        let image = RgbImage::from_fn(width, 30, |x, y| image::Rgb([x as u8, y as u8, 7]));
        DynamicImage::ImageRgb8(image).save(self.path(file)).unwrap();
    }

    /// 16 bits: `value` in column 3 of row 2, 0 elsewhere.
    fn map(&self, file: &str, value: u16) {
        let map = ImageBuffer::from_fn(40, 30, |x, y| Luma([if (x, y) == (3, 2) { value } else { 0 }]));
        DynamicImage::ImageLuma16(map).save(self.path(file)).unwrap();
    }

    /// The two patterns and a focal length of 20 px, a baseline of half a metre: `f * B` is 10 px m; or what is given
    /// in their place.
    fn params(&self, more: &Json) -> Json {
        let mut params = json!({
            "root": self.root,
            "left": "cam0/*.png",
            "right": "cam1/*.png",
            "calibration": { "focal_px": 20, "baseline_m": 0.5 },
        });
        params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        params.as_object_mut().unwrap().retain(|_, value| !value.is_null());
        params
    }

    fn open(&self, more: &Json) -> Opened {
        open("images", &self.params(more)).unwrap_or_else(|fault| panic!("{}", fault.chain()))
    }

    /// The message at opening or at the first frame, with the temporary folder called ROOT.
    fn report(&self, more: &Json) -> String {
        let fault = match open("images", &self.params(more)) {
            Err(fault) => fault,
            Ok(source) => source.read(FrameIndex(0)).map(|_| ()).expect_err("it is refused"),
        };
        let remedy = fault.remedy_text().map_or_else(String::new, |text| format!("\n  remedy: {text}"));
        format!("{}{remedy}", fault.chain()).replace(&self.root.display().to_string(), "ROOT")
    }
}

/// Frames 1, 2 and 10 of 40x30.
fn pairs(set: Folder) -> Folder {
    for name in ["1", "2", "10"] {
        set.image(&format!("cam0/{name}.png"), 40);
        set.image(&format!("cam1/{name}.png"), 40);
    }
    set
}

fn ids(source: &Opened) -> Vec<String> {
    source.source.frames().iter().map(|frame| format!("{} {}", frame.index, frame.id)).collect()
}

fn calibration(values: &Values) -> &Calibration {
    let Value::Calibration(calibration) = &values["calibration"] else { panic!() };
    calibration
}

fn rgb(values: &Values, port: &str) -> RgbImage {
    let Value::Image(image) = &values[port] else { panic!() };
    let Pixels::Rgb(rgb) = image.pixels() else { panic!() };
    rgb.clone()
}

#[test]
fn images_of_a_single_camera_need_no_right_image_and_no_baseline() {
    let read = |source: &Opened, at: usize| source.read(FrameIndex(at)).unwrap().0;
    let set = pairs(Folder::new());
    set.map("depth/1.png", 2500);
    set.map("depth/2.png", 1500);
    let single = json!({
        "right": null,
        "calibration": { "focal_px": 20 },
        "ground_truth": { "files": "depth/*.png", "unit": "millimetres" },
    });
    let source = set.open(&single);
    assert_eq!(ids(&source), ["0 1", "1 2", "2 10"]);
    let values = read(&source, 0);
    let mut ports: Vec<&str> = values.keys().map(|port| &**port).collect();
    ports.sort_unstable();
    assert_eq!(ports, ["calibration", "depth", "left"]);
    let calibration = calibration(&values);
    assert_eq!((calibration.focal_px, calibration.baseline_m, calibration.cx_px), (20.0, 0.0, 19.5));
    assert!(calibration.is_single_camera());
    assert_eq!(metres(&values["depth"])[2 * 40 + 3], 2.5);
    // The third image has no ground truth.
    assert!(!read(&source, 2).contains_key("depth"));

    // A disparity has a depth if a baseline is known: 10 px m.
    let disparities = |baseline: Json| {
        let of_disparity = json!({
            "right": null,
            "calibration": { "focal_px": 20, "baseline_m": baseline },
            "ground_truth": { "files": "depth/*.png", "unit": "pixels", "divide_by": 256 },
        });
        read(&set.open(&of_disparity), 0)
    };
    assert_eq!(metres(&disparities(json!(0.5))["depth"])[2 * 40 + 3], 10.0 / (2500.0 / 256.0));
    let without = disparities(Json::Null);
    assert!(without.contains_key("disparity") && !without.contains_key("depth"));

    set.text("list.csv", "left,ground_truth,frame\ncam0/2.png,depth/2.png,b\ncam0/1.png,,a\n");
    let listed = set.open(&json!({
        "left": null, "right": null, "list": "list.csv", "calibration": null,
        "ground_truth": { "unit": "millimetres" },
    }));
    assert_eq!(ids(&listed), ["0 b", "1 a"]);
    assert_eq!(metres(&read(&listed, 0)["depth"])[2 * 40 + 3], 1.5);
    assert!(!read(&listed, 1).contains_key("right"));
}

#[test]
fn fault_52_images_of_12_bits_are_read_with_their_bits_which_decide_the_frames_key() {
    let set = Folder::new();
    let deep = ImageBuffer::from_fn(40, 30, |x, _| Luma([x as u16 * 100]));
    for camera in ["cam0", "cam1"] {
        DynamicImage::ImageLuma16(deep.clone()).save(set.path(&format!("{camera}/1.png"))).unwrap();
    }
    let levels = |bits: Json| {
        let source = set.open(&json!({ "bits": bits }));
        let values = source.read(FrameIndex(0)).unwrap().0;
        let Value::Image(image) = &values["left"] else { panic!() };
        let Pixels::Grey(grey) = image.pixels() else { panic!() };
        (grey.iter().collect::<std::collections::BTreeSet<_>>().len(), source.source.key(FrameIndex(0)).unwrap())
    };
    let (usual, of_12) = (levels(Json::Null), levels(json!(12)));
    assert_eq!((usual.0, of_12.0), (16, 40));
    assert_ne!(usual.1, of_12.1);
}

#[test]
fn fault_60_a_broken_calibration_that_all_frames_share_is_found_at_the_opening() {
    let set = pairs(Folder::new());
    set.text("stereo.yml", "%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 20, 0, 20, 0, 20, 15, 0, 0, 1 ]\nM2: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 20, 0, 20, 0, 20, 15, 0, 0, 1 ]\n");
    let params = set.params(&json!({ "calibration": { "files": ["stereo.yml"] } }));
    let fault = open("images", &params).map(drop).expect_err("it has no pose");
    assert!(fault.chain().contains("stereo.yml"), "{}", fault.chain());
}

#[test]
fn frames_come_in_the_order_of_their_numbers_with_a_calibration_in_numbers() {
    let set = pairs(Folder::new());
    let source = set.open(&json!({}));
    assert_eq!(ids(&source), ["0 1", "1 2", "2 10"]);
    let (values, _) = source.read(FrameIndex(2)).unwrap();
    let expected =
        Calibration { width: 40, height: 30, focal_px: 20.0, cx_px: 19.5, cy_px: 14.5, baseline_m: 0.5, doffs_px: 0.0 };
    assert_eq!(calibration(&values), &expected);
    let Value::Image(left) = &values["left"] else { panic!() };
    assert!(left.encoded().is_some(), "what is not rectified keeps its file's bytes");
    let source = set.open(&json!({ "frames": [2, 0] }));
    assert_eq!(ids(&source), ["2 10", "0 1"]);
}

#[test]
fn without_a_calibration_there_is_no_such_output() {
    let set = pairs(Folder::new());
    let registry = depthloom_nodes::registry();
    let kind = registry.source_kind("images").unwrap();
    let ports = |more: Json| -> Vec<&str> {
        let resolved = kind.resolve(&set.params(&more)).unwrap();
        kind.outputs(&resolved).unwrap().iter().map(|port| port.name).collect()
    };
    assert_eq!(ports(json!({ "calibration": null })), ["left", "right"]);
    assert_eq!(ports(json!({})), ["left", "right", "calibration"]);
    assert_eq!(ports(json!({ "ground_truth": { "files": "x" } })), ["left", "right", "calibration", "depth"]);
    let pixels = json!({ "files": "x", "unit": "pixels" });
    assert_eq!(ports(json!({ "ground_truth": pixels })), ["left", "right", "calibration", "depth", "disparity"]);
    assert_eq!(ports(json!({ "ground_truth": pixels, "calibration": null })), ["left", "right", "disparity"]);
    let (values, _) = set.open(&json!({ "calibration": null })).read(FrameIndex(0)).unwrap();
    assert_eq!(values.keys().copied().collect::<Vec<_>>(), ["left", "right"]);
}

#[test]
fn ground_truth_in_every_unit_has_the_known_point() {
    let set = pairs(Folder::new());
    let known = |truth: Json| {
        let (values, _) = set.open(&json!({ "ground_truth": truth, "frames": [1] })).read(FrameIndex(0)).unwrap();
        let metres = metres(&values["depth"]);
        (metres[2 * 40 + 3], metres.iter().filter(|metres| metres.is_finite()).count())
    };
    // 2.5 m, which is a disparity of 4 px where f * B is 10 px m.
    for (file, value) in [("mm", 2500), ("kitti_depth", 640), ("kitti_disparity", 1024), ("tum", 12500)] {
        for frame in ["1", "2", "10"] {
            set.map(&format!("{file}/{frame}.png"), value);
        }
    }
    assert_eq!(known(json!({ "files": "mm/*.png", "unit": "millimetres" })), (2.5, 1));
    assert_eq!(known(json!({ "files": "kitti_depth/*.png", "divide_by": 256 })), (2.5, 1));
    assert_eq!(known(json!({ "files": "kitti_disparity/*.png", "unit": "pixels", "divide_by": 256 })), (2.5, 1));
    assert_eq!(known(json!({ "files": "tum/*.png", "divide_by": 5000 })), (2.5, 1));
    // What is infinitely far has a disparity of 2 px here: 4 px are 5 m. The disparity itself is given as it is.
    let apart = json!({
        "calibration": { "focal_px": 20, "baseline_m": 0.5, "doffs_px": -2 },
        "ground_truth": { "files": "kitti_disparity/*.png", "unit": "pixels", "divide_by": 256 },
    });
    let (values, _) = set.open(&apart).read(FrameIndex(0)).unwrap();
    let Value::TrueDisparity(truth) = &values["disparity"] else { panic!() };
    assert_eq!((metres(&values["depth"])[83], truth.px.as_raw()[83], truth.px.as_raw()[84].is_nan()), (5.0, 4.0, true));
    // 8 bits, a disparity times 4; and floats, of which infinite, negative and none are unknown.
    let quarter = image::GrayImage::from_fn(40, 30, |x, y| Luma([if (x, y) == (3, 2) { 16 } else { 0 }]));
    quarter.save(set.path("quarter/2.png")).unwrap();
    assert_eq!(known(json!({ "files": "quarter/*.png", "unit": "pixels", "divide_by": 4 })), (2.5, 1));
    let floats: Vec<f32> = (0..1200)
        .map(|at| match at {
            83 => 2.5,
            84 => f32::NAN,
            85 => f32::INFINITY,
            86 => -2.5,
            _ => 0.0,
        })
        .collect();
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut tiff = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap();
    tiff.write_image::<tiff::encoder::colortype::Gray32Float>(40, 30, &floats).unwrap();
    fs::write(set.path("floats/2.tiff"), bytes.into_inner()).unwrap();
    assert_eq!(known(json!({ "files": "floats/*.tiff" })), (2.5, 1));
    let mut pfm = b"Pf\n40 30\n-1.0\n".to_vec();
    pfm.extend(floats.chunks(40).rev().flatten().flat_map(|number| number.to_le_bytes()));
    fs::write(set.path("pfm/2.pfm"), pfm).unwrap();
    assert_eq!(known(json!({ "files": "pfm/*.pfm" })), (2.5, 1));
    let mut npy = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    npy.extend(format!("{:<117}\n", "{'descr': '<f4', 'fortran_order': False, 'shape': (30, 40), }").bytes());
    npy.extend(floats.iter().flat_map(|number| number.to_le_bytes()));
    fs::write(set.path("npy/2.npy"), npy).unwrap();
    assert_eq!(known(json!({ "files": "npy/*.npy" })), (2.5, 1));
    // Frames without ground truth have no output for it.
    let source = set.open(&json!({ "ground_truth": { "files": "quarter/*.png", "unit": "pixels" } }));
    assert_eq!(source.source.warnings().len(), 1, "{:?}", source.source.warnings());
    assert!(!source.read(FrameIndex(0)).unwrap().0.contains_key("depth"));
}

#[test]
fn a_list_names_pairs_ground_truth_and_frames() {
    let set = pairs(Folder::new());
    set.map("depth.png", 1000);
    set.text("pairs.csv", "\u{feff}Left, right,ground_truth,frame\r\ncam0/2.png,cam1/1.png,depth.png,second\r\n\r\n\"cam0/1.png\",cam1/2.png,,\r\n");
    let listed = json!({ "left": null, "right": null, "list": "pairs.csv", "ground_truth": { "unit": "millimetres" } });
    let source = set.open(&listed);
    assert_eq!(ids(&source), ["0 second", "1 cam0/1"]);
    assert_eq!(metres(&source.read(FrameIndex(0)).unwrap().0["depth"])[83], 1.0);
    assert!(!source.read(FrameIndex(1)).unwrap().0.contains_key("depth"));
}

#[test]
fn pairing_by_order_is_reported() {
    let set = Folder::new();
    for (left, right) in [("a", "x"), ("b", "y")] {
        set.image(&format!("cam0/{left}.png"), 40);
        set.image(&format!("cam1/{right}.png"), 40);
    }
    let source = set.open(&json!({}));
    assert_eq!(ids(&source), ["0 a", "1 b"]);
    let warnings = source.source.warnings();
    assert!(warnings[0].starts_with("left and right files have no name in common and are paired in their order"));
}

fn golden(file: &str) -> PathBuf {
    workspace().join("tests/fixtures/golden/rectify").join(file)
}

/// The pair that OpenCV rectified, with files of its calibration.
fn unrectified(files: &[&str]) -> Folder {
    let set = Folder::new();
    for (from, to) in [("left.png", "cam0/1.png"), ("right.png", "cam1/1.png")] {
        fs::copy(golden(from), set.path(to)).unwrap();
    }
    for file in files {
        fs::copy(golden(file), set.path(file)).unwrap();
    }
    set
}

/// One of OpenCV's cases.
fn case(name: &str) -> Json {
    let cases: Json = serde_json::from_slice(&fs::read(golden("cases.json")).unwrap()).unwrap();
    cases[name].clone()
}

/// That a source gives what OpenCV made of a case.
fn is_opencvs(source: &Opened, name: &str, sampling: &str, metres_per_unit: f64) {
    let (values, _) = source.read(FrameIndex(0)).unwrap();
    for port in ["left", "right"] {
        let file = format!("{name}.{port}.{sampling}.png");
        let (ours, theirs) = (rgb(&values, port), image::open(golden(&file)).unwrap().into_rgb8());
        let worst = ours.iter().zip(theirs.iter()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(worst <= Some(1), "{file} differs by {worst:?}");
    }
    let (ours, p) = (calibration(&values), case(name)["p2"].clone());
    let entry = |row: usize, column: usize| p[row][column].as_f64().unwrap();
    let expected = [entry(0, 0), entry(0, 2), entry(1, 2), -entry(0, 3) / entry(0, 0) * metres_per_unit];
    for (ours, theirs) in [ours.focal_px, ours.cx_px, ours.cy_px, ours.baseline_m].iter().zip(expected) {
        assert!((ours - theirs).abs() < 1e-4, "{name}: {ours} {theirs}");
    }
}

#[test]
fn pairs_are_rectified_as_opencv_does_it_whatever_syntax_its_files_have() {
    for files in [vec!["intrinsics.yml", "extrinsics.yml"], vec!["stereo.xml"], vec!["stereo.json"]] {
        let set = unrectified(&files);
        for sampling in ["float", "fixed"] {
            let source = set.open(&json!({ "calibration": { "files": files, "sampling": sampling } }));
            is_opencvs(&source, "plumb_bob_0", sampling, 1.0);
        }
        // From R and T alone, and in other units.
        let more = json!({ "calibration": { "files": files, "alpha": 0, "metres_per_unit": 0.5 } });
        is_opencvs(&set.open(&more), "plumb_bob_0", "float", 0.5);
    }
}

/// A list of numbers, flattened.
fn flat(value: &Json) -> Vec<f64> {
    match value {
        Json::Array(items) => items.iter().flat_map(flat).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

/// `camera_info` YAML of a camera of a case, as `camera_calibration_parsers` writes it.
fn camera_info(case: &Json, side: usize, model: &str) -> String {
    let matrix = |name: &str, rows: usize, columns: usize, numbers: &Json| {
        format!("{name}:\n  rows: {rows}\n  cols: {columns}\n  data: {:?}\n", flat(numbers))
    };
    let (r, p) = ([&case["r1"], &case["r2"]][side], [&case["p1"], &case["p2"]][side]);
    let d = &case["d"][side];
    format!(
        "image_width: 112\nimage_height: 84\ncamera_name: stereo\n{}distortion_model: {model}\n{}{}{}",
        matrix("camera_matrix", 3, 3, &case["k"][side]),
        matrix("distortion_coefficients", 1, flat(d).len(), d),
        matrix("rectification_matrix", 3, 3, r),
        matrix("projection_matrix", 3, 4, p),
    )
}

#[test]
fn camera_info_files_and_a_camchain_rectify_as_opencv() {
    for (name, model) in [("plumb_bob_0", "plumb_bob"), ("rational", "rational_polynomial"), ("fisheye", "equidistant")]
    {
        let set = unrectified(&[]);
        for (side, file) in ["left.yaml", "right.yaml"].into_iter().enumerate() {
            set.text(file, &camera_info(&case(name), side, model));
        }
        let source = set.open(&json!({ "calibration": { "files": ["left.yaml", "right.yaml"] } }));
        is_opencvs(&source, name, "float", 1.0);
        // The other way round the right camera stands left of the left one.
        let reports = set.report(&json!({ "calibration": { "files": ["right.yaml", "left.yaml"] } }));
        assert!(reports.contains("left and right are exchanged"), "{reports}");
    }
    camchain("turned_only", "radtan", 0.01);
    camchain("fisheye", "equidistant", 1.0);
}

/// A case as Kalibr's camchain, lengths times `metres`.
fn camchain(name: &str, model: &str, metres: f64) {
    let calibration = case(name);
    let (r, t) = (flat(&calibration["r"]), flat(&calibration["t"]));
    let rows: Vec<[f64; 4]> = (0..3).map(|row| [r[3 * row], r[3 * row + 1], r[3 * row + 2], t[row] * metres]).collect();
    let intrinsics = |side: usize| {
        let k = flat(&calibration["k"][side]);
        [k[0], k[4], k[2], k[5]]
    };
    let set = unrectified(&[]);
    let camera = |side: usize| {
        let lens: Vec<f64> = flat(&calibration["d"][side]).into_iter().take(4).collect();
        format!(
            "  camera_model: pinhole\n  distortion_coeffs: {lens:?}\n  distortion_model: {model}\n  intrinsics: {:?}\n  resolution: [112, 84]\n  rostopic: /cam{side}/image_raw\n",
            intrinsics(side)
        )
    };
    let pose =
        format!("  T_cn_cnm1:\n  - {:?}\n  - {:?}\n  - {:?}\n  - [0.0, 0.0, 0.0, 1.0]\n", rows[0], rows[1], rows[2]);
    set.text("camchain.yaml", &format!("cam0:\n{}cam1:\n{pose}{}", camera(0), camera(1)));
    is_opencvs(&set.open(&json!({ "calibration": { "files": ["camchain.yaml"] } })), name, "float", metres);
}

#[test]
fn rectified_images_are_unchanged() {
    let set = unrectified(&["intrinsics.yml", "extrinsics.yml"]);
    let files = json!({ "files": ["intrinsics.yml", "extrinsics.yml"], "rectified": true });
    let (values, _) = set.open(&json!({ "calibration": files })).read(FrameIndex(0)).unwrap();
    assert_eq!(rgb(&values, "left"), image::open(golden("left.png")).unwrap().into_rgb8());
    let focal = case("plumb_bob_0")["p1"][0][0].as_f64().unwrap();
    assert!((calibration(&values).focal_px - focal).abs() < 1e-9);
}

#[test]
fn frames_of_any_size_and_camera_are_rectified_as_this_machines_opencv_does_it() {
    const TEST: &str = "frames_of_any_size_and_camera_are_rectified_as_this_machines_opencv_does_it";
    let Some(python) = python(TEST) else { return };
    let set = Folder::new();
    let script = workspace().join("tests/python/rectify_pairs.py");
    let made = Command::new(python).arg(script).arg(&set.root).arg("12").output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let mut seen = 0;
    for case in 0..12 {
        let path = |file: &str| format!("{case}/{file}");
        let files = json!({ "files": [path("intrinsics.yml"), path("extrinsics.yml")], "metres_per_unit": 1 });
        let source = set.open(&json!({ "left": path("left.png"), "right": path("right.png"), "calibration": files }));
        let (values, _) = source.read(FrameIndex(0)).unwrap();
        for port in ["left", "right"] {
            let theirs = image::open(set.path(&path(&format!("{port}.rectified.png")))).unwrap().into_rgb8();
            let ours = rgb(&values, port);
            let apart = ours.iter().zip(theirs.iter()).map(|(a, b)| a.abs_diff(*b));
            let (count, worst) = apart.fold((0, 0), |(count, worst), d| (count + usize::from(d > 0), worst.max(d)));
            assert!(worst <= 1, "{case} {port}: {worst}");
            // Where `stereoRectify` is ours too, its numbers differ in the seventh digit: OpenCV's points are 32-bit
            // floats.
            let most = 2 + ours.len() / if case % 2 == 0 { 50_000 } else { 2_000 };
            assert!(count <= most, "{case} {port}: {count} of {} samples", ours.len());
            seen += ours.len();
        }
    }
    assert!(seen > 1_000_000);
}

#[test]
fn broken_data_are_named_with_a_remedy() {
    let mut reports = String::new();
    let mut add = |what: &str, set: &Folder, more: Json| {
        reports.push_str(&format!("{what}:\n{}\n\n", set.report(&more)));
    };
    let remove = |set: &Folder, file: &str| fs::remove_file(set.path(file)).unwrap();

    add("a pattern that names nothing", &pairs(Folder::new()), json!({ "right": "cam2/*.png" }));
    add("both patterns name one file", &pairs(Folder::new()), json!({ "right": "cam?/*.png" }));
    let set = pairs(Folder::new());
    remove(&set, "cam1/2.png");
    add("a right image is missing", &set, json!({}));
    let set = Folder::new();
    for name in ["cam0/a.png", "cam0/b.png", "cam1/x.png"] {
        set.image(name, 40);
    }
    add("names without anything in common, of two counts", &set, json!({}));
    let set = Folder::new();
    for (left, right) in [(1000, 2003), (2000, 3001), (3000, 3998)] {
        set.image(&format!("cam0/{left}.png"), 40);
        set.image(&format!("cam1/{right}.png"), 40);
    }
    add("times that a missing file has shifted", &set, json!({}));
    let set = pairs(Folder::new());
    set.image("cam1/1.png", 44);
    add("sizes that differ inside a pair", &set, json!({}));
    let set = pairs(Folder::new());
    let bytes = fs::read(set.path("cam1/1.png")).unwrap();
    fs::write(set.path("cam1/1.png"), &bytes[..bytes.len() / 2]).unwrap();
    add("an image cut off", &set, json!({}));

    let list = |text: &str| {
        let set = pairs(Folder::new());
        set.text("pairs.csv", text);
        set
    };
    let listed = json!({ "left": null, "right": null, "list": "pairs.csv" });
    for (what, text) in [
        ("a list with another column", "left,right,time\ncam0/1.png,cam1/1.png,5\n"),
        ("a list without its columns", "left;right\ncam0/1.png;cam1/1.png\n"),
        (
            "a list whose files are missing",
            "left,right\ncam0/1.png,cam1/1.png\ncam0/2.png,cam1/3.png\ncam0/7.png,cam1/2.png\n",
        ),
        ("a list that names a frame twice", "left,right,frame\ncam0/1.png,cam1/1.png,a\ncam0/2.png,cam1/2.png,a\n"),
        ("a list with a field too many", "left,right\ncam0/1.png,cam1/1.png,3\n"),
    ] {
        add(what, &list(text), listed.clone());
    }

    let files = json!({ "calibration": { "files": ["intrinsics.yml", "extrinsics.yml"] } });
    let calibrated = |from: &str, to: &str| {
        let set = unrectified(&["intrinsics.yml", "extrinsics.yml"]);
        for file in ["intrinsics.yml", "extrinsics.yml"] {
            let text = fs::read_to_string(set.path(file)).unwrap();
            set.text(file, &text.replace(from, to));
        }
        set
    };
    add("a calibration file that is not there", &unrectified(&["intrinsics.yml"]), files.clone());
    add(
        "a calibration that is cut off",
        &calibrated("   dt: d\n   data: [ -0.31", "   dt: d\n   data: [ -0.31 "),
        json!({ "calibration": { "files": ["cam0/1.png"] } }),
    );
    let set = unrectified(&["intrinsics.yml", "extrinsics.yml"]);
    let whole = fs::read_to_string(set.path("extrinsics.yml")).unwrap();
    set.text("extrinsics.yml", &whole[..whole.len() / 2]);
    add("a calibration that is cut off", &set, files.clone());
    add("a camera matrix of 8 numbers", &calibrated("91.5, 0., 54.25, 0.", "91.5, 0., 54.25"), files.clone());
    add("a camera matrix that is missing", &calibrated("M2:", "M3:"), files.clone());
    add("a text instead of a number", &calibrated("91.5", "about90"), files.clone());
    add("twelve coefficients", &calibrated("0.12, ", "0.12, 0., 0., 0., 0., 0., 0., 0.001, "), files.clone());
    let apart = set_of_translation(-60.0);
    add(
        "a translation in millimetres",
        &apart,
        json!({ "calibration": { "files": ["intrinsics.yml", "extrinsics.yml"], "alpha": 0 } }),
    );
    let exchanged = set_of_translation(0.12);
    add(
        "cameras exchanged",
        &exchanged,
        json!({ "calibration": { "files": ["intrinsics.yml", "extrinsics.yml"], "alpha": 0 } }),
    );
    add(
        "no pose and no projections",
        &unrectified(&["intrinsics.yml"]),
        json!({ "calibration": { "files": ["intrinsics.yml"] } }),
    );
    let set = unrectified(&[]);
    for (side, file) in ["left.yaml", "right.yaml"].into_iter().enumerate() {
        set.text(file, &camera_info(&case("fisheye"), side, "omnidirectional"));
    }
    let both = json!({ "calibration": { "files": ["left.yaml", "right.yaml"] } });
    add("a lens that is not known", &set, both.clone());
    for (side, file) in ["left.yaml", "right.yaml"].into_iter().enumerate() {
        let info = camera_info(&case("plumb_bob_0"), side, "plumb_bob");
        set.text(file, &info.replace("image_width: 112", "image_width: 640"));
    }
    add("a calibration of another size", &set, both);
    let whole = fs::read_to_string(set.path("right.yaml")).unwrap();
    for (end, what) in [("projection_matrix", "behind half"), ("camera_matrix", "behind its head")] {
        set.text("right.yaml", &whole[..whole.find(end).unwrap()]);
        let both = json!({ "calibration": { "files": ["left.yaml", "right.yaml"] } });
        add(&format!("the second of two camera_info files cut off {what}"), &set, both);
    }
    set.text("right.yaml", &whole);
    add("one camera_info file", &set, json!({ "calibration": { "files": ["left.yaml"] } }));
    set.map("truth/1.png", 2500);
    let more =
        json!({ "calibration": { "files": ["left.yaml", "right.yaml"] }, "ground_truth": { "files": "truth/*.png" } });
    for (side, file) in ["left.yaml", "right.yaml"].into_iter().enumerate() {
        set.text(file, &camera_info(&case("plumb_bob_0"), side, "plumb_bob"));
    }
    add("a truth of what is not rectified yet", &set, more);

    let set = pairs(Folder::new());
    set.image("truth/1.png", 40);
    add("a truth that is a picture", &set, json!({ "ground_truth": { "files": "truth/*.png" }, "frames": [0] }));
    image::GrayImage::new(40, 30).save(set.path("eight/1.png")).unwrap();
    let eight = json!({ "ground_truth": { "files": "eight/*.png", "unit": "millimetres" }, "frames": [0] });
    add("a truth of 8 bits where 16 are expected", &set, eight);
    set.map("small/1.png", 1);
    set.image("cam0/1.png", 44);
    set.image("cam1/1.png", 44);
    add("a truth of another size", &set, json!({ "ground_truth": { "files": "small/*.png" }, "frames": [0] }));
    for (what, more) in [
        ("no images named", json!({ "left": null, "right": null })),
        ("a calibration twice", json!({ "calibration": { "focal_px": 20, "baseline_m": 0.5, "files": ["x"] } })),
        ("half of a calibration", json!({ "calibration": { "focal_px": 20 } })),
        ("right images alone", json!({ "left": null })),
        ("files that calibrate a pair", json!({ "right": null, "calibration": { "files": ["left.yaml"] } })),
    ] {
        add(what, &set, more);
    }
    insta::assert_snapshot!(reports);
}

/// A pair whose cameras stand apart by so much.
fn set_of_translation(x: f64) -> Folder {
    let set = unrectified(&["intrinsics.yml"]);
    let eye = "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]";
    let t = format!("!!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ {x:?}, 0., 0. ]");
    set.text("extrinsics.yml", &format!("%YAML:1.0\n---\nR: {eye}\nT: {t}\n"));
    set
}
