//! The file of a recording that is being written: appends, and collects the summary.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crc32fast::Hasher;
use depthloom_mcap::records::{
    AttachmentHeader, AttachmentIndex, Channel, ChunkIndex, DataEnd, Footer, Header, Metadata, MetadataIndex,
    SchemaHeader, Statistics, SummaryOffset,
};
use depthloom_mcap::{MAGIC, op, put, put_fields, put_record};

use crate::checksum::seal;
use crate::error::RecordingError;
use crate::read::attachment::AttachmentEntry;
use crate::write::background_sync::EarlySync;
use crate::write::chunk_indexes::ChunkIndexes;
use crate::write::disk::{Disk, WrapFile, write_all};
use crate::write::layout::ChannelLayout;
use crate::write::part::Part;
use depthloom_codecs::schema::Schema;

/// The library named in the file's header: without a version, because equal runs write equal files.
pub(crate) const LIBRARY: &str = "depthloom";
const PROTOBUF: &str = "protobuf";

/// Appends to a recording's file.
///
/// Nothing is buffered in this process, so everything written survives if the process is killed. Schemas and channels
/// are written before the first message that needs them.
pub(crate) struct Writer {
    path: PathBuf,
    file: Arc<dyn Disk>,
    early_sync: EarlySync,
    pub(crate) position: u64,
    pub(crate) crc: Hasher,
    channels: Vec<ChannelLayout>,
    pub(crate) schemas_written: Vec<Schema>,
    pub(crate) channels_written: Vec<u16>,
    pub(crate) counts: Statistics,
    /// The records of the summary as bytes, which takes the least memory.
    pub(crate) schema_records: Vec<u8>,
    pub(crate) channel_records: Vec<u8>,
    chunk_indexes: ChunkIndexes,
    pub(crate) attachment_indexes: Vec<u8>,
    pub(crate) metadata_indexes: Vec<u8>,
    closed: Option<&'static str>,
}

impl Writer {
    pub(crate) fn create(
        path: &Path,
        channels: Vec<ChannelLayout>,
        through: WrapFile<'_>,
    ) -> Result<Self, RecordingError> {
        let file = depthloom_durable::create_in_place(path)
            .map_err(|source| RecordingError::Create { path: path.to_owned(), source })?;
        Self::begin(path, channels, through(file))
    }

    /// Writes the start of a recording to its empty file.
    pub(crate) fn begin(
        path: &Path,
        channels: Vec<ChannelLayout>,
        file: Arc<dyn Disk>,
    ) -> Result<Self, RecordingError> {
        let mut writer = Self::new(path, file, channels);
        let mut start = MAGIC.to_vec();
        put(&mut start, &Header { profile: String::new(), library: LIBRARY.to_owned() });
        writer.append(&start)?;
        Ok(writer)
    }

    pub(crate) fn new(path: &Path, file: Arc<dyn Disk>, channels: Vec<ChannelLayout>) -> Self {
        Self {
            path: path.to_owned(),
            early_sync: EarlySync::new(Arc::clone(&file)),
            file,
            position: 0,
            crc: Hasher::new(),
            channels,
            schemas_written: Vec::new(),
            channels_written: Vec::new(),
            counts: Statistics::default(),
            schema_records: Vec::new(),
            channel_records: Vec::new(),
            chunk_indexes: ChunkIndexes::default(),
            attachment_indexes: Vec::new(),
            metadata_indexes: Vec::new(),
            closed: None,
        }
    }

    pub(crate) fn part(&mut self, part: &Part) -> Result<(), RecordingError> {
        if part.chunks.is_empty() {
            return Ok(());
        }
        self.declare(&part.messages)?;
        for channel in &part.messages {
            self.count_messages(*channel, 1);
        }
        let base = self.position;
        self.append_checked(&part.bytes, &part.crc)?;
        part.chunks.iter().for_each(|chunk| self.index_chunk(base, chunk.clone()));
        Ok(())
    }

    pub(crate) fn count_messages(&mut self, channel: u16, count: u64) {
        self.counts.message_count += count;
        *self.counts.channel_message_counts.entry(channel).or_default() += count;
    }

