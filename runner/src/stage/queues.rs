//! The tasks that are ready, oldest frame first.

use std::sync::atomic::{AtomicUsize, Ordering};

use crossbeam::deque::{Injector, Steal};
use crossbeam::utils::CachePadded;
use depthloom_graphs::plan::FrameIndex;

/// A queue per frame in flight: frame `k` has queue `k % window`, which no other frame in flight shares.
pub(crate) struct Queues<T> {
    ring: Box<[Injector<T>]>,
    oldest: CachePadded<AtomicUsize>,
}

impl<T> Queues<T> {
    pub(crate) fn new(window: usize) -> Self {
        Self { ring: (0..window).map(|_| Injector::new()).collect(), oldest: CachePadded::new(AtomicUsize::new(0)) }
    }

    /// Only the order of tasks depends on it, so a late reader does no harm.
    pub(crate) fn set_oldest(&self, position: FrameIndex) {
        self.oldest.store(position.0, Ordering::Relaxed);
    }

    pub(crate) fn push(&self, position: FrameIndex, task: T) {
        self.ring[position.0 % self.ring.len()].push(task);
    }

    pub(crate) fn pop(&self) -> Option<T> {
        self.pop_older_than(FrameIndex(usize::MAX))
    }

    /// The task of the oldest frame that has one, among the frames before `position`.
    pub(crate) fn pop_older_than(&self, position: FrameIndex) -> Option<T> {
        let oldest = self.oldest.load(Ordering::Relaxed);
        (oldest..position.0.min(oldest.saturating_add(self.ring.len()))).find_map(|k| {
            let queue = &self.ring[k % self.ring.len()];
            loop {
                match queue.steal() {
                    Steal::Success(task) => return Some(task),
                    Steal::Empty => return None,
                    Steal::Retry => std::hint::spin_loop(),
                }
            }
        })
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.ring.iter().all(Injector::is_empty)
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::plan::FrameIndex;

    use super::Queues;

    #[test]
    fn older_frames_come_first_and_tasks_of_a_frame_in_order() {
        let queues = Queues::new(3);
        queues.set_oldest(FrameIndex(4));
        for task in [(6, 0), (4, 0), (5, 0), (4, 1)] {
            queues.push(FrameIndex(task.0), task);
        }
        assert_eq!(queues.pop_older_than(FrameIndex(4)), None);
        assert_eq!(queues.pop_older_than(FrameIndex(5)), Some((4, 0)));
        assert_eq!(
            [queues.pop(), queues.pop(), queues.pop(), queues.pop()],
            [Some((4, 1)), Some((5, 0)), Some((6, 0)), None]
        );
        assert!(queues.is_empty());
    }
}
