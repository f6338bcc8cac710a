//! KITTI's other benchmarks: `kitti/stereo2012`, `kitti/depth`, `kitti/odometry`: layout, and a point of
//! each by hand.

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::path::Path;

use depthloom_graphs::Value;
use depthloom_test_needs::shared;
use serde_json::{Value as Json, json};

use crate::call::{Values, metres, open};
use crate::folder::Folder;
use crate::stereo_sets::agree;

/// Focal length 20 px, principal point (20, 15), baseline 0.5 m: `f * B` is 10 px m. The left of a pair may stand
/// aside.
fn projections(left: &str, right: &str) -> String {
    format!("{left}: 20 0 20 4 0 20 15 0 0 0 1 0\n{right}: 20 0 20 -6 0 20 15 0 0 0 1 0\n")
}

/// A small set of a kind in a folder, as parameters.
pub(crate) fn small(kind: &str, root: &Path) -> Json {
    let set = Folder::at(root);
    match kind {
        "kitti/stereo2012" => stereo_2012(set).params(&json!({ "disparities": true })),
        "kitti/odometry" => odometry(set).params(&json!({ "sequence": "04" })),
        "kitti/depth" => depth(set).params(&json!({ "raw": root.join("raw") })),
        _ => panic!("add a small {kind}"),
    }
}

/// The ground-truth depth of the known point, and how many points are known.
fn known(values: &Values) -> (f32, usize) {
    let metres = metres(&values["depth"]);
    (metres[2 * 40 + 3], metres.iter().filter(|metres| metres.is_finite()).count())
}

fn baseline(values: &Values) -> f64 {
    let Value::Calibration(calibration) = &values["calibration"] else { panic!() };
    assert_eq!((calibration.focal_px, calibration.cx_px, calibration.cy_px), (20.0, 20.0, 15.0));
    calibration.baseline_m
}

fn stereo_2012(set: Folder) -> Folder {
    for number in ["000003", "000007"] {
        for camera in ["colored_0", "colored_1", "image_0", "image_1"] {
            set.image(&format!("training/{camera}/{number}_10.png"));
            set.image(&format!("training/{camera}/{number}_11.png"));
        }
        // A disparity of 4 px: 2.5 m. All pixels know 5 px there: 2 m.
        set.map(&format!("training/disp_noc/{number}_10.png"), 4 * 256);
        set.map(&format!("training/disp_occ/{number}_10.png"), 5 * 256);
        let text = projections("P0", "P1") + &projections("P2", "P3").replace(" -6 ", " -16 ");
        set.text(&format!("training/calib/{number}.txt"), &text);
    }
    set
}

#[test]
fn stereo_2012_reads_the_first_step_of_both_pairs_with_ground_truth() {
    let set = stereo_2012(Folder::new());
    let grey = set.open("kitti/stereo2012", &json!({ "cameras": "grey", "disparities": true }));
    let ids: Vec<_> = grey.source.frames().iter().map(|frame| (frame.index, &*frame.id)).collect();
    assert_eq!(ids, [(3, "000003_10"), (7, "000007_10")]);
    let (values, _) = grey.read(FrameIndex(0)).unwrap();
    assert_eq!((baseline(&values), known(&values)), (0.5, (2.5, 1)));
    for port in ["disp_noc", "disp_occ", "occluded"] {
        assert!(values.contains_key(port), "{port}");
    }
    let (values, _) = set
        .open("kitti/stereo2012", &json!({ "ground_truth": "occ", "disparities": true }))
        .read(FrameIndex(0))
        .unwrap();
    assert_eq!(agree(&values), 1);
    // The colour cameras are a metre apart here.
    let (values, _) =
        set.open("kitti/stereo2012", &json!({ "ground_truth": "occ", "frames": [7] })).read(FrameIndex(0)).unwrap();
    assert_eq!((baseline(&values), known(&values)), (1.0, (4.0, 1)));
    assert!(!values.contains_key("disp_noc"));
    let (values, _) = set.open("kitti/stereo2012", &json!({ "ground_truth": "none" })).read(FrameIndex(0)).unwrap();
    assert!(!values.contains_key("depth"));
}

fn odometry(set: Folder) -> Folder {
    for number in 0..3 {
        for camera in ["image_0", "image_1", "image_2", "image_3"] {
            set.image(&format!("sequences/04/{camera}/{number:06}.png"));
        }
    }
    let text = projections("P0", "P1") + &projections("P2", "P3").replace(" -6 ", " -16 ");
    set.text("sequences/04/calib.txt", &text);
    set.text("sequences/04/times.txt", "0.000000e+00\n1.036224e-01\n2.072449e-01\n");
    set
}

#[test]
fn odometry_gives_a_sequence_with_its_times() {
    let set = odometry(Folder::new());
    let source = set.open("kitti/odometry", &json!({ "sequence": "04", "cameras": "grey", "frames": "1..3" }));
    let frames: Vec<_> = source.source.frames().iter().map(|frame| (&*frame.id, frame.time_ns)).collect();
    assert_eq!(frames, [("04_000001", 103_622_400), ("04_000002", 207_244_900)]);
    let (values, _) = source.read(FrameIndex(0)).unwrap();
    assert_eq!((baseline(&values), values.contains_key("depth")), (0.5, false));
    let (values, _) = set.open("kitti/odometry", &json!({ "sequence": "04" })).read(FrameIndex(0)).unwrap();
    assert_eq!(baseline(&values), 1.0);
    let own = open("kitti/odometry", &json!({ "root": set.path("sequences/04") })).unwrap();
    assert_eq!(&*own.source.frames()[2].id, "04_000002");
}

