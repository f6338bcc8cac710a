//! Where things lie in a recording, from its summary. `recovery_scan.rs` finds the same where there is none.

use std::collections::BTreeMap;
use std::sync::Arc;

use crc32fast::Hasher;
use mcap::records::{Record, op};

use crate::checksum::unseal;
use crate::error::RecordingError;
use crate::file::PositionedFile;
use crate::parse::{self, ChannelEntry, RECORD_HEADER, Records};
use crate::read::attachment::AttachmentEntry;
use crate::{KNOWN_FORMATS, ONCE_METADATA, PLAN_METADATA};
use depthloom_codecs::schema::Schema;

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

/// A metadata record, its checksum found right.
#[derive(Clone, Debug)]
pub(crate) struct MetadataEntry {
    pub(crate) name: String,
    pub(crate) values: BTreeMap<String, String>,
    /// Where it starts and ends.
    pub(crate) offset: u64,
    pub(crate) end: u64,
    /// The CRC-32 that all bytes before it had when it was written.
    pub(crate) crc_before: u32,
}

impl MetadataEntry {
    /// Whether it says where the content of a once-value is.
    pub(crate) fn is_of_once(&self) -> bool {
        self.name.starts_with(ONCE_METADATA)
    }
}

/// Where things lie in a file.
#[derive(Debug, Default)]
pub(crate) struct Index {
    pub(crate) schemas: BTreeMap<u16, String>,
    pub(crate) channels: BTreeMap<u16, ChannelEntry>,
    /// In the order of the file.
    pub(crate) chunks: Vec<ChunkEntry>,
    pub(crate) attachments: Vec<AttachmentEntry>,
    pub(crate) metadata: Vec<MetadataEntry>,
    /// Where the data ends, and the CRC-32 that all bytes before then had; `None` if that was not needed to find the rest.
    pub(crate) data_end: Option<(u64, u32)>,
    pub(crate) channel_lists: BTreeMap<Vec<u16>, Arc<[u16]>>,
}

/// The record that ends the data, before the summary.
pub(crate) const DATA_END: u64 = RECORD_HEADER + 4;
/// A footer with its header, and the magic bytes after it.
const FOOTER: u64 = RECORD_HEADER + 20 + MAGIC;
pub(crate) const MAGIC: u64 = mcap::MAGIC.len() as u64;
/// Bytes of a summary that are read at a time, if no record of it has more.
const WINDOW: u64 = 1 << 20;

impl Index {
    /// Reads the summary; `None` if the file's writer did not finish it.
    pub(crate) fn of_summary(file: &PositionedFile) -> Result<Option<Self>, RecordingError> {
        let Some(start) = summary_start(file)? else { return Ok(None) };
        // The checksum covers the footer up to the checksum itself.
        let checked_end = file.size - MAGIC - 4;
        let (mut window, mut at, mut found) = (Vec::new(), start, Hasher::new());
        while at < checked_end {
            let length = WINDOW.min(checked_end - at);
            file.read_range(&mut window, at, length)?;
            found.update(&window);
            at += length;
        }
        let mut crc = [0; 4];
        file.read_exact(&mut crc, checked_end)?;
        if crc != found.finalize().to_le_bytes() {
            return Err(file.damaged(start, "the summary's checksum differs"));
        }
        file.read_exact(&mut crc, start - 4)?;
        let mut index = Self { data_end: Some((start - DATA_END, u32::from_le_bytes(crc))), ..Self::default() };
        index.read_summary(file, start, window)?;
        index.channel_lists.clear();
        Ok(Some(index))
    }

    /// The schema's name of a channel.
    pub(crate) fn schema_of(&self, channel: &ChannelEntry) -> Option<&str> {
        self.schemas.get(&channel.schema).map(String::as_str)
    }

    /// Whether a channel is one of commit records.
    pub(crate) fn is_of_commits(&self, channel: u16) -> bool {
        let schema = self.channels.get(&channel).and_then(|channel| self.schema_of(channel));
        schema == Some(Schema::Commit.name())
    }

    /// Reads the records of the summary: some at a time, for of a long run they are many megabytes, of which little is kept.
    fn read_summary(&mut self, file: &PositionedFile, start: u64, mut window: Vec<u8>) -> Result<(), RecordingError> {
        let (end, mut at, mut length) = (file.size - FOOTER, start, WINDOW);
        let mut indexes = Vec::new();
        while at < end {
            length = length.min(end - at);
            file.read_range(&mut window, at, length)?;
            let read = self.read_records(file, (at, start), &window, &mut indexes)?;
            match read {
                0 if length == end - at => return Err(file.damaged(at, "a record of the summary is cut")),
                // A record longer than the window.
                0 => length *= 2,
                _ => (at, length) = (at + read, WINDOW),
            }
        }
        let mut record = Vec::new();
        for (offset, length) in indexes {
            file.read_range(&mut record, offset, length)?;
            let Some(Ok((_, op::METADATA, body))) = Records::new(&record).next() else {
                return Err(file.damaged(offset, "no metadata record is there"));
            };
            self.metadata.push(metadata_entry(file, offset, body)?);
        }
        self.chunks.sort_by_key(|chunk| chunk.start);
        Ok(())
    }

