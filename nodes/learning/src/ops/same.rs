//! Convolution that keeps the size, with its gradients.

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Flex};
use depthloom_kernels::convolve::Same;
use depthloom_kernels::simd::Level;

use super::batch::{Kept, Wanted, activation, backward, forward, in_order, nchw, samples};

fn operation(x: &FlexTensor, weight: &FlexTensor, relu: bool) -> Same {
    let [_, inputs, height, width] = nchw(x);
    let (outputs, kernel) = (nchw(weight)[0], nchw(weight)[2]);
    Same { inputs, outputs, width, height, kernel, activation: activation(relu) }
}

/// The operation's output; `x` and `weight` are in order.
pub(super) fn run(x: &FlexTensor, weight: &FlexTensor, bias: &FlexTensor, relu: bool) -> FlexTensor {
    let (level, op, batch) = (Level::best(), operation(x, weight, relu), nchw(x)[0]);
    let packed = op.weights(level, samples(weight), false);
    let bias = samples(bias);
    forward(x, [batch, op.outputs, op.height, op.width], |image, out, scratch| {
        op.forward(level, image, &packed, bias, out, scratch);
    })
}

#[derive(Debug)]
struct Step;

impl Backward<Flex, 3> for Step {
    type State = Kept;

    fn backward(self, ops: Ops<Kept, 3>, gradients: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let [x, weight, bias] = &ops.parents;
        let wanted = Wanted { x: x.is_some(), weight: weight.is_some(), bias: bias.is_some() };
        let (kept, level) = (ops.state, Level::best());
        let slope = in_order(gradients.consume::<Flex>(&ops.node));
        let op = operation(&kept.x, &kept.weight, kept.relu);
        let packed = op.weights(level, samples(&kept.weight), wanted.x);
        let found = backward(&kept, &slope, wanted, op.outputs, |image, out, slope, gradients, scratch| {
            op.backward(level, image, &packed, out, slope, gradients, scratch);
        });
        for (node, gradient) in ops.parents.into_iter().zip(found) {
            if let (Some(node), Some(gradient)) = (node, gradient) {
                gradients.register::<Flex>(node.id, gradient);
            }
        }
    }
}

/// The operation's output, recorded for the backward pass.
pub(super) fn tracked<C: CheckpointStrategy>(
    x: FloatTensor<Autodiff<Flex, C>>,
    weight: FloatTensor<Autodiff<Flex, C>>,
    bias: FloatTensor<Autodiff<Flex, C>>,
    relu: bool,
) -> FloatTensor<Autodiff<Flex, C>> {
    let ((x, x_node), (weight, weight_node), (bias, bias_node)) =
        (x.into_parts(), weight.into_parts(), bias.into_parts());
    let (x, weight, bias) = (in_order(x), in_order(weight), in_order(bias));
    let out = run(&x, &weight, &bias, relu);
    match Step.prepare::<C>([x_node, weight_node, bias_node]).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(Kept { x, weight, out: out.clone(), relu }, out),
        OpsKind::UnTracked(prep) => prep.finish(out),
    }
}
