//! The full suite, and the hermetic part of it that runs by default.

use crate::{is_required, skips};

/// The environment variable that requests the full suite.
const VARIABLE: &str = "DEPTHLOOM_FULL_TESTS";

/// Whether the full suite was requested. Without it tests use no network, no Python and no browser.
#[must_use]
pub fn is_full() -> bool {
    is_required(VARIABLE)
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
