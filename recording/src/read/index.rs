//! Finds the records of a recording from its summary. `recovery_scan.rs` does the same for files without one.

use std::collections::BTreeMap;
use std::sync::Arc;

use crc32fast::Hasher;
use depthloom_codecs::schema::Schema;
use depthloom_mcap::records::{
    AttachmentIndex, Channel, ChunkHeader, ChunkIndex, Metadata, MetadataIndex, SchemaHeader, Statistics,
};
use depthloom_mcap::{
    FOOTER, FileEnd, FileError, MAGIC_LENGTH, PositionedFile, RECORD_HEADER, body_of, each_summary_record, file_end,
    op, read, read_all,
};

use crate::checksum::unseal;
use crate::error::RecordingError;
use crate::read::attachment::AttachmentEntry;
use crate::{AGGREGATE_METADATA, FORMAT, LONGEST_CHUNK_HEADER, PLAN_METADATA, TOPIC_IN_PLAN};

#[derive(Clone, Debug)]
pub(crate) struct ChannelEntry {
    pub(crate) schema: u16,
    pub(crate) topic: String,
    /// The topic in the file. It differs from the topic in the plan if viewers would not find the camera of an image by
    /// the latter.
    pub(crate) written_topic: String,
    /// Whether its only metadata is its stage: true only for the channel of a stage's commits.
    pub(crate) is_of_a_stage: bool,
}

impl From<Channel> for ChannelEntry {
    fn from(Channel { schema_id, topic: written_topic, metadata, .. }: Channel) -> Self {
        let topic = metadata.get(TOPIC_IN_PLAN).unwrap_or(&written_topic).clone();
        let is_of_a_stage = metadata.len() == 1 && metadata.contains_key("stage");
        Self { schema: schema_id, topic, written_topic, is_of_a_stage }
    }
}

/// A chunk, and the channels of its messages.
#[derive(Clone, Debug)]
pub(crate) struct ChunkEntry {
    pub(crate) start: u64,
    /// The length of the record, bytes.
    pub(crate) length: u64,
    pub(crate) end: u64,
    /// Ascending; chunks with equal channels share the list.
    pub(crate) channels: Arc<[u16]>,
}

impl ChunkEntry {
    /// The header of the chunk; `None` if no chunk starts there.
    pub(crate) fn header(&self, file: &PositionedFile) -> Result<Option<ChunkHeader>, FileError> {
        let mut head = [0; LONGEST_CHUNK_HEADER as usize];
        let length = self.length.saturating_sub(RECORD_HEADER).min(LONGEST_CHUNK_HEADER);
        let head = &mut head[..length as usize];
        file.read_exact(head, self.start + RECORD_HEADER)?;
        Ok(read(head).map(|(header, _)| header))
    }
}

#[derive(Clone, Debug)]
pub(crate) struct MetadataEntry {
    pub(crate) name: String,
    pub(crate) values: BTreeMap<String, String>,
    pub(crate) offset: u64,
    pub(crate) end: u64,
    /// The CRC-32 of all bytes before it when it was written.
    pub(crate) crc_before: u32,
}

impl MetadataEntry {
    /// Whether it states where the content of an aggregate value is.
    pub(crate) fn is_of_aggregate(&self) -> bool {
        self.name.starts_with(AGGREGATE_METADATA)
    }
}

#[derive(Debug, Default)]
pub(crate) struct Index {
    pub(crate) schemas: BTreeMap<u16, String>,
    pub(crate) channels: BTreeMap<u16, ChannelEntry>,
    /// In the order of the file.
    pub(crate) chunks: Vec<ChunkEntry>,
    pub(crate) attachments: Vec<AttachmentEntry>,
    pub(crate) metadata: Vec<MetadataEntry>,
    /// Where the data ends, and the CRC-32 of all bytes before that; `None` if the index was found without them.
    pub(crate) data_end: Option<(u64, u32)>,
    /// How many messages each channel has, by the summary; empty without one.
    pub(crate) message_counts: BTreeMap<u16, u64>,
    pub(crate) channel_lists: BTreeMap<Vec<u16>, Arc<[u16]>>,
}

/// The record that ends the data, before the summary.
pub(crate) const DATA_END: u64 = RECORD_HEADER + 4;
impl Index {
    /// Reads the summary; `None` if the file's writer did not finish it.
    pub(crate) fn of_summary(file: &PositionedFile) -> Result<Option<Self>, RecordingError> {
        let Some(start) = summary_start(file)? else { return Ok(None) };
        let mut index = Self::default();
        // The checksum covers the footer up to the checksum itself.
        let checked_end = file.size - MAGIC_LENGTH - 4;
        let (mut block, mut at, mut found) = (Vec::new(), start, Hasher::new());
        while at < checked_end {
            let length = (1 << 20).min(checked_end - at);
            file.read_range(&mut block, at, length)?;
            found.update(&block);
            at += length;
        }
        let mut crc = [0; 4];
        file.read_exact(&mut crc, checked_end)?;
        if crc != found.finalize().to_le_bytes() {
            return Err(file.damaged(start, "the summary's checksum differs").into());
        }
        file.read_exact(&mut crc, start - 4)?;
        index.data_end = Some((start - DATA_END, u32::from_le_bytes(crc)));
        let mut metadata = Vec::new();
        each_summary_record(file, (start, file.size - FOOTER), |at, opcode, body| {
            let known = index.add_summary_record(opcode, body, start, &mut metadata);
            known.ok_or_else(|| file.damaged(at, "a record of the summary is damaged"))
        })?;
        let mut record = Vec::new();
        for MetadataIndex { offset, length, .. } in metadata {
            file.read_range(&mut record, offset, length)?;
            let body = body_of(op::METADATA, &record);
            let body = body.ok_or_else(|| file.damaged(offset, "no metadata record starts there"))?;
            index.metadata.push(metadata_entry(file, offset, body)?);
        }
        index.chunks.sort_by_key(|chunk| chunk.start);
        index.channel_lists.clear();
        Ok(Some(index))
    }

