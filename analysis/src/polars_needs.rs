//! Whether polars can have its threads and descriptors.
//!
//! Where the system gives no more of them, polars' pools panic, or wait for ever for threads that never came. So as many as it
//! may start and open are started and opened once, all at the same time, before its first query.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread::{Builder, available_parallelism, scope};

/// What polars starts besides a thread a core, at most: those of its input and output.
const BESIDES: usize = 8;

/// Pipes, of two descriptors each, that come to more than polars opens and a report needs beside it.
const PIPES: usize = 8;

/// Whether polars' queries can be run here.
pub(crate) fn are_there() -> bool {
    static THERE: OnceLock<bool> = OnceLock::new();
    let threads = || 2 * available_parallelism().map_or(1, usize::from) + BESIDES;
    *THERE.get_or_init(|| can_open(PIPES) && can_start(threads()))
}

/// Whether so many pipes can be open at once.
fn can_open(pipes: usize) -> bool {
    (0..pipes).map(|_| std::io::pipe()).collect::<Result<Vec<_>, _>>().is_ok()
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
        assert!(super::can_start(4) && super::can_open(1));
        assert!(super::are_there());
    }
}
