//! Recordings of earlier runs as one store: what a run need not make again.

use std::collections::HashSet;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock};

use depthloom_graphs::contracts::{Fault, Store, StoredPort, StoredState};
use depthloom_graphs::plan::{FrameIndex, Plan, RunId};
use depthloom_graphs::{Key, Value};
use depthloom_mcap::{FileError, MAGIC_LENGTH, PositionedFile, RecordPlace, Window, op};
use depthloom_threads::locked;

use crate::FORMAT;
use crate::checksum::CrcBefore;
use crate::error::RecordingError;
use crate::plan::RecordedPlan;
use crate::read::index::{ChunkEntry, metadata_entry};
use crate::read::recording::{RecordedFrame, Recording, StoredValues};
use crate::reuse::stored_values::{KeyedPlace, fault, unknown};

/// Recordings of earlier runs as one store: what they made and a run needs need not be made again.
///
/// What a key names is taken from the first recording that has it sound: every byte of a frame is checked before
/// anything of it is taken, and a frame that is not what was written is left to the next recording, or to be made
/// afresh.
pub struct EarlierRuns {
    runs: Vec<EarlierRun>,
    unreadable: Vec<(PathBuf, RecordingError)>,
    damage: Mutex<Vec<(PathBuf, String)>>,
}

pub(crate) struct EarlierRun {
    pub(crate) recording: Recording,
    /// By commit, the CRC-32 of each of the frame's chunks as it is stored; `None` if the frame's bytes are not what
    /// was written. A frame is checked on first use.
    checked: Vec<OnceLock<Option<Box<[u32]>>>>,
    taken: AtomicBool,
}

impl EarlierRuns {
    /// A store of recordings, the one to be asked first in front. Of those that cannot be read, or have nothing of a
    /// plan's nodes, no more than the plan is read.
    pub fn new(recordings: impl IntoIterator<Item = impl AsRef<Path>>, plan: &Plan) -> Self {
        let wanted: HashSet<Key> = plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.recipe).collect();
        let is_of_use = |recorded: &RecordedPlan| {
            let mut nodes = recorded.runs.iter().flat_map(|run| &run.nodes);
            nodes.any(|node| wanted.contains(&node.recipe))
        };
        let (mut runs, mut unreadable) = (Vec::new(), Vec::new());
        for path in recordings {
            let path = path.as_ref();
            if recorded_plan(path).is_some_and(|(format, plan)| format != FORMAT || !is_of_use(&plan)) {
                continue;
            }
            match Recording::open(path) {
                Ok(recording) if recording.is_of_this_format() && is_of_use(recording.plan()) => {
                    let checked = std::iter::repeat_with(OnceLock::new).take(recording.sealed.len()).collect();
                    runs.push(EarlierRun { recording, checked, taken: AtomicBool::new(false) });
                }
                Ok(_) => {}
                Err(error) if is_only_begun(path, &error) => {}
                Err(error) => unreadable.push((path.to_owned(), error)),
            }
        }
        Self { runs, unreadable, damage: Mutex::default() }
    }

    /// The recordings that cannot be read, and why. One whose run has only begun, or that is gone, is none of them.
    #[must_use]
    pub fn unreadable(&self) -> &[(PathBuf, RecordingError)] {
        &self.unreadable
    }

    /// Whether there is nothing to take.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// The recording that was made by most of a plan's nodes, and its plan.
    #[must_use]
    pub fn nearest(&self, plan: &Plan) -> Option<(&Path, &RecordedPlan)> {
        let wanted: HashSet<Key> = plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.recipe).collect();
        let shared = |run: &&EarlierRun| {
            let nodes = run.recording.plan().runs.iter().flat_map(|run| &run.nodes);
            nodes.filter(|node| wanted.contains(&node.recipe)).count()
        };
        // Of equals the first: the last maximum of the reversed.
        let nearest = self.runs.iter().rev().max_by_key(shared)?;
        Some((nearest.recording.path(), nearest.recording.plan()))
    }

    /// The recordings that something was taken of.
    pub fn taken(&self) -> impl Iterator<Item = &Path> {
        self.runs.iter().filter(|run| run.taken.load(Ordering::Relaxed)).map(|run| run.recording.path())
    }

    /// What was found damaged and was not taken: the recording, and what is wrong.
    #[must_use]
    pub fn damage(&self) -> Vec<(PathBuf, String)> {
        let mut damage = locked(&self.damage).clone();
        damage.sort();
        damage
    }

    /// The recordings that know a key, sound, and where in them, in order.
    fn located(&self, key: &Key) -> impl Iterator<Item = (&EarlierRun, KeyedPlace)> {
        self.runs.iter().filter_map(|run| {
            let place = run.recording.place_of(key)?;
            let is_sound = match place.values() {
                StoredValues::Frame { run: stage, position, .. } => self.checksums(run, stage, position).is_some(),
                // An attachment has a checksum of its own, and is checked against the hash in its name.
                StoredValues::Once { .. } => true,
            };
            is_sound.then_some((run, place))
        })
    }

    /// The first recording that has the value of a port under a key, and where in it: the newest may have kept less
    /// than one before.
    pub(crate) fn locate(&self, key: &Key, port: &str) -> Option<(&EarlierRun, KeyedPlace)> {
        let has = |(run, place): &(&EarlierRun, KeyedPlace)| {
            let held = run.recording.held_at(*place);
            held.iter().any(|held| held.port == port && held.state == StoredState::Stored)
        };
        self.located(key).find(has)
    }

    /// The CRC-32 of each chunk of a frame as it is stored; `None` if the frame's bytes are not what was written.
    pub(crate) fn checksums<'a>(&self, run: &'a EarlierRun, stage: RunId, position: FrameIndex) -> Option<&'a [u32]> {
        let frame = &run.recording.frames(stage)[position];
        let checked = run.checked[frame.commit].get_or_init(|| match run.recording.check_frame(frame) {
            Ok(checksums) => Some(checksums),
            Err(error) => {
                let what = format!("frame `{}`: {error}", frame.id);
                let mut damage = locked(&self.damage);
                damage.push((run.recording.path().to_owned(), what));
                None
            }
        });
        checked.as_deref()
    }
}

