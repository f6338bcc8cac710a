//! Scale and shift as smooth fields over the image.

use depthloom_scores::Line;

use super::{Domain, Maps, metres};
use crate::raster::{check, check_same};
use crate::simd::{Level, Pass};

/// How local an alignment is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Standard deviation of the Gaussian windows, px; above 0.
    pub sigma_px: f64,
    /// Weight of the global line, as a share of the pixels under a whole window; above 0.
    pub prior: f64,
}

/// Cells per standard deviation of a window. At the centres of cells the windows are solved; between them the two
/// coefficients are interpolated.
const CELLS: f64 = 3.0;
/// Where windows end, in standard deviations.
const REACH: f64 = 4.0;

/// Sums of weights, of x, of x^2, of residuals r, and of x r over the pixels of a cell.
type Sums = [f64; 5];

/// Aligns a map by lines that differ smoothly between pixels, metres, capped as by [`apply`](super::apply).
///
/// The line of a pixel has the least sum of `g w (z - scale x - shift)^2` over the pixels valid in both maps, `g`
/// being a Gaussian of the distance, plus `prior` times the window's pixels on the `global` line, with the mean and
/// variance of all `x`. Far from stereo the line is thus the global one. Without a spread of `x`, the result is the
/// global line.
///
/// # Panics
/// If a map or the result has not `width * height` pixels.
pub fn local(
    maps: &Maps<'_>,
    (width, height): (usize, usize),
    global: Line,
    window: Window,
    (domain, cap_m): (Domain, f64),
    out: &mut [f32],
) {
    local_at(Level::best(), maps, (width, height), global, window, (domain, cap_m), out);
}

pub(super) fn local_at(
    level: Level,
    maps: &Maps<'_>,
    (width, height): (usize, usize),
    global: Line,
    window: Window,
    (domain, cap_m): (Domain, f64),
    out: &mut [f32],
) {
    maps.check();
    check("monocular map", maps.mono.len(), width, height, 1);
    check_same("aligned map", out.len(), maps.mono.len());
    let Some((x_mean, variance)) = moments(maps).filter(|(_, variance)| *variance > 0.0) else {
        return super::apply_at(level, maps.mono, global, domain, cap_m, out);
    };
    let cell = (window.sigma_px / CELLS).ceil().max(1.0) as usize;
    let size = (width.div_ceil(cell), height.div_ceil(cell));
    let mut sums = vec![[0.0; 5]; size.0 * size.1];
    for row in 0..height {
        let cells = &mut sums[row / cell * size.0..][..size.0];
        for column in 0..width {
            if let Some(point) = maps.point(row * width + column) {
                let (x, weight) = (f64::from(point.x), f64::from(point.weight));
                let (centred, residual) = (x - x_mean, f64::from(point.z) - global.at(x));
                let terms = [1.0, centred, centred * centred, residual, centred * residual];
                for (sum, term) in cells[column / cell].iter_mut().zip(terms) {
                    *sum += weight * term;
                }
            }
        }
    }
    let taps = taps(window.sigma_px / cell as f64);
    let sums = blurred(&sums, size, &taps);
    let prior = window.prior * std::f64::consts::TAU * window.sigma_px * window.sigma_px;
    let corrections: Vec<Line> = sums.iter().map(|sums| correction(*sums, prior, variance)).collect();
    let field = Field { lines: &corrections, size, cell, global, x_mean };
    level.run(Apply { mono: maps.mono, width, field, domain, cap_m, out });
}

/// Weighted mean and variance of x over the pixels valid in both.
fn moments(maps: &Maps<'_>) -> Option<(f64, f64)> {
    let points = || (0..maps.mono.len()).filter_map(|at| maps.point(at));
    let (mut total, mut sum) = (0.0, 0.0);
    for point in points() {
        total += f64::from(point.weight);
        sum += f64::from(point.weight) * f64::from(point.x);
    }
    let mean = sum / total;
    let mut squares = 0.0;
    for point in points() {
        squares += f64::from(point.weight) * (f64::from(point.x) - mean) * (f64::from(point.x) - mean);
    }
    (total > 0.0).then_some((mean, squares / total))
}

