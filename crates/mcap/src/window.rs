//! Reading a file in small pieces, one after the other.

use crate::error::FileError;
use crate::file::PositionedFile;
use crate::record::{RECORD_HEADER, record_header};

/// A stretch of a file, around the place that is read.
pub struct Window<'a> {
    file: &'a PositionedFile,
    start: u64,
    bytes: Vec<u8>,
}

/// A record of a file: its kind, and the stated place of its body.
#[derive(Clone, Copy, Debug)]
pub struct RecordPlace {
    /// Its kind.
    pub opcode: u8,
    /// Where its body starts.
    pub body: u64,
    /// How many bytes its body has.
    pub length: u64,
}

impl<'a> Window<'a> {
    /// A window on a file.
    #[must_use]
    pub const fn new(file: &'a PositionedFile) -> Self {
        Self { file, start: 0, bytes: Vec::new() }
    }

    /// The bytes of a range; `None` if the file ends before.
    pub fn at(&mut self, offset: u64, length: u64) -> Result<Option<&[u8]>, FileError> {
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

    /// The record that starts at a place; `None` if the file ends before its body.
    pub fn record(&mut self, at: u64) -> Result<Option<RecordPlace>, FileError> {
        let header = self.at(at, RECORD_HEADER)?.and_then(record_header);
        Ok(header.map(|(opcode, length)| RecordPlace { opcode, body: at + RECORD_HEADER, length }))
    }
}
