//! A Gaussian blur of maps on a coarse grid, as exact as the mixture needs it.
//!
//! The blur of OpenCV (border reflected, `BORDER_REFLECT_101`) has no detail finer than a few pixels. So it is computed
//! at the nodes of a grid, one for each cell of [`Grid::cell`] x `cell` pixels:
//!
//! 1. Each pixel, also those that the border reflects, is shared linearly between the nodes around it.
//! 2. The nodes are convolved with taps that, after step 1, come closest to the Gaussian ([`taps`]).
//! 3. Pixels interpolate the nodes, with four nodes each way.
//!
//! With cells of a quarter of sigma at most, weights differ by less than 0.2 % of the largest from the Gaussian's.
//!
//! Rows are kept in *phases*: pixel `x` is at `[x % cell][x / cell]`. So neighbours in a loop are neighbours in memory,
//! whichever of a cell's pixels they are, and nothing has to be permuted.

use super::LANES;
use crate::raster::reflect101;
use crate::simd::{Block, BlockPass, Level, run_blocks};

/// Blurred nodes beyond the cells of an image, on either side, which interpolation needs.
pub(super) const GUARD: usize = 2;

/// Maps that are blurred together.
pub(super) const MAPS: usize = 3;

/// Nodes from which a pixel interpolates, each way.
const NEAR: usize = 4;

/// A grid of nodes over an image.
#[derive(Debug, Default)]
pub(super) struct Grid {
    pub cell: usize,
    /// The taps from the centre on; the other half is the mirror image.
    pub half_taps: Vec<f32>,
    pub columns: Axis,
    pub rows: Axis,
    /// Where the pixels beyond the left and right border are, and where those they reflect: indices into phases.
    reflected: Vec<(u32, u32)>,
    /// For each row of the image the rows of nodes that it contributes to, with weights.
    targets: Vec<Vec<(usize, f32)>>,
    phases: Vec<Phase>,
    pub width: usize,
    pub height: usize,
}

/// One direction of the grid.
#[derive(Debug, Default)]
pub(super) struct Axis {
    /// Cells that have a pixel of the image.
    pub cells: usize,
    /// Nodes before the blur.
    pub nodes: usize,
    /// Nodes after it.
    pub blurred: usize,
}

/// Where a pixel is in its cell.
#[derive(Clone, Copy, Debug)]
struct Phase {
    /// The share of the nearest node: of the pixel's cell.
    nearest: f32,
    /// The share of the node on its other side.
    other: f32,
    /// The index of the first of the pixel's [`NEAR`] blurred nodes, for cell 0.
    first: usize,
    /// Whether the other node is that of the cell before, and not that of the cell after.
    before: bool,
    interpolation: [f32; NEAR],
}

impl Phase {
    fn new(pixel: usize, cell: usize) -> Self {
        let from_node = (pixel as f64 - (cell - 1) as f64 / 2.0) / cell as f64;
        let before = from_node < 0.0;
        let t = if before { from_node + 1.0 } else { from_node };
        // Keys (1981), a = -1/2.
        let interpolation = [
            ((2.0 - t) * t - 1.0) * t / 2.0,
            ((3.0 * t - 5.0) * t * t + 2.0) / 2.0,
            ((4.0 - 3.0 * t) * t + 1.0) * t / 2.0,
            (t - 1.0) * t * t / 2.0,
        ];
        Self {
            nearest: (1.0 - from_node.abs()) as f32,
            other: from_node.abs() as f32,
            first: GUARD - 1 - usize::from(before),
            before,
            interpolation: interpolation.map(|weight| weight as f32),
        }
    }
}

const fn rounded_up(count: usize) -> usize {
    count.next_multiple_of(LANES)
}

impl Grid {
    /// The largest cell that is exact enough for a standard deviation, px: 1, 2 or 4.
    pub(super) fn cell_for(sigma: f64) -> usize {
        [4, 2].into_iter().find(|&cell| sigma >= 4.0 * cell as f64).unwrap_or(1)
    }

