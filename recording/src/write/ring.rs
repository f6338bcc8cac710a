//! Keeps the last seconds of a live run in memory, and writes them to a recording on request.

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use depthloom_graphs::contracts::{
    Commit, ErrorMessage, Failure, LiveCommit, NodeWarning, Sink, Slot, SlotKey, Store, StoredValue,
};
use depthloom_graphs::plan::{FrameIndex, PartId, Plan, RunId};
use depthloom_graphs::{Frame, Key, Value};
use depthloom_threads::{Caught, caught, locked, look_for_room};

use crate::error::RecordingError;
use crate::read::recording::RecordedWindow;
use crate::reuse::earlier_runs::EarlierRuns;
use crate::write::disk::Disk;
use crate::write::layout::FileLayout;
use crate::write::part::Part;
use crate::write::part_encoder::PartEncoder;
use crate::write::recorder::Recorder;

/// Where a ring writes its files, and how much it holds.
#[derive(Clone, Debug)]
pub struct RingOptions {
    /// The folder of `kept-0001.mcap` and the files after it. It is created if its parent exists.
    pub folder: PathBuf,
    /// Frames that were written longer ago leave the ring.
    pub window: Duration,
    /// The most bytes of all frames in the ring. The oldest frames leave first.
    pub max_bytes: u64,
}

impl RingOptions {
    /// The default of `max_bytes`: 512 MiB.
    pub const MAX_BYTES: u64 = 512 << 20;
}

/// What came of a trigger.
#[derive(Debug)]
pub enum RingEvent {
    /// A recording was written.
    Written(RingFile),
    /// The ring had no frame, so no file was written.
    Empty,
    /// One recording is being written and another one waits, so this trigger was ignored.
    Busy,
    /// The recording could not be written. The frames are still in the ring.
    Failed(ErrorMessage),
}

/// A recording that a ring wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RingFile {
    /// The file.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// The number of its frames.
    pub frames: u64,
    /// The time from the writing of its first frame until the trigger.
    pub duration: Duration,
    /// Whether frames of the window are missing because of [`RingOptions::max_bytes`].
    pub is_limited_by_bytes: bool,
}

/// Wraps the file that a ring opened.
type WrapRingFile = Box<dyn Fn(File) -> Arc<dyn Disk> + Send>;
type ReportEvent = Arc<dyn Fn(RingEvent) + Send + Sync>;

/// Holds the encoded frames of one stage run in memory. [`RingSink::trigger`] writes them to a recording.
///
/// Frames of other stage runs are not taken. Aggregate values are, and each file contains them. Up to three times
/// [`RingOptions::max_bytes`] are in memory while one recording is being written and another one waits.
pub struct RingSink {
    encoder: PartEncoder,
    live: RunId,
    window: Duration,
    max_bytes: u64,
    ring: Mutex<Ring>,
    report: ReportEvent,
    /// `None` once the sink is closed.
    requests: Option<SyncSender<Snapshot>>,
    writer: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Ring {
    frames: VecDeque<Arc<RingFrame>>,
    bytes: u64,
    /// How many frames of the live run were written so far.
    position: usize,
    aggregates: Vec<Arc<RingAggregate>>,
    /// When the last frame was written that left because of its bytes.
    last_lost_to_bytes: Option<Instant>,
}

/// What one trigger writes.
struct Snapshot {
    taken: Instant,
    frames: Vec<Arc<RingFrame>>,
    aggregates: Vec<Arc<RingAggregate>>,
    is_limited_by_bytes: bool,
}

struct RingFrame {
    written: Instant,
    position: FrameIndex,
    commit: OwnedCommit,
    parts: Vec<Part>,
    bytes: u64,
}

struct RingAggregate {
    run: RunId,
    slot: Slot,
    key: Key,
    value: Value,
    warnings: Vec<NodeWarning>,
}

/// A [`Commit`] that outlives its frame.
struct OwnedCommit {
    run: RunId,
    frame: Frame,
    source_key: Option<Key>,
    keys: Vec<SlotKey>,
    failures: Vec<Failure>,
    absent: Vec<Slot>,
    warnings: Vec<NodeWarning>,
    live: Option<LiveCommit>,
}

impl OwnedCommit {
    fn new(commit: &Commit<'_>) -> Self {
        Self {
            run: commit.run,
            frame: commit.frame.clone(),
            source_key: commit.source_key,
            keys: commit.keys.to_vec(),
            failures: commit.failures.to_vec(),
            absent: commit.absent.to_vec(),
            warnings: commit.warnings.to_vec(),
            live: commit.live,
        }
    }

    fn borrow(&self) -> Commit<'_> {
        Commit {
            run: self.run,
            frame: &self.frame,
            source_key: self.source_key,
            keys: &self.keys,
            failures: &self.failures,
            absent: &self.absent,
            warnings: &self.warnings,
            live: self.live,
        }
    }

