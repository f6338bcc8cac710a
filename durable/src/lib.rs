//! Files that are whole or not there, also after a power cut.
//!
//! A file is written under another name in its own folder, synchronised, renamed, and the folder synchronised: POSIX promises
//! that a rename replaces a name at once, and nothing of the order in which content and names reach the disk.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// The ending of a file that is not whole yet.
pub const PARTIAL: &str = "partial";

/// Writes a file with `write`, in place of whatever has its name once all of it is on the disk.
///
/// On an error the file under the final name is what it was, and nothing half-written stays beside it.
///
/// # Errors
/// What `write` gave, or what creating, synchronising or renaming the file gave.
pub fn write_with<E: From<io::Error>>(path: &Path, write: impl FnOnce(&mut File) -> Result<(), E>) -> Result<(), E> {
    let partial = partial_name(path);
    let mut file = File::create(&partial)?;
    let written = write(&mut file).and_then(|()| {
        file.sync_all()?;
        drop(file);
        Ok(rename(&partial, path)?)
    });
    if written.is_err() {
        // The error that is told is the first one; a file that stays costs room and nothing else.
        let _ = fs::remove_file(&partial);
    }
    written
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
}
