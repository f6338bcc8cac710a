//! The lock of a run's folder: one process writes at a time. It is a system lock on the marker file, which a crash
//! releases.

use std::fs::{File, TryLockError};
use std::io::{self, Write as _};
use std::path::Path;

use depthloom_graphs::regular_file;
use depthloom_terminal::say;

use super::marker::is_of_0_1_0;
use crate::files::MARKER;

/// The right to write in a run's folder, until it is dropped.
#[derive(Debug)]
pub struct Lock {
    marker: File,
}

/// Why a folder cannot be locked.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// Another process writes there.
    #[error("another process is writing to it")]
    Busy,
    /// The system refused.
    #[error(transparent)]
    System(#[from] io::Error),
}

impl Lock {
    /// Marks a folder as a run's and locks it.
    ///
    /// The marker has its final name from the start, although it may not be complete yet: so a kill always leaves a
    /// folder that is recognised as a run's, and of several processes that mark one folder only one succeeds.
    ///
    /// # Errors
    /// [`Refused::Busy`] if another process marked it first, or the error of the system.
    pub fn mark(folder: &Path) -> Result<Self, Refused> {
        let path = folder.join(MARKER);
        let marker = match depthloom_durable::create_new(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Err(Refused::Busy),
            opened => opened?,
        };
        // A process that looks for finished runs may have locked the marker by now: then the folder belongs to it.
        let mut lock = Self::from_marker(marker)?;
        let written = writeln!(lock.marker, "{}", content()).and_then(|()| lock.marker.sync_all());
        match written.and_then(|()| depthloom_durable::sync_name(&path)) {
            Ok(()) => Ok(lock),
            Err(error) => {
                let _ = std::fs::remove_file(&path);
                Err(error.into())
            }
        }
    }

    /// Locks a run's folder, unless another process has.
    ///
    /// # Errors
    /// [`Refused::Busy`] if another process has the lock, or the error of the system.
    pub fn take(folder: &Path) -> Result<Self, Refused> {
        let marker = match depthloom_durable::open_regular(&folder.join(MARKER)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound && is_of_0_1_0(folder) => return Self::mark(folder),
            opened => opened?,
        };
        let lock = Self::from_marker(marker)?;
        // Between opening and locking, the previous owner may have replaced the folder.
        if lock.is_of(folder) { Ok(lock) } else { Err(Refused::Busy) }
    }

    fn from_marker(marker: File) -> Result<Self, Refused> {
        match marker.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(Refused::Busy),
            Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {
                say(
                    "warning: this file system does not support locks: make sure that no other process writes to the same folder",
                );
            }
            Err(TryLockError::Error(error)) => return Err(error.into()),
        }
        Ok(Self { marker })
    }

    /// Whether the folder under this path is still the one that was locked.
    pub fn is_of(&self, folder: &Path) -> bool {
        let identities =
            regular_file::open(&folder.join(MARKER)).and_then(|there| Ok((identity(&there)?, identity(&self.marker)?)));
        identities.is_ok_and(|(there, here)| there == here)
    }
}

/// Whether a process is writing in a run's folder at this moment.
///
/// Takes a shared lock for a moment, and writes nothing.
pub fn is_held(folder: &Path) -> bool {
    let shared = regular_file::open(&folder.join(MARKER)).map(|marker| marker.try_lock_shared());
    matches!(shared, Ok(Err(TryLockError::WouldBlock)))
}

fn content() -> serde_json::Value {
    serde_json::json!({ "format": "depthloom run 1", "depthloom": env!("CARGO_PKG_VERSION") })
}

/// The identity of a file, whatever its name.
#[cfg(unix)]
fn identity(file: &File) -> io::Result<(u64, u64)> {
    use std::os::unix::fs::MetadataExt as _;
    let metadata = file.metadata()?;
    Ok((metadata.dev(), metadata.ino()))
}

/// An approximation on systems without file numbers.
#[cfg(not(unix))]
fn identity(file: &File) -> io::Result<std::time::SystemTime> {
    file.metadata()?.created()
}

#[cfg(test)]
mod tests {
    use super::{Lock, Refused, is_held};
    use crate::files::MARKER;
    use std::fs;

    #[test]
    fn a_folder_has_one_writer_and_an_ended_writer_leaves_no_lock() {
        let folder = tempfile::tempdir().unwrap();
        let first = Lock::mark(folder.path()).unwrap();
        assert!(matches!(Lock::take(folder.path()), Err(Refused::Busy)) && is_held(folder.path()));
        drop(first);
        assert!(!is_held(folder.path()));
        let second = Lock::take(folder.path()).unwrap();
        assert!(second.is_of(folder.path()));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_is_marked_once() {
        let folder = tempfile::tempdir().unwrap();
        let first = Lock::mark(folder.path()).unwrap();
        assert!(matches!(Lock::mark(folder.path()), Err(Refused::Busy)));
        assert!(first.is_of(folder.path()));
        // A folder that cannot be marked stays unchanged.
        assert!(Lock::mark(&folder.path().join("none")).is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_that_replaced_the_locked_one_is_detected() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        fs::create_dir(&out).unwrap();
        let lock = Lock::mark(&out).unwrap();
        fs::rename(&out, folder.path().join("aside")).unwrap();
        fs::create_dir(&out).unwrap();
        fs::write(out.join(MARKER), "").unwrap();
        assert!(!lock.is_of(&out) && lock.is_of(&folder.path().join("aside")));
    }
}
