//! What a person can do where a file or folder of ours cannot be written.

use std::io::{self, ErrorKind};

/// What helps where the system refuses to write a folder of ours; `None` where nothing is known.
#[must_use]
pub fn remedy_of_writing(error: &io::Error) -> Option<&'static str> {
    match error.kind() {
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            Some("choose a folder that may be written with --out")
        }
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            Some("free some space, or choose a folder on another disk with --out")
        }
        ErrorKind::NotADirectory | ErrorKind::AlreadyExists => {
            Some("a file of that name exists where a folder is needed: choose another --out")
        }
        ErrorKind::InvalidFilename => Some("choose a shorter --out: `.partial` and the names of files come behind it"),
        _ => None,
    }
}
