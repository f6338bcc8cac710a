//! The directions that come from the row before.
//!
//! Each direction keeps one slot a path, updated in place: a path that runs straight down stays in its column's slot, one
//! that runs diagonally stays in the slot of its diagonal. Slots are rings over the diagonals alive at once.
//! A slot holds the `d` costs of the path's last pixel, then 16 values of padding: the first and last are the borders
//! that stand beyond the disparities (of this slot's end and of the next slot's beginning), one in between is the
//! smallest cost plus P2.

use super::lanes::{LANES, Lanes};
use super::shared::Shared;
use crate::sgbm::search::Search;

/// Where a slot keeps its smallest cost plus P2, after its costs.
const DELTA: usize = 8;

/// Values of one slot.
pub(super) fn slot_len(search: &Search) -> usize {
    search.disparities + LANES
}

/// The slots of one direction.
#[derive(Clone, Copy)]
pub(super) struct Slots<'a> {
    /// Memory: one vector of padding, then the slots.
    memory: Shared<'a, i16>,
    /// Number of slots.
    count: usize,
    /// By how many slots a column moves with each row: -1, 0 or 1.
    drift: isize,
}

impl<'a> Slots<'a> {
    /// Values of memory for `count` slots.
    pub fn len(search: &Search, count: usize) -> usize {
        LANES + count * slot_len(search)
    }

    /// Fresh paths: all costs 0.
    pub fn new(search: &Search, memory: Shared<'a, i16>, count: usize, drift: isize) -> Self {
        // SAFETY: nobody else has this memory yet.
        let values = unsafe { memory.write(0..Self::len(search, count)) };
        let (lead, slots) = values.split_at_mut(LANES);
        lead.fill(border(search));
        for slot in slots.chunks_exact_mut(slot_len(search)) {
            reset(search, slot);
        }
        Self { memory, count, drift }
    }

    /// The slot of column `x` in the `i`-th row.
    fn index(&self, x: usize, i: usize) -> usize {
        let shift = (i % self.count) as isize * self.drift;
        (x as isize + shift).rem_euclid(self.count as isize) as usize
    }
}

/// Stands for a cost beyond the disparities: never the smallest, and P1 can be added to it.
pub(super) fn border(search: &Search) -> i16 {
    i16::MAX - search.p1
}

fn reset(search: &Search, slot: &mut [i16]) {
    let (costs, padding) = slot.split_at_mut(search.disparities);
    costs.fill(0);
    padding.fill(border(search));
    padding[DELTA] = search.p2;
}

/// Part of a row through which the paths are led on.
pub(super) struct March<'a> {
    pub search: &'a Search,
    /// The directions: one, or three.
    pub slots: &'a [Slots<'a>],
    /// The row's number in the order in which rows are visited.
    pub i: usize,
    /// Columns.
    pub columns: std::ops::Range<usize>,
    /// Block costs of these columns.
    pub cost: *const i16,
    /// Sums of earlier directions at these columns, or null for none.
    pub sum_before: *const i16,
    /// Where the sums with these directions go.
    pub sum: *mut i16,
}

/// Leads the paths through a part of a row.
///
/// # Safety
/// The instruction set of `L` must be present; the pointers hold the costs of the columns; nobody else uses the sums or
/// the columns' slots.
#[inline(always)]
pub(super) unsafe fn march<L: Lanes, const N: usize>(m: &March<'_>) {
    // SAFETY: as the caller vouches.
    unsafe {
        match *m.slots {
            [down] => march_through::<L, N, 1>(m, [down]),
            [a, b, c] => march_through::<L, N, 3>(m, [a, b, c]),
            _ => unreachable!("one direction or three"),
        }
    }
}

#[inline(always)]
unsafe fn march_through<L: Lanes, const N: usize, const DIRECTIONS: usize>(
    m: &March<'_>,
    slots: [Slots<'_>; DIRECTIONS],
) {
    let search = m.search;
    let n = if N > 0 { N } else { search.disparities / LANES };
    let d = n * LANES;
    let stride = d + LANES;
    if m.columns.is_empty() {
        return;
    }
    for direction in &slots {
        // A diagonal that enters the image here has no history.
        let enters = match direction.drift {
            -1 => 0,
            1 => search.columns - 1,
            _ => continue,
        };
        if m.columns.contains(&enters) {
            let start = LANES + direction.index(enters, m.i) * stride;
            // SAFETY: the slot belongs to this column, hence to this call.
            reset(search, unsafe { direction.memory.write(start..start + stride) });
        }
    }
    let mut index = slots.map(|direction| direction.index(m.columns.start, m.i));
    let base = slots.map(|direction| direction.memory.at(LANES));
    // SAFETY: slots `index < count` lie in the memory with padding before and after; cost and sums as the caller vouches.
    unsafe {
        let p1 = L::splat(search.p1);
        let p2 = L::splat(search.p2);
        let mut cost = m.cost;
        let mut sum = m.sum;
        let mut sum_before = m.sum_before;
        for _ in m.columns.clone() {
            let mut slot = base;
            for k in 0..DIRECTIONS {
                slot[k] = base[k].add(index[k] * stride);
                index[k] += 1;
                if index[k] == slots[k].count {
                    index[k] = 0;
                }
            }
            let mut delta = [L::splat(0); DIRECTIONS];
            let mut below = delta;
            for k in 0..DIRECTIONS {
                delta[k] = L::splat(*slot[k].add(d + DELTA));
                below[k] = L::load(slot[k].sub(1));
            }
            let mut smallest = [L::splat(i16::MAX); DIRECTIONS];
            for j in 0..n {
                let at = j * LANES;
                let c = L::load(cost.add(at));
                let mut total = if sum_before.is_null() { L::splat(0) } else { L::load(sum_before.add(at)) };
                for k in 0..DIRECTIONS {
                    let slot = slot[k].add(at);
                    let near = L::add(L::min(below[k], L::load(slot.add(1))), p1);
                    // The next vector's predecessors, before this vector is overwritten.
                    below[k] = L::load(slot.add(LANES - 1));
                    let best = L::min(L::min(near, L::load(slot)), delta[k]);
                    let new = L::add(L::sub(best, delta[k]), c);
                    L::store(slot, new);
                    smallest[k] = L::min(smallest[k], new);
                    total = L::add_saturating(total, new);
                }
                L::store(sum.add(at), total);
            }
            for k in 0..DIRECTIONS {
                *slot[k].add(d + DELTA) = L::first(L::add(L::minimum(smallest[k]), p2));
            }
            cost = cost.add(d);
            sum = sum.add(d);
            if !sum_before.is_null() {
                sum_before = sum_before.add(d);
            }
        }
    }
}