    pub(super) fn new(width: usize, height: usize, sigma: f64, cell: usize) -> Self {
        let half_taps = taps(sigma, cell);
        let radius = half_taps.len() - 1;
        let axis = |len: usize| {
            let cells = len.div_ceil(cell);
            Axis { cells, nodes: cells + 2 * (GUARD + radius), blurred: cells + 2 * GUARD }
        };
        let mut grid = Self {
            cell,
            half_taps,
            columns: axis(width),
            rows: axis(height),
            reflected: Vec::new(),
            targets: vec![Vec::new(); height],
            phases: (0..cell).map(|pixel| Phase::new(pixel, cell)).collect(),
            width,
            height,
        };
        let (margin, stride) = (grid.margin(), grid.padded_phase());
        let reach = (margin * cell) as isize;
        let past = (grid.columns.cells * cell) as isize + reach;
        for x in (-reach..0).chain(width as isize..past) {
            let source = reflect101(x, width);
            let from = source % cell * stride + margin + source / cell;
            let at = (x + reach) as usize;
            grid.reflected.push(((at % cell * stride + at / cell) as u32, from as u32));
        }
        let past = (grid.rows.cells * cell) as isize + reach;
        for y in -reach..past {
            let targets = &mut grid.targets[reflect101(y, height)];
            // Nodes begin one cell after the margin does.
            let (cell, pixel) = ((y + reach) as usize / cell, (y + reach) as usize % cell);
            let phase = grid.phases[pixel];
            let other = if phase.before { cell.wrapping_sub(1) } else { cell + 1 };
            for (row, weight) in [(cell, phase.nearest), (other, phase.other)] {
                let row = row.wrapping_sub(1);
                if row < grid.rows.nodes && weight > 0.0 {
                    match targets.iter_mut().find(|target| target.0 == row) {
                        Some(target) => target.1 += weight,
                        None => targets.push((row, weight)),
                    }
                }
            }
        }
        grid
    }

    fn radius(&self) -> usize {
        self.half_taps.len() - 1
    }

    /// Cells beyond the image on either side.
    pub(super) fn margin(&self) -> usize {
        self.radius() + GUARD + 1
    }

    /// Samples of a phase of a row, without margins.
    pub(super) fn phase(&self) -> usize {
        rounded_up(self.columns.cells)
    }

    /// Samples of a phase of a row, with margins.
    pub(super) fn padded_phase(&self) -> usize {
        // `splat` reads two samples beyond the last node.
        (self.margin() + self.phase()).max(self.node_row() + LANES)
    }

    /// Samples of a row of nodes of one map.
    pub(super) fn node_row(&self) -> usize {
        rounded_up(self.blurred_row() + 2 * self.radius())
    }

    /// Samples of a row of blurred nodes of one map.
    pub(super) fn blurred_row(&self) -> usize {
        rounded_up(self.columns.blurred)
    }

    /// Samples of a row of interpolated nodes of one map: pixels of the last block read beyond the blurred nodes.
    pub(super) fn line(&self) -> usize {
        self.blurred_row() + LANES
    }

    /// Fills the margins of a padded row with the pixels that the border reflects.
    #[inline(always)]
    pub(super) fn reflect(&self, phases: &mut [f32]) {
        for &(to, from) in &self.reflected {
            phases[to as usize] = phases[from as usize];
        }
    }

    /// Shares a padded row between nodes, along the row.
    #[inline(always)]
    pub(super) fn splat<const CELL: usize>(&self, phases: &[f32], nodes: &mut [f32]) {
        let stride = self.padded_phase();
        for (block, out) in nodes.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            let mut sums = [0.0; LANES];
            for pixel in 0..CELL {
                let phase = self.phases[pixel];
                let at = pixel * stride + block * LANES + 1;
                let nearest = samples(phases, at);
                // A pixel before its node gives the rest to the node before: a node takes it from the cell after.
                let other = samples(phases, if phase.before { at + 1 } else { at - 1 });
                for i in 0..LANES {
                    sums[i] += phase.nearest * nearest[i] + phase.other * other[i];
                }
            }
            *out = sums;
        }
    }

    /// Adds a row of nodes, of all maps, to the rows of nodes around row `y` of the image.
    #[inline(always)]
    pub(super) fn add_row(&self, y: usize, row: &[f32], grid: &mut [f32]) {
        for &(target, weight) in &self.targets[y] {
            let target = &mut grid[target * row.len()..][..row.len()];
            let blocks = target.as_chunks_mut::<LANES>().0.iter_mut().zip(row.as_chunks::<LANES>().0);
            for (sum, nodes) in blocks {
                for i in 0..LANES {
                    sum[i] += weight * nodes[i];
                }
            }
        }
    }

    /// Interpolates the blurred nodes of all maps at row `y` of the image.
    #[inline(always)]
    pub(super) fn interpolate_row(&self, y: usize, blurred: &[f32], lines: &mut [f32]) {
        let (length, line) = (self.blurred_row(), self.line());
        let phase = self.phases[y % self.cell];
        let first = y / self.cell + phase.first;
        let [a, b, c, d] = phase.interpolation;
        for map in 0..MAPS {
            let (at, step) = ((first * MAPS + map) * length, MAPS * length);
            let out = &mut lines[map * line..][..length];
            for (block, out) in out.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                let at = at + block * LANES;
                let (p, q) = (samples(blurred, at), samples(blurred, at + step));
                let (r, s) = (samples(blurred, at + 2 * step), samples(blurred, at + 3 * step));
                for i in 0..LANES {
                    out[i] = (a * p[i] + b * q[i]) + (c * r[i] + d * s[i]);
                }
            }
        }
    }

    /// Interpolates one map at [`LANES`] pixels of a phase, from `cell` on.
    #[inline(always)]
    pub(super) fn interpolate(&self, pixel: usize, cell: usize, line: &[f32], out: &mut [f32; LANES]) {
        let phase = self.phases[pixel];
        let [a, b, c, d] = phase.interpolation;
        let at = cell + phase.first;
        let (p, q) = (samples(line, at), samples(line, at + 1));
        let (r, s) = (samples(line, at + 2), samples(line, at + 3));
        for i in 0..LANES {
            out[i] = (a * p[i] + b * q[i]) + (c * r[i] + d * s[i]);
        }
    }
}

