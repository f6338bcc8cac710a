//! What sources warn of while their frames are looked at and nothing is run.

use std::collections::BTreeSet;
use std::sync::Mutex;

use depthloom_graphs::Host;
use depthloom_threads::{into_unlocked, locked};

#[derive(Default)]
pub(crate) struct WarningCollector(Mutex<BTreeSet<String>>);

impl WarningCollector {
    /// All of it, in order.
    pub(crate) fn into_warnings(self) -> BTreeSet<String> {
        into_unlocked(self.0)
    }
}

impl Host for WarningCollector {
    fn cancelled(&self) -> bool {
        false
    }

    fn warn_n(&self, _count: u64, what: &str) {
        locked(&self.0).insert(what.to_owned());
    }

    fn progress(&self, _done: u64, _total: u64, _message: &str) {}

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).for_each(f);
    }

    fn width(&self) -> usize {
        1
    }
}
