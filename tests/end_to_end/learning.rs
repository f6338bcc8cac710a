//! Training does not read ground truth, survives kills, and yields the same network with any number of workers.

use std::collections::hash_map::RandomState;
use std::hash::BuildHasher;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use depthloom_recording::{RecordedContent, Recording};
use depthloom_test_needs::is_full;

use crate::support::{depthloom, succeed, workspace};

/// The number of training steps; the hermetic suite uses fewer.
pub(crate) fn steps() -> u64 {
    if is_full() { 60 } else { 24 }
}

/// A stage `learn` that takes seconds.
pub(crate) fn learn(steps: u64, checkpoint_every: u64) -> String {
    format!(
        "  learn:
    source: train
    nodes:
      stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }} }}
      edges: {{ kind: confidence/edges, inputs: {{ image: source/left }} }}
      samples:
        kind: learn/samples
        inputs: {{ image: source/left, target: stereo/disparity, mask: edges/mask, calibration: source/calibration }}
        with: {{ size: [64, 32] }}
      train:
        kind: learn/ssl
        inputs: {{ samples: samples/samples }}
        with: {{ steps: {steps}, batch: 2, curve_every: 7, checkpoint_every: {checkpoint_every} }}
"
    )
}

/// Writes an experiment with only a training stage, on a street.
pub(crate) fn street(folder: &Path, checkpoint_every: u64) -> PathBuf {
    let source = "  train: { kind: synthetic/road, with: { frames: 0..5, width: 320, height: 96, seed: 4 } }";
    let path = folder.join(format!("street-{checkpoint_every}.yaml"));
    let stage = learn(steps(), checkpoint_every);
    std::fs::write(&path, format!("experiment: street\nsources:\n{source}\nstages:\n{stage}")).expect("written");
    path
}

/// The results of training in a run: the hashes of model and samples, and the file of learning curves.
pub(crate) fn learned(out: &Path) -> (String, String, Vec<u8>) {
    let recording = Recording::open(out.join("recording.mcap")).expect("a recording");
    let hash = |value_type: &str| {
        let mut found = recording.aggregate_values().iter().filter(|value| value.value_type == value_type);
        let value = found.next().unwrap_or_else(|| panic!("no {value_type} in {}", out.display()));
        let RecordedContent::Attachment { hash, name, .. } = &value.content else {
            panic!("{value_type} is not an attachment")
        };
        assert!(!recording.attachment(name).expect("its bytes").is_empty());
        hash.to_string()
    };
    (hash("model"), hash("samples"), std::fs::read(out.join("learning_curves.csv")).expect("a curve"))
}

pub(crate) fn run(experiment: &Path, out: &Path, workers: &str) -> (String, String, Vec<u8>) {
    succeed(
        depthloom()
            .args(["run", "--no-page"])
            .arg(experiment)
            .args(["--quiet", "--workers", workers, "--out"])
            .arg(out),
    );
    learned(out)
}

#[test]
fn ground_truth_of_training_frames_does_not_change_the_network() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    let size = ["--width", "320", "--height", "96", "--frames", "4", "--seed", "3"];
    succeed(depthloom().arg("synth").arg(&data).args(size));
    // The shipped experiment table1, after a stage that trains on a data set with ground truth.
    let table1 = workspace().join("experiments/table1.yaml");
    let experiment = |ground_truth: &str| {
        let path = folder.path().join(format!("{ground_truth}.yaml"));
        let text = format!(
            "extends: {}\nexperiment: labels\nsources:\n  train: {{ kind: kitti/stereo2015, with: {{ root: data, ground_truth: {ground_truth} }} }}\n  \
             test: {{ with: {{ frames: 0..2, width: 320, height: 96 }} }}\nstages:\n{}",
            table1.display(),
            learn(10, 100),
        );
        std::fs::write(&path, text).expect("written");
        path
    };
    let run = |ground_truth: &str, out: &str| {
        let out = folder.path().join(out);
        let learned = run(&experiment(ground_truth), &out, "2");
        (learned, std::fs::read(out.join("scores.csv")).expect("scores"))
    };
    let with = run("noc", "with");
    let ground_truth = data.join("training/disp_noc_0");
    let file = |frame: u32| ground_truth.join(format!("{frame:06}_10.png"));
    // Wrong labels: every frame gets those of the next frame.
    let bytes: Vec<Vec<u8>> = (0..4).map(|frame| std::fs::read(file(frame)).expect("ground truth")).collect();
    (0..4).for_each(|frame| std::fs::write(file(frame), &bytes[(frame as usize + 1) % 4]).expect("written"));
    assert!(with == run("noc", "wrong"), "wrong ground truth of training frames changes the network");
    // No labels.
    for folder in ["disp_noc_0", "disp_occ_0"] {
        std::fs::remove_dir_all(data.join("training").join(folder)).expect("removed");
    }
    assert!(with == run("none", "without"), "ground truth of training frames changes the network");
}