/// Blurs nodes, [`MAPS`] rows of [`Grid::node_row`] samples for each row of nodes, to rows of [`Grid::blurred_row`].
pub(super) fn blur(level: Level, grid: &Grid, nodes: &[f32], down: &mut [f32], blurred: &mut [f32]) {
    run_blocks(level, Blur { grid, nodes, down, blurred });
}

struct Blur<'a> {
    grid: &'a Grid,
    nodes: &'a [f32],
    /// Room for the nodes after the blur along columns.
    down: &'a mut [f32],
    blurred: &'a mut [f32],
}

impl BlockPass for Blur<'_> {
    type Output = ();

    #[inline(always)]
    fn run<B: Block>(self) {
        let Self { grid, nodes, down, blurred } = self;
        let (taps, radius) = (&grid.half_taps[..], grid.radius());
        let (node_row, length) = (grid.node_row(), grid.blurred_row());
        let stride = MAPS * node_row;
        for at in (0..stride).step_by(LANES) {
            for row in 0..grid.rows.blurred {
                let centre = (row + radius) * stride + at;
                let sum = symmetric::<B>(nodes, centre, stride, taps);
                sum.store(down[row * stride + at..].first_chunk_mut().expect("rows are whole blocks"));
            }
        }
        for (down, blurred) in down.chunks_exact(node_row).zip(blurred.chunks_exact_mut(length)) {
            for (block, out) in blurred.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                symmetric::<B>(down, block * LANES + radius, 1, taps).store(out);
            }
        }
    }
}

/// The weighted sum of samples `step` apart, under symmetric taps, from the centre outwards.
#[inline(always)]
fn symmetric<B: Block>(from: &[f32], centre: usize, step: usize, taps: &[f32]) -> B {
    let mut sum = B::load(samples(from, centre)).times(taps[0]);
    for (i, &tap) in taps.iter().enumerate().skip(1) {
        let pair = B::load(samples(from, centre - i * step)).plus(B::load(samples(from, centre + i * step)));
        sum = sum.plus(pair.times(tap));
    }
    sum
}

/// [`LANES`] samples.
#[inline(always)]
pub(super) fn samples<T>(from: &[T], at: usize) -> &[T; LANES] {
    from[at..].first_chunk().expect("rows are padded to whole blocks")
}

/// Permutes a row into phases, [`Grid::phase`] samples each, or any other multiple of [`LANES`].
#[inline(always)]
pub(super) fn to_phases<const CELL: usize>(row: &[f32], phases: &mut [f32]) {
    let stride = phases.len() / CELL;
    let cells = row.as_chunks::<CELL>().0;
    for (block, cells) in cells.as_chunks::<LANES>().0.iter().enumerate() {
        let mut parts = [[0.0; LANES]; CELL];
        for i in 0..LANES {
            for pixel in 0..CELL {
                parts[pixel][i] = cells[i][pixel];
            }
        }
        for (pixel, part) in parts.iter().enumerate() {
            phases[pixel * stride + block * LANES..][..LANES].copy_from_slice(part);
        }
    }
}

/// The inverse of [`to_phases`].
#[inline(always)]
pub(super) fn from_phases<const CELL: usize>(phases: &[f32], row: &mut [f32]) {
    let stride = phases.len() / CELL;
    let cells = row.as_chunks_mut::<CELL>().0;
    for (block, cells) in cells.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        let mut parts = [[0.0; LANES]; CELL];
        for (pixel, part) in parts.iter_mut().enumerate() {
            *part = *samples(phases, pixel * stride + block * LANES);
        }
        for i in 0..LANES {
            for pixel in 0..CELL {
                cells[i][pixel] = parts[pixel][i];
            }
        }
    }
}

