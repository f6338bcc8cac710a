//! Files that are whole or not there, also after a power cut.
//!
//! A file is written under another name in its own folder, synchronised, renamed, and the folder synchronised: POSIX promises
//! that a rename replaces a name at once, and nothing of the order in which content and names reach the disk.

use std::ffi::OsString;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// The ending of a file that is not whole yet.
pub const PARTIAL: &str = "partial";

/// Writes a file with `write`, in place of whatever has its name once all of it is on the disk.
///
/// On an error the file under the final name is what it was, and nothing half-written stays beside it. Several may write one
/// file at a time, in one process or in several: each writes a file of its own, and the last to end has the name.
///
/// # Errors
/// What `write` gave, or what creating, synchronising or renaming the file gave.
pub fn write_with<E: From<io::Error>>(path: &Path, write: impl FnOnce(&mut File) -> Result<(), E>) -> Result<(), E> {
    let (partial, mut file) = own_partial(path)?;
    let written = write(&mut file).and_then(|()| {
        file.sync_all()?;
        Ok(rename(&partial, path)?)
    });
    if written.is_err() {
        // The error that is told is the first one; a file that stays costs room and nothing else.
        let _ = fs::remove_file(&partial);
    }
    written
}

/// An empty file beside `path` that no other writer has: `<path>.partial`, or a numbered one while others write that.
///
/// The lock on it goes with its writer, however that ends: so what a killed one left is in nobody's way, and is taken over.
fn own_partial(path: &Path) -> io::Result<(PathBuf, File)> {
    let mut others: u32 = 0;
    loop {
        let partial = if others == 0 { partial_name(path) } else { partial_name(&with_number(path, others)) };
        let file = File::options().create(true).truncate(false).write(true).open(&partial)?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => others += 1,
            // Its writer renamed it after it was opened here: it has its final name, and is not ours.
            Ok(()) if !is_named(&file, &partial)? => {}
            // Where the file system knows no locks, writers are not told apart.
            Ok(()) | Err(TryLockError::Error(_)) => {
                file.set_len(0)?;
                return Ok((partial, file));
            }
        }
    }
}

/// Whether an open file is still the one of that name.
fn is_named(file: &File, path: &Path) -> io::Result<bool> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let identity = |metadata: fs::Metadata| (metadata.dev(), metadata.ino());
        match fs::metadata(path) {
            Ok(named) => Ok(identity(named) == identity(file.metadata()?)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(error) => Err(error),
        }
    }
    #[cfg(not(unix))]
    {
        let _ = (file, path);
        Ok(true)
    }
}

/// Writes a file's whole content; see [`write_with`].
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

/// Synchronises a folder and all that lies in it, whoever wrote it: what a folder needs before it gets its final name.
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
            File::options().read(true).write(!cfg!(unix)).open(&path)?.sync_all()?;
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

/// The folder a path names something in.
fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// `<path>.partial`: the name a file or folder has until it is whole.
#[must_use]
pub fn partial_name(path: &Path) -> PathBuf {
    let mut name = path.file_name().map(OsString::from).unwrap_or_default();
    name.push(".");
    name.push(PARTIAL);
    path.with_file_name(name)
}

/// `<path>.<number>`.
fn with_number(path: &Path, number: u32) -> PathBuf {
    let mut name = path.file_name().map(OsString::from).unwrap_or_default();
    name.push(format!(".{number}"));
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::{self, Write as _};

    #[test]
    fn a_file_is_replaced_as_a_whole() {
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
        fs::write(below.join("teacher.onnx"), b"network").unwrap();
        super::sync_tree(folder.path()).unwrap();
        assert!(super::sync_tree(&below.join("none")).is_err());
    }

    #[test]
    fn a_write_that_fails_leaves_what_was_there_and_nothing_else() {
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
    fn fault_01_what_a_killed_writer_left_is_in_nobodys_way() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        fs::write(super::partial_name(&path), b"half of something long").unwrap();
        super::write(&path, b"whole").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
