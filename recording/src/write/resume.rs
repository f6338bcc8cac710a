//! Resumes a recording that its run did not finish: what was committed stays, byte for byte, and the rest is written
//! after it.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::Path;

use crc32fast::Hasher;
use depthloom_codecs::schema::Schema;
use depthloom_graphs::Frame;
use depthloom_graphs::contracts::NodeWarning;
use depthloom_graphs::plan::{FrameIndex, NodeRef, Plan, PortId, RunId};
use depthloom_mcap::records::{Channel, MessageIndex, MessageIndexEntry, Metadata, MetadataIndex, SchemaHeader};
use depthloom_mcap::{MAGIC_LENGTH, PositionedFile, RecordPlace, Window, op, put, read, read_all};

use crate::checksum::CrcBefore;
use crate::condition::Condition;
use crate::error::RecordingError;
use crate::plan::{RecordedPlan, json};
use crate::read::attachment::AttachmentEntry;
use crate::read::chunk_messages::ChunkBuffers;
use crate::read::damage::Damage;
use crate::read::index::ChunkEntry;
use crate::read::recording::{RecordedContent, Recording};
use crate::write::attachments::experiment_files;
use crate::write::disk::{WrapFile, itself, write_all};
use crate::write::file_writer::Writer;
use crate::write::layout::ChannelLayout;
use crate::write::part::placed;
use crate::write::viewer::at_the_time_shown;
use crate::{ENDED_METADATA, PLAN_METADATA, RECOVERED};

impl Recording {
    /// Whether this recording has the plan of a run.
    #[must_use]
    pub fn has_plan(&self, plan: &Plan) -> bool {
        // The written text is compared, because numbers may differ in the last bit when read.
        let recorded = self.index.metadata.iter().find(|metadata| metadata.name == PLAN_METADATA);
        let recorded = recorded.and_then(|metadata| metadata.values.get("plan"));
        recorded == Some(&json(&RecordedPlan::from_plan(plan)))
    }

    /// Whether a run of the same experiment wrote this recording. Other inputs of
    /// the run (data, programs, engines) may have changed since.
    #[must_use]
    pub fn is_of_experiment(&self, plan: &Plan) -> bool {
        let files = experiment_files(plan);
        let mut stored = self.attachments().iter().filter(|file| !file.name.starts_with("artifacts/"));
        let has_same_files = files.iter().all(|(name, text)| {
            let is_same = |found: Result<Vec<u8>, RecordingError>| match found {
                Ok(bytes) => bytes == text.as_bytes(),
                // The copy of a damaged file says nothing.
                Err(error) => error.is_damage() && self.has_plan(plan),
            };
            stored.next().is_some_and(|file| file.name == *name) && is_same(self.attachment(name))
        });
        has_same_files && stored.next().is_none()
    }

    /// Whether the frame at a position of a stage run has the id, index and time with which this frame would be
    /// recorded there.
    #[must_use]
    pub fn is_frame(&self, run: RunId, position: FrameIndex, frame: &Frame) -> bool {
        let recorded = self.frames(run).get(position.0);
        let first = self.windows().into_iter().find(|window| window.run == run).map_or(0, |window| window.first.0);
        let frame = at_the_time_shown(FrameIndex(first + position.0), frame);
        recorded.is_some_and(|recorded| {
            (&recorded.id, recorded.index, recorded.time_ns) == (&frame.id, frame.index, frame.time_ns)
        })
    }

    /// Checks all bytes that a resumed run would keep. [`Recording::open`] reads only a part of a file with an intact
    /// summary.
    ///
    /// # Errors
    /// If they are damaged or cannot be read.
    pub fn check_committed(&self) -> Result<(), RecordingError> {
        // Without a summary, `open` has checked every byte.
        if self.index.data_end.is_none() { Ok(()) } else { check(self) }
    }

