//! Where things lie in a recording without a sound summary: from a walk over its records.
//!
//! Commit records, metadata records and the end of the data hold the CRC-32 of all bytes before them. What stands before one of
//! them that agrees is what was written, and is kept; what stands behind the last is kept by nothing.

use mcap::records::op;
use prost::Message;

use crate::attachment::AttachmentEntry;
use crate::checksum::CrcBefore;
use crate::condition::Condition;
use crate::error::RecordingError;
use crate::file::PositionedFile;
use crate::index::{ChunkEntry, Index, MAGIC, metadata_entry};
use crate::messages::CommitMessage;
use crate::parse::{self, ChunkHead, RECORD_HEADER};
use crate::unpack::{ChunkBuffers, LARGEST_CHUNK};

/// The most bytes before a chunk's or an attachment's content that are looked at: names are short.
const HEAD: u64 = 1 << 16;
/// The most bytes a record may have that is no attachment: a chunk that was not compressed, and what surrounds it.
const LARGEST_RECORD: u64 = LARGEST_CHUNK + 1024;

/// What a walk found.
pub(crate) struct Walked {
    pub(crate) index: Index,
    pub(crate) condition: Condition,
}

/// How a walk ends.
enum End {
    /// At the end of the data: all of it is what was written.
    Data,
    /// At a record that is cut, or at the file's end.
    Cut,
    /// At what is not what was written.
    Damaged { offset: u64, what: String },
}

/// Walks over the records up to the first that is cut or damaged.
pub(crate) fn walk(file: &PositionedFile) -> Result<Walked, RecordingError> {
    let mut walk = Walk {
        file,
        window: Window { file, start: 0, bytes: Vec::new() },
        crc: CrcBefore::new(file),
        buffers: ChunkBuffers::default(),
        index: Index::default(),
        kept: Kept::default(),
        chunk: None,
        at: MAGIC,
        sound_to: MAGIC,
        rest_from: MAGIC,
    };
    let end = loop {
        match walk.step() {
            Ok(None) => {}
            Ok(Some(end)) => break end,
            Err(RecordingError::Damaged { offset, what, .. }) => break End::Damaged { offset, what },
            Err(error) => return Err(error),
        }
    };
    let end = match end {
        End::Cut => walk.cut()?,
        end => end,
    };
    let rest_bytes = file.size - walk.rest_from;
    walk.drop_the_rest();
    let condition = match end {
        End::Data | End::Cut => Condition::Unfinished { rest_bytes },
        End::Damaged { offset, what } => Condition::Damaged { offset, what, cut: true },
    };
    Ok(Walked { index: walk.index, condition })
}

/// How much of an index is what was written.
#[derive(Default)]
struct Kept {
    chunks: usize,
    attachments: usize,
    metadata: usize,
    /// What came since.
    later_schemas: Vec<u16>,
    later_channels: Vec<u16>,
}

struct Walk<'a> {
    file: &'a PositionedFile,
    window: Window<'a>,
    crc: CrcBefore<'a>,
    buffers: ChunkBuffers,
    index: Index,
    kept: Kept,
    /// A chunk whose message indexes come: start, length, channels.
    chunk: Option<(u64, u64, Vec<u16>)>,
    at: u64,
    /// Everything before is what was written.
    sound_to: u64,
    /// There, or behind the message index of a commit that ends there.
    rest_from: u64,
}

