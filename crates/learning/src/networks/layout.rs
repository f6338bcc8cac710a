//! The parameters of a network: names, shapes, and what they begin with.

use super::{Act, Architecture, Builder, Conv, Size};
use depthloom_random::SplitMix64;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Parameter {
    /// `<layer>.weight` or `<layer>.bias`.
    pub(crate) name: String,
    /// Its shape: of a convolution outputs x inputs x rows x columns, of a transposed one inputs x outputs x rows x
    /// columns, of a dense layer outputs x inputs, of a bias its length.
    pub(crate) shape: Vec<usize>,
    /// Whether it is learned or kept.
    pub(crate) frozen: bool,
    start: Start,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Start {
    Constant(f32),
    /// Uniform within this.
    Uniform(f32),
}

impl Parameter {
    pub(crate) fn len(&self) -> usize {
        self.shape.iter().product()
    }
}

#[derive(Clone, Debug)]
pub(crate) struct ParameterLayout {
    pub(crate) parameters: Vec<Parameter>,
    /// The size of its map.
    pub(crate) map: Size,
}

impl ParameterLayout {
    /// Values to begin with: Glorot's uniform distribution for weights, constants for biases (Glorot, Bengio 2010; what
    /// Keras does).
    pub(crate) fn start(&self, seed: u64) -> Vec<Vec<f32>> {
        let mut random = SplitMix64::new(seed);
        let values = |parameter: &Parameter| match parameter.start {
            Start::Constant(value) => vec![value; parameter.len()],
            Start::Uniform(limit) => (0..parameter.len()).map(|_| (random.unit() * 2.0 - 1.0) * limit).collect(),
        };
        self.parameters.iter().map(values).collect()
    }
}

pub(crate) fn layout(network: impl Architecture, size: Size) -> ParameterLayout {
    let mut lister = Lister { size, parameters: Vec::new() };
    let maps = network.build(&mut lister, &Shape { channels: network.interface().planes, size });
    ParameterLayout { parameters: lister.parameters, map: maps[0].size }
}

#[derive(Clone, Copy)]
struct Shape {
    channels: usize,
    size: Size,
}

struct Lister {
    size: Size,
    parameters: Vec<Parameter>,
}

impl Lister {
    /// Weights that sum over `reach.0` inputs and are read by `reach.1` outputs, and a bias.
    fn layer(&mut self, name: &str, shape: Vec<usize>, reach: (usize, usize), outputs: usize, frozen: bool, bias: f32) {
        let limit = (6.0 / (reach.0 + reach.1) as f64).sqrt() as f32;
        let named = |what: &str| format!("{name}.{what}");
        self.parameters.push(Parameter { name: named("weight"), shape, frozen, start: Start::Uniform(limit) });
        let start = Start::Constant(bias);
        self.parameters.push(Parameter { name: named("bias"), shape: vec![outputs], frozen, start });
    }
}

impl Builder for Lister {
    type Map = Shape;

    fn conv(&mut self, name: &str, x: &Shape, conv: Conv) -> Shape {
        let Conv { outputs, kernel, stride, pad, frozen, bias, .. } = conv;
        let taps = kernel * kernel;
        let shape = vec![outputs, x.channels, kernel, kernel];
        self.layer(name, shape, (x.channels * taps, outputs * taps), outputs, frozen, bias);
        let side = |length: usize| (length + 2 * pad - kernel) / stride + 1;
        Shape { channels: outputs, size: Size { width: side(x.size.width), height: side(x.size.height) } }
    }

    fn double(&mut self, name: &str, x: &Shape, outputs: usize) -> Shape {
        self.layer(name, vec![x.channels, outputs, 4, 4], (x.channels * 16, outputs * 16), outputs, false, 0.0);
        Shape { channels: outputs, size: Size { width: x.size.width * 2, height: x.size.height * 2 } }
    }

    fn halve(&mut self, x: &Shape) -> Shape {
        Shape { channels: x.channels, size: Size { width: x.size.width / 2, height: x.size.height / 2 } }
    }

    fn join(&mut self, a: &Shape, b: &Shape) -> Shape {
        Shape { channels: a.channels + b.channels, size: a.size }
    }

    fn dense(&mut self, name: &str, x: &Shape, outputs: usize, _act: Act, bias: f32) -> Shape {
        let inputs = x.channels * x.size.width * x.size.height;
        self.layer(name, vec![outputs, inputs], (inputs, outputs), outputs, false, bias);
        Shape { channels: outputs, size: Size { width: 1, height: 1 } }
    }

    fn as_map(&mut self, _x: &Shape, size: Size) -> Shape {
        Shape { channels: 1, size }
    }

    fn sigmoid(&mut self, x: &Shape) -> Shape {
        *x
    }

    fn size(&self) -> Size {
        self.size
    }
}

#[cfg(test)]
mod tests {
    use super::{ParameterLayout, Size, layout};
    use crate::networks::{FusionUnet, Monocular, Network};

    #[test]
    fn networks_have_the_sizes_they_are_known_for() {
        let size = Size { width: 320, height: 96 };
        // `../shared/models/ssl_unet.onnx` has as many.
        let count = |layout: ParameterLayout| layout.parameters.iter().map(super::Parameter::len).sum::<usize>();
        assert_eq!(count(layout(Network::UnetLite.without_spread(), size)), 1_071_417);
        assert_eq!(layout(Network::UnetLite.without_spread(), size).map, size);
        assert_eq!(count(layout(Monocular { network: Network::UnetLite, spread: true }, size)), 1_071_417 + 8 * 9 + 1);
        assert_eq!(count(layout(Network::UnetTiny.without_spread(), size)), 70_791);
        // VGG-16's convolutions have 14,714,688 parameters (torchvision: `vgg16().features`).
        let vgg = layout(Network::FcnVgg16.without_spread(), size);
        let of_vgg = vgg.parameters.iter().filter(|parameter| parameter.name.starts_with("features."));
        assert_eq!(of_vgg.map(super::Parameter::len).sum::<usize>(), 14_714_688);
        assert!(vgg.parameters.iter().any(|parameter| parameter.name == "features.28.weight"));
        assert_eq!(count(layout(FusionUnet, size)), 144_187);
        assert_eq!(layout(Network::EigenCoarse.without_spread(), size).map, Size { width: 40, height: 12 });
    }

    #[test]
    fn equal_seeds_begin_equally() {
        let layout = layout(Monocular { network: Network::FcnLite, spread: true }, Size { width: 64, height: 32 });
        assert!(layout.start(3) == layout.start(3) && layout.start(3) != layout.start(4));
        let last = layout.parameters.iter().position(|parameter| parameter.name == "last.bias").unwrap();
        assert_eq!(layout.start(3)[last], [-2.0]);
    }
}
