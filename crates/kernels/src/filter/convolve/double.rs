//! Transposed convolution that doubles the image's size: 4x4 kernels, stride 2.

use super::planes::Planes;
use super::product::{Dots, Product, pack};
use super::{Activation, Gradients, Layer, LayerScratch, room};
use crate::simd::{Level, run_lanes};

const KERNEL: usize = 4;
const TAPS: usize = KERNEL * KERNEL;
/// For each parity of an output row (or column): the kernel's rows that reach it, and the input rows they come from,
/// counted from the row above.
const REACH: [[(usize, usize); 2]; 2] = [[(1, 1), (3, 0)], [(0, 2), (2, 1)]];
/// For each row of the kernel: the parity of the output rows it reaches, and how far down they are, counted from the
/// row above.
const ORIGIN: [(usize, usize); KERNEL] = [(1, 0), (0, 1), (1, 1), (0, 2)];

/// A transposed convolution, PyTorch's `conv_transpose2d(kernel 4, stride=2, padding=1)`: twice the rows and columns.
///
/// Weights are inputs x outputs x 4 x 4. The outputs of even and odd rows and columns are four convolutions with 2x2 of
/// the taps each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Double {
    /// Channels in.
    pub inputs: usize,
    /// Channels out.
    pub outputs: usize,
    /// Of the image that comes in.
    pub image: Planes,
    /// What follows the sum.
    pub activation: Activation,
}

/// The weights of [`Double`], packed.
#[derive(Debug, Default)]
pub struct DoubleWeights {
    /// By parity of row and column.
    forward: [Vec<f32>; 4],
    /// Where their taps lie.
    taps: [Vec<usize>; 4],
    backward: Vec<f32>,
    /// Where the taps of the slopes lie, which are four planes, one a parity, of each channel.
    slope_taps: Vec<usize>,
}

impl Double {
    /// The output's planes.
    #[must_use]
    pub const fn output(&self) -> Planes {
        self.image.resized(self.image.width() * 2, self.image.height() * 2)
    }

    /// The slopes of even and odd rows and columns, a plane each.
    fn apart<'a>(&self, slopes: &[f32], memory: &'a mut Vec<f32>) -> &'a [f32] {
        let (planes, output) = (self.image, self.output());
        let apart = room(memory, 4 * self.outputs * planes.plane());
        apart.fill(0.0);
        for channel in 0..self.outputs {
            for parity in 0..4 {
                let from = output.rows(slopes, channel).skip(parity / 2).step_by(2);
                for (to, from) in planes.rows_mut(apart, parity * self.outputs + channel).zip(from) {
                    for (to, pair) in to.iter_mut().zip(from.as_chunks::<2>().0) {
                        *to = pair[parity % 2];
                    }
                }
            }
        }
        apart
    }
}

impl Layer for Double {
    type Weights = DoubleWeights;

    fn weights(&self, level: Level, weights: &[f32], backward: bool) -> DoubleWeights {
        assert_eq!(weights.len(), self.inputs * self.outputs * TAPS);
        let shift = self.image.pad() - 1;
        let at = |input: usize, output: usize, tap: usize| weights[(input * self.outputs + output) * TAPS + tap];
        let mut packed = DoubleWeights::default();
        for (parity, (forward, taps)) in packed.forward.iter_mut().zip(&mut packed.taps).enumerate() {
            let weight = |m: usize, k: usize| {
                let ((down, _), (right, _)) = reach(parity, k % 4);
                at(k / 4, m, down * KERNEL + right)
            };
            pack(level, self.outputs, self.inputs * 4, weight, forward);
            taps.extend((0..self.inputs * 4).map(|k| {
                let ((_, down), (_, right)) = reach(parity, k % 4);
                self.image.tap(k / 4, down + shift, right + shift)
            }));
        }
        packed.slope_taps.extend((0..self.outputs * TAPS).map(|k| {
            let (output, tap) = (k / TAPS, k % TAPS);
            let ((parity_row, down), (parity_column, right)) = (ORIGIN[tap / KERNEL], ORIGIN[tap % KERNEL]);
            self.image.tap((parity_row * 2 + parity_column) * self.outputs + output, down + shift, right + shift)
        }));
        if backward {
            let weight = |m: usize, k: usize| at(m, k / TAPS, k % TAPS);
            pack(level, self.inputs, self.outputs * TAPS, weight, &mut packed.backward);
        }
        packed
    }