    /// Adds the index of a chunk; `base` is added to its offsets.
    pub(crate) fn index_chunk(&mut self, base: u64, mut chunk: ChunkIndex) {
        chunk.chunk_start_offset += base;
        chunk.message_index_offsets.values_mut().for_each(|offset| *offset += base);
        self.chunk_indexes.put(|out| put(out, &chunk));
        let ChunkIndex { message_start_time: first, message_end_time: last, .. } = chunk;
        let counts = &mut self.counts;
        counts.message_start_time = if counts.chunk_count == 0 { first } else { counts.message_start_time.min(first) };
        counts.message_end_time = counts.message_end_time.max(last);
        counts.chunk_count += 1;
    }

    /// Appends the part that `make` returns for the CRC-32 of all bytes before it; its messages have one channel.
    pub(crate) fn closing_part(
        &mut self,
        channel: u16,
        make: impl FnOnce(u32) -> Part,
    ) -> Result<Part, RecordingError> {
        self.declare(&[channel])?;
        let part = make(self.crc.clone().finalize());
        self.part(&part)?;
        Ok(part)
    }

    pub(crate) fn attachment(&mut self, name: &str, media_type: &str, data: &[u8]) -> Result<(), RecordingError> {
        let mut record = Vec::with_capacity(data.len() + name.len() + media_type.len() + 64);
        put_attachment(&mut record, name, media_type, data);
        let (offset, length, size) = (self.position, record.len() as u64, data.len() as u64);
        self.append(&record)?;
        let (name, media_type) = (name.to_owned(), media_type.to_owned());
        self.index_attachment(AttachmentEntry { name, media_type, size, offset, length });
        Ok(())
    }

    pub(crate) fn metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) -> Result<(), RecordingError> {
        let mut record = Vec::new();
        let metadata = seal(name, metadata, self.crc.clone().finalize());
        put(&mut record, &Metadata { name: name.to_owned(), metadata });
        let (offset, length) = (self.position, record.len() as u64);
        self.append(&record)?;
        self.index_metadata(&MetadataIndex { offset, length, name: name.to_owned() });
        Ok(())
    }

    pub(crate) fn index_attachment(&mut self, entry: AttachmentEntry) {
        let AttachmentEntry { name, media_type, size: data_size, offset, length } = entry;
        let index = AttachmentIndex { offset, length, log_time: 0, create_time: 0, data_size, name, media_type };
        put(&mut self.attachment_indexes, &index);
        self.counts.attachment_count += 1;
    }

    pub(crate) fn index_metadata(&mut self, index: &MetadataIndex) {
        put(&mut self.metadata_indexes, index);
        self.counts.metadata_count += 1;
    }

    /// Waits until everything written and the file's name are on the disk.
    pub(crate) fn sync(&mut self) -> Result<(), RecordingError> {
        let early = self.early_sync.finish();
        let synchronised =
            early.and_then(|()| self.file.sync_all()).and_then(|()| depthloom_durable::sync_name(&self.path));
        synchronised.map_err(|source| self.refused(source))
    }

    /// Writes the summary, and waits until the file is on the disk; nothing can be written afterwards. Returns the
    /// file's size and statistics.
    pub(crate) fn finish(&mut self) -> Result<(u64, Statistics), RecordingError> {
        let mut end = Vec::new();
        put(&mut end, &DataEnd { data_section_crc: self.crc.clone().finalize() });
        self.append(&end)?;
        let start = self.position;
        let mut before = std::mem::take(&mut self.schema_records);
        let schemas_end = before.len();
        before.append(&mut self.channel_records);
        let channels_end = before.len();
        put(&mut before, &self.counts);
        let mut after = std::mem::take(&mut self.attachment_indexes);
        let attachments = after.len();
        after.append(&mut self.metadata_indexes);
        let chunks_end = before.len() as u64 + self.chunk_indexes.length();
        let groups = [
            (op::SCHEMA, schemas_end as u64),
            (op::CHANNEL, channels_end as u64),
            (op::STATISTICS, before.len() as u64),
            (op::CHUNK_INDEX, chunks_end),
            (op::ATTACHMENT_INDEX, chunks_end + attachments as u64),
            (op::METADATA_INDEX, chunks_end + after.len() as u64),
        ];
        let offsets_start = start + chunks_end + after.len() as u64;
        let mut group_start = 0;
        for (opcode, group_end) in groups {
            if group_end > group_start {
                let (group_start, group_length) = (start + group_start, group_end - group_start);
                put(&mut after, &SummaryOffset { group_opcode: opcode, group_start, group_length });
            }
            group_start = group_end;
        }
        let mut crc = Hasher::new();
        crc.update(&before);
        self.append(&before)?;
        // The chunk indexes are by far the largest part: they are never completely in memory.
        let chunks = std::mem::take(&mut self.chunk_indexes);
        for records in chunks.blocks() {
            let records = records.map_err(|source| self.refused(source))?;
            crc.update(&records);
            self.append(&records)?;
        }
        put_footer(&mut after, crc, start, offsets_start);
        after.extend_from_slice(MAGIC);
        self.append(&after)?;
        self.sync()?;
        self.closed = Some("it is finished");
        Ok((self.position, self.counts.clone()))
    }

    /// Replaces the schema of a channel that is not written yet.
    pub(crate) fn set_schema(&mut self, channel: u16, schema: Schema) {
        self.channels[usize::from(channel) - 1].schema = schema;
    }

    /// Appends the channels, and their schemas, that are not written yet.
    fn declare(&mut self, channels: &[u16]) -> Result<(), RecordingError> {
        let mut out = Vec::new();
        for &id in channels {
            if self.channels_written.contains(&id) {
                continue;
            }
            let channel = &self.channels[usize::from(id) - 1];
            let schema = channel.schema;
            if !self.schemas_written.contains(&schema) {
                let start = out.len();
                put_schema(&mut out, schema);
                self.schema_records.extend_from_slice(&out[start..]);
                self.schemas_written.push(schema);
                self.counts.schema_count += 1;
            }
            let start = out.len();
            let (topic, metadata) = (channel.topic.clone(), channel.metadata.clone());
            put(
                &mut out,
                &Channel { id, schema_id: schema.id(), topic, message_encoding: PROTOBUF.to_owned(), metadata },
            );
            self.channel_records.extend_from_slice(&out[start..]);
            self.channels_written.push(id);
            self.counts.channel_count += 1;
        }
        if out.is_empty() { Ok(()) } else { self.append(&out) }
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), RecordingError> {
        let mut crc = Hasher::new();
        crc.update(bytes);
        self.append_checked(bytes, &crc)
    }

    fn append_checked(&mut self, bytes: &[u8], crc: &Hasher) -> Result<(), RecordingError> {
        if let Some(why) = self.closed {
            return Err(RecordingError::Closed { path: self.path.clone(), why });
        }
        write_all(&*self.file, bytes).map_err(|source| self.refused(source))?;
        self.position += bytes.len() as u64;
        self.early_sync.written(bytes.len() as u64);
        self.crc.combine(crc);
        Ok(())
    }

    fn refused(&mut self, source: io::Error) -> RecordingError {
        self.closed = Some("an earlier write failed");
        RecordingError::Write { path: self.path.clone(), offset: self.position, source }
    }
}

