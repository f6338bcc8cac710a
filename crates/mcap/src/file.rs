//! A file read by position, from several threads at once.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::regular_file;

use crate::error::FileError;
use crate::open_files::{FileOnDemand, OpenFiles};

/// Bytes that are appended at a time: so few that they are still in a cache when they are read, after they were
/// cleared.
const STRETCH: usize = 256 << 10;

/// A file open for reading.
#[derive(Debug)]
pub struct PositionedFile {
    /// Its path.
    pub path: PathBuf,
    /// How many bytes it had when it was opened.
    pub size: u64,
    handle: Handle,
}

#[derive(Debug)]
enum Handle {
    Open(File),
    OnDemand(FileOnDemand),
}

impl PositionedFile {
    /// Opens a regular file.
    pub fn open(path: &Path) -> Result<Self, FileError> {
        Self::open_as(path, |file| Ok(Handle::Open(file)))
    }

    /// As [`open`](Self::open), one of many files: it is closed when too many are open, and opened again when it is
    /// read. It is then at its path, or at `moved`. Otherwise reading is an error, also if another file is there.
    pub fn open_on_demand(path: &Path, files: &Arc<OpenFiles>, moved: Option<PathBuf>) -> Result<Self, FileError> {
        Self::open_as(path, |file| FileOnDemand::new(file, files, moved).map(Handle::OnDemand))
    }

    fn open_as(path: &Path, handle: impl FnOnce(File) -> io::Result<Handle>) -> Result<Self, FileError> {
        let failed = |source| FileError::Open { path: path.to_owned(), source };
        let file = regular_file::open(path).map_err(failed)?;
        let size = file.metadata().map_err(failed)?.len();
        Ok(Self { path: path.to_owned(), size, handle: handle(file).map_err(failed)? })
    }

    /// The last part of its path: folders differ between machines.
    pub fn name(&self) -> std::path::Display<'_> {
        name_of(&self.path)
    }

    /// Fills the buffer with the bytes at a position.
    pub fn read_exact(&self, buffer: &mut [u8], offset: u64) -> Result<(), FileError> {
        let read = match &self.handle {
            Handle::Open(file) => regular_file::read_exact_at(file, buffer, offset),
            Handle::OnDemand(file) => {
                file.get(&self.path).and_then(|file| regular_file::read_exact_at(&file, buffer, offset))
            }
        };
        read.map_err(|source| FileError::Read { path: self.path.clone(), offset, source })
    }

    /// The bytes of a range, in a buffer that is reused.
    pub fn read_range(&self, buffer: &mut Vec<u8>, offset: u64, length: u64) -> Result<(), FileError> {
        let bytes = self.checked(offset, length)?;
        let more = bytes.saturating_sub(buffer.len());
        buffer.try_reserve_exact(more).map_err(|_| self.too_large(offset, length))?;
        buffer.resize(bytes, 0);
        self.read_exact(buffer, offset)
    }

    /// Appends the bytes of a range to a buffer.
    pub fn append_range(&self, buffer: &mut Vec<u8>, offset: u64, length: u64) -> Result<(), FileError> {
        let (start, bytes) = (buffer.len(), self.checked(offset, length)?);
        buffer.try_reserve(bytes).map_err(|_| self.too_large(offset, length))?;
        while buffer.len() < start + bytes {
            let stretch = buffer.len()..(start + bytes).min(buffer.len() + STRETCH);
            buffer.resize(stretch.end, 0);
            self.read_exact(&mut buffer[stretch.clone()], offset + (stretch.start - start) as u64)?;
        }
        Ok(())
    }

    /// The length of a range that the file has: lengths in a damaged file can be anything, so this comes before any
    /// allocation.
    fn checked(&self, offset: u64, length: u64) -> Result<usize, FileError> {
        let end = offset.checked_add(length).filter(|end| *end <= self.size);
        end.and_then(|_| usize::try_from(length).ok()).ok_or_else(|| {
            self.damaged(offset, format!("{length} bytes are expected there, and the file has {}", self.size))
        })
    }

    /// The bytes of a range of at most `most`.
    pub fn range(&self, offset: u64, length: u64, most: u64) -> Result<Vec<u8>, FileError> {
        if self.checked(offset, length)? as u64 > most {
            let (long, most) = (length.div_ceil(1 << 20), most >> 20);
            let what = format!("a piece of {long} MiB is expected there, and it may have {most} MiB");
            return Err(self.damaged(offset, what));
        }
        let mut bytes = Vec::new();
        self.read_range(&mut bytes, offset, length)?;
        Ok(bytes)
    }

    /// The error that the bytes at a position are not what was written.
    #[must_use]
    pub fn damaged(&self, offset: u64, what: impl Into<String>) -> FileError {
        FileError::Damaged { path: self.path.clone(), offset, what: what.into() }
    }

    /// The error that the bytes at a position do not fit into memory.
    #[must_use]
    pub fn too_large(&self, offset: u64, bytes: u64) -> FileError {
        FileError::Memory { path: self.path.clone(), offset, bytes }
    }
}

/// The last part of a path.
#[must_use]
pub fn name_of(path: &Path) -> std::path::Display<'_> {
    path.file_name().map_or_else(|| path.display(), |name| Path::new(name).display())
}
