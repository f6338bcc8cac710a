//! The file of a recording being written: appends, and knows what the summary must say.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crc32fast::Hasher;
use mcap::records::op;

use crate::checksum::seal;
use crate::error::RecordingError;
use crate::record::{
    ChunkPlace, Counts, put_attachment, put_attachment_index, put_channel, put_chunk_index, put_data_end, put_footer,
    put_header, put_metadata, put_metadata_index, put_schema, put_statistics, put_summary_offset,
};
use crate::write::background_sync::EarlySync;
use crate::write::chunk_indexes::ChunkIndexes;
use crate::write::disk::{Disk, Through, write_all};
use crate::write::layout::ChannelLayout;
use crate::write::part::Part;
use depthloom_codecs::schema::Schema;

/// The library named in the file's header: no version, since equal runs are equal files.
pub(crate) const LIBRARY: &str = "depthloom";

/// Appends to a recording's file.
///
/// Nothing is held back in this process, so what was written is there if the process is killed. Schemas and channels are
/// written when the first message needs them.
pub(crate) struct Writer {
    path: PathBuf,
    file: Arc<dyn Disk>,
    early_sync: EarlySync,
    pub(crate) position: u64,
    pub(crate) crc: Hasher,
    channels: Vec<ChannelLayout>,
    pub(crate) schemas_written: Vec<Schema>,
    pub(crate) channels_written: Vec<u16>,
    pub(crate) counts: Counts,
    /// The records of the summary, in the bytes in which they will be written: the least memory.
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
        through: Through<'_>,
    ) -> Result<Self, RecordingError> {
        let file = depthloom_durable::create_in_place(path)
            .map_err(|source| RecordingError::Create { path: path.to_owned(), source })?;
        let mut writer = Self::of(path, through(file), channels);
        let mut start = mcap::MAGIC.to_vec();
        put_header(&mut start, LIBRARY);
        writer.append(&start)?;
        Ok(writer)
    }

    /// Of a file that holds nothing.
    pub(crate) fn of(path: &Path, file: Arc<dyn Disk>, channels: Vec<ChannelLayout>) -> Self {
        Self {
            path: path.to_owned(),
            early_sync: EarlySync::new(Arc::clone(&file)),
            file,
            position: 0,
            crc: Hasher::new(),
            channels,
            schemas_written: Vec::new(),
            channels_written: Vec::new(),
            counts: Counts::default(),
            schema_records: Vec::new(),
            channel_records: Vec::new(),
            chunk_indexes: ChunkIndexes::default(),
            attachment_indexes: Vec::new(),
            metadata_indexes: Vec::new(),
            closed: None,
        }
    }

    /// Appends the chunks of a part.
    pub(crate) fn part(&mut self, part: &Part) -> Result<(), RecordingError> {
        if part.chunks.is_empty() {
            return Ok(());
        }
        self.declare(&part.messages)?;
        for channel in &part.messages {
            *self.counts.messages.entry(*channel).or_default() += 1;
        }
        let base = self.position;
        self.append_checked(&part.bytes, &part.crc)?;
        part.chunks.iter().for_each(|chunk| self.index_chunk(base, chunk));
        Ok(())
    }

    /// Notes where a chunk lies that is `base` bytes farther than it says.
    pub(crate) fn index_chunk(&mut self, base: u64, chunk: &ChunkPlace) {
        self.chunk_indexes.put(|out| put_chunk_index(out, base, chunk));
        self.counts.chunks += 1;
        let (first, last) = self.counts.times_ns.unwrap_or(chunk.times_ns);
        self.counts.times_ns = Some((first.min(chunk.times_ns.0), last.max(chunk.times_ns.1)));
    }

    /// Appends the part that `make` makes of the CRC-32 of all bytes before it; its messages are of one channel.
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
        let (offset, length) = (self.position, record.len() as u64);
        self.append(&record)?;
        put_attachment_index(&mut self.attachment_indexes, offset, length, data.len() as u64, name, media_type);
        self.counts.attachments += 1;
        Ok(())
    }

    /// Appends a metadata record, with its checksums.
    pub(crate) fn metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) -> Result<(), RecordingError> {
        let mut record = Vec::new();
        put_metadata(&mut record, name, &seal(name, metadata, self.crc.clone().finalize()));
        let (offset, length) = (self.position, record.len() as u64);
        self.append(&record)?;
        put_metadata_index(&mut self.metadata_indexes, offset, length, name);
        self.counts.metadata += 1;
        Ok(())
    }

    /// Waits until all that was written is on the disk, and the file's name.
    pub(crate) fn sync(&mut self) -> Result<(), RecordingError> {
        let early = self.early_sync.finish();
        let synchronised =
            early.and_then(|()| self.file.sync_all()).and_then(|()| depthloom_durable::sync_name(&self.path));
        synchronised.map_err(|source| self.refused(source))
    }

    /// Writes the summary, and waits until the file is on the disk; nothing can be written after it. Gives the file's size and what it holds.
    pub(crate) fn finish(&mut self) -> Result<(u64, Counts), RecordingError> {
        let mut end = Vec::new();
        put_data_end(&mut end, self.crc.clone().finalize());
        self.append(&end)?;
        let start = self.position;
        let mut before = std::mem::take(&mut self.schema_records);
        let schemas_end = before.len();
        before.append(&mut self.channel_records);
        let channels_end = before.len();
        put_statistics(&mut before, &self.counts);
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
                put_summary_offset(&mut after, opcode, start + group_start, group_end - group_start);
            }
            group_start = group_end;
        }
        let mut crc = Hasher::new();
        crc.update(&before);
        self.append(&before)?;
        // The chunks' indexes are by far the most: they never lie in memory as a whole.
        let chunks = std::mem::take(&mut self.chunk_indexes);
        for records in chunks.blocks() {
            let records = records.map_err(|source| self.refused(source))?;
            crc.update(&records);
            self.append(&records)?;
        }
        put_footer(&mut after, crc, start, offsets_start);
        after.extend_from_slice(mcap::MAGIC);
        self.append(&after)?;
        self.sync()?;
        self.closed = Some("it is finished");
        Ok((self.position, self.counts.clone()))
    }

    /// Appends the channels, and their schemas, that are not there already.
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
                put_schema(&mut out, schema.id(), schema.name(), schema.descriptor_set());
                self.schema_records.extend_from_slice(&out[start..]);
                self.schemas_written.push(schema);
                self.counts.schemas += 1;
            }
            let start = out.len();
            put_channel(&mut out, id, schema.id(), &channel.topic, &channel.metadata);
            self.channel_records.extend_from_slice(&out[start..]);
            self.channels_written.push(id);
            self.counts.channels += 1;
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
