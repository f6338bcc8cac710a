//! Optional requirements of tests: the folder of reference data, Python with packages, ONNX Runtime,
//! Chromium, Slurm.
//!
//! Tests that need more than the reference data belong to the full suite, which runs with `DEPTHLOOM_FULL_TESTS=1`.
//!
//! A test without its requirement is skipped: it passes and prints a line to standard error, which the test harness
//! does not capture. It also [leaves a record](skips). `tests/skipped.rs`, the last program of `cargo test
//! --workspace`, counts these records. If `DEPTHLOOM_REQUIRE_SHARED`, `DEPTHLOOM_REQUIRE_PYTHON`,
//! `DEPTHLOOM_REQUIRE_CHROMIUM` or `DEPTHLOOM_REQUIRE_SLURM` is set (and not `0`), the test fails instead.

mod book;
mod chromium;
mod full;
mod lichtblick;
pub mod onnx_file;
mod python;
pub mod random;
mod rerun;
mod shared;
#[cfg(unix)]
pub mod signals;
pub mod skips;
mod slurm;

pub use book::mdbook;
pub use chromium::chromium;
pub use full::{full, is_full};
pub use lichtblick::lichtblick;
pub use python::{dora, onnx_runtime, packaging, python, python_package, system_python, viewer_client};
pub use rerun::{Rerun, rerun};
pub use shared::shared;
pub use skips::skipped;
pub use slurm::{Slurm, slurm};

use std::path::{Path, PathBuf};

/// The root of the workspace.
///
/// # Panics
/// Never: this crate is two folders below it.
#[must_use]
pub fn workspace() -> &'static Path {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.ancestors().nth(2).expect("this crate is crates/test-needs")
}

/// The folder that this test program was built into: `target`, or `CARGO_TARGET_DIR`.
///
/// # Panics
/// If this is not a test program that cargo built.
#[must_use]
pub fn target() -> PathBuf {
    let program = std::env::current_exe().expect("a running program has a path");
    // <target>/<profile>/deps/<program>
    program.ancestors().nth(3).expect("cargo puts test programs into <target>/<profile>/deps").to_owned()
}

fn is_required(variable: &str) -> bool {
    std::env::var_os(variable).is_some_and(|value| !value.is_empty() && value != "0")
}

fn miss(variable: &str, test: &str, why: &str) {
    assert!(!is_required(variable), "{test} cannot run, and {variable} is set: {why}");
    skipped(test, why);
}