#[test]
fn ground_truth_does_not_change_the_reliability() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    let size = ["--width", "320", "--height", "96", "--frames", "4", "--seed", "3"];
    succeed(depthloom().arg("synth").arg(&data).args(size));
    let run = |ground_truth: &str, out: &str, workers: &str| {
        let path = folder.path().join(format!("{ground_truth}.yaml"));
        let nodes = "
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { right: true } }
      mono: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/calibration } }";
        let inputs =
            "disparity: stereo/disparity, mono: mono/depth, calibration: source/calibration, right: stereo/right";
        let text = format!(
            "experiment: reliability
sources:
  data: {{ kind: kitti/stereo2015, with: {{ root: data, ground_truth: {ground_truth} }} }}
  street: {{ kind: synthetic/road, with: {{ frames: 0..2, width: 320, height: 96 }} }}
stages:
  trust:
    source: data
    nodes:{nodes}
      reliability: {{ kind: learn/reliability, inputs: {{ {inputs} }} }}
  fuse:
    source: street
    nodes:{nodes}
      mixture: {{ kind: fusion/mixture, inputs: {{ {inputs}, reliability: trust.reliability/reliability }} }}
    score:
      ground_truth: source/depth
      estimates: {{ mixture: {{ from: mixture/depth, deviation: mixture/deviation }} }}
"
        );
        std::fs::write(&path, text).expect("written");
        let out = folder.path().join(out);
        let mut command = depthloom();
        command
            .args(["run", "--no-page", "--fresh", "--quiet", "--workers", workers])
            .arg(&path)
            .arg("--out")
            .arg(&out);
        succeed(&mut command);
        let read = |file: &str| std::fs::read(out.join(file)).expect(file);
        (read("models/trust.reliability.json"), read("scores.csv"))
    };
    let with = run("noc", "with", "1");
    let file = |frame: u32| data.join(format!("training/disp_noc_0/{frame:06}_10.png"));
    let bytes: Vec<Vec<u8>> = (0..4).map(|frame| std::fs::read(file(frame)).expect("ground truth")).collect();
    (0..4).for_each(|frame| std::fs::write(file(frame), &bytes[(frame as usize + 1) % 4]).expect("written"));
    assert!(with == run("noc", "wrong", "8"), "wrong ground truth changes the reliability");
    assert!(with == run("none", "without", "2"), "ground truth changes the reliability");
}

#[test]
fn the_network_is_the_same_with_one_and_eight_workers() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = street(folder.path(), 100);
    let runs = ["1", "8"].map(|workers| run(&experiment, &folder.path().join(workers), workers));
    assert!(runs[0] == runs[1], "networks with 1 and 8 workers differ");
}

/// The step of the checkpoint in a folder, if there is one: it begins as a `.safetensors` file, with the progress as
/// JSON in its header.
pub(crate) fn step(checkpoints: &Path) -> Option<u64> {
    let mut files = std::fs::read_dir(checkpoints).ok()?.flatten().map(|entry| entry.path());
    let path = files.find(|path| path.extension().is_some_and(|extension| extension == "checkpoint"))?;
    let bytes = std::fs::read(path).ok()?;
    let length = u64::from_le_bytes(bytes.get(..8)?.try_into().expect("8 bytes"));
    let header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + length as usize]).expect("a complete header");
    let progress = header["__metadata__"]["progress"].as_str().expect("the progress");
    let progress: serde_json::Value = serde_json::from_str(progress).expect("JSON");
    progress["step"].as_u64()
}

/// Runs until there is a checkpoint of at least step `at`, then kills the run. Returns the step of the checkpoint,
/// which never falls below `from`.
///
/// On a loaded machine the run may finish, and remove its checkpoint, before the kill. Then this function starts again
/// from the first step.
pub(crate) fn run_and_kill(experiment: &Path, out: &Path, from: u64, at: u64) -> u64 {
    let attempts = (0..20).map(|attempt| if attempt == 0 { from } else { 0 });
    let killed = attempts.into_iter().find_map(|from| killed_at(experiment, out, from, at));
    killed.expect("one of twenty kills comes before the end of the run")
}

/// The step at which a run was killed; `None` if it finished before.
fn killed_at(experiment: &Path, out: &Path, from: u64, at: u64) -> Option<u64> {
    let checkpoints = out.with_file_name("checkpoints");
    let mut run = depthloom();
    run.args(["run", "--no-page"]).arg(experiment).args(["--quiet", "--workers", "2", "--out"]).arg(out);
    let mut child = run.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the binary starts");
    while child.try_wait().expect("a child").is_none() {
        // A file that is being replaced may be missing from a listing.
        let reached = step(&checkpoints);
        assert!(
            reached.is_none_or(|reached| reached >= from),
            "a run that resumes after step {from} is at {reached:?}"
        );
        if reached >= Some(at) {
            break;
        }
        std::thread::yield_now();
    }
    child.kill().expect("killed");
    child.wait().expect("ended");
    // The folder gets its final name when the run is finished.
    if out.exists() {
        std::fs::remove_dir_all(out).expect("removed");
        return None;
    }
    Some(step(&checkpoints).expect("a kill leaves the previous or the new checkpoint"))
}

#[test]
fn a_training_killed_three_times_yields_the_same_network() {
    let folder = tempfile::tempdir().expect("a folder");
    let alone = folder.path().join("alone");
    std::fs::create_dir(&alone).expect("a folder");
    let undisturbed = run(&street(&alone, 100), &alone.join("run"), "2");
    // The interval of checkpoints does not change the network.
    let experiment = street(folder.path(), 1);
    let random = RandomState::new();
    let points = [0_u64, 1, 2].map(|third| 1 + third * (steps() / 4) + random.hash_one(third) % (steps() / 5));
    let mut reached = 0;
    for (attempt, at) in points.into_iter().enumerate() {
        let out = folder.path().join(format!("killed-{attempt}"));
        reached = run_and_kill(&experiment, &out, reached, at);
        assert!((at..=steps()).contains(&reached), "killed at step {reached} instead of {at}");
    }
    let resumed = run(&experiment, &folder.path().join("last"), "2");
    assert!(resumed == undisturbed, "the network differs after kills at the steps {points:?}");
    assert!(!folder.path().join("checkpoints").exists(), "a finished training removes its checkpoint");
}
