//! Indexes a recording without an intact summary by a scan of its records.
//!
//! Commit records, metadata records and the end of the data contain the CRC-32 of all bytes before them. If it agrees,
//! these bytes are undamaged and are kept; bytes after the last such record are dropped.

use depthloom_mcap::records::{Channel, ChunkHeader, SchemaHeader};
use depthloom_mcap::{
    FileError, MAGIC_LENGTH, PositionedFile, RECORD_HEADER, RecordPlace, Window, counted, op, read, read_all,
    record_header,
};
use prost::Message;

use crate::checksum::CrcBefore;
use crate::commit_message::CommitMessage;
use crate::condition::Condition;
use crate::error::RecordingError;
use crate::read::attachment::{AttachmentEntry, AttachmentHead, attachment_head};
use crate::read::chunk_messages::ChunkBuffers;
use crate::read::index::{ChannelEntry, ChunkEntry, Index, metadata_entry};
use crate::{LARGEST_CHUNK, LONGEST_CHUNK_HEADER};
use depthloom_codecs::schema::Schema;

/// The most bytes that are read before the content of a chunk or an attachment: names are short.
const HEAD: u64 = 1 << 16;
/// The most bytes of a record that is not an attachment: an uncompressed chunk and its header.
const LARGEST_RECORD: u64 = LARGEST_CHUNK + 1024;

pub(crate) struct Scanned {
    pub(crate) index: Index,
    pub(crate) condition: Condition,
}

enum End {
    /// At the end of the data, all of which is undamaged.
    Data,
    /// At a record that is cut, or at the file's end.
    Cut,
    /// At damaged bytes, or at bytes that cannot be read.
    Error(RecordingError),
}

impl<E: Into<RecordingError>> From<E> for End {
    fn from(error: E) -> Self {
        Self::Error(error.into())
    }
}

/// Walks over the records up to the first that is cut or damaged.
pub(crate) fn scan(file: &PositionedFile) -> Result<Scanned, RecordingError> {
    let mut scan = Scan {
        file,
        window: Window::new(file),
        crc: CrcBefore::new(file),
        buffers: ChunkBuffers::default(),
        index: Index::default(),
        kept: SoundPart::default(),
        chunk: None,
        at: MAGIC_LENGTH,
        sound_to: MAGIC_LENGTH,
        rest_from: MAGIC_LENGTH,
    };
    let mut end = loop {
        if let Err(end) = scan.step() {
            break end;
        }
    };
    if matches!(end, End::Cut) {
        end = scan.check_the_rest().err().map_or(End::Cut, End::from);
    }
    let rest_bytes = file.size - scan.rest_from;
    scan.drop_the_rest();
    let condition = match end {
        End::Data | End::Cut => Condition::Unfinished { rest_bytes },
        End::Error(RecordingError::File(FileError::Damaged { offset, what, .. })) => {
            Condition::Damaged { offset, what, cut: true }
        }
        End::Error(error) => return Err(error),
    };
    Ok(Scanned { index: scan.index, condition })
}

/// How much of an index is undamaged.
#[derive(Default)]
struct SoundPart {
    chunks: usize,
    attachments: usize,
    metadata: usize,
    later_schemas: Vec<u16>,
    later_channels: Vec<u16>,
}

struct Scan<'a> {
    file: &'a PositionedFile,
    window: Window<'a>,
    crc: CrcBefore<'a>,
    buffers: ChunkBuffers,
    index: Index,
    kept: SoundPart,
    /// A chunk whose message indexes follow: start, length, channels.
    chunk: Option<(u64, u64, Vec<u16>)>,
    at: u64,
    /// All bytes before this offset are undamaged.
    sound_to: u64,
    /// `sound_to`, or after the message index of a commit that ends there.
    rest_from: u64,
}

#[derive(Clone, Copy)]
struct Here {
    at: u64,
    /// Where its body starts, the length that its header states, and where it ends according to that.
    body: u64,
    length: u64,
    end: u64,
    is_cut: bool,
}

impl Here {
    /// Continues only if the complete record is there.
    const fn whole(self) -> Result<(), End> {
        if self.is_cut { Err(End::Cut) } else { Ok(()) }
    }
}

