//! Reads regular files up to a limit: opening a pipe would block, and a device may have no end.

use std::fs::{File, Metadata};
use std::io::{Error, ErrorKind, Read};
use std::path::Path;

/// Opens a regular file for reading.
///
/// # Errors
/// As [`read`], without a limit.
pub fn open(path: &Path) -> Result<File, Error> {
    look(path)?;
    File::open(path)
}

/// Checked before opening: opening a pipe waits for its writer.
fn look(path: &Path) -> Result<Metadata, Error> {
    let metadata = std::fs::metadata(path)?;
    if metadata.is_dir() {
        return Err(Error::new(ErrorKind::IsADirectory, "it is a folder"));
    }
    if !metadata.is_file() {
        return Err(Error::new(ErrorKind::InvalidInput, "it is not a regular file"));
    }
    Ok(metadata)
}

/// The bytes of a regular file of at most `most` bytes.
///
/// # Errors
/// Lower-case fragments without the path; [`ErrorKind::FileTooLarge`], [`ErrorKind::IsADirectory`], and
/// [`ErrorKind::InvalidInput`] for pipes, sockets and devices.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>, Error> {
    let metadata = look(path)?;
    let too_large = |bytes: u64| {
        let what = format!("it holds {} MiB, more than the {} MiB that are read", bytes.div_ceil(1 << 20), most >> 20);
        Err(Error::new(ErrorKind::FileTooLarge, what))
    };
    if metadata.len() > most {
        return too_large(metadata.len());
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(metadata.len()).unwrap_or(usize::MAX))?;
    // The file may grow, and files in `/proc` are longer than their metadata says.
    File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most { too_large(bytes.len() as u64) } else { Ok(bytes) }
}

const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// The remedy for a pointer of Git LFS.
pub const LFS_REMEDY: &str = "fetch the file with `git lfs pull` in its repository";

/// Whether the first 16 bytes or more are those of a Git LFS pointer.
pub fn is_lfs_pointer(head: &[u8]) -> bool {
    head.len() >= 16 && head.iter().zip(LFS_POINTER).all(|(a, b)| a == b)
}

/// Reads the bytes at a position.
///
/// # Errors
/// [`ErrorKind::UnexpectedEof`] where the file ends before.
#[cfg(unix)]
pub fn read_exact_at(file: &File, buffer: &mut [u8], offset: u64) -> Result<(), Error> {
    std::os::unix::fs::FileExt::read_exact_at(file, buffer, offset)
}

/// Reads the bytes at a position.
///
/// # Errors
/// [`ErrorKind::UnexpectedEof`] where the file ends before.
#[cfg(windows)]
pub fn read_exact_at(file: &File, mut buffer: &mut [u8], mut offset: u64) -> Result<(), Error> {
    while !buffer.is_empty() {
        let read = std::os::windows::fs::FileExt::seek_read(file, buffer, offset)?;
        if read == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        buffer = &mut buffer[read..];
        offset += read as u64;
    }
    Ok(())
}
