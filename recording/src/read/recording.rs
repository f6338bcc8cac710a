//! An open recording.

use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use depthloom_graphs::Key;
use depthloom_graphs::contracts::{Drops, Failure, LiveCommit, NodeWarning, Slot, SlotKey};
use depthloom_graphs::plan::{FrameIndex, NodeId, PortId, RunId};
use prost::Message;

use crate::commit_message::CommitMessage;
use crate::condition::Condition;
use crate::error::RecordingError;
use crate::plan::RecordedPlan;
use crate::read::attachment::AttachmentEntry;
use crate::read::chunk_messages::ChunkBuffers;
use crate::read::damaged_content::DamagedContent;
use crate::read::index::{ChunkEntry, Index, MetadataEntry};
use crate::read::recovery_scan::{Scanned, scan};
use crate::reuse::key_index::KeyIndex;
use crate::write::file_writer::LIBRARY;
use crate::{ENDED_METADATA, PLAN_METADATA, RECOVERED, WINDOW_METADATA};
use depthloom_mcap::records::{Header, Metadata};
use depthloom_mcap::{
    FileError, MAGIC_LENGTH, OpenFiles, PositionedFile, RecordPlace, Window, begins_as_mcap, op, read_all,
};

/// A committed frame of a stage run.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedFrame {
    /// The name that the source gave it.
    pub id: Arc<str>,
    /// Its index in the source, counted before any selection.
    pub index: u64,
    /// Its time, nanoseconds.
    pub time_ns: u64,
    /// The key of the source's values; `None` if the source failed.
    pub source_key: Option<Key>,
    /// The keys of the nodes' values; a node that is neither here nor under `failures` did not run.
    pub keys: Box<[SlotKey]>,
    /// The failures on it.
    pub failures: Vec<Failure>,
    /// The warnings on it.
    pub warnings: Vec<NodeWarning>,
    /// The outputs without a value although their source or node ran; `None` if the recording does not state them.
    pub absent: Option<Vec<Slot>>,
    /// Its drops and latency, of a live run.
    pub live: Option<LiveCommit>,
    pub(crate) chunks: Range<usize>,
    pub(crate) commit: usize,
}

/// The frames of a stage run in a recording that does not have all: those from a position on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordedWindow {
    /// The stage run.
    pub run: RunId,
    /// The position in the stage run of the first frame that was recorded.
    pub first: FrameIndex,
}

/// The frames of the live runs of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LiveTotals {
    /// The frames that were recorded.
    pub frames: u64,
    /// The frames that were dropped before or between these.
    pub dropped: Drops,
}

/// An aggregate value, and where its content is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedAggregate {
    /// The stage run.
    pub run: RunId,
    /// The node that computed it.
    pub node: NodeId,
    /// Its output port.
    pub port: PortId,
    /// Its type: the name of a `ValueType`.
    pub value_type: String,
    /// Its key; all aggregate values of a node share it.
    pub key: Key,
    /// The warnings of its node: the message, and the number of affected things.
    pub warnings: Vec<(String, u64)>,
    /// Where its content is.
    pub content: RecordedContent,
}

/// Where the content of an aggregate value is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RecordedContent {
    /// In an attachment: models and samples.
    Attachment {
        /// The hash of the content.
        hash: Key,
        /// Its media type.
        media_type: String,
        /// The attachment's name.
        name: String,
    },
    /// In the messages of a topic, outside frames: learning curves.
    Messages {
        /// The topic.
        topic: String,
        /// The number of messages.
        count: u64,
    },
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum StoredValues {
    /// Those of a run's source (`node: None`) or node on a frame.
    Frame {
        run: RunId,
        position: FrameIndex,
        node: Option<NodeId>,
    },
    Once {
        run: RunId,
        node: NodeId,
    },
}

/// A recording open for reading: complete, or the undamaged part up to its last commit.
///
/// Memory holds the index, not the values. Reading is by offset, so several threads may read at once.
#[derive(Debug)]
pub struct Recording {
    pub(crate) file: PositionedFile,
    pub(crate) index: Index,
    condition: Condition,
    plan: RecordedPlan,
    frames: Vec<Vec<RecordedFrame>>,
    once: Vec<RecordedAggregate>,
    committed: u64,
    /// By commit: where its chunk starts, and the CRC-32 of all bytes before it.
    pub(crate) sealed: Vec<(u64, u32)>,
    pub(crate) by_key: OnceLock<KeyIndex>,
}

