//! `middlebury`, `eth3d/two-view`, `sintel-stereo`, `scene-flow`, `drivingstereo`: a point of each by hand.

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::path::Path;
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_graphs::values::Calibration;
use depthloom_test_needs::{python, shared, workspace};
use image::{Rgb, RgbImage};
use serde_json::{Value as Json, json};

use crate::call::{Values, metres, open, value};
use crate::folder::{Folder, SIZE};

/// A calibration of 2014: `f * B` is 20 px m.
pub(crate) const OF_2014: &str = "cam0=[100 0 18; 0 100 15; 0 0 1]\ncam1=[100 0 23.5; 0 100 15; 0 0 1]\ndoffs=5.5\nbaseline=200\nwidth=40\nheight=30\nndisp=64\n";

/// A small set of a kind in a folder, as parameters.
pub(crate) fn small(kind: &str, root: &Path) -> Json {
    let set = Folder::at(root);
    match kind {
        "middlebury" => of_2014(set).params(&json!({})),
        "eth3d/two-view" => eth3d(set).params(&json!({})),
        "sintel-stereo" => sintel(set).params(&json!({ "focal_px": 1120 })),
        "scene-flow" => scene_flow(set).params(&json!({})),
        "drivingstereo" => driving_stereo(set).params(&json!({})),
        _ => panic!("add a small {kind}"),
    }
}

fn calibration(values: &Values) -> Calibration {
    let Value::Calibration(calibration) = &values["calibration"] else { panic!() };
    Calibration::clone(calibration)
}

/// The true disparities of a port.
fn px<'a>(values: &'a Values, port: &str) -> &'a [f32] {
    let Value::TrueDisparity(truth) = &values[port] else { panic!("{port} is {}", values[port].value_type()) };
    truth.px.as_raw()
}

/// What is known of a map of `width` columns: by column and row.
fn known(map: &[f32], width: usize) -> Vec<((usize, usize), f32)> {
    let known = map.iter().enumerate().filter(|(_, number)| !number.is_nan());
    known.map(|(at, number)| ((at % width, at / width), *number)).collect()
}

/// That disparity, depth and calibration speak of one place: each pixel's point, of its depth, is seen by the right
/// camera a disparity to the left.
pub(crate) fn agree(values: &Values) -> usize {
    let calib = calibration(values);
    let (width, depth) = (calib.width as usize, metres(&values["depth"]));
    let seen = known(px(values, "disp_occ"), width);
    for &((column, row), disparity) in &seen {
        let z = f64::from(depth[row * width + column]);
        let x = (column as f64 - calib.cx_px) * z / calib.focal_px;
        let p = calib.p_right();
        let there = (p[0] * x + p[2] * z + p[3]) / (z + p[11]);
        let (expected, off) = (column as f64 - f64::from(disparity), 1e-3);
        assert!((there - expected).abs() < off, "({column}, {row}): {there}, not {expected}");
    }
    seen.len()
}

pub(crate) fn of_2014(set: Folder) -> Folder {
    for scene in ["Adirondack", "Vintage"] {
        set.image(&format!("{scene}/im0.png"));
        set.image(&format!("{scene}/im1.png"));
        set.text(&format!("{scene}/calib.txt"), OF_2014);
        set.pfm(&format!("{scene}/disp0.pfm"), SIZE, &[4.5, 10.25]);
        // Both cameras see (3, 2), one (4, 2).
        let mut mask = image::GrayImage::new(SIZE.0, SIZE.1);
        mask.put_pixel(3, 2, image::Luma([255]));
        mask.put_pixel(4, 2, image::Luma([128]));
        mask.save(set.path(&format!("{scene}/mask0nocc.png"))).unwrap();
    }
    set.image("notes/cover.png");
    set
}

