//! A batch spread over threads, image by image; gradients added up in the images' order.

use std::cell::RefCell;

use burn::backend::TensorMetadata;
use burn::backend::flex::FlexTensor;
use burn::tensor::{DType, Shape, TensorData};
use depthloom_kernels::convolve::{ConvolutionScratch, Gradients};
use rayon::prelude::*;

/// What burn stores of an operation for its backward pass.
#[derive(Clone, Debug)]
pub(super) struct ForwardState {
    pub(crate) x: FlexTensor,
    pub(crate) weight: FlexTensor,
    pub(crate) out: FlexTensor,
    pub(crate) relu: bool,
}

/// Batch, channels, rows, columns of a tensor.
pub(super) fn nchw(tensor: &FlexTensor) -> [usize; 4] {
    let shape = tensor.shape();
    [shape[0], shape[1], shape[2], shape[3]]
}

pub(super) fn in_order(tensor: FlexTensor) -> FlexTensor {
    assert_eq!(tensor.dtype(), DType::F32, "networks learn in f32");
    if tensor.as_slice::<f32>().is_some() { tensor } else { tensor.to_contiguous() }
}

pub(super) fn samples(tensor: &FlexTensor) -> &[f32] {
    tensor.as_slice().expect("`in_order` put them in order")
}

pub(super) fn tensor(values: Vec<f32>, shape: impl Into<Shape>) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, shape))
}

/// Runs `f` with this thread's scratch memory, state from call to call.
fn with_scratch<T>(f: impl FnOnce(&mut ConvolutionScratch) -> T) -> T {
    thread_local! {
        static SCRATCH: RefCell<ConvolutionScratch> = RefCell::default();
    }
    SCRATCH.with_borrow_mut(f)
}

pub(super) fn forward(
    x: &FlexTensor,
    out_shape: [usize; 4],
    f: impl Fn(&[f32], &mut [f32], &mut ConvolutionScratch) + Sync,
) -> FlexTensor {
    let [_, channels, rows, columns] = nchw(x);
    let mut out = vec![0.0; out_shape.iter().product()];
    let area_out = out_shape[1..].iter().product();
    out.par_chunks_exact_mut(area_out)
        .zip(samples(x).par_chunks_exact(channels * rows * columns))
        .with_max_len(1)
        .for_each(|(out, image)| with_scratch(|scratch| f(image, out, scratch)));
    tensor(out, out_shape)
}

#[derive(Clone, Copy, Debug)]
pub(super) struct NeededGradients {
    pub(crate) x: bool,
    pub(crate) weight: bool,
    pub(crate) bias: bool,
}

/// Every image backwards through `f(image, out, slope, gradients, scratch)`: the gradients of x, weight and bias.
pub(super) fn backward(
    state: &ForwardState,
    slope: &FlexTensor,
    needed: NeededGradients,
    biases: usize,
    f: impl Fn(&[f32], &[f32], &[f32], &mut Gradients<'_>, &mut ConvolutionScratch) + Sync,
) -> [Option<FlexTensor>; 3] {
    let [batch, channels, rows, columns] = nchw(&state.x);
    let area = channels * rows * columns;
    let area_out: usize = nchw(&state.out)[1..].iter().product();
    let count = samples(&state.weight).len();
    let mut of_x = vec![0.0; if needed.x { batch * area } else { 0 }];
    let mut of_weight = vec![0.0; if needed.weight { batch * count } else { 0 }];
    let mut of_bias = vec![0.0; if needed.bias { batch * biases } else { 0 }];
    let places = pieces(&mut of_x, area, batch)
        .zip(pieces(&mut of_weight, count, batch))
        .zip(pieces(&mut of_bias, biases, batch))
        .zip(samples(&state.x).chunks_exact(area))
        .zip(samples(&state.out).chunks_exact(area_out).zip(samples(slope).chunks_exact(area_out)));
    let places: Vec<_> = places.collect();
    places.into_par_iter().with_max_len(1).for_each(|((((image, weights), bias), x), (out, slope))| {
        let mut gradients = Gradients { image, weights, bias };
        with_scratch(|scratch| f(x, out, slope, &mut gradients, scratch));
    });
    let shape = |needed: bool, values: Vec<f32>, like: &FlexTensor| needed.then(|| tensor(values, like.shape()));
    let of_bias = needed.bias.then(|| tensor(added(of_bias, biases), [biases]));
    [shape(needed.x, of_x, &state.x), shape(needed.weight, added(of_weight, count), &state.weight), of_bias]
}

/// One piece of `each` samples an image, or none for any.
fn pieces(values: &mut [f32], each: usize, batch: usize) -> impl Iterator<Item = Option<&mut [f32]>> {
    let mut rest = values;
    (0..batch).map(move |_| {
        let piece;
        (piece, rest) = std::mem::take(&mut rest).split_at_mut_checked(each)?;
        Some(piece)
    })
}

/// The sum of the images' shares, in their order.
fn added(mut shares: Vec<f32>, each: usize) -> Vec<f32> {
    if each == 0 || shares.is_empty() {
        return shares;
    }
    let (sum, rest) = shares.split_at_mut(each);
    for share in rest.chunks_exact(each) {
        sum.iter_mut().zip(share).for_each(|(sum, share)| *sum += share);
    }
    shares.truncate(each);
    shares
}
