//! A recording being read.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use depthloom_graphs::Key;
use depthloom_graphs::contracts::{Failure, NodeWarning, Slot, SlotKey};
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
use crate::{ENDED_METADATA, FORMAT, PLAN_METADATA, RECOVERED};
use depthloom_mcap::{FileError, PositionedFile, begins_as_mcap};

/// A frame of a stage run, committed.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedFrame {
    /// The source's own name for it.
    pub id: Arc<str>,
    /// Its index in the source, counted before any selection.
    pub index: u64,
    /// Its time, nanoseconds.
    pub time_ns: u64,
    /// The key of the source's values; `None` if the source failed.
    pub source_key: Option<Key>,
    /// The keys of the nodes' values; a node that is neither here nor under `failures` did not fire.
    pub keys: Box<[SlotKey]>,
    /// What failed on it.
    pub failures: Vec<Failure>,
    /// What was told of on it without failing.
    pub warnings: Vec<NodeWarning>,
    /// The outputs that gave nothing although their source or node fired; `None` if the recording does not say it.
    pub absent: Option<Vec<Slot>>,
    pub(crate) chunks: Range<usize>,
    pub(crate) commit: usize,
}

/// A once-value, and where its content is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedOnce {
    /// The stage run.
    pub run: RunId,
    /// The node that gave it.
    pub node: NodeId,
    /// Its output port.
    pub port: PortId,
    /// What it is: the name of a `ValueType`.
    pub value_type: String,
    /// Its key; all once-values of a node share it.
    pub key: Key,
    /// What its node told of without failing: what, and how many of it.
    pub warnings: Vec<(String, u64)>,
    /// Where its content is.
    pub content: RecordedContent,
}

