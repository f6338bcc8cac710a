//! The tridiagonal systems of rows and columns, solved by elimination without pivots.
//!
//! A row of `n` pixels `f` with affinities `w` between neighbours becomes the `u` of
//! `(1 + l w[k-1] + l w[k]) u[k] - l w[k-1] u[k-1] - l w[k] u[k+1] = f[k]`. Rows are solved sixteen at a time, columns
//! in strips, so that vectors hold systems that do not depend on each other. Planes that share the affinities share the
//! elimination.

use depthloom_threads::locked;
use std::sync::Mutex;

use crate::simd::{Level, Pass};
use crate::tiles::{Tiles, each};

use super::{Guide, Params, Region};

/// Rows that are solved together.
const LANES: usize = 16;

pub(super) const TILE_ROWS: usize = LANES;

const STRIP: usize = 64;

/// Pixels that OpenCV's vectors hold. It associates its sums in one way in whole vectors and in another in what is left
/// over; which pixels these are is cut here as it is there.
const VECTOR: usize = 4;

/// Affinities of each pixel of a region to the next one in its row and column, negated; 0 at the end.
#[derive(Debug, Default)]
pub(super) struct Affinities {
    right: Vec<f32>,
    below: Vec<f32>,
}

impl Affinities {
    pub(super) fn fill(&mut self, table: &[f32], guide: &Guide<'_>, region: &Region, tiles: &dyn Tiles) {
        for plane in [&mut self.right, &mut self.below] {
            plane.resize(region.width * region.height, 0.0);
        }
        let rows = TILE_ROWS * region.width;
        let parts = self.right.chunks_mut(rows).zip(self.below.chunks_mut(rows)).collect();
        each(tiles, parts, |tile, (right, below): (&mut [f32], &mut [f32])| {
            let lines = right.chunks_exact_mut(region.width).zip(below.chunks_exact_mut(region.width));
            for (y, (right, below)) in (tile * TILE_ROWS..).zip(lines) {
                match guide.channels {
                    1 => affinities::<1>(table, guide, region, y, right, below),
                    _ => affinities::<3>(table, guide, region, y, right, below),
                }
            }
        });
    }
}

fn affinities<const C: usize>(
    table: &[f32],
    guide: &Guide<'_>,
    region: &Region,
    y: usize,
    right: &mut [f32],
    below: &mut [f32],
) {
    let line = |y: usize| {
        let samples = &guide.samples[((region.y + y) * guide.width + region.x) * C..][..region.width * C];
        samples.as_chunks::<C>().0
    };
    let affinity = |a: &[u8; C], b: &[u8; C]| {
        let squared: u32 = a.iter().zip(b).map(|(&a, &b)| u32::from(a.abs_diff(b)).pow(2)).sum();
        table[squared as usize]
    };
    let here = line(y);
    for (right, pair) in right.iter_mut().zip(here.windows(2)) {
        *right = affinity(&pair[0], &pair[1]);
    }
    right[region.width - 1] = 0.0;
    if y + 1 == region.height {
        below.fill(0.0);
    } else {
        for ((below, here), next) in below.iter_mut().zip(here).zip(line(y + 1)) {
            *below = affinity(here, next);
        }
    }
}

#[derive(Debug, Default)]
pub(super) struct Spare {
    eliminated: Vec<f32>,
    values: Vec<f32>,
}

/// Smooths planes of a region, whose affinities are known, in place.
pub(super) fn smooth<const N: usize>(
    level: Level,
    params: &Params,
    affinities: &Affinities,
    region: &Region,
    mut planes: [&mut [f32]; N],
    spares: &Mutex<Vec<Spare>>,
    tiles: &dyn Tiles,
) {
    let lent = |work: &mut dyn FnMut(&mut Spare)| {
        let lock = || locked(spares);
        let mut spare = lock().pop().unwrap_or_default();
        work(&mut spare);
        lock().push(spare);
    };
    let mut lambda = params.lambda;
    for _ in 0..params.iterations {
        each(tiles, row_tiles(&affinities.right, region, &mut planes), |_, mut tile| {
            lent(&mut |spare| level.run(Rows { tile: &mut tile, width: region.width, lambda, spare }));
        });
        each(tiles, column_tiles(region, &mut planes), |index, mut rows| {
            let (below, first) = (&affinities.below[..], index * STRIP);
            lent(&mut |spare| level.run(Columns { below, first, rows: &mut rows, width: region.width, lambda, spare }));
        });
        lambda *= params.attenuation;
    }
}

