//! Which columns are searched, and what of them is kept.

use std::ops::Range;

use super::Params;
use crate::raster::replicate;

#[derive(Clone, Debug)]
pub(super) struct Search {
    pub width: usize,
    pub height: usize,
    pub min_disparity: i32,
    pub disparities: usize,
    /// Half the block, px.
    pub radius: usize,
    pub cap: u8,
    pub texture_threshold: i32,
    pub uniqueness: i32,
    /// Difference allowed by the left-right check, 1/16 px.
    pub disp12_max_diff: Option<i32>,
    pub invalid: i16,
    pub first_column: usize,
    /// The right column that it is compared with at the largest disparity.
    first_partner: usize,
    /// Searched columns; with a positive smallest disparity the last of them lie beyond the right border.
    pub columns: usize,
}

impl Search {
    /// `None` if no pixel can be valid. `params` must have passed its check.
    pub(super) fn new(params: &Params, width: usize, height: usize) -> Option<Self> {
        let largest = params.min_disparity + params.disparities - 1;
        let (first_column, first_partner) = (largest.max(0) as usize, (-largest).max(0) as usize);
        let columns = (width + 1).checked_sub(first_partner + params.disparities as usize)?;
        let search = Self {
            width,
            height,
            min_disparity: params.min_disparity,
            disparities: params.disparities as usize,
            radius: params.block as usize / 2,
            cap: params.prefilter_cap as u8,
            texture_threshold: params.texture_threshold,
            uniqueness: params.uniqueness,
            disp12_max_diff: (params.disp12_max_diff >= 0).then(|| params.disp12_max_diff.saturating_mul(16)),
            invalid: params.invalid(),
            first_column,
            first_partner,
            columns,
        };
        let possible =
            columns > 0 && first_column < width && first_partner < width && !search.kept_columns().is_empty();
        possible.then_some(search)
    }

    /// Columns that may be valid: those searched, within `getValidDisparityROI`.
    pub(super) fn kept_columns(&self) -> Range<usize> {
        let end = self.width.saturating_sub(self.radius).min(self.first_column + self.columns);
        self.first_column + self.radius..end
    }

    pub(super) fn kept_rows(&self) -> Range<usize> {
        self.radius..self.height - self.radius
    }

    /// The disparity of candidate `index`, px: the right image is read from left to right, disparities fall.
    pub(super) fn disparity(&self, index: usize) -> i32 {
        self.min_disparity + (self.disparities - 1 - index) as i32
    }

    /// The column of the left image, counted from the first searched one; borders repeat.
    #[inline(always)]
    pub(super) fn left(&self, column: isize) -> usize {
        replicate(self.first_column as isize + column, self.width)
    }

    /// Where the candidates of that column start in the right image; at the borders they stop moving all together.
    #[inline(always)]
    pub(super) fn right(&self, column: isize) -> usize {
        replicate(self.first_partner as isize + column, self.width - self.disparities + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::Search;
    use crate::stereo::bm::Params;

    #[test]
    fn columns_without_partner_are_not_searched() {
        let search = |min_disparity, block| Search::new(&Params { min_disparity, block, ..Params::default() }, 100, 50);
        let seen = |min| search(min, 5).map(|s| (s.first_column, s.first_partner, s.columns, s.kept_columns()));
        assert_eq!(seen(0), Some((63, 0, 37, 65..98)));
        assert_eq!(seen(5), Some((68, 0, 37, 70..98)));
        assert_eq!(seen(-70), Some((0, 7, 30, 2..30)));
        assert_eq!(seen(40), None);
        assert!(search(0, 39).is_none(), "no block lies inside both images");
        assert!(search(0, 37).is_some());
        assert!(search(-95, 11).is_none(), "only columns of the left margin are searched");
    }
}