impl Recording {
    /// Opens a recording: fast by its summary, or by reading the complete file if it has no undamaged summary.
    ///
    /// Damaged bytes of the plan are an error. Other damage leaves out what follows it, and [`Recording::condition`]
    /// reports it. Values are checked when they are read.
    ///
    /// # Errors
    /// If the file cannot be read, is not a recording, or its plan is damaged or invalid.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        Self::open_file(PositionedFile::open(path.as_ref())?)
    }

    /// As [`Recording::open`], one of many recordings of which only some are open. The folder of an unfinished run is
    /// renamed when the run finishes.
    pub(crate) fn open_on_demand(path: &Path, files: &Arc<OpenFiles>) -> Result<Self, RecordingError> {
        let moved = path.parent().zip(path.file_name()).and_then(|(run, name)| {
            let is_partial = run.extension().is_some_and(|ending| ending == depthloom_durable::PARTIAL);
            is_partial.then(|| run.with_extension("").join(name))
        });
        Self::open_file(PositionedFile::open_on_demand(path, files, moved)?)
    }

    fn open_file(file: PositionedFile) -> Result<Self, RecordingError> {
        let file = mcap_file(file)?;
        let whole = Index::of_summary(&file).and_then(|index| index.map(|index| Loaded::new(&file, index)).transpose());
        let (found, condition) = match whole {
            Ok(Some(found)) => {
                let condition = found.condition_by_metadata();
                (found, condition)
            }
            Ok(None) => Loaded::without_summary(&file, None)?,
            Err(RecordingError::File(FileError::Damaged { offset, what, .. })) => {
                Loaded::without_summary(&file, Some((offset, what)))?
            }
            Err(error) => return Err(error),
        };
        Ok(Self::new(file, found, condition))
    }

    /// Opens a recording without its summary: checks every byte, and keeps what is before the first damage.
    pub(crate) fn open_by_scan(path: &Path) -> Result<Self, RecordingError> {
        let file = mcap_file(PositionedFile::open(path)?)?;
        let (found, condition) = Loaded::without_summary(&file, None)?;
        Ok(Self::new(file, found, condition))
    }

    fn new(file: PositionedFile, found: Loaded, condition: Condition) -> Self {
        let Loaded { index, plan, frames, once, committed, sealed } = found;
        Self { file, index, condition, plan, frames, once, committed, sealed, by_key: OnceLock::new() }
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.file.path
    }

    /// The condition in which the recording was found.
    #[must_use]
    pub const fn condition(&self) -> &Condition {
        &self.condition
    }

    /// The offset of the end of the last committed frame.
    #[must_use]
    pub const fn committed_bytes(&self) -> u64 {
        self.committed
    }

    /// The plan of its run.
    #[must_use]
    pub const fn plan(&self) -> &RecordedPlan {
        &self.plan
    }

    /// The committed frames of a stage run, in order; empty if there is no such run.
    #[must_use]
    pub fn frames(&self, run: RunId) -> &[RecordedFrame] {
        self.frames.get(run.0).map_or(&[], Vec::as_slice)
    }

    /// Which frames were recorded, of a ring or of a shard: those of these stage runs. Empty for other recordings.
    #[must_use]
    pub fn windows(&self) -> Vec<RecordedWindow> {
        let entries = self.index.metadata.iter().filter(|metadata| metadata.name == WINDOW_METADATA);
        let window = |entry: &MetadataEntry| {
            let number = |name: &str| entry.values.get(name)?.parse::<usize>().ok();
            Some(RecordedWindow { run: RunId(number("run")?), first: FrameIndex(number("first")?) })
        };
        entries.filter_map(window).collect()
    }

    /// The frames of live runs, and the frames that these dropped; `None` without such frames. Frames dropped after the
    /// last one are not counted.
    #[must_use]
    pub fn live_totals(&self) -> Option<LiveTotals> {
        let live: Vec<LiveCommit> = self.frames.iter().flatten().filter_map(|frame| frame.live).collect();
        let mut dropped = Drops::default();
        live.iter().for_each(|live| dropped += live.drops);
        (!live.is_empty()).then_some(LiveTotals { frames: live.len() as u64, dropped })
    }

    /// The aggregate values; [`Recording::aggregate_value`] reads one.
    #[must_use]
    pub fn aggregate_values(&self) -> &[RecordedAggregate] {
        &self.once
    }

    /// The attachments.
    #[must_use]
    pub fn attachments(&self) -> &[AttachmentEntry] {
        &self.index.attachments
    }

    /// The content of an attachment, checked.
    ///
    /// # Errors
    /// If the recording has no attachment of that name, or it is damaged.
    pub fn attachment(&self, name: &str) -> Result<Vec<u8>, RecordingError> {
        let entry = self.index.attachments.iter().find(|entry| entry.name == name);
        let entry = entry.ok_or_else(|| RecordingError::Missing {
            path: self.file.path.clone(),
            what: format!("attachment `{name}`"),
        })?;
        entry
            .read(&self.file)
            .map_err(|error| RecordingError::from(error).with_content(&DamagedContent::Attachment(name.to_owned())))
    }
}

