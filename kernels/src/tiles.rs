//! How a kernel spreads one frame over threads: it names the pieces, somebody else owns the threads.

mod crew;

use std::sync::{Mutex, PoisonError};

pub use crew::{Closing, Crew};

/// Runs the independent pieces ("tiles") of a kernel.
///
/// Kernels cut their work by the image's size and never by [`Tiles::width`], and tiles of one `run` write to different
/// places: the result never depends on who runs which tile, nor on how many threads there are.
pub trait Tiles: Sync {
    /// Calls `f(0)`, ..., `f(n - 1)`, each index exactly once, possibly on several threads; returns when all are done.
    fn run(&self, n: usize, f: &(dyn Fn(usize) + Sync));

    /// How many calls could be under way at once, at least 1. A hint: kernels size scratch memory by it, not their cuts.
    fn width(&self) -> usize;
}

/// All tiles on the calling thread, in order.
#[derive(Clone, Copy, Debug, Default)]
pub struct Serial;

impl Tiles for Serial {
    fn run(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        for index in 0..n {
            f(index);
        }
    }

    fn width(&self) -> usize {
        1
    }
}

/// Runs each part as a tile of its own.
pub(crate) fn each<T: Send>(tiles: &dyn Tiles, parts: Vec<T>, f: impl Fn(usize, T) + Sync) {
    let parts: Vec<_> = parts.into_iter().map(|part| Mutex::new(Some(part))).collect();
    tiles.run(parts.len(), &|index| {
        let part = parts[index].lock().unwrap_or_else(PoisonError::into_inner).take();
        f(index, part.expect("each index comes once"));
    });
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::{Serial, Tiles};

    #[test]
    fn serial_runs_each_index_once_in_order() {
        let seen = Mutex::new(Vec::new());
        Serial.run(5, &|index| seen.lock().unwrap().push(index));
        assert_eq!(seen.into_inner().unwrap(), [0, 1, 2, 3, 4]);
        assert_eq!(Serial.width(), 1);
    }
}
