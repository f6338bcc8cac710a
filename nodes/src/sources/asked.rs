//! What was read for a frame's key, kept for whoever reads the frame next.

use depthloom_graphs::plan::FrameIndex;
use depthloom_threads::locked;
use std::collections::VecDeque;
use std::sync::Mutex;

/// More than there are workers between key and read; at most 50 MB of KITTI's files if only keys are requested.
const MOST: usize = 24;

/// Input read for a frame's key, kept until the frame is read.
pub(super) struct Asked<T>(Mutex<VecDeque<(FrameIndex, T)>>);

impl<T> Default for Asked<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T> Asked<T> {
    pub(super) fn keep(&self, position: FrameIndex, read: T) {
        let mut kept = locked(&self.0);
        kept.retain(|(other, _)| *other != position);
        if kept.len() == MOST {
            kept.pop_front();
        }
        kept.push_back((position, read));
    }

    pub(super) fn take(&self, position: FrameIndex) -> Option<T> {
        let mut kept = locked(&self.0);
        let at = kept.iter().position(|(other, _)| *other == position)?;
        kept.remove(at).map(|(_, read)| read)
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::plan::FrameIndex;

    use super::{Asked, MOST};

    #[test]
    fn the_latest_are_kept_each_until_it_is_taken() {
        let asked = Asked::default();
        FrameIndex::all(MOST + 1).for_each(|position| asked.keep(position, "first"));
        let take = |position| asked.take(FrameIndex(position));
        assert_eq!((take(0), take(1), take(1)), (None, Some("first"), None));
        asked.keep(FrameIndex(2), "second");
        assert_eq!((take(2), take(2)), (Some("second"), None));
    }
}
