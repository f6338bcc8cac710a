//! The layers of networks, forward and backward, one image at a time.
//!
//! [`Same`] (odd kernel, stride 1, size kept), [`Strided`] (any stride), [`Double`] (4x4 transposed, stride 2, size
//! doubled) and [`Dense`], as PyTorch defines them, bias and ReLU included, and [`halve`]. Images are f32 in
//! [`Planes`]: lines with zeros between the rows, so that a layer reads the output of the one before where it lies. A
//! call works on one thread; a batch is spread by giving each thread its images and its [`LayerScratch`]. A gradient of
//! weights is one image's share: the caller adds the shares in the order of the images, so that no result depends on
//! the number of threads. Fused multiply-adds give the same bits on every instruction set.
//!
//! ```
//! use depthloom_kernels::convolve::{Activation, Layer, LayerScratch, Planes, Same};
//! use depthloom_kernels::simd::Level;
//!
//! let planes = Planes::new(3, 2, 1);
//! let same = Same { inputs: 1, outputs: 1, planes, kernel: 3, activation: Activation::None };
//! let weights = same.weights(Level::best(), &[1.0; 9], false);
//! let (mut image, mut out) = (planes.zeros(1), planes.zeros(1));
//! planes.spread(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &mut image);
//! same.forward(Level::best(), &image, &weights, &[0.5], &mut out, &mut LayerScratch::default());
//! let mut sum_of_nine = [0.0; 6];
//! planes.collect(&out, &mut sum_of_nine);
//! assert_eq!(sum_of_nine, [12.5, 21.5, 16.5, 12.5, 21.5, 16.5]);
//! ```

mod dense;
mod double;
mod halve;
mod planes;
mod product;
mod same;
mod strided;

use std::fmt::Debug;

pub use dense::{Dense, DenseWeights};
pub use double::{Double, DoubleWeights};
pub use halve::{halve, halve_back};
pub use planes::Planes;
pub use same::{Same, SameWeights};
pub use strided::{Strided, StridedWeights};

use crate::simd::{Level, Pass};
use product::Finish;

/// A layer with weights. Methods panic if a slice is not of the length that the sizes say.
pub trait Layer: Debug + Sync {
    /// Weights as the inner loops read them, packed once for all images of a batch.
    type Weights: Sync;

    /// Packs weights; for the gradient of the image only if `backward`.
    fn weights(&self, level: Level, weights: &[f32], backward: bool) -> Self::Weights;

    /// The output of one image.
    fn forward(
        &self,
        level: Level,
        image: &[f32],
        weights: &Self::Weights,
        bias: &[f32],
        out: &mut [f32],
        scratch: &mut LayerScratch,
    );

    /// From the gradient of the output before the activation, `slopes` (see [`before_activation`]), those that
    /// `gradients` has room for. `image` is that of the forward pass. Of weights and bias this is one image's share.
    fn backward(
        &self,
        level: Level,
        image: &[f32],
        weights: &Self::Weights,
        slopes: &[f32],
        gradients: &mut Gradients<'_>,
        scratch: &mut LayerScratch,
    );
}

/// What follows a layer's sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// Nothing.
    None,
    /// `max(x, 0)`.
    Relu,
}

impl Activation {
    fn finish(self, bias: &[f32]) -> Finish<'_> {
        match self {
            Self::None => Finish::Bias(bias),
            Self::Relu => Finish::BiasRelu(bias),
        }
    }
}

/// Turns the gradient of a layer's output into that before its activation, in place; `out` is the output.
///
/// `slopes` and `out` are planes. What lies between the rows becomes zero, as layers expect it.
pub fn before_activation(level: Level, activation: Activation, planes: &Planes, out: &[f32], slopes: &mut [f32]) {
    match activation {
        Activation::None => planes.clear_gaps(slopes),
        Activation::Relu => level.run(Mask { out, slopes }),
    }
}

struct Mask<'a> {
    out: &'a [f32],
    slopes: &'a mut [f32],
}

impl Pass for Mask<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (slope, &out) in self.slopes.iter_mut().zip(self.out) {
            *slope = if out > 0.0 { *slope } else { 0.0 };
        }
    }
}

/// The gradients that are wanted.
#[derive(Debug, Default)]
pub struct Gradients<'a> {
    /// Of the image that came in.
    pub image: Option<ImageGradient<'a>>,
    /// Of the weights, in their own order; overwritten.
    pub weights: Option<&'a mut [f32]>,
    /// Of the bias; overwritten.
    pub bias: Option<&'a mut [f32]>,
}

/// Where the gradient of an image goes. What lies between its rows is undefined afterwards.
#[derive(Debug)]
pub struct ImageGradient<'a> {
    /// The planes.
    pub planes: &'a mut [f32],
    /// Whether it is added to what is there; otherwise it is overwritten.
    pub add: bool,
}

impl ImageGradient<'_> {
    const fn finish(&self) -> Finish<'static> {
        if self.add { Finish::Add } else { Finish::Set }
    }
}

/// Memory that a thread keeps between calls.
#[derive(Debug, Default)]
pub struct LayerScratch {
    planes: Vec<f32>,
    sums: Vec<f32>,
}

/// At least `count` samples of whatever content.
fn room(memory: &mut Vec<f32>, count: usize) -> &mut [f32] {
    if memory.len() < count {
        memory.resize(count, 0.0);
    }
    &mut memory[..count]
}

/// The gradients of the biases: sums over the lines of `slopes`.
fn bias_gradient(planes: &Planes, slopes: &[f32], bias: &mut [f32]) {
    for (channel, bias) in bias.iter_mut().enumerate() {
        *bias = sum(&slopes[planes.origin(channel)..][..planes.columns()]);
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
