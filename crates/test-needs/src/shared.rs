//! The folder of reference data: real frames, golden results.

use std::path::PathBuf;

use crate::{miss, workspace};

/// The folder `DEPTHLOOM_SHARED` (relative to the root of the workspace), or `shared` next to the checkout. `None` if
/// it has no reference data: the test is then reported as skipped.
///
/// # Panics
/// Without reference data, if `DEPTHLOOM_REQUIRE_SHARED` is set.
#[must_use]
pub fn shared(test: &str) -> Option<PathBuf> {
    let named = std::env::var_os("DEPTHLOOM_SHARED").map_or_else(|| "../shared".into(), PathBuf::from);
    let folder = workspace().join(named);
    if folder.join("oracle/golden").is_dir() {
        return Some(folder);
    }
    miss("DEPTHLOOM_REQUIRE_SHARED", test, &format!("{} holds no reference data", folder.display()));
    None
}
