//! A killed run leaves a readable recording; an interrupted run finishes its frames.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::support::{depthloom, read_csv, succeed};

/// A run of `frames` small frames.
fn run(out: &Path, frames: usize) -> Command {
    let mut run = depthloom();
    run.args(["run", "--no-page", "experiments/first-look.yaml", "--workers", "2", "--out"]).arg(out);
    run.args(["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"]);
    run.args(["--set", &format!("sources.street.with.frames=0..{frames}")]);
    run
}

/// Starts a long run and waits until its recording holds some frames.
fn start(out: &Path) -> Child {
    let mut child = run(out, 100_000).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the binary starts");
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
    assert!(!out.exists(), "a killed run must not look like a finished one");
    let partial = out.with_extension("partial");
    succeed(depthloom().arg("report").arg(&partial));
    assert_report_equals_complete_run(&partial, folder.path());
}

/// Asserts that the report of an unfinished run equals the report of a complete run with the same number of frames.
fn assert_report_equals_complete_run(partial: &Path, folder: &Path) {
    let rows = read_csv(&partial.join("scores.csv"));
    let frames = rows.iter().map(|row| &row["frame"]).collect::<BTreeSet<_>>().len();
    assert!(frames > 2, "{frames} frames were recorded");
    let complete = folder.join("complete");
    succeed(&mut run(&complete, frames));
    for file in ["scores.csv", "table.csv", "error_vs_distance.csv"] {
        let read =
            |run: &Path| std::fs::read_to_string(run.join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
        assert_eq!(read(partial), read(&complete), "{file} of the {frames} recorded frames");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_finishes_its_frames_and_leaves_them_readable() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let mut child = start(&out);
    succeed(Command::new("kill").args(["-INT", &child.id().to_string()]));
    assert_eq!(child.wait().expect("ended").code(), Some(130));
    assert!(!out.exists(), "an interrupted run must not look like a finished one");
    let partial = out.with_extension("partial");
    let report = succeed(depthloom().arg("report").arg(&partial));
    assert!(
        String::from_utf8_lossy(&report.stdout).contains("note: the recording is unfinished; all numbers cover its")
    );
    assert_report_equals_complete_run(&partial, folder.path());
}