#[test]
fn middlebury_2014_has_two_principal_points_and_an_occlusion_mask() {
    let set = of_2014(Folder::new());
    let opened = set.open("middlebury", &json!({}));
    let ids: Vec<_> = opened.source.frames().iter().map(|frame| (frame.index, &*frame.id)).collect();
    assert_eq!(ids, [(0, "Adirondack"), (1, "Vintage")]);
    let (values, _) = opened.read(FrameIndex(0)).unwrap();
    let calib = calibration(&values);
    assert_eq!(
        (calib.focal_px, calib.cx_px, calib.cy_px, calib.baseline_m, calib.doffs_px),
        (100.0, 18.0, 15.0, 0.2, 5.5)
    );
    // 20 px m / (4.5 + 5.5) px.
    assert_eq!(known(metres(&values["depth"]), 40), [((3, 2), 2.0), ((4, 2), 20.0 / 15.75)]);
    assert_eq!(known(px(&values, "disp_occ"), 40), [((3, 2), 4.5), ((4, 2), 10.25)]);
    assert_eq!(known(px(&values, "disp_noc"), 40), [((3, 2), 4.5)]);
    let Value::Mask(occluded) = &values["occluded"] else { panic!() };
    assert_eq!(occluded.set.iter().filter(|set| **set > 0).count(), 1);
    assert_eq!(agree(&values), 2);
    let noc =
        set.open("middlebury", &json!({ "ground_truth": "noc", "scenes": ["Vintage"] })).read(FrameIndex(0)).unwrap().0;
    assert_eq!(known(metres(&noc["depth"]), 40), [((3, 2), 2.0)]);
    let none = set.open("middlebury", &json!({ "ground_truth": "none" })).read(FrameIndex(0)).unwrap().0;
    assert_eq!(none.keys().copied().collect::<Vec<_>>(), ["calibration", "left", "right"]);
    // A scene's own folder is a data set of one.
    let one = open("middlebury", &json!({ "root": set.path("Vintage") })).unwrap();
    assert_eq!(&*one.source.frames()[0].id, "Vintage");
}

/// The same place in images of half the size: half of all pixels, the same depth.
#[test]
fn middlebury_scales_with_its_calibration() {
    let set = of_2014(Folder::new());
    let half = "cam0=[50 0 9; 0 50 7.5; 0 0 1]\ncam1=[50 0 11.75; 0 50 7.5; 0 0 1]\ndoffs=2.75\nbaseline=200\n";
    set.image_of("half/Vintage/im0.png", (20, 15));
    set.image_of("half/Vintage/im1.png", (20, 15));
    set.text("half/Vintage/calib.txt", half);
    set.pfm("half/Vintage/disp0GT.pfm", (20, 15), &[2.25]);
    let half = open("middlebury", &json!({ "root": set.path("half") })).unwrap().read(FrameIndex(0)).unwrap().0;
    assert_eq!(known(metres(&half["depth"]), 20), [((3, 2), 2.0)]);
    assert_eq!((agree(&half), half.contains_key("disp_noc")), (1, false));
}

pub(crate) fn of_2006(set: Folder) -> Folder {
    set.image_of("Aloe/view1.png", (8, 555));
    set.image_of("Aloe/view5.png", (8, 555));
    set.map_u8_of("Aloe/disp1.png", (8, 555), 96);
    set.text("Aloe/dmin.txt", "270\n");
    set
}

#[test]
fn middlebury_2006_adds_the_part_removed_by_cropping() {
    let set = of_2006(Folder::new());
    let values = set.open("middlebury", &json!({})).read(FrameIndex(0)).unwrap().0;
    // At half size a grey level is half a pixel: 48 px, and 135 px of cropping; 1870 px focal length.
    assert_eq!(known(px(&values, "disp_occ"), 8), [((3, 2), 48.0)]);
    let calib = calibration(&values);
    assert_eq!(
        (calib.focal_px, calib.doffs_px, calib.baseline_m, calib.cx_px, calib.cy_px),
        (1870.0, 135.0, 0.16, 3.5, 277.0)
    );
    // As in 3740 px * 0.16 m / (96 + 270) px of the full size.
    let depth = metres(&values["depth"])[2 * 8 + 3];
    assert!((depth - 1.634_972_7).abs() < 1e-6, "{depth}");
    assert_eq!(agree(&values), 1);
    let oracle = set.open("middlebury", &json!({ "factor": 3 })).read(FrameIndex(0)).unwrap().0;
    assert_eq!(known(px(&oracle, "disp_occ"), 8), [((3, 2), 32.0)]);
    set.remove("Aloe/dmin.txt");
    let opened = set.open("middlebury", &json!({}));
    assert_eq!(opened.source.warnings(), ["1 scene has no dmin.txt, and so neither calibration nor depth: Aloe"]);
    let values = opened.read(FrameIndex(0)).unwrap().0;
    assert_eq!(values.keys().copied().collect::<Vec<_>>(), ["disp_occ", "left", "right"]);
}

