//! Reading a file by position, from several threads at once.

use std::fs::File;
use std::path::{Path, PathBuf};

use depthloom_graphs::regular_file;

use crate::error::RecordingError;

/// A file open for reading.
#[derive(Debug)]
pub(crate) struct PositionedFile {
    pub(crate) path: PathBuf,
    file: File,
    pub(crate) size: u64,
}

impl PositionedFile {
    pub(crate) fn open(path: &Path) -> Result<Self, RecordingError> {
        let failed = |source| RecordingError::Open { path: path.to_owned(), source };
        let file = regular_file::open(path).map_err(failed)?;
        let size = file.metadata().map_err(failed)?.len();
        Ok(Self { path: path.to_owned(), file, size })
    }

    /// Fills the buffer with the bytes at a position.
    pub(crate) fn read_exact(&self, buffer: &mut [u8], offset: u64) -> Result<(), RecordingError> {
        let read = regular_file::read_exact_at(&self.file, buffer, offset);
        read.map_err(|source| RecordingError::Read { path: self.path.clone(), offset, source })
    }

    /// The bytes of a range, in a buffer that is reused.
    ///
    /// The range is checked against the file before anything is allocated: lengths in a damaged file can be anything.
    pub(crate) fn read_range(&self, buffer: &mut Vec<u8>, offset: u64, length: u64) -> Result<(), RecordingError> {
        let end = offset.checked_add(length).filter(|end| *end <= self.size);
        let (Some(_), Ok(length)) = (end, usize::try_from(length)) else {
            return Err(self.damaged(offset, format!("{length} bytes are said to follow, the file ends before")));
        };
        let more = length.saturating_sub(buffer.len());
        buffer.try_reserve_exact(more).map_err(|_| self.too_large(offset, length as u64))?;
        buffer.resize(length, 0);
        self.read_exact(buffer, offset)
    }

    /// Appends the bytes of a range, which is one of an index.
    pub(crate) fn append_range(&self, buffer: &mut Vec<u8>, offset: u64, length: u64) -> Result<(), RecordingError> {
        let start = buffer.len();
        buffer.try_reserve(length as usize).map_err(|_| self.too_large(offset, length))?;
        buffer.resize(start + length as usize, 0);
        self.read_exact(&mut buffer[start..], offset)
    }

    pub(crate) fn too_large(&self, offset: u64, bytes: u64) -> RecordingError {
        RecordingError::Memory { path: self.path.clone(), offset, bytes }
    }

    pub(crate) fn damaged(&self, offset: u64, what: impl Into<String>) -> RecordingError {
        RecordingError::damaged(&self.path, offset, what)
    }
}
