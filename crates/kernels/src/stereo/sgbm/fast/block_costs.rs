//! Block costs of rows from pixel costs, and the path to the right, which goes over them in the same pass.
//!
//! Two neighbouring rows are computed together: their blocks share all rows of pixels except two, and each path waits
//! for its pixel's minimum while the other continues.

use super::along::{Fixed, advance};
use crate::stereo::lanes::Lanes;
use crate::stereo::sgbm::search::Search;

/// `ROWS` rows at once.
pub(super) struct BlockRows<'a> {
    pub search: &'a Search,
    /// Whether pixel costs are bytes.
    pub bytes: bool,
    /// Rows of pixel costs that are in the blocks of all these rows; one as often as it counts.
    pub shared: &'a [*const i16],
    pub rows: &'a mut [BlockRow<'a>],
}

pub(super) struct BlockRow<'a> {
    /// The other row of pixel costs in this row's blocks.
    pub own: *const i16,
    /// Memory for the sums over a block's height of a block's columns: `window_len` values.
    pub window: &'a mut [i16],
    /// Block costs.
    pub cost: &'a mut [i16],
    /// Costs of the path to the right.
    pub path: &'a mut [i16],
}

/// Values of memory for one row's window.
pub(super) fn window_len(search: &Search) -> usize {
    window_columns(search) * search.disparities
}

const fn window_columns(search: &Search) -> usize {
    2 * search.radius + 2
}

/// Makes the block costs and leads the path to the right.
///
/// # Safety
/// The instruction set of `L` must be present; rows of pixel costs are `costs::pixel_len` long.
#[inline(always)]
pub(super) unsafe fn block_costs<L: Lanes, const N: usize>(part: &mut BlockRows<'_>) {
    // SAFETY: as the caller guarantees.
    unsafe {
        if part.bytes {
            of_pixels::<L, N, true>(part);
        } else {
            of_pixels::<L, N, false>(part);
        }
    }
}

/// # Safety
/// As [`block_costs`].
#[inline(always)]
unsafe fn of_pixels<L: Lanes, const N: usize, const BYTES: bool>(part: &mut BlockRows<'_>) {
    let (search, shared) = (part.search, part.shared);
    // SAFETY: as the caller guarantees.
    unsafe {
        match &mut *part.rows {
            [a, b] if N > 0 => along::<L, 2, BYTES, _>(search, shared, [a, b], [[L::splat(0); N]; 2]),
            [a] if N > 0 => along::<L, 1, BYTES, _>(search, shared, [a], [[L::splat(0); N]]),
            rows => {
                for row in rows {
                    let path = vec![L::splat(0); search.disparities / L::LANES];
                    along::<L, 1, BYTES, _>(search, shared, [row], [path]);
                }
            }
        }
    }
}

/// Sums over a block's height, column by column, of `ROWS` rows.
struct Columns<'a, const ROWS: usize> {
    shared: &'a [*const i16],
    own: [*const i16; ROWS],
    /// The last columns, in a ring of `end` values.
    window: [*mut i16; ROWS],
    end: usize,
    /// The number of columns that are made, and the place of the next in the ring.
    made: usize,
    place: usize,
}

impl<const ROWS: usize> Columns<'_, ROWS> {
    /// Makes the columns up to and including `until`.
    ///
    /// # Safety
    /// As [`block_costs`]; the column is searched.
    #[inline(always)]
    unsafe fn make<L: Lanes, const BYTES: bool>(&mut self, n: usize, until: usize) {
        let d = n * L::LANES;
        while self.made <= until {
            for j in 0..n {
                let at = j * L::LANES;
                let from = self.made * d + at;
                // SAFETY: as the caller guarantees.
                unsafe {
                    let mut sum = L::splat(0);
                    for &row in self.shared {
                        sum = L::add(sum, load::<L, BYTES>(row, from));
                    }
                    for (own, window) in self.own.iter().zip(self.window) {
                        L::store(window.add(self.place + at), L::add(sum, load::<L, BYTES>(*own, from)));
                    }
                }
            }
            self.place = if self.place + d == self.end { 0 } else { self.place + d };
            self.made += 1;
        }
    }
}

/// # Safety
/// As [`block_costs`]; the paths hold vectors for all disparities.
#[inline(always)]
unsafe fn along<L: Lanes, const ROWS: usize, const BYTES: bool, P: AsMut<[L::V]>>(
    search: &Search,
    shared: &[*const i16],
    rows: [&mut BlockRow<'_>; ROWS],
    mut paths: [P; ROWS],
) {
    let Search { columns, radius, .. } = *search;
    let n = paths[0].as_mut().len();
    let d = n * L::LANES;
    assert!(search.disparities == d && columns > 0);
    let (mut own, mut window) = ([std::ptr::null(); ROWS], [std::ptr::null_mut(); ROWS]);
    let (mut cost, mut path) = (window, window);
    for (r, row) in rows.into_iter().enumerate() {
        assert!(row.window.len() >= window_len(search));
        assert!(row.cost.len() == columns * d && row.path.len() == columns * d);
        (own[r], window[r]) = (row.own, row.window.as_mut_ptr());
        (cost[r], path[r]) = (row.cost.as_mut_ptr(), row.path.as_mut_ptr());
    }
    let fixed = Fixed::<L>::new(search);
    let mut smallest = [L::splat(0); ROWS];
    let end = window_len(search);
    let last = columns - 1;
    let mut sums = Columns { shared, own, window, end, made: 0, place: 0 };
    // SAFETY: as the caller guarantees; lengths were just checked.
    unsafe {
        sums.make::<L, BYTES>(n, radius.min(last));
        for r in 0..ROWS {
            for j in 0..n {
                let at = j * L::LANES;
                let first = L::load(window[r].add(at));
                // The border column counts `radius + 1` times: once here, and once more with each column added.
                let mut sum = L::add(L::splat(search.p2), first);
                for column in 1..=radius {
                    sum = L::add(sum, L::add(first, L::load(window[r].add(column.min(last) * d + at))));
                }
                L::store(cost[r].add(at), sum);
            }
        }
        // The places in the ring of the columns that enter and leave the block with the next column.
        let (mut enters, mut leaves) = (radius.min(last) * d, 0);
        for x in 0..=last {
            if x > 0 {
                if x + radius <= last {
                    sums.make::<L, BYTES>(n, x + radius);
                    enters = if enters + d == end { 0 } else { enters + d };
                }
                for r in 0..ROWS {
                    for j in 0..n {
                        let at = j * L::LANES;
                        let change = L::sub(L::load(window[r].add(enters + at)), L::load(window[r].add(leaves + at)));
                        L::store(cost[r].add(at), L::add(L::load(cost[r].sub(d).add(at)), change));
                    }
                }
                if x > radius {
                    leaves = if leaves + d == end { 0 } else { leaves + d };
                }
            }
            for r in 0..ROWS {
                let (cost, to) = (cost[r], path[r]);
                smallest[r] = advance::<L, false, false>(paths[r].as_mut(), smallest[r], &fixed, cost, to, to).0;
            }
            cost = cost.map(|cost| cost.add(d));
            path = path.map(|path| path.add(d));
        }
    }
}

/// A vector of pixel costs.
///
/// # Safety
/// As [`block_costs`]; they are within the row.
#[inline(always)]
unsafe fn load<L: Lanes, const BYTES: bool>(row: *const i16, at: usize) -> L::V {
    // SAFETY: as the caller guarantees.
    unsafe { if BYTES { L::load_widened(row.cast::<u8>().add(at)) } else { L::load(row.add(at)) } }
}
