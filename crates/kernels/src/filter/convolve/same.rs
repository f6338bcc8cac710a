//! Convolution that keeps the image's size: odd kernels, stride 1, zeros around.

use super::planes::Planes;
use super::product::{Dots, Product, pack};
use super::{Activation, Gradients, Layer, LayerScratch, bias_gradient};
use crate::simd::{Level, run_lanes};

/// A convolution `out[o] = act(bias[o] + sum over i of weights[o][i] * in[i])` with zero padding that keeps the size:
/// PyTorch's `conv2d(stride=1, padding=k/2)`. Weights are outputs x inputs x kernel x kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Same {
    /// Channels in.
    pub inputs: usize,
    /// Channels out.
    pub outputs: usize,
    /// Of image and output; their zeros reach at least as far as the kernel.
    pub planes: Planes,
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
    /// Where the taps of the image lie, and those of the slopes.
    offsets: [Vec<usize>; 2],
}

impl Same {
    const fn taps(&self) -> usize {
        self.kernel * self.kernel
    }

    fn offsets(&self, channels: usize) -> Vec<usize> {
        let shift = self.planes.pad() - self.kernel / 2;
        let tap = |k: usize| {
            let (channel, tap) = (k / self.taps(), k % self.taps());
            self.planes.tap(channel, tap / self.kernel + shift, tap % self.kernel + shift)
        };
        (0..channels * self.taps()).map(tap).collect()
    }
}

impl Layer for Same {
    type Weights = SameWeights;

    fn weights(&self, level: Level, weights: &[f32], backward: bool) -> SameWeights {
        let taps = self.taps();
        assert!(self.kernel % 2 == 1 && self.kernel / 2 <= self.planes.pad(), "kernel {}", self.kernel);
        assert_eq!(weights.len(), self.outputs * self.inputs * taps);
        let depth = self.inputs * taps;
        let offsets = [self.offsets(self.inputs), self.offsets(if backward { self.outputs } else { 0 })];
        let mut packed = SameWeights { offsets, ..SameWeights::default() };
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
        _scratch: &mut LayerScratch,
    ) {
        let planes = self.planes;
        assert_eq!(image.len(), self.inputs * planes.plane());
        assert_eq!(out.len(), self.outputs * planes.plane());
        run_lanes(
            level,
            Product {
                weights: &weights.forward,
                offsets: &weights.offsets[0],
                source: image,
                out: &mut out[planes.origin(0)..],
                stride: planes.plane(),
                rows: self.outputs,
                columns: planes.columns(),
                finish: self.activation.finish(bias),
            },
        );
        planes.clear_gaps(out);
    }

    fn backward(
        &self,
        level: Level,
        image: &[f32],
        weights: &SameWeights,
        slopes: &[f32],
        gradients: &mut Gradients<'_>,
        _scratch: &mut LayerScratch,
    ) {
        let planes = self.planes;
        assert_eq!(slopes.len(), self.outputs * planes.plane());
        if let Some(bias) = gradients.bias.as_deref_mut() {
            bias_gradient(&planes, slopes, bias);
        }
        if let Some(gradient) = gradients.weights.as_deref_mut() {
            run_lanes(
                level,
                Dots {
                    left: slopes,
                    first: planes.origin(0),
                    stride: planes.plane(),
                    rows: self.outputs,
                    source: image,
                    offsets: &weights.offsets[0],
                    columns: planes.columns(),
                    out: gradient,
                },
            );
        }
        if let Some(gradient) = &mut gradients.image {
            assert_eq!(gradient.planes.len(), self.inputs * planes.plane());
            run_lanes(
                level,
                Product {
                    weights: &weights.backward,
                    offsets: &weights.offsets[1],
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
