//! How a kernel spreads one frame over threads: it names the pieces, the caller owns the threads.

use depthloom_threads::locked;
use std::sync::Mutex;

pub use depthloom_threads::{Serial, Tiles, rounds_in_one_run};

/// Runs each part as a tile of its own.
pub(crate) fn each<T: Send>(tiles: &dyn Tiles, parts: Vec<T>, f: impl Fn(usize, T) + Sync) {
    let parts: Vec<_> = parts.into_iter().map(|part| Mutex::new(Some(part))).collect();
    tiles.run(parts.len(), &|index| {
        let part = locked(&parts[index]).take();
        f(index, part.expect("each index comes once"));
    });
}
