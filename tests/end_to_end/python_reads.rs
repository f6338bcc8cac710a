//! Recordings open with Python's own `mcap` and decode to the same floats.

use std::process::Command;

use crate::recording_digest::digest;
use crate::support::{depthloom, python, succeed, workspace};

#[test]
fn python_decodes_a_recording_to_the_same_floats() {
    let Some(python) = python("python_decodes_a_recording_to_the_same_floats") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    succeed(
        depthloom().args(["run", "--no-page", "experiments/first-look.yaml", "--quiet", "--out"]).arg(&out).args(small),
    );
    let recording = out.join("recording.mcap");
    let theirs = succeed(Command::new(python).arg(workspace().join("tests/python/read_recording.py")).arg(&recording));
    let theirs: serde_json::Value = serde_json::from_slice(&theirs.stdout).expect("JSON");
    let ours = digest(&recording);
    assert_eq!(theirs, ours, "Python's and our reader see the same messages");
}

#[test]
fn python_finds_no_fault_in_recordings_that_were_reused_taken_up_and_recovered() {
    let test = "python_finds_no_fault_in_recordings_that_were_reused_taken_up_and_recovered";
    let Some(python) = python(test) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let experiment = crate::reuse::experiment(folder.path());
    let run = |out: &str, set: &[&str]| {
        let mut run = depthloom();
        run.env_remove("DEPTHLOOM_FRESH").current_dir(folder.path()).args(["run", "--no-page", "--json", "--out", out]);
        let told = succeed(run.arg(&experiment).args(set.iter().flat_map(|set| ["--set", set])));
        let told: serde_json::Value = serde_json::from_slice(&told.stdout).expect("JSON");
        (at(out).join("recording.mcap"), told["reused"]["nodes"].as_array().map_or(0, Vec::len))
    };
    let (complete, none) = run("shelf/complete", &[]);
    let (reused, taken) = run("shelf/reused", &["compare.fused.with.size=3"]);
    assert!(none == 0 && taken > 10, "{taken}");
    // One that was killed in the middle of its frames, taken up; and what of it can be recovered.
    let bytes = std::fs::read(&complete).expect("a recording");
    let cut = at("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).expect("written");
    std::fs::create_dir_all(at("apart/taken-up.partial")).expect("made");
    for name in ["depthloom-run.json", "experiment.yaml", "experiment.resolved.yaml"] {
        std::fs::copy(at("shelf/complete").join(name), at("apart/taken-up.partial").join(name)).expect("copied");
    }
    std::fs::copy(&cut, at("apart/taken-up.partial/recording.mcap")).expect("copied");
    let (taken_up, taken) = run("apart/taken-up", &[]);
    assert!(taken > 0);
    let recovered = at("recovered.mcap");
    succeed(depthloom().args(["recover", "--out"]).arg(&recovered).arg(&cut));
    for path in [complete, reused, taken_up, recovered] {
        let mut theirs = Command::new(&python);
        let theirs = succeed(theirs.arg(workspace().join("tests/python/read_recording.py")).arg(&path));
        let theirs: serde_json::Value = serde_json::from_slice(&theirs.stdout).expect("JSON");
        let ours = digest(&path);
        assert_eq!(theirs, ours, "{}", path.display());
    }
}
