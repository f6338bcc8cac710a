//! Sums of products over shifted rows: the two loops that all convolutions of a network consist of.
//!
//! An image whose rows are separated by zeros is one long line, and a convolution's tap is that line shifted. So
//! neither columns of patches (im2col) nor a transform are needed: the operands are read where they lie.
#![expect(unsafe_code, reason = "vector loads and stores at positions that were checked once for the whole loop")]

use crate::simd::{LANES, Lanes, LanesPass, Level, run_lanes};

/// Samples of a line that are worked on before the next rows are: what they need stays in the cache.
const SPAN: usize = 480;
/// Samples whose products are summed in registers, before the sum is added to the total.
const DOT_SPAN: usize = 1024;

/// What becomes of a row's sums.
#[derive(Clone, Copy)]
pub(super) enum Finish<'a> {
    /// They are written.
    Set,
    /// They are added to what is there.
    Add,
    /// The row's bias is added.
    Bias(&'a [f32]),
    /// The row's bias is added, and what is negative becomes zero.
    BiasRelu(&'a [f32]),
}

/// `out[m][p] = sum over k of weights[m][k] * source[offsets[k] + p]`, for `p < columns`, finished.
///
/// The sum runs over `k` in order, whatever the instruction set.
pub(super) struct Product<'a> {
    /// As [`pack`] orders them for this level.
    pub weights: &'a [f32],
    pub offsets: &'a [usize],
    pub source: &'a [f32],
    /// Rows of `columns` samples, each `stride` after the one before.
    pub out: &'a mut [f32],
    /// Distance of output rows, samples.
    pub stride: usize,
    pub rows: usize,
    /// Output columns, a multiple of [`LANES`].
    pub columns: usize,
    pub finish: Finish<'a>,
}

/// Heights of the tiles that `rows` rows are cut into, for tiles of at most `most` rows (a power of two).
fn heights(rows: usize, most: usize) -> impl Iterator<Item = (usize, usize)> {
    let mut start = 0;
    std::iter::from_fn(move || {
        let left = rows - start;
        let height = (left > 0).then(|| if left >= most { most } else { 1 << left.ilog2() })?;
        start += height;
        Some((start - height, height))
    })
}

/// Orders weights `weight(m, k)` as [`Product`] reads them: tile by tile of rows, each `k` by `k`.
pub(super) fn pack(level: Level, rows: usize, depth: usize, weight: impl Fn(usize, usize) -> f32, out: &mut Vec<f32>) {
    struct Most;
    impl LanesPass for Most {
        type Output = usize;
        #[inline(always)]
        fn run<L: Lanes>(self) -> usize {
            L::TILE.0
        }
    }
    out.clear();
    out.reserve(rows * depth);
    for (start, height) in heights(rows, run_lanes(level, Most)) {
        for k in 0..depth {
            out.extend((start..start + height).map(|m| weight(m, k)));
        }
    }
}

