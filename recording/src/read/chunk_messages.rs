//! The messages of a chunk, decompressed and checked.

use depthloom_mcap::{Chunk, FileError, Message, PositionedFile, Records, message, op};

use crate::LARGEST_CHUNK;
use crate::read::index::ChunkEntry;

/// Buffers for reading chunks, reused for the next chunk.
#[derive(Debug, Default)]
pub(crate) struct ChunkBuffers {
    stored: Vec<u8>,
    unpacked: Vec<u8>,
}

impl ChunkBuffers {
    /// Reads a chunk, checks it, and passes its messages to `take` in order.
    pub(crate) fn each_message(
        &mut self,
        file: &PositionedFile,
        chunk: &ChunkEntry,
        mut take: impl FnMut(Message<'_>) -> Result<(), String>,
    ) -> Result<(), FileError> {
        let damaged = |what: String| file.damaged(chunk.start, what);
        let Self { stored, unpacked } = self;
        let stored = Chunk::read(file, (chunk.start, chunk.length), LARGEST_CHUNK, stored)?;
        let records = stored.records(unpacked)?;
        if stored.header.uncompressed_crc == 0 && crc32fast::hash(records) != 0 {
            return Err(damaged("a chunk has no checksum".to_owned()));
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
