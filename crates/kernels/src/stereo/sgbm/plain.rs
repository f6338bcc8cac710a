//! The plain implementation: every step as OpenCV orders it, one cost at a time, no instruction set assumed.
//!
//! It is the twin that the fast paths are compared with bit for bit, and it alone serves parameters with which 16-bit
//! costs may saturate: OpenCV adds with saturation, so that there the *order* of its additions shows in the result.
//!
//! One thing cannot be rows: where fewer columns are searched than half a block is wide, OpenCV (except in `hh4`) reads
//! behind its buffer of pixel costs. Here the last column is repeated there, as it is everywhere else.

use super::Mode;
use super::choice::{Choice, RowChoice};
use super::maps::Maps;
use super::plain_cost::CostRows;
use super::search::{Search, Stripe};
use super::view::View;
use crate::filter::median::integer::{median3_row, rows_around};

/// Matches two images, up to and including the median; shapes and parameters are checked by the caller.
pub(super) fn compute(search: &Search, block: i32, left: &View<'_>, right: &View<'_>, maps: &mut Maps<'_>) {
    maps.clear(search);
    if search.columns == 0 {
        return;
    }
    for stripe in search.stripes(block) {
        let mut aggregation = Aggregation::new(search, left, right, &stripe);
        match search.mode {
            Mode::Sgbm => aggregation.one_pass(&stripe, maps),
            Mode::ThreeWay => aggregation.three_way(&stripe, maps),
            Mode::Hh | Mode::Hh4 => aggregation.two_passes(&stripe, maps),
        }
    }
    for map in [Some(&mut *maps.disparity), maps.right.as_deref_mut()].into_iter().flatten() {
        let source = map.to_vec();
        for (y, out) in map.chunks_exact_mut(search.width).enumerate() {
            median3_row(rows_around(&source, search.width, y), out);
        }
    }
}

/// The costs `L` of one direction along one row, and their minimum per column; a border column on each side stays 0.
/// Each column's costs lie between two borders that are never the smallest.
struct Paths {
    costs: Vec<i16>,
    minima: Vec<i16>,
}

/// Fresh costs of one column, or of several, of `d` disparities each.
fn fresh(columns: usize, d: usize) -> Vec<i16> {
    let mut costs = vec![0; columns * (d + 2)];
    for column in costs.chunks_exact_mut(d + 2) {
        column[0] = i16::MAX;
        column[d + 1] = i16::MAX;
    }
    costs
}

impl Paths {
    fn new(search: &Search) -> Self {
        Self { costs: fresh(search.columns + 2, search.disparities), minima: vec![0; search.columns + 2] }
    }
}

struct Aggregation<'a> {
    search: &'a Search,
    rows: CostRows<'a>,
    choice: RowChoice,
}

/// `L(p, d)` of one direction from `L(q, .)` of the pixel before, both between borders: formula 13 of Hirschmueller
/// 2005.
/// `cost` already holds P2. Returns the minimum over `d`.
fn step(previous: &[i16], delta: i16, p1: i16, cost: &[i16], out: &mut [i16]) -> i16 {
    let d = cost.len();
    let (below, here, above) = (&previous[..d], &previous[1..=d], &previous[2..d + 2]);
    let mut minimum = i16::MAX;
    for ((((out, below), here), above), cost) in out[1..=d].iter_mut().zip(below).zip(here).zip(above).zip(cost) {
        let near = (*below).min(*above).saturating_add(p1);
        *out = near.min(*here).min(delta).saturating_sub(delta).saturating_add(*cost);
        minimum = minimum.min(*out);
    }
    minimum
}

fn add(sum: &mut [i16], costs: &[i16]) {
    for (s, &c) in sum.iter_mut().zip(costs) {
        *s = s.saturating_add(c);
    }
}

impl<'a> Aggregation<'a> {
    fn new(search: &'a Search, left: &'a View<'a>, right: &'a View<'a>, stripe: &Stripe) -> Self {
        Self { search, rows: CostRows::new(search, left, right, stripe), choice: RowChoice::new(search) }
    }

    /// Minimum plus P2 in 16 bits: wraps, except in `3way`, where it saturates.
    fn delta(&self, minimum: i16) -> i16 {
        match self.search.mode {
            Mode::ThreeWay => minimum.saturating_add(self.search.p2),
            Mode::Sgbm | Mode::Hh | Mode::Hh4 => minimum.wrapping_add(self.search.p2),
        }
    }

    /// One direction along one row: `from` holds the row the paths come from, shifted by `dx` columns.
    fn across(&self, from: &Paths, dx: isize, cost: &[i16], to: &mut Paths, sum: Option<&mut [i16]>) {
        let d = self.search.disparities;
        let slot = d + 2;
        let mut sum = sum;
        for x in 0..self.search.columns {
            let before = (x as isize + 1 + dx) as usize;
            let delta = self.delta(from.minima[before]);
            let out = &mut to.costs[(x + 1) * slot..][..slot];
            to.minima[x + 1] =
                step(&from.costs[before * slot..][..slot], delta, self.search.p1, &cost[x * d..][..d], out);
            if let Some(sum) = sum.as_deref_mut() {
                add(&mut sum[x * d..][..d], &out[1..=d]);
            }
        }
    }

