//! A run that is killed leaves what it has done, readable; a run that is interrupted says where it is.

use std::path::Path;
use std::process::{Child, Stdio};

use crate::support::{depthloom, succeed};

/// Starts a long run and waits until its recording holds some frames.
fn start(out: &Path) -> Child {
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    let mut child = depthloom()
        .args(["run", "experiments/first-look.yaml", "--workers", "2", "--out"])
        .arg(out)
        .args(small)
        .args(["--set", "sources.street.with.frames=0..100000"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the binary starts");
    let recording = out.with_extension("partial").join("recording.mcap");
    while std::fs::metadata(&recording).map_or(0, |file| file.len()) < 2_000_000 {
        assert!(child.try_wait().expect("a child").is_none(), "the run ended by itself");
        std::thread::yield_now();
    }
    child
}

#[test]
fn a_killed_run_leaves_a_recording_that_can_be_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let mut child = start(&out);
    child.kill().expect("killed");
    child.wait().expect("ended");
    assert!(!out.exists(), "a killed run must not look like a whole one");
    let partial = out.with_extension("partial");
    succeed(depthloom().arg("report").arg(&partial));
    let scores = std::fs::read_to_string(partial.join("scores.csv")).expect("scores");
    assert!(scores.lines().count() > 2, "{scores}");
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_finishes_its_frames_and_says_where_they_are() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let mut child = start(&out);
    succeed(std::process::Command::new("kill").args(["-INT", &child.id().to_string()]));
    assert_eq!(child.wait().expect("ended").code(), Some(130));
    assert!(!out.exists(), "an interrupted run must not look like a whole one");
    succeed(depthloom().arg("report").arg(out.with_extension("partial")));
}
