//! Monocular depth corrected by an interpolation of sparse stereo depth, as in Facil et al. 2017.
//!
//! For every pixel `p` and all support pixels `q`, at which stereo is trusted: `Z(p) = Z_m(p) + sum(w(p, q) (Z_s(q) -
//! Z_m(q))) / sum(w(p, q))`, with `w = W1 W2 W3`:
//!
//! - `W1 = exp(-|p - q| / distance_px)`: support pixels nearby.
//! - `W2 = 1 / ((|gx(p) - gx(q)| + gradient) (|gy(p) - gy(q)| + gradient))`: support pixels where monocular depth has
//!   the same gradient `(gx, gy)`.
//! - `W3 = exp(-|Z_m(p) + gx(p) (q - p)_x + gy(p) (q - p)_y - Z_m(q)|) + plane`: support pixels in the plane through
//!   `p`, metres.

use crate::fusion::functions::exp;
use crate::raster::{check, check_same};
use crate::simd::{Level, Pass};
use crate::tiles::{Tiles, each};

/// Rows of a tile.
const ROWS: usize = 8;
/// A pixel this many `distance_px` away, or farther, has the weight of one as far away: smaller ones have no `f32`.
const FARTHEST: f64 = 50.0;
/// Exponents beyond count as this one: the result is below all `plane` that matter.
const LARGEST_EXPONENT: f32 = 80.0;

/// The constants of the weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Columns and rows of the cells, px, of which each gives at most one support pixel.
    pub spacing: usize,
    /// Least confidence of a support pixel.
    pub min_confidence: f32,
    /// The scale of `W1`, px.
    pub distance_px: f32,
    /// What is added to differences of gradients in `W2`, metres per pixel.
    pub gradient: f32,
    /// What is added to `W3`.
    pub plane: f32,
}

/// A pixel at which stereo is trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Support {
    x: usize,
    y: usize,
    /// Monocular depth and its gradient.
    mono: f32,
    gradient: [f32; 2],
    /// Stereo minus monocular depth, metres.
    correction: f32,
}

/// Depth maps of a frame, metres, and the confidence in stereo; row-major, of one size.
#[derive(Clone, Copy, Debug)]
pub struct Maps<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Monocular depth; NaN or infinite: invalid.
    pub mono: &'a [f32],
    /// Stereo depth; NaN or infinite: invalid.
    pub stereo: &'a [f32],
    /// Confidence in stereo.
    pub confidence: &'a [f32],
}

/// Corrects monocular depth by the support pixels, and returns their number.
///
/// In each cell of the grid, the support pixel is the one with the highest confidence (the first in row-major order of
/// several) among those where both depths are valid. Where monocular depth is invalid, the result is stereo. Without
/// support, monocular depth is unchanged. A result is at least the smallest of all valid depths.
pub fn fuse(tiles: &dyn Tiles, maps: &Maps<'_>, params: &Params, out: &mut [f32]) -> usize {
    fuse_at(Level::best(), tiles, maps, params, out)
}

fn fuse_at(level: Level, tiles: &dyn Tiles, maps: &Maps<'_>, params: &Params, out: &mut [f32]) -> usize {
    let Maps { width, height, mono, stereo, confidence } = *maps;
    check("mono", mono.len(), width, height, 1);
    check_same("stereo", stereo.len(), mono.len());
    check_same("confidence", confidence.len(), mono.len());
    check_same("fused depth", out.len(), mono.len());
    if out.is_empty() {
        return 0;
    }
    let gradients = gradients(mono, width, height);
    let support = support(maps, &gradients, params);
    let valid = mono.iter().chain(stereo).copied().filter(|metres| metres.is_finite());
    let least = valid.fold(f32::INFINITY, f32::min);
    let nearness = Nearness::new(width, height, params.distance_px);
    each(tiles, out.chunks_mut(ROWS * width).collect(), |tile, rows: &mut [f32]| {
        for (row, out) in rows.chunks_exact_mut(width).enumerate() {
            let y = tile * ROWS + row;
            let here = y * width..(y + 1) * width;
            let (mono, stereo) = (&mono[here.clone()], &stereo[here.clone()]);
            let gradients = [&gradients[0][here.clone()], &gradients[1][here]];
            level.run(Row { y, mono, stereo, gradients, support: &support, nearness: &nearness, params, least, out });
        }
    });
    support.len()
}

