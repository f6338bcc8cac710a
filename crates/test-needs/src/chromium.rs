//! Chromium, for tests of pages in a browser.

use std::path::PathBuf;

const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// A browser of Chromium's family. `None` without a browser: the test is then reported as skipped.
///
/// # Panics
/// Without a browser, if `DEPTHLOOM_REQUIRE_CHROMIUM` is set.
#[must_use]
pub fn chromium(test: &str) -> Option<PathBuf> {
    if !crate::full(test) {
        return None;
    }
    if let Some(named) = std::env::var_os("CHROMIUM").filter(|named| !named.is_empty()) {
        return Some(named.into());
    }
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()).collect();
    let found =
        NAMES.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|path| path.is_file());
    if found.is_none() {
        crate::miss("DEPTHLOOM_REQUIRE_CHROMIUM", test, "there is no Chromium in $PATH, and $CHROMIUM is not set");
    }
    found
}