/// Up to [`LANES`] rows of affinities and planes.
struct RowTile<'a, const N: usize> {
    right: &'a [f32],
    planes: [&'a mut [f32]; N],
    /// Whether OpenCV has these rows in vectors.
    whole: bool,
}

fn row_tiles<'a, const N: usize>(
    right: &'a [f32],
    region: &Region,
    planes: &'a mut [&mut [f32]; N],
) -> Vec<RowTile<'a, N>> {
    let whole = region.height / VECTOR * VECTOR;
    let mut rest = planes.each_mut().map(|plane| &mut **plane);
    let mut tiles = Vec::new();
    let mut first = 0;
    while first < region.height {
        let end = if first < whole { (first + LANES).min(whole) } else { region.height };
        let [from, len] = [first, end - first].map(|rows| rows * region.width);
        let planes = rest.each_mut().map(|plane| plane.split_off_mut(..len).expect("planes have the region's size"));
        tiles.push(RowTile { right: &right[from..][..len], planes, whole: first < whole });
        first = end;
    }
    tiles
}

struct Rows<'a, 'b, const N: usize> {
    tile: &'a mut RowTile<'b, N>,
    width: usize,
    lambda: f32,
    spare: &'a mut Spare,
}

type Lanes = [f32; LANES];

/// A value of each row at one column; 0 for rows that are not there.
#[inline(always)]
fn column(rows: &[&[f32]; LANES], x: usize) -> Lanes {
    std::array::from_fn(|lane| rows[lane][x])
}

#[inline(always)]
fn lines<'a>(plane: &'a [f32], zeros: &'a [f32], width: usize) -> [&'a [f32]; LANES] {
    std::array::from_fn(|lane| plane.get(lane * width..(lane + 1) * width).unwrap_or(zeros))
}

impl<const N: usize> Pass for Rows<'_, '_, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { tile, width, lambda, spare } = self;
        // OpenCV computes the first column and up to four at the end without vectors.
        let whole = if tile.whole { 1 + width.saturating_sub(VECTOR).div_ceil(VECTOR) * VECTOR } else { 0 };
        let zeros = vec![0.0; width];
        let Spare { eliminated, values } = spare;
        eliminated.resize(width * LANES, 0.0);
        values.resize(width * LANES * N, 0.0);
        let eliminated = &mut eliminated.as_chunks_mut::<LANES>().0[..width];
        let values = &mut values.as_chunks_mut::<LANES>().0.as_chunks_mut::<N>().0[..width];
        {
            let right = lines(tile.right, &zeros, width);
            let planes = tile.planes.each_ref().map(|plane| lines(plane, &zeros, width));
            let (mut before, mut out) = ([0.0; LANES], [0.0; LANES]);
            let mut solved = [[0.0; LANES]; N];
            for x in 0..width {
                let affinity = column(&right, x);
                let mut divisor = [0.0; LANES];
                for lane in 0..LANES {
                    let (last, next) = (before[lane], lambda * affinity[lane]);
                    let carried = out[lane] * last;
                    divisor[lane] =
                        if x < whole { (1.0 - (next + last)) - carried } else { ((1.0 - last) - next) - carried };
                    out[lane] = next / divisor[lane];
                }
                for (plane, solved) in planes.iter().zip(&mut solved) {
                    let value = column(plane, x);
                    for lane in 0..LANES {
                        solved[lane] = (value[lane] - solved[lane] * before[lane]) / divisor[lane];
                    }
                }
                for lane in 0..LANES {
                    before[lane] = lambda * affinity[lane];
                }
                eliminated[x] = out;
                values[x] = solved;
            }
        }
        for x in (0..width.saturating_sub(1)).rev() {
            let (here, after) = values.split_at_mut(x + 1);
            for (here, after) in here[x].iter_mut().zip(&after[0]) {
                for lane in 0..LANES {
                    here[lane] -= eliminated[x][lane] * after[lane];
                }
            }
        }
        for (n, plane) in tile.planes.iter_mut().enumerate() {
            for (lane, row) in plane.chunks_exact_mut(width).enumerate() {
                for (pixel, values) in row.iter_mut().zip(&*values) {
                    *pixel = values[n][lane];
                }
            }
        }
    }
}

