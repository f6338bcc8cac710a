//! Threads that help: whoever has tiles runs them, whoever is idle joins in.
#![expect(unsafe_code, reason = "lends a closure that borrows from the stack to threads that outlive the call")]

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use super::Tiles;

/// How often a waiting thread looks again at once, before it lets other threads go first: some microseconds.
const SPINS: u32 = 500;

/// How often an idle helper lets others go first before it sleeps: longer than the time between two `run`s of one kernel,
/// so that a frame's helpers need not be woken for every one of them.
const YIELDS: u32 = 500;

/// Waits a little, the longer the more often it has been called.
fn wait(times: u32) {
    if times < SPINS { std::hint::spin_loop() } else { std::thread::yield_now() }
}

/// A meeting place of threads with tiles and threads without work.
///
/// It owns no threads: callers of [`Tiles::run`] do their own tiles, and threads inside [`Crew::work`] or
/// [`Crew::help`] take some off them. Several threads may call `run` at once; each returns when its own tiles are done.
pub struct Crew {
    width: usize,
    jobs: Mutex<Vec<Arc<Job>>>,
    /// Jobs with tiles not yet taken: read without the lock by idle helpers.
    open: AtomicUsize,
    closed: AtomicBool,
    wake: Condvar,
}

/// One `run` under way.
struct Job {
    /// The caller's closure; its lifetime is erased and kept by [`Tiles::run`], which outwaits all users.
    tile: *const (dyn Fn(usize) + Sync),
    len: usize,
    next: AtomicUsize,
    /// Tiles finished or given up.
    done: AtomicUsize,
    panic: Mutex<Option<Box<dyn std::any::Any + Send>>>,
}

// SAFETY: `tile` points to a `Sync` closure, which may be called from any thread; everything else is `Send` and `Sync`.
unsafe impl Send for Job {}
// SAFETY: as above.
unsafe impl Sync for Job {}

/// Ends [`Crew::work`] of all helpers when dropped, also by a panic.
pub struct Closing<'a>(&'a Crew);

impl Drop for Closing<'_> {
    fn drop(&mut self) {
        self.0.closed.store(true, Ordering::Release);
        drop(self.0.lock());
        self.0.wake.notify_all();
    }
}

impl Crew {
    /// A crew of `width` threads, those included that call `run`.
    #[must_use]
    pub fn new(width: usize) -> Self {
        Self {
            width: width.max(1),
            jobs: Mutex::default(),
            open: AtomicUsize::new(0),
            closed: AtomicBool::new(false),
            wake: Condvar::new(),
        }
    }

    /// Helps until the crew is closed; sleeps while there is nothing to do.
    pub fn work(&self) {
        let mut idle = 0;
        while !self.closed.load(Ordering::Acquire) {
            if self.help() {
                idle = 0;
            } else if idle < SPINS + YIELDS {
                wait(idle);
                idle += 1;
            } else {
                let jobs = self.lock();
                if jobs.is_empty() && !self.closed.load(Ordering::Acquire) {
                    drop(self.wake.wait(jobs).unwrap_or_else(PoisonError::into_inner));
                }
                idle = 0;
            }
        }
    }

    /// Does tiles of one `run` of another thread, if there is one with tiles left; whether it did any.
    pub fn help(&self) -> bool {
        if self.open.load(Ordering::Acquire) == 0 {
            return false;
        }
        let Some(job) = self.lock().iter().find(|job| job.next.load(Ordering::Relaxed) < job.len).cloned() else {
            return false;
        };
        self.take_tiles(&job)
    }

    /// A guard that closes the crew.
    #[must_use = "dropping the guard closes the crew"]
    pub fn closing(&self) -> Closing<'_> {
        Closing(self)
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Arc<Job>>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take_tiles(&self, job: &Job) -> bool {
        let mut any = false;
        loop {
            let index = job.next.fetch_add(1, Ordering::Relaxed);
            if index >= job.len {
                return any;
            }
            any = true;
            if index + 1 == job.len {
                self.open.fetch_sub(1, Ordering::Relaxed);
            }
            // SAFETY: `index < len` was taken by this thread alone and is not yet counted in `done`, so the `run` that
            // owns the closure is still waiting and the closure is alive.
            let tile = unsafe { &*job.tile };
            if let Err(panic) = catch_unwind(AssertUnwindSafe(|| tile(index))) {
                job.panic.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(panic);
            }
            job.done.fetch_add(1, Ordering::Release);
        }
    }
}

impl Tiles for Crew {
    fn run(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        if n <= 1 || self.width == 1 {
            (0..n).for_each(f);
            return;
        }
        // SAFETY: only the lifetime changes. The closure is called only for a taken tile (`take_tiles`), and this
        // function returns or unwinds only when all taken tiles are counted in `done`.
        let tile = unsafe {
            std::mem::transmute::<*const (dyn Fn(usize) + Sync + '_), *const (dyn Fn(usize) + Sync + 'static)>(f)
        };
        let job = Arc::new(Job {
            tile,
            len: n,
            next: AtomicUsize::new(0),
            done: AtomicUsize::new(0),
            panic: Mutex::new(None),
        });
        self.lock().push(Arc::clone(&job));
        self.open.fetch_add(1, Ordering::Release);
        self.wake.notify_all();
        self.take_tiles(&job);
        let mut looks = 0;
        while job.done.load(Ordering::Acquire) < n {
            wait(looks);
            looks = looks.saturating_add(1);
        }
        self.lock().retain(|other| !Arc::ptr_eq(other, &job));
        let panic = job.panic.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(panic) = panic {
            resume_unwind(panic);
        }
    }

    fn width(&self) -> usize {
        self.width
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::{Crew, Tiles};

    fn with_crew<R>(width: usize, f: impl FnOnce(&Crew) -> R) -> R {
        let crew = Crew::new(width);
        std::thread::scope(|scope| {
            let closing = crew.closing();
            for _ in 1..width {
                scope.spawn(|| crew.work());
            }
            let result = f(&crew);
            drop(closing);
            result
        })
    }

    #[test]
    fn each_tile_runs_once_and_before_run_returns() {
        with_crew(3, |crew| {
            for n in [0, 1, 2, 7, 100] {
                let counts: Vec<_> = (0..n).map(|_| AtomicUsize::new(0)).collect();
                crew.run(n, &|index| {
                    counts[index].fetch_add(1, Ordering::Relaxed);
                });
                assert!(counts.iter().all(|count| count.load(Ordering::Relaxed) == 1));
            }
        });
    }

    #[test]
    fn several_callers_share_one_crew() {
        with_crew(2, |crew| {
            let total = AtomicUsize::new(0);
            std::thread::scope(|scope| {
                for _ in 0..3 {
                    scope.spawn(|| {
                        for _ in 0..20 {
                            crew.run(10, &|index| {
                                total.fetch_add(index, Ordering::Relaxed);
                            });
                        }
                    });
                }
            });
            assert_eq!(total.into_inner(), 3 * 20 * 45);
        });
    }

    #[test]
    fn a_panicking_tile_panics_the_caller_after_all_tiles_ended() {
        with_crew(2, |crew| {
            let done = AtomicUsize::new(0);
            let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                crew.run(8, &|index| {
                    assert!(index != 3, "tile 3 fails");
                    done.fetch_add(1, Ordering::Relaxed);
                });
            }));
            assert!(result.is_err());
            assert_eq!(done.into_inner(), 7);
        });
    }
}
