//! The order of the work: bands of rows, cut into columns for the directions that come from the row before.
//!
//! A band goes through two rounds, and the pieces of a round run in any order on any number of threads:
//!
//! 1. *Columns*. Each tile of columns makes its block costs and aggregates path costs down its rows. A diagonal path
//!    needs the neighbouring column of the row before, so that a tile loses one column at each inner side with every
//!    row: it does a *trapezoid*. The *triangle* that two neighbours lost between them is done by the later of the two.
//! 2. *Rows*: the directions along the row, and the decision; and the row sums of the next band's costs, smaller pieces
//!    that fill what is left of the round.
//!
//! `hh` and `hh4` go over the image twice, and keep costs and sums of the whole image in between; the others hold a
//! band.

use depthloom_threads::locked;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard};

use super::aggregate::{Aggregate, Slots, Source};
use super::costs::{CostRow, Slide, pixel_len};
use super::decide::{Decide, total_len};
use super::kernels::Kernels;
use super::right_view::{BestCandidates, RightRow};
use super::row_disparities::RowDisparities;
use super::shared::{Costs, Shared};
use crate::memory::TooMuch;
use crate::stereo::sgbm::Mode;
use crate::stereo::sgbm::prefilter::Planes;
use crate::stereo::sgbm::search::{Search, Stripe};
use crate::stereo::sgbm::view::View;
use crate::tiles::Tiles;

/// Rows in a band. More are fewer rounds and fewer triangles; fewer are less that leaves the cache.
const BAND: usize = 24;

const PAIR: usize = 2;

/// Columns in a tile, at least twice the rows of a band.
const TILE: usize = 2 * BAND;

#[derive(Debug, Default)]
struct RowScratch {
    left: Planes,
    right: Planes,
    pixel: Costs,
    total: Costs,
    disparities: RowDisparities,
    best: BestCandidates,
}

#[derive(Debug, Default)]
pub(super) struct Memory {
    sums: Costs,
    cost: Costs,
    sum: Costs,
    band: Costs,
    paths: [Costs; 3],
    rows: Vec<Mutex<RowScratch>>,
}

/// The maps of a frame before the median.
#[derive(Clone, Copy)]
pub(super) struct RawMaps<'a> {
    pub disparity: Shared<'a, i16>,
    pub right: Option<Shared<'a, i16>>,
    pub ambiguity: Option<Shared<'a, f32>>,
}

/// One stripe of one frame.
struct Frame<'a> {
    kernels: Kernels,
    search: &'a Search,
    left: &'a View<'a>,
    right: &'a View<'a>,
    stripe: &'a Stripe,
    /// Row sums, row `k` at `k` modulo `sum_rows`.
    sums: Shared<'a, i16>,
    sum_rows: usize,
    /// Block costs: of the whole stripe, or of the last `BAND + 1` rows.
    cost: Shared<'a, i16>,
    /// Sums over the directions of the first of two passes.
    sum: Shared<'a, i16>,
    /// Sums of the band's rows.
    band: Shared<'a, i16>,
    two_passes: bool,
    rows: &'a [Mutex<RowScratch>],
    out: RawMaps<'a>,
}

struct Sweep<'a> {
    upwards: bool,
    /// Whether this sweep completes the sums.
    last: bool,
    slots: &'a [Slots<'a>],
}

