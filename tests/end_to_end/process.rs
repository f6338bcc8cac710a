//! Nodes that are programs: their results, their cache keys, and their faults.

mod examples;
mod faults;
mod keys;
mod permission;
pub(crate) mod python;
mod replies;
mod secrets;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::{depthloom, workspace};

/// The environment variable that identifies the processes of a test.
const MARK: &str = "DEPTHLOOM_TEST_MARK";

/// A folder with the script `peer.py`, its replies, and experiments with one node that runs it.
struct Peer {
    folder: tempfile::TempDir,
}

impl Peer {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let script = workspace().join("tests/end_to_end/process/peer.py");
        std::fs::copy(script, folder.path().join("peer.py")).expect("copied");
        replies::write(folder.path());
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// An experiment whose node `own` runs this command (as YAML), with additional parameters.
    fn experiment(&self, name: &str, frames: &str, command: &str, more: &str) -> PathBuf {
        let (width, height) = if name.starts_with("shared") { replies::LARGE } else { replies::SIZE };
        let text = format!(
            "experiment: {name}\n\
             sources: {{ street: {{ kind: synthetic/road, with: {{ frames: {frames}, width: {width}, height: {height} }} }} }}\n\
             stages:\n  look:\n    source: street\n    nodes:\n      own:\n        kind: process\n\
             \x20       inputs: {{ image: source/left }}\n\
             \x20       with: {{ command: {command}, ports: {{ inputs: {{ image: image }}, outputs: {{ depth: depth }} }}, {more} }}\n\
             \x20   score: {{ ground_truth: source/depth, estimates: {{ own: {{ from: own/depth, sets: [all] }} }} }}\n"
        );
        let path = self.path(&format!("{name}.yaml"));
        std::fs::write(&path, text).expect("written");
        path
    }

    /// An experiment whose node runs the script in this mode.
    fn experiment_in_mode(&self, mode: &str, frames: &str, more: &str) -> PathBuf {
        let command = format!("[python3, peer.py, {mode}, {:?}]", self.folder.path().to_string_lossy());
        self.experiment(mode, frames, &command, more)
    }
}

/// A run with the permission to start programs.
fn run(experiment: &Path, out: &Path, mark: &str) -> Command {
    let mut command = depthloom();
    command.args(["run", "--no-page"]).arg(experiment).args(["--allow-exec", "--out"]).arg(out).env(MARK, mark);
    command
}

/// All output of a command, on one line.
fn output_of(output: &Output) -> String {
    let text = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8_lossy(&text).replace('│', " ").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The running processes of a test: number and command.
fn processes(mark: &str) -> Vec<String> {
    let variable_of_test = format!("{MARK}={mark}");
    let all = std::fs::read_dir("/proc").expect("a Linux").flatten();
    let of_test = all.filter(|process| {
        let environment = std::fs::read(process.path().join("environ")).unwrap_or_default();
        environment.split(|byte| *byte == 0).any(|variable| variable == variable_of_test.as_bytes())
    });
    of_test
        .map(|process| {
            let line = std::fs::read(process.path().join("cmdline")).unwrap_or_default();
            format!("{} {}", process.file_name().display(), String::from_utf8_lossy(&line).replace('\0', " "))
        })
        .collect()
}

/// Waits for a condition, with a time limit for slow machines.
fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let start = std::time::Instant::now();
    while !holds() {
        assert!(start.elapsed().as_secs() < 300, "not within five minutes: {what}");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
}