/// Horizontal and vertical central differences, one-sided at the border (NumPy's `gradient`); 0 where one of both
/// neighbours is invalid.
fn gradients(map: &[f32], width: usize, height: usize) -> [Vec<f32>; 2] {
    let along = |at: usize, place: usize, count: usize, step: usize| {
        let (before, after) = (usize::from(place > 0), usize::from(place + 1 < count));
        let difference = map[at + after * step] - map[at - before * step];
        let change = difference / (before + after).max(1) as f32;
        if change.is_finite() { change } else { 0.0 }
    };
    let pixels = || 0..width * height;
    let across = pixels().map(|at| along(at, at % width, width, 1)).collect();
    [across, pixels().map(|at| along(at, at / width, height, width)).collect()]
}

fn support(maps: &Maps<'_>, gradients: &[Vec<f32>; 2], params: &Params) -> Vec<Support> {
    let Maps { width, height, mono, stereo, confidence } = *maps;
    let mut support = Vec::new();
    for top in (0..height).step_by(params.spacing) {
        for left in (0..width).step_by(params.spacing) {
            let mut best: Option<usize> = None;
            for y in top..height.min(top + params.spacing) {
                for at in y * width + left..y * width + width.min(left + params.spacing) {
                    let is_trusted = confidence[at] >= params.min_confidence;
                    let is_valid = mono[at].is_finite() && stereo[at].is_finite();
                    if is_trusted && is_valid && best.is_none_or(|best| confidence[at] > confidence[best]) {
                        best = Some(at);
                    }
                }
            }
            support.extend(best.map(|at| Support {
                x: at % width,
                y: at / width,
                mono: mono[at],
                gradient: [gradients[0][at], gradients[1][at]],
                correction: stereo[at] - mono[at],
            }));
        }
    }
    support
}

/// `W1` by distance in columns and rows.
struct Nearness {
    width: usize,
    /// One row per distance in rows; in it the distances `-(width - 1)` to `width - 1`.
    table: Vec<f32>,
}

impl Nearness {
    fn new(width: usize, height: usize, distance_px: f32) -> Self {
        let mut table = Vec::with_capacity(height * (2 * width - 1));
        for y in 0..height {
            let at = |x: usize| {
                let distance = ((x * x + y * y) as f64).sqrt();
                libm::exp(-(distance / f64::from(distance_px)).min(FARTHEST)) as f32
            };
            table.extend((1..width).rev().map(at));
            table.extend((0..width).map(at));
        }
        Self { width, table }
    }

    /// `W1` of a row's pixels for a support pixel in column `x`, which is `rows_away` rows away.
    #[inline(always)]
    fn of_row(&self, x: usize, rows_away: usize) -> &[f32] {
        let first = rows_away * (2 * self.width - 1) + self.width - 1 - x;
        &self.table[first..first + self.width]
    }
}

struct Row<'a> {
    y: usize,
    mono: &'a [f32],
    stereo: &'a [f32],
    gradients: [&'a [f32]; 2],
    support: &'a [Support],
    nearness: &'a Nearness,
    params: &'a Params,
    least: f32,
    out: &'a mut [f32],
}

