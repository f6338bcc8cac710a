//! Recordings open with Python's own `mcap` and decode to the same floats.

use std::process::Command;

use crate::support::{depthloom, python, succeed, workspace};

#[test]
fn python_decodes_a_recording_to_the_same_floats() {
    let Some(python) = python("python_decodes_a_recording_to_the_same_floats") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    succeed(depthloom().args(["run", "experiments/first-look.yaml", "--quiet", "--out"]).arg(&out).args(small));
    let recording = out.join("recording.mcap");
    let theirs = succeed(Command::new(python).arg(workspace().join("tests/python/read_recording.py")).arg(&recording));
    let theirs: serde_json::Value = serde_json::from_slice(&theirs.stdout).expect("JSON");
    let ours = depthloom_recording::digest(&recording).expect("our own reader");
    assert_eq!(theirs, ours, "Python's and our reader see the same messages");
}
