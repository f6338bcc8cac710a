//! A ring of the last seconds of a live run, and the recordings that it writes.
#![expect(clippy::unwrap_used, reason = "helpers fail as tests do")]

use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use depthloom_graphs::plan::{FrameIndex, Plan, RunId};
use depthloom_recording::{
    Condition, Disk, RecordedWindow, Recorder, Recording, RingEvent, RingFile, RingOptions, RingSink,
};

use crate::fixture::{curve, frame, plan_of, record_aggregate_values, record_live_frame, values};
use crate::live::live;

const TRAIN: RunId = RunId(0);
const LIVE: RunId = RunId(1);
const PATIENCE: Duration = Duration::from_secs(30);

fn plan() -> Plan {
    plan_of(&["train", "compare"])
}

fn options(folder: &Path) -> RingOptions {
    RingOptions { folder: folder.to_owned(), window: PATIENCE, max_bytes: RingOptions::MAX_BYTES }
}

fn ring(plan: &Plan, options: RingOptions) -> (RingSink, Receiver<RingEvent>) {
    ring_through(plan, options, |file| Arc::new(file))
}

fn ring_through(
    plan: &Plan,
    options: RingOptions,
    through: impl Fn(File) -> Arc<dyn Disk> + Send + 'static,
) -> (RingSink, Receiver<RingEvent>) {
    let (sender, events) = channel();
    let report = move |event| sender.send(event).unwrap_or_default();
    (RingSink::new_through(plan, LIVE, options, report, through).unwrap(), events)
}

fn write(ring: &RingSink, index: u64) {
    let frame = frame(index);
    record_live_frame(ring, LIVE, (index as usize, &frame), &values(&frame, 20, 12), false, Some(live(index)));
}

fn file(events: &Receiver<RingEvent>) -> RingFile {
    match events.recv_timeout(PATIENCE).expect("an event") {
        RingEvent::Written(file) => file,
        other => panic!("{other:?}"),
    }
}

/// The frames and all their values, as text that shows every bit.
fn content(path: &Path, run: RunId) -> Vec<String> {
    let recording = Recording::open(path).unwrap();
    assert_eq!(recording.condition(), &Condition::Complete);
    assert_eq!(recording.damage(&|| false), []);
    let topics = recording.plan().outputs(run).filter(|(_, output)| output.recorded && !output.once);
    let topics: Vec<&str> = topics.map(|(_, output)| output.topic.as_str()).collect();
    let mut reader = recording.reader(run, &topics).unwrap();
    let frames = FrameIndex::enumerate(recording.frames(run));
    frames
        .map(|(position, frame)| {
            let commit = (&frame.id, frame.index, frame.time_ns, frame.source_key, &frame.keys);
            let commit = (commit, &frame.failures, &frame.warnings, &frame.absent, frame.live);
            format!("{commit:?} {:?}", reader.read(position).unwrap())
        })
        .collect()
}

/// A recording of all frames by a [`Recorder`].
fn recorded(folder: &Path, plan: &Plan, frames: u64) -> Vec<String> {
    let path = folder.join("all.mcap");
    let recorder = Recorder::create(&path, plan).unwrap();
    for index in 0..frames {
        let frame = frame(index);
        record_live_frame(&recorder, LIVE, (index as usize, &frame), &values(&frame, 20, 12), false, Some(live(index)));
    }
    recorder.finish(&[]).unwrap();
    content(&path, LIVE)
}

