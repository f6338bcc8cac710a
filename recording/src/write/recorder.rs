//! A recording that is being written: the sink of a run.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use depthloom_graphs::contracts::{Commit, ErrorMessage, NodeWarning, Sink, Slot, Store, StoredValue, stored_values};
use depthloom_graphs::plan::{FrameIndex, NodeRef, PartId, Plan, PortId, RunId};
use depthloom_graphs::values::{Artifact, Curve};
use depthloom_graphs::{Frame, Key, Value};
use prost::Message;

use crate::commit_message::CommitMessage;
use crate::error::RecordingError;
use crate::plan::{RecordedPlan, json};
use crate::read::curve::points_part;
use crate::read::recording::Recording;
use crate::reuse::earlier_runs::EarlierRuns;
use crate::reuse::stored_bytes::{CopyTarget, StoredBytes};
use crate::write::attachments::{Attachment, artifact_name, experiment_files};
use crate::write::buffer_pool::PartPools;
use crate::write::compression::put_port_value;
use crate::write::disk::{WrapFile, itself};
use crate::write::file_writer::Writer;
use crate::write::layout::{Class, FileLayout, PortLayout, RunLayout};
use crate::write::part::{Part, PartBuilder, Unkept};
use crate::write::resume::{Resumed, resume};
use crate::write::viewer::{BEGINNING_NS, at_the_time_shown};
use crate::{AGGREGATE_METADATA, ENDED_METADATA, FORMAT, LARGEST_CHUNK, PLAN_METADATA};
use depthloom_codecs::decode::nothing_found;
use depthloom_threads::locked;

/// Statistics of a finished recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written {
    /// The file's size.
    pub bytes: u64,
    /// The number of committed frames, over all stage runs.
    pub frames: u64,
    /// The number of messages.
    pub messages: u64,
    /// The number of chunks.
    pub chunks: u64,
}

/// The time for compressing one class of topics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Compression {
    /// The class: `camera`, `truth`, `fixed-point`, `maps`, `scores`.
    pub class: &'static str,
    /// CPU time, over all frames written, nanoseconds.
    pub cpu_ns: u64,
}

/// Writes the values of a run into one MCAP file.
///
/// Parts are encoded and compressed by [`Sink::encode`] on the calling thread; [`Sink::write`] only appends bytes.
/// After every frame, the file can be read up to that frame, even if the process is killed.
pub struct Recorder {
    path: PathBuf,
    layout: FileLayout,
    every: u64,
    /// By stage run and part; the commit records' pools come last.
    pools: Vec<Vec<PartPools>>,
    state: Mutex<State>,
    earlier: Option<Arc<EarlierRuns>>,
    /// Whether every frame waits for the disk.
    durable: bool,
    /// Frames by stage run, and aggregate values, that an earlier process wrote.
    written: Vec<usize>,
    once: BTreeMap<(NodeRef, PortId), Key>,
    /// The warnings on these frames, by stage run and frame.
    warnings: Vec<Vec<Vec<NodeWarning>>>,
}

struct State {
    writer: Writer,
    frames: u64,
    artifacts: BTreeSet<Key>,
    /// The number of committed frames of each stage run, and the time of the first.
    committed: Vec<usize>,
    first_ns: Vec<Option<u64>>,
    /// By stage run and part.
    compress_ns: Vec<Vec<u64>>,
}

impl Recorder {
    /// Creates the file (usually under a name that changes when it is complete), and writes the plan and the
    /// experiment's files.
    ///
    /// # Errors
    /// If the plan cannot be recorded, or the file cannot be created.
    pub fn create(path: impl Into<PathBuf>, plan: &Plan) -> Result<Self, RecordingError> {
        Self::create_through(path, plan, &itself)
    }