impl Pass for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { y, mono, stereo, gradients: [across, down], support, nearness, params, least, out } = self;
        let (mut weights, mut corrections) = (vec![0.0_f32; mono.len()], vec![0.0_f32; mono.len()]);
        let columns: Vec<f32> = (0..mono.len()).map(|x| x as f32).collect();
        let (gradient, plane) = (params.gradient, params.plane);
        for one in support {
            let near = nearness.of_row(one.x, one.y.abs_diff(y));
            let (x, rows) = (one.x as f32, one.y as f32 - y as f32);
            let sums = weights.iter_mut().zip(corrections.iter_mut());
            let here = mono.iter().zip(across).zip(down).zip(&columns).zip(near);
            for ((weight_sum, correction_sum), ((((&mono, &gx), &gy), &column), &near)) in sums.zip(here) {
                let apart = ((gx - one.gradient[0]).abs() + gradient) * ((gy - one.gradient[1]).abs() + gradient);
                let off_plane = (mono + gx * (x - column) + gy * rows - one.mono).abs();
                // A comparison with NaN is false: NaN becomes the bound.
                let off_plane = if off_plane < LARGEST_EXPONENT { off_plane } else { LARGEST_EXPONENT };
                let weight = near * ((exp(-off_plane) + plane) / apart);
                *weight_sum += weight;
                *correction_sum += weight * one.correction;
            }
        }
        let sums = weights.iter().zip(&corrections);
        for (((out, &mono), &stereo), (&weight, &correction)) in out.iter_mut().zip(mono).zip(stereo).zip(sums) {
            let corrected = if weight > 0.0 { (mono + correction / weight).max(least) } else { mono };
            let otherwise = if stereo.is_finite() { stereo } else { f32::NAN };
            *out = if mono.is_finite() { corrected } else { otherwise };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;
    use crate::tiles::Serial;

    const NAN: f32 = f32::NAN;
    const PARAMS: Params = Params { spacing: 1, min_confidence: 0.5, distance_px: 2.0, gradient: 0.1, plane: 1e-3 };

    fn fused(width: usize, mono: &[f32], stereo: &[f32], confidence: &[f32], params: &Params) -> (Vec<f32>, usize) {
        let height = mono.len() / width;
        let (bits, support) = every_level(|level| {
            let mut out = vec![0.0; mono.len()];
            let maps = Maps { width, height, mono, stereo, confidence };
            let support = fuse_at(level, &Serial, &maps, params, &mut out);
            (out.into_iter().map(f32::to_bits).collect::<Vec<_>>(), support)
        });
        (bits.into_iter().map(f32::from_bits).collect(), support)
    }

    /// A row of four pixels, the outermost trusted: by hand.
    #[test]
    fn four_pixels_by_hand() {
        let mono = [10.0, 11.0, 12.0, 20.0];
        let (ours, support) = fused(4, &mono, &[12.0, NAN, 30.0, 21.0], &[1.0, 1.0, 0.2, 0.9], &PARAMS);
        assert_eq!(support, 2, "the third has too little confidence");
        // Gradients (1, 1, 4.5, 8); corrections +2 at pixel 0 and +1 at pixel 3.
        // Pixel 1 to pixel 0: 1 px away, same gradient, in its plane (11 - 1 = 10). To pixel 3: 2 px away, gradients
        // 7 apart, and 11 + 2 = 13 is 7 m off 20.
        let w = |distance: f64, apart: f64, off: f64| {
            (-distance / 2.0).exp() / ((apart + 0.1) * 0.1) * ((-off).exp() + 1e-3)
        };
        let (first, last) = (w(1.0, 0.0, 0.0), w(2.0, 7.0, 7.0));
        let expected = 11.0 + (2.0 * first + last) / (first + last);
        assert!((f64::from(ours[1]) - expected).abs() < 1e-5, "{}, not {expected}", ours[1]);
        // Pixel 2: 12 - 2 * 4.5 = 3 is 7 m off 10; 12 + 4.5 is 3.5 m off 20.
        let (first, last) = (w(2.0, 3.5, 7.0), w(1.0, 3.5, 3.5));
        let expected = 12.0 + (2.0 * first + last) / (first + last);
        assert!((f64::from(ours[2]) - expected).abs() < 1e-5, "{}, not {expected}", ours[2]);
    }

    #[test]
    fn a_constant_offset_is_corrected_everywhere_and_gaps_are_filled() {
        let mono: Vec<f32> = (0..60).map(|at| if at == 17 { NAN } else { 10.0 + at as f32 * 0.3 }).collect();
        let stereo: Vec<f32> =
            (0..60).map(|at| if at % 3 == 0 || at == 17 { 13.0 + at as f32 * 0.3 } else { NAN }).collect();
        let params = Params { spacing: 4, ..PARAMS };
        let (ours, support) = fused(10, &mono, &stereo, &[1.0; 60], &params);
        assert_eq!(support, 6);
        for (at, ours) in ours.iter().enumerate() {
            assert!((ours - (13.0 + at as f32 * 0.3)).abs() < 1e-4, "{at}: {ours}");
        }
    }

    #[test]
    fn without_support_mono_is_unchanged() {
        let (ours, support) = fused(2, &[5.0, NAN], &[6.0, NAN], &[0.0, 1.0], &PARAMS);
        assert!(support == 0 && ours[0] == 5.0 && ours[1].is_nan());
    }
}