/// A Gaussian with 1 at its centre, which is the first tap.
fn taps(sigma: f64) -> Vec<f64> {
    let reach = (REACH * sigma).ceil() as usize;
    (0..=reach).map(|tap| libm::exp(-0.5 * (tap as f64 / sigma) * (tap as f64 / sigma))).collect()
}

/// Nothing is beyond the borders: windows there have fewer pixels.
fn blurred(sums: &[Sums], (columns, rows): (usize, usize), taps: &[f64]) -> Vec<Sums> {
    let along = |from: &[Sums], (count, step): (usize, usize), first: usize, index: usize| {
        let mut out = [0.0; 5];
        let range = index.saturating_sub(taps.len() - 1)..(index + taps.len()).min(count);
        for other in range {
            let tap = taps[other.abs_diff(index)];
            for (out, sum) in out.iter_mut().zip(from[first + other * step]) {
                *out += tap * sum;
            }
        }
        out
    };
    let places = || (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
    let wide: Vec<Sums> = places().map(|(row, column)| along(sums, (columns, 1), row * columns, column)).collect();
    places().map(|(row, column)| along(&wide, (rows, columns), column, row)).collect()
}

/// The line of the residuals against the centred x, with the prior at 0.
fn correction([total, x, xx, r, xr]: Sums, prior: f64, variance: f64) -> Line {
    let (total, xx) = (total + prior, xx + prior * variance);
    let determinant = total * xx - x * x;
    Line { scale: (total * xr - x * r) / determinant, shift: (xx * r - x * xr) / determinant }
}

#[derive(Clone, Copy)]
struct Field<'a> {
    lines: &'a [Line],
    /// Columns and rows of cells.
    size: (usize, usize),
    /// px.
    cell: usize,
    global: Line,
    x_mean: f64,
}

/// Where a pixel is between the centres of two cells.
#[derive(Clone, Copy)]
struct Between {
    first: usize,
    second: usize,
    share: f64,
}

impl Between {
    #[inline(always)]
    fn new(pixel: usize, cell: usize, cells: usize) -> Self {
        let position = ((pixel as f64 + 0.5) / cell as f64 - 0.5).clamp(0.0, (cells - 1) as f64);
        let first = position as usize;
        Self { first, second: (first + 1).min(cells - 1), share: position - first as f64 }
    }
}

#[inline(always)]
fn mix(a: Line, b: Line, share: f64) -> Line {
    Line { scale: a.scale + share * (b.scale - a.scale), shift: a.shift + share * (b.shift - a.shift) }
}

struct Apply<'a> {
    mono: &'a [f32],
    width: usize,
    field: Field<'a>,
    domain: Domain,
    cap_m: f64,
    out: &'a mut [f32],
}

