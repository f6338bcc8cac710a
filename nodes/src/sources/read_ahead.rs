//! Input that was read for a frame's key, kept until the frame is read.

use depthloom_graphs::plan::FrameIndex;
use depthloom_threads::locked;
use std::collections::VecDeque;
use std::sync::Mutex;

/// More than there are workers between key and read; at most 50 MB of KITTI's files if only keys are requested.
const CAPACITY: usize = 24;

pub(super) struct ReadAhead<T>(Mutex<VecDeque<(FrameIndex, T)>>);

impl<T> Default for ReadAhead<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T> ReadAhead<T> {
    pub(super) fn keep(&self, position: FrameIndex, input: T) {
        let mut inputs = locked(&self.0);
        inputs.retain(|(other, _)| *other != position);
        if inputs.len() == CAPACITY {
            inputs.pop_front();
        }
        inputs.push_back((position, input));
    }

    pub(super) fn take(&self, position: FrameIndex) -> Option<T> {
        let mut inputs = locked(&self.0);
        let at = inputs.iter().position(|(other, _)| *other == position)?;
        inputs.remove(at).map(|(_, input)| input)
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::plan::FrameIndex;

    use super::{CAPACITY, ReadAhead};

    #[test]
    fn the_latest_inputs_are_stored_until_they_are_used() {
        let inputs = ReadAhead::default();
        FrameIndex::all(CAPACITY + 1).for_each(|position| inputs.keep(position, "first"));
        let take = |position| inputs.take(FrameIndex(position));
        assert_eq!((take(0), take(1), take(1)), (None, Some("first"), None));
        inputs.keep(FrameIndex(2), "second");
        assert_eq!((take(2), take(2)), (Some("second"), None));
    }
}