pub(crate) fn of_2001(set: Folder) -> Folder {
    for view in [2, 4, 6] {
        set.image(&format!("venus/im{view}.ppm"));
    }
    set.map_u8("venus/disp2.pgm", 90);
    set
}

#[test]
fn middlebury_2001_and_2003_have_only_the_given_calibration() {
    let set = of_2001(Folder::new());
    let read = |more: Json| set.open("middlebury", &more).read(FrameIndex(0)).unwrap().0;
    let values = read(json!({}));
    assert_eq!(values.keys().copied().collect::<Vec<_>>(), ["disp_occ", "left", "right"]);
    assert_eq!(known(px(&values, "disp_occ"), 40), [((3, 2), 11.25)]);
    // A view half as far has half the disparity.
    let near = read(json!({ "views": [2, 4], "factor": 4 }));
    assert_eq!(known(px(&near, "disp_occ"), 40), [((3, 2), 11.25)]);
    let given = read(json!({ "factor": 4, "focal_px": 90, "baseline_m": 0.5 }));
    assert_eq!((known(metres(&given["depth"]), 40), agree(&given)), (vec![((3, 2), 2.0)], 1));
    assert_eq!((calibration(&given).cx_px, calibration(&given).cy_px), (19.5, 14.5));
}

pub(crate) fn eth3d(set: Folder) -> Folder {
    let calibration = "cam0=[541.764 0 553.869; 0 541.764 232.396; 0 0 1]\ncam1=[541.764 0 553.869; 0 541.764 232.396; 0 0 1]\ndoffs=0\nbaseline=59.9101\nwidth=40\nheight=30\n";
    set.image("two_view_training/delivery_area_1l/im0.png");
    set.image("two_view_training/delivery_area_1l/im1.png");
    set.text("two_view_training/delivery_area_1l/calib.txt", calibration);
    set.pfm("two_view_training_gt/delivery_area_1l/disp0GT.pfm", SIZE, &[16.25]);
    set.map_u8("two_view_training_gt/delivery_area_1l/mask0nocc.png", 255);
    set
}

#[test]
fn eth3d_has_its_baseline_in_millimetres_and_ground_truth_in_another_folder() {
    let set = eth3d(Folder::new());
    let values = set.open("eth3d/two-view", &json!({})).read(FrameIndex(0)).unwrap().0;
    // 541.764 px * 0.0599101 m / 16.25 px.
    let depth = metres(&values["depth"])[2 * 40 + 3];
    assert!((depth - 1.997_362).abs() < 1e-6, "{depth}");
    assert_eq!((agree(&values), known(px(&values, "disp_noc"), 40)), (1, vec![((3, 2), 16.25)]));
    let alone =
        open("eth3d/two-view", &json!({ "root": set.path("two_view_training"), "ground_truth": "none" })).unwrap();
    assert_eq!(&*alone.source.frames()[0].id, "delivery_area_1l");
    assert!(!alone.read(FrameIndex(0)).unwrap().0.contains_key("disp_occ"));
}

pub(crate) fn sintel(set: Folder) -> Folder {
    for folder in ["final_left", "final_right", "clean_left", "clean_right"] {
        set.image(&format!("training/{folder}/alley_1/frame_0001.png"));
        set.image(&format!("training/{folder}/alley_1/frame_0002.png"));
    }
    for frame in ["frame_0001", "frame_0002"] {
        // 12 + 77/64 + 128/16384 px everywhere.
        let disparities = RgbImage::from_pixel(SIZE.0, SIZE.1, Rgb([3, 77, 128]));
        disparities.save(set.path(&format!("training/disparities/alley_1/{frame}.png"))).unwrap();
        set.map_u8(&format!("training/occlusions/alley_1/{frame}.png"), 255);
        let out = image::GrayImage::from_fn(SIZE.0, SIZE.1, |x, _| image::Luma([u8::from(x == 0)]));
        out.save(set.path(&format!("training/outofframe/alley_1/{frame}.png"))).unwrap();
    }
    set
}

