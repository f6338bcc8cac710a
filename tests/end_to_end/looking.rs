//! Recordings opened in viewers: Rerun and Lichtblick.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use depthloom_test_needs::{Rerun, lichtblick, rerun};

use crate::reuse::experiment;
use crate::support::{depthloom, skipped, succeed, workspace};

/// Recordings of a complete run, of a run that reused another, of a run that resumed after truncation, and a recovered
/// recording.
fn recordings(folder: &Path) -> Vec<PathBuf> {
    let experiment = experiment(folder);
    let at = |name: &str| folder.join("shelf").join(name);
    let run = |out: &Path, set: &[&str]| {
        let mut run = depthloom();
        run.current_dir(folder).env_remove("DEPTHLOOM_FRESH").args(["run", "--no-page", "--quiet", "--workers", "2"]);
        run.args(["--set", "record.points=[fused, depth]", "--out"]);
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
    succeed(depthloom().args(["runs", "recover", "--out"]).arg(&recovered).arg(partial.join("recording.mcap")));
    let resumed = run(&at("resumed"), &[]);
    vec![complete, reused, resumed, recovered]
}

/// Rerun's messages about slow drawing without a graphics card. They do not concern the recording.
const SLOW: [&str; 2] = ["Software rasterizer", "PollError"];

/// Rerun's errors if it finds no usable graphics driver.
const NO_GRAPHICS: [&str; 2] = ["No graphics adapter was found", "Failed to get render context"];

/// How long to wait for a viewer, and how often to start it: on a slow machine, a picture that is late never appears.
const PATIENCE: Duration = Duration::from_secs(150);
const ATTEMPTS: usize = 3;

/// Warnings and errors that a program prints, except those about a missing graphics card.
fn complaints(command: &mut Command) -> Vec<String> {
    let output = command.output().expect("Rerun starts");
    complaints_of(command, &output)
}

/// The output of a command; `None` if it did not end within [`PATIENCE`] and was killed.
fn in_time(command: &mut Command, folder: &Path) -> Option<Output> {
    let [out, err] = ["viewer.out", "viewer.err"].map(|name| folder.join(name));
    let file = |path: &Path| File::create(path).expect("a file");
    let mut child = command.stdout(file(&out)).stderr(file(&err)).spawn().expect("Rerun starts");
    let end = Instant::now() + PATIENCE;
    let status = loop {
        match child.try_wait().expect("a child") {
            Some(status) => break status,
            None if Instant::now() > end => {
                // Python's `rerun` starts the viewer as its own child process, which would continue.
                let _ = Command::new("pkill").arg("-P").arg(child.id().to_string()).status();
                child.kill().expect("ended");
                child.wait().expect("a child");
                return None;
            }
            None => std::thread::sleep(Duration::from_millis(100)),
        }
    };
    let [stdout, stderr] = [out, err].map(|path| std::fs::read(path).expect("the output"));
    Some(Output { status, stdout, stderr })
}

fn complaints_of(command: &Command, output: &Output) -> Vec<String> {
    let printed = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() || NO_GRAPHICS.iter().any(|why| printed.contains(why)), "{command:?}: {printed}");
    let is_complaint = |line: &&str| {
        line.contains("WARN")
            || line.contains("ERROR")
            || line.contains("panicked")
            || NO_GRAPHICS.iter().any(|why| line.contains(why))
    };
    printed
        .lines()
        .filter(is_complaint)
        .filter(|line| !SLOW.iter().any(|slow| line.contains(slow)))
        .map(str::to_owned)
        .collect()
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

/// Finds faults that the loader does not: frames that two topics define, images that cannot be decoded.
#[test]
fn rerun_shows_recordings_without_a_complaint() {
    const TEST: &str = "rerun_shows_recordings_without_a_complaint";
    let Some(rerun) = rerun(TEST) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let viewer = |rerun: &Rerun, recording: &Path| {
        let shot = folder.path().join("shot.png");
        let mut viewer = rerun.viewer(TEST, folder.path())?;
        viewer.args(["--port", "0", "--screenshot-to"]).arg(&shot).arg(recording);
        let Some(output) = (0..ATTEMPTS).find_map(|_| in_time(&mut viewer, folder.path())) else {
            skipped(TEST, "Rerun's viewer drew no picture in three times 150 seconds: the machine is too slow");
            return None;
        };
        let complaints = complaints_of(&viewer, &output);
        if complaints.iter().any(|line| NO_GRAPHICS.iter().any(|why| line.contains(why))) {
            skipped(TEST, "this machine has Vulkan drivers, but none that Rerun's viewer can draw with");
            return None;
        }
        Some(complaints)
    };
    for recording in recordings(folder.path()) {
        let Some(complaints) = viewer(&rerun, &recording) else { return };
        assert_eq!(complaints, [""; 0], "{}", recording.display());
    }
}

/// Layouts of table1 for Foxglove and Rerun.
const FOXGLOVE: &str = "experiments/table1-foxglove.json";
const RERUN: &str = "experiments/table1-rerun.py";

#[test]
fn lichtblick_finds_every_calibration_and_plots_every_path() {
    let Some(mut check) = lichtblick("lichtblick_finds_every_calibration_and_plots_every_path") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let [complete, ..] = &recordings(folder.path())[..] else { panic!("recordings") };
    let checked = succeed(check.arg(complete).arg(workspace().join(FOXGLOVE)));
    let checked: serde_json::Value = serde_json::from_slice(&checked.stdout).expect("JSON");
    assert_eq!((&checked["calibrations"], &checked["plots"]), (&6.into(), &6.into()), "{checked}");
    assert!(checked["pictures"].as_u64().is_some_and(|pictures| pictures > 15), "{checked}");
}

/// Every topic that occurs in a text, quoted or in a message path.
fn topics_in(text: &str) -> Vec<&str> {
    let starts = text.match_indices(['"', '\\']).map(|(place, _)| &text[place + 1..]);
    let topics = starts.filter(|rest| rest.starts_with("/compare/") || rest.starts_with("/learn/"));
    topics.map(|rest| &rest[..rest.find(['"', '\\']).expect("a text ends")]).collect()
}

#[test]
fn every_topic_of_the_viewer_layouts_is_recorded() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    let out = folder.path().join("run");
    succeed(depthloom().args(["run", "--no-page", "--quiet", "--out"]).arg(&out).arg(&experiment));
    let bytes = std::fs::read(out.join("recording.mcap")).expect("a recording");
    let summary = mcap::Summary::read(&bytes).expect("sound").expect("a summary");
    let recorded: Vec<&str> = summary.channels.values().map(|channel| channel.topic.as_str()).collect();
    for (file, count) in [(FOXGLOVE, 24), (RERUN, 9)] {
        let text = std::fs::read_to_string(workspace().join(file)).expect("the layout");
        let topics = topics_in(&text);
        assert_eq!(topics.len(), count, "{file}: {topics:?}");
        for topic in topics {
            // In a message path, a field follows the topic if the topic is not quoted.
            let is_known = recorded.iter().any(|name| topic == *name || topic.starts_with(&format!("{name}.")));
            assert!(is_known, "{file} shows {topic}, which is not recorded");
        }
    }
}
