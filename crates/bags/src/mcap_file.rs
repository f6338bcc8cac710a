//! An MCAP file of a bag: messages by channel, read where they lie.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex};

use depthloom_graphs::Fault;
use depthloom_threads::{Tiles, into_unlocked, locked};
use mcap::records::{Record, op};

use crate::MOST_BYTES;
use crate::bag::{Message, Place};
use crate::chunk_cache::ChunkCache;
use crate::chunks::{Chunk, MESSAGE_HEADER, RECORD_HEADER, message_header, record_header};
use crate::file::PositionedFile;
use crate::mcap_index::{Channel, Index, MAGIC, Warning};
use crate::record;

/// The most messages of a file: four days of a thousand a second. A few forged indexes that name one another's entries could ask for any number.
const MOST_MESSAGES: usize = 400_000_000 / size_of::<Message>();

/// The most bytes of a file's header.
const MOST_HEADER: u64 = 64 << 10;

/// The most bytes of a message index.
const MOST_INDEX: u64 = 256 << 20;

/// The library that an MCAP file's header names as its writer, whatever follows; `None` of what does not begin as one.
#[must_use]
pub fn written_by(path: &Path) -> Option<String> {
    let file = PositionedFile::open(path).ok()?;
    let start = MAGIC.len() as u64;
    let head = file.range(0, start + RECORD_HEADER as u64, MOST_HEADER).ok().filter(|head| head.starts_with(MAGIC))?;
    let (op::HEADER, length) = record_header(&head[MAGIC.len()..])? else { return None };
    let body = file.range(start + RECORD_HEADER as u64, length, MOST_HEADER).ok()?;
    match record::parse(op::HEADER, &body)? {
        Record::Header(header) => Some(header.library),
        _ => None,
    }
}

pub struct McapFile {
    file: PositionedFile,
    index: Index,
    /// Which file of the bag it is.
    number: usize,
    cache: Arc<ChunkCache>,
    /// Chunks that are not compressed, and whose checksum was seen to hold.
    sound: Mutex<BTreeSet<usize>>,
}

impl McapFile {
    pub fn open(path: &Path, number: usize, cache: Arc<ChunkCache>) -> Result<Self, Fault> {
        let file = PositionedFile::open(path)?;
        let index = Index::of(&file)?;
        Ok(Self { file, index, number, cache, sound: Mutex::default() })
    }

    pub const fn channels(&self) -> &BTreeMap<u16, Channel> {
        &self.index.channels
    }

    pub const fn warning(&self) -> Option<&Warning> {
        self.index.warning.as_ref()
    }

    /// The messages of some channels, in the order of the file, each with the channel's place among them.
    pub fn messages(&self, file: usize, channels: &[u32], give: &mut dyn FnMut(usize, Message)) -> Result<(), Fault> {
        let wanted = |channel: u16| channels.iter().position(|of| *of == u32::from(channel));
        let mut count = 0;
        for (number, place) in self.index.chunks.iter().enumerate() {
            for (&channel, &at) in &place.message_index_offsets {
                let Some(which) = wanted(channel) else { continue };
                let entries = self.message_index(channel, at)?;
                count += entries.len();
                if count > MOST_MESSAGES {
                    let what = format!("its indexes name more than {MOST_MESSAGES} messages");
                    return Err(self.file.damaged(at, what));
                }
                for (log_ns, offset) in entries {
                    give(which, Message { file, log_ns, place: Place::Chunk { chunk: number, channel, offset } });
                }
            }
        }
        for of in &self.index.unindexed {
            if let Some(which) = wanted(of.channel) {
                let place = Place::Chunk { chunk: of.chunk, channel: of.channel, offset: of.offset };
                give(which, Message { file, log_ns: of.log_ns, place });
            }
        }
        for of in &self.index.loose {
            if let Some(which) = wanted(of.channel) {
                give(
                    which,
                    Message { file, log_ns: of.log_ns, place: Place::Bytes { offset: of.offset, length: of.length } },
                );
            }
        }
        Ok(())
    }

