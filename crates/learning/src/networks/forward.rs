//! A network computed with the training library.

use burn::tensor::ops::ConvOptions;
use burn::tensor::{Tensor, activation, module};
use depthloom_kernels::convolve::Activation;

use super::{Act, Architecture, Builder, Conv, Size};
use crate::ops;

/// The maps of a batch of images, batch x maps x rows x columns in [0, 1].
///
/// `images` is batch x planes x height x width; `parameters` are those of [`layout`](super::layout()), in its
/// order and flat.
pub(crate) fn forward(network: impl Architecture, images: &Tensor<4>, parameters: &[Tensor<1>]) -> Tensor<4> {
    let [_, _, height, width] = images.dims();
    let mut layers = Layers { size: Size { width, height }, parameters: parameters.iter() };
    let maps = network.build(&mut layers, images);
    if maps.len() == 1 { maps[0].clone() } else { Tensor::cat(maps, 1) }
}

struct Layers<'a> {
    size: Size,
    parameters: std::slice::Iter<'a, Tensor<1>>,
}

impl Layers<'_> {
    fn next<const D: usize>(&mut self, shape: [usize; D]) -> Tensor<D> {
        self.parameters.next().expect("the layout lists every parameter").clone().reshape(shape)
    }
}

const fn kind(act: Act) -> Activation {
    match act {
        Act::None => Activation::None,
        Act::Relu => Activation::Relu,
    }
}

impl Builder for Layers<'_> {
    type Map = Tensor<4>;

    fn conv(&mut self, _name: &str, x: &Tensor<4>, conv: Conv) -> Tensor<4> {
        let Conv { outputs, kernel, stride, pad, act, .. } = conv;
        let weight = self.next([outputs, x.dims()[1], kernel, kernel]);
        let bias = self.next([outputs]);
        if conv.keeps_size() {
            return ops::same(x.clone(), weight, bias, kind(act));
        }
        let options = ConvOptions::new([stride, stride], [pad, pad], [1, 1], 1);
        let out = module::conv2d(x.clone(), weight, Some(bias), options);
        if act == Act::Relu { activation::relu(out) } else { out }
    }

    fn double(&mut self, _name: &str, x: &Tensor<4>, outputs: usize) -> Tensor<4> {
        let weight = self.next([x.dims()[1], outputs, 4, 4]);
        let bias = self.next([outputs]);
        ops::double(x.clone(), weight, bias, Activation::Relu)
    }

    fn halve(&mut self, x: &Tensor<4>) -> Tensor<4> {
        ops::halve(x.clone())
    }

    fn join(&mut self, a: &Tensor<4>, b: &Tensor<4>) -> Tensor<4> {
        Tensor::cat(vec![a.clone(), b.clone()], 1)
    }

    fn dense(&mut self, _name: &str, x: &Tensor<4>, outputs: usize, act: Act, _bias: f32) -> Tensor<4> {
        let [batch, channels, height, width] = x.dims();
        let inputs = channels * height * width;
        let weight: Tensor<2> = self.next([outputs, inputs]);
        let bias: Tensor<1> = self.next([outputs]);
        let out = x.clone().reshape([batch, inputs]).matmul(weight.transpose()) + bias.unsqueeze();
        let out = if act == Act::Relu { activation::relu(out) } else { out };
        out.reshape([batch, outputs, 1, 1])
    }

    fn as_map(&mut self, x: &Tensor<4>, size: Size) -> Tensor<4> {
        let batch = x.dims()[0];
        x.clone().reshape([batch, 1, size.height, size.width])
    }

    fn sigmoid(&mut self, x: &Tensor<4>) -> Tensor<4> {
        activation::sigmoid(x.clone())
    }

    fn size(&self) -> Size {
        self.size
    }
}
