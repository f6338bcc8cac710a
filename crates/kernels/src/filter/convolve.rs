//! Convolutions of networks, forward and backward, one image at a time.
//!
//! Two shapes that learning spends its time in: [`Same`] (odd kernel, stride 1, size kept) and [`Double`] (4x4
//! transposed, stride 2, size doubled), as PyTorch defines them, bias and ReLU included. Images are f32, channels x
//! height x width. A call works on one thread; a batch is spread by giving each thread its images and its
//! [`ConvolutionScratch`]. A gradient of weights is one image's share: the caller adds the shares in the order of the
//! images, so that no result depends on the number of threads. Fused multiply-adds give the same bits on every
//! instruction set.
//!
//! ```
//! use depthloom_kernels::convolve::{Activation, Convolution, ConvolutionScratch, Same};
//! use depthloom_kernels::simd::Level;
//!
//! let same = Same { inputs: 1, outputs: 1, width: 3, height: 2, kernel: 3, activation: Activation::None };
//! let mut sum_of_nine = vec![0.0; 6];
//! let weights = same.weights(Level::best(), &[1.0; 9], false);
//! let image = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
//! same.forward(Level::best(), &image, &weights, &[0.5], &mut sum_of_nine, &mut ConvolutionScratch::default());
//! assert_eq!(sum_of_nine, [12.5, 21.5, 16.5, 12.5, 21.5, 16.5]);
//! ```

mod double;
mod planes;
mod product;
mod same;

use std::fmt::Debug;

pub use double::{Double, DoubleWeights};
pub use same::{Same, SameWeights};

use crate::simd::Level;
use planes::Planes;
use product::Product;

/// A convolution of one image, channels x height x width. Methods panic if a slice is not of the length that the sizes
/// say.
pub trait Convolution: Copy + Debug + Sync + Sized + 'static {
    /// Weights as the inner loops read them, packed once for all images of a batch.
    type Weights: Sync;

    /// The convolution of images of shape `[channels, height, width]` with weights of four sides.
    fn new(image: [usize; 3], weights: [usize; 4], activation: Activation) -> Self;

    /// Channels, height and width of the output.
    fn output(&self) -> [usize; 3];

    /// Packs weights; for the backward pass only if `backward`.
    fn weights(&self, level: Level, weights: &[f32], backward: bool) -> Self::Weights;

    /// The output of one image.
    fn forward(
        &self,
        level: Level,
        image: &[f32],
        weights: &Self::Weights,
        bias: &[f32],
        out: &mut [f32],
        scratch: &mut ConvolutionScratch,
    );

    /// From the gradient of the output, `slope`, those that `gradients` has room for.
    ///
    /// `image` and `out` are those of the forward pass. Of weights and bias this is one image's share.
    #[expect(clippy::too_many_arguments, reason = "an operation and everything it is of")]
    fn backward(
        &self,
        level: Level,
        image: &[f32],
        weights: &Self::Weights,
        out: &[f32],
        slope: &[f32],
        gradients: &mut Gradients<'_>,
        scratch: &mut ConvolutionScratch,
    );
}

/// What follows a convolution's sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// Nothing.
    None,
    /// `max(x, 0)`.
    Relu,
}

impl Activation {
    /// The gradient before the activation, from its output and the gradient after it.
    fn slope(self, out: &[f32], slope: &[f32], to: &mut [f32]) {
        match self {
            Self::None => to.copy_from_slice(slope),
            Self::Relu => {
                for ((to, &out), &slope) in to.iter_mut().zip(out).zip(slope) {
                    *to = if out > 0.0 { slope } else { 0.0 };
                }
            }
        }
    }
}

/// The gradients that are wanted; each is overwritten.
#[derive(Debug, Default)]
pub struct Gradients<'a> {
    /// Of the image that came in.
    pub image: Option<&'a mut [f32]>,
    /// Of the weights, in their own order.
    pub weights: Option<&'a mut [f32]>,
    /// Of the bias.
    pub bias: Option<&'a mut [f32]>,
}

/// Memory that a thread keeps between calls.
#[derive(Debug, Default)]
pub struct ConvolutionScratch {
    source: Vec<f32>,
    slopes: Vec<f32>,
    sums: Vec<f32>,
    offsets: Vec<usize>,
}

impl ConvolutionScratch {
    fn room(&mut self, sums: usize) {
        if self.sums.len() < sums {
            self.sums.resize(sums, 0.0);
        }
    }

    /// The gradient of an image of `channels`, from the slopes and their taps' offsets.
    fn image_gradient(
        &mut self,
        level: Level,
        planes: &Planes,
        weights: &[f32],
        channels: usize,
        gradient: &mut [f32],
    ) {
        let columns = planes.columns();
        self.room(channels * columns);
        let Self { slopes, sums, offsets, .. } = self;
        let (source, out) = (&slopes[..], &mut sums[..]);
        level.run_lanes(Product { weights, offsets, source, out, stride: columns, rows: channels, columns });
        planes.collect(sums, gradient);
    }
}

/// A sum in sixteen lanes, whose halves are then added until one is left.
fn sum(values: &[f32]) -> f32 {
    const LANES: usize = crate::simd::LANES;
    let (vectors, rest) = values.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for vector in vectors {
        lanes.iter_mut().zip(vector).for_each(|(lane, value)| *lane += value);
    }
    lanes.iter_mut().zip(rest).for_each(|(lane, value)| *lane += value);
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            lanes[i] += lanes[i + half];
        }
        half /= 2;
    }
    lanes[0]
}

#[cfg(test)]
mod tests;
