//! The permits to work: they limit how many threads work at once.

use crate::locked;
use std::sync::atomic::{AtomicUsize, Ordering, fence};
use std::sync::{Condvar, Mutex, PoisonError};

use crossbeam::utils::{Backoff, CachePadded};

/// The permits to work, as many as threads may work at once. A worker without a task gives its permit back; a thread
/// that helps with tiles takes one.
///
/// Workers that have nothing to do sleep here. The protocol is the usual one of two flags: a thread that brings work
/// makes it visible and then looks for sleepers; one that goes to sleep registers and then looks for work. So one of
/// the two sees the other.
#[derive(Debug)]
pub struct Budget {
    width: usize,
    free: CachePadded<AtomicUsize>,
    sleepers: CachePadded<AtomicUsize>,
    asleep: Mutex<()>,
    wake: Condvar,
}

/// The right to work until dropped.
#[must_use = "dropping it gives it back"]
#[derive(Debug)]
pub struct Permit<'a>(&'a Budget);

impl Budget {
    /// A budget of `width` threads, at least one.
    #[must_use]
    pub fn new(width: usize) -> Self {
        let width = width.max(1);
        Self {
            width,
            free: CachePadded::new(AtomicUsize::new(width)),
            sleepers: CachePadded::new(AtomicUsize::new(0)),
            asleep: Mutex::new(()),
            wake: Condvar::new(),
        }
    }

    /// How many may work at once.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// A permit, if one is free.
    pub fn permit(&self) -> Option<Permit<'_>> {
        let take = |free: usize| free.checked_sub(1);
        // Cheap where none is free, which is the rule in a busy run.
        if self.free.load(Ordering::Relaxed) == 0 {
            return None;
        }
        // Created only for an acquired permit: dropping it releases the permit and wakes a waiter.
        self.free.fetch_update(Ordering::AcqRel, Ordering::Relaxed, take).is_ok().then(|| Permit(self))
    }

    /// A permit as soon as there is both work and a permit; `None` once the work is finished.
    pub fn permit_for(&self, is_work: impl Fn() -> bool, is_over: impl Fn() -> bool) -> Option<Permit<'_>> {
        let look = || if is_work() { self.permit() } else { None };
        // A task often follows within microseconds, and going to sleep costs several.
        let spin = Backoff::new();
        while !spin.is_completed() {
            if is_over() {
                return None;
            }
            if let Some(permit) = look() {
                return Some(permit);
            }
            spin.snooze();
        }
        self.sleepers.fetch_add(1, Ordering::SeqCst);
        fence(Ordering::SeqCst);
        let mut asleep = locked(&self.asleep);
        let permit = loop {
            if is_over() {
                break None;
            }
            if let Some(permit) = look() {
                break Some(permit);
            }
            asleep = self.wake.wait(asleep).unwrap_or_else(PoisonError::into_inner);
        };
        self.sleepers.fetch_sub(1, Ordering::SeqCst);
        permit
    }

    /// Wakes sleepers for that many new tasks.
    pub fn wake(&self, tasks: usize) {
        fence(Ordering::SeqCst);
        let sleepers = self.sleepers.load(Ordering::SeqCst);
        if tasks == 0 || sleepers == 0 {
            return;
        }
        let _asleep = locked(&self.asleep);
        (0..tasks.min(sleepers)).for_each(|_| self.wake.notify_one());
    }

    /// Wakes all sleepers, because the work is finished.
    pub fn wake_all(&self) {
        let _asleep = locked(&self.asleep);
        self.wake.notify_all();
    }
}

impl Permit<'_> {
    /// Gives the permit back without waking anyone: right only for who looks for work itself afterwards.
    pub fn rest(self) {
        self.0.free.fetch_add(1, Ordering::Release);
        std::mem::forget(self);
    }
}

impl Drop for Permit<'_> {
    fn drop(&mut self) {
        self.0.free.fetch_add(1, Ordering::SeqCst);
        // There may be a task that waits for no more than a permit.
        self.0.wake(1);
    }
}

#[cfg(test)]
mod tests {
    use super::Budget;
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

    #[test]
    fn there_are_as_many_permits_as_workers() {
        let budget = Budget::new(2);
        let (first, second) = (budget.permit(), budget.permit());
        assert!(first.is_some() && second.is_some() && budget.permit().is_none());
        drop(first);
        assert!(budget.permit().is_some());
    }

    #[test]
    fn a_late_worker_neither_creates_a_permit_nor_waits_forever() {
        let budget = Budget::new(2);
        let (now, peak) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..20_000 {
                        let permit = budget.permit_for(|| true, || false);
                        peak.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                        now.fetch_sub(1, Ordering::SeqCst);
                        drop(permit);
                    }
                });
            }
        });
        assert!(peak.into_inner() <= 2);
        assert_eq!(std::iter::from_fn(|| budget.permit().map(std::mem::forget)).count(), 2);
    }

    #[test]
    fn sleepers_find_every_task_and_wake_at_the_end() {
        let budget = Budget::new(3);
        let (tasks, taken, over) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicBool::new(false));
        let take = |tasks: usize| tasks.checked_sub(1);
        std::thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| {
                    let is_work = || tasks.load(Ordering::SeqCst) > 0;
                    while let Some(permit) = budget.permit_for(is_work, || over.load(Ordering::SeqCst)) {
                        if tasks.fetch_update(Ordering::SeqCst, Ordering::SeqCst, take).is_ok() {
                            taken.fetch_add(1, Ordering::SeqCst);
                        }
                        permit.rest();
                    }
                });
            }
            for _ in 0..2000 {
                tasks.fetch_add(1, Ordering::SeqCst);
                budget.wake(1);
                // Every other task finds the others asleep or about to be.
                while tasks.load(Ordering::SeqCst) > 1 {
                    std::thread::yield_now();
                }
            }
            while taken.load(Ordering::SeqCst) < 2000 {
                std::thread::yield_now();
            }
            over.store(true, Ordering::SeqCst);
            budget.wake_all();
        });
        assert_eq!(taken.load(Ordering::SeqCst), 2000);
    }
}
