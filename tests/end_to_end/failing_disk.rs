//! A disk that fails while a recording is written or resumed: the run resumes once the disk works again, and ends with
//! the same bytes.

use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use depthloom_graphs::Registry;
use depthloom_graphs::language::{Options, load};
use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::Ready;
use depthloom_recording::{Disk, EarlierRuns, Recorder, Recording};
use depthloom_runner::{Interrupt, Unwatched};

use crate::resume::{below, kills};
use crate::reuse::experiment;

/// How a disk fails.
#[derive(Clone, Copy, Debug)]
enum Fault {
    /// A write that does not fit is written in part; all later writes fail.
    Full,
    /// A write that does not fit fails completely, and so do all later calls.
    Broken,
    /// One write fails; later ones succeed.
    Once,
    /// All writes succeed, but synchronising fails.
    Unsynchronised,
}

const FAULTS: [Fault; 4] = [Fault::Full, Fault::Broken, Fault::Once, Fault::Unsynchronised];

/// A file with room for a limited number of bytes.
struct FailingDisk {
    file: File,
    fault: Fault,
    room: AtomicU64,
}

impl FailingDisk {
    fn is_full(&self) -> bool {
        self.room.load(Ordering::SeqCst) == 0
    }
}

impl Disk for FailingDisk {
    fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        let room = self.room.load(Ordering::SeqCst);
        let fits = bytes.len().min(usize::try_from(room).unwrap_or(usize::MAX));
        if fits < bytes.len() {
            match self.fault {
                Fault::Full if fits > 0 => {}
                Fault::Full => return Err(ErrorKind::StorageFull.into()),
                Fault::Broken => {
                    self.room.store(0, Ordering::SeqCst);
                    return Err(io::Error::from_raw_os_error(5));
                }
                Fault::Once => {
                    self.room.store(u64::MAX, Ordering::SeqCst);
                    return Err(io::Error::from_raw_os_error(5));
                }
                Fault::Unsynchronised => {
                    self.room.store(0, Ordering::SeqCst);
                    return Disk::write(&self.file, bytes);
                }
            }
        }
        let written = Disk::write(&self.file, &bytes[..fits])?;
        self.room.fetch_sub(written as u64, Ordering::SeqCst);
        Ok(written)
    }

    fn sync_data(&self) -> io::Result<()> {
        self.sync_all()
    }

    fn sync_all(&self) -> io::Result<()> {
        match self.fault {
            Fault::Unsynchronised | Fault::Broken if self.is_full() => Err(io::Error::from_raw_os_error(5)),
            _ => Ok(()),
        }
    }
}

/// A run whose recording is written through the test's disk.
struct Run {
    registry: Registry,
    experiment: PathBuf,
    recording: PathBuf,
}

impl Run {
    fn ready(&self) -> (Ready, Plan) {
        let plan = load(&self.experiment, &self.registry, &Options::default()).expect("a valid experiment").plan;
        let ready = Ready::new(plan, &self.registry).unwrap_or_else(|missing| panic!("{missing:?}"));
        let plan = ready.plan.clone();
        (ready, plan)
    }

    /// Starts or resumes the run, as the command `run` does. Returns whether it finished.
    fn run(&self, durable: bool, fault: Option<(Fault, u64)>) -> bool {
        let (ready, plan) = self.ready();
        let partial =
            Recording::open(&self.recording).ok().filter(|partial| !partial.is_empty() && partial.has_plan(&plan));
        let earlier = Arc::new(EarlierRuns::new(partial.iter().map(Recording::path), &plan));
        let open_disk = |file: File| -> Arc<dyn Disk> {
            match fault {
                Some((fault, room)) => Arc::new(FailingDisk { file, fault, room: AtomicU64::new(room) }),
                None => Arc::new(file),
            }
        };
        let recorder = match &partial {
            Some(partial) => Recorder::resume_through(partial, &plan, &open_disk),
            None => Recorder::create_through(&self.recording, &plan, &open_disk),
        };
        let Ok(recorder) = recorder else { return false };
        let recorder = recorder.with_earlier(earlier).durable(durable);
        let options = depthloom_runner::Options { workers: 2, ..depthloom_runner::Options::default() };
        let ran = depthloom_runner::run(ready, &recorder, &options, &Unwatched, &Interrupt::default());
        let finished = if ran.is_ok() { recorder.finish(&[]) } else { recorder.finish_early() };
        assert!(fault.is_some() || (ran.is_ok() && finished.is_ok()), "{ran:?}, {finished:?}");
        ran.is_ok() && finished.is_ok()
    }
}

#[test]
fn a_run_resumes_after_a_disk_failure_at_any_byte_with_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    let at = |name: &str| Run {
        registry: depthloom::registry(),
        experiment: experiment.clone(),
        recording: folder.path().join(name),
    };
    assert!(at("expected.mcap").run(false, None));
    let read = |path: &Path| std::fs::read(path).expect("a recording");
    let expected = read(&folder.path().join("expected.mcap"));
    let (mut failed, mut resumed) = (0, 0);
    for case in 0..kills() {
        let run = at("failing.mcap");
        let durable = case % 3 == 0;
        // Half of the cases fail a second time while they resume.
        for again in 0..=case % 2 {
            let seed = case * 2 + again + 1;
            let fault = FAULTS[below(seed + 1000, 4) as usize];
            let finished = run.run(durable, Some((fault, below(seed, expected.len() as u64))));
            failed += u64::from(!finished);
            if finished {
                break;
            }
        }
        let partial = Recording::open(&run.recording);
        resumed += u64::from(partial.is_ok_and(|partial| !partial.is_empty()));
        run.run(durable, None);
        assert!(read(&run.recording) == expected, "case {case}");
        std::fs::remove_file(&run.recording).expect("removed");
    }
    println!(
        "{failed} failures in {} runs, of which {resumed} resumed after recorded frames: all ended with the same bytes",
        kills()
    );
    assert!(failed * 2 >= kills() && resumed * 10 >= kills() * 7, "{failed} failed, {resumed} resumed");
}
