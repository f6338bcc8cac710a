//! The full suite, and the hermetic part of it that runs by default.

use std::fs::OpenOptions;
use std::io::Write as _;

use crate::{is_required, skips};

/// The environment variable that requests the full suite.
const VARIABLE: &str = "DEPTHLOOM_FULL_TESTS";

/// The environment variable that names a file: tests that would do more in the full suite are listed there, so that CI runs only these again.
const LIST: &str = "DEPTHLOOM_LIST_FULL_TESTS";

/// Whether the full suite was requested. Without it tests use no network, no Python and no browser.
///
/// # Panics
/// If the test cannot be added to the list that `DEPTHLOOM_LIST_FULL_TESTS` names.
#[must_use]
pub fn is_full() -> bool {
    let is_full = is_required(VARIABLE);
    if !is_full && let Some(list) = std::env::var_os(LIST) {
        let mut list =
            OpenOptions::new().create(true).append(true).open(list).expect("the list of tests can be opened");
        // One write, so that lines of several programs do not mix.
        list.write_all(line().as_bytes()).expect("the list of tests can be written");
    }
    is_full
}

/// The program and the test that ask: the harness runs each test in a thread of its name. A program without a harness, or a thread of a
/// test's own, stands for the whole program: no test after the tabulator.
fn line() -> String {
    let program = std::env::current_exe().expect("a running program has a path");
    let stem = program.file_stem().unwrap_or_default().to_string_lossy();
    // <name>-<hash>
    let name = stem.rsplit_once('-').map_or(&*stem, |(name, _)| name);
    let thread = std::thread::current();
    let test = thread.name().filter(|name| *name != "main").unwrap_or_default();
    format!("{name}\t{test}\n")
}

/// Whether a test of the full suite runs. If the full suite was not requested, the test is skipped.
///
/// # Panics
/// If the record of the skipped test cannot be written.
#[must_use]
pub fn full(test: &str) -> bool {
    if !is_full() {
        skips::skipped(test, &format!("it is part of the full suite: {VARIABLE}=1"));
    }
    is_full()
}
