//! A chunk read back: its records, decompressed and checked.

use std::io::ErrorKind;

use mcap::records::op;

use crate::error::RecordingError;
use crate::file::PositionedFile;
use crate::parse::{ChunkMessage, Records, chunk_head, message};
use crate::read::index::ChunkEntry;
use depthloom_codecs::compression::decompress;

/// The most a chunk may hold, uncompressed: protobuf messages end there, and no frame of a camera comes near. Writer and reader
/// keep to the same number.
pub(crate) const LARGEST_CHUNK: u64 = 1 << 31;

/// Buffers for reading chunks, reused from one to the next.
#[derive(Debug, Default)]
pub(crate) struct ChunkBuffers {
    stored: Vec<u8>,
    unpacked: Vec<u8>,
}

impl ChunkBuffers {
    /// Reads a chunk, checks it, and hands its messages over in order.
    pub(crate) fn each_message(
        &mut self,
        file: &PositionedFile,
        chunk: &ChunkEntry,
        mut take: impl FnMut(ChunkMessage<'_>) -> Result<(), String>,
    ) -> Result<(), RecordingError> {
        let damaged = |what: String| file.damaged(chunk.start, what);
        file.read_range(&mut self.stored, chunk.start, chunk.length)?;
        let Some(Ok((_, op::CHUNK, body))) = Records::new(&self.stored).next() else {
            return Err(damaged("no chunk is there".to_owned()));
        };
        let head = chunk_head(body).filter(|head| head.body_length == Some(body.len() as u64));
        let head = head.ok_or_else(|| damaged("the sizes of a chunk contradict each other".to_owned()))?;
        if head.uncompressed_size > LARGEST_CHUNK {
            let size = head.uncompressed_size;
            return Err(damaged(format!("a chunk is said to hold {size} bytes, and none holds over {LARGEST_CHUNK}")));
        }
        let stored = &body[head.length..];
        let records: &[u8] = match head.compression {
            "" => stored,
            "zstd" => {
                let size = head.uncompressed_size as usize;
                self.unpacked.clear();
                let reserved = self.unpacked.try_reserve_exact(size);
                reserved.map_err(|_| file.too_large(chunk.start, head.uncompressed_size))?;
                match decompress(stored, &mut self.unpacked) {
                    Ok(_) => {}
                    Err(error) if error.kind() == ErrorKind::OutOfMemory => {
                        return Err(file.too_large(chunk.start, head.uncompressed_size));
                    }
                    Err(error) => return Err(damaged(format!("a chunk cannot be decompressed: {error}"))),
                }
                &self.unpacked
            }
            other => return Err(damaged(format!("a chunk is compressed as `{other}`, which depthloom never does"))),
        };
        if records.len() as u64 != head.uncompressed_size || crc32fast::hash(records) != head.crc {
            return Err(damaged("a chunk's checksum differs".to_owned()));
        }
        for record in Records::new(records) {
            let (_, opcode, body) = record.map_err(|at| damaged(format!("record {at} of a chunk is cut")))?;
            if opcode == op::MESSAGE {
                let message = message(body).ok_or_else(|| damaged("a message of a chunk is cut".to_owned()))?;
                take(message).map_err(damaged)?;
            }
        }
        Ok(())
    }
}
