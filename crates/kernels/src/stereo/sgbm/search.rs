//! What the parameters mean on images of one size: the columns searched and the numbers OpenCV really uses.

use super::{Mode, Params};

/// Parameters resolved as OpenCV resolves them, with the searched part of the image.
#[derive(Clone, Debug)]
pub(super) struct Search {
    pub width: usize,
    pub height: usize,
    /// 1 or 3.
    pub channels: usize,
    /// Smallest disparity, px.
    pub min_disparity: i32,
    /// Number of disparities: the length of one pixel's costs.
    pub disparities: usize,
    pub first_column: usize,
    /// Number of columns searched; 0 where the image is too narrow.
    pub columns: usize,
    /// Half the block's side, rounded down.
    pub radius: usize,
    pub p1: i16,
    pub p2: i16,
    /// Left-right check, px, at least 1.
    pub disp12_max_diff: i32,
    pub clip: i32,
    /// Uniqueness margin, per cent.
    pub uniqueness: i32,
    /// Value of invalid pixels.
    pub invalid: i16,
    /// Value of invalid pixels of the right image.
    pub right_invalid: i16,
    pub mode: Mode,
}

impl Search {
    pub(super) fn new(params: &Params, width: usize, height: usize, channels: usize) -> Self {
        let end = params.min_disparity + params.disparities;
        let first_column = end.max(0) as usize;
        let last_column = width as i32 + params.min_disparity.min(0);
        let columns = (last_column - first_column as i32).max(0) as usize;
        let p1 = params.p1_used();
        let p2 = params.p2_used().max(p1 + 1);
        Self {
            width,
            height,
            channels,
            min_disparity: params.min_disparity,
            disparities: params.disparities as usize,
            first_column,
            columns,
            radius: params.block as usize / 2,
            p1: p1 as i16,
            p2: p2 as i16,
            disp12_max_diff: if params.disp12_max_diff > 0 { params.disp12_max_diff } else { 1 },
            clip: params.prefilter_cap.max(15) | 1,
            uniqueness: params.uniqueness,
            invalid: params.invalid(),
            right_invalid: params.right_invalid(),
            mode: params.mode,
        }
    }

    /// The least width OpenCV accepts. `sgbm` and `hh` ask for more than half a block beyond the largest disparity,
    /// `3way` for one searched column; `hh4` takes anything, and if nothing can be searched, all pixels are invalid.
    pub(super) fn least_width(&self) -> i64 {
        let end = i64::from(self.min_disparity) + self.disparities as i64;
        match self.mode {
            Mode::Sgbm | Mode::Hh => end + self.radius as i64 + 1,
            Mode::ThreeWay => end.max(0) + i64::from(-self.min_disparity.min(0)) + 1,
            Mode::Hh4 => 1,
        }
    }

    pub(super) fn row_len(&self) -> usize {
        self.columns * self.disparities
    }

    /// Stripes of rows that are matched independently: source rows, and what of them is kept.
    ///
    /// Only `3way` has several: OpenCV cuts four stripes, each starting early by an overlap so that the downward
    /// direction settles, and assembles the result by rows *counted from the stripe's buffer*: where the overlap of a
    /// small image reaches above row 0, the kept rows are therefore shifted or missing. That is kept.
    pub(super) fn stripes(&self, block: i32) -> Vec<Stripe> {
        let height = self.height;
        if self.mode != Mode::ThreeWay {
            return vec![Stripe { start: 0, end: height, rows: 0..height, first_output: 0 }];
        }
        let size = height.div_ceil(4);
        let overlap = block as usize / 2 + 1 + (0.1 * size as f64).ceil() as usize;
        let mut stripes = Vec::new();
        for n in 0..4 {
            let outputs = (n * size).min(height)..((n + 1) * size).min(height);
            if outputs.is_empty() {
                break;
            }
            let start = (n * size).saturating_sub(overlap).min(height);
            let end = outputs.end;
            let first_kept = if n == 0 { 0 } else { start + overlap };
            let rows = first_kept..(first_kept + outputs.len());
            stripes.push(Stripe { start, end, rows, first_output: outputs.start });
        }
        stripes
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Stripe {
    pub start: usize,
    /// One past the last source row.
    pub end: usize,
    /// Source rows written to the output; those at or past `end` are invalid.
    pub rows: std::ops::Range<usize>,
    /// Output row of the first kept row.
    pub first_output: usize,
}

#[cfg(test)]
mod tests {
    use super::{Search, Stripe};
    use crate::stereo::sgbm::{Mode, Params};

    #[test]
    fn columns_that_have_no_partner_are_not_searched() {
        let search = |min_disparity| Search::new(&Params { min_disparity, ..Params::default() }, 100, 10, 1);
        assert_eq!((search(0).first_column, search(0).columns), (64, 36));
        assert_eq!((search(5).first_column, search(5).columns), (69, 31));
        assert_eq!((search(-8).first_column, search(-8).columns), (56, 36));
        assert_eq!((search(-80).first_column, search(-80).columns), (0, 20));
        assert_eq!(search(40).columns, 0);
    }

    #[test]
    fn three_way_cuts_four_overlapping_stripes() {
        let params = Params { mode: Mode::ThreeWay, ..Params::default() };
        let stripes = Search::new(&params, 100, 100, 1).stripes(5);
        // 25 rows each; overlap 5/2 + 1 + ceil(2.5) = 6
        assert_eq!(stripes[0], Stripe { start: 0, end: 25, rows: 0..25, first_output: 0 });
        assert_eq!(stripes[2], Stripe { start: 44, end: 75, rows: 50..75, first_output: 50 });
        assert_eq!(stripes.len(), 4);
    }
}
