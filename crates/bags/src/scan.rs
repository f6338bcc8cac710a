//! An MCAP file record by record: what a writer that was cut off left, or one that keeps no index. Messages are stepped over.

use std::collections::BTreeMap;

use depthloom_graphs::Fault;
use mcap::records::{ChunkIndex, Record, op};

use crate::chunks::{Chunk, MESSAGE_HEADER, RECORD_HEADER, Records, message_header, record_header};
use crate::file::PositionedFile;
use crate::mcap_index::{Channel, Index, Loose, MAGIC, Unindexed, Warning};
use crate::record;

/// The most bytes of a schema or a channel.
const MOST_RECORD: u64 = 16 << 20;

/// Bytes of a chunk before its compression's name.
const BEFORE_COMPRESSION: usize = 32;

/// The most bytes of that name.
const MOST_NAME: usize = 64;

/// Schemas and channels, whichever comes first.
#[derive(Default)]
pub struct Known {
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, (u16, Channel)>,
}

impl Known {
    /// Takes note of a schema or a channel.
    pub fn take(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(of) => {
                let channel = Channel { topic: of.topic, message_type: String::new(), encoding: of.message_encoding };
                self.channels.insert(of.id, (of.schema_id, channel));
            }
            _ => {}
        }
    }

    /// All channels, with their schemas' names.
    pub fn channels(self) -> impl Iterator<Item = (u16, Channel)> {
        let Self { schemas, channels } = self;
        channels.into_iter().map(move |(id, (schema, channel))| {
            let message_type = schemas.get(&schema).cloned().unwrap_or_default();
            (id, Channel { message_type, ..channel })
        })
    }
}

/// The index of a file, from a look at every record.
pub fn scan(file: &PositionedFile) -> Result<Index, Fault> {
    let mut index = Index::default();
    let mut known = Known::default();
    let mut at = MAGIC.len() as u64;
    let mut is_ended = false;
    while at < file.size {
        let mut header = [0; RECORD_HEADER];
        let left = file.size - at;
        if left < RECORD_HEADER as u64 {
            // The magic at the end, whole or not.
            break;
        }
        file.read_exact(&mut header, at)?;
        let Some((opcode, length)) = record_header(&header) else { break };
        let body = at + RECORD_HEADER as u64;
        if length > left - RECORD_HEADER as u64 {
            break;
        }
        match opcode {
            op::SCHEMA | op::CHANNEL => {
                let body = file.range(body, length, MOST_RECORD)?;
                record::parse(opcode, &body).into_iter().for_each(|record| known.take(record));
            }
            op::MESSAGE if length >= MESSAGE_HEADER as u64 => {
                let mut header = [0; MESSAGE_HEADER];
                file.read_exact(&mut header, body)?;
                let (channel, log_ns) = message_header(&header).expect("its bytes are there");
                let before = MESSAGE_HEADER as u64;
                index.loose.push(Loose { channel, log_ns, offset: body + before, length: length - before });
            }
            op::CHUNK => index.chunks.push(chunk(file, at, length)?),
            op::MESSAGE_INDEX if length >= 6 => {
                let mut channel = [0; 2];
                file.read_exact(&mut channel, body)?;
                if let Some(chunk) = index.chunks.last_mut() {
                    chunk.message_index_offsets.insert(u16::from_le_bytes(channel), at);
                    chunk.message_index_length += RECORD_HEADER as u64 + length;
                }
            }
            // Behind it come summary and footer, which tell nothing new.
            op::DATA_END => {
                is_ended = true;
                break;
            }
            _ => {}
        }
        at = body + length;
    }
    index.channels = known.channels().collect();
    if !is_ended {
        // Its message indexes may not all have been written.
        if let Some(last) = index.chunks.last_mut() {
            last.message_index_offsets.clear();
            last.message_index_length = 0;
        }
        let path = file.name();
        let text = format!(
            "{path} was cut off: its last whole record ends at byte {at} of {}, and what is before that is read",
            file.size
        );
        index.warning = Some(Warning { text, is_loss: true });
    }
    Ok(index)
}

/// What the head of a chunk says.
fn chunk(file: &PositionedFile, at: u64, length: u64) -> Result<ChunkIndex, Fault> {
    let damaged = || file.damaged(at, "no whole chunk");
    let mut head = vec![0; usize::try_from(length).unwrap_or(usize::MAX).min(BEFORE_COMPRESSION + MOST_NAME + 8)];
    file.read_exact(&mut head, at + RECORD_HEADER as u64)?;
    let word = |from: usize| head.get(from..from + 8).and_then(|word| Some(u64::from_le_bytes(word.try_into().ok()?)));
    let name = head.get(28..BEFORE_COMPRESSION).and_then(|length| Some(u32::from_le_bytes(length.try_into().ok()?)));
    let name = name.map(|length| length as usize).filter(|length| *length <= MOST_NAME).ok_or_else(damaged)?;
    let compression = head.get(BEFORE_COMPRESSION..BEFORE_COMPRESSION + name).ok_or_else(damaged)?;
    Ok(ChunkIndex {
        message_start_time: word(0).ok_or_else(damaged)?,
        message_end_time: word(8).ok_or_else(damaged)?,
        chunk_start_offset: at,
        chunk_length: length + RECORD_HEADER as u64,
        message_index_offsets: BTreeMap::new(),
        message_index_length: 0,
        compression: String::from_utf8_lossy(compression).into_owned(),
        compressed_size: word(BEFORE_COMPRESSION + name).ok_or_else(damaged)?,
        uncompressed_size: word(16).ok_or_else(damaged)?,
    })
}

/// The index with what only the chunks themselves tell: channels that no record outside names, messages that no message index tells of.
pub fn completed(file: &PositionedFile, mut index: Index) -> Result<Index, Fault> {
    let mut known = Known::default();
    for (number, place) in index.chunks.iter().enumerate() {
        let is_indexed = place.message_index_length > 0 || !place.message_index_offsets.is_empty();
        let knows = |channel: &u16| index.channels.contains_key(channel) || known.channels.contains_key(channel);
        if is_indexed && place.message_index_offsets.keys().all(knows) {
            continue;
        }
        for (offset, opcode, body) in Records::new(&Chunk::read(file, place)?.records()?) {
            match opcode {
                op::SCHEMA | op::CHANNEL => {
                    record::parse(opcode, body).into_iter().for_each(|record| known.take(record));
                }
                op::MESSAGE if !is_indexed => {
                    if let Some((channel, log_ns)) = message_header(body) {
                        index.unindexed.push(Unindexed { chunk: number, channel, log_ns, offset });
                    }
                }
                _ => {}
            }
        }
    }
    for (id, channel) in known.channels() {
        index.channels.entry(id).or_insert(channel);
    }
    Ok(index)
}
