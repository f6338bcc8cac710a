//! A run that resumes after its data changed: it must not keep a frame of the old data.

use std::fs;

use super::{Case, stderr_of};
use crate::support::depthloom;

const IMAGES: &str = "experiment: images
sources: { own: { kind: images, with: { root: data, left: left/*.png, right: right/*.png, calibration: { focal_px: 40, baseline_m: 0.5 } } } }
stages:
  look:
    source: own
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 16 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
";

/// Nodes after those of [`IMAGES`]: an aggregate value over all frames, and a second one computed from it.
const LEARNING: &str = "      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples: { kind: learn/samples, inputs: { image: source/left, target: stereo/disparity, mask: edges/mask }, with: { size: [32, 32] } }
      learnt: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { steps: 1, batch: 1 } }
";

const FRAMES: u32 = 6;

fn frame(case: &Case, frame: u32, seed: u32) {
    for (side, shift) in [("left", 0), ("right", 3)] {
        case.write_image(&format!("data/{side}/{frame:03}.png"), seed, shift);
    }
}

fn remove(case: &Case, frame: u32) {
    for side in ["left", "right"] {
        fs::remove_file(case.path(&format!("data/{side}/{frame:03}.png"))).expect("removed");
    }
}

/// Interrupts a run on six frames, changes the data, and resumes.
fn resume_after(text: &str, change: impl FnOnce(&Case)) {
    let case = Case::new();
    (0..FRAMES).for_each(|number| frame(&case, number, number));
    case.write("images.yaml", text);
    case.run("images.yaml", "runs/one", &[]);
    case.interrupt("runs/one", 0.7);
    change(&case);
    if !case.run_as_fresh_or_refused("images.yaml", "runs/one") {
        case.run_as_fresh("images.yaml", "runs/one", &["--overwrite"]);
    }
}

#[test]
fn images_that_were_replaced_are_read_again() {
    resume_after(IMAGES, |case| (0..FRAMES).for_each(|number| frame(case, number, 100 + number)));
}

#[test]
fn one_image_that_was_replaced_is_read_again() {
    resume_after(IMAGES, |case| frame(case, 1, 100));
}

#[test]
fn frames_that_were_removed_are_removed() {
    resume_after(IMAGES, |case| remove(case, 1));
}

#[test]
fn frames_that_moved_are_not_lost() {
    resume_after(IMAGES, |case| {
        remove(case, 0);
        frame(case, 8, 0);
    });
}

#[test]
fn fewer_frames_than_were_recorded_are_fewer_frames() {
    resume_after(IMAGES, |case| (1..FRAMES).for_each(|number| remove(case, number)));
}

/// Aggregate values and later stages are recorded after the last frame of a stage. They are recomputed after a frame
/// was added.
#[test]
fn an_added_frame_is_recorded_before_aggregate_values_and_later_stages() {
    let second = IMAGES.split_once("stages:\n").expect("stages").1.replace("look:", "again:");
    for (experiment, shares) in
        [(format!("{IMAGES}{LEARNING}"), [0.6, 0.7, 0.8, 0.9]), (format!("{IMAGES}{second}"), [0.4, 0.5, 0.6, 0.7])]
    {
        for share in shares {
            let case = Case::new();
            (0..FRAMES).for_each(|number| frame(&case, number, number));
            case.write("images.yaml", &experiment);
            case.run("images.yaml", "runs/one", &[]);
            case.interrupt("runs/one", share);
            frame(&case, FRAMES, FRAMES);
            case.run_as_fresh("images.yaml", "runs/one", &[]);
        }
    }
}

/// A resumed run sets outdated frames aside. They are kept if the run fails before its first frame.
#[test]
fn frames_that_were_set_aside_survive_a_failure_before_the_first_frame() {
    let case = Case::new();
    (0..FRAMES).for_each(|number| frame(&case, number, number));
    case.write("images.yaml", IMAGES);
    case.run("images.yaml", "runs/one", &[]);
    case.interrupt("runs/one", 0.7);
    frame(&case, 1, 100);
    case.write("data/left/000.png", "not an image");
    let failed = case.attempt("images.yaml", "runs/one", &[]);
    assert!(!failed.status.success(), "{}", stderr_of(&failed));
    assert!(case.path("runs/one.partial/recording.outdated.mcap").is_file(), "{}", stderr_of(&failed));

    // Another experiment, or --fresh, does not replace these frames either.
    case.write("other.yaml", IMAGES.replace("disparities: 16", "disparities: 32"));
    for (experiment, more) in [("other.yaml", &[][..]), ("images.yaml", &["--fresh"])] {
        let refused = case.attempt(experiment, "runs/one", more);
        assert_eq!(refused.status.code(), Some(2), "{}", stderr_of(&refused));
        assert!(stderr_of(&refused).contains("--overwrite"), "{}", stderr_of(&refused));
    }

    frame(&case, 0, 0);
    let output = depthloom()
        .current_dir(case.folder.path())
        .env_remove("DEPTHLOOM_FRESH")
        .args(["run", "--no-page", "images.yaml", "--out", "runs/one", "--json"])
        .output()
        .expect("the program starts");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("an object");
    assert!(
        output.status.success() && report["reused"]["nodes"][0]["reused"].as_u64() > Some(0),
        "{report:#} {}",
        stderr_of(&output)
    );
    case.assert_as_fresh("images.yaml", "runs/one", &[]);
}

/// Reports of a partial run do not remain in the finished run.
#[test]
fn reports_of_the_partial_run_are_removed() {
    let case = Case::new();
    (0..FRAMES).for_each(|number| frame(&case, number, number));
    case.write("images.yaml", IMAGES);
    case.run("images.yaml", "runs/one", &[]);
    case.interrupt("runs/one", 0.7);
    let report = depthloom().current_dir(case.folder.path()).args(["report", "runs/one.partial"]).output();
    let report = report.expect("the program starts");
    assert!(report.status.success() && case.path("runs/one.partial/report.html").is_file(), "{}", stderr_of(&report));
    case.run_as_fresh("images.yaml", "runs/one", &[]);
    assert!(!case.path("runs/one/report.html").exists(), "a page of fewer frames");
}

/// A failure is not a result: frames that failed before the interruption are tried again, and fail or succeed as in a
/// fresh run.
#[test]
fn frames_that_failed_before_the_interruption_are_tried_again() {
    for is_repaired in [false, true] {
        let case = Case::new();
        (0..FRAMES).for_each(|number| frame(&case, number, number));
        case.write("data/left/001.png", "not an image");
        case.write("images.yaml", IMAGES);
        let first = case.attempt("images.yaml", "runs/one", &["--keep-going"]);
        assert_eq!(first.status.code(), Some(3), "{}", stderr_of(&first));
        case.interrupt("runs/one", 0.95);
        if is_repaired {
            frame(&case, 1, 1);
        }
        let again = case.attempt("images.yaml", "runs/one", &["--keep-going"]);
        let fresh = case.attempt("images.yaml", "fresh", &["--keep-going", "--fresh"]);
        assert_eq!(again.status.code(), Some(if is_repaired { 0 } else { 3 }), "{}", stderr_of(&again));
        assert_eq!(again.status.code(), fresh.status.code(), "{}", stderr_of(&fresh));
        assert!(
            case.read("runs/one", "recording.mcap") == case.read("fresh", "recording.mcap"),
            "{}",
            stderr_of(&again)
        );
    }
}

#[test]
fn samples_of_replaced_images_are_collected_again() {
    resume_after(&format!("{IMAGES}{LEARNING}"), |case| {
        (0..FRAMES).for_each(|number| frame(case, number, 100 + number));
    });
}

/// A source and a node in Python; the source has neither `version` nor `code`, and the node imports a module.
const CAMERA: &str = r#"
import sys
import numpy as np, depthloom
import value
@depthloom.source(outputs={"left": "image", "depth": "depth", "calibration": "calibration"})
class Camera:
    def frames(self):
        return [f"f{k}" for k in range(8)]
    def read(self, frame):
        camera = depthloom.Calibration(64, 32, focal_px=90, cx_px=31.5, cy_px=15.5, baseline_m=0.5, doffs_px=0)
        depth = np.full((32, 64), value.SOURCE, np.float32)
        return {"left": np.full((32, 64), 128, np.uint8), "depth": depth, "calibration": camera}
@depthloom.node(inputs={"depth": "depth"}, outputs={"depth": "depth"})
def scaled(depth):
    return depth * value.NODE
depthloom.serve(Camera, scaled)
"#;

const PYTHON: &str = "experiment: camera
sources: { own: SOURCE }
stages:
  look:
    source: own
    nodes:
      mono: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/calibration } }
      scaled: { kind: process, inputs: { depth: mono/depth }, with: { command: [python3, camera.py, scaled], code: [camera.py], ports: { inputs: { depth: depth }, outputs: { depth: depth } } } }
    score: { ground_truth: source/depth, estimates: { mono: mono/depth, scaled: scaled/depth } }
";

/// Interrupts a run with Python programs, changes their module, and resumes.
fn resume_after_a_module_changed(test: &str, source: &str, before: &str, after: &str, files: &[&str]) {
    let Some(case) = Case::with_python(test) else { return };
    case.write("camera.py", CAMERA);
    case.write("camera.yaml", PYTHON.replace("SOURCE", source));
    case.write("value.py", before);
    case.run("camera.yaml", "runs/one", &[]);
    case.interrupt("runs/one", 0.6);
    case.write("value.py", after);
    let output = case.attempt("camera.yaml", "runs/one", &[]);
    if !output.status.success() {
        assert_eq!(output.status.code(), Some(2), "{}", stderr_of(&output));
        case.run("camera.yaml", "runs/one", &["--overwrite"]);
    }
    case.assert_files_as_fresh("camera.yaml", "runs/one", &[], files);
}

#[test]
fn a_program_without_version_and_code_recomputes_all_frames() {
    resume_after_a_module_changed(
        "a_program_without_version_and_code_recomputes_all_frames",
        "{ kind: process/source, with: { command: [python3, camera.py, Camera], outputs: { left: image, depth: depth, calibration: calibration } } }",
        "SOURCE, NODE = 10, 2\n",
        "SOURCE, NODE = 40, 2\n",
        // The keys of such values are random per run, and the recording contains them.
        &["scores.csv", "table.csv"],
    );
}

#[test]
fn a_changed_module_of_a_node_does_not_mix_frames_of_two_versions() {
    resume_after_a_module_changed(
        "a_changed_module_of_a_node_does_not_mix_frames_of_two_versions",
        "{ kind: process/source, with: { command: [python3, camera.py, Camera], version: 1, outputs: { left: image, depth: depth, calibration: calibration } } }",
        "SOURCE, NODE = 10, 2\n",
        "SOURCE, NODE = 10, 3\n",
        &["scores.csv", "table.csv", "recording.mcap"],
    );
}
