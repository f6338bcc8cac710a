//! The destination of a recording's bytes.

use std::fs::File;
use std::io::{self, ErrorKind};
use std::sync::Arc;

/// The destination of a recording's bytes: its file, or in tests a double that fails.
pub trait Disk: Send + Sync {
    /// Appends some of the bytes, at least one; returns how many.
    ///
    /// # Errors
    /// The error of the system.
    fn write(&self, bytes: &[u8]) -> io::Result<usize>;

    /// Waits until the bytes are on the disk.
    ///
    /// # Errors
    /// The error of the system.
    fn sync_data(&self) -> io::Result<()>;

    /// Waits until the bytes and the file's metadata are on the disk.
    ///
    /// # Errors
    /// The error of the system.
    fn sync_all(&self) -> io::Result<()>;
}

/// Wraps the file that a recorder opened.
pub type WrapFile<'a> = &'a dyn Fn(File) -> Arc<dyn Disk>;

impl Disk for File {
    fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        let mut file = self;
        io::Write::write(&mut file, bytes)
    }

    fn sync_data(&self) -> io::Result<()> {
        self.sync_data()
    }

    fn sync_all(&self) -> io::Result<()> {
        self.sync_all()
    }
}

pub(crate) fn itself(file: File) -> Arc<dyn Disk> {
    Arc::new(file)
}

/// Appends all bytes.
pub(crate) fn write_all(disk: &dyn Disk, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match disk.write(bytes) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(written) => bytes = &bytes[written..],
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}
