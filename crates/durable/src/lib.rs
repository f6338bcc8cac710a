//! Files that are complete or not there, also after a power cut, and that never go where a link leads.
//!
//! A file is written under a temporary name in its own folder, synchronised, renamed, and the folder synchronised:
//! POSIX promises that a rename replaces a name at once, and nothing of the order in which content and names reach the
//! disk.
//!
//! A folder may come from a stranger, with links, pipes and devices under names that depthloom is known to use. So a
//! temporary file has a random name and is created here or not at all, a rename replaces a link instead of following
//! it, and what is opened to be locked or continued is a regular file that was reached without a link.

mod names;
mod open;
mod remedy;

use std::ffi::OsString;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

pub use names::final_name;
pub use open::{create_folder, create_in_place, create_new, open_or_create, open_regular};
pub use remedy::remedy_of_writing;

/// The ending of a file or folder that is not complete yet.
pub const PARTIAL: &str = "partial";

/// Writes a file with `write`, in place of whatever has its name once all of it is on the disk.
///
/// On an error the previous file stays, and no incomplete file remains. Several may
/// write one file at a time, in one process or in several: each writes a separate file, and the last to finish has the
/// name. A link of that name is replaced, not followed.
///
/// # Errors
/// What `write` gave, or what creating, synchronising or renaming the file gave; [`io::ErrorKind::InvalidInput`] if a
/// pipe, a socket or a device has the name.
pub fn write_with<E: From<io::Error>>(path: &Path, write: impl FnOnce(&mut File) -> Result<(), E>) -> Result<(), E> {
    open::refuse_special(path)?;
    let (temporary, mut file) = create_temporary(path)?;
    let written = write(&mut file).and_then(|()| {
        file.sync_all()?;
        Ok(rename(&temporary, path)?)
    });
    if written.is_err() {
        // The error that is reported is the first one; a file that stays costs room and nothing else.
        let _ = fs::remove_file(&temporary);
    }
    written
}

/// A new empty file next to `path`, locked: the lock distinguishes a live writer from a killed one, see
/// [`remove_abandoned`].
fn create_temporary(path: &Path) -> io::Result<(PathBuf, File)> {
    const ATTEMPTS: usize = 100;
    for _ in 0..ATTEMPTS {
        let temporary = names::temporary(path);
        let file = match create_new(&temporary) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
            created => created?,
        };
        match file.try_lock() {
            // Another process that looks for abandoned files was between creation and lock.
            Err(TryLockError::WouldBlock) => {}
            Ok(()) if !open::is_named(&file, &temporary) => {}
            // On file systems without locks, no file counts as abandoned.
            Ok(()) | Err(TryLockError::Error(_)) => return Ok((temporary, file)),
        }
    }
    Err(io::Error::new(io::ErrorKind::AlreadyExists, "no temporary name is free"))
}

/// Removes the temporary files that killed writers left in a folder. One that is being written is locked, and stays.
///
/// Nothing depends on it: what cannot be removed costs room and nothing else.
pub fn remove_abandoned(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if entry.file_name().to_str().and_then(final_name).is_some()
            && open_regular(&path).is_ok_and(|file| file.try_lock().is_ok())
        {
            let _ = fs::remove_file(&path);
        }
    }
}

/// Writes the complete content of a file; see [`write_with`].
///
/// # Errors
/// As [`write_with`].
pub fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    write_with(path, |file| io::Write::write_all(file, content))
}

/// Renames a file or folder whose content is on the disk already, and synchronises the folders that name it.
///
/// # Errors
/// What the system gave.
pub fn rename(from: &Path, to: &Path) -> io::Result<()> {
    fs::rename(from, to)?;
    sync_folder(parent(to))?;
    if parent(from) != parent(to) {
        sync_folder(parent(from))?;
    }
    Ok(())
}

/// Synchronises a folder: the names in it. Where folders cannot be opened (Windows) names need no such call.
///
/// # Errors
/// What the system gave.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

