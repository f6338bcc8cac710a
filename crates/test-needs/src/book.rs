//! mdBook, which renders the guide to HTML.

use std::path::PathBuf;
use std::process::Command;

use crate::{skipped, target};

/// mdBook's program in `target/tools/bin` or on the PATH. `None` without it: the test is then reported as skipped.
#[must_use]
pub fn mdbook(test: &str) -> Option<PathBuf> {
    if !crate::full(test) {
        return None;
    }
    let candidates = [target().join("tools/bin/mdbook"), PathBuf::from("mdbook")];
    let works = |program: &&PathBuf| {
        Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success())
    };
    let found = candidates.iter().find(works).cloned();
    if found.is_none() {
        skipped(test, "there is no mdbook, neither in target/tools/bin nor on the PATH (`cargo install mdbook`)");
    }
    found
}