    /// Whether no frame or aggregate value was committed.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.end().is_none()
    }

    /// The offset of the end of the last complete frame or aggregate value; `None` without one.
    fn end(&self) -> Option<u64> {
        self.end_before(u64::MAX)
    }

    /// The same, of those that end before `limit`.
    fn end_before(&self, limit: u64) -> Option<u64> {
        let values =
            self.index.metadata.iter().filter(|metadata| metadata.is_of_aggregate()).map(|metadata| metadata.end);
        let is_commit =
            |chunk: &&ChunkEntry| self.sealed.binary_search_by_key(&chunk.start, |(start, _)| *start).is_ok();
        let commits = self.index.chunks.iter().filter(is_commit).map(|chunk| chunk.end);
        values.chain(commits).filter(|end| *end <= limit).max()
    }

    fn frame_count(&self) -> u64 {
        RunId::all(self.plan().runs.len()).map(|run| self.frames(run).len() as u64).sum()
    }

    /// The message index of the last commit, if the file was cut before it.
    fn missing_index(&self, end: u64) -> Vec<u8> {
        let mut index = Vec::new();
        let chunk = self.index.chunks.iter().find(|chunk| chunk.end == end && chunk.start + chunk.length == end);
        let frames = RunId::all(self.plan().runs.len()).flat_map(|run| self.frames(run));
        let frame = frames.max_by_key(|frame| frame.commit);
        if let (Some(ChunkEntry { channels, .. }), Some(frame)) = (chunk, frame) {
            let records = vec![MessageIndexEntry { log_time: frame.time_ns, offset: 0 }];
            channels
                .iter()
                .for_each(|&channel_id| put(&mut index, &MessageIndex { channel_id, records: records.clone() }));
        }
        index
    }
}

/// The result of [`recover`].
pub struct Recovered {
    /// The frames in the new file.
    pub frames: u64,
    /// The frames that the summary of the damaged file lists and the new file does not have.
    pub lost: u64,
    /// The first damage of the old file.
    pub damage: Option<RecordingError>,
}

/// Copies the complete frames and aggregate values of a recording that is unfinished or damaged, and adds a summary. Of
/// a damaged file, copies what is before the first damage.
///
/// # Errors
/// If there is no complete frame, `from` cannot be read or `to` cannot be written. Then the caller must remove `to`.
pub fn recover(from: &Recording, to: &Path) -> Result<Recovered, RecordingError> {
    // A summary can be intact although values are damaged.
    let mut by_scan = None;
    let scanned = match from.index.data_end {
        Some(_) => by_scan.insert(Recording::open_by_scan(from.path())?),
        None => from,
    };
    let damage = first_damage(from, scanned);
    let mut buffers = ChunkBuffers::default();
    let mut chunks = scanned.index.chunks.iter();
    // `first_damage` has decompressed the chunks of the summary.
    let is_checked = from.index.data_end.is_some() && damage.is_none() && has_same_chunks(from, scanned);
    let mut is_damaged = |chunk: &&ChunkEntry| buffers.each_message(&scanned.file, chunk, |_| Ok(())).is_err();
    let damaged_chunk = if is_checked { None } else { chunks.find(&mut is_damaged) };
    let Some(end) = scanned.end_before(damaged_chunk.map_or(u64::MAX, |chunk| chunk.start)) else {
        return Err(match damage {
            Some((offset, what)) => {
                scanned.file.damaged(offset, format!("{what}; no complete frame comes before it")).into()
            }
            None => {
                RecordingError::Missing { path: from.path().to_owned(), what: "complete frame to recover".to_owned() }
            }
        });
    };
    let failed = |source| RecordingError::Create { path: to.to_owned(), source };
    let mut copy = depthloom_durable::create_new(to).map_err(failed)?;
    let (mut block, mut at) = (Vec::new(), 0);
    while at < end {
        let length = (1 << 20).min(end - at);
        scanned.file.read_range(&mut block, at, length)?;
        copy.write_all(&block).map_err(failed)?;
        at += length;
    }
    drop(copy);
    let copy = Recording::open(to)?;
    let mut writer = Writer::resume(&copy, Vec::new(), end, &itself)?;
    let frames = copy.frame_count();
    if damage.is_some() || *from.condition() != Condition::Complete {
        let entries = [("frames", frames.to_string()), (RECOVERED, true.to_string())];
        writer.metadata(ENDED_METADATA, entries.map(|(name, value)| (name.to_owned(), value)).into())?;
    }
    writer.finish()?;
    let lost = from.frame_count() - frames;
    let damage = damage.map(|(offset, what)| from.file.damaged(offset, what).into());
    Ok(Recovered { frames, lost, damage })
}