#[test]
fn missing_times_are_an_error_and_no_times_file_means_10_hz() {
    let set = odometry(Folder::new());
    set.text("sequences/04/times.txt", "0.0\n5.0\n");
    let reports = set.report("kitti/odometry", &json!({ "sequence": "04" }));
    assert!(reports.starts_with("ROOT/sequences/04/times.txt has 2 times, and none of frame 04_000002"), "{reports}");
    fs::remove_file(set.path("sequences/04/times.txt")).unwrap();
    let source = set.open("kitti/odometry", &json!({ "sequence": "04" }));
    assert_eq!(source.source.frames()[2].time_ns, 200_000_000);
}

fn depth(set: Folder) -> Folder {
    let drive = "2011_09_26_drive_0001_sync";
    for number in 0..3 {
        for camera in ["image_02", "image_03"] {
            set.image(&format!("raw/2011_09_26/{drive}/{camera}/data/{number:010}.png"));
        }
    }
    // The benchmark leaves out a drive's ends. 2.5 m.
    set.map(&format!("train/{drive}/proj_depth/groundtruth/image_02/{:010}.png", 1), 640);
    set.map(&format!("train/{drive}/proj_depth/velodyne_raw/image_02/{:010}.png", 1), 128);
    let text = format!("S_rect_02: 40 30\n{}", projections("P_rect_02", "P_rect_03"));
    set.text("raw/2011_09_26/calib_cam_to_cam.txt", &text);
    set
}

#[test]
fn kitti_depth_has_annotated_ground_truth_and_raw_images() {
    let set = depth(Folder::new());
    let raw = set.path("raw");
    let source = set.open("kitti/depth", &json!({ "raw": raw }));
    let ids: Vec<_> = source.source.frames().iter().map(|frame| (frame.index, &*frame.id)).collect();
    assert_eq!(ids, [(1, "2011_09_26_drive_0001_sync_0000000001")]);
    let (values, _) = source.read(FrameIndex(0)).unwrap();
    assert_eq!((baseline(&values), known(&values)), (0.5, (2.5, 1)));
    let scan = set.open("kitti/depth", &json!({ "raw": raw.join("2011_09_26"), "ground_truth": "velodyne_raw" }));
    assert_eq!(known(&scan.read(FrameIndex(0)).unwrap().0), (0.5, 1));
}

#[test]
fn the_shared_annotated_maps_are_read_as_opencv_reads_them() {
    const TEST: &str = "the_shared_annotated_maps_are_read_as_opencv_reads_them";
    let Some(shared) = shared(TEST) else { return };
    // The shared sample has no images of that drive: images of another frame of the same day and size replace them.
    let set = Folder::new();
    let images = shared.join("data/kitti_raw/2011_09_26");
    let (there, here) = ("2011_09_26_drive_0002_sync", "raw/2011_09_26/2011_09_26_drive_0001_sync");
    for camera in ["image_02", "image_03"] {
        for (from, to) in [(0, 5), (1, 6)] {
            let from = images.join(there).join(format!("{camera}/data/{from:010}.png"));
            fs::copy(from, set.path(&format!("{here}/{camera}/data/{to:010}.png"))).unwrap();
        }
    }
    let calibration = "calib_cam_to_cam.txt";
    fs::copy(images.join(calibration), set.path(&format!("raw/2011_09_26/{calibration}"))).unwrap();
    let root = shared.join("data/kitti_depth");
    let source = open("kitti/depth", &json!({ "root": root, "raw": set.path("raw") })).unwrap();
    assert_eq!(source.source.frames().len(), 2);
    for (position, number) in [5, 6].into_iter().enumerate() {
        let file = format!("2011_09_26_drive_0001_sync/proj_depth/groundtruth/image_02/{number:010}.png");
        let map = crate::call::png_u16(&root.join(file));
        let (values, _) = source.read(FrameIndex(position)).unwrap();
        assert!(map.iter().any(|raw| *raw > 0));
        for (ours, raw) in metres(&values["depth"]).iter().zip(map.iter()) {
            assert!(if *raw == 0 { ours.is_nan() } else { *ours == f32::from(*raw) / 256.0 });
        }
    }
}

#[test]
fn missing_data_are_named_with_a_remedy() {
    let refused = |set: Folder, kind: &str, more: Json, file: &str| {
        set.remove(file);
        format!("{kind} without {file}:\n{}\n", set.report(kind, &more))
    };
    let of_2012 = |file| refused(stereo_2012(Folder::new()), "kitti/stereo2012", json!({}), file);
    let of_odometry = |file| refused(odometry(Folder::new()), "kitti/odometry", json!({ "sequence": "04" }), file);
    let of_depth = |file: &str| {
        let set = depth(Folder::new());
        let raw = set.path("raw");
        refused(set, "kitti/depth", json!({ "raw": raw }), file).replace(&raw.display().to_string(), "ROOT/raw")
    };
    let reports = [
        of_2012("training/colored_1/000007_10.png"),
        of_2012("training/disp_noc"),
        of_2012("training/calib/000003.txt"),
        of_2012("training"),
        of_odometry("sequences/04/image_3/000001.png"),
        of_odometry("sequences/04/calib.txt"),
        of_odometry("sequences/04"),
        of_depth("train"),
        of_depth("raw/2011_09_26/2011_09_26_drive_0001_sync/image_02/data/0000000001.png"),
        of_depth("raw/2011_09_26/calib_cam_to_cam.txt"),
    ];
    insta::assert_snapshot!(reports.join("\n"));
}