impl LanesPass for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let depth = self.offsets.len();
        let farthest = self.offsets.iter().max().copied().unwrap_or(0);
        assert!(self.columns.is_multiple_of(LANES) && self.weights.len() == self.rows * depth);
        assert!(depth == 0 || farthest + self.columns <= self.source.len());
        assert!(self.rows == 0 || (self.rows - 1) * self.stride + self.columns <= self.out.len());
        if let Finish::Bias(bias) | Finish::BiasRelu(bias) = self.finish {
            assert!(bias.len() == self.rows);
        }
        let (most, wide) = L::TILE;
        let mut span = 0;
        while span < self.columns {
            let end = (span + SPAN).min(self.columns);
            for (row, height) in heights(self.rows, most) {
                let mut p = span;
                while p < end {
                    let step = wide.min((end - p) / LANES);
                    let finish = match self.finish {
                        Finish::Bias(bias) => Finish::Bias(&bias[row..row + height]),
                        Finish::BiasRelu(bias) => Finish::BiasRelu(&bias[row..row + height]),
                        finish => finish,
                    };
                    // SAFETY: weights of `height` rows begin at `row * depth` (they are ordered by tiles); `p` and the
                    // samples after it lie within `columns`, for which source and output were checked above.
                    unsafe {
                        let weights = self.weights.as_ptr().add(row * depth);
                        let source = self.source.as_ptr().add(p);
                        let out = self.out.as_mut_ptr().add(row * self.stride + p);
                        match (height, step) {
                            (8, 3) => tile::<L, 8, 3>(weights, self.offsets, source, out, self.stride, finish),
                            (8, 2) => tile::<L, 8, 2>(weights, self.offsets, source, out, self.stride, finish),
                            (8, _) => tile::<L, 8, 1>(weights, self.offsets, source, out, self.stride, finish),
                            (4, 3) => tile::<L, 4, 3>(weights, self.offsets, source, out, self.stride, finish),
                            (4, 2) => tile::<L, 4, 2>(weights, self.offsets, source, out, self.stride, finish),
                            (4, _) => tile::<L, 4, 1>(weights, self.offsets, source, out, self.stride, finish),
                            (2, 3) => tile::<L, 2, 3>(weights, self.offsets, source, out, self.stride, finish),
                            (2, 2) => tile::<L, 2, 2>(weights, self.offsets, source, out, self.stride, finish),
                            (2, _) => tile::<L, 2, 1>(weights, self.offsets, source, out, self.stride, finish),
                            (_, 3) => tile::<L, 1, 3>(weights, self.offsets, source, out, self.stride, finish),
                            (_, 2) => tile::<L, 1, 2>(weights, self.offsets, source, out, self.stride, finish),
                            (_, _) => tile::<L, 1, 1>(weights, self.offsets, source, out, self.stride, finish),
                        }
                    }
                    p += step * LANES;
                }
            }
            span = end;
        }
    }
}

/// `R` rows of `C` times [`LANES`] sums, kept in registers.
///
/// # Safety
/// `weights` has `R` floats for each offset; `source` can be read for `C * LANES` floats after each offset; `out` can
/// be read and written for as many in each of `R` rows; `finish` has `R` biases.
#[inline(always)]
unsafe fn tile<L: Lanes, const R: usize, const C: usize>(
    weights: *const f32,
    offsets: &[usize],
    source: *const f32,
    out: *mut f32,
    stride: usize,
    finish: Finish<'_>,
) {
    let mut sums = [[L::splat(0.0); C]; R];
    for (k, &offset) in offsets.iter().enumerate() {
        // SAFETY: the caller's promise.
        unsafe {
            let samples: [L; C] = std::array::from_fn(|c| L::load(source.add(offset + c * LANES)));
            for (r, sums) in sums.iter_mut().enumerate() {
                let weight = L::splat(*weights.add(k * R + r));
                for (sum, samples) in sums.iter_mut().zip(samples) {
                    *sum = sum.plus_product(samples, weight);
                }
            }
        }
    }
    for (r, row) in sums.into_iter().enumerate() {
        for (c, mut sum) in row.into_iter().enumerate() {
            // SAFETY: the caller's promise.
            unsafe {
                let out = out.add(r * stride + c * LANES);
                match finish {
                    Finish::Set => {}
                    Finish::Add => sum = sum.plus(L::load(out)),
                    Finish::Bias(bias) => sum = sum.plus(L::splat(*bias.get_unchecked(r))),
                    Finish::BiasRelu(bias) => sum = sum.plus(L::splat(*bias.get_unchecked(r))).positive(),
                }
                sum.store(out);
            }
        }
    }
}

/// `out[m][k] = sum over p < columns of rows[m][p] * source[offsets[k] + p]`.
///
/// The sum runs over lanes and spans of fixed size, whatever the instruction set.
pub(super) struct Dots<'a> {
    /// The left factors: rows of `columns` samples, the first at `first`, each `stride` after the one before.
    pub left: &'a [f32],
    pub first: usize,
    /// Distance of rows, samples.
    pub stride: usize,
    pub rows: usize,
    pub source: &'a [f32],
    pub offsets: &'a [usize],
    /// Samples summed over, a multiple of [`LANES`].
    pub columns: usize,
    /// Row by row, `offsets.len()` each.
    pub out: &'a mut [f32],
}

