//! Tiles on the permits of a budget.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{Builder, scope};

use crate::{Budget, Tiles, look_for_room, rounds_in_one_run};

impl Tiles for Budget {
    fn run(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        self.tiles(n, f, &|work| work());
    }

    fn rounds(&self, counts: &[usize], f: &(dyn Fn(usize, usize) + Sync)) {
        rounds_in_one_run(self, counts, f);
    }

    fn width(&self) -> usize {
        Self::width(self)
    }
}

impl Budget {
    /// Runs `f(0)`, ..., `f(n - 1)`, each once, begun in ascending order; returns when all are done. The caller, who
    /// has a permit, works; helpers are threads started for the call, one for every permit that is free, so that tiles
    /// never take a core from other work. `helping` runs on each of these threads around its work, which it must call.
    ///
    /// A started thread costs tens of microseconds, which is little beside the milliseconds that tiles are for, and it
    /// may borrow the caller's data without any `unsafe`.
    ///
    /// # Panics
    /// If a tile panics; which panic is reported, and how many other tiles still run, is not specified.
    pub fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync), helping: &(dyn Fn(&dyn Fn()) + Sync)) {
        let next = AtomicUsize::new(0);
        let draw = || {
            let tile = next.fetch_add(1, Ordering::Relaxed);
            let is_one = tile < n;
            if is_one {
                f(tile);
            }
            is_one
        };
        let draw = &draw;
        scope(|scope| {
            // Looked for again before every tile: a permit that becomes free meanwhile brings one more helper.
            loop {
                while n.saturating_sub(next.load(Ordering::Relaxed)) > 1
                    && let Some(permit) = self.permit()
                {
                    let helper = move || {
                        helping(&|| while draw() {});
                        drop(permit);
                    };
                    let started = look_for_room()
                        .and_then(|()| Builder::new().name("depthloom-tiles".to_owned()).spawn_scoped(scope, helper));
                    if started.is_err() {
                        // No thread to be had: the caller works alone.
                        break;
                    }
                }
                if !draw() {
                    break;
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use crate::{Budget, Tiles};

    #[test]
    fn every_tile_runs_once_and_never_more_at_once_than_permits() {
        for width in [1, 2, 8] {
            let budget = Budget::new(width);
            let own = budget.permit().expect("no permit is in use yet");
            let (now, peak) = (AtomicUsize::new(0), AtomicUsize::new(0));
            let runs: Vec<AtomicUsize> = (0..500).map(|_| AtomicUsize::new(0)).collect();
            budget.run(runs.len(), &|tile| {
                peak.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                runs[tile].fetch_add(1, Ordering::SeqCst);
                std::thread::yield_now();
                now.fetch_sub(1, Ordering::SeqCst);
            });
            assert!(runs.iter().all(|runs| runs.load(Ordering::SeqCst) == 1));
            assert!(peak.load(Ordering::SeqCst) <= width);
            drop(own);
            let all: Vec<_> = std::iter::from_fn(|| budget.permit()).collect();
            assert_eq!(all.len(), width, "helpers give their permits back");
        }
    }

    #[test]
    fn helpers_work_inside_the_given_wrapper() {
        let budget = Budget::new(3);
        let caller = std::thread::current().id();
        let (helpers, strangers) = (Mutex::new(Vec::new()), AtomicUsize::new(0));
        let tile = |_| {
            let me = std::thread::current().id();
            if me != caller && !helpers.lock().expect("no tile panicked").contains(&me) {
                strangers.fetch_add(1, Ordering::Relaxed);
            }
            std::thread::yield_now();
        };
        let helping = |work: &dyn Fn()| {
            helpers.lock().expect("no tile panicked").push(std::thread::current().id());
            work();
        };
        let _own = budget.permit();
        budget.tiles(200, &tile, &helping);
        assert_eq!(helpers.lock().expect("no tile panicked").len(), 2);
        assert_eq!(strangers.into_inner(), 0);
    }

    #[test]
    fn several_callers_share_one_budget() {
        let (budget, total) = (Budget::new(3), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| {
                    let _own = budget.permit();
                    for _ in 0..20 {
                        budget.run(10, &|tile| {
                            total.fetch_add(tile, Ordering::Relaxed);
                        });
                    }
                });
            }
        });
        assert_eq!(total.into_inner(), 3 * 20 * 45);
    }
}
