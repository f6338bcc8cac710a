//! Matching costs of the plain implementation: pixel costs, sums along the row, sums over the block.

use super::Mode;
use super::prefilter::Planes;
use super::search::{Search, Stripe};
use super::view::View;

/// Yields the rows of block costs (with P2 added) of one stripe, top to bottom.
pub(super) struct CostRows<'a> {
    search: &'a Search,
    left: &'a View<'a>,
    right: &'a View<'a>,
    start: usize,
    next: usize,
    left_planes: Planes,
    right_planes: Planes,
    pixel: Vec<i16>,
    /// Sums along the row of the last `2 * radius + 2` rows, row `k` at `k` modulo their number.
    sums: Vec<Vec<i16>>,
    cost: Vec<i16>,
}

impl<'a> CostRows<'a> {
    pub(super) fn new(search: &'a Search, left: &'a View<'a>, right: &'a View<'a>, stripe: &Stripe) -> Self {
        let len = search.row_len();
        Self {
            search,
            left,
            right,
            start: stripe.start,
            next: stripe.start,
            left_planes: Planes::default(),
            right_planes: Planes::default(),
            pixel: vec![0; len],
            sums: vec![vec![0; len]; 2 * search.radius + 2],
            cost: vec![search.p2; len],
        }
    }

    pub(super) fn next(&mut self) -> &[i16] {
        let y = self.next;
        self.next += 1;
        let last = self.search.height - 1;
        let radius = self.search.radius;
        if y == self.start {
            for k in y..=y + radius {
                if k <= last {
                    self.sum_row(k, true);
                }
                let times = if k == y { radius as i16 + 1 } else { 1 };
                let sum = &self.sums[k.min(last) % self.sums.len()];
                for (cost, &sum) in self.cost.iter_mut().zip(sum) {
                    *cost = cost.saturating_add(sum.saturating_mul(times));
                }
            }
            return &self.cost;
        }
        let enters = y + radius;
        if enters <= last {
            self.sum_row(enters, false);
        } else if self.search.mode == Mode::Hh4 {
            // OpenCV leaves the costs of the last rows at their initial value in this mode.
            self.cost.fill(self.search.p2);
            return &self.cost;
        }
        let add = &self.sums[enters.min(last) % self.sums.len()];
        let sub = &self.sums[(y - 1).saturating_sub(radius).max(self.start) % self.sums.len()];
        // The order shows only where sums saturate.
        let first = match self.search.mode {
            Mode::ThreeWay => self.cost.len(),
            _ if enters <= last => self.search.disparities,
            _ => 0,
        };
        for (i, ((cost, &add), &sub)) in self.cost.iter_mut().zip(add).zip(sub).enumerate() {
            *cost = if i < first {
                cost.saturating_add(add).saturating_sub(sub)
            } else {
                cost.saturating_sub(sub).saturating_add(add)
            };
        }
        &self.cost
    }

    fn sum_row(&mut self, k: usize, first: bool) {
        self.pixel_costs(k);
        let d = self.search.disparities;
        let radius = self.search.radius;
        let last = self.search.columns - 1;
        let count = self.sums.len();
        let sums = &mut self.sums[k % count];
        let pixel = |x: usize| &self.pixel[x.min(last) * d..][..d];
        for (i, sum) in sums[..d].iter_mut().enumerate() {
            *sum = if self.search.mode == Mode::Hh4 {
                let column = |x: usize| pixel(x.saturating_sub(radius))[i];
                (0..=2 * radius).fold(0, |sum: i16, x| sum.saturating_add(column(x)))
            } else {
                let border = pixel(0)[i].saturating_mul(radius as i16 + 1);
                (1..=radius).fold(border, |sum, x| sum.saturating_add(pixel(x)[i]))
            };
        }
        // The order shows only where sums saturate.
        let adds_first = first || self.search.mode == Mode::ThreeWay;
        for x in 1..=last {
            let add = pixel(x + radius);
            let sub = pixel((x - 1).saturating_sub(radius));
            let (before, now) = sums[(x - 1) * d..][..2 * d].split_at_mut(d);
            for i in 0..d {
                now[i] = if adds_first {
                    before[i].saturating_add(add[i]).saturating_sub(sub[i])
                } else {
                    before[i].saturating_sub(sub[i]).saturating_add(add[i])
                };
            }
        }
    }

    /// Dissimilarity after Birchfield and Tomasi 1998 of every searched pixel of row `k` with every candidate.
    fn pixel_costs(&mut self, k: usize) {
        let Search { width, channels, min_disparity, disparities, first_column, columns, .. } = *self.search;
        self.left_planes.fill(self.search, self.left, k, false);
        self.right_planes.fill(self.search, self.right, k, true);
        self.pixel.fill(0);
        for (index, (left, right)) in self.left_planes.planes().iter().zip(self.right_planes.planes()).enumerate() {
            // Grey differences count a quarter.
            let shift = if index < channels { 0 } else { 2 };
            for x in 0..columns {
                let column = first_column + x;
                let (u, u_low, u_high) = (left.value[column], left.low[column], left.high[column]);
                // The right row is reversed, so that disparities ascend with the index.
                let from = ((width - 1 - column) as i32 + min_disparity) as usize;
                let value = &right.value[from..][..disparities];
                let low = &right.low[from..][..disparities];
                let high = &right.high[from..][..disparities];
                let pixel = &mut self.pixel[x * disparities..][..disparities];
                for (((cost, &v), &v_low), &v_high) in pixel.iter_mut().zip(value).zip(low).zip(high) {
                    let left_in_right = u.saturating_sub(v_high).max(v_low.saturating_sub(u));
                    let right_in_left = v.saturating_sub(u_high).max(u_low.saturating_sub(v));
                    *cost += i16::from(left_in_right.min(right_in_left) >> shift);
                }
            }
        }
    }
}
