//! An MCAP file of a bag: messages by channel, read without a copy of the file.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex};

use depthloom_graphs::Fault;
use depthloom_mcap::records::{Header, MessageIndex};
use depthloom_mcap::{
    FileError, MAGIC_LENGTH, MESSAGE_HEADER, Message as Stored, PositionedFile, RECORD_HEADER, Window, begins_as_mcap,
    body_of, message, no_message, op, read, record_header,
};
use depthloom_threads::{Tiles, into_unlocked, locked};

use super::chunk_cache::ChunkCache;
use super::index::{Index, summary};
use super::message::{Channel, Message, Place, Warning};
use super::scan::{MOST_CHUNK, completed, read_chunk, scan};
use crate::MOST_BYTES;

/// The most messages of a file: four days of a thousand a second. A few forged indexes that name one another's entries
/// could ask for any number.
const MOST_MESSAGES: usize = 400_000_000 / size_of::<Message>();

const MOST_HEADER: u64 = 64 << 10;

const MOST_INDEX: u64 = 256 << 20;

/// The library that an MCAP file's header names as its writer, whatever follows; `None` of what does not begin as one.
#[must_use]
pub fn written_by(path: &Path) -> Option<String> {
    let file = PositionedFile::open(path).ok()?;
    let record = Window::new(&file).record(MAGIC_LENGTH).ok()??;
    if !begins_as_mcap(&file).ok()? || record.opcode != op::HEADER {
        return None;
    }
    let body = file.range(record.body, record.length, MOST_HEADER).ok()?;
    read(&body).map(|(header, _): (Header, _)| header.library)
}

/// Reads the summary; without a summary, reads every record.
fn read_index(file: &PositionedFile) -> Result<Index, FileError> {
    let why = match summary(file) {
        Ok(Some(index)) => return completed(file, index),
        // Written without chunks, or without an index: nothing is wrong with it.
        Ok(None) => None,
        Err(error) => Some(error),
    };
    let mut index = scan(file)?;
    if let Some(why) = why.filter(|_| index.warning.is_none()) {
        let text = format!(
            "{}: its index cannot be read ({why}), so every record was read; `mcap recover` repairs the file",
            file.name()
        );
        index.warning = Some(Warning { text, is_loss: false });
    }
    completed(file, index)
}

pub(crate) struct McapFile {
    file: PositionedFile,
    index: Index,
    number: usize,
    cache: Arc<ChunkCache>,
    /// Chunks that are not compressed, and whose checksum was seen to hold.
    sound: Mutex<BTreeSet<usize>>,
}

impl McapFile {
    pub(crate) fn open(file: PositionedFile, number: usize, cache: Arc<ChunkCache>) -> Result<Self, FileError> {
        let index = read_index(&file)?;
        Ok(Self { file, index, number, cache, sound: Mutex::default() })
    }

    pub(crate) const fn channels(&self) -> &BTreeMap<u16, Channel> {
        &self.index.channels
    }

    pub(crate) const fn warning(&self) -> Option<&Warning> {
        self.index.warning.as_ref()
    }

    /// The messages of some channels, in the order of the file, each with the channel's place among them.
    pub(crate) fn messages(
        &self,
        file: usize,
        channels: &[u32],
        give: &mut dyn FnMut(usize, Message),
    ) -> Result<(), Fault> {
        let wanted = |channel: u16| channels.iter().position(|of| *of == u32::from(channel));
        let mut count = 0;
        for (number, place) in self.index.chunks.iter().enumerate() {
            for (&channel, &at) in &place.message_index_offsets {
                let Some(which) = wanted(channel) else { continue };
                let entries = self.message_index(channel, at)?;
                count += entries.len();
                if count > MOST_MESSAGES {
                    let what = format!("its indexes name more than {MOST_MESSAGES} messages");
                    return Err(self.file.damaged(at, what).into());
                }
                for (log_ns, offset) in entries {
                    give(which, Message { file, log_ns, place: Place::Chunk { chunk: number, channel, offset } });
                }
            }
        }
        for message in &self.index.unindexed {
            if let Some(which) = wanted(message.channel) {
                give(which, Message { file, log_ns: message.log_ns, place: message.place });
            }
        }
        Ok(())
    }

    /// Log time and place in the chunk of each message of a channel.
    fn message_index(&self, channel: u16, at: u64) -> Result<Vec<(u64, u64)>, FileError> {
        let damaged = || self.file.damaged(at, "no message index is there");
        let header = self.file.range(at, RECORD_HEADER, RECORD_HEADER)?;
        let Some((op::MESSAGE_INDEX, length)) = record_header(&header) else { return Err(damaged()) };
        let body = self.file.range(at.saturating_add(RECORD_HEADER), length, MOST_INDEX)?;
        let index = read(&body).filter(|(index, _): &(MessageIndex, _)| index.channel_id == channel);
        let (index, _) = index.ok_or_else(damaged)?;
        Ok(index.records.into_iter().map(|entry| (entry.log_time, entry.offset)).collect())
    }

