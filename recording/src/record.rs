//! MCAP records, appended to a buffer. <https://mcap.dev/spec>
//!
//! Reading them is left to the `mcap` crate; it writes no chunks that somebody else has compressed, so writing is done here.

use std::collections::BTreeMap;

use crc32fast::Hasher;
use mcap::records::op;

/// Appends a record whose body `body` appends.
pub(crate) fn put_record(out: &mut Vec<u8>, opcode: u8, body: impl FnOnce(&mut Vec<u8>)) {
    out.push(opcode);
    let length_at = out.len();
    out.extend_from_slice(&[0; 8]);
    body(out);
    let length = (out.len() - length_at - 8) as u64;
    out[length_at..length_at + 8].copy_from_slice(&length.to_le_bytes());
}

fn put_text(out: &mut Vec<u8>, text: &str) {
    out.extend_from_slice(&(text.len() as u32).to_le_bytes());
    out.extend_from_slice(text.as_bytes());
}

fn put_text_map(out: &mut Vec<u8>, map: &BTreeMap<String, String>) {
    let bytes: usize = map.iter().map(|(key, value)| 8 + key.len() + value.len()).sum();
    out.extend_from_slice(&(bytes as u32).to_le_bytes());
    for (key, value) in map {
        put_text(out, key);
        put_text(out, value);
    }
}

pub(crate) fn put_header(out: &mut Vec<u8>, library: &str) {
    put_record(out, op::HEADER, |out| {
        put_text(out, "");
        put_text(out, library);
    });
}

pub(crate) fn put_schema(out: &mut Vec<u8>, id: u16, name: &str, data: &[u8]) {
    put_record(out, op::SCHEMA, |out| {
        out.extend_from_slice(&id.to_le_bytes());
        put_text(out, name);
        put_text(out, "protobuf");
        out.extend_from_slice(&(data.len() as u32).to_le_bytes());
        out.extend_from_slice(data);
    });
}

pub(crate) fn put_channel(out: &mut Vec<u8>, id: u16, schema: u16, topic: &str, metadata: &BTreeMap<String, String>) {
    put_record(out, op::CHANNEL, |out| {
        out.extend_from_slice(&id.to_le_bytes());
        out.extend_from_slice(&schema.to_le_bytes());
        put_text(out, topic);
        put_text(out, "protobuf");
        put_text_map(out, metadata);
    });
}

/// Appends a message whose data `data` appends.
pub(crate) fn put_message(
    out: &mut Vec<u8>,
    channel: u16,
    sequence: u32,
    time_ns: u64,
    data: impl FnOnce(&mut Vec<u8>),
) {
    put_record(out, op::MESSAGE, |out| {
        out.extend_from_slice(&channel.to_le_bytes());
        out.extend_from_slice(&sequence.to_le_bytes());
        out.extend_from_slice(&time_ns.to_le_bytes());
        out.extend_from_slice(&time_ns.to_le_bytes());
        data(out);
    });
}

/// Appends where a chunk's messages of a channel are: time and offset of each.
pub(crate) fn put_message_index(out: &mut Vec<u8>, channel: u16, messages: &[(u64, u64)]) {
    put_record(out, op::MESSAGE_INDEX, |out| {
        out.extend_from_slice(&channel.to_le_bytes());
        out.extend_from_slice(&(messages.len() as u32 * 16).to_le_bytes());
        for (time_ns, offset) in messages {
            out.extend_from_slice(&time_ns.to_le_bytes());
            out.extend_from_slice(&offset.to_le_bytes());
        }
    });
}

/// Where a chunk lies, for the summary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChunkPlace {
    /// Where its record starts.
    pub(crate) start: u64,
    /// How many bytes the record has.
    pub(crate) length: u64,
    /// The first and last time of its messages, nanoseconds.
    pub(crate) times_ns: (u64, u64),
    /// Where the message indexes of its channels start, by channel.
    pub(crate) indexes: Vec<(u16, u64)>,
    /// How many bytes the message indexes have.
    pub(crate) indexes_length: u64,
    pub(crate) compression: &'static str,
    pub(crate) compressed_size: u64,
    pub(crate) uncompressed_size: u64,
}

/// Appends the index of a chunk that lies `base` bytes farther than it says.
pub(crate) fn put_chunk_index(out: &mut Vec<u8>, base: u64, chunk: &ChunkPlace) {
    put_record(out, op::CHUNK_INDEX, |out| {
        for number in [chunk.times_ns.0, chunk.times_ns.1, base + chunk.start, chunk.length] {
            out.extend_from_slice(&number.to_le_bytes());
        }
        out.extend_from_slice(&(chunk.indexes.len() as u32 * 10).to_le_bytes());
        for (channel, offset) in &chunk.indexes {
            out.extend_from_slice(&channel.to_le_bytes());
            out.extend_from_slice(&(base + offset).to_le_bytes());
        }
        out.extend_from_slice(&chunk.indexes_length.to_le_bytes());
        put_text(out, chunk.compression);
        out.extend_from_slice(&chunk.compressed_size.to_le_bytes());
        out.extend_from_slice(&chunk.uncompressed_size.to_le_bytes());
    });
}

