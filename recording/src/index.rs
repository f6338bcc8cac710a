//! Where things lie in a recording: from its summary, or from a walk over its records where a crash left no summary.

use std::collections::BTreeMap;
use std::sync::Arc;

use mcap::records::{Record, op};

use crate::error::RecordingError;
use crate::file::PositionedFile;

/// A chunk, and which channels it has messages of.
#[derive(Clone, Debug)]
pub(crate) struct ChunkEntry {
    /// Where its record starts.
    pub(crate) start: u64,
    /// How many bytes the record has.
    pub(crate) length: u64,
    /// Where its message indexes end.
    pub(crate) end: u64,
    /// Ascending; chunks of equal channels share the list.
    pub(crate) channels: Arc<[u16]>,
}

/// A channel.
#[derive(Clone, Debug)]
pub(crate) struct ChannelEntry {
    pub(crate) schema: u16,
    pub(crate) topic: String,
}

/// An attachment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttachmentEntry {
    /// Its name.
    pub name: String,
    /// What it holds.
    pub media_type: String,
    /// How many bytes it has.
    pub size: u64,
    pub(crate) offset: u64,
    pub(crate) length: u64,
}

/// A metadata record.
#[derive(Clone, Debug)]
pub(crate) struct MetadataEntry {
    pub(crate) name: String,
    pub(crate) values: BTreeMap<String, String>,
}

/// Where things lie in a file.
#[derive(Debug, Default)]
pub(crate) struct Index {
    /// Whether the file has a summary: whether its writer finished it.
    pub(crate) whole: bool,
    pub(crate) schemas: BTreeMap<u16, String>,
    pub(crate) channels: BTreeMap<u16, ChannelEntry>,
    /// In the order of the file.
    pub(crate) chunks: Vec<ChunkEntry>,
    pub(crate) attachments: Vec<AttachmentEntry>,
    pub(crate) metadata: Vec<MetadataEntry>,
    channel_lists: BTreeMap<Vec<u16>, Arc<[u16]>>,
}

/// Opcode and length.
const RECORD_HEADER: u64 = 9;
/// A footer with its header, and the magic bytes after it.
const FOOTER: u64 = RECORD_HEADER + 20 + MAGIC;
const MAGIC: u64 = mcap::MAGIC.len() as u64;

impl Index {
    pub(crate) fn read(file: &PositionedFile) -> Result<Self, RecordingError> {
        let mut magic = [0; MAGIC as usize];
        if file.size < MAGIC {
            return Err(RecordingError::NotMcap { path: file.path.clone() });
        }
        file.read_exact(&mut magic, 0)?;
        if magic != mcap::MAGIC {
            return Err(RecordingError::NotMcap { path: file.path.clone() });
        }
        let mut index = Self::default();
        match summary_range(file)? {
            Some((start, end, crc)) => index.read_summary(file, start, end, crc)?,
            None => index.walk(file)?,
        }
        index.channel_lists.clear();
        Ok(index)
    }

    /// The schema's name of a channel.
    pub(crate) fn schema_of(&self, channel: &ChannelEntry) -> Option<&str> {
        self.schemas.get(&channel.schema).map(String::as_str)
    }

