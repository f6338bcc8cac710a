//! A recording that is being written: the sink of a run.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use depthloom_codecs::schema::Schema;
use depthloom_graphs::contracts::{Commit, ErrorMessage, NodeWarning, Sink, Slot, Store, StoredValue};
use depthloom_graphs::plan::{FrameIndex, NodeRef, PartId, Plan, PortId, RunId};
use depthloom_graphs::values::{Artifact, Curve};
use depthloom_graphs::{Frame, Key, Value};

use crate::error::RecordingError;
use crate::plan::{RecordedPlan, json};
use crate::read::curve::points_part;
use crate::read::recording::{RecordedWindow, Recording};
use crate::reuse::earlier_runs::EarlierRuns;
use crate::write::attachments::{Attachment, artifact_name, experiment_files};
use crate::write::disk::{Disk, WrapFile, itself};
use crate::write::file_writer::Writer;
use crate::write::layout::FileLayout;
use crate::write::part::Part;
use crate::write::part_encoder::{PartEncoder, too_large};
use crate::write::resume::{Resumed, resume};
use crate::write::viewer::{BEGINNING_NS, at_the_time_shown};
use crate::{AGGREGATE_METADATA, ENDED_METADATA, FORMAT, LARGEST_CHUNK, PLAN_METADATA, WINDOW_METADATA};
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
    encoder: PartEncoder,
    state: Mutex<State>,
    /// Whether every frame waits for the disk.
    durable: bool,
    /// Whether frames are recorded, not only aggregate values.
    records_frames: bool,
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
    /// By stage run, the position of the first frame, where the recording states it.
    first: Vec<Option<FrameIndex>>,
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
        let writer = Writer::create(&path, layout.channels.clone(), through)?;
        Self::begin(path, plan, layout, writer)
    }

    /// As [`Recorder::create`], in an empty file that is open.
    pub(crate) fn create_in(path: &Path, file: Arc<dyn Disk>, plan: &Plan) -> Result<Self, RecordingError> {
        let layout = FileLayout::new(plan)?;
        let writer = Writer::begin(path, layout.channels.clone(), file)?;
        Self::begin(path.to_owned(), plan, layout, writer)
    }

    fn begin(path: PathBuf, plan: &Plan, layout: FileLayout, mut writer: Writer) -> Result<Self, RecordingError> {
        let recorded = RecordedPlan::from_plan(plan);
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
        let nothing = Resumed {
            writer,
            frames: vec![0; runs],
            first: vec![None; runs],
            once: BTreeMap::new(),
            artifacts: BTreeSet::new(),
            first_ns: vec![None; runs],
            warnings: Vec::new(),
        };
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
        let compress_ns = layout.runs.iter().map(|run| vec![0; run.parts]).collect();
        let Resumed { writer, frames: written, first, once, artifacts, first_ns, warnings } = resumed;
        let frames = written.iter().sum::<usize>() as u64;
        let committed = written.clone();
        let state = Mutex::new(State { writer, frames, artifacts, first, committed, first_ns, compress_ns });
        let encoder = PartEncoder::new(path.clone(), layout, plan.record.every);
        Self { path, encoder, state, durable: false, records_frames: true, written, once, warnings }
    }

    /// Waits for the disk after every frame.
    #[must_use]
    pub fn durable(self, durable: bool) -> Self {
        Self { durable, ..self }
    }

    /// Records only frames of some stage runs, from a position on. A resumed recording states that already.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn with_windows(self, windows: &[RecordedWindow]) -> Result<Self, RecordingError> {
        if self.state().first.iter().all(Option::is_none) {
            windows.iter().try_for_each(|window| self.record_window(*window))?;
        }
        Ok(self)
    }

    /// Records aggregate values only.
    #[must_use]
    pub fn without_frames(self) -> Self {
        Self { records_frames: false, ..self }
    }

    /// The number of frames in the recording so far, over all stage runs.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.state().frames
    }

    /// Reuses values of earlier runs.
    #[must_use]
    pub fn with_earlier(mut self, earlier: Arc<EarlierRuns>) -> Self {
        self.encoder.set_earlier(earlier);
        self
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
        let spent = self.encoder.layout.runs[run].classes.iter().zip(&state.compress_ns[run]);
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

    /// States that the file has only frames of stage runs with a window, from a position on.
    pub(crate) fn record_window(&self, window: RecordedWindow) -> Result<(), RecordingError> {
        let entries = [("run", window.run.0), ("first", window.first.0)];
        let entries = entries.map(|(name, number)| (name.to_owned(), number.to_string()));
        let mut state = self.state();
        state.first[window.run] = Some(window.first);
        state.writer.metadata(WINDOW_METADATA, entries.into())
    }

    /// Appends a frame: its parts, then its commit record. `position` is the frame's position in its stage run; `None`
    /// after the frames that were appended before.
    pub(crate) fn append(
        &self,
        commit: &Commit<'_>,
        position: Option<FrameIndex>,
        parts: &[Part],
    ) -> Result<(), ErrorMessage> {
        let mut state = self.state();
        for (spent, part) in state.compress_ns[commit.run].iter_mut().zip(parts) {
            *spent += part.compress_ns;
        }
        parts.iter().try_for_each(|part| state.writer.part(part))?;
        let channel = self.encoder.layout.runs[commit.run].commit_channel;
        if commit.live.is_some() {
            state.writer.set_schema(channel, Schema::LiveCommit);
        }
        // All frames of a stage run, or of its window, are committed, in order.
        let first = state.first[commit.run].map_or(0, |first| first.0);
        let position = position.unwrap_or(FrameIndex(first + state.committed[commit.run]));
        let frame = at_the_time_shown(position, commit.frame);
        let closing = state.writer.closing_part(channel, |crc| self.encoder.commit_part(commit, &frame, crc))?;
        self.encoder.recycle_commit(commit.run, closing);
        if self.durable {
            state.writer.sync()?;
        }
        state.frames += 1;
        state.committed[commit.run] += 1;
        state.first_ns[commit.run].get_or_insert(frame.time_ns);
        Ok(())
    }
}

impl Sink for Recorder {
    type Part = Part;

    fn parts(&self, run: RunId) -> usize {
        self.encoder.parts(run)
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        if self.records_frames { self.encoder.part(run, slot) } else { None }
    }

    fn encode(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<Part, ErrorMessage> {
        self.encoder.encode(run, frame, part, values)
    }

    fn encode_stored(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
        stored: &[StoredValue<'_>],
    ) -> Result<Part, ErrorMessage> {
        self.encoder.encode_stored(run, frame, part, values, stored)
    }

    fn keeps(&self, run: RunId, slot: Slot, position: FrameIndex) -> bool {
        self.encoder.keeps(run, slot, position)
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
        self.encoder.store()
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<Part>) -> Result<(), ErrorMessage> {
        if !self.records_frames {
            return Ok(());
        }
        self.append(commit, None, &parts)?;
        self.encoder.recycle(commit.run, parts);
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
                let channel = self.encoder.layout.runs[run]
                    .curve_channel(slot)
                    .ok_or_else(|| ErrorMessage::new("a learning curve of a port that is not recorded"))?;
                state.keep_curve(run, channel, &self.encoder.layout.channels[usize::from(channel) - 1].topic, curve)
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
        let name = format!("{AGGREGATE_METADATA}{}", self.encoder.layout.runs[run].aggregate_topic(slot));
        state.writer.metadata(&name, metadata).and_then(|()| state.writer.sync()).map_err(ErrorMessage::from)
    }
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
