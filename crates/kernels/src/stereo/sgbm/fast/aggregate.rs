//! The directions that come from the row before.
//!
//! Each direction keeps one slot a path, updated in place: a path that runs straight down stays in its column's slot,
//! one that runs diagonally stays in the slot of its diagonal. Slots are rings over the diagonals alive at once.
//! A slot holds the `d` costs of the path's last pixel, then as much padding as keeps vectors aligned, 16 values or
//! more: the first and last are the borders that stand beyond the disparities (of this slot's end and of the next
//! slot's beginning), one in between is the smallest cost plus P2.

use super::shared::Shared;
use crate::stereo::lanes::Lanes;
use crate::stereo::sgbm::search::Search;

/// Where a slot keeps its smallest cost plus P2, after its costs.
const DELTA: usize = 8;

/// The borders, and what is between them.
pub(super) const LEAST_PADDING: usize = 2 * DELTA;

/// Padding before the first slot: a cache line.
const LEAD: usize = 32;

#[derive(Clone, Copy)]
pub(super) struct Slots<'a> {
    /// Memory: one vector of padding, then the slots.
    memory: Shared<'a, i16>,
    count: usize,
    stride: usize,
    /// By how many slots a column moves with each row: -1, 0 or 1.
    drift: isize,
}

impl<'a> Slots<'a> {
    /// Values of memory for `count` slots, each padded by `padding` values.
    pub(super) fn len(search: &Search, count: usize, padding: usize) -> usize {
        LEAD + count * (search.disparities + padding)
    }

    pub(super) fn new(search: &Search, memory: Shared<'a, i16>, count: usize, padding: usize, drift: isize) -> Self {
        // SAFETY: this memory is not shared yet.
        let values = unsafe { memory.write(0..Self::len(search, count, padding)) };
        let stride = search.disparities + padding;
        let (lead, slots) = values.split_at_mut(LEAD);
        lead.fill(border(search));
        for slot in slots.chunks_exact_mut(stride) {
            slot[search.disparities..].fill(border(search));
            reset(search, slot);
        }
        Self { memory, count, stride, drift }
    }

    /// The slot of column `x` in the `i`-th row.
    fn index(&self, x: usize, i: usize) -> usize {
        let shift = (i % self.count) as isize * self.drift;
        (x as isize + shift).rem_euclid(self.count as isize) as usize
    }

    /// Begins the diagonal that enters the image in the `i`-th row, if it enters in one of these columns: it has no
    /// history.
    fn enter(&self, search: &Search, i: usize, columns: &std::ops::Range<usize>) {
        let x = match self.drift {
            -1 => 0,
            1 => search.columns - 1,
            _ => return,
        };
        if columns.contains(&x) {
            let start = LEAD + self.index(x, i) * self.stride;
            // SAFETY: the slot up to its smallest cost belongs to this column, hence to the worker that aggregates
            // paths through it.
            reset(search, unsafe { self.memory.write(start..start + search.disparities + DELTA + 1) });
        }
    }
}

/// Stands for a cost beyond the disparities: never the smallest, and P1 can be added to it.
pub(super) fn border(search: &Search) -> i16 {
    i16::MAX - search.p1
}

/// Makes the path of a slot fresh. Leaves the borders alone, which neighbours may be reading.
fn reset(search: &Search, slot: &mut [i16]) {
    slot[..search.disparities].fill(0);
    slot[search.disparities + DELTA] = search.p2;
}

pub(super) struct Aggregate<'a> {
    pub search: &'a Search,
    /// The directions: one, or three.
    pub slots: &'a [Slots<'a>],
    /// The row's number in the order in which rows are visited.
    pub i: usize,
    pub columns: std::ops::Range<usize>,
    /// Block costs of the columns.
    pub cost: *const i16,
    /// Sums of earlier directions, to which the costs of these are added.
    pub sum: *mut i16,
}

/// Aggregates costs along the paths through a part of a row.
///
/// # Safety
/// The instruction set of `L` must be present; the pointers hold the costs and sums of the columns; nothing else uses
/// the sums or the columns' slots.
#[inline(always)]
pub(super) unsafe fn aggregate<L: Lanes, const N: usize>(m: &Aggregate<'_>) {
    // SAFETY: as the caller guarantees.
    unsafe {
        match *m.slots {
            [down] => through::<L, N, 1>(m, [down]),
            [a, b, c] => through::<L, N, 3>(m, [a, b, c]),
            _ => unreachable!("one direction or three"),
        }
    }
}

/// # Safety
/// As [`aggregate`].
#[inline(always)]
unsafe fn through<L: Lanes, const N: usize, const DIRECTIONS: usize>(
    m: &Aggregate<'_>,
    slots: [Slots<'_>; DIRECTIONS],
) {
    let search = m.search;
    let n = if N > 0 { N } else { search.disparities / L::LANES };
    let d = n * L::LANES;
    let stride = slots[0].stride;
    if m.columns.is_empty() {
        return;
    }
    // The slot of the column, where the ring ends, and its length.
    let mut slot = [std::ptr::null_mut::<i16>(); DIRECTIONS];
    let mut end = slot;
    let mut around = [0; DIRECTIONS];
    for k in 0..DIRECTIONS {
        slots[k].enter(search, m.i, &m.columns);
        around[k] = slots[k].count * stride;
        slot[k] = slots[k].memory.at(LEAD + slots[k].index(m.columns.start, m.i) * stride);
        end[k] = slots[k].memory.at(LEAD + around[k]);
    }
    let (mut cost, mut sum) = (m.cost, m.sum);
    // SAFETY: slots are inside their memory with padding before and after; the rest as the caller guarantees.
    unsafe {
        let p1 = L::splat(search.p1);
        for _ in m.columns.clone() {
            let mut delta = [L::splat(0); DIRECTIONS];
            let mut below = delta;
            for k in 0..DIRECTIONS {
                delta[k] = L::splat(*slot[k].add(d + DELTA));
                below[k] = L::load(slot[k].sub(1));
            }
            let mut smallest = [L::splat(i16::MAX); DIRECTIONS];
            for j in 0..n {
                let at = j * L::LANES;
                let c = L::load(cost.add(at));
                let mut total = L::load(sum.add(at));
                for k in 0..DIRECTIONS {
                    let slot = slot[k].add(at);
                    let here = L::load(slot);
                    let near = L::add(L::min(below[k], L::load(slot.add(1))), p1);
                    // What the next vector's predecessors come from, before this vector is overwritten.
                    if j + 1 < n {
                        below[k] = L::load(slot.add(L::LANES - 1));
                    }
                    let best = L::min(L::min(near, here), delta[k]);
                    let new = L::add(L::sub(best, delta[k]), c);
                    L::store(slot, new);
                    smallest[k] = L::min(smallest[k], new);
                    total = L::add_saturating(total, new);
                }
                L::store(sum.add(at), total);
            }
            for k in 0..DIRECTIONS {
                *slot[k].add(d + DELTA) = L::first(L::minimum(smallest[k])).wrapping_add(search.p2);
                slot[k] = slot[k].add(stride);
                if slot[k] == end[k] {
                    slot[k] = slot[k].sub(around[k]);
                }
            }
            cost = cost.add(d);
            sum = sum.add(d);
        }
    }
}
