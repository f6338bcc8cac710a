//! Recordings of earlier runs as one store of values that a run can reuse.

use std::collections::{BTreeMap, HashSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use depthloom_graphs::contracts::{Fault, Store, StoredPort, StoredState};
use depthloom_graphs::plan::{FrameIndex, NodeRef, Plan, RunId};
use depthloom_graphs::{Key, Value};
use depthloom_mcap::{FileError, MAGIC_LENGTH, OpenFiles, PositionedFile, RecordPlace, Window, op};
use depthloom_threads::{Budget, Tiles as _, core_count, into_unlocked, locked};

use crate::FORMAT;
use crate::checksum::CrcBefore;
use crate::error::RecordingError;
use crate::plan::RecordedPlan;
use crate::read::index::{ChunkEntry, metadata_entry};
use crate::read::recording::{RecordedFrame, Recording, StoredValues};
use crate::reuse::key_index::{KeyIndex, KeyedPlace};
use crate::reuse::stored_values::{fault, unknown};

/// Recordings of earlier runs as one store: a run reuses their values instead of computing them.
///
/// A value is reused from the first recording that has it undamaged. All bytes of a frame are checked before any of its
/// values are reused. A damaged frame is looked up in the next recording, or recomputed.
pub struct EarlierRuns {
    runs: Vec<EarlierRun>,
    by_key: OnceLock<KeyIndex>,
    unreadable: Vec<(PathBuf, RecordingError)>,
    damage: Mutex<Vec<(PathBuf, String)>>,
}

pub(crate) struct EarlierRun {
    pub(crate) recording: Recording,
    /// By commit, the CRC-32 of each of the frame's chunks as stored; `None` if the frame is damaged. A frame is
    /// checked when it is first used.
    checked: Vec<OnceLock<Option<Box<[u32]>>>>,
    is_reused: AtomicBool,
}

impl EarlierRuns {
    /// A store of recordings; the first one is searched first. Of recordings that cannot be read, or have no values of
    /// the plan's nodes, only the plan is read.
    ///
    /// There may be thousands of them: few files are open at once, and a key is looked up in one table for all.
    pub fn new(recordings: impl IntoIterator<Item = impl AsRef<Path>>, plan: &Plan) -> Self {
        let wanted: HashSet<Key> = plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.node_hash).collect();
        let is_of_use = |recorded: &RecordedPlan| {
            let mut nodes = recorded.runs.iter().flat_map(|run| &run.nodes);
            nodes.any(|node| wanted.contains(&node.node_hash))
        };
        let paths: Vec<PathBuf> = recordings.into_iter().map(|path| path.as_ref().to_owned()).collect();
        let files = Arc::new(OpenFiles::new(most_open_files()));
        let opened: Vec<Mutex<Option<_>>> = paths.iter().map(|_| Mutex::default()).collect();
        let budget = Budget::new(core_count());
        let _own = budget.permit();
        budget.run(paths.len(), &|number| {
            *locked(&opened[number]) = Some(open_if_of_use(&paths[number], &files, &is_of_use));
        });
        let (mut runs, mut unreadable) = (Vec::new(), Vec::new());
        for (path, opened) in paths.into_iter().zip(opened) {
            match into_unlocked(opened) {
                Some(Ok(Some(recording))) => {
                    let checked = std::iter::repeat_with(OnceLock::new).take(recording.sealed.len()).collect();
                    runs.push(EarlierRun { recording, checked, is_reused: AtomicBool::new(false) });
                }
                Some(Ok(None)) | None => {}
                Some(Err(error)) => unreadable.push((path, error)),
            }
        }
        Self { runs, by_key: OnceLock::new(), unreadable, damage: Mutex::default() }
    }

    /// The recordings that cannot be read, and why; except those whose run has just begun, and removed ones.
    #[must_use]
    pub fn unreadable(&self) -> &[(PathBuf, RecordingError)] {
        &self.unreadable
    }

    /// Whether there is nothing to reuse.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// The recording that shares the most nodes with a plan, and its plan.
    #[must_use]
    pub fn nearest(&self, plan: &Plan) -> Option<(&Path, &RecordedPlan)> {
        let wanted: HashSet<Key> = plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.node_hash).collect();
        let shared = |run: &&EarlierRun| {
            let nodes = run.recording.plan().runs.iter().flat_map(|run| &run.nodes);
            nodes.filter(|node| wanted.contains(&node.node_hash)).count()
        };
        // Of equal counts the first: the last maximum in reverse order.
        let nearest = self.runs.iter().rev().max_by_key(shared)?;
        Some((nearest.recording.path(), nearest.recording.plan()))
    }

    /// The keys of the aggregate values in the recordings in a folder, by stage run and node. The recordings must be of
    /// one plan.
    #[must_use]
    pub fn aggregates_in(&self, folder: &Path) -> BTreeMap<NodeRef, Key> {
        let Ok(folder) = folder.canonicalize() else { return BTreeMap::new() };
        let is_inside = |path: &Path| path.canonicalize().is_ok_and(|path| path.starts_with(&folder));
        let inside = self.runs.iter().map(|run| &run.recording).filter(|recording| is_inside(recording.path()));
        let mut keys = BTreeMap::new();
        for value in inside.flat_map(Recording::aggregate_values) {
            keys.entry(NodeRef { run: value.run, node: value.node }).or_insert(value.key);
        }
        keys
    }

    /// The recordings whose values were reused.
    pub fn reused(&self) -> impl Iterator<Item = &Path> {
        self.runs.iter().filter(|run| run.is_reused.load(Ordering::Relaxed)).map(|run| run.recording.path())
    }

    /// The damage that was found, whose values were not reused: the recording, and what is wrong.
    #[must_use]
    pub fn damage(&self) -> Vec<(PathBuf, String)> {
        let mut damage = locked(&self.damage).clone();
        damage.sort();
        damage
    }

    /// The recordings with undamaged values of a key, in order, and where they are.
    fn located(&self, key: &Key) -> impl Iterator<Item = (&EarlierRun, KeyedPlace)> {
        let index = self.by_key.get_or_init(|| KeyIndex::new(self.runs.iter().map(|run| &run.recording)));
        index.places(key).filter_map(|(number, place)| {
            let run = &self.runs[number];
            let is_sound = match place.values() {
                StoredValues::Frame { run: stage, position, .. } => self.checksums(run, stage, position).is_some(),
                // An attachment has its own checksum, and is checked against the hash in its name.
                StoredValues::Once { .. } => true,
            };
            is_sound.then_some((run, place))
        })
    }

    /// The first recording that has the value of a port under a key, and where it is. The newest recording may contain
    /// fewer values than an older one.
    pub(crate) fn locate(&self, key: &Key, port: &str) -> Option<(&EarlierRun, KeyedPlace)> {
        let has_value = |(run, place): &(&EarlierRun, KeyedPlace)| {
            let ports = run.recording.stored_at(*place);
            ports.iter().any(|stored| stored.port == port && stored.state == StoredState::Stored)
        };
        self.located(key).find(has_value)
    }

    /// The CRC-32 of each chunk of a frame as stored; `None` if the frame is damaged.
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