fn has_same_chunks(one: &Recording, other: &Recording) -> bool {
    let places = |recording: &Recording| {
        recording.index.chunks.iter().map(|chunk| (chunk.start, chunk.length)).collect::<Vec<_>>()
    };
    places(one) == places(other)
}

/// The first damage of a recording: its offset and a message. Uses the summary if there is one, because it can name the
/// values.
fn first_damage(indexed: &Recording, scanned: &Recording) -> Option<(u64, String)> {
    if let Some(Damage { offset, bytes, content }) = indexed.damage(&|| false).first() {
        return Some((*offset, format!("{bytes} bytes from there are damaged; they contained {content}")));
    }
    match (indexed.condition(), scanned.condition()) {
        (Condition::Damaged { offset, what, .. }, _) | (_, Condition::Damaged { offset, what, .. }) => {
            Some((*offset, what.clone()))
        }
        _ => None,
    }
}

/// A resumed file, and what it already contains.
pub(crate) struct Resumed {
    pub(crate) writer: Writer,
    /// By stage run, the number of frames it contains.
    pub(crate) frames: Vec<usize>,
    /// By stage run, the position of its first frame, where the file states it.
    pub(crate) first: Vec<Option<FrameIndex>>,
    /// The keys of the aggregate values it contains, by node and port.
    pub(crate) once: BTreeMap<(NodeRef, PortId), depthloom_graphs::Key>,
    pub(crate) artifacts: BTreeSet<depthloom_graphs::Key>,
    /// The time of each stage run's first frame.
    pub(crate) first_ns: Vec<Option<u64>>,
    /// The warnings on its frames, by stage run and frame.
    pub(crate) warnings: Vec<Vec<Vec<NodeWarning>>>,
}

/// Cuts off what was not committed. The writer then appends to it. `None` if nothing was committed.
pub(crate) fn resume(
    recording: &Recording,
    channels: Vec<ChannelLayout>,
    through: WrapFile<'_>,
) -> Result<Option<Resumed>, RecordingError> {
    let Some(end) = recording.end() else { return Ok(None) };
    let writer = Writer::resume(recording, channels, end, through)?;
    let runs = RunId::all(recording.plan().runs.len());
    let once = recording.aggregate_values();
    let artifact = |content: &RecordedContent| match content {
        RecordedContent::Attachment { hash, .. } => Some(*hash),
        RecordedContent::Messages { .. } => None,
    };
    let windows = recording.windows();
    let first = |run| windows.iter().find(|window| window.run == run).map(|window| window.first);
    Ok(Some(Resumed {
        writer,
        frames: runs.clone().map(|run| recording.frames(run).len()).collect(),
        first: runs.clone().map(first).collect(),
        once: once.iter().map(|once| ((NodeRef { run: once.run, node: once.node }, once.port), once.key)).collect(),
        artifacts: once.iter().filter_map(|once| artifact(&once.content)).collect(),
        warnings: runs
            .clone()
            .map(|run| recording.frames(run).iter().map(|frame| frame.warnings.clone()).collect())
            .collect(),
        first_ns: runs.map(|run| recording.frames(run).first().map(|frame| frame.time_ns)).collect(),
    }))
}

