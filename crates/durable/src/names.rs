//! Names of temporary files: `.<name>.<eight hexadecimal digits>.partial`.

use std::collections::hash_map::RandomState;
use std::ffi::OsString;
use std::hash::BuildHasher as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::PARTIAL;

const DIGITS: usize = 8;

/// The most bytes that a file system takes as a name.
const LONGEST: usize = 255;

/// A random temporary name in the folder of `path`.
pub(crate) fn temporary(path: &Path) -> PathBuf {
    static CALLS: AtomicU64 = AtomicU64::new(0);
    // The keys of `RandomState` come from the system's random numbers.
    let random = RandomState::new().hash_one((std::process::id(), CALLS.fetch_add(1, Ordering::Relaxed))) as u32;
    let ending = format!(".{random:0DIGITS$x}.{PARTIAL}");
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let room = LONGEST - 1 - ending.len();
    let name = &name[..name.floor_char_boundary(room.min(name.len()))];
    path.with_file_name(OsString::from(format!(".{name}{ending}")))
}

/// The name that a temporary file was to get; `None` if it is not the name of a temporary file.
#[must_use]
pub fn final_name(temporary: &str) -> Option<&str> {
    let name = temporary.strip_prefix('.')?.strip_suffix(PARTIAL)?.strip_suffix('.')?;
    let (name, random) = name.rsplit_once('.')?;
    let is_random = random.len() == DIGITS && random.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
    (is_random && !name.is_empty()).then_some(name)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::{final_name, temporary};

    #[test]
    fn a_temporary_name_contains_the_final_one_and_is_not_predictable() {
        let [first, second] = [0, 1].map(|_| temporary(Path::new("out/table.csv")));
        assert_ne!(first, second);
        assert_eq!(first.parent(), Some(Path::new("out")));
        assert_eq!(first.file_name().and_then(|name| final_name(name.to_str()?)), Some("table.csv"));
        for other in
            ["table.csv.partial", "table.csv.1.partial", ".12345678.partial", ".x.1234567g.partial", ".x.12345678"]
        {
            assert_eq!(final_name(other), None, "{other}");
        }
    }
}
