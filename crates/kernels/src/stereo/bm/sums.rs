//! Sums of absolute differences over the block, for all candidates of a column at once.
//!
//! A row keeps, for each column and candidate, the sum over the block's height. The next row adds the differences of
//! the entering image row and takes off those of the leaving one; along the row the block's sum gains one column and
//! loses another. The sums are stored by column, candidates side by side: every loop runs along them.

use super::search::Search;

/// What sums are kept in: 16 bits where they fit, as they mostly do, else 32.
pub(super) trait Sum: Copy + Default + Ord + Send {
    const MAX: Self;
    fn new(difference: u8) -> Self;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn wide(self) -> i32;
    /// The largest sum that is at most `limit`; `None` if none is.
    fn at_most(limit: i32) -> Option<Self>;
}

macro_rules! sum {
    ($number:ty) => {
        impl Sum for $number {
            const MAX: Self = Self::MAX;
            #[inline(always)]
            fn new(difference: u8) -> Self {
                difference.into()
            }
            #[inline(always)]
            fn plus(self, other: Self) -> Self {
                self.wrapping_add(other)
            }
            #[inline(always)]
            fn minus(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }
            #[inline(always)]
            fn wide(self) -> i32 {
                self as i32
            }
            #[inline(always)]
            fn at_most(limit: i32) -> Option<Self> {
                (limit >= 0).then(|| Self::try_from(limit).unwrap_or(Self::MAX))
            }
        }
    };
}

sum!(u16);
sum!(u32);

pub(super) fn fit_16_bits(search: &Search) -> bool {
    let block = 2 * search.radius + 1;
    2 * usize::from(search.cap) * block * block <= usize::from(u16::MAX)
}

#[derive(Clone, Copy)]
pub(super) struct Pair<'a> {
    pub left: &'a [u8],
    pub right: &'a [u8],
}

#[derive(Clone, Copy)]
pub(super) struct Column<'a> {
    pub left: u8,
    pub right: &'a [u8],
}

impl<'a> Pair<'a> {
    #[inline(always)]
    pub(super) fn column(&self, search: &Search, column: isize) -> Column<'a> {
        let (left, right) = (search.left(column), search.right(column));
        Column { left: self.left[left], right: &self.right[right..][..search.disparities] }
    }
}

#[inline(always)]
pub(super) fn accumulate<S: Sum>(sums: &mut [S], entering: &Column<'_>) {
    for (sum, &right) in sums.iter_mut().zip(entering.right) {
        *sum = sum.plus(S::new(entering.left.abs_diff(right)));
    }
}

#[inline(always)]
pub(super) fn advance<S: Sum>(sums: &mut [S], entering: &Column<'_>, leaving: &Column<'_>) {
    for ((sum, &enters), &leaves) in sums.iter_mut().zip(entering.right).zip(leaving.right) {
        *sum = sum.plus(S::new(entering.left.abs_diff(enters))).minus(S::new(leaving.left.abs_diff(leaves)));
    }
}

#[inline(always)]
pub(super) fn widen<S: Sum>(block: &mut [S], entering: &[S]) {
    for (block, &entering) in block.iter_mut().zip(entering) {
        *block = block.plus(entering);
    }
}

/// Moves the block one column on; the smallest of its sums.
#[inline(always)]
pub(super) fn shift<S: Sum>(block: &mut [S], entering: &[S], leaving: &[S]) -> S {
    let mut smallest = S::MAX;
    for ((block, &entering), &leaving) in block.iter_mut().zip(entering).zip(leaving) {
        let sum = block.plus(entering).minus(leaving);
        *block = sum;
        smallest = smallest.min(sum);
    }
    smallest
}
