//! The operations on the CPU back end, with and without gradients.

use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Flex};

use super::batch::in_order;
use super::{Convolutions, double, halve, same};

impl Convolutions for Flex {
    fn same(x: FloatTensor<Self>, weight: FloatTensor<Self>, bias: FloatTensor<Self>, relu: bool) -> FloatTensor<Self> {
        same::run(&in_order(x), &in_order(weight), &in_order(bias), relu)
    }

    fn double(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        relu: bool,
    ) -> FloatTensor<Self> {
        double::run(&in_order(x), &in_order(weight), &in_order(bias), relu)
    }

    fn halve(x: FloatTensor<Self>) -> FloatTensor<Self> {
        halve::run(&in_order(x))
    }
}

impl<C: CheckpointStrategy> Convolutions for Autodiff<Flex, C> {
    fn same(x: FloatTensor<Self>, weight: FloatTensor<Self>, bias: FloatTensor<Self>, relu: bool) -> FloatTensor<Self> {
        same::tracked::<C>(x, weight, bias, relu)
    }

    fn double(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        relu: bool,
    ) -> FloatTensor<Self> {
        double::tracked::<C>(x, weight, bias, relu)
    }

    fn halve(x: FloatTensor<Self>) -> FloatTensor<Self> {
        halve::tracked::<C>(x)
    }
}
