//! Where a recording's bytes go.

use std::fs::File;
use std::io::{self, ErrorKind};
use std::sync::Arc;

/// Where a recording's bytes go: its file, or in tests a double of it that fails.
pub trait Disk: Send + Sync {
    /// Appends some of the bytes, at least one of them; how many.
    ///
    /// # Errors
    /// What the system refused.
    fn write(&self, bytes: &[u8]) -> io::Result<usize>;

    /// Waits until the bytes are on the disk.
    ///
    /// # Errors
    /// What the system refused.
    fn sync_data(&self) -> io::Result<()>;

    /// Waits until the bytes, and what the file system knows of the file, are on the disk.
    ///
    /// # Errors
    /// What the system refused.
    fn sync_all(&self) -> io::Result<()>;
}

/// What stands between a recorder and the file it opened.
pub type Through<'a> = &'a dyn Fn(File) -> Arc<dyn Disk>;

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

/// Appends all of the bytes.
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
