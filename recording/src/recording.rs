//! A recording being read.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use depthloom_graphs::Key;
use depthloom_graphs::contracts::{Failure, SlotKey};
use mcap::records::{Record, op};
use prost::Message;

use crate::error::RecordingError;
use crate::file::PositionedFile;
use crate::index::{AttachmentEntry, ChannelEntry, ChunkEntry, Index, MetadataEntry};
use crate::messages::CommitMessage;
use crate::plan::RecordedPlan;
use crate::reader::FrameReader;
use crate::schema::Schema;
use crate::store::KeyedPlace;
use crate::unpack::ChunkBuffers;
use crate::{FORMAT, ONCE_METADATA, PLAN_METADATA};

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
    pub(crate) chunks: Range<usize>,
}

/// A once-value, and where its content is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedOnce {
    /// The stage run.
    pub run: usize,
    /// The node that gave it.
    pub node: usize,
    /// Its output port.
    pub port: usize,
    /// What it is: the name of a `ValueType`.
    pub value_type: String,
    /// Its key; all once-values of a node share it.
    pub key: Key,
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

/// A recording open for reading: whole, or what a crash left of one, up to its last commit.
///
/// The index is held in memory, values are not. Reading is by position, so several threads may read at once.
#[derive(Debug)]
pub struct Recording {
    pub(crate) file: PositionedFile,
    pub(crate) index: Index,
    plan: RecordedPlan,
    frames: Vec<Vec<RecordedFrame>>,
    once: Vec<RecordedOnce>,
    committed: u64,
    pub(crate) by_key: OnceLock<BTreeMap<Key, KeyedPlace>>,
}

impl Recording {
    /// Opens a recording.
    ///
    /// # Errors
    /// If the file cannot be read, is no recording, or is damaged.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let file = PositionedFile::open(path.as_ref())?;
        let index = Index::read(&file)?;
        let plan = read_plan(&file, &index)?;
        let once = read_once(&file, &index, plan.runs.len())?;
        let mut recording = Self {
            frames: vec![Vec::new(); plan.runs.len()],
            file,
            index,
            plan,
            once,
            committed: 0,
            by_key: OnceLock::new(),
        };
        recording.read_commits()?;
        Ok(recording)
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.file.path
    }

    /// Whether its writer finished it.
    #[must_use]
    pub const fn whole(&self) -> bool {
        self.index.whole
    }

    /// Where the last committed frame ends in the file: what stands behind it in an unfinished file belongs to no frame.
    #[must_use]
    pub const fn committed_bytes(&self) -> u64 {
        self.committed
    }

    /// The plan that made it.
    #[must_use]
    pub const fn plan(&self) -> &RecordedPlan {
        &self.plan
    }

    /// The committed frames of a stage run, in order; none if there is no such run.
    #[must_use]
    pub fn frames(&self, run: usize) -> &[RecordedFrame] {
        self.frames.get(run).map_or(&[], Vec::as_slice)
    }

    /// A reader of some of a stage run's topics; each may be an alias.
    ///
    /// # Errors
    /// If the run has no such topic, or did not record it.
    pub fn reader(&self, run: usize, topics: &[impl AsRef<str>]) -> Result<FrameReader<'_>, RecordingError> {
        FrameReader::new(self, run, topics)
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
        let mut record = Vec::new();
        self.file.read_range(&mut record, entry.offset, entry.length)?;
        match mcap::parse_record(op::ATTACHMENT, record.get(9..).unwrap_or_default()) {
            Ok(Record::Attachment { data, .. }) => Ok(data.into_owned()),
            Ok(_) => Err(self.file.damaged(entry.offset, "no attachment is there")),
            Err(error) => Err(self.file.damaged(entry.offset, error.to_string())),
        }
    }

    /// The chunks of all committed frames, each frame's commit record last, and of all learning curves, in the order of the file.
    pub(crate) fn committed_chunks(&self) -> impl Iterator<Item = &ChunkEntry> {
        self.index.chunks.iter().filter(|chunk| chunk.end <= self.committed || self.holds_whole_curve(chunk))
    }

    /// Finds the frames: each is what stands between two commit records.
    fn read_commits(&mut self) -> Result<(), RecordingError> {
        let is_commit = |(id, channel): (&u16, &ChannelEntry)| {
            (self.index.schema_of(channel) == Some(Schema::Commit.name())).then_some(*id)
        };
        let commits: Vec<u16> = self.index.channels.iter().filter_map(is_commit).collect();
        let mut buffers = ChunkBuffers::default();
        let mut first = 0;
        for (position, chunk) in self.index.chunks.iter().enumerate() {
            if first == position && self.holds_points(chunk) {
                // Between two frames, and of neither.
                first = position + 1;
                continue;
            }
            if !matches!(*chunk.channels, [channel] if commits.contains(&channel)) {
                continue;
            }
            let mut found = None;
            let chunks = first..position;
            buffers.each_message(&self.file, chunk, |message| {
                found = Some(committed(message.time_ns, message.data, chunks.clone())?);
                Ok(())
            })?;
            let (run, frame) = found.ok_or_else(|| self.file.damaged(chunk.start, "a commit chunk is empty"))?;
            let frames = self.frames.get_mut(run);
            frames
                .ok_or_else(|| self.file.damaged(chunk.start, "a frame is of a run the plan does not have"))?
                .push(frame);
            first = position + 1;
            self.committed = chunk.end;
        }
        Ok(())
    }
}

