//! Tiles: the independent pieces of a call that may run on several threads.

use crate::{into_unlocked, locked};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::ThreadId;

/// Runs the independent pieces ("tiles") of a call.
///
/// Callers cut their work by its size and never by [`Tiles::width`], and tiles of one `run` write to different
/// places: the result never depends on who runs which tile, nor on how many threads there are.
pub trait Tiles: Sync {
    /// Calls `f(0)`, ..., `f(n - 1)`, each index exactly once, possibly on several threads; returns when all are done.
    fn run(&self, n: usize, f: &(dyn Fn(usize) + Sync));

    /// Calls `f(round, tile)` for every tile below `counts[round]` of every round; a round begins when the one before
    /// is done.
    fn rounds(&self, counts: &[usize], f: &(dyn Fn(usize, usize) + Sync)) {
        for (round, &count) in counts.iter().enumerate() {
            self.run(count, &|tile| f(round, tile));
        }
    }

    /// How many calls could be under way at once, at least 1. A hint: scratch memory may be sized by it; cuts only
    /// where they change no bit of a result.
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

/// The results of `f(0)`, ..., `f(n - 1)`, in this order, whichever thread computed which.
pub fn in_order<R: Send>(tiles: &dyn Tiles, n: usize, f: impl Fn(usize) -> R + Sync) -> Vec<R> {
    let results: Mutex<Vec<(usize, R)>> = Mutex::new(Vec::with_capacity(n));
    tiles.run(n, &|index| {
        let result = f(index);
        locked(&results).push((index, result));
    });
    let mut results = into_unlocked(results);
    results.sort_unstable_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

/// How often a thread that waits for others looks again at once, before it lets other threads go first: some tens of
/// microseconds, as long as tiles take.
const SPINS: u32 = 1000;

/// [`Tiles::rounds`] by one [`Tiles::run`], for those to whom each `run` is dear because it calls threads together.
///
/// A thread that comes to a round before the one before is done waits for it. So `tiles` must begin its calls in
/// ascending order, as by a counter: then what is waited for has been begun, and is not itself waiting for what comes
/// later.
///
/// The tiles of a round are shared out by their place among the others, and a thread does its own share of every round
/// before it takes those of others: its cache still has the data of the previous round.
pub fn rounds_in_one_run(tiles: &dyn Tiles, counts: &[usize], f: &(dyn Fn(usize, usize) + Sync)) {
    let width = tiles.width();
    let mut first = 0;
    let rounds: Vec<_> = counts.iter().map(|&count| Round::new(&mut first, count, width)).collect();
    let (done, threads) = (AtomicUsize::new(0), Mutex::new(Vec::with_capacity(width)));
    tiles.run(first, &|index| {
        // The last round that begins here or before: those before it that begin here too have no tiles.
        let round = rounds.partition_point(|round| round.first <= index) - 1;
        let mut looks = 0_u32;
        while done.load(Ordering::Acquire) < rounds[round].first {
            if looks < SPINS {
                std::hint::spin_loop();
            } else {
                std::thread::yield_now();
            }
            looks = looks.saturating_add(1);
        }
        let _done = Done(&done);
        f(round, rounds[round].take(number_of_this_thread(&threads)));
    });
}

fn number_of_this_thread(threads: &Mutex<Vec<ThreadId>>) -> usize {
    let me = std::thread::current().id();
    let mut threads = locked(threads);
    let known = threads.iter().position(|&thread| thread == me);
    known.unwrap_or_else(|| {
        threads.push(me);
        threads.len() - 1
    })
}

/// The tiles of a round that have not been started.
struct Round {
    /// How many tiles the rounds before have.
    first: usize,
    /// Of each share the next tile, and its end.
    shares: Vec<(AtomicUsize, usize)>,
}

impl Round {
    fn new(first: &mut usize, count: usize, shares: usize) -> Self {
        let cut = |share: usize| count * share / shares;
        let shares = (0..shares).map(|share| (AtomicUsize::new(cut(share)), cut(share + 1))).collect();
        let round = Self { first: *first, shares };
        *first += count;
        round
    }

    /// A tile: of the share of that number, or of the next that has one.
    fn take(&self, share: usize) -> usize {
        let from = share % self.shares.len();
        let shares = self.shares[from..].iter().chain(&self.shares[..from]);
        let mut taken = shares.filter_map(|(next, end)| {
            let tile = next.fetch_add(1, Ordering::Relaxed);
            (tile < *end).then_some(tile)
        });
        taken.next().expect("a round has as many tiles as calls")
    }
}

/// Counts a tile when dropped, also by a panic: the others do not wait for it.
struct Done<'a>(&'a AtomicUsize);

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.0.fetch_add(1, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::{Serial, Tiles, in_order, rounds_in_one_run};
    use crate::Budget;

    #[test]
    fn results_are_in_the_order_of_their_indices() {
        for width in [1, 4] {
            let budget = Budget::new(width);
            let _own = budget.permit();
            let results = in_order(&budget, 100, |index| {
                std::thread::sleep(std::time::Duration::from_micros(100 - index as u64));
                index * index
            });
            assert!(results.into_iter().eq((0..100).map(|index| index * index)));
        }
    }

    #[test]
    fn serial_runs_each_index_once_in_order() {
        let seen = Mutex::new(Vec::new());
        Serial.run(5, &|index| seen.lock().unwrap().push(index));
        assert_eq!(seen.into_inner().unwrap(), [0, 1, 2, 3, 4]);
        assert_eq!(Serial.width(), 1);
    }

    #[test]
    fn a_round_begins_when_the_one_before_is_done() {
        let counts = [3, 0, 7, 1, 0, 0, 40, 2];
        for width in [1, 2, 3, 8] {
            let budget = Budget::new(width);
            let _own = budget.permit();
            let runs: Vec<Vec<AtomicUsize>> =
                counts.iter().map(|&count| (0..count).map(|_| AtomicUsize::new(0)).collect()).collect();
            for spread in [&budget as &dyn Tiles, &Serial] {
                runs.iter().flatten().for_each(|runs| runs.store(0, Ordering::SeqCst));
                rounds_in_one_run(spread, &counts, &|round, tile| {
                    let before = runs[..round].iter().flatten();
                    assert!(before.map(|runs| runs.load(Ordering::SeqCst)).all(|runs| runs == 1));
                    std::thread::yield_now();
                    runs[round][tile].fetch_add(1, Ordering::SeqCst);
                });
                assert!(runs.iter().flatten().all(|runs| runs.load(Ordering::SeqCst) == 1));
            }
        }
    }

    #[test]
    fn a_tile_that_panics_leaves_no_round_waiting() {
        let budget = Budget::new(2);
        let _own = budget.permit();
        let run = || rounds_in_one_run(&budget, &[4, 4], &|round, tile| assert!((round, tile) != (0, 1), "meant"));
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_err());
    }
}
