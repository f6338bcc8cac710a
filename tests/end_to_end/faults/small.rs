//! Runs of `experiments/first-look.yaml` on small frames, also under other programs.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use crate::support::{depthloom, succeed, workspace};

/// Adds the arguments that run `experiments/first-look.yaml` on small frames.
pub(super) fn look(command: &mut Command, frames: &str, out: &Path) {
    let frames = format!("sources.street.with.frames={frames}");
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96", "--set", &frames];
    command
        .args(["run", "--no-page"])
        .arg(workspace().join("experiments/first-look.yaml"))
        .args(["--workers", "2"])
        .args(small);
    command.arg("--out").arg(out);
}

pub(super) fn run(frames: &str, out: &Path, arguments: &[&str]) -> Output {
    let mut command = depthloom();
    look(&mut command, frames, out);
    command.args(arguments).output().expect("the binary starts")
}

/// `depthloom` started by another program: `prlimit`, `sh`, `timeout`.
pub(super) fn under(program: &str, arguments: &[&str]) -> Command {
    let binary = depthloom();
    let mut command = Command::new(program);
    command.args(arguments).arg(binary.get_program()).current_dir(workspace());
    for (name, value) in binary.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command
}

pub(super) fn stderr_of(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The bytes of its recording that a run has written so far.
pub(super) fn recorded(out: &Path) -> u64 {
    fs::metadata(partial(out).join("recording.mcap")).map_or(0, |file| file.len())
}

pub(super) fn partial(out: &Path) -> PathBuf {
    out.with_extension("partial")
}

/// Waits for a condition while the run continues.
pub(super) fn wait(child: &mut Child, until: impl Fn() -> bool) {
    while !until() {
        assert!(child.try_wait().expect("a child").is_none(), "the run ended by itself");
        std::thread::yield_now();
    }
}

pub(super) fn send(signal: &str, child: &Child) {
    succeed(Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]));
}

/// An experiment that trains on a street.
pub(super) fn street(folder: &Path, steps: u64) -> PathBuf {
    let path = folder.join(format!("street-{steps}.yaml"));
    let text = format!(
        "experiment: street
sources:
  train: {{ kind: synthetic/road, with: {{ frames: 0..4, width: 320, height: 96, seed: 4 }} }}
stages:
  learn:
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
        with: {{ steps: {steps}, batch: 2, curve_every: 7, checkpoint_every: 2 }}
"
    );
    fs::write(&path, text).expect("written");
    path
}

/// Starts a run that takes longer than any test, and waits until it has recorded some frames.
pub(super) fn start_long(command: &mut Command, out: &Path) -> Child {
    look(command, "0..100000", out);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the binary starts");
    wait(&mut child, || recorded(out) > 1_000_000);
    child
}
