//! The queue between the workers of a run and the thread that encodes for viewers. No operation of it waits.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::Thread;

use crossbeam::queue::ArrayQueue;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_graphs::{Frame, Value};

/// The queue holds the values of this many frames, or of more if not all their parts are shown.
const FRAMES: usize = 2;
/// More than the frames in flight of any window, so that two of them do not share a place.
const PLACES: usize = 256;

/// Values of one part of a frame.
pub(crate) struct PartValues {
    pub(crate) run: RunId,
    pub(crate) position: FrameIndex,
    pub(crate) frame: Frame,
    pub(crate) values: Vec<(Slot, Value)>,
}

pub(crate) struct Queue {
    parts: ArrayQueue<PartValues>,
    reader: OnceLock<Thread>,
    dropped_frames: AtomicU64,
    /// The last dropped frames, by position: a frame with several dropped parts counts once.
    last_dropped: Vec<AtomicU64>,
}

impl Queue {
    /// `parts` is the largest number of parts of a frame.
    pub(crate) fn new(parts: usize) -> Self {
        Self {
            parts: ArrayQueue::new(FRAMES * parts.max(1)),
            reader: OnceLock::new(),
            dropped_frames: AtomicU64::new(0),
            last_dropped: (0..PLACES).map(|_| AtomicU64::new(0)).collect(),
        }
    }

    /// Adds values. A full queue drops its oldest ones.
    pub(crate) fn push(&self, values: PartValues) {
        if let Some(oldest) = self.parts.force_push(values) {
            self.count(oldest.run, oldest.position);
        }
        if let Some(reader) = self.reader.get() {
            reader.unpark();
        }
    }

    pub(crate) fn pop(&self) -> Option<PartValues> {
        self.parts.pop()
    }

    /// The thread that is woken when values come.
    pub(crate) fn set_reader(&self, reader: Thread) {
        self.reader.get_or_init(|| reader);
    }

    /// The number of frames of which values were dropped.
    pub(crate) fn dropped_frames(&self) -> u64 {
        self.dropped_frames.load(Ordering::Relaxed)
    }

    fn count(&self, run: RunId, position: FrameIndex) {
        let frame = (((run.0 as u64) << 48) ^ position.0 as u64) + 1;
        if self.last_dropped[position.0 % PLACES].swap(frame, Ordering::Relaxed) != frame {
            self.dropped_frames.fetch_add(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Frame;
    use depthloom_graphs::plan::{FrameIndex, RunId};

    use super::{FRAMES, PartValues, Queue};

    #[test]
    fn a_full_queue_drops_its_oldest_frames_and_counts_each_once() {
        let queue = Queue::new(3);
        for position in 0..10 {
            for _part in 0..3 {
                let frame = Frame::at_10_hz(format!("{position}"), position as u64);
                queue.push(PartValues { run: RunId(1), position: FrameIndex(position), frame, values: Vec::new() });
            }
        }
        assert_eq!(queue.dropped_frames(), 10 - FRAMES as u64);
        let rest: Vec<usize> = std::iter::from_fn(|| queue.pop()).map(|part| part.position.0).collect();
        assert_eq!(rest, (10 - FRAMES..10).flat_map(|position| [position; 3]).collect::<Vec<_>>());
    }
}