/// Whether a recording cannot be read because nothing has been written of it yet, or it was removed in the meantime.
///
/// A run that is finished has a whole recording: one that holds nothing there is damaged.
fn is_only_begun(path: &Path, error: &RecordingError) -> bool {
    let is_finished =
        path.parent().is_some_and(|run| run.extension().is_none_or(|ending| ending != depthloom_durable::PARTIAL));
    match error {
        RecordingError::NotARecording { .. } | RecordingError::NotMcap { .. } if is_finished => false,
        RecordingError::NotARecording { .. } => true,
        RecordingError::NotMcap { path } => std::fs::metadata(path).is_ok_and(|file| file.len() < MAGIC_LENGTH),
        RecordingError::File(FileError::Open { source, .. }) => source.kind() == ErrorKind::NotFound,
        _ => false,
    }
}

/// Format and plan of a recording, read from its head alone: of a file without an end all of it would have to be read.
fn recorded_plan(path: &Path) -> Option<(String, RecordedPlan)> {
    let file = PositionedFile::open(path).ok()?;
    let (mut window, mut at) = (Window::new(&file), MAGIC_LENGTH);
    for _ in 0..2 {
        let RecordPlace { opcode, body, length } = window.record(at).ok()??;
        if opcode == op::METADATA {
            let metadata = metadata_entry(&file, at, window.at(body, length).ok()??).ok()?;
            let plan = RecordedPlan::from_json(metadata.values.get("plan")?).ok()?;
            return Some((metadata.values.get("format")?.clone(), plan));
        }
        at = body.checked_add(length)?;
    }
    None
}

impl EarlierRun {
    pub(crate) fn take(&self) {
        self.taken.store(true, Ordering::Relaxed);
    }
}

