//! Training samples of real frames, checked against OpenCV.

use std::process::Command;

use depthloom_recording::{RecordedContent, Recording};

use crate::support::{depthloom, python, shared, succeed, workspace};

#[test]
fn samples_of_real_frames_match_opencv() {
    const TEST: &str = "samples_of_real_frames_match_opencv";
    let (Some(shared), Some(python)) = (shared(TEST), python(TEST)) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("samples.yaml");
    let text = "\
experiment: samples
sources:
  train: { kind: kitti/stereo2015, with: { root: '${KITTI_STEREO_2015}', frames: [150, 155], ground_truth: none } }
stages:
  learn:
    source: train
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples:
        kind: learn/samples
        inputs: { image: source/left, target: stereo/disparity, mask: edges/mask, calibration: source/calibration, right: source/right }
        with: { size: [320, 96] }
      train: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { steps: 1, batch: 1 } }
";
    std::fs::write(&experiment, text).expect("written");
    let (out, kitti) = (folder.path().join("run"), shared.join("data/kitti_stereo_2015"));
    let mut run = depthloom();
    run.args(["run", "--no-page"]).arg(&experiment).args(["--quiet", "--out"]).arg(&out);
    succeed(run.env("KITTI_STEREO_2015", &kitti));
    let recording = Recording::open(out.join("recording.mcap")).expect("a recording");
    let samples = recording.aggregate_values().iter().find(|value| value.value_type == "samples").expect("samples");
    let RecordedContent::Attachment { name, .. } = &samples.content else { panic!("samples are an attachment") };
    let file = folder.path().join("samples.bin");
    std::fs::write(&file, recording.attachment(name).expect("their bytes")).expect("written");
    let script = workspace().join("tests/python/check_samples.py");
    let disparities = shared.join("oracle/golden/ground_plane");
    let output = succeed(Command::new(python).arg(script).arg(&file).arg(kitti.join("training")).arg(disparities));
    let printed = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(printed.contains("000150_10") && printed.contains("000155_10"), "{printed}");
}