#[test]
fn a_ring_writes_the_frames_of_its_window_with_equal_values() {
    let folder = tempfile::tempdir().unwrap();
    let plan = plan();
    let frame_bytes = {
        let (ring, _events) = ring(&plan, options(&folder.path().join("one")));
        write(&ring, 5);
        ring.size().1
    };
    let target = folder.path().join("kept");
    // Space for a few frames.
    let (ring, events) = ring(&plan, RingOptions { max_bytes: 5 * frame_bytes, ..options(&target) });
    // A batch stage before it: only its aggregate values.
    record_live_frame(&ring, TRAIN, (0, &frame(0)), &[], false, None);
    record_aggregate_values(&ring, TRAIN);
    assert_eq!(ring.size(), (0, 0));
    for index in 0..12 {
        write(&ring, index);
        assert!(ring.size().1 <= 5 * frame_bytes, "{:?}", ring.size());
    }
    let frames = ring.size().0 as u64;
    assert!((3..=6).contains(&frames), "{frames}");
    ring.trigger();
    let written = file(&events);
    assert_eq!(written.path, target.join("kept-0001.mcap"));
    assert_eq!((written.frames, written.is_limited_by_bytes), (frames, true));
    assert_eq!(written.bytes, std::fs::metadata(&written.path).unwrap().len());
    assert_eq!(std::fs::read_dir(&target).unwrap().count(), 1, "no temporary file is left");

    let all = recorded(folder.path(), &plan, 12);
    assert!(content(&written.path, LIVE) == all[12 - frames as usize..]);
    let recording = Recording::open(&written.path).unwrap();
    assert!(recording.frames(TRAIN).is_empty());
    let window = RecordedWindow { run: LIVE, first: FrameIndex(12 - frames as usize) };
    assert_eq!(recording.windows(), [window]);
    assert_eq!(recording.frames(LIVE)[0].index, 12 - frames, "frames keep their numbers");
    let [model, learning_curve] = recording.aggregate_values() else { panic!("two aggregate values are expected") };
    assert_eq!((model.run, learning_curve.run), (TRAIN, TRAIN));
    let expected = format!("{:?}", depthloom_graphs::Value::from(curve()));
    assert_eq!(format!("{:?}", recording.aggregate_value(learning_curve).unwrap()), expected);

    // The ring keeps its frames: a second file has the new ones and those before.
    write(&ring, 12);
    ring.trigger();
    let second = file(&events);
    assert_eq!(second.path, target.join("kept-0002.mcap"));
    let all = recorded(folder.path(), &plan, 13);
    assert!(content(&second.path, LIVE) == all[13 - second.frames as usize..]);
    assert!(second.frames > 1);
    ring.close();
    assert!(events.recv_timeout(PATIENCE).is_err(), "no other event");
}

#[test]
fn a_ring_forgets_frames_that_are_too_old() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("kept");
    let window = Duration::from_millis(400);
    let (ring, events) = ring(&plan(), RingOptions { window, ..options(&target) });
    write(&ring, 0);
    std::thread::sleep(2 * window);
    write(&ring, 1);
    assert_eq!(ring.size().0, 1);
    ring.trigger();
    let written = file(&events);
    assert_eq!((written.frames, written.is_limited_by_bytes), (1, false));
    assert!(written.duration <= window);
    assert_eq!(Recording::open(&written.path).unwrap().frames(LIVE)[0].index, 1);
    // Also without later frames.
    std::thread::sleep(2 * window);
    ring.trigger();
    assert!(matches!(events.recv_timeout(PATIENCE), Ok(RingEvent::Empty)));
    assert_eq!(ring.size(), (0, 0));
    assert_eq!(std::fs::read_dir(&target).unwrap().count(), 1);
}

#[test]
fn a_file_starts_with_a_frame_that_has_values() {
    let folder = tempfile::tempdir().unwrap();
    let mut plan = plan();
    plan.record.every = 3;
    let frames = |ring: &RingSink| (0..8).for_each(|index| write(ring, index));
    let all = {
        let (ring, _events) = ring(&plan, options(&folder.path().join("all")));
        frames(&ring);
        ring.size().1
    };
    // The first frame does not fit.
    let (ring, events) = ring(&plan, RingOptions { max_bytes: all - 1, ..options(&folder.path().join("kept")) });
    frames(&ring);
    assert_eq!(ring.size().0, 7);
    ring.trigger();
    let written = file(&events);
    assert_eq!(written.frames, 5);
    let expected = recorded(folder.path(), &plan, 8);
    assert!(content(&written.path, LIVE) == expected[3..]);
}

#[test]
fn no_file_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["kept-0001.mcap", "kept-0002.mcap.partial"];
    names.iter().for_each(|name| std::fs::write(folder.path().join(name), b"years").unwrap());
    let (ring, events) = ring(&plan(), options(folder.path()));
    write(&ring, 0);
    ring.trigger();
    assert_eq!(file(&events).path, folder.path().join("kept-0003.mcap"));
    for name in names {
        assert_eq!(std::fs::read(folder.path().join(name)).unwrap(), b"years");
    }
}

/// A disk that waits before each write until the gate is open, and refuses writes while it is full.
struct Gated {
    file: File,
    gate: Arc<Gate>,
}