    fn read_summary(&mut self, file: &PositionedFile, start: u64, end: u64, crc: u32) -> Result<(), RecordingError> {
        self.whole = true;
        let mut bytes = Vec::new();
        file.read_range(&mut bytes, start, end - start)?;
        // The checksum covers the footer up to the checksum itself.
        let checked = bytes.len() - (4 + MAGIC as usize);
        if crc != 0 && crc32fast::hash(&bytes[..checked]) != crc {
            return Err(file.damaged(start, "the summary's checksum differs"));
        }
        let records = &bytes[..bytes.len() - FOOTER as usize];
        let mut indexes = Vec::new();
        for record in Records::new(records) {
            let (at, opcode, body) = record.map_err(|at| file.damaged(start + at, "a record of the summary is cut"))?;
            let parsed = mcap::parse_record(opcode, body);
            match parsed.map_err(|error| file.damaged(start + at, error.to_string()))? {
                Record::Schema { header, .. } => {
                    self.schemas.insert(header.id, header.name);
                }
                Record::Channel(channel) => self.add_channel(channel),
                Record::ChunkIndex(chunk) => {
                    let channels = self.channel_list(chunk.message_index_offsets.keys().copied().collect());
                    let ends = chunk.chunk_start_offset.checked_add(chunk.chunk_length);
                    let end = ends.and_then(|end| end.checked_add(chunk.message_index_length));
                    let end = end.filter(|end| *end <= start);
                    let end = end.ok_or_else(|| file.damaged(start + at, "a chunk lies outside the data"))?;
                    let (start, length) = (chunk.chunk_start_offset, chunk.chunk_length);
                    self.chunks.push(ChunkEntry { start, length, end, channels });
                }
                Record::AttachmentIndex(attachment) => self.attachments.push(AttachmentEntry {
                    name: attachment.name,
                    media_type: attachment.media_type,
                    size: attachment.data_size,
                    offset: attachment.offset,
                    length: attachment.length,
                }),
                Record::MetadataIndex(metadata) => indexes.push((metadata.offset, metadata.length)),
                _ => {}
            }
        }
        let mut record = Vec::new();
        for (offset, length) in indexes {
            file.read_range(&mut record, offset, length)?;
            let body = record.get(RECORD_HEADER as usize..).unwrap_or_default();
            self.add_metadata(file, offset, body)?;
        }
        self.chunks.sort_by_key(|chunk| chunk.start);
        Ok(())
    }

    /// Walks over the records up to the first that is cut; the bodies of chunks and attachments are passed over.
    fn walk(&mut self, file: &PositionedFile) -> Result<(), RecordingError> {
        let mut window = Window { file, start: 0, bytes: Vec::new() };
        let mut at = MAGIC;
        let mut chunk: Option<(u64, u64, Vec<u16>)> = None;
        loop {
            let header = window.at(at, RECORD_HEADER)?;
            let Some(&[opcode, ref length @ ..]) = header else { break };
            let length = length.try_into().map_or(u64::MAX, u64::from_le_bytes);
            let body = at + RECORD_HEADER;
            let Some(end) = body.checked_add(length).filter(|end| *end <= file.size) else { break };
            if opcode == op::MESSAGE_INDEX {
                let Some(&[low, high]) = window.at(body, 2)? else { break };
                if let Some((_, _, channels)) = &mut chunk {
                    channels.push(u16::from_le_bytes([low, high]));
                }
                at = end;
                continue;
            }
            // The chunk before is complete: all its message indexes are.
            self.close_chunk(&mut chunk, at);
            match opcode {
                op::CHUNK => chunk = Some((at, end - at, Vec::new())),
                op::SCHEMA | op::CHANNEL | op::METADATA => {
                    let Some(bytes) = window.at(body, length)? else { break };
                    match mcap::parse_record(opcode, bytes) {
                        Ok(Record::Schema { header, .. }) => {
                            self.schemas.insert(header.id, header.name);
                        }
                        Ok(Record::Channel(channel)) => self.add_channel(channel),
                        Ok(Record::Metadata(metadata)) => {
                            self.metadata.push(MetadataEntry { name: metadata.name, values: metadata.metadata });
                        }
                        Ok(_) => {}
                        Err(error) => return Err(file.damaged(at, error.to_string())),
                    }
                }
                op::ATTACHMENT => {
                    if let Some(entry) = attachment_entry(&mut window, at, length)? {
                        self.attachments.push(entry);
                    }
                }
                op::DATA_END => break,
                _ => {}
            }
            at = end;
        }
        // Whatever is cut comes after this chunk's indexes, or is one of them: then its last channels are missing.
        self.close_chunk(&mut chunk, at);
        Ok(())
    }

    fn close_chunk(&mut self, chunk: &mut Option<(u64, u64, Vec<u16>)>, end: u64) {
        if let Some((start, length, mut channels)) = chunk.take() {
            channels.sort_unstable();
            let channels = self.channel_list(channels);
            self.chunks.push(ChunkEntry { start, length, end, channels });
        }
    }