#[test]
fn sintel_ignores_pixels_outside_the_frame_and_marks_occlusions() {
    let set = sintel(Folder::new());
    let opened = set.open("sintel-stereo", &json!({ "focal_px": 1120, "frames": [1] }));
    assert_eq!((&*opened.source.frames()[0].id, opened.source.frames()[0].index), ("alley_1_frame_0002", 1));
    let values = opened.read(FrameIndex(0)).unwrap().0;
    let disparity = 12.0 + 77.0 / 64.0 + 128.0 / 16384.0;
    let occ = known(px(&values, "disp_occ"), 40);
    assert_eq!((occ.len(), occ[0]), (39 * 30, ((1, 0), disparity)));
    assert_eq!(known(px(&values, "disp_noc"), 40).len(), 39 * 30 - 1);
    let Value::Mask(occluded) = &values["occluded"] else { panic!() };
    assert_eq!((occluded.set[(3, 2)].0, occluded.set[(0, 0)].0), ([255], [0]));
    // 1120 px * 0.1 m.
    assert_eq!((metres(&values["depth"])[41], agree(&values)), (112.0 / disparity, 39 * 30));
    let without = set.open("sintel-stereo", &json!({ "pass": "clean" })).read(FrameIndex(0)).unwrap().0;
    assert_eq!(without.keys().copied().collect::<Vec<_>>(), ["disp_noc", "disp_occ", "left", "occluded", "right"]);
    // The camera of the depth archive: tag, intrinsics, pose.
    let numbers = [900.0, 0.0, 20.0, 0.0, 900.0, 14.0, 0.0, 0.0, 1.0];
    let doubles = numbers.into_iter().chain([0.0; 12]).flat_map(f64::to_le_bytes);
    let camera: Vec<u8> = 202_021.25_f32.to_le_bytes().into_iter().chain(doubles).collect();
    for frame in ["frame_0001", "frame_0002"] {
        set.bytes(&format!("training/camdata_left/alley_1/{frame}.cam"), &camera);
    }
    let values = set.open("sintel-stereo", &json!({})).read(FrameIndex(0)).unwrap().0;
    let calib = calibration(&values);
    assert_eq!(
        (calib.focal_px, calib.cx_px, calib.cy_px, metres(&values["depth"])[41]),
        (900.0, 20.0, 14.0, 90.0 / disparity)
    );
}

pub(crate) fn scene_flow(set: Folder) -> Folder {
    let size = (960, 4);
    for way in ["35mm_focallength/scene_forwards/fast", "15mm_focallength/scene_backwards/slow"] {
        for pass in ["frames_finalpass", "frames_cleanpass"] {
            set.image_of(&format!("{pass}/{way}/left/0001.png"), size);
            set.image_of(&format!("{pass}/{way}/right/0001.png"), size);
        }
        set.pfm(&format!("disparity/{way}/left/0001.pfm"), size, &[37.5]);
    }
    set
}