/// Opens a recording; `None` if it has no values of the plan's nodes, or nothing yet.
fn open_if_of_use(
    path: &Path,
    files: &Arc<OpenFiles>,
    is_of_use: &impl Fn(&RecordedPlan) -> bool,
) -> Result<Option<Recording>, RecordingError> {
    if recorded_plan(path).is_some_and(|(format, plan)| format != FORMAT || !is_of_use(&plan)) {
        return Ok(None);
    }
    match Recording::open_on_demand(path, files) {
        Ok(recording) => Ok(Some(recording).filter(|recording| is_of_use(recording.plan()))),
        Err(RecordingError::Format { .. }) => Ok(None),
        Err(error) if is_only_begun(path, &error) => Ok(None),
        Err(error) => Err(error),
    }
}

/// How many recordings stay open: a quarter of the files that this process may have open, and at most 256.
fn most_open_files() -> usize {
    const MOST: usize = 256;
    #[cfg(unix)]
    let limit = rustix::process::getrlimit(rustix::process::Resource::Nofile).current;
    #[cfg(not(unix))]
    let limit: Option<u64> = None;
    let quarter = limit.and_then(|limit| usize::try_from(limit / 4).ok()).unwrap_or(MOST);
    quarter.clamp(1, MOST)
}

/// Whether a recording cannot be read because nothing has been written yet, or because it was removed in the meantime.
///
/// The recording of a finished run is complete: if it has no content, it is damaged.
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

/// Format and plan of a recording, read from its first records: otherwise an unfinished file would be read completely.
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
    pub(crate) fn mark_reused(&self) {
        self.is_reused.store(true, Ordering::Relaxed);
    }
}

impl Recording {
    /// Checks the bytes from one commit to the next: those of a frame, as stored. Returns the CRC-32 of each of its
    /// chunks.
    fn check_frame(&self, frame: &RecordedFrame) -> Result<Box<[u32]>, RecordingError> {
        let mut crc = CrcBefore::new(&self.file);
        if let Some((start, before)) = frame.commit.checked_sub(1).map(|earlier| self.sealed[earlier]) {
            crc.set_known(start, before);
        }
        let checksum = |chunk: &ChunkEntry| {
            crc.up_to(chunk.start)?;
            crc.section(chunk.end)
        };
        let checksums = frame.chunks(&self.index).iter().map(checksum).collect::<Result<_, _>>()?;
        let (start, stated) = self.sealed[frame.commit];
        if crc.up_to(start)? == stated {
            return Ok(checksums);
        }
        Err(self.file.damaged(start, "the bytes of the frame before are damaged").into())
    }
}

impl Store for EarlierRuns {
    fn find(&self, key: &Key) -> Option<Vec<StoredPort>> {
        let mut located = self.located(key);
        let (run, place) = located.next()?;
        let mut ports = run.recording.stored_at(place);
        let is_complete = |ports: &[StoredPort]| ports.iter().all(|port| port.state != StoredState::NotKept);
        // Another recording may have values that this one does not have.
        for (run, place) in located {
            if is_complete(&ports) {
                break;
            }
            for other in run.recording.stored_at(place) {
                match ports.iter_mut().find(|port| port.port == other.port) {
                    Some(port) => port.state = port.state.max(other.state),
                    None => ports.push(other),
                }
            }
        }
        Some(ports)
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
            // The value is known to be absent, or is unknown.
            let stored = self.find(key).and_then(|ports| ports.into_iter().find(|stored| stored.port == port));
            return match stored {
                Some(StoredPort { state: StoredState::Absent, .. }) => Ok(None),
                _ => Err(unknown(key)),
            };
        };
        run.mark_reused();
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
        // By recording and frame, the values to read.
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
            run.mark_reused();
            let frame_topics: Vec<&str> = indexes.iter().map(|index| topics[*index]).collect();
            let read = run
                .recording
                .reader(stage, &frame_topics)
                .and_then(|mut reader| reader.read(position))
                .map_err(fault)?;
            indexes.into_iter().zip(read).for_each(|(index, value)| values[index] = value);
        }
        Ok(values)
    }
}
