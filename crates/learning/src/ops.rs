//! Convolutions and pooling for the training library, faster on a CPU than its own.
//!
//! burn's CPU back end computes the gradient of a convolution by another, strided convolution, which takes most of a
//! training step. Its extension mechanism lets an operation bring its own gradient: here are those that networks spend
//! their time in, on top of `depthloom_kernels::convolve`, bias and ReLU included. On other back ends (a GPU) the
//! library's own operations run. What is tested: equal to the library's own operations, forward and backward (`tests`).

mod batch;
mod convolution;
mod halve;
mod implementations;

use burn::backend::{Backend, Dispatch, backend_extension, tensor::FloatTensor};
use burn::tensor::ops::{ConvOptions, ConvTransposeOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, activation, module};
use depthloom_kernels::convolve::Activation;

/// The operations added to the CPU back end. Tensors are f32, NCHW.
#[backend_extension(Flex, Autodiff)]
pub(crate) trait Convolutions: Backend {
    /// Convolution with an odd kernel, stride 1 and zero padding that keeps the size; `relu` follows.
    fn same(x: FloatTensor<Self>, weight: FloatTensor<Self>, bias: FloatTensor<Self>, relu: bool) -> FloatTensor<Self>;
    /// Transposed convolution with a 4x4 kernel, stride 2 and padding 1, which doubles the size; `relu` follows.
    fn double(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        relu: bool,
    ) -> FloatTensor<Self>;
    /// The maximum of 2x2 samples; sides are even.
    fn halve(x: FloatTensor<Self>) -> FloatTensor<Self>;
}

fn is_cpu(device: &Device) -> bool {
    *device == Device::flex() || *device == Device::flex().autodiff()
}

/// Convolution with an odd kernel (outputs x inputs x k x k), stride 1, zero padding that keeps the size.
pub(crate) fn same(x: Tensor<4>, weight: Tensor<4>, bias: Tensor<1>, activation: Activation) -> Tensor<4> {
    let relu = activation == Activation::Relu;
    if is_cpu(&x.device()) {
        let out =
            <Dispatch as Convolutions>::same(x.into_dispatch(), weight.into_dispatch(), bias.into_dispatch(), relu);
        return Tensor::from_dispatch(out);
    }
    let pad = weight.dims()[2] / 2;
    let out = module::conv2d(x, weight, Some(bias), ConvOptions::new([1, 1], [pad, pad], [1, 1], 1));
    if relu { activation::relu(out) } else { out }
}

/// Transposed convolution (inputs x outputs x 4 x 4), stride 2, padding 1: twice the rows and columns.
pub(crate) fn double(x: Tensor<4>, weight: Tensor<4>, bias: Tensor<1>, activation: Activation) -> Tensor<4> {
    let relu = activation == Activation::Relu;
    if is_cpu(&x.device()) {
        let out =
            <Dispatch as Convolutions>::double(x.into_dispatch(), weight.into_dispatch(), bias.into_dispatch(), relu);
        return Tensor::from_dispatch(out);
    }
    let options = ConvTransposeOptions::new([2, 2], [1, 1], [0, 0], [1, 1], 1);
    let out = module::conv_transpose2d(x, weight, Some(bias), options);
    if relu { activation::relu(out) } else { out }
}

/// The largest of every 2x2 samples: half the rows and columns, which are even.
pub(crate) fn halve(x: Tensor<4>) -> Tensor<4> {
    if is_cpu(&x.device()) {
        return Tensor::from_dispatch(<Dispatch as Convolutions>::halve(x.into_dispatch()));
    }
    module::max_pool2d(x, MaxPoolOptions::new([2, 2]).with_stride([2, 2]))
}

#[cfg(test)]
mod tests;
