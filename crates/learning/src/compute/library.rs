//! Networks computed by burn: on a GPU, and as the reference of the tests.

use burn::tensor::ops::{ConvOptions, ConvTransposeOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, TensorData, activation, module};

use super::Input;
use crate::networks::{Act, Architecture, Builder, Conv, ParameterLayout, Size};

/// The library with its version, which is part of the keys of networks that a GPU trained.
pub(crate) const VERSION: &str = "burn 0.22.1";

/// Computes a network for images of any size.
#[derive(Debug)]
pub(crate) struct Engine<A> {
    network: A,
    layout: ParameterLayout,
    device: Device,
}

impl<A: Architecture> Engine<A> {
    #[cfg(feature = "gpu")]
    pub(crate) fn new(network: A, layout: &ParameterLayout) -> Self {
        Self::on(Device::wgpu(burn::tensor::DeviceKind::default()), network, layout)
    }

    pub(crate) fn on(device: Device, network: A, layout: &ParameterLayout) -> Self {
        Self { network, layout: layout.clone(), device }
    }

    /// The maps of a batch, batch x maps x rows x columns in [0, 1], with parameters in the order of the layout.
    pub(crate) fn maps(&mut self, input: &Input, parameters: &[Vec<f32>]) -> Vec<f32> {
        let parameters: Vec<_> = parameters.iter().map(|values| flat(values, &self.device)).collect();
        host(&forward(self.network, &images(input, &self.device), &parameters))
    }

    /// The maps of a batch, and the gradients of the learned parameters for the gradient of the maps that `slopes`
    /// makes of them.
    pub(crate) fn gradients<T>(
        &mut self,
        input: &Input,
        parameters: &[Vec<f32>],
        slopes: impl FnOnce(&[f32]) -> (Vec<f32>, T),
    ) -> (Vec<Option<Vec<f32>>>, T) {
        let device = self.device.clone().autodiff();
        let tracked: Vec<Tensor<1>> = parameters
            .iter()
            .zip(&self.layout.parameters)
            .map(|(values, parameter)| {
                let values = flat(values, &device);
                if parameter.frozen { values } else { values.require_grad() }
            })
            .collect();
        let map = forward(self.network, &images(input, &device), &tracked);
        let (slopes, more) = slopes(&host(&map));
        // The gradient of `map . slopes` by the map is `slopes`.
        let slopes = Tensor::<4>::from_data(TensorData::new(slopes, map.dims()), &map.device());
        let gradients = (map * slopes).sum().backward();
        let gradient = |tracked: &Tensor<1>| tracked.grad(&gradients).map(|gradient| host(&gradient));
        (tracked.iter().map(gradient).collect(), more)
    }
}

fn flat(values: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len()]), device)
}

fn images(input: &Input, device: &Device) -> Tensor<4> {
    Tensor::from_data(TensorData::new(input.values.clone(), input.shape), device)
}

fn host<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.to_data().try_into_vec().expect("networks learn in f32")
}

fn forward(network: impl Architecture, images: &Tensor<4>, parameters: &[Tensor<1>]) -> Tensor<4> {
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

impl Builder for Layers<'_> {
    type Map = Tensor<4>;

    fn conv(&mut self, _name: &str, x: &Tensor<4>, conv: Conv) -> Tensor<4> {
        let Conv { outputs, kernel, stride, pad, act, .. } = conv;
        let weight = self.next([outputs, x.dims()[1], kernel, kernel]);
        let bias = self.next([outputs]);
        let options = ConvOptions::new([stride, stride], [pad, pad], [1, 1], 1);
        let out = module::conv2d(x.clone(), weight, Some(bias), options);
        if act == Act::Relu { activation::relu(out) } else { out }
    }

    fn double(&mut self, _name: &str, x: &Tensor<4>, outputs: usize) -> Tensor<4> {
        let weight = self.next([x.dims()[1], outputs, 4, 4]);
        let bias = self.next([outputs]);
        let options = ConvTransposeOptions::new([2, 2], [1, 1], [0, 0], [1, 1], 1);
        activation::relu(module::conv_transpose2d(x.clone(), weight, Some(bias), options))
    }

    fn halve(&mut self, x: &Tensor<4>) -> Tensor<4> {
        module::max_pool2d(x.clone(), MaxPoolOptions::new([2, 2]).with_stride([2, 2]))
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
