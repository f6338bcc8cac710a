//! From raw maps to answers: medians, and the left-right check.

use super::choice::NONE;
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

/// One row of answers.
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
        median3_row(left, y, left_median);
        if check.lr_max_diff >= 0 {
            median3_row(right, y, right_median);
        }
        for (x, (out, &answer)) in out.iter_mut().zip(&*left_median).enumerate() {
            *out = check.answer(x, answer, right_median);
        }
    }
}

impl Check {
    /// A match must lie in the right image, and be the other's match as well.
    #[inline(always)]
    fn answer(self, x: usize, answer: u16, right: &[u16]) -> i16 {
        let whole = i32::from(answer >> 4);
        let partner = x as i32 - whole - self.min_disparity;
        if answer == NONE || partner < 0 || partner >= right.len() as i32 {
            return self.invalid;
        }
        if self.lr_max_diff >= 0 {
            let back = right[partner as usize];
            if back == NONE || (i32::from(back) - whole).abs() > self.lr_max_diff {
                return self.invalid;
            }
        }
        (i32::from(answer) + self.min_disparity * 16) as i16
    }
}

/// Row `y` of the 3x3 median; the border is replicated.
#[inline(always)]
fn median3_row(map: &[u16], y: usize, out: &mut [u16]) {
    let width = out.len();
    let last = map.len() / width - 1;
    let [above, here, below] = [y.saturating_sub(1), y, (y + 1).min(last)].map(|y| &map[y * width..][..width]);
    let columns = |x: usize| [above[x], here[x], below[x]];
    for x in [0, width - 1] {
        out[x] = median9([columns(x.saturating_sub(1)), columns(x), columns((x + 1).min(width - 1))]);
    }
    if width > 2 {
        let windows = above.windows(3).zip(here.windows(3)).zip(below.windows(3));
        for (out, ((a, b), c)) in out[1..width - 1].iter_mut().zip(windows) {
            *out = median9([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]]);
        }
    }
}

/// The middle of the largest low, the middle middle and the smallest high of three columns.
#[inline(always)]
fn median9(columns: [[u16; 3]; 3]) -> u16 {
    let [a, b, c] = columns.map(sorted3);
    let low = a[0].max(b[0]).max(c[0]);
    let middle = sorted3([a[1], b[1], c[1]])[1];
    let high = a[2].min(b[2]).min(c[2]);
    sorted3([low, middle, high])[1]
}

#[inline(always)]
fn sorted3([a, b, c]: [u16; 3]) -> [u16; 3] {
    let (low, high) = (a.min(b), a.max(b));
    let (middle, high) = (high.min(c), high.max(c));
    [low.min(middle), low.max(middle), high]
}

#[cfg(test)]
mod tests {
    use super::{Check, NONE};

    #[test]
    fn an_answer_needs_a_partner_that_agrees() {
        let check = Check { min_disparity: 1, lr_max_diff: 1, invalid: 0 };
        let right = [9, 4, NONE, 2];
        assert_eq!(check.answer(5, 3 * 16 + 5, &right), 4 * 16 + 5); // partner 1, 4 against 3
        assert_eq!(check.answer(6, 4 * 16, &right), 5 * 16);
        assert_eq!(check.answer(5, 4 * 16, &right), 0); // partner 0, 9 against 4
        assert_eq!(check.answer(5, 2 * 16, &right), 0); // partner 2 has no answer
        assert_eq!(check.answer(5, 5 * 16, &right), 0); // partner -1
        assert_eq!(check.answer(5, 0, &right), 0); // partner 4
        assert_eq!(check.answer(5, NONE, &right), 0);
        let check = Check { lr_max_diff: -1, ..check };
        assert_eq!(check.answer(5, 4 * 16, &right), 5 * 16);
    }
}
