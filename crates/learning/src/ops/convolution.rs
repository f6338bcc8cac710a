//! A convolution with its gradients: what `same` and `double` have in common.

use std::fmt::Debug;
use std::marker::PhantomData;

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients as Grads;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Flex};
use depthloom_kernels::convolve::{
    Activation, ConvolutionScratch, Double, DoubleWeights, Gradients, Same, SameWeights,
};
use depthloom_kernels::simd::Level;

use super::batch::{Kept, Wanted, backward, forward, in_order, nchw, samples};

/// A convolution of one image.
pub(super) trait Convolution: Debug + Sized + Sync + 'static {
    /// Weights as its loops read them.
    type Weights: Sync;

    /// The one of an image (batch, channels, rows, columns) and weights (four sides).
    fn of(image: [usize; 4], weight: [usize; 4], activation: Activation) -> Self;
    /// Channels, rows and columns of its output.
    fn out(&self) -> [usize; 3];
    /// Packs weights.
    fn pack(&self, level: Level, weight: &[f32], backward: bool) -> Self::Weights;
    /// One image forward.
    fn forward(
        &self,
        level: Level,
        image: &[f32],
        weights: &Self::Weights,
        bias: &[f32],
        out: &mut [f32],
        scratch: &mut ConvolutionScratch,
    );
    /// One image backwards.
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

macro_rules! convolution {
    ($kernel:ident, $weights:ident) => {
        type Weights = $weights;

        fn pack(&self, level: Level, weight: &[f32], backward: bool) -> $weights {
            self.weights(level, weight, backward)
        }

        fn forward(
            &self,
            level: Level,
            image: &[f32],
            weights: &$weights,
            bias: &[f32],
            out: &mut [f32],
            scratch: &mut ConvolutionScratch,
        ) {
            $kernel::forward(self, level, image, weights, bias, out, scratch);
        }

        fn backward(
            &self,
            level: Level,
            image: &[f32],
            weights: &$weights,
            out: &[f32],
            slope: &[f32],
            gradients: &mut Gradients<'_>,
            scratch: &mut ConvolutionScratch,
        ) {
            $kernel::backward(self, level, image, weights, out, slope, gradients, scratch);
        }
    };
}

impl Convolution for Same {
    convolution!(Same, SameWeights);

    fn of([_, inputs, height, width]: [usize; 4], [outputs, _, kernel, _]: [usize; 4], activation: Activation) -> Self {
        Self { inputs, outputs, width, height, kernel, activation }
    }

    fn out(&self) -> [usize; 3] {
        [self.outputs, self.height, self.width]
    }
}

impl Convolution for Double {
    convolution!(Double, DoubleWeights);

    fn of([_, inputs, height, width]: [usize; 4], [_, outputs, _, _]: [usize; 4], activation: Activation) -> Self {
        Self { inputs, outputs, width, height, activation }
    }

    fn out(&self) -> [usize; 3] {
        [self.outputs, self.height * 2, self.width * 2]
    }
}

const fn activation(relu: bool) -> Activation {
    if relu { Activation::Relu } else { Activation::None }
}

/// The output of a batch.
pub(super) fn run<K: Convolution>(x: FlexTensor, weight: FlexTensor, bias: FlexTensor, relu: bool) -> FlexTensor {
    run_in_order::<K>(&in_order(x), &in_order(weight), &in_order(bias), relu)
}

fn run_in_order<K: Convolution>(x: &FlexTensor, weight: &FlexTensor, bias: &FlexTensor, relu: bool) -> FlexTensor {
    let (level, kernel) = (Level::best(), K::of(nchw(x), nchw(weight), activation(relu)));
    let packed = kernel.pack(level, samples(weight), false);
    let ([channels, rows, columns], bias) = (kernel.out(), samples(bias));
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
        OpsKind::Tracked(prep) => prep.finish(Kept { x, weight, out: out.clone(), relu }, out),
        OpsKind::UnTracked(prep) => prep.finish(out),
    }
}

#[derive(Debug)]
struct Step<K>(PhantomData<fn() -> K>);

impl<K: Convolution> Backward<Flex, 3> for Step<K> {
    type State = Kept;

    fn backward(self, ops: Ops<Kept, 3>, grads: &mut Grads, _checkpointer: &mut Checkpointer) {
        let [x, weight, bias] = &ops.parents;
        let wanted = Wanted { x: x.is_some(), weight: weight.is_some(), bias: bias.is_some() };
        let (kept, level) = (ops.state, Level::best());
        let slope = in_order(grads.consume::<Flex>(&ops.node));
        let kernel = K::of(nchw(&kept.x), nchw(&kept.weight), activation(kept.relu));
        let packed = kernel.pack(level, samples(&kept.weight), wanted.x);
        let found = backward(&kept, &slope, wanted, kernel.out()[0], |image, out, slope, gradients, scratch| {
            kernel.backward(level, image, &packed, out, slope, gradients, scratch);
        });
        for (node, gradient) in ops.parents.into_iter().zip(found) {
            if let (Some(node), Some(gradient)) = (node, gradient) {
                grads.register::<Flex>(node.id, gradient);
            }
        }
    }
}