/// Matches one stripe; `out` has the maps of the whole frame, of which the rows kept are written.
pub(super) fn compute<'a>(
    kernels: Kernels,
    search: &'a Search,
    stripe: &'a Stripe,
    [left, right]: [&'a View<'a>; 2],
    memory: &'a mut Memory,
    tiles: &dyn Tiles,
    out: RawMaps<'a>,
) -> Result<(), TooMuch> {
    let len = search.row_len();
    let height = stripe.end - stripe.start;
    let two_passes = matches!(search.mode, Mode::Hh | Mode::Hh4);
    let diagonals = matches!(search.mode, Mode::Hh | Mode::Sgbm);
    let volume = if two_passes { height } else { BAND + 1 };
    let sum_rows = BAND + 2 * search.radius + 2;
    let sum_len = if two_passes { volume * len } else { 0 };
    memory.rows.resize_with(2 * BAND, Mutex::default);
    memory.sums.make_room(sum_rows * len)?;
    memory.cost.make_room(volume * len)?;
    memory.sum.make_room(sum_len)?;
    memory.band.make_room(BAND * len)?;
    let frame = Frame {
        kernels,
        search,
        left,
        right,
        stripe,
        sums: memory.sums.at_least(sum_rows * len),
        sum_rows,
        cost: memory.cost.at_least(volume * len),
        sum: memory.sum.at_least(sum_len),
        band: memory.band.at_least(BAND * len),
        two_passes,
        rows: &memory.rows,
        out,
    };
    // A diagonal enters on one side while another leaves on the other, up to a band's rows earlier or later.
    let directions: &[(isize, usize)] = if diagonals { &[(-1, BAND), (0, 0), (1, BAND)] } else { &[(0, 0)] };
    let path_memory: Vec<_> = directions
        .iter()
        .zip(&mut memory.paths)
        .map(|(&(_, spare), costs)| costs.at_least(Slots::len(search, search.columns + spare, kernels.padding)))
        .collect();
    for upwards in [false, true] {
        if upwards && !two_passes {
            break;
        }
        let slots: Vec<_> = directions
            .iter()
            .zip(&path_memory)
            .map(|(&(drift, spare), &memory)| {
                Slots::new(search, memory, search.columns + spare, kernels.padding, drift)
            })
            .collect();
        frame.sweep(&Sweep { upwards, last: upwards || !two_passes, slots: &slots }, tiles);
    }
    Ok(())
}

impl<'a> Frame<'a> {
    fn height(&self) -> usize {
        self.stripe.end - self.stripe.start
    }

    fn sweep(&self, sweep: &Sweep<'_>, tiles: &dyn Tiles) {
        let bands = self.height().div_ceil(BAND);
        let tile_count = (self.search.columns / TILE).max(1);
        // Of each border between two tiles, how many trapezoids beside it have been done.
        let beside: Vec<_> = (1..tile_count).map(|_| AtomicUsize::new(0)).collect();
        let decided = |band: usize| if sweep.last { self.rows_of(band).len().div_ceil(PAIR) } else { 0 };
        // The first round makes the row sums of the first band alone; then two rounds for each band.
        let mut counts = vec![self.summed_for(sweep, 0).len()];
        for band in 0..bands {
            counts.extend([tile_count, decided(band) + self.summed_for(sweep, band + 1).len()]);
        }
        tiles.rounds(&counts, &|round, n| {
            let sum = |band: usize, n: usize| self.sum_row(self.summed_for(sweep, band).start + n, n);
            match (round.checked_sub(1).map(|round| round / 2), round % 2) {
                (None, _) => sum(0, n),
                (Some(band), 1) => self.tile(sweep, band, n, &beside),
                (Some(band), _) if n < decided(band) => {
                    let rows = self.rows_of(band);
                    let first = rows.start + n * PAIR;
                    self.decide(sweep, first..(first + PAIR).min(rows.end));
                }
                (Some(band), _) => sum(band + 1, n - decided(band)),
            }
        });
    }

    /// The rows of a band, in the order of the sweep.
    fn rows_of(&self, band: usize) -> Range<usize> {
        band * BAND..((band + 1) * BAND).min(self.height())
    }

    /// The rows of the image whose row sums a band is the first to need; none where the sweep finds the costs made, and
    /// beyond the last band.
    fn summed_for(&self, sweep: &Sweep<'_>, band: usize) -> Range<usize> {
        let end_of = |bands: usize| {
            let end = if bands == 0 { 0 } else { (bands * BAND).min(self.height()) + self.search.radius };
            (self.stripe.start + end).min(self.search.height)
        };
        if sweep.upwards { 0..0 } else { end_of(band)..end_of(band + 1) }
    }

    /// The trapezoid of a tile, and the triangles at its sides whose other neighbour has been done.
    fn tile(&self, sweep: &Sweep<'_>, band: usize, tile: usize, beside: &[AtomicUsize]) {
        let end = if tile == beside.len() { self.search.columns } else { (tile + 1) * TILE };
        self.trapezoid(sweep, self.rows_of(band), tile * TILE..end);
        if sweep.slots.len() == 1 {
            return;
        }
        for border in [tile.checked_sub(1), Some(tile)].into_iter().flatten() {
            // Both neighbours pass here once per band. The second one sees what the first one wrote.
            if beside.get(border).is_some_and(|passed| passed.fetch_add(1, Ordering::AcqRel) % 2 == 1) {
                self.triangle(sweep, self.rows_of(band), (border + 1) * TILE);
            }
        }
    }