#[test]
fn scene_flow_has_two_lenses() {
    let set = scene_flow(Folder::new());
    let opened = set.open("scene-flow", &json!({ "pass": "clean" }));
    let ids: Vec<_> = opened.source.frames().iter().map(|frame| &*frame.id).collect();
    assert_eq!(ids, ["15mm_focallength_scene_backwards_slow_0001", "35mm_focallength_scene_forwards_fast_0001"]);
    for (position, focal_px, depth) in [(0, 450.0, 12.0), (1, 1050.0, 28.0)] {
        let values = opened.read(FrameIndex(position)).unwrap().0;
        let calib = calibration(&values);
        assert_eq!((calib.focal_px, calib.cx_px, calib.baseline_m), (focal_px, 479.5, 1.0));
        assert_eq!((known(metres(&values["depth"]), 960), agree(&values)), (vec![((3, 2), depth)], 1));
    }
    assert_ne!(
        opened.read(FrameIndex(0)).unwrap().1,
        opened.read(FrameIndex(1)).unwrap().1,
        "the lens is part of the key, though all files are equal"
    );
    let one =
        set.open("scene-flow", &json!({ "folders": ["35mm_focallength/scene_forwards"], "ground_truth": "none" }));
    assert_eq!((one.source.frames().len(), one.read(FrameIndex(0)).unwrap().0.contains_key("disp_occ")), (1, false));
    // Images of half the size have half the focal length.
    for folder in ["frames_finalpass/A/0000/left", "frames_finalpass/A/0000/right"] {
        set.image_of(&format!("small/{folder}/0006.png"), (480, 4));
    }
    set.pfm("small/disparity/A/0000/left/0006.pfm", (480, 4), &[18.75]);
    let half = open("scene-flow", &json!({ "root": set.path("small") })).unwrap().read(FrameIndex(0)).unwrap().0;
    assert_eq!((known(metres(&half["depth"]), 480), calibration(&half).cx_px), (vec![((3, 2), 28.0)], 239.5));
}

/// Of a half-size file the last column of the right projection is that of the full size.
pub(crate) const OF_DRIVING: &str = "calib_time: 09-Jan-2018\nT_103: -0.5 0.0 0.0\nP_rect_101: 30 0 20 0 0 30 15 0 0 0 1 0\nP_rect_103: 30 0 20 -30 0 30 15 0 0 0 1 0\n";

pub(crate) fn driving_stereo(set: Folder) -> Folder {
    let stem = "2018-10-19-09-30-39_2018-10-19-09-31-36-438";
    set.image(&format!("left-image-half-size/{stem}.jpg"));
    set.image(&format!("right-image-half-size/{stem}.jpg"));
    set.map(&format!("disparity-map-half-size/{stem}.png"), 4 * 256);
    set.text("half-image-calib/2018-10-19-09-30-39.txt", OF_DRIVING);
    set
}

#[test]
fn drivingstereo_has_ground_truth_in_256ths_and_its_own_baseline() {
    let set = driving_stereo(Folder::new());
    let values = set.open("drivingstereo", &json!({})).read(FrameIndex(0)).unwrap().0;
    let calib = calibration(&values);
    assert_eq!((calib.focal_px, calib.cx_px, calib.baseline_m, calib.doffs_px), (30.0, 20.0, 0.5, 0.0));
    // 30 px * 0.5 m / 4 px.
    assert_eq!((known(metres(&values["depth"]), 40), agree(&values)), (vec![((3, 2), 3.75)], 1));
    // The data set's own depths go before those.
    let stem = "2018-10-19-09-30-39_2018-10-19-09-31-36-438";
    set.map(&format!("depth-map-half-size/{stem}.png"), 960);
    let values = set.open("drivingstereo", &json!({})).read(FrameIndex(0)).unwrap().0;
    assert_eq!((known(metres(&values["depth"]), 40), agree(&values)), (vec![((3, 2), 3.75)], 1));
    // The training set: a folder a sequence, calibrations beside.
    for folder in ["train-left-image", "train-right-image"] {
        set.image(&format!("training/{folder}/2018-07-09-16-11-56/2018-07-09-16-11-56_2018-07-09-16-11-57-000.jpg"));
    }
    let map = "training/train-disparity-map/2018-07-09-16-11-56/2018-07-09-16-11-56_2018-07-09-16-11-57-000.png";
    set.map(map, 2 * 256);
    set.text("half-image-calib/2018-07-09-16-11-56.txt", OF_DRIVING);
    let values =
        open("drivingstereo", &json!({ "root": set.path("training") })).unwrap().read(FrameIndex(0)).unwrap().0;
    assert_eq!(known(metres(&values["depth"]), 40), [((3, 2), 7.5)]);
    // Archives unpacked into folders of their names.
    for folder in ["left-image-half-size", "right-image-half-size", "disparity-map-half-size", "half-image-calib"] {
        fs::rename(set.path(folder), set.path(&format!("again/{folder}/{folder}"))).unwrap();
    }
    let values = open("drivingstereo", &json!({ "root": set.path("again") })).unwrap().read(FrameIndex(0)).unwrap().0;
    assert_eq!(known(metres(&values["depth"]), 40), [((3, 2), 3.75)]);
    // At full size a pixel is 128.
    for (folder, ending) in [("left-image-full-size", "png"), ("right-image-full-size", "png")] {
        set.image(&format!("cloudy/{folder}/{stem}.{ending}"));
    }
    set.map(&format!("cloudy/disparity-map-full-size/{stem}.png"), 4 * 256);
    let full = open("drivingstereo", &json!({ "root": set.path("cloudy"), "size": "full" })).unwrap();
    assert!(full.source.warnings()[0].starts_with("there is no folder full-image-calib in root"));
    let values = full.read(FrameIndex(0)).unwrap().0;
    assert_eq!((known(px(&values, "disp_occ"), 40), values.contains_key("depth")), (vec![((3, 2), 8.0)], false));
}

