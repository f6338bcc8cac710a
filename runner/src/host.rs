//! What the runner offers a node while it works.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use depthloom_graphs::contracts::NodeWarning;
use depthloom_graphs::plan::{FrameIndex, NodeId, RunId};
use depthloom_graphs::{Host, Key};
use depthloom_threads::{Budget, Caught, caught, into_unlocked, locked, resume};

use crate::checkpoints::{Checkpoints, Refused};
use crate::interrupt::Interrupt;
use crate::observer::Observer;
use crate::run_context::RunContext;
use crate::timing::Stopwatch;
use crate::warnings::Warnings;

/// The host of one task.
pub(crate) struct TaskHost<'a> {
    pub(crate) budget: &'a Budget,
    pub(crate) interrupt: &'a Interrupt,
    pub(crate) observer: &'a dyn Observer,
    pub(crate) warnings: &'a Warnings,
    pub(crate) run: RunId,
    /// `None` for the source.
    pub(crate) node: Option<NodeId>,
    /// `None` outside frames.
    pub(crate) position: Option<FrameIndex>,
    /// The cache key of the aggregate values that are computed.
    pub(crate) key: Option<Key>,
    pub(crate) checkpoints: Option<&'a Checkpoints>,
    pub(crate) helpers_cpu_ns: AtomicU64,
    /// The warnings of this task, each with a count.
    pub(crate) reported: Mutex<BTreeMap<String, u64>>,
    /// Whether its warnings were reported before: the task repeats one of an earlier process or another frame.
    pub(crate) is_repeated: bool,
    pub(crate) is_live: bool,
    /// What decided the outputs besides the inputs; see [`Host::observe`].
    pub(crate) observed: Mutex<Option<Key>>,
}

impl<'a> TaskHost<'a> {
    pub(crate) fn new<T>(context: &RunContext<'a, T>, run: RunId, node: Option<NodeId>) -> Self {
        let RunContext { budget, interrupt, observer, warnings, .. } = *context;
        Self {
            budget,
            interrupt,
            observer,
            warnings,
            run,
            node,
            position: None,
            key: None,
            checkpoints: None,
            helpers_cpu_ns: AtomicU64::new(0),
            reported: Mutex::default(),
            is_repeated: false,
            is_live: false,
            observed: Mutex::default(),
        }
    }

    pub(crate) fn into_warnings(self) -> impl Iterator<Item = NodeWarning> {
        let reported = into_unlocked(self.reported);
        reported.into_iter().map(move |(what, count)| NodeWarning { node: self.node, what, count })
    }
}

impl Host for TaskHost<'_> {
    fn cancelled(&self) -> bool {
        self.interrupt.aborts()
    }

    fn stopping(&self) -> bool {
        self.interrupt.stops_admission()
    }

    fn warn_n(&self, count: u64, what: &str) {
        let mut reported = locked(&self.reported);
        let first = !reported.contains_key(what);
        let counted = reported.entry(what.to_owned()).or_default();
        // Saturating: programs report any number.
        *counted = counted.saturating_add(count);
        drop(reported);
        if !self.is_repeated && self.warnings.add(self.run, self.node, what, count, first) {
            self.observer.warned(self.run, self.node, what);
        }
    }

    fn notice(&self, what: &str) {
        if self.warnings.add(self.run, self.node, what, 0, true) {
            self.observer.warned(self.run, self.node, what);
        }
    }

    fn info(&self, what: &str) {
        if let Some(node) = self.node {
            self.observer.info(self.run, node, what);
        }
    }

    fn progress(&self, done: u64, total: u64, message: &str) {
        if let Some(node) = self.node {
            self.observer.progress(self.run, node, done, total, message);
        }
    }

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        // All tiles run, so that the panic of the first one is reported.
        let panic: Mutex<Option<(usize, Caught)>> = Mutex::new(None);
        let tile = |tile| {
            if let Err(new) = caught(|| f(tile)) {
                let mut panic = locked(&panic);
                if panic.as_ref().is_none_or(|(first, _)| tile < *first) {
                    *panic = Some((tile, new));
                }
            }
        };
        let helping = |work: &dyn Fn()| {
            let watch = Stopwatch::start();
            work();
            self.helpers_cpu_ns.fetch_add(watch.cpu_ns(), Ordering::Relaxed);
        };
        self.budget.tiles(n, &tile, &helping);
        if let Some((_, first)) = into_unlocked(panic) {
            resume(first);
        }
    }

    fn width(&self) -> usize {
        self.budget.width()
    }

    fn add_cpu_time(&self, cpu_ns: u64) {
        self.helpers_cpu_ns.fetch_add(cpu_ns, Ordering::Relaxed);
    }

    fn position(&self) -> Option<FrameIndex> {
        self.position
    }

    fn key(&self) -> Option<Key> {
        self.key
    }

    fn is_live(&self) -> bool {
        self.is_live
    }

    fn observe(&self, what: Key) {
        let mut observed = locked(&self.observed);
        let all = observed.take().map_or(what, |before| Key::build("observed").key(&before).key(&what).finish());
        *observed = Some(all);
    }

    fn checkpoint(&self) -> Option<PathBuf> {
        match self.checkpoints?.take(&self.key?) {
            Ok(path) => path,
            Err(Refused::InUse) => {
                self.notice("another process computes the same values: this one keeps no checkpoint");
                None
            }
            Err(Refused::Io(error)) => {
                self.notice(&format!("no checkpoint can be kept: {error}"));
                None
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::TaskHost;
    use crate::interrupt::Interrupt;
    use crate::observer::Unwatched;
    use crate::warnings::Warnings;
    use depthloom_graphs::Host;
    use depthloom_graphs::plan::RunId;
    use depthloom_threads::{Budget, caught};
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

    fn host<'a>(budget: &'a Budget, interrupt: &'a Interrupt, warnings: &'a Warnings) -> TaskHost<'a> {
        TaskHost {
            budget,
            interrupt,
            observer: &Unwatched,
            warnings,
            run: RunId(0),
            node: None,
            position: None,
            key: None,
            checkpoints: None,
            helpers_cpu_ns: AtomicU64::new(0),
            reported: Mutex::default(),
            is_repeated: false,
            is_live: false,
            observed: Mutex::default(),
        }
    }

    #[test]
    fn the_first_panicking_tile_is_reported() {
        let (budget, interrupt) = (Budget::new(4), Interrupt::default());
        let tiles = || {
            host(&budget, &interrupt, &Warnings::default())
                .tiles(64, &|tile| assert!(tile % 10 != 7, "tile {tile} is odd"));
        };
        let message = caught(tiles).expect_err("tiles 7, 17, ... panic").0;
        assert!(message.ends_with("tile 7 is odd"), "{message}");
    }

    #[test]
    fn tiles_within_tiles_run() {
        let (budget, interrupt) = (Budget::new(3), Interrupt::default());
        let warnings = Warnings::default();
        let (host, count) = (host(&budget, &interrupt, &warnings), AtomicUsize::new(0));
        host.tiles(5, &|_| {
            host.tiles(7, &|_| {
                count.fetch_add(1, Ordering::SeqCst);
            });
        });
        assert_eq!(count.load(Ordering::SeqCst), 35);
    }
}
