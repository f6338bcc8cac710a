//! What the runner offers a node while it works.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::{Builder, scope};

use depthloom_graphs::{Host, Key};

use crate::checkpoints::{Checkpoints, Refused};
use crate::crew::Crew;
use crate::interrupt::Interrupt;
use crate::observer::Observer;
use crate::panics::{Caught, caught, resume};
use crate::timing::Stopwatch;
use crate::warnings::Warnings;

/// The host of one task.
///
/// Tiles are drawn from a counter by the caller and by helpers: threads started for the call, one for every permit that is
/// free, so that tiles never take a core from a task. A started thread costs tens of microseconds, which is little beside the
/// milliseconds that tiles are for, and it may borrow the caller's data without any `unsafe`.
pub(crate) struct TaskHost<'a> {
    pub(crate) crew: &'a Crew,
    pub(crate) interrupt: &'a Interrupt,
    pub(crate) observer: &'a dyn Observer,
    pub(crate) warnings: &'a Warnings,
    pub(crate) run: usize,
    /// The node that works, if it is one.
    pub(crate) node: Option<usize>,
    /// Of a once-node: the key of what it gives, and where it may put down checkpoints.
    pub(crate) once: Option<(Key, &'a Checkpoints)>,
    /// Processor time of helpers.
    pub(crate) helpers_cpu_ns: AtomicU64,
}

impl Host for TaskHost<'_> {
    fn cancelled(&self) -> bool {
        self.interrupt.aborts()
    }

    fn stopping(&self) -> bool {
        self.interrupt.stops_admission()
    }

    fn warn_of(&self, count: u64, what: &str) {
        if self.warnings.add(self.run, self.node, what, count) {
            self.observer.warned(self.run, self.node, what);
        }
    }

    fn tell(&self, what: &str) {
        if let Some(node) = self.node {
            self.observer.told(self.run, node, what);
        }
    }

    fn progress(&self, done: u64, total: u64, message: &str) {
        if let Some(node) = self.node {
            self.observer.progress(self.run, node, done, total, message);
        }
    }

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        let next = AtomicUsize::new(0);
        // Of several tiles that panic the first is told, whoever ran it: so all are run.
        let panic: Mutex<Option<(usize, Caught)>> = Mutex::new(None);
        let draw = || {
            let tile = next.fetch_add(1, Ordering::Relaxed);
            if tile >= n {
                return false;
            }
            if let Err(new) = caught(|| f(tile)) {
                let mut panic = panic.lock().unwrap_or_else(PoisonError::into_inner);
                if panic.as_ref().is_none_or(|(first, _)| tile < *first) {
                    *panic = Some((tile, new));
                }
            }
            true
        };
        let (draw, helpers_cpu_ns) = (&draw, &self.helpers_cpu_ns);
        scope(|scope| {
            // Looked for again before every tile: a permit that becomes free meanwhile brings one more helper.
            loop {
                while n.saturating_sub(next.load(Ordering::Relaxed)) > 1
                    && let Some(permit) = self.crew.permit()
                {
                    let helper = move || {
                        let watch = Stopwatch::start();
                        while draw() {}
                        helpers_cpu_ns.fetch_add(watch.cpu_ns(), Ordering::Relaxed);
                        drop(permit);
                    };
                    if Builder::new().name("depthloom-tiles".to_owned()).spawn_scoped(scope, helper).is_err() {
                        // No thread to be had: the caller works alone.
                        break;
                    }
                }
                if !draw() {
                    break;
                }
            }
        });
        if let Some((_, first)) = panic.into_inner().unwrap_or_else(PoisonError::into_inner) {
            resume(first);
        }
    }

    fn width(&self) -> usize {
        self.crew.width()
    }

    fn spent(&self, cpu_ns: u64) {
        self.helpers_cpu_ns.fetch_add(cpu_ns, Ordering::Relaxed);
    }

    fn key(&self) -> Option<Key> {
        self.once.map(|(key, _)| key)
    }

    fn checkpoint(&self) -> Option<PathBuf> {
        let (key, checkpoints) = self.once?;
        match checkpoints.take(&key) {
            Ok(path) => path,
            Err(Refused::InUse) => {
                self.warn("another process is at the same work: nothing is kept of this one's until it is done");
                None
            }
            Err(Refused::Io(error)) => {
                self.warn(&format!("no checkpoint can be kept: {error}"));
                None
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::TaskHost;
    use crate::crew::Crew;
    use crate::interrupt::Interrupt;
    use crate::observer::Unwatched;
    use crate::panics::caught;
    use crate::warnings::Warnings;
    use depthloom_graphs::Host;
    use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

    fn host<'a>(crew: &'a Crew, interrupt: &'a Interrupt, warnings: &'a Warnings) -> TaskHost<'a> {
        TaskHost {
            crew,
            interrupt,
            observer: &Unwatched,
            warnings,
            run: 0,
            node: None,
            once: None,
            helpers_cpu_ns: AtomicU64::new(0),
        }
    }

    #[test]
    fn every_tile_runs_once_and_never_more_at_once_than_permits() {
        for workers in [1, 2, 8] {
            let (crew, interrupt) = (Crew::new(workers), Interrupt::default());
            let own = crew.permit().expect("nobody works yet");
            let (now, peak) = (AtomicUsize::new(0), AtomicUsize::new(0));
            let runs: Vec<AtomicUsize> = (0..500).map(|_| AtomicUsize::new(0)).collect();
            let warnings = Warnings::default();
            let host = host(&crew, &interrupt, &warnings);
            host.tiles(runs.len(), &|tile| {
                peak.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                runs[tile].fetch_add(1, Ordering::SeqCst);
                std::thread::yield_now();
                now.fetch_sub(1, Ordering::SeqCst);
            });
            assert!(runs.iter().all(|r| r.load(Ordering::SeqCst) == 1));
            assert!(peak.load(Ordering::SeqCst) <= workers);
            drop(own);
            let all: Vec<_> = std::iter::from_fn(|| crew.permit()).collect();
            assert_eq!(all.len(), workers, "helpers give their permits back");
        }
    }

    #[test]
    fn the_first_panicking_tile_is_told() {
        let (crew, interrupt) = (Crew::new(4), Interrupt::default());
        let tiles = || {
            host(&crew, &interrupt, &Warnings::default())
                .tiles(64, &|tile| assert!(tile % 10 != 7, "tile {tile} is odd"));
        };
        let told = caught(tiles).expect_err("tiles 7, 17, ... panic").0;
        assert!(told.ends_with("tile 7 is odd"), "{told}");
    }

    #[test]
    fn tiles_within_tiles_run() {
        let (crew, interrupt) = (Crew::new(3), Interrupt::default());
        let warnings = Warnings::default();
        let (host, count) = (host(&crew, &interrupt, &warnings), AtomicUsize::new(0));
        host.tiles(5, &|_| {
            host.tiles(7, &|_| {
                count.fetch_add(1, Ordering::SeqCst);
            });
        });
        assert_eq!(count.load(Ordering::SeqCst), 35);
    }
}
