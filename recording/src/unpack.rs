//! A chunk read back: its records, decompressed and checked.

use mcap::records::{Record, op};

use crate::error::RecordingError;
use crate::file::PositionedFile;
use crate::index::{ChunkEntry, Records};

/// The most a chunk may say it holds: far above any frame, far below what would exhaust a machine.
const LARGEST_CHUNK: u64 = 1 << 31;

/// Buffers for reading chunks, reused from one to the next.
#[derive(Debug, Default)]
pub(crate) struct ChunkBuffers {
    stored: Vec<u8>,
    unpacked: Vec<u8>,
}

/// A message within a chunk.
pub(crate) struct ChunkMessage<'a> {
    pub(crate) channel: u16,
    pub(crate) time_ns: u64,
    pub(crate) data: &'a [u8],
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
        let parsed = mcap::parse_record(op::CHUNK, body).map_err(|error| damaged(error.to_string()))?;
        let Record::Chunk { header, data } = parsed else { return Err(damaged("no chunk is there".to_owned())) };
        if header.uncompressed_size > LARGEST_CHUNK {
            return Err(damaged(format!("a chunk is said to hold {} bytes", header.uncompressed_size)));
        }
        let records: &[u8] = match header.compression.as_str() {
            "" => &data,
            "zstd" => {
                self.unpacked.clear();
                self.unpacked.reserve(header.uncompressed_size as usize);
                let unpacked = zstd::bulk::Decompressor::new()
                    .and_then(|mut zstd| zstd.decompress_to_buffer(&data, &mut self.unpacked));
                unpacked.map_err(|error| damaged(format!("a chunk cannot be decompressed: {error}")))?;
                &self.unpacked
            }
            other => return Err(damaged(format!("a chunk is compressed as `{other}`, which depthloom never does"))),
        };
        if header.uncompressed_crc != 0 && crc32fast::hash(records) != header.uncompressed_crc {
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

fn message(body: &[u8]) -> Option<ChunkMessage<'_>> {
    let (channel, rest) = body.split_first_chunk()?;
    let (_sequence, rest) = rest.split_first_chunk::<4>()?;
    let (time_ns, rest) = rest.split_first_chunk()?;
    let (_publish_time, data) = rest.split_first_chunk::<8>()?;
    Some(ChunkMessage { channel: u16::from_le_bytes(*channel), time_ns: u64::from_le_bytes(*time_ns), data })
}