impl Scan<'_> {
    fn step(&mut self) -> Result<(), End> {
        let at = self.at;
        let RecordPlace { opcode, body, length } = self.window.record(at)?.ok_or(End::Cut)?;
        let is_known = match opcode {
            op::HEADER => at == MAGIC_LENGTH,
            op::DATA_END => length == 4,
            op::SCHEMA | op::CHANNEL | op::CHUNK | op::MESSAGE_INDEX | op::METADATA | op::ATTACHMENT => true,
            _ => false,
        };
        let end = body.checked_add(length).filter(|_| is_known);
        let Some(end) = end else { return Err(self.damaged(at, "no record starts there")) };
        if opcode != op::ATTACHMENT && length > LARGEST_RECORD {
            let what = format!("a record states {length} bytes, more than the {LARGEST_RECORD} of the largest");
            return Err(self.damaged(at, &what));
        }
        let here = Here { at, body, length, end, is_cut: end > self.file.size };
        if opcode != op::MESSAGE_INDEX {
            // The previous chunk is complete: all its message indexes are read.
            self.close_chunk(at);
        }
        match opcode {
            op::SCHEMA => self.schema(here)?,
            op::CHANNEL => self.channel(here)?,
            op::CHUNK => self.chunk(here)?,
            op::MESSAGE_INDEX => self.message_index(here)?,
            op::ATTACHMENT => self.attachment(here)?,
            op::METADATA => self.metadata(here)?,
            op::DATA_END => {
                let stated = self.window.at(body, length)?.and_then(|crc| crc.first_chunk()).ok_or(End::Cut)?;
                let stated = u32::from_le_bytes(*stated);
                self.agree(at, stated)?;
                self.keep(end);
                return Err(End::Data);
            }
            // The header contains nothing that is needed, and the first checksum covers it.
            _ => here.whole()?,
        }
        self.at = end;
        Ok(())
    }

    fn damaged(&self, offset: u64, what: &str) -> End {
        self.file.damaged(offset, what).into()
    }

    /// The beginning of a record's body, as far as it is there and needed.
    fn head(&mut self, here: Here) -> Result<&[u8], End> {
        let length = here.length.min(HEAD).min(self.file.size - here.body);
        self.window.at(here.body, length)?.ok_or(End::Cut)
    }

    fn schema(&mut self, here: Here) -> Result<(), End> {
        let body = self.window.at(here.body, here.length)?.ok_or(End::Cut)?;
        match schema(body) {
            Some(SchemaHeader { id, name, .. })
                if !self.index.schemas.contains_key(&id) && is_consistent(id, &name) =>
            {
                self.index.schemas.insert(id, name);
                self.kept.later_schemas.push(id);
                Ok(())
            }
            _ => Err(self.damaged(here.at, "a schema is damaged")),
        }
    }

    fn channel(&mut self, here: Here) -> Result<(), End> {
        let body = self.window.at(here.body, here.length)?.ok_or(End::Cut)?;
        let channel = read_all::<Channel>(body).map(|channel| (channel.id, ChannelEntry::from(channel)));
        match channel {
            Some((id, channel)) if !self.index.channels.contains_key(&id) && self.is_consistent(&channel) => {
                self.index.channels.insert(id, channel);
                self.kept.later_channels.push(id);
                Ok(())
            }
            _ => Err(self.damaged(here.at, "a channel is damaged")),
        }
    }

    /// Whether a channel's schema is known, and is that of commits exactly if the channel is: otherwise all commits
    /// would be missed.
    fn is_consistent(&self, channel: &ChannelEntry) -> bool {
        let schema = self.index.schemas.get(&channel.schema);
        schema.is_some_and(|name| (name == Schema::Commit.name()) == channel.is_of_a_stage)
    }

    fn chunk(&mut self, here: Here) -> Result<(), End> {
        let head = self.head(here)?;
        let first = match read::<ChunkHeader>(head) {
            Some((chunk, records)) => {
                let before = (head.len() - records.len()) as u64;
                if before.checked_add(chunk.compressed_size) != Some(here.length) {
                    return Err(self.damaged(here.at, "the sizes of a chunk contradict each other"));
                }
                // A commit record is never compressed.
                if chunk.compression.is_empty() { first_channel(records) } else { None }
            }
            None if here.is_cut && (head.len() as u64) < LONGEST_CHUNK_HEADER => return Err(End::Cut),
            None => return Err(self.damaged(here.at, "the sizes of a chunk contradict each other")),
        };
        here.whole()?;
        if first.is_some_and(|channel| !self.index.channels.contains_key(&channel)) {
            return Err(self.damaged(here.at, "a message has an unknown channel"));
        }
        match first.filter(|channel| self.index.is_of_commits(*channel)) {
            Some(channel) => self.commit(here.at, here.end, channel)?,
            None => self.chunk = Some((here.at, here.end - here.at, Vec::new())),
        }
        Ok(())
    }

    fn message_index(&mut self, here: Here) -> Result<(), End> {
        let head = self.window.at(here.body, here.length.min(6))?.ok_or(End::Cut)?;
        let Some(channel) = message_index_channel(head, here.length) else {
            return Err(self.damaged(here.at, "a message index is damaged"));
        };
        here.whole()?;
        if !self.index.channels.contains_key(&channel) {
            return Err(self.damaged(here.at, "a message index has an unknown channel"));
        }
        let is_of_commit = self.sound_to == here.at && self.index.is_of_commits(channel);
        match (&mut self.chunk, self.index.chunks.last_mut()) {
            (Some((_, _, channels)), _) => channels.push(channel),
            // The commit is complete without it.
            (None, Some(commit)) if is_of_commit => {
                commit.end = here.end;
                self.rest_from = here.end;
            }
            (None, _) => return Err(self.damaged(here.at, "a message index does not follow a chunk")),
        }
        Ok(())
    }

    fn attachment(&mut self, here: Here) -> Result<(), End> {
        let start = self.head(here)?;
        let head = attachment_head(start).map(|(head, rest)| (head, (start.len() - rest.len()) as u64));
        let (AttachmentHead { name, media_type, size }, before) = match head {
            None if here.is_cut => return Err(End::Cut),
            None => return Err(self.damaged(here.at, "the sizes of an attachment contradict each other")),
            Some(head) => head,
        };
        // A checksum of four bytes follows the content.
        if size.checked_add(before + 4) != Some(here.length) {
            return Err(self.damaged(here.at, "the sizes of an attachment contradict each other"));
        }
        here.whole()?;
        let (offset, length) = (here.at, here.end - here.at);
        self.index.attachments.push(AttachmentEntry { name, media_type, size, offset, length });
        Ok(())
    }

    fn metadata(&mut self, here: Here) -> Result<(), End> {
        if metadata_length(self.head(here)?).is_some_and(|stated| stated != here.length) {
            return Err(self.damaged(here.at, "the sizes of a metadata record contradict each other"));
        }
        let body = self.window.at(here.body, here.length)?.ok_or(End::Cut)?;
        let metadata = metadata_entry(self.file, here.at, body)?;
        self.agree(here.at, metadata.crc_before)?;
        self.index.metadata.push(metadata);
        self.keep(here.end);
        Ok(())
    }

    /// Keeps the commit record in a chunk, and everything before it.
    fn commit(&mut self, start: u64, end: u64, channel: u16) -> Result<(), FileError> {
        let channels = self.index.channel_list(vec![channel]);
        let chunk = ChunkEntry { start, length: end - start, end, channels };
        let mut crc_before = None;
        self.buffers.each_message(self.file, &chunk, |message| {
            if message.channel != channel || crc_before.is_some() {
                return Err("a commit chunk contains another message".to_owned());
            }
            let commit = CommitMessage::decode(message.data);
            crc_before = Some(commit.map_err(|error| format!("a commit record is invalid: {error}"))?.crc32_before);
            Ok(())
        })?;
        let crc_before = crc_before.ok_or_else(|| self.file.damaged(start, "a commit chunk is empty"))?;
        self.agree(start, crc_before)?;
        self.index.chunks.push(chunk);
        self.keep(end);
        Ok(())
    }

    /// Compares the bytes before an offset with the checksum that is stored there.
    fn agree(&mut self, at: u64, stated: u32) -> Result<(), FileError> {
        if self.crc.up_to(at)? == stated {
            return Ok(());
        }
        let what = format!("bytes between there and byte {at} are damaged");
        Err(self.file.damaged(self.sound_to, what))
    }

    fn keep(&mut self, to: u64) {
        let Index { chunks, attachments, metadata, .. } = &self.index;
        let (chunks, attachments, metadata) = (chunks.len(), attachments.len(), metadata.len());
        self.kept = SoundPart { chunks, attachments, metadata, ..SoundPart::default() };
        (self.sound_to, self.rest_from) = (to, to);
    }

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

    /// Distinguishes a file whose writer stopped from one that is damaged where the scan stopped: everything after the
    /// last commit must be the beginning of what would have been written.
    fn check_the_rest(&mut self) -> Result<(), FileError> {
        // If the file is cut among a chunk's message indexes, its last channels are missing.
        let unindexed = self.chunk.take().map(|(start, length, _)| {
            let channels = self.index.channels.keys().copied().collect();
            (ChunkEntry { start, length, end: start + length, channels }, false)
        });
        let indexed = self.index.chunks[self.kept.chunks..].iter().map(|chunk| (chunk.clone(), true));
        for (chunk, is_indexed) in indexed.chain(unindexed) {
            let mut seen = Vec::new();
            self.buffers.each_message(self.file, &chunk, |message| {
                seen.push(message.channel);
                Ok(())
            })?;
            seen.sort_unstable();
            seen.dedup();
            let is_right =
                if is_indexed { seen == *chunk.channels } else { seen.iter().all(|id| chunk.channels.contains(id)) };
            if !is_right {
                let what = "the channels of a chunk differ from those of its message indexes";
                return Err(self.file.damaged(chunk.start, what));
            }
        }
        for attachment in &self.index.attachments[self.kept.attachments..] {
            attachment.read(self.file)?;
        }
        match self.chunk_behind(self.at)? {
            None => Ok(()),
            Some(place) => {
                let what =
                    format!("the record there states a length beyond the file, but a chunk follows at byte {place}");
                Err(self.file.damaged(self.at, what))
            }
        }
    }

    /// The first offset after `at` with a complete chunk header.
    fn chunk_behind(&mut self, at: u64) -> Result<Option<u64>, FileError> {
        const BLOCK: u64 = 1 << 20;
        const LONGEST: u64 = RECORD_HEADER + LONGEST_CHUNK_HEADER;
        let mut from = at + 1;
        while from < self.file.size {
            let length = (BLOCK + LONGEST).min(self.file.size - from);
            let Some(bytes) = self.window.at(from, length)? else { break };
            for place in 0..bytes.len().min(BLOCK as usize) {
                if bytes[place] != op::CHUNK {
                    continue;
                }
                let Some((_, stated)) = record_header(&bytes[place..]) else { break };
                let body = &bytes[place + RECORD_HEADER as usize..];
                let head = read::<ChunkHeader>(&body[..body.len().min(LONGEST_CHUNK_HEADER as usize)]);
                if head.is_some_and(|(head, _)| {
                    let before = LONGEST_CHUNK_HEADER - 4 + head.compression.len() as u64;
                    matches!(&*head.compression, "" | "zstd")
                        && before.checked_add(head.compressed_size) == Some(stated)
                }) {
                    return Ok(Some(from + place as u64));
                }
            }
            from += BLOCK;
        }
        Ok(None)
    }
}