/// Synchronises a folder and all its content, whichever process wrote it. Call this before the folder gets its final
/// name.
///
/// # Errors
/// What the system gave.
pub fn sync_tree(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let (path, kind) = entry.and_then(|entry| Ok((entry.path(), entry.file_type()?)))?;
        if kind.is_dir() {
            sync_tree(&path)?;
        } else if kind.is_file() {
            // Some systems synchronise only what is open for writing.
            match File::options().read(true).write(!cfg!(unix)).open(&path) {
                // A temporary file that another process has renamed in the meantime.
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                opened => opened?.sync_all()?,
            }
        }
    }
    sync_folder(folder)
}

/// Synchronises the folder that names a file: its name is on the disk then.
///
/// # Errors
/// What the system gave.
pub fn sync_name(path: &Path) -> io::Result<()> {
    sync_folder(parent(path))
}

fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// `<path>.partial`: the name that a run's folder has until it is complete. A process that resumes one checks first
/// whose it is.
#[must_use]
pub fn partial_name(path: &Path) -> PathBuf {
    let mut name = path.file_name().map(OsString::from).unwrap_or_default();
    name.push(".");
    name.push(PARTIAL);
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::{self, Write as _};

    #[test]
    fn a_file_is_replaced_atomically() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        super::write(&path, b"before").unwrap();
        super::write(&path, b"after").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"after");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_tree_is_synchronised_whatever_is_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let below = folder.path().join("models");
        fs::create_dir(&below).unwrap();
        fs::write(below.join("train.onnx"), b"network").unwrap();
        super::sync_tree(folder.path()).unwrap();
        assert!(super::sync_tree(&below.join("none")).is_err());
    }

    #[test]
    fn a_failed_write_leaves_the_previous_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        super::write(&path, b"before").unwrap();
        let failed = super::write_with(&path, |file| {
            file.write_all(b"half of")?;
            Err::<(), _>(io::Error::other("no room"))
        });
        assert_eq!(failed.unwrap_err().to_string(), "no room");
        assert_eq!(fs::read(&path).unwrap(), b"before");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn fault_01_two_writers_of_one_file_do_not_mix() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        super::write_with(&path, |file| {
            file.write_all(b"one ")?;
            super::write(&path, b"the other, which is longer")?;
            assert_eq!(fs::read(&path)?, b"the other, which is longer");
            file.write_all(b"writer")
        })
        .unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"one writer");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn only_abandoned_temporary_files_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        let killed = super::names::temporary(&path);
        let foreign = folder.path().join("table.csv.partial");
        fs::write(&killed, b"half of something long").unwrap();
        fs::write(&foreign, b"not temporary").unwrap();
        super::write_with(&path, |file| {
            super::remove_abandoned(folder.path());
            assert!(!killed.exists() && foreign.exists());
            file.write_all(b"complete")
        })
        .unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"complete");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_long_name_can_be_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("\u{f6}".repeat(127));
        super::write(&path, b"complete").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"complete");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_replaced_and_never_followed() {
        use std::os::unix::fs::symlink;

        let folder = tempfile::tempdir().unwrap();
        let (path, precious) = (folder.path().join("table.md"), folder.path().join("precious"));
        fs::write(&precious, b"years").unwrap();
        symlink(&precious, &path).unwrap();
        symlink(&precious, super::partial_name(&path)).unwrap();
        super::write(&path, b"table").unwrap();
        assert_eq!(fs::read(&precious).unwrap(), b"years");
        assert!(!path.is_symlink());
        assert_eq!(fs::read(&path).unwrap(), b"table");
        // An abandoned file that is a link is not a temporary file of depthloom.
        symlink(&precious, super::names::temporary(&path)).unwrap();
        super::remove_abandoned(folder.path());
        assert_eq!(fs::read(&precious).unwrap(), b"years");
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.md");
        // A pipe under the name that older versions wrote to does not disturb.
        for name in ["table.md.partial", ".table.md.12345678.partial"] {
            crate::open::tests::make_pipe(&folder.path().join(name));
        }
        super::write(&path, b"table").unwrap();
        super::remove_abandoned(folder.path());
        fs::remove_file(&path).unwrap();
        crate::open::tests::make_pipe(&path);
        let error = super::write(&path, b"table").unwrap_err();
        assert_eq!(error.to_string(), "it is a pipe, a socket or a device, not a regular file");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    }
}