fn mcap_file(file: PositionedFile) -> Result<PositionedFile, RecordingError> {
    if begins_as_mcap(&file)? { Ok(file) } else { Err(RecordingError::NotMcap { path: file.path }) }
}

/// Whether another program wrote an MCAP file: its header names another library, and no plan follows.
fn is_foreign(file: &PositionedFile) -> Result<bool, FileError> {
    let mut window = Window::new(file);
    let Some(RecordPlace { opcode: op::HEADER, body, length }) = window.record(MAGIC_LENGTH)? else { return Ok(false) };
    let header = window.at(body, length)?.and_then(read_all::<Header>);
    if header.is_none_or(|header| header.library == LIBRARY) {
        return Ok(false);
    }
    // One changed byte does not make a recording of depthloom another program's.
    let next = window.record(body + length)?;
    let Some(RecordPlace { opcode: op::METADATA, body, length }) = next else { return Ok(true) };
    let metadata = window.at(body, length)?.and_then(read_all::<Metadata>);
    Ok(metadata.is_some_and(|metadata| metadata.name != PLAN_METADATA))
}

struct Loaded {
    index: Index,
    plan: RecordedPlan,
    frames: Vec<Vec<RecordedFrame>>,
    once: Vec<RecordedAggregate>,
    committed: u64,
    sealed: Vec<(u64, u32)>,
}

impl Loaded {
    fn new(file: &PositionedFile, index: Index) -> Result<Self, RecordingError> {
        let plan = read_plan(file, &index)?;
        let once = read_aggregates(file, &index, &plan)?;
        let frames = vec![Vec::new(); plan.runs.len()];
        let mut found = Self { index, plan, frames, once, committed: 0, sealed: Vec::new() };
        found.read_commits(file)?;
        Ok(found)
    }

    /// The content without a summary, or without a damaged one.
    fn without_summary(
        file: &PositionedFile,
        damage: Option<(u64, String)>,
    ) -> Result<(Self, Condition), RecordingError> {
        let Scanned { index, condition } = scan(file)?;
        let condition = match (condition, damage) {
            (Condition::Unfinished { .. }, Some((offset, what))) => Condition::Damaged { offset, what, cut: false },
            (condition, _) => condition,
        };
        match (Self::new(file, index), &condition) {
            (Ok(found), _) => Ok((found, condition)),
            (Err(error @ RecordingError::NotARecording { .. }), _) if is_foreign(file)? => Err(error),
            // Without a plan nothing can be read; the error is what stopped the scan.
            (Err(RecordingError::NotARecording { .. }), Condition::Damaged { offset, what, .. }) => {
                Err(file.damaged(*offset, what).into())
            }
            (Err(error), _) => Err(error),
        }
    }

    /// The condition according to the metadata, which is right if the summary is.
    fn condition_by_metadata(&self) -> Condition {
        match self.index.metadata.iter().find(|metadata| metadata.name == ENDED_METADATA) {
            None => Condition::Complete,
            Some(ended) if ended.values.contains_key(RECOVERED) => Condition::Recovered,
            Some(_) => Condition::Unfinished { rest_bytes: 0 },
        }
    }

