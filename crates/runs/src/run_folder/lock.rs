//! Who writes in a run's folder: one process at a time. The lock is the system's, on the open marker: a crash leaves
//! none behind.

use std::fs::{File, TryLockError};
use std::io::{self, Write as _};
use std::path::Path;

use depthloom_graphs::regular_file;
use depthloom_terminal::say;

use super::marker::is_of_0_1_0;
use crate::files::MARKER;

/// The right to write in a run's folder, until dropped.
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
    /// The marker has its name from the start, though it may not be whole yet: a folder is known by it at every moment
    /// that a kill can leave behind, and of several who mark one folder only one does.
    ///
    /// # Errors
    /// [`Refused::Busy`] if another process marked it first, or what the system gave.
    pub fn mark(folder: &Path) -> Result<Self, Refused> {
        let path = folder.join(MARKER);
        let marker = match depthloom_durable::create_new(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Err(Refused::Busy),
            opened => opened?,
        };
        // Who looks for a run that is over may have locked it by now: then the folder is theirs, and so is the marker.
        let mut lock = Self::of(marker)?;
        let written = writeln!(lock.marker, "{}", content()).and_then(|()| lock.marker.sync_all());
        match written.and_then(|()| depthloom_durable::sync_name(&path)) {
            Ok(()) => Ok(lock),
            Err(error) => {
                let _ = std::fs::remove_file(&path);
                Err(error.into())
            }
        }
    }

    /// Locks a run's folder, if nobody has.
    ///
    /// # Errors
    /// [`Refused::Busy`] if another process holds the lock, or what the system gave.
    pub fn take(folder: &Path) -> Result<Self, Refused> {
        let marker = match depthloom_durable::open_regular(&folder.join(MARKER)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound && is_of_0_1_0(folder) => return Self::mark(folder),
            opened => opened?,
        };
        let lock = Self::of(marker)?;
        // Between opening and locking the folder may have been replaced by who had it.
        if lock.is_of(folder) { Ok(lock) } else { Err(Refused::Busy) }
    }

    fn of(marker: File) -> Result<Self, Refused> {
        match marker.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(Refused::Busy),
            Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {
                say("warning: this disk knows no locks: see to it that no other process writes to the same folder");
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
/// Who asks shares a lock for that moment with others who ask, and writes nothing.
pub fn is_held(folder: &Path) -> bool {
    let asked = regular_file::open(&folder.join(MARKER)).map(|marker| marker.try_lock_shared());
    matches!(asked, Ok(Err(TryLockError::WouldBlock)))
}

fn content() -> serde_json::Value {
    serde_json::json!({ "format": "depthloom run 1", "depthloom": env!("CARGO_PKG_VERSION") })
}

/// What tells a file from every other one, whatever its name.
#[cfg(unix)]
fn identity(file: &File) -> io::Result<(u64, u64)> {
    use std::os::unix::fs::MetadataExt as _;
    let metadata = file.metadata()?;
    Ok((metadata.dev(), metadata.ino()))
}

/// As near as it comes without a file's number.
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
    fn a_folder_has_one_writer_and_a_writer_that_is_gone_leaves_no_lock() {
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
        // A folder that cannot be marked is left as it was.
        assert!(Lock::mark(&folder.path().join("none")).is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_that_replaced_the_locked_one_is_another() {
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
