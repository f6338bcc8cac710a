//! The order of the work: bands of rows, cut into columns for the directions that come from the row before.
//!
//! A band goes through three rounds, and the pieces of a round run in any order on any number of threads:
//!
//! 1. *Block costs*: pairs of rows, from the pixel costs of the rows around them, and the path to the right over them.
//! 2. *Columns*. Each tile of columns aggregates path costs down the rows. A diagonal path needs the neighbouring
//!    column of the row before, so that a tile loses one column at each inner side with every row: it does a
//!    *trapezoid*. The *triangle* that two neighbours lost between them is done by the later of the two.
//! 3. *Decisions*: pairs of rows, the path to the left and the choice; and the pixel costs of the next band, smaller
//!    pieces that fill what is left of the round.
//!
//! A band is as small as the number of threads allows: its costs and sums, the pixel costs around it and the paths
//! then stay in the second-level cache. How rows are cut into bands changes no result, because costs are whole numbers.
//!
//! `hh` and `hh4` go over the image twice, and keep costs and sums of the whole image in between; the others hold a
//! band.

use depthloom_threads::locked;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard};

use super::aggregate::{Aggregate, Slots};
use super::block_costs::{BlockRow, BlockRows, window_len};
use super::costs::{CostRow, in_bytes, pixel_len};
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

const PAIR: usize = 2;

/// Rows in the largest band.
const LARGEST_BAND: usize = 24;

/// Columns in a tile, at least twice the rows of a band.
const TILE: usize = 2 * LARGEST_BAND;

/// Rows in a band: two pairs for each thread.
fn band_rows(threads: usize) -> usize {
    (2 * PAIR * threads).min(LARGEST_BAND)
}

#[derive(Debug, Default)]
struct RowScratch {
    left: Planes,
    right: Planes,
    window: Costs,
    total: Costs,
    disparities: RowDisparities,
    best: BestCandidates,
}

