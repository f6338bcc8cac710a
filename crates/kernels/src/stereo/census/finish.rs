//! From raw maps to disparities: medians, and the left-right check.

use super::choice::NONE;
use crate::filter::median::integer::{median3_row, rows_around};
use crate::simd::Pass;

/// The left and the right raw map, 1/16 and whole px above the smallest disparity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Maps<'a> {
    pub left: &'a [u16],
    pub right: &'a [u16],
    pub width: usize,
}

/// What the check asks, and what stands for failure.
#[derive(Clone, Copy, Debug)]
pub(super) struct Check {
    pub min_disparity: i32,
    pub lr_max_diff: i32,
    pub invalid: i16,
}

pub(super) struct FinishRow<'a> {
    pub maps: Maps<'a>,
    pub check: Check,
    pub y: usize,
    pub out: &'a mut [i16],
    /// Two rows of memory.
    pub medians: &'a mut [u16],
}

impl Pass for FinishRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { maps: Maps { left, right, width }, check, y, out, medians } = self;
        let (left_median, right_median) = medians.split_at_mut(width);
        median3_row(rows_around(left, width, y), left_median);
        if check.lr_max_diff >= 0 {
            median3_row(rows_around(right, width, y), right_median);
        }
        for (x, (out, &raw)) in out.iter_mut().zip(&*left_median).enumerate() {
            *out = check.disparity(x, raw, right_median);
        }
    }
}

impl Check {
    /// A match must be inside the right image, and must match back.
    #[inline(always)]
    fn disparity(self, x: usize, raw: u16, right: &[u16]) -> i16 {
        let whole = i32::from(raw >> 4);
        let partner = x as i32 - whole - self.min_disparity;
        if raw == NONE || partner < 0 || partner >= right.len() as i32 {
            return self.invalid;
        }
        if self.lr_max_diff >= 0 {
            let back = right[partner as usize];
            if back == NONE || (i32::from(back) - whole).abs() > self.lr_max_diff {
                return self.invalid;
            }
        }
        (i32::from(raw) + self.min_disparity * 16) as i16
    }
}

#[cfg(test)]
mod tests {
    use super::{Check, NONE};

    #[test]
    fn a_valid_pixel_needs_a_partner_that_agrees() {
        let check = Check { min_disparity: 1, lr_max_diff: 1, invalid: 0 };
        let right = [9, 4, NONE, 2];
        assert_eq!(check.disparity(5, 3 * 16 + 5, &right), 4 * 16 + 5); // partner 1, 4 against 3
        assert_eq!(check.disparity(6, 4 * 16, &right), 5 * 16);
        assert_eq!(check.disparity(5, 4 * 16, &right), 0); // partner 0, 9 against 4
        assert_eq!(check.disparity(5, 2 * 16, &right), 0); // partner 2 is invalid
        assert_eq!(check.disparity(5, 5 * 16, &right), 0); // partner -1
        assert_eq!(check.disparity(5, 0, &right), 0); // partner 4
        assert_eq!(check.disparity(5, NONE, &right), 0);
        let check = Check { lr_max_diff: -1, ..check };
        assert_eq!(check.disparity(5, 4 * 16, &right), 5 * 16);
    }
}