/// Appends an attachment, with its checksum. Its times are zero: equal runs are equal files.
pub(crate) fn put_attachment(out: &mut Vec<u8>, name: &str, media_type: &str, data: &[u8]) {
    put_record(out, op::ATTACHMENT, |out| {
        let start = out.len();
        out.extend_from_slice(&[0; 16]);
        put_text(out, name);
        put_text(out, media_type);
        out.extend_from_slice(&(data.len() as u64).to_le_bytes());
        out.extend_from_slice(data);
        let crc = crc32fast::hash(&out[start..]);
        out.extend_from_slice(&crc.to_le_bytes());
    });
}

pub(crate) fn put_attachment_index(
    out: &mut Vec<u8>,
    offset: u64,
    length: u64,
    data_size: u64,
    name: &str,
    media_type: &str,
) {
    put_record(out, op::ATTACHMENT_INDEX, |out| {
        for number in [offset, length, 0, 0, data_size] {
            out.extend_from_slice(&number.to_le_bytes());
        }
        put_text(out, name);
        put_text(out, media_type);
    });
}

pub(crate) fn put_metadata(out: &mut Vec<u8>, name: &str, metadata: &BTreeMap<String, String>) {
    put_record(out, op::METADATA, |out| {
        put_text(out, name);
        put_text_map(out, metadata);
    });
}

pub(crate) fn put_metadata_index(out: &mut Vec<u8>, offset: u64, length: u64, name: &str) {
    put_record(out, op::METADATA_INDEX, |out| {
        out.extend_from_slice(&offset.to_le_bytes());
        out.extend_from_slice(&length.to_le_bytes());
        put_text(out, name);
    });
}

/// What the statistics record counts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    pub(crate) schemas: u16,
    pub(crate) channels: u32,
    pub(crate) attachments: u32,
    pub(crate) metadata: u32,
    pub(crate) chunks: u32,
    /// The first and last time of a message, nanoseconds.
    pub(crate) times_ns: Option<(u64, u64)>,
    /// Messages by channel.
    pub(crate) messages: BTreeMap<u16, u64>,
}

pub(crate) fn put_statistics(out: &mut Vec<u8>, counts: &Counts) {
    put_record(out, op::STATISTICS, |out| {
        let (first, last) = counts.times_ns.unwrap_or_default();
        out.extend_from_slice(&counts.messages.values().sum::<u64>().to_le_bytes());
        out.extend_from_slice(&counts.schemas.to_le_bytes());
        for count in [counts.channels, counts.attachments, counts.metadata, counts.chunks] {
            out.extend_from_slice(&count.to_le_bytes());
        }
        out.extend_from_slice(&first.to_le_bytes());
        out.extend_from_slice(&last.to_le_bytes());
        out.extend_from_slice(&(counts.messages.len() as u32 * 10).to_le_bytes());
        for (channel, messages) in &counts.messages {
            out.extend_from_slice(&channel.to_le_bytes());
            out.extend_from_slice(&messages.to_le_bytes());
        }
    });
}

pub(crate) fn put_summary_offset(out: &mut Vec<u8>, opcode: u8, start: u64, length: u64) {
    put_record(out, op::SUMMARY_OFFSET, |out| {
        out.push(opcode);
        out.extend_from_slice(&start.to_le_bytes());
        out.extend_from_slice(&length.to_le_bytes());
    });
}

pub(crate) fn put_data_end(out: &mut Vec<u8>, crc: u32) {
    put_record(out, op::DATA_END, |out| out.extend_from_slice(&crc.to_le_bytes()));
}

/// Appends the footer to the end of a summary section, whose checksum it holds; `before` is that of what comes before this end.
pub(crate) fn put_footer(summary: &mut Vec<u8>, before: Hasher, summary_start: u64, offsets_start: u64) {
    put_record(summary, op::FOOTER, |out| {
        out.extend_from_slice(&summary_start.to_le_bytes());
        out.extend_from_slice(&offsets_start.to_le_bytes());
        // The checksum covers the footer's opcode and length too; the length is filled in only after this returns.
        let length_at = out.len() - 16 - 8;
        out[length_at..length_at + 8].copy_from_slice(&20_u64.to_le_bytes());
        let mut crc = before;
        crc.update(out);
        out.extend_from_slice(&crc.finalize().to_le_bytes());
    });
}
