//! A network written as ONNX.

use super::{Act, Architecture, Builder, Conv, Interface, Size};
use crate::onnx::{GraphBuilder, Metadata, Tensor, Weights};

/// The ONNX file of `network` for images of `size` with the parameters `values`, in the order of
/// [`layout`](super::layout()).
///
/// Its input is batch x planes x height x width, for most networks the `image`, RGB in [0, 1]; its outputs, batch x
/// maps x rows x columns, are named after their meaning.
pub(crate) fn export(network: impl Architecture, size: Size, values: &[Vec<f32>], training_key: &str) -> Vec<u8> {
    let mut graph = GraphBuilder::new(network.name());
    let Interface { input, planes, normalisation, outputs } = network.interface();
    let image = graph.input(input, &[planes, size.height, size.width]);
    let mut writer = Writer { size, graph, values: values.iter() };
    let maps = network.build(&mut writer, &image);
    assert!(writer.values.next().is_none(), "every parameter belongs to a layer");
    let mut graph = writer.graph;
    let scaled: Vec<(Tensor, &str)> =
        maps.iter().zip(&outputs).map(|(map, output)| (graph.scale(*map, output.scale), output.name)).collect();
    let metadata = Metadata { size: [size.width, size.height], normalisation, training_key };
    graph.finish(&scaled, &metadata)
}

struct Writer<'a> {
    size: Size,
    graph: GraphBuilder,
    values: std::slice::Iter<'a, Vec<f32>>,
}

impl<'a> Writer<'a> {
    fn next(&mut self) -> &'a [f32] {
        self.values.next().expect("the layout lists every parameter")
    }

    fn channels(&self, x: Tensor) -> usize {
        self.graph.dims(x)[0]
    }

    fn activated(&mut self, x: Tensor, act: Act) -> Tensor {
        match act {
            Act::None => x,
            Act::Relu => self.graph.relu(x),
        }
    }
}

impl Builder for Writer<'_> {
    type Map = Tensor;

    fn conv(&mut self, name: &str, x: &Tensor, conv: Conv) -> Tensor {
        let Conv { outputs, kernel, stride, pad, act, .. } = conv;
        let (values, bias) = (self.next(), self.next());
        let weights = Weights { dims: [outputs, self.channels(*x), kernel, kernel], values };
        let out = self.graph.conv2d(name, *x, weights, bias, stride, pad);
        self.activated(out, act)
    }

    fn double(&mut self, name: &str, x: &Tensor, outputs: usize) -> Tensor {
        let (values, bias) = (self.next(), self.next());
        let weights = Weights { dims: [self.channels(*x), outputs, 4, 4], values };
        let out = self.graph.conv_transpose2d(name, *x, weights, bias, 2, 1);
        self.graph.relu(out)
    }

    fn halve(&mut self, x: &Tensor) -> Tensor {
        self.graph.max_pool(*x, 2, 2, 0)
    }

    fn join(&mut self, a: &Tensor, b: &Tensor) -> Tensor {
        self.graph.concat(&[*a, *b])
    }

    fn dense(&mut self, name: &str, x: &Tensor, _outputs: usize, act: Act, _bias: f32) -> Tensor {
        let (weights, bias) = (self.next(), self.next());
        let out = self.graph.linear(name, *x, weights, bias);
        self.activated(out, act)
    }

    fn as_map(&mut self, x: &Tensor, size: Size) -> Tensor {
        self.graph.reshape(*x, &[1, size.height, size.width])
    }

    fn sigmoid(&mut self, x: &Tensor) -> Tensor {
        self.graph.sigmoid(*x)
    }

    fn size(&self) -> Size {
        self.size
    }
}
