//! MCAP's chunks: records that are compressed together. <https://mcap.dev/spec>

use std::io::{self, Read};

use depthloom_graphs::Fault;
use mcap::records::{ChunkIndex, Record, op};

use crate::file::PositionedFile;
use crate::record;

/// Opcode and length before a record.
pub const RECORD_HEADER: usize = 9;

/// Channel, sequence and two times before a message's bytes.
pub const MESSAGE_HEADER: usize = 22;

/// The most bytes of a chunk, as stored and decompressed. Writers make them of some MB, and larger where one message is.
pub const MOST_CHUNK: u64 = 1 << 30;

/// Opcode and length of a record.
pub fn record_header(bytes: &[u8]) -> Option<(u8, u64)> {
    let (header, _) = bytes.split_first_chunk::<RECORD_HEADER>()?;
    let [opcode, length @ ..] = *header;
    Some((opcode, u64::from_le_bytes(length)))
}

/// Channel and log time of a message's header.
pub fn message_header(bytes: &[u8]) -> Option<(u16, u64)> {
    let (header, _) = bytes.split_first_chunk::<MESSAGE_HEADER>()?;
    let [c0, c1, _, _, _, _, time @ ..] = *header;
    let (time, _) = time.split_first_chunk()?;
    Some((u16::from_le_bytes([c0, c1]), u64::from_le_bytes(*time)))
}

/// A chunk as it lies, and what is said of it.
pub struct Chunk<'a> {
    file: &'a PositionedFile,
    place: &'a ChunkIndex,
    record: Vec<u8>,
}

impl<'a> Chunk<'a> {
    /// Reads a chunk.
    pub fn read(file: &'a PositionedFile, place: &'a ChunkIndex) -> Result<Self, Fault> {
        if place.uncompressed_size > MOST_CHUNK {
            let (size, most) = (place.uncompressed_size.div_ceil(1 << 20), MOST_CHUNK >> 20);
            let what = format!("a chunk is said to hold {size} MiB, more than the {most} MiB that one may");
            return Err(file.damaged(place.chunk_start_offset, what));
        }
        let record = file.range(place.chunk_start_offset, place.chunk_length, MOST_CHUNK + 4096)?;
        Ok(Self { file, place, record })
    }

    fn damaged(&self, what: impl std::fmt::Display) -> Fault {
        self.file.damaged(self.place.chunk_start_offset, what)
    }

    /// The records, decompressed as they are read; with the size and the checksum that they are said to have.
    fn open(&self) -> Result<(Box<dyn Read + '_>, u64, u32), Fault> {
        let body = match record_header(&self.record) {
            Some((op::CHUNK, length)) if length == (self.record.len() - RECORD_HEADER) as u64 => {
                &self.record[RECORD_HEADER..]
            }
            _ => return Err(self.damaged("no chunk of the length that the index says")),
        };
        let parsed = record::parse(op::CHUNK, body).ok_or_else(|| self.damaged("no whole chunk"))?;
        let Record::Chunk { header, .. } = parsed else { return Err(self.damaged("no chunk")) };
        let start = body.len() - usize::try_from(header.compressed_size).expect("it was held against the record");
        let stored = &body[start..];
        let reader: Box<dyn Read + '_> = match header.compression.as_str() {
            "" => Box::new(stored),
            "zstd" => Box::new(
                zstd::stream::read::Decoder::new(stored).map_err(|error| self.damaged("no zstd").because(error))?,
            ),
            "lz4" => Box::new(lz4::Decoder::new(stored).map_err(|error| self.damaged("no LZ4").because(error))?),
            other => {
                let what = format!("{}: a chunk is compressed as `{other}`", self.file.path.display());
                return Err(Fault::new(what)
                    .remedy("zstd, lz4 and none are read; `mcap compress` or `ros2 bag convert` writes it again"));
            }
        };
        Ok((reader, header.uncompressed_size, header.uncompressed_crc))
    }

    /// All its records. No more is taken than it is said to have.
    pub fn records(&self) -> Result<Vec<u8>, Fault> {
        let (reader, size, crc) = self.open()?;
        if size != self.place.uncompressed_size {
            let what = format!("a chunk says that it has {size} bytes, and the index {}", self.place.uncompressed_size);
            return Err(self.damaged(what));
        }
        let mut records = Vec::new();
        let read = reader.take(size + 1).read_to_end(&mut records);
        read.map_err(|error| self.damaged("a chunk cannot be decompressed").because(error))?;
        if records.len() as u64 != size {
            return Err(self.damaged(format!("a chunk of {size} bytes decompresses to {}", records.len())));
        }
        if crc != 0 && crc32fast::hash(&records) != crc {
            return Err(self.damaged("the checksum of a chunk is another one"));
        }
        Ok(records)
    }

    /// The first `most` bytes of the messages at these places in its records, ascending; no more is decompressed than to the last.
    pub fn heads(&self, offsets: &[u64], most: usize) -> Result<Vec<Vec<u8>>, Fault> {
        let (mut reader, size, _) = self.open()?;
        let mut at = 0;
        let mut heads = Vec::with_capacity(offsets.len());
        for &offset in offsets {
            let failed = |error: io::Error| self.damaged("a chunk cannot be decompressed").because(error);
            let Some(between) = offset.checked_sub(at).filter(|_| offset < size) else {
                return Err(self.no_message(offset));
            };
            io::copy(&mut reader.by_ref().take(between), &mut io::sink()).map_err(failed)?;
            let mut header = [0; RECORD_HEADER + MESSAGE_HEADER];
            reader.read_exact(&mut header).map_err(failed)?;
            let length = match record_header(&header) {
                Some((op::MESSAGE, length)) if length >= MESSAGE_HEADER as u64 => length - MESSAGE_HEADER as u64,
                _ => return Err(self.no_message(offset)),
            };
            let mut head = vec![0; most.min(usize::try_from(length).unwrap_or(usize::MAX))];
            reader.read_exact(&mut head).map_err(failed)?;
            at = offset + (header.len() + head.len()) as u64;
            heads.push(head);
        }
        Ok(heads)
    }

    fn no_message(&self, offset: u64) -> Fault {
        self.damaged(format!("the index names a message at byte {offset} of the chunk's records, and there is none"))
    }
}

/// The records in a stretch of bytes: where each starts, its opcode and its body; up to the first that is not whole.
pub struct Records<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Records<'a> {
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }
}

impl<'a> Iterator for Records<'a> {
    type Item = (u64, u8, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let rest = self.bytes.get(self.at..)?;
        let (opcode, length) = record_header(rest)?;
        let body = rest[RECORD_HEADER..].get(..usize::try_from(length).ok()?)?;
        let at = self.at as u64;
        self.at += RECORD_HEADER + body.len();
        Some((at, opcode, body))
    }
}
