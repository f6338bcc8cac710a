//! What sources warn of while their frames are looked at and nothing is run.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use depthloom_graphs::Host;

/// What the sources warn of, each once.
#[derive(Default)]
pub struct Told(Mutex<BTreeSet<String>>);

impl Told {
    /// All of it, in order.
    pub fn into_warnings(self) -> BTreeSet<String> {
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Host for Told {
    fn cancelled(&self) -> bool {
        false
    }

    fn warn_of(&self, _count: u64, what: &str) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(what.to_owned());
    }

    fn progress(&self, _done: u64, _total: u64, _message: &str) {}

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).for_each(f);
    }

    fn width(&self) -> usize {
        1
    }
}
