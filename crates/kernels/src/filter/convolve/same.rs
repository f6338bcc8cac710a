//! Convolution that keeps the image's size: odd kernels, stride 1, zeros around.

use super::planes::Planes;
use super::product::{Dots, Product, pack};
use super::{Activation, Convolution, ConvolutionScratch, Gradients};
use crate::simd::Level;

/// A convolution `out[o] = act(bias[o] + sum over i of weights[o][i] * in[i])` with zero padding that keeps the size:
/// PyTorch's `conv2d(stride=1, padding=k/2)`. Weights are outputs x inputs x kernel x kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Same {
    /// Channels in.
    pub inputs: usize,
    /// Channels out.
    pub outputs: usize,
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
    /// Rows and columns of the kernel, odd.
    pub kernel: usize,
    /// What follows the sum.
    pub activation: Activation,
}

/// The weights of [`Same`], packed.
#[derive(Debug, Default)]
pub struct SameWeights {
    forward: Vec<f32>,
    backward: Vec<f32>,
}

impl Same {
    const fn planes(&self) -> Planes {
        Planes::new(self.width, self.height, self.kernel / 2)
    }

    const fn taps(&self) -> usize {
        self.kernel * self.kernel
    }

    const fn area(&self) -> usize {
        self.width * self.height
    }

    fn offsets(&self, channels: usize, out: &mut Vec<usize>) {
        let planes = self.planes();
        let tap = |k: usize| {
            let (channel, tap) = (k / self.taps(), k % self.taps());
            planes.tap(channel, tap / self.kernel, tap % self.kernel)
        };
        out.clear();
        out.extend((0..channels * self.taps()).map(tap));
    }
}

impl Convolution for Same {
    type Weights = SameWeights;

    fn new([inputs, height, width]: [usize; 3], [outputs, _, kernel, _]: [usize; 4], activation: Activation) -> Self {
        Self { inputs, outputs, width, height, kernel, activation }
    }

    fn output(&self) -> [usize; 3] {
        [self.outputs, self.height, self.width]
    }

    fn weights(&self, level: Level, weights: &[f32], backward: bool) -> SameWeights {
        let (taps, mut packed) = (self.taps(), SameWeights::default());
        assert!(self.kernel % 2 == 1, "an even kernel keeps no size");
        assert_eq!(weights.len(), self.outputs * self.inputs * taps);
        let depth = self.inputs * taps;
        pack(level, self.outputs, depth, |m, k| weights[m * depth + k], &mut packed.forward);
        if backward {
            // The gradient of a convolution is the convolution with the kernel turned round.
            let turned = |m: usize, k: usize| weights[(k / taps) * depth + m * taps + (taps - 1 - k % taps)];
            pack(level, self.inputs, self.outputs * taps, turned, &mut packed.backward);
        }
        packed
    }

    fn forward(
        &self,
        level: Level,
        image: &[f32],
        weights: &SameWeights,
        bias: &[f32],
        out: &mut [f32],
        scratch: &mut ConvolutionScratch,
    ) {
        let (planes, area) = (self.planes(), self.area());
        assert_eq!(image.len(), self.inputs * area);
        assert_eq!(out.len(), self.outputs * area);
        planes.spread(image, &mut scratch.source);
        self.offsets(self.inputs, &mut scratch.offsets);
        scratch.room(self.outputs * planes.columns());
        level.run_lanes(Product {
            weights: &weights.forward,
            offsets: &scratch.offsets,
            source: &scratch.source,
            out: &mut scratch.sums,
            stride: planes.columns(),
            rows: self.outputs,
            columns: planes.columns(),
        });
        for (channel, out) in out.chunks_exact_mut(area).enumerate() {
            let bias = bias.get(channel).copied().unwrap_or(0.0);
            let sums = &scratch.sums[channel * planes.columns()..];
            for (row, sums) in out.chunks_exact_mut(self.width).zip(sums.chunks(planes.row())) {
                match self.activation {
                    Activation::None => row.iter_mut().zip(sums).for_each(|(out, sum)| *out = sum + bias),
                    Activation::Relu => row.iter_mut().zip(sums).for_each(|(out, sum)| *out = (sum + bias).max(0.0)),
                }
            }
        }
    }

    fn backward(
        &self,
        level: Level,
        image: &[f32],
        weights: &SameWeights,
        out: &[f32],
        slope: &[f32],
        gradients: &mut Gradients<'_>,
        scratch: &mut ConvolutionScratch,
    ) {
        let (planes, area) = (self.planes(), self.area());
        assert_eq!(slope.len(), self.outputs * area);
        planes.reserve(&mut scratch.slopes, self.outputs);
        for channel in 0..self.outputs {
            let at = channel * area;
            planes.fill(&mut scratch.slopes, channel, |y, to| {
                let from = at + y * self.width;
                self.activation.slope(&out[from..][..self.width], &slope[from..][..self.width], to);
            });
        }
        if let Some(bias) = gradients.bias.as_deref_mut() {
            for (channel, bias) in bias.iter_mut().enumerate() {
                *bias = super::sum(&scratch.slopes[planes.origin(channel)..][..planes.columns()]);
            }
        }
        if let Some(gradient) = gradients.weights.as_deref_mut() {
            planes.spread(image, &mut scratch.source);
            self.offsets(self.inputs, &mut scratch.offsets);
            level.run_lanes(Dots {
                left: &scratch.slopes,
                first: planes.origin(0),
                stride: planes.plane(),
                rows: self.outputs,
                source: &scratch.source,
                offsets: &scratch.offsets,
                columns: planes.columns(),
                out: gradient,
            });
        }
        if let Some(gradient) = gradients.image.as_deref_mut() {
            self.offsets(self.outputs, &mut scratch.offsets);
            scratch.image_gradient(level, &planes, &weights.backward, self.inputs, gradient);
        }
    }
}
