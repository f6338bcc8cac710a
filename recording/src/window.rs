//! Reading a file in small pieces, one after the other.

use crate::error::RecordingError;
use crate::file::PositionedFile;

/// A stretch of the file around where the walk is.
pub(crate) struct Window<'a> {
    file: &'a PositionedFile,
    start: u64,
    bytes: Vec<u8>,
}

impl<'a> Window<'a> {
    pub(crate) const fn new(file: &'a PositionedFile) -> Self {
        Self { file, start: 0, bytes: Vec::new() }
    }

    /// The bytes of a range; `None` if the file ends before.
    pub(crate) fn at(&mut self, offset: u64, length: u64) -> Result<Option<&[u8]>, RecordingError> {
        const READ_AHEAD: u64 = 4096;
        let Some(end) = offset.checked_add(length).filter(|end| *end <= self.file.size) else { return Ok(None) };
        if offset < self.start || end > self.start + self.bytes.len() as u64 {
            let length = length.max(READ_AHEAD).min(self.file.size - offset);
            self.file.read_range(&mut self.bytes, offset, length)?;
            self.start = offset;
        }
        let from = (offset - self.start) as usize;
        Ok(Some(&self.bytes[from..from + length as usize]))
    }
}