    /// Where a message is in a chunk that is not compressed, by its header: offset in the file, and length.
    fn bytes_in_chunk(&self, chunk: usize, channel: u16, offset: u64) -> Result<(u64, u64), FileError> {
        const BEFORE: u64 = RECORD_HEADER + MESSAGE_HEADER;
        let place = &self.index.chunks[chunk];
        let end = place.chunk_start_offset.saturating_add(place.chunk_length);
        let at = place.compressed_data_offset().unwrap_or(u64::MAX).saturating_add(offset);
        let damaged = || self.file.damaged(at, "the index names a message that does not exist");
        if at.saturating_add(BEFORE) > end {
            return Err(damaged());
        }
        let header = self.file.range(at, BEFORE, BEFORE)?;
        let length = match (record_header(&header), message(&header[RECORD_HEADER as usize..])) {
            (Some((op::MESSAGE, length)), Some(found)) if found.channel == channel => {
                length.checked_sub(MESSAGE_HEADER)
            }
            _ => None,
        };
        let length = length.filter(|length| (at + BEFORE).checked_add(*length).is_some_and(|after| after <= end));
        Ok((at + BEFORE, length.ok_or_else(damaged)?))
    }

    /// Checks a chunk. Its records, if they are compressed: otherwise they are read where they are.
    fn decompressed(&self, chunk: usize) -> Result<Vec<u8>, FileError> {
        let (mut stored, mut records) = (Vec::new(), Vec::new());
        read_chunk(&self.file, &self.index.chunks[chunk], &mut stored)?.records(&mut records)?;
        Ok(records)
    }

    /// Reads a chunk that is not compressed once, to compare its checksum: nothing else detects a flipped bit in its
    /// messages.
    fn check(&self, chunk: usize) -> Result<(), FileError> {
        let sound = || locked(&self.sound);
        if !sound().contains(&chunk) {
            self.decompressed(chunk)?;
            sound().insert(chunk);
        }
        Ok(())
    }

    pub(crate) fn read(&self, place: Place) -> Result<Vec<u8>, Fault> {
        let (chunk, channel, offset) = match place {
            Place::Bytes { offset, length } => return Ok(self.file.range(offset, length, MOST_BYTES)?),
            Place::Chunk { chunk, channel, offset } => (chunk, channel, offset),
            Place::Row(_) => unreachable!("rows are SQLite's"),
        };
        let place = &self.index.chunks[chunk];
        if place.compression.is_empty() {
            self.check(chunk)?;
            let (offset, length) = self.bytes_in_chunk(chunk, channel, offset)?;
            return Ok(self.file.range(offset, length, MOST_BYTES)?);
        }
        let size = place.uncompressed_size.min(MOST_CHUNK);
        let records = self.cache.get((self.number, chunk), size, || self.decompressed(chunk))?;
        let stored = usize::try_from(offset).ok().and_then(|offset| records.get(offset..));
        match stored.and_then(|record| body_of(op::MESSAGE, record)).and_then(message) {
            Some(Stored { channel: found, data, .. }) if found == channel => Ok(data.to_vec()),
            _ => Err(no_message(&self.file, place.chunk_start_offset, offset).into()),
        }
    }

    /// The first bytes of messages: of those in compressed chunks, chunk by chunk on as many threads as there are.
    pub(crate) fn heads(&self, places: &[Place], most: usize, tiles: &dyn Tiles) -> Result<Vec<Vec<u8>>, Fault> {
        let mut heads = vec![Vec::new(); places.len()];
        let mut packed: BTreeMap<usize, Vec<(u64, usize)>> = BTreeMap::new();
        for (number, place) in places.iter().enumerate() {
            let (offset, length) = match *place {
                Place::Bytes { offset, length } => (offset, length),
                Place::Chunk { chunk, offset, .. } if !self.index.chunks[chunk].compression.is_empty() => {
                    packed.entry(chunk).or_default().push((offset, number));
                    continue;
                }
                Place::Chunk { chunk, channel, offset } => self.bytes_in_chunk(chunk, channel, offset)?,
                Place::Row(_) => unreachable!("rows are SQLite's"),
            };
            heads[number] = self.file.range(offset, length.min(most as u64), most as u64)?;
        }
        let packed: Vec<(usize, Vec<(u64, usize)>)> = packed.into_iter().collect();
        let unpacked = Mutex::new(Vec::with_capacity(packed.len()));
        tiles.run(packed.len(), &|tile| {
            let (chunk, wanted) = &packed[tile];
            let mut wanted = wanted.clone();
            wanted.sort_unstable();
            let offsets: Vec<u64> = wanted.iter().map(|(offset, _)| *offset).collect();
            let mut stored = Vec::new();
            let read = read_chunk(&self.file, &self.index.chunks[*chunk], &mut stored)
                .and_then(|chunk| chunk.heads(&offsets, most));
            locked(&unpacked).push((tile, wanted, read));
        });
        let mut unpacked = into_unlocked(unpacked);
        // The first fault in the order of the chunks.
        unpacked.sort_unstable_by_key(|(tile, _, _)| *tile);
        for (_, wanted, read) in unpacked {
            for ((_, number), head) in wanted.into_iter().zip(read?) {
                heads[number] = head;
            }
        }
        Ok(heads)
    }
}