/// Whether a schema has the id that belongs to its name. A damaged schema would hide all commits after it.
fn is_consistent(id: u16, name: &str) -> bool {
    match Schema::with_id(id) {
        Some(schema) => schema.name() == name,
        None => Schema::named(name).is_none(),
    }
}

/// The schema that fills a record.
fn schema(body: &[u8]) -> Option<SchemaHeader> {
    let (schema, mut rest) = read::<SchemaHeader>(body)?;
    counted(&mut rest)?;
    rest.is_empty().then_some(schema)
}

/// The length of a metadata record according to its head.
fn metadata_length(mut head: &[u8]) -> Option<u64> {
    let name = counted(&mut head)?.len() as u64;
    Some(8 + name + u64::from(u32::from_le_bytes(*head.first_chunk()?)))
}

/// The channel of a message index of that length.
pub(crate) fn message_index_channel(head: &[u8], length: u64) -> Option<u16> {
    let [c0, c1, entries @ ..] = *head.first_chunk::<6>()?;
    let entries = u32::from_le_bytes(entries);
    (entries % 16 == 0 && length == 6 + u64::from(entries)).then_some(u16::from_le_bytes([c0, c1]))
}

/// The channel of the first message among a chunk's records, which may be cut.
fn first_channel(records: &[u8]) -> Option<u16> {
    let (op::MESSAGE, _) = record_header(records)? else { return None };
    records[RECORD_HEADER as usize..].first_chunk().map(|channel| u16::from_le_bytes(*channel))
}
