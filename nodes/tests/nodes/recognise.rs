//! Kinds recognise their own layouts, and no kind another's.

use depthloom_graphs::plan::FrameIndex;
use depthloom_test_needs::workspace;
use serde_json::json;

use crate::call::open;
use crate::{images, kitti_family, kitti_raw, ros2_bag, stereo_sets};

/// The kinds that recognise a path, each with the parameters it gives.
fn recognised(root: &std::path::Path) -> Vec<(&'static str, serde_json::Value)> {
    let registry = depthloom_nodes::registry();
    let parameters = |entry: &depthloom_graphs::registry::SourceEntry| {
        entry.recognise(root).into_iter().map(|found| (entry.declaration.kind, found.params)).collect::<Vec<_>>()
    };
    registry.sources().filter(|entry| entry.declaration.kind != "images").flat_map(parameters).collect()
}

#[test]
fn fault_62_a_calibration_of_another_data_set_makes_no_scene_of_middlebury() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["I1_000000.png", "I2_000000.png"] {
        image::GrayImage::new(8, 6).save(folder.path().join(name)).unwrap();
    }
    std::fs::write(folder.path().join("calib.txt"), "f=894.58 px\ncu=635.96 px\nb=0.57 m\n").unwrap();
    let others = recognised(folder.path());
    assert!(others.is_empty(), "{others:?}");
    let found = depthloom_nodes::registry().source_kind("images").unwrap().recognise(folder.path());
    assert_eq!(found[0].params["left"], "I1_000000.png");
    assert_eq!(found[0].params["right"], "I2_000000.png");
}

#[test]
fn every_kind_recognises_its_folder_and_opens_it_with_the_reported_parameters() {
    let of_kitti = ["kitti/stereo2012", "kitti/odometry", "kitti/depth", "kitti/raw"];
    let others = ["ros2/bag", "middlebury", "eth3d/two-view", "sintel-stereo", "scene-flow", "drivingstereo"];
    for kind in of_kitti.into_iter().chain(others) {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let path = match kind {
            "ros2/bag" => {
                ros2_bag::small(root);
                root.join("small.mcap")
            }
            "kitti/raw" => {
                kitti_raw::small(root);
                root.to_owned()
            }
            _ if of_kitti.contains(&kind) => {
                kitti_family::small(kind, root);
                root.to_owned()
            }
            _ => {
                stereo_sets::small(kind, root);
                root.to_owned()
            }
        };
        let found = recognised(&path);
        let own: Vec<_> = found.iter().filter(|(found, _)| *found == kind).collect();
        assert_eq!(own.len(), 1, "{kind}: {found:?}");
        assert_eq!(found.len(), 1, "{kind}: {found:?}");
        let source = open(kind, &own[0].1).unwrap_or_else(|fault| panic!("{kind}: {}", fault.chain()));
        source.read(FrameIndex(0)).unwrap_or_else(|fault| panic!("{kind}: {}", fault.chain()));
    }
    let road = recognised(&workspace().join("tests/fixtures/road"));
    assert_eq!(road.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), ["kitti/stereo2015"]);
    assert!(recognised(&workspace().join("src")).is_empty());
}

#[test]
fn pairs_of_ones_own_are_recognised_with_their_calibration() {
    let folder = tempfile::tempdir().unwrap();
    images::small(folder.path());
    let golden = workspace().join("tests/fixtures/golden/rectify");
    for file in ["intrinsics.yml", "extrinsics.yml"] {
        std::fs::copy(golden.join(file), folder.path().join(file)).unwrap();
    }
    let registry = depthloom_nodes::registry();
    let found = registry.source_kind("images").unwrap().recognise(folder.path());
    assert_eq!(found.len(), 1, "{found:?}");
    let files = json!(["extrinsics.yml", "intrinsics.yml"]);
    assert_eq!((&found[0].params["left"], &found[0].params["right"]), (&json!("cam0/*.png"), &json!("cam1/*.png")));
    assert_eq!(found[0].params["calibration"]["files"], files);
    assert!(
        found[0].what.starts_with("pairs of images, cam0/*.png and cam1/*.png, calibrated by "),
        "{}",
        found[0].what
    );
}
