//! A path along a row: one step to the next pixel.

use super::aggregate::border;
use crate::stereo::lanes::Lanes;
use crate::stereo::sgbm::search::Search;

/// The penalties in vectors.
#[derive(Clone, Copy)]
pub(super) struct Fixed<'a, L: Lanes> {
    pub search: &'a Search,
    p1: L::V,
    p2: L::V,
    border: L::V,
}

impl<'a, L: Lanes> Fixed<'a, L> {
    #[inline(always)]
    pub(super) fn new(search: &'a Search) -> Self {
        Self { search, p1: L::splat(search.p1), p2: L::splat(search.p2), border: L::splat(border(search)) }
    }
}

/// Leads a path on by one pixel, and writes its costs, or with `ADD` their sums with those at `sum`. Returns their
/// minimum, and if `LEAST` that of what was written.
///
/// # Safety
/// The instruction set of `L` must be present; the pointers hold the pixel's block costs and sums, and room for the new
/// sums.
#[inline(always)]
pub(super) unsafe fn advance<L: Lanes, const ADD: bool, const LEAST: bool>(
    path: &mut [L::V],
    smallest: L::V,
    fixed: &Fixed<'_, L>,
    cost: *const i16,
    sum: *const i16,
    to: *mut i16,
) -> (L::V, L::V) {
    let Fixed { p1, p2, border, .. } = *fixed;
    // SAFETY: as the caller guarantees.
    unsafe {
        let n = path.len();
        let delta = L::add(smallest, p2);
        let mut smallest = L::splat(i16::MAX);
        let mut least = smallest;
        let mut before = border;
        for j in 0..n {
            let here = path[j];
            let after = if j + 1 < n { path[j + 1] } else { border };
            let near = L::add(L::min(L::below(before, here), L::above(here, after)), p1);
            let best = L::min(L::min(near, here), delta);
            let mut new = L::add(L::sub(best, delta), L::load(cost.add(j * L::LANES)));
            path[j] = new;
            before = here;
            smallest = L::min(smallest, new);
            if ADD {
                new = L::add_saturating(L::load(sum.add(j * L::LANES)), new);
            }
            L::store(to.add(j * L::LANES), new);
            if LEAST {
                least = L::min(least, new);
            }
        }
        (L::minimum(smallest), if LEAST { L::minimum(least) } else { least })
    }
}