    /// As [`Recorder::create`], but tests can wrap the file to let writes fail.
    ///
    /// # Errors
    /// As [`Recorder::create`].
    pub fn create_through(
        path: impl Into<PathBuf>,
        plan: &Plan,
        through: WrapFile<'_>,
    ) -> Result<Self, RecordingError> {
        let path = path.into();
        let layout = FileLayout::new(plan)?;
        let recorded = RecordedPlan::from_plan(plan);
        let mut writer = Writer::create(&path, layout.channels.clone(), through)?;
        let metadata = BTreeMap::from([
            ("format".to_owned(), FORMAT.to_owned()),
            ("plan".to_owned(), json(&recorded)),
            ("aliases".to_owned(), json(&layout.aliases(&recorded))),
        ]);
        writer.metadata(PLAN_METADATA, metadata)?;
        for (name, text) in experiment_files(plan) {
            writer.attachment(&name, "application/yaml", text.as_bytes())?;
        }
        let runs = layout.runs.len();
        let (frames, first_ns, warnings) = (vec![0; runs], vec![None; runs], Vec::new());
        let nothing = Resumed { writer, frames, once: BTreeMap::new(), artifacts: BTreeSet::new(), first_ns, warnings };
        Ok(Self::new(path, plan, layout, nothing))
    }

    /// Resumes the recording of an interrupted run after its last commit; the bytes are those of an uninterrupted run.
    /// The recording must have this plan ([`Recording::has_plan`]). Its values for frames that are processed again are
    /// reused from `earlier`, which must contain the recording.
    ///
    /// # Errors
    /// If the file cannot be read or written, or is damaged.
    pub fn resume(recording: &Recording, plan: &Plan) -> Result<Self, RecordingError> {
        Self::resume_through(recording, plan, &itself)
    }

    /// As [`Recorder::resume`], but tests can wrap the file to let writes fail.
    ///
    /// # Errors
    /// As [`Recorder::resume`].
    pub fn resume_through(recording: &Recording, plan: &Plan, through: WrapFile<'_>) -> Result<Self, RecordingError> {
        let layout = FileLayout::new(plan)?;
        match resume(recording, layout.channels.clone(), through)? {
            Some(resumed) => Ok(Self::new(recording.path().to_owned(), plan, layout, resumed)),
            None => Self::create_through(recording.path(), plan, through),
        }
    }

    fn new(path: PathBuf, plan: &Plan, layout: FileLayout, resumed: Resumed) -> Self {
        let pools_of = |run: &RunLayout| (0..=run.parts).map(|_| PartPools::default()).collect();
        let pools = layout.runs.iter().map(pools_of).collect();
        let compress_ns = layout.runs.iter().map(|run| vec![0; run.parts]).collect();
        let Resumed { writer, frames: written, once, artifacts, first_ns, warnings } = resumed;
        let frames = written.iter().sum::<usize>() as u64;
        let state = Mutex::new(State { writer, frames, artifacts, committed: written.clone(), first_ns, compress_ns });
        let every = plan.record.every.max(1);
        Self { path, layout, every, pools, state, earlier: None, durable: false, written, once, warnings }
    }

    /// Waits for the disk after every frame.
    #[must_use]
    pub fn durable(self, durable: bool) -> Self {
        Self { durable, ..self }
    }

