//! Recordings in the viewers that people open them with.

use std::path::{Path, PathBuf};
use std::process::Command;

use depthloom_test_needs::{Rerun, rerun};

use crate::reuse::experiment;
use crate::support::{depthloom, skipped, succeed};

/// A recording of each kind: a complete run's, one that took from another, one taken up after its end was cut off, one recovered.
fn recordings(folder: &Path) -> Vec<PathBuf> {
    let experiment = experiment(folder);
    let at = |name: &str| folder.join("shelf").join(name);
    let run = |out: &Path, set: &[&str]| {
        let mut run = depthloom();
        run.current_dir(folder).env_remove("DEPTHLOOM_FRESH").args(["run", "--quiet", "--workers", "2", "--out"]);
        succeed(run.arg(out).arg(&experiment).args(set));
        out.join("recording.mcap")
    };
    let complete = run(&at("complete"), &[]);
    let reused = run(&at("reused"), &["--set", "compare.fused.with.size=3"]);
    let bytes = std::fs::read(&complete).expect("a recording");
    let partial = at("resumed.partial");
    std::fs::create_dir_all(partial.join("experiment")).expect("a folder");
    for name in ["depthloom-run.json", "experiment.yaml", "experiment.resolved.yaml", "experiment/table1.yaml"] {
        std::fs::copy(at("complete").join(name), partial.join(name)).expect("copied");
    }
    std::fs::write(partial.join("recording.mcap"), &bytes[..bytes.len() / 4 * 3]).expect("written");
    let recovered = folder.join("recovered.mcap");
    succeed(depthloom().args(["recover", "--out"]).arg(&recovered).arg(partial.join("recording.mcap")));
    let resumed = run(&at("resumed"), &[]);
    vec![complete, reused, resumed, recovered]
}

/// What Rerun ends with where it finds no driver that it can draw with.
const NO_GRAPHICS: [&str; 2] = ["No graphics adapter was found", "Failed to get render context"];

/// What a program says that is no news: warnings and errors, but for that of a machine without a graphics card.
fn complaints(command: &mut Command) -> Vec<String> {
    let output = command.output().expect("Rerun starts");
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() || NO_GRAPHICS.iter().any(|why| said.contains(why)), "{command:?}: {said}");
    let is_complaint = |line: &&str| {
        line.contains("WARN")
            || line.contains("ERROR")
            || line.contains("panicked")
            || NO_GRAPHICS.iter().any(|why| line.contains(why))
    };
    said.lines().filter(is_complaint).filter(|line| !line.contains("Software rasterizer")).map(str::to_owned).collect()
}

#[test]
fn rerun_loads_recordings_without_a_complaint() {
    let Some(rerun) = rerun("rerun_loads_recordings_without_a_complaint") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    for recording in recordings(folder.path()) {
        let rrd = folder.path().join("converted.rrd");
        let mut convert = rerun.command(folder.path());
        convert.args(["mcap", "convert", "--application-id", "depthloom", "--output"]).arg(&rrd).arg(&recording);
        assert_eq!(complaints(&mut convert), [""; 0], "{}", recording.display());
        let mut verify = rerun.command(folder.path());
        assert_eq!(complaints(verify.args(["rrd", "verify"]).arg(&rrd)), [""; 0], "{}", recording.display());
    }
}

/// What the loader does not see: frames that two topics define, images that cannot be decoded.
#[test]
fn rerun_shows_recordings_without_a_complaint() {
    const TEST: &str = "rerun_shows_recordings_without_a_complaint";
    let Some(rerun) = rerun(TEST) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let viewer = |rerun: &Rerun, recording: &Path| {
        let shot = folder.path().join("shot.png");
        let mut viewer = rerun.viewer(TEST, folder.path())?;
        viewer.args(["--port", "0", "--screenshot-to"]).arg(&shot).arg(recording);
        let complaints = complaints(&mut viewer);
        if complaints.iter().any(|said| NO_GRAPHICS.iter().any(|why| said.contains(why))) {
            skipped(TEST, "this machine has Vulkan drivers, but none that Rerun's viewer can draw with");
            return None;
        }
        assert!(shot.exists(), "nothing was shown");
        Some(complaints)
    };
    for recording in recordings(folder.path()) {
        let Some(complaints) = viewer(&rerun, &recording) else { return };
        assert_eq!(complaints, [""; 0], "{}", recording.display());
    }
}