#[derive(Debug, Default)]
pub(super) struct Memory {
    pixel: Costs,
    nothing: Costs,
    cost: Costs,
    sum: Costs,
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
    /// Rows in a band.
    band: usize,
    /// Pixel costs, row `k` at `k` modulo `pixel_rows`.
    pixel: Shared<'a, i16>,
    pixel_rows: usize,
    /// Pixel costs of 0.
    nothing: Shared<'a, i16>,
    /// Block costs: of the whole stripe, or of a band.
    cost: Shared<'a, i16>,
    /// Sums over the directions: of the whole stripe, or of a band.
    sum: Shared<'a, i16>,
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
    let band = band_rows(tiles.width());
    let volume = if two_passes { height } else { band };
    let pixel_rows = band + 2 * search.radius;
    memory.rows.resize_with(2 * band.max(PAIR), Mutex::default);
    memory.pixel.make_room(pixel_rows * pixel_len(search))?;
    memory.nothing.make_room(pixel_len(search))?;
    memory.cost.make_room(volume * len)?;
    memory.sum.make_room(volume * len)?;
    let frame = Frame {
        kernels,
        search,
        left,
        right,
        stripe,
        band,
        pixel: memory.pixel.at_least(pixel_rows * pixel_len(search)),
        pixel_rows,
        nothing: memory.nothing.at_least(pixel_len(search)),
        cost: memory.cost.at_least(volume * len),
        sum: memory.sum.at_least(volume * len),
        two_passes,
        rows: &memory.rows,
        out,
    };
    // A diagonal enters on one side while another leaves on the other, up to a band's rows earlier or later.
    let directions: &[(isize, usize)] = if diagonals { &[(-1, band), (0, 0), (1, band)] } else { &[(0, 0)] };
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
        let bands = self.height().div_ceil(self.band);
        let tile_count = (self.search.columns / TILE).max(1);
        // Of each border between two tiles, how many trapezoids beside it have been done.
        let beside: Vec<_> = (1..tile_count).map(|_| AtomicUsize::new(0)).collect();
        let pairs = |band: usize, wanted: bool| if wanted { self.rows_of(band).len().div_ceil(PAIR) } else { 0 };
        // The first round makes the pixel costs of the first band alone; then three rounds for each band.
        let mut counts = vec![self.pixels_for(sweep, 0).len()];
        for band in 0..bands {
            let (made, decided) = (pairs(band, !sweep.upwards), pairs(band, sweep.last));
            counts.extend([made, tile_count, decided + self.pixels_for(sweep, band + 1).len()]);
        }
        tiles.rounds(&counts, &|round, n| {
            let pixels = |band: usize, n: usize| self.pixel_row(self.pixels_for(sweep, band).start + n, n);
            let pair = |band: usize| {
                let rows = self.rows_of(band);
                let first = rows.start + n * PAIR;
                first..(first + PAIR).min(rows.end)
            };
            let Some(round) = round.checked_sub(1) else { return pixels(0, n) };
            let band = round / 3;
            match round % 3 {
                0 => self.block_costs(pair(band)),
                1 => self.tile(sweep, band, n, &beside),
                _ => match n.checked_sub(pairs(band, sweep.last)) {
                    None => self.decide(sweep, pair(band)),
                    Some(n) => pixels(band + 1, n),
                },
            }
        });
    }

    /// The rows of a band, in the order of the sweep.
    fn rows_of(&self, band: usize) -> Range<usize> {
        band * self.band..((band + 1) * self.band).min(self.height())
    }

    /// The rows of the image whose pixel costs a band is the first to need; none where the sweep finds the costs made,
    /// and beyond the last band.
    fn pixels_for(&self, sweep: &Sweep<'_>, band: usize) -> Range<usize> {
        let end_of = |bands: usize| {
            let end = if bands == 0 { 0 } else { (bands * self.band).min(self.height()) + self.search.radius };
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

    /// Where row `k` of the image keeps its pixel costs.
    fn pixels_at(&self, k: usize) -> usize {
        (k - self.stripe.start) % self.pixel_rows * pixel_len(self.search)
    }

    /// Where row `y` of the stripe keeps its block costs and sums.
    fn cells(&self, y: usize) -> Range<usize> {
        let (len, row) = (self.search.row_len(), if self.two_passes { y } else { y % self.band });
        row * len..(row + 1) * len
    }

    /// Pixel costs of row `k` of the image. The `n`-th such row of its round.
    fn pixel_row(&self, k: usize, n: usize) {
        // Beside those of the rows that are decided in the same round.
        let mut scratch = self.scratch(self.band + n);
        let RowScratch { left, right, .. } = &mut *scratch;
        let start = self.pixels_at(k);
        // SAFETY: each row of a round writes its own part of the ring, of which nothing is read in this round: block
        // costs, whose makers read it, have rounds of their own. The table's maker found the instruction set.
        unsafe {
            let pixel = self.pixel.write(start..start + pixel_len(self.search));
            (self.kernels.planes)(left, self.search, self.left, k, false);
            (self.kernels.planes)(right, self.search, self.right, k, true);
            let (left, right) = (left.planes(), right.planes());
            (self.kernels.cost_row)(&mut CostRow { search: self.search, left, right, pixel });
        }
    }

    /// Block costs of one row of the stripe or two, and the path to the right.
    fn block_costs(&self, rows: Range<usize>) {
        // In this mode OpenCV leaves the costs of the last rows at their initial value.
        let is_left = |y: usize| {
            self.search.mode == Mode::Hh4 && y > 0 && self.stripe.start + y + self.search.radius >= self.search.height
        };
        if rows.len() > 1 && rows.clone().any(is_left) {
            return rows.for_each(|y| self.block_costs(y..y + 1));
        }
        let (start, radius) = (self.stripe.start, self.search.radius);
        let nothing = self.nothing.at(0).cast_const();
        // Row `offset` below the topmost of the first row's block; at the borders the first or last row again.
        let pixels = |offset: usize| {
            let k = (start + rows.start + offset).saturating_sub(radius).clamp(start, self.search.height - 1);
            if is_left(rows.start) { nothing } else { self.pixel.at(self.pixels_at(k)).cast_const() }
        };
        let side = 2 * radius + 1;
        let shared: Vec<_> = (1..side).map(pixels).collect();
        let mut scratch: [_; PAIR] = std::array::from_fn(|n| self.scratch(rows.start % self.band + n));
        let own = [pixels(0), pixels(side)];
        let mut parts: Vec<_> = rows
            .zip(&mut scratch)
            .zip(own)
            .map(|((y, scratch), own)| {
                let room = window_len(self.search);
                let window = scratch.window.at_least(room);
                // SAFETY: each row of this round has its own scratch, costs and sums. Pixel costs are only read.
                unsafe {
                    let (cost, path) = (self.cost.write(self.cells(y)), self.sum.write(self.cells(y)));
                    BlockRow { own, window: window.write(0..room), cost, path }
                }
            })
            .collect();
        let bytes = in_bytes(self.search);
        // SAFETY: the pointers are to rows of pixel costs; the table's maker found the instruction set.
        unsafe {
            (self.kernels.block_costs)(&mut BlockRows {
                search: self.search,
                bytes,
                shared: &shared,
                rows: &mut parts,
            });
        }
    }

    /// One tile of columns through the rows of a band: the paths as far as they depend on this tile.
    fn trapezoid(&self, sweep: &Sweep<'_>, band: Range<usize>, columns: Range<usize>) {
        let diagonals = sweep.slots.len() > 1;
        for i in band.clone() {
            let lost = if diagonals { i - band.start } else { 0 };
            let first = if columns.start == 0 { 0 } else { columns.start + lost };
            let last = if columns.end == self.search.columns { columns.end } else { columns.end - lost };
            self.aggregate(sweep, i, first..last);
        }
    }

    /// What the tiles on both sides of `column` lost.
    fn triangle(&self, sweep: &Sweep<'_>, band: Range<usize>, column: usize) {
        for i in band.clone() {
            let lost = i - band.start;
            self.aggregate(sweep, i, column - lost..column + lost);
        }
    }

    /// The `i`-th row of the sweep.
    fn row_of(&self, sweep: &Sweep<'_>, i: usize) -> usize {
        if sweep.upwards { self.height() - 1 - i } else { i }
    }

    /// Aggregates costs along the paths through some columns of the `i`-th row of the sweep.
    fn aggregate(&self, sweep: &Sweep<'_>, i: usize, columns: Range<usize>) {
        let first = self.cells(self.row_of(sweep, i)).start + columns.start * self.search.disparities;
        let (cost, sum) = (self.cost.at(first), self.sum.at(first));
        let part = Aggregate { search: self.search, slots: sweep.slots, i, columns, cost, sum };
        // SAFETY: columns of a row belong to one trapezoid or triangle; so do their slots: a diagonal leaves its tile
        // for the triangle beside it, never for another tile, and triangles come when both tiles are done (see the
        // module's description). Costs were made in an earlier round. The table's maker found the instruction set.
        unsafe { (self.kernels.aggregate)(&part) }
    }

    fn decide(&self, sweep: &Sweep<'_>, rows: Range<usize>) {
        let stripe_rows = &self.stripe.rows;
        let width = self.search.width;
        let first = rows.start;
        let mut scratch: [_; PAIR] = std::array::from_fn(|n| self.scratch(first % self.band + n));
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
                    cost: self.cost.read(self.cells(y)),
                    sum: self.sum.write(self.cells(y)),
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
