//! Checkpoint files of aggregate nodes: locked while they are written, removed when the values are safe.

use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use depthloom_graphs::Key;
use depthloom_threads::locked;

/// The checkpoints of a run, by the key of the values they lead to.
///
/// A system lock next to each file keeps other processes away, and disappears with a killed process. Locks are held to
/// the end of the run: if it ends early, the next run needs the checkpoints of finished nodes too. After a complete run
/// call [`Checkpoints::remove`]; a drop keeps the files.
#[derive(Clone, Debug, Default)]
pub struct Checkpoints(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    folder: Option<PathBuf>,
    locks: Mutex<BTreeMap<Key, Lock>>,
}

#[derive(Debug)]
struct Lock {
    _file: File,
    /// Whether a node is using it now.
    in_use: bool,
}

#[derive(Debug)]
pub(crate) enum Refused {
    /// By another process, or by another node of this one.
    InUse,
    Io(io::Error),
}

impl Checkpoints {
    /// The folder is created with the first checkpoint; without a folder, no checkpoints are written.
    pub(crate) fn new(folder: Option<PathBuf>) -> Self {
        Self(Arc::new(Shared { folder, locks: Mutex::default() }))
    }

    /// The file for a key, until [`Checkpoints::release`]; `None` without a folder.
    pub(crate) fn take(&self, key: &Key) -> Result<Option<PathBuf>, Refused> {
        let Some(folder) = &self.0.folder else { return Ok(None) };
        let mut locks = locked(&self.0.locks);
        if let Some(lock) = locks.get_mut(key) {
            if lock.in_use {
                return Err(Refused::InUse);
            }
            lock.in_use = true;
        } else {
            let file = lock(folder, key)?;
            locks.insert(*key, Lock { _file: file, in_use: true });
        }
        Ok(Some(file_of(folder, key)))
    }

    pub(crate) fn release(&self, key: &Key) {
        if let Some(lock) = locked(&self.0.locks).get_mut(key) {
            lock.in_use = false;
        }
    }

    /// Removes the files, whose values are safe, and the folder with the last one.
    pub fn remove(self) {
        let Some(folder) = &self.0.folder else { return };
        for key in locked(&self.0.locks).keys() {
            // A checkpoint that stays only costs space.
            let _ = fs::remove_file(file_of(folder, key));
        }
    }
}

/// Removes the locks, and the folder if it is empty.
impl Drop for Shared {
    fn drop(&mut self) {
        let Some(folder) = &self.folder else { return };
        let locks = self.locks.get_mut().unwrap_or_else(std::sync::PoisonError::into_inner);
        for key in locks.keys() {
            // Removed while it is locked: a process that opened it before notices that the name is gone, and creates
            // another.
            let _ = fs::remove_file(lock_of(folder, key));
        }
        if !locks.is_empty() {
            locks.clear();
            let _ = fs::remove_dir(folder);
        }
    }
}

fn file_of(folder: &Path, key: &Key) -> PathBuf {
    folder.join(format!("{key}.checkpoint"))
}

fn lock_of(folder: &Path, key: &Key) -> PathBuf {
    folder.join(format!("{key}.lock"))
}

fn lock(folder: &Path, key: &Key) -> Result<File, Refused> {
    let path = lock_of(folder, key);
    // Another process may remove the folder or the file between two of these calls: then they are created again.
    for _ in 0..100 {
        fs::create_dir_all(folder).map_err(Refused::Io)?;
        let file = match depthloom_durable::open_or_create(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            Err(error) => return Err(Refused::Io(error)),
        };
        match file.try_lock() {
            Ok(()) if has_this_name(&file, &path) => return Ok(file),
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(Refused::InUse),
            Err(TryLockError::Error(error)) => return Err(Refused::Io(error)),
        }
    }
    Err(Refused::InUse)
}

/// Whether the path still names the opened file.
fn has_this_name(file: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let same = |a: &fs::Metadata, b: &fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
        matches!((file.metadata(), fs::metadata(path)), (Ok(opened), Ok(named)) if same(&opened, &named))
    }
    #[cfg(not(unix))]
    {
        // A file that is open cannot be removed.
        let _ = file;
        path.exists()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use depthloom_graphs::Key;

    use super::{Checkpoints, Refused};

    #[test]
    fn fault_05_a_checkpoint_has_one_writer_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let at = || Checkpoints::new(Some(folder.path().join("checkpoints")));
        let (key, other) = (Key::of_content(b"a training"), Key::of_content(b"another"));
        let (first, second) = (at(), at());
        let path = first.take(&key).unwrap().unwrap();
        assert!(matches!(second.take(&key), Err(Refused::InUse)), "another process");
        assert!(matches!(first.take(&key), Err(Refused::InUse)), "another node of this process");
        assert_ne!(second.take(&other).unwrap(), Some(path.clone()));
        fs::write(&path, b"half way").unwrap();
        first.release(&key);
        assert!(matches!(second.take(&key), Err(Refused::InUse)), "it is locked until the run is complete");
        assert_eq!(first.take(&key).unwrap(), Some(path.clone()));
        drop(first);
        // An interrupted run leaves the file, but not the lock.
        assert_eq!(second.take(&key).unwrap(), Some(path.clone()));
        assert_eq!(fs::read(&path).unwrap(), b"half way");
        second.remove();
        assert!(!folder.path().join("checkpoints").exists());
    }

    #[test]
    fn without_a_folder_nothing_is_kept() {
        assert!(Checkpoints::default().take(&Key::of_content(b"a training")).unwrap().is_none());
    }
}
