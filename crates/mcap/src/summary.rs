//! How a file begins and ends, and the summary at its end.

use mcap::records::{Footer, op};

use crate::error::FileError;
use crate::file::PositionedFile;
use crate::record::{RECORD_HEADER, Records, body_of, read};
use crate::{MAGIC, MAGIC_LENGTH};

/// How many bytes the footer has with its header, and the magic bytes after it.
pub const FOOTER: u64 = RECORD_HEADER + 20 + MAGIC_LENGTH;

/// How a file ends.
#[derive(Clone, Copy, Debug)]
pub struct FileEnd {
    /// Where the footer is, or should be.
    pub offset: u64,
    /// The footer; `None` if none is there.
    pub footer: Option<Footer>,
    /// Whether the file ends with the magic bytes.
    pub has_magic: bool,
}

/// Whether a file begins as an MCAP file does.
pub fn begins_as_mcap(file: &PositionedFile) -> Result<bool, FileError> {
    if file.size < MAGIC_LENGTH {
        return Ok(false);
    }
    let is_magic = |offset| file.range(offset, MAGIC_LENGTH, MAGIC_LENGTH).map(|bytes| bytes == MAGIC);
    match is_magic(0)? {
        false if is_magic(file.size - MAGIC_LENGTH)? => {
            Err(file.damaged(0, "it does not begin as an MCAP file, and ends as one"))
        }
        begins => Ok(begins),
    }
}

/// How a file ends; `None` if it is too short for an MCAP file that was finished.
pub fn file_end(file: &PositionedFile) -> Result<Option<FileEnd>, FileError> {
    let Some(offset) = file.size.checked_sub(FOOTER).filter(|offset| *offset >= MAGIC_LENGTH) else {
        return Ok(None);
    };
    let bytes = file.range(offset, FOOTER, FOOTER)?;
    let (record, magic) = bytes.split_at(bytes.len() - MAGIC.len());
    let footer = body_of(op::FOOTER, record).and_then(read).map(|(footer, _)| footer);
    Ok(Some(FileEnd { offset, footer, has_magic: magic == MAGIC }))
}

/// Passes the records of a summary from `start` to `end` to `each`: offset, opcode, body. They are read some at a time:
/// of a long recording they have many megabytes.
pub fn each_summary_record<E: From<FileError>>(
    file: &PositionedFile,
    (start, end): (u64, u64),
    mut each: impl FnMut(u64, u8, &[u8]) -> Result<(), E>,
) -> Result<(), E> {
    const WINDOW: u64 = 1 << 20;
    let (mut bytes, mut at, mut length) = (Vec::new(), start, WINDOW);
    while at < end {
        length = length.min(end - at);
        file.read_range(&mut bytes, at, length)?;
        let mut read = 0;
        for (offset, opcode, body) in Records::new(&bytes).map_while(Result::ok) {
            each(at + offset, opcode, body)?;
            read = offset + RECORD_HEADER + body.len() as u64;
        }
        match read {
            0 if length == end - at => return Err(file.damaged(at, "a record of the summary is cut").into()),
            // A record longer than the window.
            0 => length *= 2,
            _ => (at, length) = (at + read, WINDOW),
        }
    }
    Ok(())
}
