//! The scored pixels of a frame by whole metres of their ground truth.

use std::ops::Range;

use super::FARTHEST_M;
use super::sample::is_valid;

/// For each scored pixel its metre.
pub(super) struct Metres {
    /// By pixel, its index in `metres`.
    index: Vec<u16>,
    /// The pixels, sorted by metre.
    pixels: Vec<u32>,
    /// The metres that have pixels, nearest first, each with the places of its pixels in `pixels`. Pixels that are too
    /// far have the last one, [`FARTHEST_M`].
    metres: Vec<(u32, Range<usize>)>,
}

impl Metres {
    pub(super) fn new(ground_truth_m: &[f32]) -> Self {
        let metre = |t: f32| (t as u32).min(FARTHEST_M) as usize;
        let mut counts = vec![0; FARTHEST_M as usize + 1];
        ground_truth_m.iter().for_each(|t| counts[metre(*t)] += 1);
        let (mut metres, mut indices, mut start) = (Vec::new(), vec![0; counts.len()], 0);
        for (metre, count) in counts.into_iter().enumerate().filter(|(_, count)| *count > 0) {
            indices[metre] = metres.len() as u16;
            metres.push((metre as u32, start..start + count));
            start += count;
        }
        let index: Vec<u16> = ground_truth_m.iter().map(|t| indices[metre(*t)]).collect();
        let mut next: Vec<usize> = metres.iter().map(|(_, places)| places.start).collect();
        let mut pixels = vec![0; index.len()];
        for (pixel, index) in (0..).zip(&index) {
            let next = &mut next[usize::from(*index)];
            pixels[*next] = pixel;
            *next += 1;
        }
        Self { index, pixels, metres }
    }

    /// The metres with pixels that are not too far, nearest first, each with its number of pixels.
    pub(super) fn counts(&self) -> impl Iterator<Item = (u32, usize)> {
        self.metres.iter().filter(|(metre, _)| *metre < FARTHEST_M).map(|(metre, places)| (*metre, places.len()))
    }

    /// The metre of each pixel; `None` if it is too far.
    pub(super) fn of_pixels(&self) -> impl Iterator<Item = Option<u32>> {
        self.index.iter().map(|index| Some(self.metres[usize::from(*index)].0).filter(|metre| *metre < FARTHEST_M))
    }

    /// The samples of the pixels that are valid, by metre: all samples, and the metres with their places among them.
    pub(super) fn sorted(&self, samples: &[u32]) -> (Vec<u32>, Vec<(u32, Range<usize>)>) {
        // One more, for a last sample that is not valid.
        let mut sorted = vec![0; self.pixels.len() + 1];
        let mut end = 0;
        let by_metre = self.metres.iter().map(|(metre, places)| {
            let start = end;
            for pixel in &self.pixels[places.clone()] {
                let sample = samples[*pixel as usize];
                // Without a branch: valid pixels have no pattern to predict. The next valid one overwrites the others.
                sorted[end] = sample;
                end += usize::from(is_valid(sample));
            }
            (*metre, start..end)
        });
        let by_metre = by_metre.collect();
        (sorted, by_metre)
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample::sample;
    use super::{FARTHEST_M, Metres};

    const INVALID: u32 = sample(f32::NAN, true);

    #[test]
    fn samples_are_sorted_by_metre_and_keep_their_order_within_one() {
        let metres = Metres::new(&[3.5, 9.0, 3.25, 1e9, 1.0, 4096.0, 3.75]);
        assert_eq!(metres.counts().collect::<Vec<_>>(), [(1, 1), (3, 3), (9, 1)]);
        let of_pixels: Vec<_> = metres.of_pixels().collect();
        assert_eq!(of_pixels, [Some(3), Some(9), Some(3), None, Some(1), None, Some(3)]);
        let (sorted, places) = metres.sorted(&[10, 11, INVALID, 13, 14, 15, 16]);
        let found: Vec<_> = places.into_iter().map(|(metre, places)| (metre, sorted[places].to_vec())).collect();
        assert_eq!(found, [(1, vec![14]), (3, vec![10, 16]), (9, vec![11]), (FARTHEST_M, vec![13, 15])]);
    }

    #[test]
    fn a_last_pixel_without_a_sample_is_nowhere() {
        let (sorted, places) = Metres::new(&[2.0, 2.5]).sorted(&[7, INVALID]);
        assert_eq!(sorted[places[0].1.clone()], [7]);
        assert!(Metres::new(&[]).sorted(&[]).1.is_empty());
    }
}
