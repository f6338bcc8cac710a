//! Whether polars can have its threads.
//!
//! Where the system gives no more threads, polars' pools panic, or wait for ever for threads that never came. So as many as it
//! may start are started once, all at the same time, before its first query.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread::{Builder, available_parallelism, scope};

/// What polars starts besides a thread a core, at most: those of its input and output.
const BESIDES: usize = 8;

/// Whether polars' queries can be run here.
pub(crate) fn are_there() -> bool {
    static THERE: OnceLock<bool> = OnceLock::new();
    *THERE.get_or_init(|| can_start(2 * available_parallelism().map_or(1, usize::from) + BESIDES))
}

/// Whether so many threads can run at once.
fn can_start(threads: usize) -> bool {
    // Each waits until all have been started or one could not be.
    let gate = Mutex::new(());
    scope(|scope| {
        let closed = gate.lock().unwrap_or_else(PoisonError::into_inner);
        let start = |_| {
            let wait = || drop(gate.lock().unwrap_or_else(PoisonError::into_inner));
            Builder::new().name("depthloom-probe".to_owned()).spawn_scoped(scope, wait).is_ok()
        };
        let started = (0..threads).all(start);
        drop(closed);
        started
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_few_threads_can_be_started_and_more_than_there_can_be_cannot() {
        assert!(super::can_start(4));
        assert!(super::are_there());
    }
}