fn put_schema(out: &mut Vec<u8>, schema: Schema) {
    put_record(out, op::SCHEMA, |out| {
        let (name, encoding) = (schema.name().to_owned(), PROTOBUF.to_owned());
        put_fields(out, &SchemaHeader { id: schema.id(), name, encoding });
        let data = schema.descriptor_set();
        out.extend_from_slice(&(data.len() as u32).to_le_bytes());
        out.extend_from_slice(data);
    });
}

/// Appends an attachment, with its checksum. Its times are zero, because equal runs write equal files.
fn put_attachment(out: &mut Vec<u8>, name: &str, media_type: &str, data: &[u8]) {
    put_record(out, op::ATTACHMENT, |out| {
        let (start, name, media_type) = (out.len(), name.to_owned(), media_type.to_owned());
        put_fields(out, &AttachmentHeader { log_time: 0, create_time: 0, name, media_type });
        out.extend_from_slice(&(data.len() as u64).to_le_bytes());
        out.extend_from_slice(data);
        let crc = crc32fast::hash(&out[start..]);
        out.extend_from_slice(&crc.to_le_bytes());
    });
}

/// Appends the footer to the end of a summary section. The footer contains the section's checksum; `before` is the
/// checksum of the bytes before this end.
fn put_footer(summary: &mut Vec<u8>, before: Hasher, summary_start: u64, summary_offset_start: u64) {
    let (start, mut crc) = (summary.len(), before);
    let mut footer = Footer { summary_start, summary_offset_start, summary_crc: 0 };
    put(summary, &footer);
    // The checksum covers the footer up to the checksum itself.
    crc.update(&summary[..summary.len() - 4]);
    footer.summary_crc = crc.finalize();
    summary.truncate(start);
    put(summary, &footer);
}
