//! What matches cost: the number of bits in which two features differ.

use super::features::Feature;

/// The right image's features of one row, last column first: candidates of growing disparity lie side by side.
#[derive(Debug, Default)]
pub(super) struct Candidates<F> {
    reversed: Vec<F>,
    width: usize,
}

impl<F: Feature> Candidates<F> {
    /// Takes a row; there will be `lanes` candidates from `min_disparity` on. Outside of the image, a feature is 0.
    pub(super) fn set(&mut self, right: &[F], min_disparity: i32, lanes: usize) {
        self.width = right.len();
        self.reversed.clear();
        self.reversed.resize(self.width + lanes, F::default());
        let last = self.width as isize - 1 - min_disparity as isize;
        for (index, feature) in self.reversed.iter_mut().enumerate() {
            let column = last - index as isize;
            if let Ok(column) = usize::try_from(column)
                && let Some(&right) = right.get(column)
            {
                *feature = right;
            }
        }
    }

    #[inline(always)]
    pub(super) fn at(&self, x: usize, lanes: usize) -> &[F] {
        &self.reversed[self.width - 1 - x..][..lanes]
    }
}

/// Costs of `left` against each candidate; 255 where `padding` has it.
#[inline(always)]
pub(super) fn hamming<const N: usize, F: Feature>(left: F, candidates: &[F], padding: &[u8], out: &mut [u8]) {
    let chunks = out.as_chunks_mut::<N>().0.iter_mut();
    for ((out, candidates), padding) in chunks.zip(candidates.as_chunks::<N>().0).zip(padding.as_chunks::<N>().0) {
        for ((out, candidate), padding) in out.iter_mut().zip(candidates).zip(padding) {
            *out = left.distance(*candidate) | padding;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Candidates, hamming};

    #[test]
    fn candidates_run_to_the_left_and_end_at_the_border() {
        let mut candidates = Candidates::default();
        candidates.set(&[1_u32, 2, 4, 8], 0, 3);
        assert_eq!(candidates.at(3, 3), [8, 4, 2]);
        assert_eq!(candidates.at(0, 3), [1, 0, 0]);
        candidates.set(&[1_u32, 2, 4, 8], -2, 3);
        assert_eq!(candidates.at(1, 3), [8, 4, 2]);
        assert_eq!(candidates.at(3, 3), [0, 0, 8]);
        candidates.set(&[1_u32, 2, 4, 8], 9, 3);
        assert_eq!(candidates.at(3, 3), [0; 3]);
    }

    #[test]
    fn padding_costs_the_most() {
        let mut out = [0; 4];
        hamming::<4, u32>(0b111, &[0b111, 0b110, 0, 0], &[0, 0, 0, 255], &mut out);
        assert_eq!(out, [0, 1, 3, 255]);
    }
}
