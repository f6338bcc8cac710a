//! The maximum of 2x2 samples, with its gradient.
//!
//! Where two samples are equally large the first has the gradient, as in PyTorch; which it was is seen again from input
//! and output, so nothing but these is kept.

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind, unary};
use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Flex};
use rayon::prelude::*;

use super::batch::{in_order, nchw, samples, tensor};

/// The operation's output; `x` is in order and has even sides.
pub(super) fn run(x: &FlexTensor) -> FlexTensor {
    let [batch, channels, rows, columns] = nchw(x);
    assert!(rows.is_multiple_of(2) && columns.is_multiple_of(2), "{rows}x{columns} samples cannot be halved");
    let (half, mut out) = (columns / 2, vec![0.0; batch * channels * rows * columns / 4]);
    let planes = samples(x).par_chunks_exact(rows * columns);
    out.par_chunks_exact_mut(rows * columns / 4).zip(planes).for_each(|(out, plane)| {
        for (out, pair) in out.chunks_exact_mut(half).zip(plane.chunks_exact(2 * columns)) {
            let (above, below) = pair.split_at(columns);
            let (above, below) = (above.as_chunks::<2>().0, below.as_chunks::<2>().0);
            for ((out, above), below) in out.iter_mut().zip(above).zip(below) {
                *out = larger(larger(above[0], above[1]), larger(below[0], below[1]));
            }
        }
    });
    tensor(out, [batch, channels, rows / 2, half])
}

/// Without a branch; networks hold no NaN, and one that does has diverged anyway.
fn larger(a: f32, b: f32) -> f32 {
    if a >= b { a } else { b }
}

fn gradient(x: &FlexTensor, out: &FlexTensor, slope: &FlexTensor) -> FlexTensor {
    let [batch, channels, rows, columns] = nchw(x);
    let (half, mut gradient) = (columns / 2, vec![0.0; batch * channels * rows * columns]);
    let planes = samples(x).par_chunks_exact(rows * columns);
    let smaller = samples(out).par_chunks_exact(rows * half / 2).zip(samples(slope).par_chunks_exact(rows * half / 2));
    gradient.par_chunks_exact_mut(rows * columns).zip(planes.zip(smaller)).for_each(
        |(gradient, (plane, (out, slope)))| {
            let rows = gradient.chunks_exact_mut(2 * columns).zip(plane.chunks_exact(2 * columns));
            for ((gradient, pair), (out, slope)) in rows.zip(out.chunks_exact(half).zip(slope.chunks_exact(half))) {
                let (g_above, g_below) = gradient.split_at_mut(columns);
                let (above, below) = pair.split_at(columns);
                let to = g_above.as_chunks_mut::<2>().0.iter_mut().zip(g_below.as_chunks_mut::<2>().0);
                let from = above.as_chunks::<2>().0.iter().zip(below.as_chunks::<2>().0);
                for (((g_above, g_below), (above, below)), (&most, &slope)) in to.zip(from).zip(out.iter().zip(slope)) {
                    let mut left = slope;
                    let mut take = |sample: f32| {
                        let taken = if sample == most { left } else { 0.0 };
                        left = if sample == most { 0.0 } else { left };
                        taken
                    };
                    *g_above = [take(above[0]), take(above[1])];
                    *g_below = [take(below[0]), take(below[1])];
                }
            }
        },
    );
    tensor(gradient, [batch, channels, rows, columns])
}

#[derive(Debug)]
struct Step;

impl Backward<Flex, 1> for Step {
    /// Input and output.
    type State = (FlexTensor, FlexTensor);

    fn backward(self, ops: Ops<Self::State, 1>, gradients: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let (x, out) = ops.state;
        unary::<Flex, _>(ops.parents, ops.node, gradients, |slope| gradient(&x, &out, &in_order(slope)));
    }
}

pub(super) fn tracked<C: CheckpointStrategy>(x: FloatTensor<Autodiff<Flex, C>>) -> FloatTensor<Autodiff<Flex, C>> {
    let (x, node) = x.into_parts();
    let x = in_order(x);
    let out = run(&x);
    match Step.prepare::<C>([node]).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish((x, out.clone()), out),
        OpsKind::UnTracked(prep) => prep.finish(out),
    }
}
