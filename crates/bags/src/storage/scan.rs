//! An MCAP file record by record: for files that were cut off, or have no index. Messages are stepped over.

use depthloom_mcap::records::{ChunkHeader, ChunkIndex};
use depthloom_mcap::{
    Chunk, FileError, MAGIC_LENGTH, MESSAGE_HEADER, PositionedFile, RECORD_HEADER, RecordPlace, Records, Window,
    chunk_index, message, op, read,
};

use super::index::{Index, KnownRecords, Unindexed};
use super::message::{Place, Warning};

/// The most bytes of a chunk, as stored and decompressed. Writers make them of some MB, and larger where one message
/// is.
pub(super) const MOST_CHUNK: u64 = 1 << 30;

/// The most bytes of a schema or a channel.
const MOST_RECORD: u64 = 16 << 20;

/// The most bytes of a chunk's header: compressions have short names.
const MOST_HEADER: u64 = 104;

/// The index of a file, from a look at every record.
pub(super) fn scan(file: &PositionedFile) -> Result<Index, FileError> {
    let mut index = Index::default();
    let mut known = KnownRecords::default();
    let (mut window, mut at, mut is_ended) = (Window::new(file), MAGIC_LENGTH, false);
    // At the end there may be the magic bytes, or a part of them.
    while let Some(RecordPlace { opcode, body, length }) = window.record(at)? {
        if length > file.size - body {
            break;
        }
        match opcode {
            op::SCHEMA | op::CHANNEL => {
                known.add(opcode, &file.range(body, length, MOST_RECORD)?);
            }
            op::MESSAGE if length >= MESSAGE_HEADER => {
                if let Some(message) = window.at(body, MESSAGE_HEADER)?.and_then(message) {
                    let place = Place::Bytes { offset: body + MESSAGE_HEADER, length: length - MESSAGE_HEADER };
                    index.unindexed.push(Unindexed { channel: message.channel, log_ns: message.time_ns, place });
                }
            }
            op::CHUNK => {
                let header = window.at(body, length.min(MOST_HEADER))?.and_then(read::<ChunkHeader>);
                let (header, _) = header.ok_or_else(|| file.damaged(at, "no complete chunk is there"))?;
                index.chunks.push(chunk_index(header, at, length + RECORD_HEADER));
            }
            op::MESSAGE_INDEX if length >= 6 => {
                let channel = window.at(body, 2)?.and_then(|bytes| bytes.first_chunk()).copied();
                if let (Some(channel), Some(chunk)) = (channel, index.chunks.last_mut()) {
                    chunk.message_index_offsets.insert(u16::from_le_bytes(channel), at);
                    chunk.message_index_length += RECORD_HEADER + length;
                }
            }
            // Summary and footer follow, which add nothing.
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
        let (name, size) = (file.name(), file.size);
        let text = format!(
            "{name} was cut off: its last whole record ends at byte {at} of {size}, and what is before that is read"
        );
        index.warning = Some(Warning { text, is_loss: true });
    }
    Ok(index)
}

/// The index, completed from the chunks: channels that no record outside names, messages that no message
/// index names.
pub(super) fn completed(file: &PositionedFile, mut index: Index) -> Result<Index, FileError> {
    let mut known = KnownRecords::default();
    let (mut stored, mut unpacked) = (Vec::new(), Vec::new());
    for (number, place) in index.chunks.iter().enumerate() {
        let is_indexed = place.message_index_length > 0 || !place.message_index_offsets.is_empty();
        let knows = |channel: &u16| index.channels.contains_key(channel) || known.has(*channel);
        if is_indexed && place.message_index_offsets.keys().all(knows) {
            continue;
        }
        let chunk = read_chunk(file, place, &mut stored)?;
        for (offset, opcode, body) in Records::new(chunk.records(&mut unpacked)?).map_while(Result::ok) {
            known.add(opcode, body);
            if opcode == op::MESSAGE
                && !is_indexed
                && let Some(message) = message(body)
            {
                let place = Place::Chunk { chunk: number, channel: message.channel, offset };
                index.unindexed.push(Unindexed { channel: message.channel, log_ns: message.time_ns, place });
            }
        }
    }
    for (id, channel) in known.channels() {
        index.channels.entry(id).or_insert(channel);
    }
    Ok(index)
}

pub(super) fn read_chunk<'a>(
    file: &'a PositionedFile,
    place: &ChunkIndex,
    buffer: &'a mut Vec<u8>,
) -> Result<Chunk<'a>, FileError> {
    let chunk = Chunk::read(file, (place.chunk_start_offset, place.chunk_length), MOST_CHUNK, buffer)?;
    let (named, found) = (place.uncompressed_size, chunk.header.uncompressed_size);
    if named != found {
        let what = format!("the index names a chunk of {named} bytes, and it has {found}");
        return Err(file.damaged(place.chunk_start_offset, what));
    }
    Ok(chunk)
}