impl Writer {
    /// Opens a file whose first `end` bytes stay.
    fn resume(
        recording: &Recording,
        channels: Vec<ChannelLayout>,
        end: u64,
        through: WrapFile<'_>,
    ) -> Result<Self, RecordingError> {
        let path = recording.path();
        let failed = |source| RecordingError::Create { path: path.to_owned(), source };
        check(recording)?;
        let mut file = depthloom_durable::open_regular(path).map_err(failed)?;
        file.set_len(end).map_err(failed)?;
        file.seek(SeekFrom::Start(end)).map_err(failed)?;
        let rest = recording.missing_index(end);
        let file = through(file);
        write_all(&*file, &rest).map_err(failed)?;
        let end = end + rest.len() as u64;
        let read = PositionedFile::open(path)?;
        let crc = CrcBefore::new(&read).up_to(end)?;
        let mut writer = Self::new(path, file, channels);
        (writer.crc, writer.position) = (Hasher::new_with_initial_len(crc, end), end);
        writer.read_existing(&read, &recording.index.attachments, end)?;
        Ok(writer)
    }

    /// Collects the summary of the records that stay.
    fn read_existing(
        &mut self,
        file: &PositionedFile,
        attachments: &[AttachmentEntry],
        end: u64,
    ) -> Result<(), RecordingError> {
        let (mut window, mut at, mut stored) = (Window::new(file), MAGIC_LENGTH, Vec::new());
        // A chunk, and the message indexes after it so far.
        let mut chunk: Option<(u64, u64)> = None;
        loop {
            let record = if at < end { window.record(at)? } else { None };
            if record.is_none_or(|record| record.opcode != op::MESSAGE_INDEX)
                && let Some((start, end)) = chunk.take()
            {
                file.read_range(&mut stored, start, end - start)?;
                self.read_existing_chunk(&stored, start).ok_or_else(|| file.damaged(start, "a chunk is damaged"))?;
            }
            let Some(RecordPlace { opcode, body, length }) = record else { return Ok(()) };
            let next = body + length;
            let damaged = || file.damaged(at, "a record is damaged");
            match opcode {
                op::CHUNK => chunk = Some((at, next)),
                op::MESSAGE_INDEX => chunk = chunk.map(|(start, _)| (start, next)),
                op::SCHEMA => {
                    let schema = window.at(body, length)?.and_then(read::<SchemaHeader>);
                    let (SchemaHeader { id, .. }, _) = schema.ok_or_else(damaged)?;
                    self.schemas_written.push(Schema::with_id(id).ok_or_else(damaged)?);
                    self.counts.schema_count += 1;
                    self.schema_records.extend_from_slice(window.at(at, next - at)?.unwrap_or_default());
                }
                op::CHANNEL => {
                    let channel = window.at(body, length)?.and_then(read_all::<Channel>).ok_or_else(damaged)?;
                    self.channels_written.push(channel.id);
                    self.counts.channel_count += 1;
                    self.channel_records.extend_from_slice(window.at(at, next - at)?.unwrap_or_default());
                }
                op::METADATA => {
                    let metadata = window.at(body, length)?.and_then(read_all::<Metadata>).ok_or_else(damaged)?;
                    self.index_metadata(&MetadataIndex { offset: at, length: next - at, name: metadata.name });
                }
                op::ATTACHMENT => {
                    let entry = attachments.iter().find(|entry| entry.offset == at).ok_or_else(damaged)?;
                    self.index_attachment(entry.clone());
                }
                _ => {}
            }
            at = next;
        }
    }

    fn read_existing_chunk(&mut self, stored: &[u8], start: u64) -> Option<()> {
        let (place, messages) = placed(stored, 0)?;
        for (channel, count) in messages {
            self.count_messages(channel, count);
        }
        self.index_chunk(start, place);
        Some(())
    }
}

/// Compares the bytes that stay with the checksum in the last commit or aggregate value among them.
fn check(recording: &Recording) -> Result<(), RecordingError> {
    let values = recording.index.metadata.iter().filter(|metadata| metadata.is_of_aggregate());
    let values = values.map(|metadata| (metadata.offset, metadata.crc_before));
    match recording.sealed.iter().copied().chain(values).max() {
        Some((start, stated)) if CrcBefore::new(&recording.file).up_to(start)? != stated => {
            Err(recording.file.damaged(start, "the bytes before are damaged").into())
        }
        _ => Ok(()),
    }
}