/// For each strip of columns, its part of each row of each plane.
fn column_tiles<'a, const N: usize>(region: &Region, planes: &'a mut [&mut [f32]; N]) -> Vec<Vec<[&'a mut [f32]; N]>> {
    let count = region.width.div_ceil(STRIP);
    let mut tiles: Vec<Vec<_>> = (0..count).map(|_| Vec::with_capacity(region.height)).collect();
    let mut rows = planes.each_mut().map(|plane| plane.chunks_exact_mut(region.width));
    for _ in 0..region.height {
        let mut parts =
            rows.each_mut().map(|rows| rows.next().expect("planes have the region's size").chunks_mut(STRIP));
        for tile in &mut tiles {
            tile.push(parts.each_mut().map(|parts| parts.next().expect("as many strips as tiles")));
        }
    }
    tiles
}

struct Columns<'a, 'b, const N: usize> {
    below: &'a [f32],
    first: usize,
    rows: &'a mut [[&'b mut [f32]; N]],
    width: usize,
    lambda: f32,
    spare: &'a mut Spare,
}

impl<const N: usize> Pass for Columns<'_, '_, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { below, first, rows, width, lambda, spare } = self;
        let len = rows[0][0].len();
        let whole = (width / VECTOR * VECTOR).saturating_sub(first).min(len);
        let eliminated = &mut spare.eliminated;
        eliminated.resize(rows.len() * STRIP, 0.0);
        let eliminated = &mut eliminated.as_chunks_mut::<STRIP>().0[..rows.len()];
        let mut before = [0.0; STRIP];
        let mut out = [0.0; STRIP];
        for y in 0..rows.len() {
            let affinity = &below[y * width + first..][..len];
            let mut next = [0.0; STRIP];
            for (next, affinity) in next.iter_mut().zip(affinity) {
                *next = lambda * affinity;
            }
            let mut divisor = [0.0; STRIP];
            for x in 0..STRIP {
                divisor[x] = 1.0 - ((before[x] + next[x]) + out[x] * before[x]);
            }
            for x in whole..len {
                divisor[x] = ((1.0 - before[x]) - next[x]) - out[x] * before[x];
            }
            for x in 0..STRIP {
                out[x] = next[x] / divisor[x];
            }
            eliminated[y] = out;
            let (above, here) = rows.split_at_mut(y);
            for (n, here) in here[0].iter_mut().enumerate() {
                if let Some(above) = above.last() {
                    for (((here, above), divisor), before) in here.iter_mut().zip(&*above[n]).zip(&divisor).zip(&before)
                    {
                        *here = (*here - *above * before) / divisor;
                    }
                } else {
                    for (here, divisor) in here.iter_mut().zip(&divisor) {
                        *here /= divisor;
                    }
                }
            }
            before = next;
        }
        for y in (0..rows.len().saturating_sub(1)).rev() {
            let (here, after) = rows.split_at_mut(y + 1);
            for (here, after) in here[y].iter_mut().zip(&after[0]) {
                for ((here, after), eliminated) in here.iter_mut().zip(&**after).zip(&eliminated[y]) {
                    *here -= eliminated * after;
                }
            }
        }
    }
}