    fn add_channel(&mut self, channel: mcap::records::Channel) {
        self.channels.insert(channel.id, ChannelEntry { schema: channel.schema_id, topic: channel.topic });
    }

    fn add_metadata(&mut self, file: &PositionedFile, offset: u64, body: &[u8]) -> Result<(), RecordingError> {
        match mcap::parse_record(op::METADATA, body) {
            Ok(Record::Metadata(metadata)) => {
                self.metadata.push(MetadataEntry { name: metadata.name, values: metadata.metadata });
                Ok(())
            }
            Ok(_) => Err(file.damaged(offset, "no metadata record is there")),
            Err(error) => Err(file.damaged(offset, error.to_string())),
        }
    }

    fn channel_list(&mut self, channels: Vec<u16>) -> Arc<[u16]> {
        self.channel_lists.entry(channels).or_insert_with_key(|channels| channels.as_slice().into()).clone()
    }
}

/// Start and end of the summary with its footer, and its checksum; `None` if the file's writer did not finish it.
fn summary_range(file: &PositionedFile) -> Result<Option<(u64, u64, u32)>, RecordingError> {
    if file.size < MAGIC + FOOTER {
        return Ok(None);
    }
    let mut bytes = [0; FOOTER as usize];
    file.read_exact(&mut bytes, file.size - FOOTER)?;
    let (record, magic) = bytes.split_at((FOOTER - MAGIC) as usize);
    if magic != mcap::MAGIC || record[0] != op::FOOTER {
        return Ok(None);
    }
    match mcap::parse_record(op::FOOTER, &record[RECORD_HEADER as usize..]) {
        Ok(Record::Footer(footer)) if footer.summary_start == 0 => Ok(None),
        Ok(Record::Footer(footer)) if footer.summary_start <= file.size - FOOTER => {
            Ok(Some((footer.summary_start, file.size, footer.summary_crc)))
        }
        _ => Err(file.damaged(file.size - FOOTER, "the footer points outside the file")),
    }
}

fn attachment_entry(window: &mut Window<'_>, at: u64, length: u64) -> Result<Option<AttachmentEntry>, RecordingError> {
    // Times, name, media type and size; names are short.
    let head = length.min(4096);
    let Some(head) = window.at(at + RECORD_HEADER, head)? else { return Ok(None) };
    let text = |head: &[u8], at: usize| {
        let length = u32::from_le_bytes(*head.get(at..)?.first_chunk()?) as usize;
        let text = head.get(at + 4..(at + 4).checked_add(length)?)?;
        Some((String::from_utf8(text.to_vec()).ok()?, at + 4 + length))
    };
    let Some((name, next)) = text(head, 16) else { return Ok(None) };
    let Some((media_type, next)) = text(head, next) else { return Ok(None) };
    let Some(size) = head.get(next..).and_then(|rest| rest.first_chunk()) else { return Ok(None) };
    let size = u64::from_le_bytes(*size);
    Ok(Some(AttachmentEntry { name, media_type, size, offset: at, length: length + RECORD_HEADER }))
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

/// The records in a stretch of bytes: offset, opcode, body. A record that is cut gives its offset as an error.
pub(crate) struct Records<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Records<'a> {
    pub(crate) const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }
}

impl<'a> Iterator for Records<'a> {
    type Item = Result<(u64, u8, &'a [u8]), u64>;

    fn next(&mut self) -> Option<Self::Item> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return None;
        }
        let at = self.at as u64;
        let parsed = rest.split_first_chunk::<{ RECORD_HEADER as usize }>().and_then(|(header, rest)| {
            let [opcode, length @ ..] = *header;
            let length = usize::try_from(u64::from_le_bytes(length)).ok()?;
            Some((opcode, rest.get(..length)?))
        });
        let Some((opcode, body)) = parsed else {
            self.at = self.bytes.len();
            return Some(Err(at));
        };
        self.at += RECORD_HEADER as usize + body.len();
        Some(Ok((at, opcode, body)))
    }
}
