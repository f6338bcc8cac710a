//! Recordings can be read with Python's package `mcap`, and decode to the same floats.

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
    assert_eq!(theirs, ours, "Python and depthloom read the same messages");
}

#[test]
fn python_reads_recordings_with_reuse_resumption_and_recovery() {
    let test = "python_reads_recordings_with_reuse_resumption_and_recovery";
    let Some(python) = python(test) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let experiment = crate::reuse::experiment(folder.path());
    let run = |out: &str, set: &[&str]| {
        let mut run = depthloom();
        run.env_remove("DEPTHLOOM_FRESH").current_dir(folder.path()).args(["run", "--no-page", "--json", "--out", out]);
        let output = succeed(run.arg(&experiment).args(set.iter().flat_map(|set| ["--set", set])));
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        (at(out).join("recording.mcap"), report["reused"]["nodes"].as_array().map_or(0, Vec::len))
    };
    let (complete, none) = run("shelf/complete", &[]);
    let (reusing, reused_nodes) = run("shelf/reused", &["compare.fused.with.size=3"]);
    assert!(none == 0 && reused_nodes > 10, "{reused_nodes}");
    // A truncated recording, resumed and recovered.
    let bytes = std::fs::read(&complete).expect("a recording");
    let cut = at("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).expect("written");
    std::fs::create_dir_all(at("apart/resumed.partial")).expect("made");
    for name in ["depthloom-run.json", "experiment.yaml", "experiment.resolved.yaml"] {
        std::fs::copy(at("shelf/complete").join(name), at("apart/resumed.partial").join(name)).expect("copied");
    }
    std::fs::copy(&cut, at("apart/resumed.partial/recording.mcap")).expect("copied");
    let (resumed, reused_nodes) = run("apart/resumed", &[]);
    assert!(reused_nodes > 0);
    let recovered = at("recovered.mcap");
    succeed(depthloom().args(["runs", "recover", "--out"]).arg(&recovered).arg(&cut));
    for path in [complete, reusing, resumed, recovered] {
        let mut theirs = Command::new(&python);
        let theirs = succeed(theirs.arg(workspace().join("tests/python/read_recording.py")).arg(&path));
        let theirs: serde_json::Value = serde_json::from_slice(&theirs.stdout).expect("JSON");
        let ours = digest(&path);
        assert_eq!(theirs, ours, "{}", path.display());
    }
}