    /// The number of frames in the recording so far, over all stage runs.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.state().frames
    }

    /// Reuses values of earlier runs.
    #[must_use]
    pub fn with_earlier(self, earlier: Arc<EarlierRuns>) -> Self {
        Self { earlier: Some(earlier).filter(|earlier| !earlier.is_empty()), ..self }
    }

    /// The file being written.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The time for compression in a stage run so far, by class.
    ///
    /// # Panics
    /// If the plan has no such stage run.
    #[must_use]
    pub fn compression(&self, run: RunId) -> Vec<Compression> {
        let state = self.state();
        let spent = self.layout.runs[run].classes.iter().zip(&state.compress_ns[run]);
        spent.map(|(class, cpu_ns)| Compression { class: class.name(), cpu_ns: *cpu_ns }).collect()
    }

    /// Adds the attachments, writes the summary and closes the file.
    ///
    /// # Errors
    /// If the disk refuses, or did before.
    pub fn finish(&self, attachments: &[Attachment]) -> Result<Written, RecordingError> {
        let mut state = self.state();
        for attachment in attachments {
            state.writer.attachment(&attachment.name, &attachment.media_type, &attachment.bytes)?;
        }
        state.close()
    }

    /// Writes the summary and closes the file of a run that ended early, which the file then states.
    ///
    /// # Errors
    /// If the disk refuses, or did before.
    pub fn finish_early(&self) -> Result<Written, RecordingError> {
        let mut state = self.state();
        let frames = state.frames.to_string();
        state.writer.metadata(ENDED_METADATA, BTreeMap::from([("frames".to_owned(), frames)]))?;
        state.close()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A thread that panicked in here can only leave a writer that refuses further writes.
        locked(&self.state)
    }

    /// Adds a value to a part, if it is recorded on this frame.
    fn add(
        &self,
        part: &mut PartBuilder<'_>,
        run: RunId,
        (position, frame): (FrameIndex, &Frame),
        (slot, value): (Slot, &Value),
        others: &[(Slot, Value)],
    ) -> Result<(), ErrorMessage> {
        let Some(port) = self.layout.runs[run].port(slot) else { return Ok(()) };
        let refused = match value {
            Value::Samples(_) | Value::Model(_) | Value::Reliability(_) | Value::Curve(_) => {
                Some(format!("a value of type {} came with a frame", value.value_type()))
            }
            Value::Disparity(disparity) if nothing_found(disparity.min_disparity_px).is_none() => {
                Some(format!("disparities from {} px on do not fit into 16 bits", disparity.min_disparity_px))
            }
            _ => None,
        };
        if let Some(what) = refused {
            let (frame, topic) = (frame.id.to_string(), port.topic.to_string());
            return Err(RecordingError::Value { frame, topic, what }.into());
        }
        if self.keeps(run, slot, position) {
            let put = put_port_value(part, frame, port, value);
            let put = put.and_then(|()| {
                port.companions.iter().try_for_each(|companion| companion.put(part, frame, value, others))
            });
            put.map_err(|why| self.unkept(frame, why))?;
        }
        Ok(())
    }

    fn unkept(&self, frame: &Frame, why: Unkept) -> ErrorMessage {
        match why {
            Unkept::TooLarge { channel, bytes } => {
                let topic = self.layout.channels[usize::from(channel) - 1].topic.clone();
                RecordingError::Value { frame: frame.id.to_string(), topic, what: too_large(bytes) }.into()
            }
            Unkept::Compression(error) => {
                let what = format!("failed to compress frame {} for {}", frame.id, self.path.display());
                ErrorMessage::new(what).because(error)
            }
        }
    }
}

impl Sink for Recorder {
    type Part = Part;

    fn parts(&self, run: RunId) -> usize {
        self.layout.runs[run].parts
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        Some(self.layout.runs[run].port(slot)?.part)
    }