    /// Log time and place in the chunk of each message of a channel.
    fn message_index(&self, channel: u16, at: u64) -> Result<Vec<(u64, u64)>, Fault> {
        let header = self.file.range(at, RECORD_HEADER as u64, MOST_INDEX)?;
        let damaged = || self.file.damaged(at, "no message index");
        let Some((op::MESSAGE_INDEX, length)) = record_header(&header) else { return Err(damaged()) };
        let body = self.file.range(at.saturating_add(RECORD_HEADER as u64), length, MOST_INDEX)?;
        match record::parse(op::MESSAGE_INDEX, &body) {
            Some(Record::MessageIndex(index)) if index.channel_id == channel => {
                Ok(index.records.into_iter().map(|entry| (entry.log_time, entry.offset)).collect())
            }
            _ => Err(damaged()),
        }
    }

    /// Where a message lies in a chunk that is not compressed, by its header: offset in the file, and length.
    fn bytes_in_chunk(&self, chunk: usize, channel: u16, offset: u64) -> Result<(u64, u64), Fault> {
        let place = &self.index.chunks[chunk];
        let records =
            place.compressed_data_offset().map_err(|error| self.file.damaged(0, "no chunk").because(error))?;
        let at = records.saturating_add(offset);
        let before = (RECORD_HEADER + MESSAGE_HEADER) as u64;
        let end = place.chunk_start_offset.saturating_add(place.chunk_length);
        let damaged = || self.file.damaged(at, "the index names a message, and there is none");
        if at.saturating_add(before) > end {
            return Err(damaged());
        }
        let header = self.file.range(at, before, before)?;
        let length = match (record_header(&header), message_header(&header[RECORD_HEADER..])) {
            (Some((op::MESSAGE, length)), Some((of, _))) if of == channel && length >= MESSAGE_HEADER as u64 => {
                length - MESSAGE_HEADER as u64
            }
            _ => return Err(damaged()),
        };
        match (at + before).checked_add(length) {
            Some(after) if after <= end => Ok((at + before, length)),
            _ => Err(damaged()),
        }
    }

    /// Reads a chunk that is not compressed once for its checksum: no other way a flipped bit of its messages is seen.
    fn check(&self, chunk: usize) -> Result<(), Fault> {
        let sound = || locked(&self.sound);
        if !sound().contains(&chunk) {
            Chunk::read(&self.file, &self.index.chunks[chunk])?.records()?;
            sound().insert(chunk);
        }
        Ok(())
    }

    /// A message's bytes.
    pub fn read(&self, place: Place) -> Result<Vec<u8>, Fault> {
        let (chunk, channel, offset) = match place {
            Place::Bytes { offset, length } => return self.file.range(offset, length, MOST_BYTES),
            Place::Chunk { chunk, channel, offset } => (chunk, channel, offset),
            Place::Row(_) => unreachable!("rows are SQLite's"),
        };
        let of = &self.index.chunks[chunk];
        if of.compression.is_empty() {
            self.check(chunk)?;
            let (offset, length) = self.bytes_in_chunk(chunk, channel, offset)?;
            return self.file.range(offset, length, MOST_BYTES);
        }
        let records =
            self.cache.get((self.number, chunk), of.uncompressed_size, || Chunk::read(&self.file, of)?.records())?;
        let message = || {
            let record = records.get(usize::try_from(offset).ok()?..)?;
            let (opcode, length) = record_header(record)?;
            let body = record[RECORD_HEADER..].get(..usize::try_from(length).ok()?)?;
            let (of, _) = message_header(body)?;
            (opcode == op::MESSAGE && of == channel).then(|| body[MESSAGE_HEADER..].to_vec())
        };
        message().ok_or_else(|| {
            let what = format!("the index names a message at byte {offset} of the chunk's records, and there is none");
            self.file.damaged(of.chunk_start_offset, what)
        })
    }

    /// The first bytes of messages: of those in compressed chunks, chunk by chunk on as many threads as there are.
    pub fn heads(&self, places: &[Place], most: usize, tiles: &dyn Tiles) -> Result<Vec<Vec<u8>>, Fault> {
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
            let read =
                Chunk::read(&self.file, &self.index.chunks[*chunk]).and_then(|chunk| chunk.heads(&offsets, most));
            locked(&unpacked).push((tile, wanted, read));
        });
        let mut unpacked = into_unlocked(unpacked);
        // The first fault, whoever came first.
        unpacked.sort_unstable_by_key(|(tile, _, _)| *tile);
        for (_, wanted, read) in unpacked {
            for ((_, number), head) in wanted.into_iter().zip(read?) {
                heads[number] = head;
            }
        }
        Ok(heads)
    }
}