/// The taps of the coarse blur, from the centre on; both halves together sum to `1 / cell`.
///
/// After linear sharing between nodes they are, by least squares, closest to the Gaussian at the distances that pixels
/// have from a node. The Gaussian ends at four sigma, as OpenCV's does for 32-bit float images.
fn taps(sigma: f64, cell: usize) -> Vec<f32> {
    let reach = 4.0 * sigma;
    let radius = (reach / cell as f64).ceil() as usize;
    let count = 2 * radius + 1;
    // Distances, in cells, of pixels from the node in the middle.
    let half = if cell.is_multiple_of(2) { 0.5 } else { 0.0 };
    let pixels = ((radius + 1) * cell) as i64;
    // The normal equations of shares and Gaussian have three diagonals.
    let (mut diagonal, mut beside, mut right) = (vec![0.0; count], vec![0.0; count], vec![0.0; count]);
    for pixel in -pixels..pixels {
        let distance = pixel as f64 + half;
        let gaussian = if distance.abs() <= reach + 1e-9 {
            libm::exp(-0.5 * (distance / sigma) * (distance / sigma))
        } else {
            0.0
        };
        let at = distance / cell as f64 + radius as f64;
        let (node, share) = (at.floor(), at - at.floor());
        let node = node as i64;
        let inside = |node: i64| usize::try_from(node).ok().filter(|&node| node < count);
        let (left, beyond) = (inside(node), inside(node + 1));
        if let Some(left) = left {
            diagonal[left] += (1.0 - share) * (1.0 - share);
            right[left] += (1.0 - share) * gaussian;
        }
        if let Some(beyond) = beyond {
            diagonal[beyond] += share * share;
            right[beyond] += share * gaussian;
        }
        if let (Some(left), Some(_)) = (left, beyond) {
            beside[left] += (1.0 - share) * share;
        }
    }
    for i in 1..count {
        let factor = beside[i - 1] / diagonal[i - 1];
        diagonal[i] -= factor * beside[i - 1];
        right[i] -= factor * right[i - 1];
    }
    let mut solution = vec![0.0; count];
    for i in (0..count).rev() {
        let after = if i + 1 < count { beside[i] * solution[i + 1] } else { 0.0 };
        solution[i] = (right[i] - after) / diagonal[i];
    }
    let sum: f64 = solution.iter().sum();
    let scale = 1.0 / (sum * cell as f64);
    (0..=radius).map(|i| ((solution[radius + i] + solution[radius - i]) / 2.0 * scale) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taps_and_shares_together_are_the_gaussian() {
        for (sigma, most) in [(1.0, 1e-6), (5.0, 1e-6), (8.0, 2e-3), (18.0, 2e-3), (40.0, 2e-3)] {
            let cell = Grid::cell_for(sigma);
            let half_taps = taps(sigma, cell);
            let tap = |at: i64| half_taps.get(at.unsigned_abs() as usize).copied().unwrap_or(0.0);
            let total: f32 = (-200..=200).map(tap).sum();
            assert!((total * cell as f32 - 1.0).abs() < 1e-6, "sigma {sigma}: {total}");
            let scale = (-8.0 * sigma) as i64..=(8.0 * sigma) as i64;
            let gaussian = |x: f64| if x.abs() <= 4.0 * sigma { libm::exp(-0.5 * x * x / sigma / sigma) } else { 0.0 };
            let sum: f64 = scale.clone().map(|x| gaussian(x as f64)).sum();
            for x in scale {
                let at = (x as f64 + if cell == 1 { 0.0 } else { 0.5 }) / cell as f64;
                let share = (at - at.floor()) as f32;
                let found = (1.0 - share) * tap(at.floor() as i64) + share * tap(at.floor() as i64 + 1);
                let off = (f64::from(found) - gaussian(at * cell as f64) / sum).abs() * sum;
                assert!(off < most, "sigma {sigma}, {x} px: off by {off} of the largest");
            }
        }
    }

    #[test]
    fn phases_keep_every_sample() {
        let row: Vec<f32> = (0..4 * 128).map(|x| x as f32).collect();
        let (mut phases, mut back) = (vec![0.0; row.len()], vec![0.0; row.len()]);
        to_phases::<4>(&row, &mut phases);
        assert_eq!((phases[0], phases[1], phases[128], phases[511]), (0.0, 4.0, 1.0, 511.0));
        from_phases::<4>(&phases, &mut back);
        assert_eq!(back, row);
    }
}