impl Pass for Apply<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { mono, width, field: Field { lines, size, cell, global, x_mean }, domain, cap_m, out } = self;
        let columns: Vec<Between> = (0..width).map(|column| Between::new(column, cell, size.0)).collect();
        let mut of_row = vec![Line { scale: 0.0, shift: 0.0 }; size.0];
        for (row, (out, mono)) in out.chunks_exact_mut(width).zip(mono.chunks_exact(width)).enumerate() {
            let between = Between::new(row, cell, size.1);
            let (upper, lower) = (&lines[between.first * size.0..], &lines[between.second * size.0..]);
            for ((line, &upper), &lower) in of_row.iter_mut().zip(upper).zip(lower) {
                *line = mix(upper, lower, between.share);
            }
            for ((out, &x), column) in out.iter_mut().zip(mono).zip(&columns) {
                let local = mix(of_row[column.first], of_row[column.second], column.share);
                let wide = f64::from(x);
                let aligned = global.scale * wide + global.shift + (local.scale * (wide - x_mean) + local.shift);
                let metres = metres(aligned, domain, cap_m);
                *out = if x.is_finite() { metres } else { f32::NAN };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::align::{Estimator, fit, points};
    use crate::simd::every_level;
    use depthloom_random::SplitMix64;

    const SIZE: (usize, usize) = (96, 40);

    fn aligned(maps: &Maps<'_>, window: Window) -> Vec<f32> {
        let global = fit(&points(maps), Estimator::LeastSquares).unwrap().line;
        let bits = every_level(|level| {
            let mut out = vec![0.0; maps.mono.len()];
            local_at(level, maps, SIZE, global, window, (Domain::InverseDepth, 1e3), &mut out);
            out.into_iter().map(f32::to_bits).collect::<Vec<_>>()
        });
        bits.into_iter().map(f32::from_bits).collect()
    }

    /// Inverse depth, a map of it whose scale and shift differ over the image, and stereo at half of the pixels.
    fn distorted() -> (Vec<f32>, Vec<f32>, Vec<f32>) {
        let mut random = SplitMix64::new(7);
        let truth: Vec<f32> = (0..SIZE.0 * SIZE.1).map(|_| 0.02 + 0.4 * random.unit()).collect();
        let distort = |(at, z): (usize, &f32)| {
            let (column, row) = ((at % SIZE.0) as f32 / SIZE.0 as f32, (at / SIZE.0) as f32 / SIZE.1 as f32);
            (z - 0.05 * row) / (2.0 + column)
        };
        let mono = truth.iter().enumerate().map(distort).collect();
        let stereo = truth.iter().map(|&z| if random.unit() < 0.5 { z } else { f32::NAN }).collect();
        (truth, mono, stereo)
    }

    fn mean_error(depth: &[f32], truth: &[f32]) -> f32 {
        depth.iter().zip(truth).map(|(depth, z)| (depth * z - 1.0).abs()).sum::<f32>() / truth.len() as f32
    }

    #[test]
    fn a_smooth_distortion_is_removed_and_a_strong_prior_is_the_global_line() {
        let (truth, mono, stereo) = distorted();
        let maps = Maps { mono: &mono, stereo: &stereo, weight: None };
        let near = mean_error(&aligned(&maps, Window { sigma_px: 6.0, prior: 1e-3 }), &truth);
        let global = fit(&points(&maps), Estimator::LeastSquares).unwrap().line;
        let mut of_global = vec![0.0; mono.len()];
        super::super::apply(&mono, global, Domain::InverseDepth, 1e3, &mut of_global);
        let far = mean_error(&of_global, &truth);
        assert!(near < 0.2 * far, "{near} {far}");
        let strong = aligned(&maps, Window { sigma_px: 6.0, prior: 1e9 });
        let apart = |(a, b): (&f32, &f32)| (a / b - 1.0).abs();
        assert!(strong.iter().zip(&of_global).map(apart).fold(0.0, f32::max) < 1e-5);
    }

    #[test]
    fn far_from_stereo_the_line_is_the_global_one() {
        let (_, mono, mut stereo) = distorted();
        for (at, z) in stereo.iter_mut().enumerate() {
            if at % SIZE.0 >= 30 {
                *z = f32::NAN;
            }
        }
        let maps = Maps { mono: &mono, stereo: &stereo, weight: None };
        let global = fit(&points(&maps), Estimator::LeastSquares).unwrap().line;
        let mut of_global = vec![0.0; mono.len()];
        super::super::apply(&mono, global, Domain::InverseDepth, 1e3, &mut of_global);
        let found = aligned(&maps, Window { sigma_px: 6.0, prior: 0.05 });
        let of_last = |map: &[f32]| map.iter().skip(95).step_by(SIZE.0).copied().collect::<Vec<_>>();
        assert_eq!(of_last(&found), of_last(&of_global));
        assert_ne!(found[..30], of_global[..30]);
    }
}
