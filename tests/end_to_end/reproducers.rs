//! The reproducers of the review of 2026-11-23: results that were silently wrong now equal those of a fresh run, or the
//! run is refused with a reason.

mod exchange;
mod keys;
mod names;
mod ordered;
mod resume;

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use image::{GrayImage, Luma};

use crate::process::python::path_of;
use crate::support::{depthloom, python_package};

/// The files that are compared between a run and a fresh one.
const REPORTED: [&str; 5] =
    ["scores.csv", "table.csv", "error_vs_distance.csv", "true_distances.csv", "recording.mcap"];

/// A folder with experiments, their files and their runs.
struct Case {
    folder: tempfile::TempDir,
    /// The PATH on which `python3` has the package `depthloom`.
    path: Option<OsString>,
}

impl Case {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a folder"), path: None }
    }

    /// A case with Python nodes; `None` without Python, and the test is reported as skipped.
    fn with_python(test: &str) -> Option<Self> {
        let python = python_package(test)?;
        Some(Self { path: Some(path_of(&python)), ..Self::new() })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().expect("a parent folder")).expect("made");
        fs::write(path, content).expect("written");
    }

    /// Writes a textured image, shifted to the left.
    fn write_image(&self, name: &str, seed: u32, shift: u32) {
        let texture = |x: u32, y: u32| {
            let mixed = (y * 4096 + x + shift + seed * 77_777).wrapping_mul(2_654_435_761);
            Luma([((mixed ^ (mixed >> 15)).wrapping_mul(2_246_822_519) >> 24) as u8])
        };
        self.write(name, "");
        GrayImage::from_fn(64, 32, texture).save(self.path(name)).expect("written");
    }

    /// Runs an experiment, which may fail.
    fn attempt(&self, experiment: &str, out: &str, more: &[&str]) -> Output {
        self.command(experiment, out, more).output().expect("the program starts")
    }

    fn command(&self, experiment: &str, out: &str, more: &[&str]) -> Command {
        let mut command = depthloom();
        command.current_dir(self.folder.path()).env_remove("DEPTHLOOM_FRESH");
        command.args(["run", "--no-page", experiment, "--quiet", "--allow-exec", "--out", out]).args(more);
        if let Some(path) = &self.path {
            command.env("PATH", path).env("PYTHONDONTWRITEBYTECODE", "1");
        }
        command
    }

    /// The program with the case's folder as working folder.
    fn depthloom(&self, arguments: &[&str]) -> Command {
        let mut command = depthloom();
        command.current_dir(self.folder.path()).env_remove("DEPTHLOOM_FRESH").args(arguments);
        command
    }

    /// Runs an experiment, which must succeed.
    fn run(&self, experiment: &str, out: &str, more: &[&str]) {
        let output = self.attempt(experiment, out, more);
        assert!(output.status.success(), "{experiment}: {}", stderr_of(&output));
    }

    /// Runs an experiment, which must succeed with the results of a fresh run.
    fn run_as_fresh(&self, experiment: &str, out: &str, more: &[&str]) {
        self.run(experiment, out, more);
        self.assert_as_fresh(experiment, out, more);
    }

    /// Asserts that recording, scores and errors of a run equal those of a fresh one.
    fn assert_as_fresh(&self, experiment: &str, out: &str, more: &[&str]) {
        self.assert_files_as_fresh(experiment, out, more, &REPORTED);
    }

    /// Asserts that these files of a run equal those of a fresh one.
    fn assert_files_as_fresh(&self, experiment: &str, out: &str, more: &[&str], files: &[&str]) {
        let fresh = format!("fresh/{out}");
        self.run(experiment, &fresh, &[more, &["--fresh"]].concat());
        for file in files {
            assert!(
                self.read(out, file) == self.read(&fresh, file),
                "{experiment}: {file} differs from that of --fresh"
            );
        }
    }

    /// Asserts that a run equals a fresh one, or is refused with a reason before its first frame. Returns whether it
    /// was accepted.
    fn run_as_fresh_or_refused(&self, experiment: &str, out: &str) -> bool {
        let output = self.attempt(experiment, out, &[]);
        if output.status.success() {
            self.assert_as_fresh(experiment, out, &[]);
            return true;
        }
        assert_eq!(output.status.code(), Some(2), "{}", stderr_of(&output));
        assert!(stderr_of(&output).contains("error: "), "{}", stderr_of(&output));
        false
    }

    fn read(&self, out: &str, file: &str) -> Option<Vec<u8>> {
        fs::read(self.path(out).join(file)).ok()
    }

    /// Turns a finished run into one of a killed process: the recording ends after this share of its bytes.
    fn interrupt(&self, out: &str, share: f64) {
        let partial = self.path(&format!("{out}.partial"));
        fs::rename(self.path(out), &partial).expect("renamed");
        for report in ["scores.csv", "scores.parquet", "table.csv", "table.parquet", "table.md", "table.tex"] {
            let _ = fs::remove_file(partial.join(report));
        }
        let recording = fs::File::options().write(true).open(partial.join("recording.mcap")).expect("a recording");
        let bytes = recording.metadata().expect("a length").len();
        recording.set_len((bytes as f64 * share) as u64).expect("cut");
    }
}

/// Standard error of a command.
fn stderr_of(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The content of a file as text.
fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}