    /// Reads those of the summary's records that are whole in a window that starts at `at`, the summary at `start`; gives how many bytes they have.
    fn read_records(
        &mut self,
        file: &PositionedFile,
        (window_at, start): (u64, u64),
        window: &[u8],
        indexes: &mut Vec<(u64, u64)>,
    ) -> Result<u64, RecordingError> {
        let mut read = 0;
        for record in Records::new(window) {
            let Ok((at, opcode, body)) = record else { break };
            read = at + RECORD_HEADER + body.len() as u64;
            let at = window_at + at;
            let parsed = mcap::parse_record(opcode, body);
            match parsed.map_err(|error| file.damaged(at, error.to_string()))? {
                Record::Schema { header, .. } => {
                    self.schemas.insert(header.id, header.name);
                }
                Record::Channel(channel) => {
                    let entry = ChannelEntry::new(channel.schema_id, &channel.topic, &channel.metadata);
                    self.channels.insert(channel.id, entry);
                }
                Record::ChunkIndex(chunk) => {
                    let channels = self.channel_list(chunk.message_index_offsets.keys().copied().collect());
                    let ends = chunk.chunk_start_offset.checked_add(chunk.chunk_length);
                    let end = ends.and_then(|end| end.checked_add(chunk.message_index_length));
                    let end = end.filter(|end| *end <= start);
                    let end = end.ok_or_else(|| file.damaged(at, "a chunk lies outside the data"))?;
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
        Ok(read)
    }

    pub(crate) fn channel_list(&mut self, channels: Vec<u16>) -> Arc<[u16]> {
        self.channel_lists.entry(channels).or_insert_with_key(|channels| channels.as_slice().into()).clone()
    }
}

/// A metadata record, checked.
///
/// The format is looked at before the checksum: another one may have its checksums elsewhere.
pub(crate) fn metadata_entry(file: &PositionedFile, offset: u64, body: &[u8]) -> Result<MetadataEntry, RecordingError> {
    let damaged = || file.damaged(offset, "a metadata record is not what was written");
    let (name, values) = parse::metadata(body).ok_or_else(damaged)?;
    if name == PLAN_METADATA {
        // Another program's metadata may have the name.
        let Some(found) = values.get("format").cloned() else {
            return Err(RecordingError::NotARecording { path: file.path.clone() });
        };
        if !KNOWN_FORMATS.contains(&found.as_str()) {
            return Err(RecordingError::Format { path: file.path.clone(), found, known: &KNOWN_FORMATS });
        }
    }
    let crc_before = unseal(&name, &values).ok_or_else(damaged)?;
    let end = offset + RECORD_HEADER + body.len() as u64;
    Ok(MetadataEntry { name, values, offset, end, crc_before })
}

/// Where the summary starts, which ends with the file; `None` if the file's writer did not finish it.
///
/// A bit flipped in the footer or behind it must not make a finished file look like one that was not: either the magic bytes
/// or a footer are enough for one that was.
fn summary_start(file: &PositionedFile) -> Result<Option<u64>, RecordingError> {
    if file.size < MAGIC + FOOTER {
        return Ok(None);
    }
    let mut bytes = [0; FOOTER as usize];
    file.read_exact(&mut bytes, file.size - FOOTER)?;
    let (record, magic) = bytes.split_at((FOOTER - MAGIC) as usize);
    let is_ended = magic == mcap::MAGIC;
    let footer = match Records::new(record).next() {
        Some(Ok((_, op::FOOTER, footer))) => footer.first_chunk().map(|start| u64::from_le_bytes(*start)),
        _ => None,
    };
    let Some(start) = footer else {
        return if is_ended {
            Err(file.damaged(file.size - FOOTER, "the footer is not what was written"))
        } else {
            Ok(None)
        };
    };
    let mut end = [0; DATA_END as usize];
    if (MAGIC + DATA_END..=file.size - FOOTER).contains(&start) {
        file.read_exact(&mut end, start - DATA_END)?;
    }
    let follows_data = end.starts_with(&[op::DATA_END, 4, 0, 0, 0, 0, 0, 0, 0]);
    match (is_ended, follows_data) {
        (true, true) => Ok(Some(start)),
        (false, false) => Ok(None),
        (true, false) => Err(file.damaged(file.size - FOOTER, "the footer points to no summary")),
        (false, true) => Err(file.damaged(file.size - MAGIC, "the file does not end as an MCAP file does")),
    }
}