    fn forward(
        &self,
        level: Level,
        image: &[f32],
        weights: &DoubleWeights,
        bias: &[f32],
        out: &mut [f32],
        scratch: &mut LayerScratch,
    ) {
        let (planes, columns, output) = (self.image, self.image.columns(), self.output());
        assert_eq!(image.len(), self.inputs * planes.plane());
        assert_eq!(out.len(), self.outputs * output.plane());
        let sums = room(&mut scratch.sums, 2 * self.outputs * columns);
        for parity_row in 0..2 {
            let (even, odd) = sums.split_at_mut(self.outputs * columns);
            for (parity_column, sums) in [even, odd].into_iter().enumerate() {
                let parity = parity_row * 2 + parity_column;
                run_lanes(
                    level,
                    Product {
                        weights: &weights.forward[parity],
                        offsets: &weights.taps[parity],
                        source: image,
                        out: sums,
                        stride: columns,
                        rows: self.outputs,
                        columns,
                        finish: self.activation.finish(bias),
                    },
                );
            }
            for channel in 0..self.outputs {
                for (y, row) in output.rows_mut(out, channel).skip(parity_row).step_by(2).enumerate() {
                    let at = channel * columns + y * planes.row();
                    let pairs = even_and_odd(sums, at, self.outputs * columns + at, planes.width());
                    for (out, (even, odd)) in row.as_chunks_mut::<2>().0.iter_mut().zip(pairs) {
                        *out = [even, odd];
                    }
                }
            }
        }
    }

    fn backward(
        &self,
        level: Level,
        image: &[f32],
        weights: &DoubleWeights,
        slopes: &[f32],
        gradients: &mut Gradients<'_>,
        scratch: &mut LayerScratch,
    ) {
        let planes = self.image;
        assert_eq!(slopes.len(), self.outputs * self.output().plane());
        let slopes = self.apart(slopes, &mut scratch.planes);
        if let Some(bias) = gradients.bias.as_deref_mut() {
            for (channel, bias) in bias.iter_mut().enumerate() {
                let sum =
                    |parity| super::sum(&slopes[planes.origin(parity * self.outputs + channel)..][..planes.columns()]);
                *bias = (sum(0) + sum(1)) + (sum(2) + sum(3));
            }
        }
        if let Some(gradient) = gradients.weights.as_deref_mut() {
            run_lanes(
                level,
                Dots {
                    left: image,
                    first: planes.origin(0),
                    stride: planes.plane(),
                    rows: self.inputs,
                    source: slopes,
                    offsets: &weights.slope_taps,
                    columns: planes.columns(),
                    out: gradient,
                },
            );
        }
        if let Some(gradient) = &mut gradients.image {
            run_lanes(
                level,
                Product {
                    weights: &weights.backward,
                    offsets: &weights.slope_taps,
                    source: slopes,
                    finish: gradient.finish(),
                    out: &mut gradient.planes[planes.origin(0)..],
                    stride: planes.plane(),
                    rows: self.inputs,
                    columns: planes.columns(),
                },
            );
        }
    }
}

/// Kernel row and input row, kernel column and input column, of one of the four taps of a parity.
const fn reach(parity: usize, tap: usize) -> ((usize, usize), (usize, usize)) {
    (REACH[parity / 2][tap / 2], REACH[parity % 2][tap % 2])
}

fn even_and_odd(sums: &[f32], even: usize, odd: usize, width: usize) -> impl Iterator<Item = (f32, f32)> {
    sums[even..][..width].iter().copied().zip(sums[odd..][..width].iter().copied())
}
