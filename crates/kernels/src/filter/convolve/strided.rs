//! Convolution of any stride: the image is unfolded into one line per tap.

use super::planes::Planes;
use super::product::{Dots, Product, pack};
use super::{Activation, Gradients, Layer, LayerScratch, bias_gradient, room};
use crate::simd::{Level, run_lanes};

/// A convolution of a network's input: PyTorch's `conv2d(stride=s, padding=p)`. It has no gradient of the image.
/// Weights are outputs x inputs x kernel x kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strided {
    /// Channels in.
    pub inputs: usize,
    /// Channels out.
    pub outputs: usize,
    /// Of the image.
    pub image: Planes,
    /// Rows and columns of the kernel.
    pub kernel: usize,
    /// Step, px.
    pub stride: usize,
    /// Zeros around the image, px.
    pub border: usize,
    /// What follows the sum.
    pub activation: Activation,
}

/// The weights of [`Strided`], packed.
#[derive(Debug, Default)]
pub struct StridedWeights {
    forward: Vec<f32>,
    offsets: Vec<usize>,
}

impl Strided {
    /// The output's planes.
    #[must_use]
    pub const fn output(&self) -> Planes {
        let (width, height) = (self.image.width(), self.image.height());
        let (wide, high) = (width + 2 * self.border - self.kernel, height + 2 * self.border - self.kernel);
        self.image.resized(wide / self.stride + 1, high / self.stride + 1)
    }

    const fn depth(&self) -> usize {
        self.inputs * self.kernel * self.kernel
    }

    /// One line for each tap, as long as a line of the output.
    fn unfold<'a>(&self, image: &[f32], memory: &'a mut Vec<f32>) -> &'a [f32] {
        let (output, columns) = (self.output(), self.output().columns());
        let lines = room(memory, self.depth() * columns);
        lines.fill(0.0);
        for (k, line) in lines.chunks_exact_mut(columns).enumerate() {
            let (channel, tap) = (k / (self.kernel * self.kernel), k % (self.kernel * self.kernel));
            let (down, right) = (tap / self.kernel, tap % self.kernel);
            let rows: Vec<_> = self.image.rows(image, channel).collect();
            for (y, line) in line.chunks_exact_mut(output.row()).take(output.height()).enumerate() {
                let Some(row) = (y * self.stride + down).checked_sub(self.border).and_then(|y| rows.get(y)) else {
                    continue;
                };
                for (x, to) in line[..output.width()].iter_mut().enumerate() {
                    let from = (x * self.stride + right).checked_sub(self.border).and_then(|x| row.get(x));
                    *to = from.copied().unwrap_or(0.0);
                }
            }
        }
        lines
    }
}

impl Layer for Strided {
    type Weights = StridedWeights;

    fn weights(&self, level: Level, weights: &[f32], _backward: bool) -> StridedWeights {
        let depth = self.depth();
        assert_eq!(weights.len(), self.outputs * depth);
        let offsets = (0..depth).map(|k| k * self.output().columns()).collect();
        let mut packed = StridedWeights { offsets, ..StridedWeights::default() };
        pack(level, self.outputs, depth, |m, k| weights[m * depth + k], &mut packed.forward);
        packed
    }

    fn forward(
        &self,
        level: Level,
        image: &[f32],
        weights: &StridedWeights,
        bias: &[f32],
        out: &mut [f32],
        scratch: &mut LayerScratch,
    ) {
        let planes = self.output();
        assert_eq!(image.len(), self.inputs * self.image.plane());
        assert_eq!(out.len(), self.outputs * planes.plane());
        run_lanes(
            level,
            Product {
                weights: &weights.forward,
                offsets: &weights.offsets,
                source: self.unfold(image, &mut scratch.planes),
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
        weights: &StridedWeights,
        slopes: &[f32],
        gradients: &mut Gradients<'_>,
        scratch: &mut LayerScratch,
    ) {
        let planes = self.output();
        assert_eq!(slopes.len(), self.outputs * planes.plane());
        assert!(gradients.image.is_none(), "the image of a strided convolution is the network's input");
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
                    source: self.unfold(image, &mut scratch.planes),
                    offsets: &weights.offsets,
                    columns: planes.columns(),
                    out: gradient,
                },
            );
        }
    }
}