    /// About the bytes that it takes in memory.
    fn bytes(&self) -> usize {
        let texts = self.failures.iter().map(|failure| failure.what.len());
        let texts = texts.chain(self.warnings.iter().map(|warning| warning.what.len()));
        size_of::<RingFrame>()
            + size_of_val(&*self.keys)
            + size_of_val(&*self.failures)
            + size_of_val(&*self.absent)
            + size_of_val(&*self.warnings)
            + texts.sum::<usize>()
    }
}

impl RingSink {
    /// A ring of the frames of the stage run `live`. `report` is called once per trigger: on the thread that writes the
    /// recordings, or by [`RingSink::trigger`] itself if nothing is written.
    ///
    /// # Errors
    /// If the plan cannot be recorded, the folder cannot be created, or the system refuses a thread.
    pub fn new(
        plan: &Plan,
        live: RunId,
        options: RingOptions,
        report: impl Fn(RingEvent) + Send + Sync + 'static,
    ) -> Result<Self, RecordingError> {
        Self::new_through(plan, live, options, report, |file| Arc::new(file))
    }

    /// As [`RingSink::new`], but tests can wrap the files to let writes fail.
    ///
    /// # Errors
    /// As [`RingSink::new`].
    pub fn new_through(
        plan: &Plan,
        live: RunId,
        options: RingOptions,
        report: impl Fn(RingEvent) + Send + Sync + 'static,
        through: impl Fn(File) -> Arc<dyn Disk> + Send + 'static,
    ) -> Result<Self, RecordingError> {
        let RingOptions { folder, window, max_bytes } = options;
        let encoder = PartEncoder::new(folder.clone(), FileLayout::new(plan)?, plan.record.every);
        let failed = |source| RecordingError::Create { path: folder.clone(), source };
        depthloom_durable::create_folder(&folder).map_err(failed)?;
        let report: ReportEvent = Arc::new(report);
        let (requests, snapshots) = sync_channel(1);
        let mut files = RingFiles { folder: folder.clone(), plan: plan.clone(), through: Box::new(through), number: 0 };
        let report_written = Arc::clone(&report);
        let write_all = move || {
            for snapshot in snapshots {
                let written = caught(|| files.write(&snapshot));
                let written = written.unwrap_or_else(|Caught(message)| {
                    Err(ErrorMessage::new(format!("the thread that writes recordings panicked {message}")))
                });
                drop(snapshot);
                report_written(written.map_or_else(RingEvent::Failed, RingEvent::Written));
            }
        };
        let thread = thread::Builder::new().name("depthloom-ring".to_owned());
        let writer = look_for_room().and_then(|()| thread.spawn(write_all)).map_err(failed)?;
        Ok(Self {
            encoder,
            live,
            window,
            max_bytes,
            ring: Mutex::default(),
            report,
            requests: Some(requests),
            writer: Some(writer),
        })
    }

    /// Reuses values of earlier runs in the stages before the live one.
    #[must_use]
    pub fn with_earlier(mut self, earlier: Arc<EarlierRuns>) -> Self {
        self.encoder.set_earlier(earlier);
        self
    }

    /// Requests a recording of the frames that are in the ring now. It only locks the ring for a short time.
    pub fn trigger(&self) {
        let Some(requests) = &self.requests else { return };
        let snapshot = self.snapshot(Instant::now());
        if snapshot.frames.is_empty() {
            (self.report)(RingEvent::Empty);
        } else if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) = requests.try_send(snapshot) {
            (self.report)(RingEvent::Busy);
        }
    }

    /// The number of frames in the ring, and the bytes that they take.
    #[must_use]
    pub fn size(&self) -> (usize, u64) {
        let ring = locked(&self.ring);
        (ring.frames.len(), ring.bytes)
    }

    /// Waits until the requested recordings are written. Dropping the sink does the same.
    pub fn close(mut self) {
        self.wait();
    }

    fn wait(&mut self) {
        drop(self.requests.take());
        if let Some(writer) = self.writer.take() {
            // It catches panics of its own work.
            let _ = writer.join();
        }
    }

    fn snapshot(&self, taken: Instant) -> Snapshot {
        let mut ring = locked(&self.ring);
        let old = ring.evict(taken, self.window, self.max_bytes);
        // In a recording, the first frame and each n-th after it have values.
        let frames = ring.frames.iter().skip_while(|frame| !self.encoder.has_values(frame.position)).cloned().collect();
        let is_in_window = |written: Instant| taken.duration_since(written) <= self.window;
        let is_limited_by_bytes = ring.last_lost_to_bytes.is_some_and(is_in_window);
        let aggregates = ring.aggregates.clone();
        drop(ring);
        drop(old);
        Snapshot { taken, frames, aggregates, is_limited_by_bytes }
    }
}

impl Drop for RingSink {
    fn drop(&mut self) {
        self.wait();
    }
}

