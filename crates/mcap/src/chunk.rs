//! Chunks: records that are compressed together.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind, Read};

use depthloom_codecs::compression::decompress;
use mcap::records::{ChunkHeader, ChunkIndex, op};

use crate::error::FileError;
use crate::file::PositionedFile;
use crate::record::{MESSAGE_HEADER, RECORD_HEADER, body_of, read, record_header};

/// A chunk as it is stored.
pub struct Chunk<'a> {
    /// Sizes, times and checksum of its records.
    pub header: ChunkHeader,
    stored: &'a [u8],
    file: &'a PositionedFile,
    start: u64,
}

impl<'a> Chunk<'a> {
    /// Reads a chunk of at most `most` uncompressed bytes into a buffer that is reused.
    pub fn read(
        file: &'a PositionedFile,
        (start, length): (u64, u64),
        most: u64,
        buffer: &'a mut Vec<u8>,
    ) -> Result<Self, FileError> {
        let too_long = |size: u64| {
            let (size, most) = (size.div_ceil(1 << 20), most >> 20);
            file.damaged(start, format!("a chunk of {size} MiB is expected there, and none has over {most} MiB"))
        };
        // What does not shrink by compression grows a little.
        if length > most + most / 128 + 4096 {
            return Err(too_long(length));
        }
        file.read_range(buffer, start, length)?;
        let body = body_of(op::CHUNK, buffer).ok_or_else(|| file.damaged(start, "no complete chunk is there"))?;
        let whole = (RECORD_HEADER + body.len() as u64 == length).then_some(body);
        let chunk = whole.and_then(read::<ChunkHeader>);
        let (header, stored) = chunk
            .filter(|(header, stored)| header.compressed_size == stored.len() as u64)
            .ok_or_else(|| file.damaged(start, "the sizes of a chunk contradict each other"))?;
        if header.uncompressed_size > most {
            return Err(too_long(header.uncompressed_size));
        }
        Ok(Self { header, stored, file, start })
    }

    /// Its records, checked; in a buffer that is reused if they are compressed.
    pub fn records<'b>(&self, buffer: &'b mut Vec<u8>) -> Result<&'b [u8], FileError>
    where
        'a: 'b,
    {
        let size = self.header.uncompressed_size;
        let records = if self.header.compression.is_empty() {
            self.stored
        } else {
            buffer.clear();
            buffer.try_reserve_exact(size as usize).map_err(|_| self.file.too_large(self.start, size))?;
            match self.header.compression.as_str() {
                "zstd" => decompress(self.stored, buffer),
                _ => self.decompressed()?.take(size + 1).read_to_end(buffer),
            }
            .map_err(|error| self.not_decompressed(&error))?;
            buffer
        };
        if records.len() as u64 != size {
            return Err(self.damaged(format!("a chunk of {size} bytes decompresses to {}", records.len())));
        }
        // Zero means that there is no checksum.
        if self.header.uncompressed_crc != 0 && crc32fast::hash(records) != self.header.uncompressed_crc {
            return Err(self.damaged("a chunk's checksum differs".to_owned()));
        }
        Ok(records)
    }

    /// The first `most` bytes of the messages at these places in its records, ascending; no more is decompressed than
    /// to the last.
    pub fn heads(&self, offsets: &[u64], most: usize) -> Result<Vec<Vec<u8>>, FileError> {
        const BEFORE: usize = (RECORD_HEADER + MESSAGE_HEADER) as usize;
        let mut reader = self.decompressed()?;
        let failed = |error: io::Error| self.not_decompressed(&error);
        let mut at = 0;
        let mut heads = Vec::with_capacity(offsets.len());
        for &offset in offsets {
            let between = offset.checked_sub(at).filter(|_| offset < self.header.uncompressed_size);
            let between = between.ok_or_else(|| self.no_message(offset))?;
            io::copy(&mut reader.by_ref().take(between), &mut io::sink()).map_err(failed)?;
            let mut header = [0; BEFORE];
            reader.read_exact(&mut header).map_err(failed)?;
            let length = match record_header(&header) {
                Some((op::MESSAGE, length)) => length.checked_sub(MESSAGE_HEADER),
                _ => None,
            };
            let length = length.ok_or_else(|| self.no_message(offset))?;
            let mut head = vec![0; most.min(usize::try_from(length).unwrap_or(usize::MAX))];
            reader.read_exact(&mut head).map_err(failed)?;
            at = offset + (BEFORE + head.len()) as u64;
            heads.push(head);
        }
        Ok(heads)
    }

    fn no_message(&self, offset: u64) -> FileError {
        no_message(self.file, self.start, offset)
    }

    fn decompressed(&self) -> Result<Box<dyn Read + 'a>, FileError> {
        let failed = |error: io::Error| self.not_decompressed(&error);
        Ok(match self.header.compression.as_str() {
            "" => Box::new(self.stored),
            "zstd" => Box::new(zstd::stream::read::Decoder::new(self.stored).map_err(failed)?),
            "lz4" => Box::new(lz4::Decoder::new(self.stored).map_err(failed)?),
            other => {
                let (path, compression) = (self.file.path.clone(), other.to_owned());
                return Err(FileError::Compression { path, offset: self.start, compression });
            }
        })
    }

    fn not_decompressed(&self, error: &io::Error) -> FileError {
        match error.kind() {
            ErrorKind::OutOfMemory => self.file.too_large(self.start, self.header.uncompressed_size),
            _ => self.damaged(format!("a chunk cannot be decompressed: {error}")),
        }
    }

    fn damaged(&self, what: String) -> FileError {
        self.file.damaged(self.start, what)
    }
}

/// The error that no message is at a place in the records of a chunk that starts at `start`.
#[must_use]
pub fn no_message(file: &PositionedFile, start: u64, offset: u64) -> FileError {
    let what = format!("the index names a message at byte {offset} of the chunk's records that does not exist");
    file.damaged(start, what)
}

/// The index of a chunk of that header, whose record starts at `start` and has `length` bytes; without message indexes.
#[must_use]
pub fn chunk_index(header: ChunkHeader, start: u64, length: u64) -> ChunkIndex {
    ChunkIndex {
        message_start_time: header.message_start_time,
        message_end_time: header.message_end_time,
        chunk_start_offset: start,
        chunk_length: length,
        message_index_offsets: BTreeMap::new(),
        message_index_length: 0,
        compression: header.compression,
        compressed_size: header.compressed_size,
        uncompressed_size: header.uncompressed_size,
    }
}
