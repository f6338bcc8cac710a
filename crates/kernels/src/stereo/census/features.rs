//! The census transform: a pixel becomes the outcome of comparisons around it.

use super::Census;
use crate::simd::Pass;

/// Columns at the left and right border without a feature (0, as in libSGM).
pub(super) const BORDER_COLUMNS: usize = 4;
/// Rows at the top and bottom border without a feature.
pub(super) const BORDER_ROWS: usize = 3;

const BLOCK: usize = 64;

/// A row's and a column's distance from the window's centre.
type Offset = (isize, isize);

pub(super) trait Feature: Copy + Default + Send + Sync + 'static {
    fn with(self, bit: bool) -> Self;

    fn distance(self, other: Self) -> u8;
}

macro_rules! feature {
    ($word:ty) => {
        impl Feature for $word {
            #[inline(always)]
            fn with(self, bit: bool) -> Self {
                self << 1 | Self::from(bit)
            }

            #[inline(always)]
            fn distance(self, other: Self) -> u8 {
                (self ^ other).count_ones() as u8
            }
        }
    };
}

feature!(u32);
feature!(u64);

/// Which sample must be brighter than which for a bit to be set.
pub(super) fn comparisons(census: Census) -> Vec<[Offset; 2]> {
    let window = (-3..=3).flat_map(|dy| (-4..=4).map(move |dx| (dy, dx)));
    match census {
        // Half of the window: the other half is opposite.
        Census::Symmetric => {
            window.take_while(|&offset| offset != (0, 0)).map(|(dy, dx)| [(dy, dx), (-dy, -dx)]).collect()
        }
        Census::Full => window.filter(|&offset| offset != (0, 0)).map(|offset| [(0, 0), offset]).collect(),
        Census::OffAxis => window.filter(|&(dy, dx)| dy != 0 && dx != 0).map(|offset| [(0, 0), offset]).collect(),
    }
}

/// Features of the image row `y` into `out`.
pub(super) struct FeatureRow<'a, F> {
    pub image: &'a [u8],
    pub width: usize,
    pub y: usize,
    pub comparisons: &'a [[Offset; 2]],
    pub out: &'a mut [F],
}

impl<F: Feature> Pass for FeatureRow<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { image, width, y, comparisons, out } = self;
        out.fill(F::default());
        let height = image.len() / width;
        if y < BORDER_ROWS || y + BORDER_ROWS >= height || width <= 2 * BORDER_COLUMNS {
            return;
        }
        let rows = |offset: Offset, x: usize| {
            let start = (y as isize + offset.0) * width as isize + x as isize + offset.1;
            &image[start as usize..]
        };
        let end = width - BORDER_COLUMNS;
        let mut x = BORDER_COLUMNS;
        while x + BLOCK <= end {
            let mut block = [F::default(); BLOCK];
            for &[brighter, darker] in comparisons {
                let (brighter, darker) = (&rows(brighter, x)[..BLOCK], &rows(darker, x)[..BLOCK]);
                for ((feature, brighter), darker) in block.iter_mut().zip(brighter).zip(darker) {
                    *feature = feature.with(brighter > darker);
                }
            }
            out[x..x + BLOCK].copy_from_slice(&block);
            x += BLOCK;
        }
        for (out, x) in out[x..end].iter_mut().zip(x..) {
            *out = comparisons.iter().fold(F::default(), |feature, &[brighter, darker]| {
                feature.with(rows(brighter, x)[0] > rows(darker, x)[0])
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Feature, FeatureRow, comparisons};
    use crate::simd::Pass;
    use crate::stereo::census::Census;

    #[test]
    fn features_have_their_number_of_bits() {
        for census in [Census::Symmetric, Census::Full, Census::OffAxis] {
            assert_eq!(comparisons(census).len() as i32, census.bits());
        }
    }

    #[test]
    fn a_bright_centre_sets_every_bit_and_is_seen_by_no_pair() {
        let (width, height) = (9, 7);
        let mut image = vec![10; width * height];
        image[3 * width + 4] = 11;
        let feature = |census| {
            let mut out = vec![u64::MAX; width];
            FeatureRow { image: &image, width, y: 3, comparisons: &comparisons(census), out: &mut out }.run();
            assert!(out.iter().enumerate().all(|(x, &feature)| x == 4 || feature == 0));
            out[4]
        };
        assert_eq!(feature(Census::Symmetric), 0);
        assert_eq!(feature(Census::Full), (1 << 62) - 1);
        assert_eq!(feature(Census::OffAxis), (1 << 48) - 1);
    }

    #[test]
    fn distance_counts_differing_bits() {
        assert_eq!(0b1011_u32.distance(0b0010), 2);
        assert_eq!(u64::MAX.distance(0), 64);
    }
}