impl Ring {
    /// Removes the frames that are too old or too many.
    fn evict(&mut self, now: Instant, window: Duration, max_bytes: u64) -> Vec<Arc<RingFrame>> {
        let mut evicted = Vec::new();
        while let Some(oldest) = self.frames.front() {
            let is_old = now.duration_since(oldest.written) > window;
            if !is_old && self.bytes <= max_bytes {
                break;
            }
            if !is_old {
                self.last_lost_to_bytes = Some(oldest.written);
            }
            self.bytes -= oldest.bytes;
            evicted.extend(self.frames.pop_front());
        }
        evicted
    }
}

impl Sink for RingSink {
    type Part = Part;

    fn parts(&self, run: RunId) -> usize {
        if run == self.live { self.encoder.parts(run) } else { 0 }
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        if run == self.live { self.encoder.part(run, slot) } else { None }
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
        run == self.live && self.encoder.keeps(run, slot, position)
    }

    fn store(&self) -> Option<&dyn Store> {
        self.encoder.store()
    }

    fn write(&self, commit: &Commit<'_>, mut parts: Vec<Part>) -> Result<(), ErrorMessage> {
        if commit.run != self.live {
            return Ok(());
        }
        // Exact copies: the buffers of the parts have room for larger ones.
        let exact: Vec<Part> = parts.iter_mut().map(Part::take_exact).collect();
        self.encoder.recycle(commit.run, parts);
        let commit = OwnedCommit::new(commit);
        let bytes = (commit.bytes() + exact.iter().map(Part::memory).sum::<usize>()) as u64;
        let written = Instant::now();
        let mut ring = locked(&self.ring);
        let position = FrameIndex(ring.position);
        ring.frames.push_back(Arc::new(RingFrame { written, position, commit, parts: exact, bytes }));
        ring.position += 1;
        ring.bytes += bytes;
        let old = ring.evict(written, self.window, self.max_bytes);
        drop(ring);
        drop(old);
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
        let aggregate = RingAggregate { run, slot, key: *key, value: value.clone(), warnings: warnings.to_vec() };
        let mut ring = locked(&self.ring);
        ring.aggregates.retain(|other| (other.run, other.slot) != (run, slot));
        ring.aggregates.push(Arc::new(aggregate));
        Ok(())
    }
}

/// The recordings of a ring.
struct RingFiles {
    folder: PathBuf,
    plan: Plan,
    through: WrapRingFile,
    /// The number of the last file.
    number: u32,
}

impl RingFiles {
    fn write(&mut self, snapshot: &Snapshot) -> Result<RingFile, ErrorMessage> {
        let (path, partial, file) = self.reserve()?;
        let written = self.fill(&partial, file, snapshot).and_then(|bytes| {
            let failed = |source| RecordingError::Create { path: path.clone(), source };
            depthloom_durable::rename(&partial, &path).map_err(failed)?;
            Ok(bytes)
        });
        let bytes = written.inspect_err(|_| {
            // The first error is reported. A file that stays takes space and nothing else.
            let _ = fs::remove_file(&partial);
            self.number -= 1;
        })?;
        let first = snapshot.frames.first().map_or(snapshot.taken, |frame| frame.written);
        Ok(RingFile {
            path,
            bytes,
            frames: snapshot.frames.len() as u64,
            duration: snapshot.taken.duration_since(first),
            is_limited_by_bytes: snapshot.is_limited_by_bytes,
        })
    }

    /// The next free name, and its empty file under the name that it has until it is complete.
    ///
    /// The temporary file reserves the number: another process that writes to the folder takes the next one.
    fn reserve(&mut self) -> Result<(PathBuf, PathBuf, File), RecordingError> {
        loop {
            self.number += 1;
            let path = self.folder.join(format!("kept-{:04}.mcap", self.number));
            let partial = depthloom_durable::partial_name(&path);
            match depthloom_durable::create_new(&partial) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(source) => {
                    self.number -= 1;
                    return Err(RecordingError::Create { path: partial, source });
                }
                Ok(_) if path.symlink_metadata().is_ok() => {
                    let _ = fs::remove_file(&partial);
                }
                Ok(file) => return Ok((path, partial, file)),
            }
        }
    }

    fn fill(&self, path: &Path, file: File, snapshot: &Snapshot) -> Result<u64, ErrorMessage> {
        let recorder = Recorder::create_in(path, (self.through)(file), &self.plan)?;
        let first = snapshot.frames.first();
        let window = first.map(|frame| RecordedWindow { run: frame.commit.run, first: frame.position });
        window.map_or(Ok(()), |window| recorder.record_window(window))?;
        let (after, before): (Vec<_>, Vec<_>) =
            snapshot.aggregates.iter().partition(|aggregate| Some(aggregate.run) == window.map(|window| window.run));
        let record = |aggregate: &Arc<RingAggregate>| {
            let RingAggregate { run, slot, key, value, warnings } = &**aggregate;
            recorder.once(*run, *slot, key, value, warnings)
        };
        before.into_iter().try_for_each(record)?;
        for frame in &snapshot.frames {
            recorder.append(&frame.commit.borrow(), Some(frame.position), &frame.parts)?;
        }
        after.into_iter().try_for_each(record)?;
        Ok(recorder.finish(&[])?.bytes)
    }
}