    /// Finds the frames: each is between two commit records.
    fn read_commits(&mut self, file: &PositionedFile) -> Result<(), RecordingError> {
        let mut buffers = ChunkBuffers::default();
        let mut first = 0;
        for (position, chunk) in self.index.chunks.iter().enumerate() {
            if first == position && self.index.holds_points(chunk) {
                // Between two frames, and not part of either.
                first = position + 1;
                continue;
            }
            if !matches!(*chunk.channels, [channel] if self.index.is_of_commits(channel)) {
                continue;
            }
            let mut found = None;
            let chunks = first..position;
            buffers.each_message(file, chunk, |message| {
                found = Some(committed(message.time_ns, message.data, chunks.clone(), self.sealed.len())?);
                Ok(())
            })?;
            let (run, frame, crc_before) = found.ok_or_else(|| file.damaged(chunk.start, "a commit chunk is empty"))?;
            let nodes = self.plan.runs.get(run.0).map_or(0, |run| run.nodes.len());
            let mut of_nodes =
                frame.keys.iter().map(|of| of.node).chain(frame.failures.iter().filter_map(|of| of.node));
            let is_of_plan = of_nodes.all(|node| node.0 < nodes);
            let frames = self.frames.get_mut(run.0).filter(|_| is_of_plan);
            frames
                .ok_or_else(|| {
                    file.damaged(chunk.start, "a frame belongs to a run or a node that the plan does not have")
                })?
                .push(frame);
            first = position + 1;
            self.committed = chunk.end;
            self.sealed.push((chunk.start, crc_before));
        }
        Ok(())
    }
}

/// The stage run of a frame, the frame, and the CRC-32 of all bytes before its commit.
fn committed(
    time_ns: u64,
    message: &[u8],
    chunks: Range<usize>,
    commit: usize,
) -> Result<(RunId, RecordedFrame, u32), String> {
    let commit_message =
        CommitMessage::decode(message).map_err(|error| format!("a commit record is invalid: {error}"))?;
    let frame = RecordedFrame {
        id: commit_message.frame.as_str().into(),
        index: commit_message.index,
        time_ns,
        source_key: commit_message.source_key().ok_or("a commit record has an invalid cache key")?,
        keys: commit_message.keys().ok_or("a commit record has an invalid cache key")?.into_boxed_slice(),
        failures: commit_message.failures(),
        warnings: commit_message.warnings(),
        absent: commit_message.absent(),
        live: commit_message.live(),
        chunks,
        commit,
    };
    Ok((RunId(commit_message.run as usize), frame, commit_message.crc32_before))
}

fn read_plan(file: &PositionedFile, index: &Index) -> Result<RecordedPlan, RecordingError> {
    let path = || file.path.clone();
    let found = index.metadata.iter().find(|metadata| metadata.name == PLAN_METADATA);
    let MetadataEntry { values, .. } = found.ok_or_else(|| RecordingError::NotARecording { path: path() })?;
    let plan = values.get("plan").ok_or_else(|| RecordingError::NotARecording { path: path() })?;
    RecordedPlan::from_json(plan).map_err(|what| RecordingError::Content { path: path(), what })
}

fn read_aggregates(
    file: &PositionedFile,
    index: &Index,
    plan: &RecordedPlan,
) -> Result<Vec<RecordedAggregate>, RecordingError> {
    let once = index.metadata.iter().filter(|metadata| metadata.is_of_aggregate());
    let read = |metadata: &MetadataEntry| {
        let text = |name: &str| metadata.values.get(name).cloned();
        let number = |name: &str| metadata.values.get(name)?.parse::<usize>().ok();
        let (run, node, port) = (RunId(number("run")?), NodeId(number("node")?), PortId(number("port")?));
        let output = plan.runs.get(run.0)?.nodes.get(node.0)?.outputs.get(port.0)?;
        Some(RecordedAggregate {
            run,
            node,
            port,
            value_type: text("type").filter(|name| output.once && *name == output.value_type)?,
            key: Key::parse(&text("key")?)?,
            warnings: text("warnings").map_or(Some(Vec::new()), |warnings| serde_json::from_str(&warnings).ok())?,
            content: match text("attachment") {
                Some(name) => RecordedContent::Attachment {
                    hash: Key::parse(&text("hash")?)?,
                    media_type: text("media_type")?,
                    name,
                },
                None => RecordedContent::Messages { topic: text("topic")?, count: number("messages")? as u64 },
            },
        })
    };
    let unknown_value = || RecordingError::Content {
        path: file.path.clone(),
        what: "the record of an aggregate value names an output that the plan does not have".to_owned(),
    };
    once.map(|metadata| read(metadata).ok_or_else(unknown_value)).collect()
}

impl RecordedFrame {
    pub(crate) fn chunks<'a>(&self, index: &'a Index) -> &'a [ChunkEntry] {
        &index.chunks[self.chunks.clone()]
    }
}
