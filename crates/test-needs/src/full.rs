//! The full suite, and the hermetic part of it that runs by default.

use std::fs::OpenOptions;
use std::io::Write as _;

use crate::{is_required, skips};

const VARIABLE: &str = "DEPTHLOOM_FULL_TESTS";

/// Environment variable with the path of a file that lists tests with a longer version, so that CI repeats only these.
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

/// Program and test name. The harness names each thread after its test; other threads stand for the whole program.
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
