//! Pairs of frames of two cameras, by time stamp.

use std::collections::VecDeque;
use std::time::Duration;

/// A frame of one camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Captured<T> {
    /// When it was captured, by the clock of both cameras.
    pub at: Duration,
    /// The driver's number, which also counts frames that it lost.
    pub sequence: u32,
    pub item: T,
}

/// How many frames of one camera were lost, from the driver's numbers.
#[derive(Debug, Default)]
pub(super) struct Sequence {
    last: Option<u32>,
}

impl Sequence {
    /// How many frames are missing before this one.
    pub(super) fn gap(&mut self, sequence: u32) -> u64 {
        let step = self.last.map_or(1, |last| sequence.wrapping_sub(last));
        self.last = Some(sequence);
        // A driver that counts from 0 again, or does not count, reports nothing.
        if step == 0 || step > u32::MAX / 2 { 0 } else { u64::from(step - 1) }
    }
}

/// Pairs each frame with the nearest one of the other camera, if it is at most half a period away.
#[derive(Debug)]
pub(super) struct Pairing<T> {
    half_period: Duration,
    /// By camera: frames, each with the number of frames that were lost before it.
    pending: [VecDeque<(u64, Captured<T>)>; 2],
    sequences: [Sequence; 2],
    /// By camera: frames lost or without a partner since the last pair.
    missed: [u64; 2],
}

impl<T> Pairing<T> {
    pub(super) fn new(period: Duration) -> Self {
        Self {
            half_period: period / 2,
            pending: [VecDeque::new(), VecDeque::new()],
            sequences: Default::default(),
            missed: [0; 2],
        }
    }

    /// Adds a frame of a camera: 0 left, 1 right.
    pub(super) fn add(&mut self, camera: usize, frame: Captured<T>) {
        let gap = self.sequences[camera].gap(frame.sequence);
        self.pending[camera].push_back((gap, frame));
    }

    /// The next pair, and how many pairs were missed before it. A moment of which both frames are missing counts once.
    pub(super) fn next(&mut self) -> Option<([Captured<T>; 2], u64)> {
        loop {
            let [left, right] = [self.pending[0].front()?.1.at, self.pending[1].front()?.1.at];
            if left.abs_diff(right) > self.half_period {
                let earlier = usize::from(right < left);
                let (gap, _) = self.pending[earlier].pop_front()?;
                self.missed[earlier] += gap + 1;
                continue;
            }
            let [(left_gap, left), (right_gap, right)] = [self.pending[0].pop_front()?, self.pending[1].pop_front()?];
            let [left_missed, right_missed] = std::mem::take(&mut self.missed);
            return Some(([left, right], (left_missed + left_gap).max(right_missed + right_gap)));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::{Captured, Pairing, Sequence};

    fn frame(ms: u64, sequence: u32) -> Captured<()> {
        Captured { at: Duration::from_millis(ms), sequence, item: () }
    }

    /// The times of all pairs with the missed ones before each.
    fn pairs(left: &[(u64, u32)], right: &[(u64, u32)]) -> Vec<(u64, u64, u64)> {
        let mut pairing = Pairing::new(Duration::from_millis(100));
        for (camera, frames) in [left, right].into_iter().enumerate() {
            frames.iter().for_each(|(ms, sequence)| pairing.add(camera, frame(*ms, *sequence)));
        }
        std::iter::from_fn(|| pairing.next())
            .map(|([left, right], missed)| (left.at.as_millis() as u64, right.at.as_millis() as u64, missed))
            .collect()
    }

    #[test]
    fn frames_at_most_half_a_period_apart_are_pairs() {
        let left = [(0, 0), (100, 1), (200, 2)];
        assert_eq!(pairs(&left, &[(20, 7), (80, 8), (250, 9)]), [(0, 20, 0), (100, 80, 0), (200, 250, 0)]);
        assert_eq!(pairs(&left, &[]), []);
    }

    #[test]
    fn frames_without_a_partner_are_missed() {
        // The right camera starts later, and loses the frame at 300 ms.
        let left = [(0, 0), (100, 1), (200, 2), (300, 3), (400, 4)];
        assert_eq!(pairs(&left, &[(190, 0), (290 + 110, 2)]), [(200, 190, 2), (400, 400, 1)]);
    }

    #[test]
    fn frames_that_drivers_lost_are_missed_once_per_moment() {
        let (left, right) = ([(0, 0), (300, 3)], [(0, 0), (100, 1), (300, 3)]);
        assert_eq!(pairs(&left, &right), [(0, 0, 0), (300, 300, 2)]);
    }

    #[test]
    fn gaps_of_a_sequence_survive_overflow_and_restarts() {
        let mut sequence = Sequence::default();
        let gaps = [u32::MAX - 1, u32::MAX, 0, 3, 3, 0, 1].map(|number| sequence.gap(number));
        assert_eq!(gaps, [0, 0, 0, 2, 0, 0, 0]);
    }

    #[test]
    fn a_pair_is_delivered_as_soon_as_both_frames_are_there() {
        let mut pairing = Pairing::new(Duration::from_millis(100));
        pairing.add(0, frame(0, 0));
        assert!(pairing.next().is_none());
        pairing.add(1, frame(10, 0));
        assert!(pairing.next().is_some() && pairing.next().is_none());
    }
}
