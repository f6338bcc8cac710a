//! The path to the left, which completes the sums, and the decision.

use super::along::{Fixed, advance};
use super::row_disparities::{DisparitySlots, RowDisparities};
use crate::stereo::lanes::{COMPARED, Lanes, compare, near_bits};
use crate::stereo::sgbm::Mode;
use crate::stereo::sgbm::choice::Choice;
use crate::stereo::sgbm::maps::ratio;
use crate::stereo::sgbm::search::Search;

pub(super) struct Decide<'a> {
    pub search: &'a Search,
    pub cost: &'a [i16],
    /// Sums of the other directions; over all directions afterwards, where these are kept.
    pub sum: &'a mut [i16],
    /// Whether the sums over all directions are left.
    pub keeps_totals: bool,
    /// Memory for one column's sums: `total_len` values.
    pub total: &'a mut [i16],
    pub disparities: &'a mut RowDisparities,
    pub out: &'a mut [i16],
    /// Where the ambiguity is wanted: its row, whose columns that are not searched are left alone.
    pub ambiguity: Option<&'a mut [f32]>,
}

/// Values of memory for one column's sums.
pub(super) fn total_len(search: &Search) -> usize {
    search.disparities.next_multiple_of(COMPARED)
}

/// Leads the paths to the left, and decides every column, of two rows at once: each pixel waits for
/// its neighbour's minimum, and the other row fills the wait. Only with `MORE` is there ambiguity, and are totals kept:
/// without it, nothing is asked per pixel.
///
/// # Safety
/// The instruction set of `L` must be present.
#[inline(always)]
pub(super) unsafe fn decide<L: Lanes, const N: usize, const MORE: bool>(rows: &mut [Decide<'_>]) {
    // SAFETY: as the caller guarantees.
    unsafe {
        match rows {
            [] => {}
            [a, b] if N > 0 => decide_two::<L, _, MORE>(a, b, [[L::splat(0); N]; 2]),
            rows => {
                for row in rows {
                    decide_one::<L, _, MORE>(row, vec![L::splat(0); row.search.disparities / L::LANES]);
                }
            }
        }
    }
}

/// # Safety
/// As [`decide`]; the paths hold vectors for all disparities.
#[inline(always)]
unsafe fn decide_two<L: Lanes, P: AsMut<[L::V]>, const MORE: bool>(
    a: &mut Decide<'_>,
    b: &mut Decide<'_>,
    [path_a, path_b]: [P; 2],
) {
    // SAFETY: as the caller guarantees; columns are searched columns.
    unsafe {
        let search = a.search;
        let fixed = Fixed::<L>::new(search);
        let (mut row_a, mut row_b) = (Along::<L, P>::new(a, path_a), Along::<L, P>::new(b, path_b));
        for x in (0..search.columns).rev() {
            row_a.left::<MORE>(&fixed, x);
            row_b.left::<MORE>(&fixed, x);
        }
    }
    a.disparities.finish(a.search, a.out);
    b.disparities.finish(b.search, b.out);
}

/// # Safety
/// As [`decide_two`].
#[inline(always)]
unsafe fn decide_one<L: Lanes, P: AsMut<[L::V]>, const MORE: bool>(row: &mut Decide<'_>, path: P) {
    // SAFETY: as the caller guarantees; columns are searched columns.
    unsafe {
        let search = row.search;
        let fixed = Fixed::<L>::new(search);
        let mut along = Along::<L, P>::new(row, path);
        for x in (0..search.columns).rev() {
            along.left::<MORE>(&fixed, x);
        }
    }
    row.disparities.finish(row.search, row.out);
}

struct Along<L: Lanes, P> {
    path: P,
    smallest: L::V,
    cost: *const i16,
    sum: *mut i16,
    total: *mut i16,
    keeps_totals: bool,
    slots: DisparitySlots,
    /// Of the searched columns; null where it is not wanted.
    ambiguity: *mut f32,
}

impl<L: Lanes, P: AsMut<[L::V]>> Along<L, P> {
    #[inline(always)]
    fn new(row: &mut Decide<'_>, mut path: P) -> Self {
        let d = path.as_mut().len() * L::LANES;
        assert!(row.search.disparities == d);
        assert!(row.cost.len() == row.search.columns * d && row.sum.len() == row.cost.len());
        assert!(row.total.len() == total_len(row.search));
        row.total.fill(i16::MAX);
        let columns = row.search.first_column..row.search.first_column + row.search.columns;
        let ambiguity = row.ambiguity.as_deref_mut().map(|row| row[columns].as_mut_ptr());
        Self {
            path,
            smallest: L::splat(0),
            cost: row.cost.as_ptr(),
            sum: row.sum.as_mut_ptr(),
            total: row.total.as_mut_ptr(),
            keeps_totals: row.keeps_totals,
            slots: row.disparities.start(row.search),
            ambiguity: ambiguity.unwrap_or(std::ptr::null_mut()),
        }
    }

    /// One step to the left, to column `x`, which completes its sums: it is decided.
    #[inline(always)]
    unsafe fn left<const MORE: bool>(&mut self, fixed: &Fixed<'_, L>, x: usize) {
        // SAFETY: as the caller guarantees.
        unsafe {
            let path = self.path.as_mut();
            let d = path.len() * L::LANES;
            let (cost, sum) = (self.cost.add(x * d), self.sum.add(x * d));
            let least;
            (self.smallest, least) = advance::<L, true, true>(path, self.smallest, fixed, cost, sum, self.total);
            let padded = std::slice::from_raw_parts(self.total, d.next_multiple_of(COMPARED));
            let best = choose::<L>(fixed.search, least, padded);
            if is_unique::<L>(fixed.search, least, best, padded) {
                self.slots.put(fixed.search, x, best, &padded[..d]);
            } else {
                self.slots.none(x);
            }
            if MORE && !self.ambiguity.is_null() {
                *self.ambiguity.add(x) = ratio(best.cost, second::<L>(best.index, &padded[..d]));
            }
            if MORE && self.keeps_totals {
                sum.copy_from_nonoverlapping(self.total, d);
            }
        }
    }
}

/// The best candidate. `padded` holds the sums, and saturated values up to a multiple of what
/// is compared at once.
///
/// # Safety
/// As [`decide`].
#[inline(always)]
unsafe fn choose<L: Lanes>(search: &Search, least: L::V, padded: &[i16]) -> Choice {
    let sums = &padded[..search.disparities];
    // SAFETY: as the caller guarantees; what is compared lies within the padded sums.
    unsafe {
        let cost = L::first(least);
        if cost == i16::MAX {
            return Choice::best(search, sums);
        }
        let mut index = 0;
        let mut equals = 0;
        // From the end, so that the first pair with an equal cost has the last word.
        for at in (0..padded.len()).step_by(2 * COMPARED).rev() {
            let bits = compare::<L, true>(padded, at, least);
            if search.mode == Mode::ThreeWay {
                equals += bits.count_ones();
            }
            if bits != 0 {
                index = at + bits.trailing_zeros() as usize;
            }
        }
        if equals > 1 { Choice::three_way(sums) } else { Choice { index: index as i32, cost } }
    }
}

/// Whether the best candidate is unique enough.
///
/// # Safety
/// As [`choose`].
#[inline(always)]
unsafe fn is_unique<L: Lanes>(search: &Search, least: L::V, best: Choice, padded: &[i16]) -> bool {
    // SAFETY: as the caller guarantees.
    unsafe {
        if L::first(least) == i16::MAX {
            return !best.is_rivalled(search, &padded[..search.disparities]);
        }
        if search.uniqueness > 0 {
            let Some(limit) = best.rival_limit(search) else { return false };
            let limit = L::splat(limit);
            for at in (0..padded.len()).step_by(2 * COMPARED) {
                // The best candidate and its two neighbours do not count as rivals.
                if compare::<L, false>(padded, at, limit) & !near_bits(best.index - at as i32) != 0 {
                    return false;
                }
            }
        }
        true
    }
}

/// More than any number of disparities.
const MOST: usize = 2048;

/// Values that make others saturate: at `MOST` and at both sides of it.
static NEAR: [i16; 2 * MOST] = {
    let mut near = [0; 2 * MOST];
    let mut at = MOST - 1;
    while at <= MOST + 1 {
        near[at] = i16::MAX;
        at += 1;
    }
    near
};

/// The smallest of the sums that are not next to the best one.
///
/// # Safety
/// As [`decide`]; no sum is negative, and vectors fill them.
#[inline(always)]
unsafe fn second<L: Lanes>(best: i32, sums: &[i16]) -> i16 {
    assert!(sums.len() < MOST && (-1..sums.len() as i32).contains(&best));
    // SAFETY: from `MOST - best` on there are as many values as sums, one less than `MOST` at most.
    unsafe {
        let near = NEAR.as_ptr().offset(MOST as isize - best as isize);
        let mut second = L::splat(i16::MAX);
        for at in (0..sums.len()).step_by(L::LANES) {
            let far = L::add_saturating(L::load(sums.as_ptr().add(at)), L::load(near.add(at)));
            second = L::min(second, far);
        }
        L::first(L::minimum(second))
    }
}