    fn encode(
        &self,
        run: RunId,
        (position, frame): (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<Part, ErrorMessage> {
        let frame = &at_the_time_shown(position, frame);
        let mut builder = PartBuilder::new(frame, &self.pools[run][part]);
        for (slot, value) in values {
            self.add(&mut builder, run, (position, frame), (*slot, value), values)?;
        }
        Ok(builder.finish())
    }

    fn encode_stored(
        &self,
        run: RunId,
        (position, frame): (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
        stored: &[StoredValue<'_>],
    ) -> Result<Part, ErrorMessage> {
        let frame = &at_the_time_shown(position, frame);
        let target = CopyTarget { layout: &self.layout.runs[run], channels: &self.layout.channels, frame, stored };
        let recorded = stored.iter().filter(|stored| self.keeps(run, stored.slot, position));
        let found = recorded
            .map(|stored| (stored, self.earlier.as_ref().and_then(|earlier| earlier.stored_bytes(&target, stored))));
        let (copied, others): (Vec<_>, Vec<_>) = found.partition(|(_, bytes)| bytes.is_some());
        let others = match &self.earlier {
            Some(earlier) => stored_values(earlier.as_ref(), others.into_iter().map(|(stored, _)| stored))?,
            None => Vec::new(),
        };
        // The inputs of points are needed as values, also if they are stored.
        let made = values.iter().chain(&others).filter_map(|(slot, _)| self.layout.runs[run].port(*slot));
        let needed: BTreeSet<Slot> = made.flat_map(PortLayout::needed).collect();
        let mut inputs: Vec<(Slot, Value)> =
            values.iter().chain(&others).filter(|(slot, _)| needed.contains(slot)).cloned().collect();
        if let Some(earlier) = &self.earlier {
            let missing = copied.iter().map(|(stored, _)| *stored).filter(|stored| needed.contains(&stored.slot));
            inputs.extend(stored_values(earlier.as_ref(), missing)?);
        }
        // In plan order, which is the order of slots.
        let mut all: Vec<(Slot, Content<'_>)> =
            values.iter().chain(&others).map(|(slot, value)| (*slot, Content::Value(value))).collect();
        all.extend(
            copied.into_iter().filter_map(|(stored, bytes)| Some((stored.slot, Content::Stored(stored.key, bytes?)))),
        );
        all.sort_by_key(|(slot, _)| *slot);
        let mut builder = PartBuilder::new(frame, &self.pools[run][part]);
        for (slot, content) in all {
            match content {
                Content::Value(value) => self.add(&mut builder, run, (position, frame), (slot, value), &inputs)?,
                Content::Stored(key, bytes) => {
                    bytes.copy(&key, &mut builder)?.map_err(|why| self.unkept(frame, why))?;
                }
            }
        }
        Ok(builder.finish())
    }

    fn keeps(&self, run: RunId, slot: Slot, position: FrameIndex) -> bool {
        let port = self.layout.runs[run].port(slot);
        port.is_some_and(|port| (position.0 as u64).is_multiple_of(self.every) || port.class == Class::Rows)
    }

    fn written(&self, run: RunId) -> usize {
        self.written[run]
    }

    fn recorded_warnings(&self, run: RunId) -> Vec<Vec<NodeWarning>> {
        self.warnings.get(run.0).cloned().unwrap_or_default()
    }

    fn written_aggregate(&self, run: RunId, slot: Slot) -> Option<Key> {
        match slot {
            Slot::Node { node, port } => self.once.get(&(NodeRef { run, node }, port)).copied(),
            Slot::Source { .. } => None,
        }
    }

    fn store(&self) -> Option<&dyn Store> {
        self.earlier.as_deref().map(|earlier| earlier as &dyn Store)
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<Part>) -> Result<(), ErrorMessage> {
        let layout = &self.layout.runs[commit.run];
        let pools = &self.pools[commit.run];
        let mut state = self.state();
        for (spent, part) in state.compress_ns[commit.run].iter_mut().zip(&parts) {
            *spent += part.compress_ns;
        }
        for (part, pools) in parts.into_iter().zip(pools) {
            state.writer.part(&part)?;
            pools.bytes.put(part.bytes);
        }
        let pools = &pools[layout.parts];
        // All frames of a stage run are committed, in order.
        let frame = at_the_time_shown(FrameIndex(state.committed[commit.run]), commit.frame);
        let closing = |crc32_before| {
            let message = CommitMessage::new(commit, crc32_before).encode_to_vec();
            let mut closing = PartBuilder::new(&frame, pools);
            closing.small(layout.commit_channel, &message).expect("a commit record is small");
            closing.finish()
        };
        let closing = state.writer.closing_part(layout.commit_channel, closing)?;
        pools.bytes.put(closing.bytes);
        if self.durable {
            state.writer.sync()?;
        }
        state.frames += 1;
        state.committed[commit.run] += 1;
        state.first_ns[commit.run].get_or_insert(frame.time_ns);
        Ok(())
    }

    fn once(
        &self,
        run: RunId,
        slot: Slot,
        key: &Key,
        value: &Value,
        warnings: &[NodeWarning],
    ) -> Result<(), ErrorMessage> {
        let Slot::Node { node, port } = slot else {
            return Err(ErrorMessage::new("a source has no aggregate values"));
        };
        let mut state = self.state();
        let content = match value {
            Value::Samples(artifact) | Value::Model(artifact) | Value::Reliability(artifact) => {
                state.keep_artifact(artifact)
            }
            Value::Curve(curve) => {
                let channel = self.layout.runs[run]
                    .curve_channel(slot)
                    .ok_or_else(|| ErrorMessage::new("a learning curve of a port that is not recorded"))?;
                state.keep_curve(run, channel, &self.layout.channels[usize::from(channel) - 1].topic, curve)
            }
            other => {
                let what = format!("an aggregate value of type {} cannot be recorded", other.value_type());
                return Err(ErrorMessage::new(what));
            }
        };
        let entries = [
            ("run", run.to_string()),
            ("node", node.to_string()),
            ("port", port.to_string()),
            ("type", value.value_type().name().to_owned()),
            ("key", key.to_string()),
        ];
        let content = content?;
        let warnings: Vec<(&str, u64)> =
            warnings.iter().map(|warning| (warning.what.as_str(), warning.count)).collect();
        let warnings = (!warnings.is_empty()).then(|| ("warnings", json(&warnings)));
        let metadata =
            entries.into_iter().chain(content).chain(warnings).map(|(name, text)| (name.to_owned(), text)).collect();
        // Content before this record counts as an aggregate value only once this record names it: this commits it. It
        // may be the result of hours.
        let name = format!("{AGGREGATE_METADATA}{}", self.layout.runs[run].aggregate_topic(slot));
        state.writer.metadata(&name, metadata).and_then(|()| state.writer.sync()).map_err(ErrorMessage::from)
    }
}

/// A value of a part: in memory, or as stored bytes of an earlier run.
enum Content<'a> {
    Value(&'a Value),
    Stored(Key, StoredBytes<'a>),
}

/// The entries of an aggregate value's record that state where its content is.
type AggregateEntries = Vec<(&'static str, String)>;

impl State {
    fn close(&mut self) -> Result<Written, RecordingError> {
        let (bytes, counts) = self.writer.finish()?;
        let (messages, chunks) = (counts.message_count, u64::from(counts.chunk_count));
        Ok(Written { bytes, frames: self.frames, messages, chunks })
    }

    /// Stores an artefact as an attachment; equal ones once.
    fn keep_artifact(&mut self, artifact: &Artifact) -> Result<AggregateEntries, RecordingError> {
        let name = artifact_name(artifact);
        if self.artifacts.insert(artifact.hash) {
            self.writer.attachment(&name, &artifact.media_type, &artifact.bytes)?;
        }
        let hash = artifact.hash.to_string();
        Ok(vec![("hash", hash), ("media_type", artifact.media_type.clone()), ("attachment", name)])
    }

    /// Stores a learning curve as messages of its topic.
    fn keep_curve(
        &mut self,
        run: RunId,
        channel: u16,
        topic: &str,
        curve: &Curve,
    ) -> Result<AggregateEntries, RecordingError> {
        let points = points_part(channel, self.first_ns[run].unwrap_or(BEGINNING_NS), curve);
        if let Some(chunk) = points.chunks.iter().find(|chunk| chunk.uncompressed_size > LARGEST_CHUNK) {
            let what = too_large(chunk.uncompressed_size);
            return Err(RecordingError::Plan { topic: topic.to_owned(), what });
        }
        self.writer.part(&points)?;
        Ok(vec![("topic", topic.to_owned()), ("messages", curve.points.len().to_string())])
    }
}

fn too_large(bytes: u64) -> String {
    format!("{bytes} bytes are more than the {LARGEST_CHUNK} that a recording can store as one message")
}
