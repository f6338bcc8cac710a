//! Convolutions of networks, forward and backward, one image at a time.
//!
//! Two shapes that learning spends its time in: [`Same`] (odd kernel, stride 1, size kept) and [`Double`] (4x4 transposed,
//! stride 2, size doubled), as PyTorch defines them, bias and ReLU included. Images are f32, channels x height x width.
//! A call works on one thread; a batch is spread by giving each thread its images and its [`ConvolutionScratch`]. Every gradient of weights is
//! one image's share, to be added up in the order of the images: then no result depends on the number of threads, and
//! fused multiply-adds on every instruction set give the same bits on all of them.
//!
//! ```
//! use depthloom_kernels::convolve::{Activation, Same, ConvolutionScratch};
//! use depthloom_kernels::simd::Level;
//!
//! let same = Same { inputs: 1, outputs: 1, width: 3, height: 2, kernel: 3, activation: Activation::None };
//! let mut sum_of_nine = vec![0.0; 6];
//! let weights = same.weights(Level::best(), &[1.0; 9], false);
//! same.forward(Level::best(), &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &weights, &[0.5], &mut sum_of_nine, &mut ConvolutionScratch::default());
//! assert_eq!(sum_of_nine, [12.5, 21.5, 16.5, 12.5, 21.5, 16.5]);
//! ```

mod double;
mod planes;
mod product;
mod same;

pub use double::{Double, DoubleWeights};
pub use same::{Same, SameWeights};

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