/// Where the content of a once-value is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RecordedContent {
    /// In an attachment: models and samples.
    Attachment {
        /// The hash of the content.
        hash: Key,
        /// What the bytes are.
        media_type: String,
        /// The attachment's name.
        name: String,
    },
    /// In the messages of a topic, outside frames: learning curves.
    Messages {
        /// The topic.
        topic: String,
        /// How many messages.
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

/// A recording open for reading: whole, or what a crash or damage left of one, up to its last commit.
///
/// The index is held in memory, values are not. Reading is by position, so several threads may read at once.
#[derive(Debug)]
pub struct Recording {
    pub(crate) file: PositionedFile,
    pub(crate) index: Index,
    condition: Condition,
    plan: RecordedPlan,
    frames: Vec<Vec<RecordedFrame>>,
    once: Vec<RecordedOnce>,
    committed: u64,
    /// By commit: where its chunk starts, and the CRC-32 that all bytes before had.
    pub(crate) sealed: Vec<(u64, u32)>,
    pub(crate) by_key: OnceLock<BTreeMap<Key, StoredValues>>,
}

impl Recording {
    /// Opens a recording: by its summary, in little time, or by reading all of it where it has no sound one.
    ///
    /// Bytes that are not what was written are an error if they are of the plan; others leave out what stands behind
    /// them, and [`Recording::condition`] says so. Values are checked when they are read.
    ///
    /// # Errors
    /// If the file cannot be read, is no recording, or its plan is damaged or one that no engine makes.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let file = mcap_file(path.as_ref())?;
        let whole = Index::of_summary(&file).and_then(|index| index.map(|index| Loaded::of(&file, index)).transpose());
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
        Ok(Self::of(file, found, condition))
    }

    /// Opens a recording without its summary: checks every byte, and keeps what is before the first that is damaged.
    pub(crate) fn open_by_scan(path: &Path) -> Result<Self, RecordingError> {
        let file = mcap_file(path)?;
        let (found, condition) = Loaded::without_summary(&file, None)?;
        Ok(Self::of(file, found, condition))
    }

    fn of(file: PositionedFile, found: Loaded, condition: Condition) -> Self {
        let Loaded { index, plan, frames, once, committed, sealed } = found;
        Self { file, index, condition, plan, frames, once, committed, sealed, by_key: OnceLock::new() }
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.file.path
    }

    /// In what condition it was found.
    #[must_use]
    pub const fn condition(&self) -> &Condition {
        &self.condition
    }

    /// Where the last committed frame ends in the file.
    #[must_use]
    pub const fn committed_bytes(&self) -> u64 {
        self.committed
    }

    /// The plan that made it.
    #[must_use]
    pub const fn plan(&self) -> &RecordedPlan {
        &self.plan
    }

    /// Whether it is of the format that is written now: then equal values are equal bytes, and no value is stored under
    /// a wrong key.
    #[must_use]
    pub fn is_of_this_format(&self) -> bool {
        let mut of_plan = self.index.metadata.iter().filter(|metadata| metadata.name == PLAN_METADATA);
        of_plan.any(|metadata| metadata.values.get("format").is_some_and(|format| format == FORMAT))
    }

    /// The committed frames of a stage run, in order; none if there is no such run.
    #[must_use]
    pub fn frames(&self, run: RunId) -> &[RecordedFrame] {
        self.frames.get(run.0).map_or(&[], Vec::as_slice)
    }

    /// The once-values; [`Recording::once_value`] reads one.
    #[must_use]
    pub fn once_values(&self) -> &[RecordedOnce] {
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
    /// If there is none of that name, or it is damaged.
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

fn mcap_file(path: &Path) -> Result<PositionedFile, RecordingError> {
    let file = PositionedFile::open(path)?;
    if begins_as_mcap(&file)? { Ok(file) } else { Err(RecordingError::NotMcap { path: file.path }) }
}

struct Loaded {
    index: Index,
    plan: RecordedPlan,
    frames: Vec<Vec<RecordedFrame>>,
    once: Vec<RecordedOnce>,
    committed: u64,
    sealed: Vec<(u64, u32)>,
}

impl Loaded {
    fn of(file: &PositionedFile, index: Index) -> Result<Self, RecordingError> {
        let plan = read_plan(file, &index)?;
        let once = read_once(file, &index, &plan)?;
        let frames = vec![Vec::new(); plan.runs.len()];
        let mut found = Self { index, plan, frames, once, committed: 0, sealed: Vec::new() };
        found.read_commits(file)?;
        Ok(found)
    }

    /// What there is without a summary, or without the one that was found damaged.
    fn without_summary(
        file: &PositionedFile,
        damage: Option<(u64, String)>,
    ) -> Result<(Self, Condition), RecordingError> {
        let Scanned { index, condition } = scan(file)?;
        let condition = match (condition, damage) {
            (Condition::Unfinished { .. }, Some((offset, what))) => Condition::Damaged { offset, what, cut: false },
            (condition, _) => condition,
        };
        match (Self::of(file, index), &condition) {
            (Ok(found), _) => Ok((found, condition)),
            // Without a plan there is nothing to read, and why is what stopped the scan.
            (Err(RecordingError::NotARecording { .. }), Condition::Damaged { offset, what, .. }) => {
                Err(file.damaged(*offset, what).into())
            }
            (Err(error), _) => Err(error),
        }
    }

    /// The condition that the writer stated, which is right where the summary is.
    fn condition_by_metadata(&self) -> Condition {
        match self.index.metadata.iter().find(|metadata| metadata.name == ENDED_METADATA) {
            None => Condition::Whole,
            Some(ended) if ended.values.contains_key(RECOVERED) => Condition::Recovered,
            Some(_) => Condition::Unfinished { rest_bytes: 0 },
        }
    }

    /// Finds the frames: each is what stands between two commit records.
    fn read_commits(&mut self, file: &PositionedFile) -> Result<(), RecordingError> {
        let mut buffers = ChunkBuffers::default();
        let mut first = 0;
        for (position, chunk) in self.index.chunks.iter().enumerate() {
            if first == position && self.index.holds_points(chunk) {
                // Between two frames, and of neither.
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
                .ok_or_else(|| file.damaged(chunk.start, "a frame is of a run or a node that the plan does not have"))?
                .push(frame);
            first = position + 1;
            self.committed = chunk.end;
            self.sealed.push((chunk.start, crc_before));
        }
        Ok(())
    }
}

/// The stage run of a frame, the frame, and the CRC-32 that all bytes before its commit had.
fn committed(
    time_ns: u64,
    message: &[u8],
    chunks: Range<usize>,
    commit: usize,
) -> Result<(RunId, RecordedFrame, u32), String> {
    let told = CommitMessage::decode(message).map_err(|error| format!("a commit record is invalid: {error}"))?;
    let frame = RecordedFrame {
        id: told.frame.as_str().into(),
        index: told.index,
        time_ns,
        source_key: told.source_key().ok_or("a commit record has an invalid cache key")?,
        keys: told.keys().ok_or("a commit record has an invalid cache key")?.into_boxed_slice(),
        failures: told.failures(),
        warnings: told.warnings(),
        absent: told.absent(),
        chunks,
        commit,
    };
    Ok((RunId(told.run as usize), frame, told.crc32_before))
}

fn read_plan(file: &PositionedFile, index: &Index) -> Result<RecordedPlan, RecordingError> {
    let path = || file.path.clone();
    let found = index.metadata.iter().find(|metadata| metadata.name == PLAN_METADATA);
    let MetadataEntry { values, .. } = found.ok_or_else(|| RecordingError::NotARecording { path: path() })?;
    let plan = values.get("plan").ok_or_else(|| RecordingError::NotARecording { path: path() })?;
    RecordedPlan::from_json(plan).map_err(|what| RecordingError::Content { path: path(), what })
}

fn read_once(file: &PositionedFile, index: &Index, plan: &RecordedPlan) -> Result<Vec<RecordedOnce>, RecordingError> {
    let once = index.metadata.iter().filter(|metadata| metadata.is_of_once());
    let read = |metadata: &MetadataEntry| {
        let text = |name: &str| metadata.values.get(name).cloned();
        let number = |name: &str| metadata.values.get(name)?.parse::<usize>().ok();
        let (run, node, port) = (RunId(number("run")?), NodeId(number("node")?), PortId(number("port")?));
        let output = plan.runs.get(run.0)?.nodes.get(node.0)?.outputs.get(port.0)?;
        Some(RecordedOnce {
            run,
            node,
            port,
            value_type: text("type").filter(|name| output.once && *name == output.value_type)?,
            key: Key::parse(&text("key")?)?,
            warnings: text("warnings").map_or(Some(Vec::new()), |told| serde_json::from_str(&told).ok())?,
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
    let no_value = || RecordingError::Content {
        path: file.path.clone(),
        what: "the record of a once-value names none that its plan has".to_owned(),
    };
    once.map(|metadata| read(metadata).ok_or_else(no_value)).collect()
}

impl RecordedFrame {
    pub(crate) fn chunks<'a>(&self, index: &'a Index) -> &'a [ChunkEntry] {
        &index.chunks[self.chunks.clone()]
    }
}
