//! Opening and creating files in folders that others may write to: never through a link, and only regular files and
//! real folders.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::Path;

/// Creates a file that is not there. What has the name already, also a link that leads nowhere, is an error.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`], or what the system gave.
pub fn create_new(path: &Path) -> io::Result<File> {
    // `O_CREAT | O_EXCL`, which POSIX lets fail on a link, whatever it leads to.
    File::options().read(true).write(true).create_new(true).open(path)
}

/// Creates a file in place of a file or link of that name, which is removed and not opened.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`] if it is a pipe, a socket or a device; what the system gave.
pub fn create_in_place(path: &Path) -> io::Result<File> {
    refuse_special(path)?;
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => create_new(path),
    }
}

/// Refuses to replace what is neither a file nor a folder nor a link: a pipe or device.
pub(crate) fn refuse_special(path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path).map(|metadata| metadata.file_type()) {
        Ok(kind) if !kind.is_file() && !kind.is_dir() && !kind.is_symlink() => Err(not_regular()),
        _ => Ok(()),
    }
}

/// Opens a regular file for reading and writing, without following a link and without waiting for the other end of a
/// pipe.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`] if it is a pipe, a socket or a device; what the system gave, such as `ELOOP` for a
/// link.
pub fn open_regular(path: &Path) -> io::Result<File> {
    regular(File::options().read(true).write(true), path)
}

/// As [`open_regular`]; a file that is not there is created.
///
/// # Errors
/// As [`open_regular`].
pub fn open_or_create(path: &Path) -> io::Result<File> {
    regular(File::options().read(true).write(true).create(true).truncate(false), path)
}

fn regular(options: &mut OpenOptions, path: &Path) -> io::Result<File> {
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt as _;
        // Of a regular file, not to wait means nothing.
        let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::NOCTTY;
        options.custom_flags(flags.bits().cast_signed());
    }
    #[cfg(not(unix))]
    if fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_symlink()) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is a symbolic link"));
    }
    let file = options.open(path)?;
    if file.metadata()?.is_file() { Ok(file) } else { Err(not_regular()) }
}

fn not_regular() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, "it is a pipe, a socket or a device, not a regular file")
}

/// Creates a folder whose parent is there, unless it is there already. A link to a folder is not a folder.
///
/// # Errors
/// [`io::ErrorKind::NotADirectory`] if something else has the name; what the system gave.
pub fn create_folder(path: &Path) -> io::Result<()> {
    match fs::create_dir(path) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => match fs::symlink_metadata(path)?.file_type() {
            kind if kind.is_dir() => Ok(()),
            kind => {
                let what = if kind.is_symlink() { "a symbolic link" } else { "a file" };
                let what = format!("{} is {what}, not a folder", path.display());
                Err(io::Error::new(io::ErrorKind::NotADirectory, what))
            }
        },
        created => created,
    }
}

/// Whether an open file is still the one of that name.
pub(crate) fn is_named(file: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let identity = |metadata: fs::Metadata| (metadata.dev(), metadata.ino());
        let named = fs::symlink_metadata(path).map(identity);
        named.is_ok_and(|named| file.metadata().is_ok_and(|opened| identity(opened) == named))
    }
    #[cfg(not(unix))]
    {
        // A file that is open cannot be removed.
        let _ = file;
        path.exists()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::fs;
    use std::path::Path;

    #[cfg(unix)]
    pub(crate) fn make_pipe(path: &Path) {
        use rustix::fs::{CWD, FileType, Mode, mknodat};
        mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn only_regular_files_are_opened_and_no_link_is_followed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), b"years").unwrap();
        std::os::unix::fs::symlink(at("file"), at("link")).unwrap();
        std::os::unix::fs::symlink(at("nowhere"), at("dangling")).unwrap();
        make_pipe(&at("pipe"));
        assert!(super::open_regular(&at("file")).is_ok());
        for name in ["link", "dangling", "pipe", "absent"] {
            assert!(super::open_regular(&at(name)).is_err(), "{name}");
            assert_eq!(super::open_or_create(&at(name)).is_ok(), name == "absent", "{name}");
            assert!(super::create_new(&at(name)).is_err(), "{name}");
        }
        assert!(!at("nowhere").exists());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_a_folder_is_not_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real"), folder.path().join("link"));
        super::create_folder(&real).unwrap();
        super::create_folder(&real).unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        let error = super::create_folder(&link).unwrap_err().to_string();
        assert!(error.ends_with("link is a symbolic link, not a folder"), "{error}");
    }
}