impl LanesPass for Dots<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let depth = self.offsets.len();
        let farthest = self.offsets.iter().max().copied().unwrap_or(0);
        assert!(self.columns.is_multiple_of(LANES) && self.out.len() == self.rows * depth);
        assert!(depth == 0 || farthest + self.columns <= self.source.len());
        assert!(self.rows == 0 || self.first + (self.rows - 1) * self.stride + self.columns <= self.left.len());
        self.out.fill(0.0);
        let wide = L::TILE.1 > 1;
        let mut span = 0;
        while span < self.columns {
            let count = DOT_SPAN.min(self.columns - span);
            let mut m = 0;
            while m < self.rows {
                let height = match self.rows - m {
                    4.. if wide => 4,
                    2.. => 2,
                    _ => 1,
                };
                let mut k = 0;
                while k < depth {
                    let step = match depth - k {
                        6.. if wide => 6,
                        3.. if wide => 3,
                        2.. if !wide => 2,
                        _ => 1,
                    };
                    // SAFETY: `span + count` lies within `columns`, for which both operands were checked above.
                    unsafe {
                        let left = self.left.as_ptr().add(self.first + m * self.stride + span);
                        let source = self.source.as_ptr().add(span);
                        let (offsets, out) = (&self.offsets[k..], &mut self.out[m * depth + k..]);
                        match (height, step) {
                            (4, 6) => dots::<L, 4, 6>(left, self.stride, source, offsets, count, out, depth),
                            (4, 3) => dots::<L, 4, 3>(left, self.stride, source, offsets, count, out, depth),
                            (4, _) => dots::<L, 4, 1>(left, self.stride, source, offsets, count, out, depth),
                            (2, 6) => dots::<L, 2, 6>(left, self.stride, source, offsets, count, out, depth),
                            (2, 3) => dots::<L, 2, 3>(left, self.stride, source, offsets, count, out, depth),
                            (2, 2) => dots::<L, 2, 2>(left, self.stride, source, offsets, count, out, depth),
                            (2, _) => dots::<L, 2, 1>(left, self.stride, source, offsets, count, out, depth),
                            (_, 6) => dots::<L, 1, 6>(left, self.stride, source, offsets, count, out, depth),
                            (_, 3) => dots::<L, 1, 3>(left, self.stride, source, offsets, count, out, depth),
                            (_, 2) => dots::<L, 1, 2>(left, self.stride, source, offsets, count, out, depth),
                            (_, _) => dots::<L, 1, 1>(left, self.stride, source, offsets, count, out, depth),
                        }
                    }
                    k += step;
                }
                m += height;
            }
            span += count;
        }
    }
}

/// Adds `R` by `K` dot products of `count` samples to `out`, whose rows are `depth` apart.
///
/// # Safety
/// `left` can be read for `count` floats in each of `R` rows, `source` for as many after each of the first `K` offsets.
#[inline(always)]
unsafe fn dots<L: Lanes, const R: usize, const K: usize>(
    left: *const f32,
    stride: usize,
    source: *const f32,
    offsets: &[usize],
    count: usize,
    out: &mut [f32],
    depth: usize,
) {
    let mut sums = [[L::splat(0.0); K]; R];
    // SAFETY: the caller's promise.
    let lines: [*const f32; K] = std::array::from_fn(|k| unsafe { source.add(offsets[k]) });
    let mut p = 0;
    while p < count {
        // SAFETY: the caller's promise; `count` is a multiple of `LANES`.
        unsafe {
            let factors: [L; R] = std::array::from_fn(|r| L::load(left.add(r * stride + p)));
            for (k, line) in lines.into_iter().enumerate() {
                let samples = L::load(line.add(p));
                for (sums, factor) in sums.iter_mut().zip(factors) {
                    sums[k] = sums[k].plus_product(factor, samples);
                }
            }
        }
        p += LANES;
    }
    for k in 0..K {
        if R == 4 {
            let found = L::sums([sums[0][k], sums[1 % R][k], sums[2 % R][k], sums[3 % R][k]]);
            for (r, sum) in found.into_iter().enumerate() {
                out[r * depth + k] += sum;
            }
        } else {
            for (r, sums) in sums.iter().enumerate() {
                out[r * depth + k] += sums[k].sum();
            }
        }
    }
}
