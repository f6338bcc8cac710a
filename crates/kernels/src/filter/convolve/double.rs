//! Transposed convolution that doubles the image's size: 4x4 kernels, stride 2.

use super::planes::Planes;
use super::product::{Dots, Product, pack};
use super::{Activation, Convolution, ConvolutionScratch, Gradients};
use crate::simd::Level;

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
    /// Columns of the image that comes in.
    pub width: usize,
    /// Rows of the image that comes in.
    pub height: usize,
    /// What follows the sum.
    pub activation: Activation,
}

/// The weights of [`Double`], packed.
#[derive(Debug, Default)]
pub struct DoubleWeights {
    /// By parity of row and column.
    forward: [Vec<f32>; 4],
    backward: Vec<f32>,
}

impl Double {
    const fn planes(&self) -> Planes {
        Planes::new(self.width, self.height, 1)
    }

    const fn area(&self) -> usize {
        self.width * self.height
    }
}

impl Convolution for Double {
    type Weights = DoubleWeights;

    fn new([inputs, height, width]: [usize; 3], [_, outputs, _, _]: [usize; 4], activation: Activation) -> Self {
        Self { inputs, outputs, width, height, activation }
    }

    fn output(&self) -> [usize; 3] {
        [self.outputs, self.height * 2, self.width * 2]
    }

    fn weights(&self, level: Level, weights: &[f32], backward: bool) -> DoubleWeights {
        assert_eq!(weights.len(), self.inputs * self.outputs * TAPS);
        let at = |input: usize, output: usize, tap: usize| weights[(input * self.outputs + output) * TAPS + tap];
        let mut packed = DoubleWeights::default();
        for (parity, forward) in packed.forward.iter_mut().enumerate() {
            let weight = |m: usize, k: usize| {
                let ((down, _), (right, _)) = reach(parity, k % 4);
                at(k / 4, m, down * KERNEL + right)
            };
            pack(level, self.outputs, self.inputs * 4, weight, forward);
        }
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
        scratch: &mut ConvolutionScratch,
    ) {
        let (planes, columns) = (self.planes(), self.planes().columns());
        assert_eq!(image.len(), self.inputs * self.area());
        assert_eq!(out.len(), self.outputs * self.area() * 4);
        planes.spread(image, &mut scratch.source);
        scratch.room(2 * self.outputs * columns);
        for parity_row in 0..2 {
            let (even, odd) = scratch.sums.split_at_mut(self.outputs * columns);
            for (parity_column, sums) in [even, odd].into_iter().enumerate() {
                let parity = parity_row * 2 + parity_column;
                let tap = |k: usize| {
                    let ((_, down), (_, right)) = reach(parity, k % 4);
                    planes.tap(k / 4, down, right)
                };
                scratch.offsets.clear();
                scratch.offsets.extend((0..self.inputs * 4).map(tap));
                level.run_lanes(Product {
                    weights: &weights.forward[parity],
                    offsets: &scratch.offsets,
                    source: &scratch.source,
                    out: sums,
                    stride: columns,
                    rows: self.outputs,
                    columns,
                });
            }
            for (channel, out) in out.chunks_exact_mut(self.area() * 4).enumerate() {
                let bias = bias.get(channel).copied().unwrap_or(0.0);
                let rows = out.chunks_exact_mut(self.width * 2).skip(parity_row).step_by(2);
                for (y, row) in rows.enumerate() {
                    let at = channel * columns + y * planes.row();
                    let pairs = even_and_odd(&scratch.sums, at, self.outputs * columns + at, self.width);
                    for (out, (even, odd)) in row.as_chunks_mut::<2>().0.iter_mut().zip(pairs) {
                        let sums = [even + bias, odd + bias];
                        *out = match self.activation {
                            Activation::None => sums,
                            Activation::Relu => sums.map(|sum| sum.max(0.0)),
                        };
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
        out: &[f32],
        slope: &[f32],
        gradients: &mut Gradients<'_>,
        scratch: &mut ConvolutionScratch,
    ) {
        let (planes, area) = (self.planes(), self.area());
        assert_eq!(slope.len(), self.outputs * area * 4);
        planes.reserve(&mut scratch.slopes, 4 * self.outputs);
        scratch.room(self.width * 2);
        for channel in 0..self.outputs {
            for parity in 0..4 {
                let plane = parity * self.outputs + channel;
                planes.fill(&mut scratch.slopes, plane, |y, to| {
                    let from = channel * area * 4 + (2 * y + parity / 2) * self.width * 2;
                    let line = &mut scratch.sums[..self.width * 2];
                    self.activation.slope(&out[from..][..self.width * 2], &slope[from..][..self.width * 2], line);
                    for (to, pair) in to.iter_mut().zip(line.as_chunks::<2>().0) {
                        *to = pair[parity % 2];
                    }
                });
            }
        }
        if let Some(bias) = gradients.bias.as_deref_mut() {
            for (channel, bias) in bias.iter_mut().enumerate() {
                let sum = |parity| {
                    super::sum(&scratch.slopes[planes.origin(parity * self.outputs + channel)..][..planes.columns()])
                };
                *bias = (sum(0) + sum(1)) + (sum(2) + sum(3));
            }
        }
        if gradients.weights.is_none() && gradients.image.is_none() {
            return;
        }
        let tap = |k: usize| {
            let (output, tap) = (k / TAPS, k % TAPS);
            let ((parity_row, down), (parity_column, right)) = (ORIGIN[tap / KERNEL], ORIGIN[tap % KERNEL]);
            planes.tap((parity_row * 2 + parity_column) * self.outputs + output, down, right)
        };
        scratch.offsets.clear();
        scratch.offsets.extend((0..self.outputs * TAPS).map(tap));
        if let Some(gradient) = gradients.weights.as_deref_mut() {
            planes.spread(image, &mut scratch.source);
            level.run_lanes(Dots {
                left: &scratch.source,
                first: planes.origin(0),
                stride: planes.plane(),
                rows: self.inputs,
                source: &scratch.slopes,
                offsets: &scratch.offsets,
                columns: planes.columns(),
                out: gradient,
            });
        }
        if let Some(gradient) = gradients.image.as_deref_mut() {
            scratch.image_gradient(level, &planes, &weights.backward, self.inputs, gradient);
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