impl Recording {
    /// Checks that the bytes from one commit to the next are what was written: those of a frame, compressed as they are
    /// stored. The CRC-32 of each of its chunks.
    fn check_frame(&self, frame: &RecordedFrame) -> Result<Box<[u32]>, RecordingError> {
        let mut crc = CrcBefore::new(&self.file);
        if let Some((start, before)) = frame.commit.checked_sub(1).map(|earlier| self.sealed[earlier]) {
            crc.take_as_known(start, before);
        }
        let checksum = |chunk: &ChunkEntry| {
            crc.place(chunk.start)?;
            crc.stretch(chunk.end)
        };
        let checksums = frame.chunks(&self.index).iter().map(checksum).collect::<Result<_, _>>()?;
        let (start, told) = self.sealed[frame.commit];
        if crc.place(start)? == told {
            return Ok(checksums);
        }
        Err(self.file.damaged(start, "the bytes before are not what was written").into())
    }
}

impl Store for EarlierRuns {
    fn find(&self, key: &Key) -> Option<Vec<StoredPort>> {
        let mut located = self.located(key);
        let (run, place) = located.next()?;
        let mut held = run.recording.held_at(place);
        let is_whole = |held: &[StoredPort]| held.iter().all(|held| held.state != StoredState::NotKept);
        // What one did not keep another may have.
        for (run, place) in located {
            if is_whole(&held) {
                break;
            }
            for other in run.recording.held_at(place) {
                match held.iter_mut().find(|held| held.port == other.port) {
                    Some(held) => held.state = held.state.max(other.state),
                    None => held.push(other),
                }
            }
        }
        Some(held)
    }

    fn origin(&self, key: &Key, port: &str) -> Option<String> {
        let (run, _) = self.locate(key, port)?;
        Some(run.recording.path().display().to_string())
    }

    fn warnings(&self, key: &Key) -> Vec<(String, u64)> {
        self.located(key).next().map(|(run, place)| run.recording.warnings_at(place)).unwrap_or_default()
    }

    fn value(&self, key: &Key, port: &str) -> Result<Option<Value>, Fault> {
        let Some((run, place)) = self.locate(key, port) else {
            // It is known to be nothing, or not known.
            let held = self.find(key).and_then(|held| held.into_iter().find(|held| held.port == port));
            return match held {
                Some(StoredPort { state: StoredState::Absent, .. }) => Ok(None),
                _ => Err(unknown(key)),
            };
        };
        run.take();
        run.recording.value_at(place, port).map_err(|error| {
            if matches!(place.values(), StoredValues::Once { .. }) {
                let mut damage = locked(&self.damage);
                damage.push((run.recording.path().to_owned(), error.to_string()));
            }
            fault(error)
        })
    }

    fn values(&self, wanted: &[(Key, &str)]) -> Result<Vec<Option<Value>>, Fault> {
        let mut values = vec![None; wanted.len()];
        // By recording and frame, which values are read there.
        let mut frames: Vec<(&EarlierRun, (RunId, FrameIndex), Vec<usize>)> = Vec::new();
        let mut topics = vec![""; wanted.len()];
        for (index, (key, port)) in wanted.iter().enumerate() {
            match self.locate(key, port).map(|(run, place)| (run, place.values())) {
                Some((run, StoredValues::Frame { run: stage, position, node })) => {
                    topics[index] = run.recording.topic_of(stage, node, port).ok_or_else(|| unknown(key))?;
                    let at = (stage, position);
                    match frames.iter_mut().find(|(of, place, _)| std::ptr::eq(*of, run) && *place == at) {
                        Some((.., indexes)) => indexes.push(index),
                        None => frames.push((run, at, vec![index])),
                    }
                }
                _ => values[index] = self.value(key, port)?,
            }
        }
        for (run, (stage, position), indexes) in frames {
            run.take();
            let of: Vec<&str> = indexes.iter().map(|index| topics[*index]).collect();
            let read = run.recording.reader(stage, &of).and_then(|mut reader| reader.read(position)).map_err(fault)?;
            indexes.into_iter().zip(read).for_each(|(index, value)| values[index] = value);
        }
        Ok(values)
    }
}