fn committed(time_ns: u64, message: &[u8], chunks: Range<usize>) -> Result<(usize, RecordedFrame), String> {
    let commit = CommitMessage::decode(message).map_err(|error| format!("a commit record is none: {error}"))?;
    let frame = RecordedFrame {
        id: commit.frame.as_str().into(),
        index: commit.index,
        time_ns,
        source_key: commit.source_key(),
        keys: commit.keys().ok_or("a commit record holds a key that is none")?.into_boxed_slice(),
        failures: commit.failures(),
        chunks,
    };
    Ok((commit.run as usize, frame))
}

fn read_plan(file: &PositionedFile, index: &Index) -> Result<RecordedPlan, RecordingError> {
    let path = || file.path.clone();
    let found = index.metadata.iter().find(|metadata| metadata.name == PLAN_METADATA);
    let MetadataEntry { values, .. } = found.ok_or_else(|| RecordingError::NotARecording { path: path() })?;
    let format = values.get("format").cloned().unwrap_or_default();
    if format != FORMAT {
        return Err(RecordingError::Format { path: path(), found: format, known: FORMAT });
    }
    let plan = values.get("plan").ok_or_else(|| RecordingError::NotARecording { path: path() })?;
    serde_json::from_str(plan).map_err(|error| file.damaged(0, format!("its plan cannot be read: {error}")))
}

fn read_once(file: &PositionedFile, index: &Index, runs: usize) -> Result<Vec<RecordedOnce>, RecordingError> {
    let once = index.metadata.iter().filter(|metadata| metadata.name == ONCE_METADATA);
    let read = |metadata: &MetadataEntry| {
        let text = |name: &str| metadata.values.get(name).cloned();
        let number = |name: &str| metadata.values.get(name)?.parse().ok();
        Some(RecordedOnce {
            run: number("run").filter(|run| *run < runs)?,
            node: number("node")?,
            port: number("port")?,
            value_type: text("type")?,
            key: Key::parse(&text("key")?)?,
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
    once.map(|metadata| read(metadata).ok_or_else(|| file.damaged(0, "the record of a once-value is incomplete")))
        .collect()
}

impl RecordedFrame {
    /// The chunks that hold its values.
    pub(crate) fn chunks<'a>(&self, index: &'a Index) -> &'a [ChunkEntry] {
        &index.chunks[self.chunks.clone()]
    }
}
