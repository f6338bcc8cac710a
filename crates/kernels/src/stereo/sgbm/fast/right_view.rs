//! The disparities of the right image's pixels, from the sums of one row: each takes the cheapest candidate of a
//! diagonal.
//!
//! Candidate `k` of searched column `x` is right pixel `x - k`, counted from the one that candidate 0 of column 0 is.
//! The columns are visited from the last to the first. A window holds the cheapest candidates so far of the `d` right
//! pixels that the column can be, in registers; from column to column it moves on by one right pixel, which has then
//! seen all of its candidates.

use crate::stereo::lanes::Lanes;
use crate::stereo::sgbm::search::Search;

pub(super) struct RightRow<'a> {
    pub search: &'a Search,
    /// Sums over all directions.
    pub sums: &'a [i16],
    pub best: &'a mut BestCandidates,
    pub out: &'a mut [i16],
}

/// Of each right pixel of one row that a searched column can be, from pixel `1 - d` on.
#[derive(Debug, Default)]
pub(super) struct BestCandidates {
    /// The searched column of its cheapest candidate.
    column: Vec<i16>,
    index: Vec<i16>,
    /// Costs of the candidate's predecessor, of itself, of its successor: all the same where one is missing.
    before: Vec<i16>,
    here: Vec<i16>,
    after: Vec<i16>,
}

/// # Safety
/// The instruction set of `L` must be present.
#[inline(always)]
pub(super) unsafe fn right_view<L: Lanes, const N: usize>(row: &mut RightRow<'_>) {
    // SAFETY: as the caller guarantees.
    unsafe {
        if N > 0 {
            search_columns::<L, _>(row, [[L::splat(0); N]; 2]);
        } else {
            let n = row.search.disparities / L::LANES;
            search_columns::<L, _>(row, [vec![L::splat(0); n], vec![L::splat(0); n]]);
        }
    }
    row.best.gather(row.search, row.sums);
    row.best.write(row.search, row.out);
}

/// Finds the columns of the cheapest candidates. The two windows hold vectors for all disparities.
///
/// # Safety
/// As [`right_view`].
#[inline(always)]
unsafe fn search_columns<L: Lanes, P: AsMut<[L::V]>>(
    row: &mut RightRow<'_>,
    [mut cost_window, mut column_window]: [P; 2],
) {
    let (cost, column) = (cost_window.as_mut(), column_window.as_mut());
    let n = cost.len();
    let d = n * L::LANES;
    let columns = row.search.columns;
    assert!(row.search.disparities == d && column.len() == n && row.sums.len() == columns * d);
    row.best.column.resize(columns + d - 1, 0);
    let found = row.best.column.as_mut_ptr();
    let nothing = L::splat(i16::MAX);
    cost.fill(nothing);
    // SAFETY: searched columns are inside the sums, and so are their right pixels inside `found`.
    unsafe {
        for x in (0..columns).rev() {
            let sums = row.sums.as_ptr().add(x * d);
            let here = L::splat(x as i16);
            for j in 0..n {
                let (next_cost, next_column) =
                    if j + 1 < n { (cost[j + 1], column[j + 1]) } else { (nothing, nothing) };
                let before = L::above(cost[j], next_cost);
                let new = L::load(sums.add(j * L::LANES));
                // Of equal candidates the later one, which has the smaller disparity.
                column[j] = L::where_less(before, new, L::above(column[j], next_column), here);
                cost[j] = L::min(before, new);
            }
            *found.add(x + d - 1) = L::first(column[0]);
        }
        // Right pixels -1, -2, ... are left of the first column's candidate 0.
        let mut lanes = [0; 32];
        for (j, &columns) in column.iter().enumerate() {
            L::store(lanes.as_mut_ptr(), columns);
            for (lane, &x) in lanes[..L::LANES].iter().enumerate() {
                *found.add(d - 1 - (j * L::LANES + lane)) = x;
            }
        }
    }
}

impl BestCandidates {
    /// The candidates and their costs, from the columns.
    #[inline(always)]
    fn gather(&mut self, search: &Search, sums: &[i16]) {
        let Search { disparities: d, columns, .. } = *search;
        let len = columns + d - 1;
        for values in [&mut self.index, &mut self.before, &mut self.here, &mut self.after] {
            values.resize(len, 0);
        }
        let (index, before) = (&mut self.index[..len], &mut self.before[..len]);
        let (here, after) = (&mut self.here[..len], &mut self.after[..len]);
        for (place, &column) in self.column[..len].iter().enumerate() {
            let x = column as usize;
            let k = x + d - 1 - place;
            let at = x * d + k;
            let is_inside = (x > 0) & (x + 1 < columns) & (k > 0) & (k + 1 < d);
            let apart = if is_inside { d + 1 } else { 0 };
            index[place] = k as i16;
            before[place] = sums[at - apart];
            here[place] = sums[at];
            after[place] = sums[at + apart];
        }
    }

    /// The minimum of the parabola through a candidate and its neighbours, in 1/16 px.
    #[inline(always)]
    fn write(&self, search: &Search, out: &mut [i16]) {
        let len = search.columns + search.disparities - 1;
        // Where candidate 0 of column 0 is, less d - 1.
        let first = (search.first_column as i32 - search.min_disparity) as usize + 1 - search.disparities;
        out[..first].fill(search.right_invalid);
        out[first + len..].fill(search.right_invalid);
        let out = &mut out[first..][..len];
        let (index, before, here, after) =
            (&self.index[..len], &self.before[..len], &self.here[..len], &self.after[..len]);
        for x in 0..len {
            let (before, middle, after) = (i32::from(before[x]), i32::from(here[x]), i32::from(after[x]));
            let curvature = (before + after - 2 * middle).max(1);
            let numerator = (before - after) * 16 + curvature;
            // Exact, as in `RowDisparities::refine`. Three equal costs give 0.
            let step = (numerator as f32 / (curvature * 2) as f32) as i32;
            let disparity = (i32::from(index[x]) + search.min_disparity) * 16 + step;
            // Saturated costs are not candidates.
            out[x] = if here[x] == i16::MAX { search.right_invalid } else { -disparity as i16 };
        }
    }
}
