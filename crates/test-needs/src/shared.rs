//! The folder of reference data: real frames, golden results.

use std::path::PathBuf;

use crate::{miss, workspace};

/// The folder that `DEPTHLOOM_SHARED` names (a relative one from the root of the workspace), or `shared` beside the
/// checkout; `None`, and the test is skipped, where neither holds reference data.
///
/// # Panics
/// If there is none and `DEPTHLOOM_REQUIRE_SHARED` is set.
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