    /// One direction along the row itself, to the right or to the left; `each` sees every column's costs.
    fn along(&self, leftwards: bool, cost: &[i16], mut each: impl FnMut(usize, &[i16])) {
        let d = self.search.disparities;
        let mut previous = fresh(1, d);
        let mut current = fresh(1, d);
        let mut minimum = 0;
        for i in 0..self.search.columns {
            let x = if leftwards { self.search.columns - 1 - i } else { i };
            minimum = step(&previous, self.delta(minimum), self.search.p1, &cost[x * d..][..d], &mut current);
            each(x, &current[1..=d]);
            std::mem::swap(&mut previous, &mut current);
        }
    }

    /// The direction to the left, whose costs complete the sums; every column is then decided.
    fn decide_leftwards(&mut self, cost: &[i16], sum: &mut [i16], out: &mut [i16]) {
        let d = self.search.disparities;
        let mut choice = std::mem::take(&mut self.choice);
        choice.start(self.search, out);
        self.along(true, cost, |x, costs| {
            let sum = &mut sum[x * d..][..d];
            add(sum, costs);
            choice.decide(self.search, x, &Choice::first_smallest(sum), sum, out);
        });
        choice.check(self.search, out);
        self.choice = choice;
    }

    fn one_pass(&mut self, stripe: &Stripe, maps: &mut Maps<'_>) {
        let width = self.search.width;
        let mut before = [-1, 0, 1].map(|dx| (dx, Paths::new(self.search)));
        let mut now = Paths::new(self.search);
        let mut sum = vec![0; self.search.row_len()];
        let d = self.search.disparities;
        for y in stripe.start..stripe.end {
            let cost = self.rows.next().to_vec();
            self.along(false, &cost, |x, costs| sum[x * d..][..d].copy_from_slice(costs));
            for (dx, paths) in &mut before {
                self.across(paths, *dx, &cost, &mut now, Some(&mut sum));
                std::mem::swap(paths, &mut now);
            }
            self.decide_leftwards(&cost, &mut sum, &mut maps.disparity[y * width..][..width]);
            maps.see(self.search, y, &sum);
        }
    }

    fn two_passes(&mut self, stripe: &Stripe, maps: &mut Maps<'_>) {
        let width = self.search.width;
        let len = self.search.row_len();
        let d = self.search.disparities;
        let diagonals = self.search.mode == Mode::Hh;
        let shifts: &[isize] = if diagonals { &[-1, 0, 1] } else { &[0] };
        let mut costs = Vec::with_capacity(len * self.search.height);
        let mut sums = vec![0; len * self.search.height];
        for upwards in [false, true] {
            let mut before: Vec<_> = shifts.iter().map(|&dx| (dx, Paths::new(self.search))).collect();
            let mut now = Paths::new(self.search);
            for i in stripe.start..stripe.end {
                let y = if upwards { self.search.height - 1 - i } else { i };
                if !upwards {
                    costs.extend_from_slice(self.rows.next());
                }
                let cost = &costs[y * len..][..len];
                let sum = &mut sums[y * len..][..len];
                if diagonals {
                    self.along(upwards, cost, |x, costs| add(&mut sum[x * d..][..d], costs));
                }
                for (dx, paths) in &mut before {
                    self.across(paths, *dx, cost, &mut now, Some(sum));
                    std::mem::swap(paths, &mut now);
                }
            }
        }
        for y in 0..self.search.height {
            let cost = &costs[y * len..][..len];
            let sum = &mut sums[y * len..][..len];
            let row = &mut maps.disparity[y * width..][..width];
            if diagonals {
                self.choice.start(self.search, row);
                for x in (0..self.search.columns).rev() {
                    let sum = &sum[x * d..][..d];
                    self.choice.decide(self.search, x, &Choice::first_smallest(sum), sum, row);
                }
                self.choice.check(self.search, row);
            } else {
                self.along(false, cost, |x, costs| add(&mut sum[x * d..][..d], costs));
                self.decide_leftwards(cost, sum, row);
            }
            maps.see(self.search, y, sum);
        }
    }

    fn three_way(&mut self, stripe: &Stripe, maps: &mut Maps<'_>) {
        let width = self.search.width;
        let d = self.search.disparities;
        let mut top = Paths::new(self.search);
        let mut now = Paths::new(self.search);
        let mut left = vec![0; self.search.row_len()];
        let mut row = vec![0; width];
        for y in stripe.start..stripe.end {
            let cost = self.rows.next().to_vec();
            self.across(&top, 0, &cost, &mut now, None);
            std::mem::swap(&mut top, &mut now);
            if y >= stripe.rows.end {
                break;
            }
            self.along(false, &cost, |x, costs| left[x * d..][..d].copy_from_slice(costs));
            let mut choice = std::mem::take(&mut self.choice);
            choice.start(self.search, &mut row);
            self.along(true, &cost, |x, right| {
                // OpenCV adds right and left first, then top.
                let sum = &mut left[x * d..][..d];
                add(sum, right);
                add(sum, &top.costs[(x + 1) * (d + 2) + 1..][..d]);
                choice.decide(self.search, x, &Choice::three_way(sum), sum, &mut row);
            });
            choice.check(self.search, &mut row);
            self.choice = choice;
            if stripe.rows.contains(&y) {
                let output = y - stripe.rows.start + stripe.first_output;
                maps.disparity[output * width..][..width].copy_from_slice(&row);
                maps.see(self.search, output, &left);
            }
        }
    }
}