#[derive(Default)]
struct Gate {
    /// Whether a write waits, and whether the gate is open.
    state: Mutex<(bool, bool)>,
    changed: Condvar,
    is_full: AtomicBool,
}

impl Gate {
    fn set(&self, change: impl FnOnce(&mut (bool, bool))) {
        change(&mut self.state.lock().unwrap());
        self.changed.notify_all();
    }

    fn wait_until(&self, is_done: impl Fn(&(bool, bool)) -> bool) {
        let state = self.state.lock().unwrap();
        let (_state, timeout) = self.changed.wait_timeout_while(state, PATIENCE, |state| !is_done(state)).unwrap();
        assert!(!timeout.timed_out());
    }
}

impl Disk for Gated {
    fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        self.gate.set(|(waits, _)| *waits = true);
        self.gate.wait_until(|(_, is_open)| *is_open);
        // The disk becomes full within the file.
        if self.gate.is_full.load(Ordering::SeqCst) && self.file.metadata()?.len() > 8000 {
            return Err(ErrorKind::StorageFull.into());
        }
        Disk::write(&self.file, bytes)
    }

    fn sync_data(&self) -> io::Result<()> {
        Disk::sync_data(&self.file)
    }

    fn sync_all(&self) -> io::Result<()> {
        Disk::sync_all(&self.file)
    }
}

fn gated_ring(folder: &Path) -> (RingSink, Receiver<RingEvent>, Arc<Gate>) {
    let gate = Arc::<Gate>::default();
    let of_files = Arc::clone(&gate);
    let through = move |file| Arc::new(Gated { file, gate: Arc::clone(&of_files) }) as Arc<dyn Disk>;
    let (ring, events) = ring_through(&plan(), options(folder), through);
    (ring, events, gate)
}

#[test]
fn a_trigger_during_a_write_waits_and_a_third_one_is_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let (ring, events, gate) = gated_ring(folder.path());
    write(&ring, 0);
    ring.trigger();
    gate.wait_until(|(waits, _)| *waits);
    // The run goes on while the disk waits.
    write(&ring, 1);
    ring.trigger();
    write(&ring, 2);
    ring.trigger();
    assert!(matches!(events.recv_timeout(PATIENCE), Ok(RingEvent::Busy)));
    gate.set(|(_, is_open)| *is_open = true);
    // Frames are in both files, each as of its trigger.
    let frames = [1, 2].map(|frames| {
        let written = file(&events);
        assert_eq!(written.frames, frames);
        content(&written.path, LIVE)
    });
    assert_eq!(frames[0][..], frames[1][..1]);
    ring.trigger();
    assert_eq!(file(&events).frames, 3);
}

#[test]
fn a_full_disk_is_reported_and_the_frames_stay() {
    let folder = tempfile::tempdir().unwrap();
    let (ring, events, gate) = gated_ring(folder.path());
    gate.set(|(_, is_open)| *is_open = true);
    gate.is_full.store(true, Ordering::SeqCst);
    (0..3).for_each(|index| write(&ring, index));
    ring.trigger();
    let Ok(RingEvent::Failed(error)) = events.recv_timeout(PATIENCE) else { panic!("no failure") };
    assert!(error.to_string().contains("kept-0001.mcap.partial at byte"), "{error}");
    assert!(error.remedy.as_deref().unwrap().starts_with("free some space"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "no incomplete file is left");
    write(&ring, 3);
    gate.is_full.store(false, Ordering::SeqCst);
    ring.trigger();
    let written = file(&events);
    assert_eq!((written.frames, written.path), (4, folder.path().join("kept-0001.mcap")));
    assert!(content(&folder.path().join("kept-0001.mcap"), LIVE) == recorded(folder.path(), &plan(), 4));
}

#[test]
fn requested_files_are_written_before_a_ring_closes() {
    let folder = tempfile::tempdir().unwrap();
    let (ring, events) = ring(&plan(), options(folder.path()));
    (0..5).for_each(|index| write(&ring, index));
    ring.trigger();
    ring.close();
    assert_eq!(file(&events).frames, 5);
}

#[test]
fn the_folder_of_a_ring_is_checked_before_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("absent/kept");
    let created = RingSink::new(&plan(), LIVE, options(&path), |_| {});
    let Err(error) = created else { panic!("its parent does not exist") };
    assert!(error.to_string().starts_with("failed to create"), "{error}");
}