    /// Adds a record of the summary, which starts at `summary`; `None` if the record is invalid.
    fn add_summary_record(
        &mut self,
        opcode: u8,
        body: &[u8],
        summary: u64,
        metadata: &mut Vec<MetadataIndex>,
    ) -> Option<()> {
        match opcode {
            op::SCHEMA => {
                let (schema, _) = read::<SchemaHeader>(body)?;
                self.schemas.insert(schema.id, schema.name);
            }
            op::CHANNEL => {
                let channel: Channel = read_all(body)?;
                self.channels.insert(channel.id, channel.into());
            }
            op::CHUNK_INDEX => {
                let chunk: ChunkIndex = read_all(body)?;
                let (start, length) = (chunk.chunk_start_offset, chunk.chunk_length);
                let end = start.checked_add(length)?.checked_add(chunk.message_index_length)?;
                let channels = self.channel_list(chunk.message_index_offsets.into_keys().collect());
                self.chunks.push(ChunkEntry { start, length, end: (end <= summary).then_some(end)?, channels });
            }
            op::ATTACHMENT_INDEX => {
                let AttachmentIndex { name, media_type, data_size: size, offset, length, .. } = read_all(body)?;
                self.attachments.push(AttachmentEntry { name, media_type, size, offset, length });
            }
            op::METADATA_INDEX => metadata.push(read_all(body)?),
            op::STATISTICS => self.message_counts = read_all::<Statistics>(body)?.channel_message_counts,
            _ => {}
        }
        Some(())
    }

    pub(crate) fn schema_of(&self, channel: &ChannelEntry) -> Option<&str> {
        self.schemas.get(&channel.schema).map(String::as_str)
    }

    /// Whether a channel is the channel of commit records.
    pub(crate) fn is_of_commits(&self, channel: u16) -> bool {
        let schema = self.channels.get(&channel).and_then(|channel| self.schema_of(channel));
        schema == Some(Schema::Commit.name())
    }

    /// Whether a chunk contains points of a learning curve.
    pub(crate) fn holds_points(&self, chunk: &ChunkEntry) -> bool {
        let [channel] = *chunk.channels else { return false };
        let schema = self.channels.get(&channel).and_then(|channel| self.schema_of(channel));
        schema == Some(Schema::CurvePoint.name())
    }

    pub(crate) fn channel_list(&mut self, channels: Vec<u16>) -> Arc<[u16]> {
        self.channel_lists.entry(channels).or_insert_with_key(|channels| channels.as_slice().into()).clone()
    }
}

/// A metadata record, checked.
///
/// The format is checked before the checksum: other formats may store checksums elsewhere.
pub(crate) fn metadata_entry(file: &PositionedFile, offset: u64, body: &[u8]) -> Result<MetadataEntry, RecordingError> {
    let damaged = || file.damaged(offset, "a metadata record is damaged");
    let Metadata { name, metadata: values } = read_all(body).ok_or_else(damaged)?;
    if name == PLAN_METADATA {
        // Metadata of another program may have the same name.
        let Some(found) = values.get("format").cloned() else {
            return Err(RecordingError::NotARecording { path: file.path.clone() });
        };
        if found != FORMAT {
            return Err(RecordingError::Format { path: file.path.clone(), found });
        }
    }
    let crc_before = unseal(&name, &values).ok_or_else(damaged)?;
    let end = offset + RECORD_HEADER + body.len() as u64;
    Ok(MetadataEntry { name, values, offset, end, crc_before })
}

/// Where the summary starts, which ends with the file; `None` if the file's writer did not finish it.
///
/// A flipped bit in the footer or after it must not make a finished file look unfinished: either the magic bytes or a
/// footer suffices.
fn summary_start(file: &PositionedFile) -> Result<Option<u64>, FileError> {
    let Some(FileEnd { offset, footer, has_magic }) = file_end(file)? else { return Ok(None) };
    let Some(start) = footer.map(|footer| footer.summary_start) else {
        return match has_magic {
            true => Err(file.damaged(offset, "the footer is damaged")),
            false => Ok(None),
        };
    };
    let mut end = [0; DATA_END as usize];
    if (MAGIC_LENGTH + DATA_END..=offset).contains(&start) {
        file.read_exact(&mut end, start - DATA_END)?;
    }
    let follows_data = end.starts_with(&[op::DATA_END, 4, 0, 0, 0, 0, 0, 0, 0]);
    match (has_magic, follows_data) {
        (true, true) => Ok(Some(start)),
        (false, false) => Ok(None),
        (true, false) => Err(file.damaged(offset, "the footer does not point to a summary")),
        (false, true) => Err(file.damaged(file.size - MAGIC_LENGTH, "the file does not end like an MCAP file")),
    }
}
