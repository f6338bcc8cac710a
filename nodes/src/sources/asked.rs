//! What was read for a frame's key, kept for whoever reads the frame next.

use depthloom_graphs::plan::FrameIndex;
use depthloom_threads::locked;
use std::collections::VecDeque;
use std::sync::Mutex;

/// The most frames that are kept: some more than there are workers that have asked for a key and not yet read, and at worst some
/// 50 MB of KITTI's files where only keys are asked for.
const MOST: usize = 24;

/// What was read for frames' keys, by position; the latest, and each until it is taken.
pub(super) struct Asked<T>(Mutex<VecDeque<(FrameIndex, T)>>);

impl<T> Default for Asked<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T> Asked<T> {
    /// Keeps what was read for a frame's key, in place of what was kept of the frame before.
    pub(super) fn keep(&self, position: FrameIndex, read: T) {
        let mut kept = locked(&self.0);
        kept.retain(|(other, _)| *other != position);
        if kept.len() == MOST {
            kept.pop_front();
        }
        kept.push_back((position, read));
    }

    /// What was read for a frame's key, if it is still kept.
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
