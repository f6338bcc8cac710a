//! Against the training library's own operations.

use burn::tensor::ops::{ConvOptions, ConvTransposeOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, TensorData, Tolerance, activation, module};
use depthloom_kernels::convolve::Activation;

fn noise<const D: usize>(seed: usize, shape: [usize; D]) -> Tensor<D> {
    frozen(seed, shape).require_grad()
}

/// As [`noise`], but without a gradient.
fn frozen<const D: usize>(seed: usize, shape: [usize; D]) -> Tensor<D> {
    let count: usize = shape.iter().product();
    let values: Vec<f32> = (0..count).map(|i| ((i * 7919 + seed * 104_729) % 2003) as f32 / 1001.0 - 1.0).collect();
    Tensor::<D>::from_data(TensorData::new(values, shape), &Device::flex().autodiff())
}

/// Output and gradients of x, weight and bias, when `slope` comes back.
fn outcome(
    operands: &(Tensor<4>, Tensor<4>, Tensor<1>),
    op: impl Fn(Tensor<4>, Tensor<4>, Tensor<1>) -> Tensor<4>,
) -> [TensorData; 4] {
    let (x, weight, bias) = operands;
    let out = op(x.clone(), weight.clone(), bias.clone());
    let slope = frozen(9, out.dims());
    let gradients = (out.clone() * slope).sum().backward();
    [
        out.into_data(),
        x.grad(&gradients).expect("x is tracked").into_data(),
        weight.grad(&gradients).expect("weight is tracked").into_data(),
        bias.grad(&gradients).expect("bias is tracked").into_data(),
    ]
}

fn equal(ours: &[TensorData; 4], theirs: &[TensorData; 4]) {
    for (ours, theirs) in ours.iter().zip(theirs) {
        ours.assert_approx_eq::<f32>(theirs, Tolerance::rel_abs(1e-4, 1e-4));
    }
}

#[test]
fn same_is_conv2d_with_its_gradients() {
    for (kernel, relu) in [(3, true), (3, false), (1, false), (5, true)] {
        let operands = (noise(1, [3, 5, 7, 21]), noise(2, [9, 5, kernel, kernel]), noise(3, [9]));
        let activate = |x| if relu { activation::relu(x) } else { x };
        let kind = if relu { Activation::Relu } else { Activation::None };
        let ours = outcome(&operands, |x, w, b| super::same(x, w, b, kind));
        let options = || ConvOptions::new([1, 1], [kernel / 2, kernel / 2], [1, 1], 1);
        equal(&ours, &outcome(&operands, |x, w, b| activate(module::conv2d(x, w, Some(b), options()))));
    }
}

#[test]
fn double_is_conv_transpose2d_with_its_gradients() {
    for kind in [Activation::None, Activation::Relu] {
        let operands = (noise(1, [3, 6, 5, 18]), noise(2, [6, 4, 4, 4]), noise(3, [4]));
        let activate = |x| if kind == Activation::Relu { activation::relu(x) } else { x };
        let ours = outcome(&operands, |x, w, b| super::double(x, w, b, kind));
        let options = || ConvTransposeOptions::new([2, 2], [1, 1], [0, 0], [1, 1], 1);
        equal(&ours, &outcome(&operands, |x, w, b| activate(module::conv_transpose2d(x, w, Some(b), options()))));
    }
}

#[test]
fn halve_is_max_pool2d_with_its_gradient() {
    let run = |op: &dyn Fn(Tensor<4>) -> Tensor<4>| {
        let x = noise(5, [2, 3, 6, 22]);
        let out = op(x.clone());
        let gradients = (out.clone() * frozen(6, out.dims())).sum().backward();
        (out.into_data(), x.grad(&gradients).expect("x is tracked").into_data())
    };
    let options = || MaxPoolOptions::new([2, 2]);
    assert!(run(&super::halve) == run(&|x| module::max_pool2d(x, options())));
}

#[test]
fn frozen_weights_get_no_gradient_and_let_it_pass() {
    let (x, weight, bias) = (noise(1, [2, 3, 4, 9]), frozen(2, [4, 3, 3, 3]), frozen(3, [4]));
    let gradients = super::same(x.clone(), weight.clone(), bias, Activation::Relu).sum().backward();
    assert!(weight.grad(&gradients).is_none());
    assert!(x.grad(&gradients).is_some());
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let operands = (noise(1, [8, 4, 12, 40]), noise(2, [8, 4, 3, 3]), noise(3, [8]));
            outcome(&operands, |x, w, b| super::same(x, w, b, Activation::Relu))
        })
    };
    let one = run(1);
    for threads in [2, 3, 8] {
        assert!(run(threads) == one, "{threads} threads gave other bits");
    }
}