impl Walk<'_> {
    /// Goes one record on.
    fn step(&mut self) -> Result<Option<End>, RecordingError> {
        let at = self.at;
        let Some(header) = self.window.at(at, RECORD_HEADER)? else { return Ok(Some(End::Cut)) };
        let Some((&opcode, Ok(length))) = header.split_first().map(|(opcode, length)| (opcode, length.try_into()))
        else {
            return Ok(Some(End::Cut));
        };
        let length = u64::from_le_bytes(length);
        let (file, body) = (self.file, at + RECORD_HEADER);
        let damaged = |what: &str| file.damaged(at, what);
        let is_known = match opcode {
            op::HEADER => at == MAGIC,
            op::SCHEMA | op::CHANNEL | op::CHUNK | op::MESSAGE_INDEX | op::ATTACHMENT | op::METADATA | op::DATA_END => {
                true
            }
            _ => false,
        };
        if !is_known {
            return Err(damaged("no record of a recording starts there"));
        }
        if opcode != op::ATTACHMENT && length > LARGEST_RECORD {
            return Err(damaged(&format!(
                "a record is said to have {length} bytes, and none has over {LARGEST_RECORD}"
            )));
        }
        let Some(end) = body.checked_add(length) else { return Err(damaged("a record is said to have no end")) };
        let is_cut = end > file.size;
        // What must be there of a record that is only looked into.
        let head = length.min(HEAD);
        if opcode == op::MESSAGE_INDEX {
            let Some(bytes) = self.window.at(body, length.min(6))? else { return Ok(Some(End::Cut)) };
            let channel = parse::message_index_channel(bytes, length);
            let channel = channel.ok_or_else(|| damaged("a message index is not what was written"))?;
            match &mut self.chunk {
                _ if is_cut => return Ok(Some(End::Cut)),
                Some((_, _, channels)) => channels.push(channel),
                // The commit's own, which is whole without it.
                None if self.sound_to == at && self.index.is_of_commits(channel) => {}
                None => return Err(damaged("a message index belongs to no chunk")),
            }
            if let (None, Some(commit)) = (&self.chunk, self.index.chunks.last_mut()) {
                commit.end = end;
                self.rest_from = end;
            }
            self.at = end;
            return Ok(None);
        }
        // The chunk before is complete: all its message indexes are.
        self.close_chunk(at);
        match opcode {
            op::CHUNK => {
                let Some(bytes) = self.window.at(body, head.min(file.size - body))? else { return Ok(Some(End::Cut)) };
                let chunk = match parse::chunk_head(bytes) {
                    Some(chunk) if chunk.body_length == Some(length) => chunk,
                    None if is_cut && (bytes.len() as u64) < ChunkHead::LONGEST => return Ok(Some(End::Cut)),
                    _ => return Err(damaged("the sizes of a chunk contradict each other")),
                };
                if is_cut {
                    return Ok(Some(End::Cut));
                }
                // A commit record is never compressed.
                let first = if chunk.compression.is_empty() { first_channel(&bytes[chunk.length..]) } else { None };
                match first.filter(|channel| self.index.is_of_commits(*channel)) {
                    Some(channel) => self.commit(at, end, channel)?,
                    None => self.chunk = Some((at, end - at, Vec::new())),
                }
            }
            op::ATTACHMENT => {
                let Some(bytes) = self.window.at(body, head.min(file.size - body))? else { return Ok(Some(End::Cut)) };
                let head = match parse::attachment_head(bytes) {
                    Some(head) if head.body_length == Some(length) => head,
                    None if is_cut => return Ok(Some(End::Cut)),
                    _ => return Err(damaged("the sizes of an attachment contradict each other")),
                };
                if is_cut {
                    return Ok(Some(End::Cut));
                }
                let (name, media_type, size) = (head.name, head.media_type, head.size);
                let length = length + RECORD_HEADER;
                self.index.attachments.push(AttachmentEntry { name, media_type, size, offset: at, length });
            }
            op::METADATA if is_cut => {
                let there = self.window.at(body, head.min(file.size - body))?;
                return match there.and_then(parse::metadata_length) {
                    Some(told) if told != length => {
                        Err(damaged("the sizes of a metadata record contradict each other"))
                    }
                    _ => Ok(Some(End::Cut)),
                };
            }
            op::DATA_END if length != 4 => return Err(damaged("the end of the data is not what was written")),
            _ if is_cut => return Ok(Some(End::Cut)),
            op::SCHEMA => {
                let Some(bytes) = self.window.at(body, length)? else { return Ok(Some(End::Cut)) };
                let (id, name) = parse::schema(bytes).ok_or_else(|| damaged("a schema is not what was written"))?;
                if self.index.schemas.insert(id, name).is_some() {
                    return Err(damaged("a schema has the number of another"));
                }
                self.kept.later_schemas.push(id);
            }
            op::CHANNEL => {
                let Some(bytes) = self.window.at(body, length)? else { return Ok(Some(End::Cut)) };
                let (id, channel) =
                    parse::channel(bytes).ok_or_else(|| damaged("a channel is not what was written"))?;
                if self.index.channels.insert(id, channel).is_some() {
                    return Err(damaged("a channel has the number of another"));
                }
                self.kept.later_channels.push(id);
            }
            op::METADATA => {
                let Some(bytes) = self.window.at(body, length)? else { return Ok(Some(End::Cut)) };
                let metadata = metadata_entry(file, at, bytes)?;
                self.agree(at, metadata.crc_before)?;
                self.index.metadata.push(metadata);
                self.keep(end);
            }
            op::DATA_END => {
                let Some(bytes) = self.window.at(body, length)? else { return Ok(Some(End::Cut)) };
                let crc = bytes.try_into().map(u32::from_le_bytes);
                self.agree(at, crc.map_err(|_| damaged("the end of the data is not what was written"))?)?;
                self.keep(end);
                self.at = end;
                return Ok(Some(End::Data));
            }
            // The header says nothing that is needed, and the first checksum covers it.
            _ => {}
        }
        self.at = end;
        Ok(None)
    }

    /// Takes the commit record in a chunk, and with it all that stands before.
    fn commit(&mut self, start: u64, end: u64, channel: u16) -> Result<(), RecordingError> {
        let channels = self.index.channel_list(vec![channel]);
        let chunk = ChunkEntry { start, length: end - start, end, channels };
        let mut crc_before = None;
        self.buffers.each_message(self.file, &chunk, |message| {
            if message.channel != channel || crc_before.is_some() {
                return Err("a commit chunk holds another message".to_owned());
            }
            let commit = CommitMessage::decode(message.data);
            crc_before = Some(commit.map_err(|error| format!("a commit record is none: {error}"))?.crc32_before);
            Ok(())
        })?;
        let crc_before = crc_before.ok_or_else(|| self.file.damaged(start, "a commit chunk is empty"))?;
        self.agree(start, crc_before)?;
        self.index.chunks.push(chunk);
        self.keep(end);
        Ok(())
    }

    /// Compares what stands before a place with the checksum told of it there.
    fn agree(&mut self, at: u64, told: u32) -> Result<(), RecordingError> {
        if self.crc.place(at)? == told {
            return Ok(());
        }
        let what = format!("between there and byte {at} something is not what was written");
        Err(self.file.damaged(self.sound_to, what))
    }

    /// Keeps all that was found.
    fn keep(&mut self, to: u64) {
        let Index { chunks, attachments, metadata, .. } = &self.index;
        let (chunks, attachments, metadata) = (chunks.len(), attachments.len(), metadata.len());
        self.kept = Kept { chunks, attachments, metadata, ..Kept::default() };
        (self.sound_to, self.rest_from) = (to, to);
    }

    /// Drops what was found and not kept.
    fn drop_the_rest(&mut self) {
        let (index, kept) = (&mut self.index, &self.kept);
        kept.later_schemas.iter().for_each(|id| drop(index.schemas.remove(id)));
        kept.later_channels.iter().for_each(|id| drop(index.channels.remove(id)));
        index.chunks.truncate(kept.chunks);
        index.attachments.truncate(kept.attachments);
        index.metadata.truncate(kept.metadata);
        index.channel_lists.clear();
    }

    fn close_chunk(&mut self, end: u64) {
        if let Some((start, length, mut channels)) = self.chunk.take() {
            channels.sort_unstable();
            let channels = self.index.channel_list(channels);
            self.index.chunks.push(ChunkEntry { start, length, end, channels });
        }
    }

    /// Tells a file whose writer stopped from one that is damaged where the walk stopped: all that stands behind the last
    /// commit must be a beginning of what would have been written.
    fn cut(&mut self) -> Result<End, RecordingError> {
        // Where the file is cut among a chunk's message indexes, its last channels are missing.
        let unindexed = self.chunk.take();
        let indexed = self.index.chunks[self.kept.chunks..].iter().map(|chunk| (chunk.clone(), true));
        let channels = self.index.channels.keys().copied().collect();
        let cut =
            unindexed.map(|(start, length, _)| (ChunkEntry { start, length, end: start + length, channels }, false));
        for (chunk, indexed) in indexed.chain(cut) {
            let mut seen = Vec::new();
            let read = self.buffers.each_message(self.file, &chunk, |message| {
                seen.push(message.channel);
                Ok(())
            });
            seen.sort_unstable();
            seen.dedup();
            let told =
                if indexed { seen == *chunk.channels } else { seen.iter().all(|id| chunk.channels.contains(id)) };
            match read {
                Ok(()) if told => {}
                Ok(()) => {
                    let what = "a chunk holds other channels than its message indexes say".to_owned();
                    return Ok(End::Damaged { offset: chunk.start, what });
                }
                Err(RecordingError::Damaged { offset, what, .. }) => return Ok(End::Damaged { offset, what }),
                Err(error) => return Err(error),
            }
        }
        for attachment in &self.index.attachments[self.kept.attachments..] {
            match attachment.read(self.file) {
                Ok(_) => {}
                Err(RecordingError::Damaged { offset, what, .. }) => return Ok(End::Damaged { offset, what }),
                Err(error) => return Err(error),
            }
        }
        Ok(match self.chunk_behind(self.at)? {
            None => End::Cut,
            Some(place) => {
                let what = format!("the record there has no end, and at byte {place} a chunk follows");
                End::Damaged { offset: self.at, what }
            }
        })
    }

    /// The first place behind one where a whole head of a chunk stands.
    fn chunk_behind(&mut self, at: u64) -> Result<Option<u64>, RecordingError> {
        const BLOCK: u64 = 1 << 20;
        const LONGEST: u64 = RECORD_HEADER + ChunkHead::LONGEST;
        let mut from = at + 1;
        while from < self.file.size {
            let length = (BLOCK + LONGEST).min(self.file.size - from);
            let Some(bytes) = self.window.at(from, length)? else { break };
            for place in 0..bytes.len().min(BLOCK as usize) {
                if bytes[place] != op::CHUNK {
                    continue;
                }
                let Some((length, body)) = bytes[place + 1..].split_first_chunk() else { break };
                let told = Some(u64::from_le_bytes(*length));
                let head = parse::chunk_head(&body[..body.len().min(ChunkHead::LONGEST as usize)]);
                if head.is_some_and(|head| head.body_length == told && matches!(head.compression, "" | "zstd")) {
                    return Ok(Some(from + place as u64));
                }
            }
            from += BLOCK;
        }
        Ok(None)
    }
}

/// The channel of the first message among a chunk's records.
fn first_channel(records: &[u8]) -> Option<u16> {
    let (header, body) = records.split_first_chunk::<{ RECORD_HEADER as usize }>()?;
    if header[0] != op::MESSAGE {
        return None;
    }
    body.first_chunk().map(|channel| u16::from_le_bytes(*channel))
}

/// A stretch of the file around where the walk is.
struct Window<'a> {
    file: &'a PositionedFile,
    start: u64,
    bytes: Vec<u8>,
}

impl Window<'_> {
    /// The bytes of a range; `None` if the file ends before.
    fn at(&mut self, offset: u64, length: u64) -> Result<Option<&[u8]>, RecordingError> {
        const READ_AHEAD: u64 = 4096;
        let Some(end) = offset.checked_add(length).filter(|end| *end <= self.file.size) else { return Ok(None) };
        if offset < self.start || end > self.start + self.bytes.len() as u64 {
            let length = length.max(READ_AHEAD).min(self.file.size - offset);
            self.file.read_range(&mut self.bytes, offset, length)?;
            self.start = offset;
        }
        let from = (offset - self.start) as usize;
        Ok(Some(&self.bytes[from..from + length as usize]))
    }
}