#[test]
fn maps_are_read_as_numpy_and_opencv_write_them() {
    let Some(python) = python("maps_are_read_as_numpy_and_opencv_write_them") else { return };
    let set = of_2014(Folder::new());
    fs::rename(set.path("Vintage"), set.path("forms/scene")).unwrap();
    let script = workspace().join("nodes/tests/write_maps.py");
    let output = Command::new(python).arg(script).arg(set.path("forms")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    set.remove("forms/scene");
    let opened = open("middlebury", &json!({ "root": set.path("forms") })).unwrap();
    assert_eq!(opened.source.frames().len(), 9);
    for (position, frame) in opened.source.frames().iter().enumerate() {
        let values =
            opened.read(FrameIndex(position)).unwrap_or_else(|fault| panic!("{}: {}", frame.id, fault.chain())).0;
        for (at, number) in px(&values, "disp_occ").iter().enumerate() {
            let (x, y) = (at % 40, at / 40);
            let expected = (x != y).then_some(at as f32 + 0.125);
            assert_eq!((!number.is_nan()).then_some(*number), expected, "{} ({x}, {y})", frame.id);
        }
    }
}

/// Our SGBM on the shared scenes, scored by us, beside OpenCV's, scored in NumPy.
#[test]
fn sgbm_is_as_wrong_on_teddy_and_cones_as_opencvs() {
    const TEST: &str = "sgbm_is_as_wrong_on_teddy_and_cones_as_opencvs";
    let (Some(shared), Some(python)) = (shared(TEST), python(TEST)) else { return };
    let root = shared.join("data/middlebury");
    let opened = open("middlebury", &json!({ "root": root })).unwrap();
    let scenes: Vec<_> = opened.source.frames().iter().map(|frame| &*frame.id).collect();
    assert_eq!(scenes, ["cones", "teddy"]);
    for (position, scene) in scenes.into_iter().enumerate() {
        let values = opened.read(FrameIndex(position)).unwrap().0;
        let found = value("stereo/sgbm", &json!({}), &[("left", &values["left"]), ("right", &values["right"])]);
        let inputs = [("estimate", &found), ("ground_truth", &values["disp_occ"])];
        let Value::Scores(rows) = value("score/disparity", &json!({ "sets": ["all", "valid"] }), &inputs) else {
            panic!()
        };
        let script = workspace().join("nodes/tests/middlebury_sgbm.py");
        let output = Command::new(&python).arg(script).arg(root.join(scene)).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let oracle: Json = serde_json::from_slice(&output.stdout).unwrap();
        for row in rows.iter() {
            let (ours, theirs) = (
                row.score("bad_2").unwrap(),
                oracle[if row.set.name() == "valid" { "answered" } else { row.set.name() }].as_f64().unwrap(),
            );
            println!("{scene}, {}: bad-2.0 {ours:.6}, OpenCV's {theirs:.6}", row.set);
            assert!((ours - theirs).abs() < 1e-12, "{scene} {}: {ours}, not {theirs}", row.set);
            assert_eq!((row.truth, row.density()), (oracle["pixels"].as_u64().unwrap(), oracle["density"].as_f64()));
        }
    }
}