    /// Memory for a piece of work; any piece may use any.
    fn scratch(&self, n: usize) -> MutexGuard<'_, RowScratch> {
        locked(&self.rows[n % self.rows.len()])
    }

    /// Where row `k` of the image keeps its row sums.
    fn sums_at(&self, k: usize) -> usize {
        (k - self.stripe.start) % self.sum_rows * self.search.row_len()
    }

    /// Where row `y` of the stripe keeps its block costs.
    fn cost_at(&self, y: usize) -> usize {
        (if self.two_passes { y } else { y % (BAND + 1) }) * self.search.row_len()
    }

    /// Row `k` of the image: pixel costs, summed along the row. The `n`-th such row of its round.
    fn sum_row(&self, k: usize, n: usize) {
        // Beside those of the rows that are decided in the same round.
        let mut scratch = self.scratch(BAND + n);
        let RowScratch { left, right, pixel, .. } = &mut *scratch;
        let pixel = pixel.at_least(pixel_len(self.search));
        let start = self.sums_at(k);
        // SAFETY: each row of a round writes its own part of the ring, of which nothing is read in this round:
        // trapezoids, which read it, have rounds of their own. The table's maker found the instruction set.
        unsafe {
            let sums = self.sums.write(start..start + self.search.row_len());
            (self.kernels.planes)(left, self.search, self.left, k, false);
            (self.kernels.planes)(right, self.search, self.right, k, true);
            (self.kernels.cost_row)(&mut CostRow {
                search: self.search,
                left: left.planes(),
                right: right.planes(),
                pixel: pixel.write(0..pixel_len(self.search)),
                sums,
            });
        }
    }

    /// One tile of columns through the rows of a band: block costs, and the paths as far as they depend on this tile.
    fn trapezoid(&self, sweep: &Sweep<'_>, band: Range<usize>, columns: Range<usize>) {
        let diagonals = sweep.slots.len() > 1;
        for i in band.clone() {
            let lost = if diagonals { i - band.start } else { 0 };
            let first = if columns.start == 0 { 0 } else { columns.start + lost };
            let last = if columns.end == self.search.columns { columns.end } else { columns.end - lost };
            if sweep.upwards || !self.slides(i) {
                if !sweep.upwards {
                    self.first_costs(i, columns.clone());
                }
                self.aggregate(sweep, i, first..last, false);
            } else {
                self.slide(i, columns.start..first);
                self.slide(i, last..columns.end);
                self.aggregate(sweep, i, first..last, true);
            }
        }
    }

    /// What the tiles on both sides of `column` lost.
    fn triangle(&self, sweep: &Sweep<'_>, band: Range<usize>, column: usize) {
        for i in band.clone() {
            let lost = i - band.start;
            self.aggregate(sweep, i, column - lost..column + lost, false);
        }
    }

    /// The `i`-th row of the sweep.
    fn row_of(&self, sweep: &Sweep<'_>, i: usize) -> usize {
        if sweep.upwards { self.height() - 1 - i } else { i }
    }

    /// Aggregates costs along the paths through some columns of the `i`-th row of the sweep, making their block costs
    /// on the way or not.
    fn aggregate(&self, sweep: &Sweep<'_>, i: usize, columns: Range<usize>, slides: bool) {
        let d = self.search.disparities;
        let len = self.search.row_len();
        let y = self.row_of(sweep, i);
        let first = columns.start * d;
        let band = self.band.at(i % BAND * len + first);
        let part = Aggregate {
            search: self.search,
            slots: sweep.slots,
            i,
            columns,
            cost: self.cost.at(self.cost_at(y) + first),
            source: if sweep.upwards {
                Source::Sums(self.sum.at(y * len + first))
            } else if slides {
                let (enters, leaves) = self.sliding(y);
                Source::Slide([
                    self.cost.at(self.cost_at(y - 1) + first),
                    self.sums.at(enters + first),
                    self.sums.at(leaves + first),
                ])
            } else {
                Source::Costs
            },
            sum: if sweep.last { band } else { self.sum.at(y * len + first) },
        };
        // SAFETY: columns of a row belong to one trapezoid or triangle; so do their slots: a diagonal leaves its tile
        // for the triangle beside it, never for another tile, and triangles come when both tiles are done (see the
        // module's description). Costs of the columns were made by this tile, or by those beside the triangle. The
        // table's maker found the instruction set.
        unsafe { (self.kernels.aggregate)(&part) }
    }

    /// Whether block costs of row `y` of the stripe are made from those of the row before.
    fn slides(&self, y: usize) -> bool {
        // In this mode OpenCV leaves the costs of the last rows at their initial value.
        let forgotten =
            self.search.mode == Mode::Hh4 && self.stripe.start + y + self.search.radius >= self.search.height;
        y > 0 && !forgotten
    }

    /// Where the row sums lie that enter and leave the block with row `y` of the stripe.
    fn sliding(&self, y: usize) -> (usize, usize) {
        let k = self.stripe.start + y;
        let enters = (k + self.search.radius).min(self.search.height - 1);
        let leaves = (k - 1).saturating_sub(self.search.radius).max(self.stripe.start);
        (self.sums_at(enters), self.sums_at(leaves))
    }

    /// Block costs of some columns of row `y` of the stripe, from those of the row before.
    fn slide(&self, y: usize, columns: Range<usize>) {
        let d = self.search.disparities;
        let part = |row: usize| row + columns.start * d..row + columns.end * d;
        let (enters, leaves) = self.sliding(y);
        // SAFETY: only this tile touches these columns of the costs in this round; the sums are read by all and written
        // in other rounds. The table's maker found the instruction set.
        unsafe {
            (self.kernels.slide)(&mut Slide {
                cost: self.cost.write(part(self.cost_at(y))),
                before: self.cost.read(part(self.cost_at(y - 1))),
                enters: self.sums.read(part(enters)),
                leaves: self.sums.read(part(leaves)),
            });
        }
    }

    /// Block costs of some columns of row `y` of the stripe, which has no row before it, or which OpenCV does not
    /// change.
    fn first_costs(&self, y: usize, columns: Range<usize>) {
        let Search { disparities: d, radius, p2, height, .. } = *self.search;
        let part = |row: usize| row + columns.start * d..row + columns.end * d;
        // SAFETY: as in `slide`.
        let cost = unsafe { self.cost.write(part(self.cost_at(y))) };
        cost.fill(p2);
        if y > 0 {
            return;
        }
        for above in 0..=radius {
            let k = (self.stripe.start + above).min(height - 1);
            let times = if above == 0 { radius as i16 + 1 } else { 1 };
            // SAFETY: as in `slide`.
            let sums = unsafe { self.sums.read(part(self.sums_at(k))) };
            for (cost, sum) in cost.iter_mut().zip(sums) {
                *cost += sum * times;
            }
        }
    }

    fn decide(&self, sweep: &Sweep<'_>, rows: Range<usize>) {
        let stripe_rows = &self.stripe.rows;
        let len = self.search.row_len();
        let width = self.search.width;
        let first = rows.start;
        let mut scratch: [_; PAIR] = std::array::from_fn(|n| self.scratch(first % BAND + n));
        let (mut decided, mut seen) = (Vec::with_capacity(PAIR), Vec::with_capacity(PAIR));
        for (i, scratch) in rows.zip(&mut scratch) {
            let y = self.row_of(sweep, i);
            let source = self.stripe.start + y;
            if !stripe_rows.contains(&source) {
                continue;
            }
            let output = (source - stripe_rows.start + self.stripe.first_output) * width;
            let row = output..output + width;
            let RowScratch { total, disparities, best, .. } = &mut **scratch;
            let room = total_len(self.search);
            let total = total.at_least(room);
            // SAFETY: each row of this round has its own scratch, its own sums and its own row of the maps; costs are
            // only read.
            decided.push(unsafe {
                Decide {
                    search: self.search,
                    cost: self.cost.read(self.cost_at(y)..self.cost_at(y) + len),
                    sum: self.band.write(i % BAND * len..(i % BAND + 1) * len),
                    total: total.write(0..room),
                    keeps_totals: self.out.right.is_some(),
                    disparities,
                    out: self.out.disparity.write(row.clone()),
                    ambiguity: self.out.ambiguity.map(|map| map.write(row.clone())),
                }
            });
            seen.push((best, row));
        }
        let has_more = self.out.right.is_some() || self.out.ambiguity.is_some();
        let decide = if has_more { self.kernels.decide_more } else { self.kernels.decide };
        // SAFETY: the table's maker found the instruction set.
        unsafe { decide(&mut decided) }
        let Some(right) = self.out.right else { return };
        for (Decide { sum, .. }, (best, row)) in decided.iter().zip(seen) {
            // SAFETY: as above.
            unsafe {
                let out = right.write(row);
                (self.kernels.right_view)(&mut RightRow { search: self.search, sums: sum, best, out });
            }
        }
    }
}
