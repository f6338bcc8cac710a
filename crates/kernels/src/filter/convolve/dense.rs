//! A dense layer: every output from every sample.

use super::planes::Planes;
use super::product::{Dots, Finish, Product, pack};
use super::{Activation, Gradients, Layer, LayerScratch, room};
use crate::simd::{LANES, Level, run_lanes};

/// `out[o] = act(bias[o] + sum over i of weights[o][i] * in[i])`: PyTorch's `flatten` and `linear`. The output is a map
/// of one sample a channel. The image's samples are a multiple of 16. Weights are outputs x inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dense {
    /// Channels in.
    pub channels: usize,
    /// Of the image.
    pub image: Planes,
    /// Samples out.
    pub outputs: usize,
    /// What follows the sum.
    pub activation: Activation,
}

/// The weights of [`Dense`].
#[derive(Debug, Default)]
pub struct DenseWeights {
    values: Vec<f32>,
    offsets: Vec<usize>,
}

impl Dense {
    /// The output's planes.
    #[must_use]
    pub const fn output(&self) -> Planes {
        self.image.resized(1, 1)
    }

    const fn inputs(&self) -> usize {
        self.channels * self.image.width() * self.image.height()
    }
}

impl Layer for Dense {
    type Weights = DenseWeights;

    fn weights(&self, _level: Level, weights: &[f32], _backward: bool) -> DenseWeights {
        assert_eq!(weights.len(), self.outputs * self.inputs());
        assert!(self.inputs().is_multiple_of(LANES), "{} samples", self.inputs());
        let offsets = (0..self.outputs).map(|o| o * self.inputs()).collect();
        DenseWeights { values: weights.to_vec(), offsets }
    }

    fn forward(
        &self,
        level: Level,
        image: &[f32],
        weights: &DenseWeights,
        bias: &[f32],
        out: &mut [f32],
        scratch: &mut LayerScratch,
    ) {
        let samples = room(&mut scratch.planes, self.inputs());
        self.image.collect(image, samples);
        let sums = room(&mut scratch.sums, self.outputs);
        run_lanes(
            level,
            Dots {
                left: &weights.values,
                first: 0,
                stride: self.inputs(),
                rows: self.outputs,
                source: samples,
                offsets: &[0],
                columns: self.inputs(),
                out: sums,
            },
        );
        for (sum, bias) in sums.iter_mut().zip(bias) {
            *sum += bias;
            if self.activation == Activation::Relu {
                *sum = sum.max(0.0);
            }
        }
        self.output().spread(sums, out);
    }

    fn backward(
        &self,
        level: Level,
        image: &[f32],
        weights: &DenseWeights,
        slopes: &[f32],
        gradients: &mut Gradients<'_>,
        scratch: &mut LayerScratch,
    ) {
        let inputs = self.inputs();
        let mut of_outputs = vec![0.0; self.outputs];
        self.output().collect(slopes, &mut of_outputs);
        if let Some(bias) = gradients.bias.as_deref_mut() {
            bias.copy_from_slice(&of_outputs);
        }
        if let Some(gradient) = gradients.weights.as_deref_mut() {
            let samples = room(&mut scratch.planes, inputs);
            self.image.collect(image, samples);
            pack(level, self.outputs, 1, |m, _| of_outputs[m], &mut scratch.sums);
            run_lanes(
                level,
                Product {
                    weights: &scratch.sums,
                    offsets: &[0],
                    source: samples,
                    out: gradient,
                    stride: inputs,
                    rows: self.outputs,
                    columns: inputs,
                    finish: Finish::Set,
                },
            );
        }
        if let Some(gradient) = &mut gradients.image {
            let samples = room(&mut scratch.sums, inputs);
            if gradient.add {
                self.image.collect(gradient.planes, samples);
            }
            run_lanes(
                level,
                Product {
                    weights: &of_outputs,
                    offsets: &weights.offsets,
                    source: &weights.values,
                    finish: gradient.finish(),
                    out: samples,
                    stride: inputs,
                    rows: 1,
                    columns: inputs,
                },
            );
            self.image.spread(samples, gradient.planes);
        }
    }
}
