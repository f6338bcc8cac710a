//! A convolution with its gradients: what `same` and `double` have in common.

use std::marker::PhantomData;

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients as Grads;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Flex};
use depthloom_kernels::convolve::{Activation, Convolution};
use depthloom_kernels::simd::Level;

use super::batch::{ForwardState, NeededGradients, backward, forward, in_order, nchw, samples};

fn kernel<K: Convolution>(x: &FlexTensor, weight: &FlexTensor, relu: bool) -> K {
    let [_, channels, height, width] = nchw(x);
    K::new([channels, height, width], nchw(weight), if relu { Activation::Relu } else { Activation::None })
}

pub(super) fn run<K: Convolution>(x: FlexTensor, weight: FlexTensor, bias: FlexTensor, relu: bool) -> FlexTensor {
    run_in_order::<K>(&in_order(x), &in_order(weight), &in_order(bias), relu)
}

fn run_in_order<K: Convolution>(x: &FlexTensor, weight: &FlexTensor, bias: &FlexTensor, relu: bool) -> FlexTensor {
    let (level, kernel) = (Level::best(), kernel::<K>(x, weight, relu));
    let packed = kernel.weights(level, samples(weight), false);
    let ([channels, rows, columns], bias) = (kernel.output(), samples(bias));
    forward(x, [nchw(x)[0], channels, rows, columns], |image, out, scratch| {
        kernel.forward(level, image, &packed, bias, out, scratch);
    })
}

/// The output of a batch, recorded for the backward pass.
pub(super) fn tracked<K: Convolution, C: CheckpointStrategy>(
    x: FloatTensor<Autodiff<Flex, C>>,
    weight: FloatTensor<Autodiff<Flex, C>>,
    bias: FloatTensor<Autodiff<Flex, C>>,
    relu: bool,
) -> FloatTensor<Autodiff<Flex, C>> {
    let ((x, x_node), (weight, weight_node), (bias, bias_node)) =
        (x.into_parts(), weight.into_parts(), bias.into_parts());
    let (x, weight) = (in_order(x), in_order(weight));
    let out = run_in_order::<K>(&x, &weight, &in_order(bias), relu);
    match Step::<K>(PhantomData).prepare::<C>([x_node, weight_node, bias_node]).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(ForwardState { x, weight, out: out.clone(), relu }, out),
        OpsKind::UnTracked(prep) => prep.finish(out),
    }
}

#[derive(Debug)]
struct Step<K>(PhantomData<fn() -> K>);

impl<K: Convolution> Backward<Flex, 3> for Step<K> {
    type State = ForwardState;

    fn backward(self, ops: Ops<ForwardState, 3>, grads: &mut Grads, _checkpointer: &mut Checkpointer) {
        let [x, weight, bias] = &ops.parents;
        let needed = NeededGradients { x: x.is_some(), weight: weight.is_some(), bias: bias.is_some() };
        let (kept, level) = (ops.state, Level::best());
        let slope = in_order(grads.consume::<Flex>(&ops.node));
        let kernel = kernel::<K>(&kept.x, &kept.weight, kept.relu);
        let packed = kernel.weights(level, samples(&kept.weight), needed.x);
        let found = backward(&kept, &slope, needed, kernel.output()[0], |image, out, slope, gradients, scratch| {
            kernel.backward(level, image, &packed, out, slope, gradients, scratch);
        });
        for (node, gradient) in ops.parents.into_iter().zip(found) {
            if let (Some(node), Some(gradient)) = (node, gradient) {
                grads.register::<Flex>(node.id, gradient);
            }
        }
    }
}
