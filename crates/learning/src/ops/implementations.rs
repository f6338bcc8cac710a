//! The operations on the CPU back end, with and without gradients.

use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Flex};
use depthloom_kernels::convolve::{Double, Same};

use super::batch::in_order;
use super::{Convolutions, convolution, halve};

impl Convolutions for Flex {
    fn same(x: FloatTensor<Self>, weight: FloatTensor<Self>, bias: FloatTensor<Self>, relu: bool) -> FloatTensor<Self> {
        convolution::run::<Same>(x, weight, bias, relu)
    }

    fn double(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        relu: bool,
    ) -> FloatTensor<Self> {
        convolution::run::<Double>(x, weight, bias, relu)
    }

    fn halve(x: FloatTensor<Self>) -> FloatTensor<Self> {
        halve::run(&in_order(x))
    }
}

impl<C: CheckpointStrategy> Convolutions for Autodiff<Flex, C> {
    fn same(x: FloatTensor<Self>, weight: FloatTensor<Self>, bias: FloatTensor<Self>, relu: bool) -> FloatTensor<Self> {
        convolution::tracked::<Same, C>(x, weight, bias, relu)
    }

    fn double(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        relu: bool,
    ) -> FloatTensor<Self> {
        convolution::tracked::<Double, C>(x, weight, bias, relu)
    }

    fn halve(x: FloatTensor<Self>) -> FloatTensor<Self> {
        halve::tracked::<C>(x)
    }
}
