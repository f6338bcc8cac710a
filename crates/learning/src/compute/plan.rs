//! A network as a list of operations over buffers of planes.

use std::fmt::Debug;
use std::ops::Range;

use depthloom_kernels::convolve::{Activation, Dense, Double, Gradients, Layer, LayerScratch, Planes, Same, Strided};
use depthloom_kernels::simd::Level;

use crate::networks::{Act, Architecture, Builder, Conv, ParameterLayout, Size};

/// A layer with its packed weights.
pub(super) trait PackedLayer: Debug + Send + Sync {
    fn pack(&mut self, level: Level, weights: &[f32], backward: bool);
    fn activation(&self) -> Activation;
    fn forward(&self, level: Level, image: &[f32], bias: &[f32], out: &mut [f32], scratch: &mut LayerScratch);
    fn backward(
        &self,
        level: Level,
        image: &[f32],
        slopes: &[f32],
        gradients: &mut Gradients<'_>,
        scratch: &mut LayerScratch,
    );
}

#[derive(Debug)]
struct Packed<L: Layer> {
    layer: L,
    activation: Activation,
    weights: Option<L::Weights>,
}

impl<L: Layer + Send> PackedLayer for Packed<L>
where
    L::Weights: Debug + Send,
{
    fn pack(&mut self, level: Level, weights: &[f32], backward: bool) {
        self.weights = Some(self.layer.weights(level, weights, backward));
    }

    fn activation(&self) -> Activation {
        self.activation
    }

    fn forward(&self, level: Level, image: &[f32], bias: &[f32], out: &mut [f32], scratch: &mut LayerScratch) {
        let weights = self.weights.as_ref().expect("weights are packed before a batch");
        self.layer.forward(level, image, weights, bias, out, scratch);
    }

    fn backward(
        &self,
        level: Level,
        image: &[f32],
        slopes: &[f32],
        gradients: &mut Gradients<'_>,
        scratch: &mut LayerScratch,
    ) {
        let weights = self.weights.as_ref().expect("weights are packed before a batch");
        self.layer.backward(level, image, weights, slopes, gradients, scratch);
    }
}

#[derive(Debug)]
pub(super) enum Kind {
    /// A layer whose weights are the parameter of this index, and its bias the next.
    Layer {
        layer: Box<dyn PackedLayer>,
        weights: usize,
        learned: bool,
    },
    Halve,
    Sigmoid,
    /// The same samples in one channel.
    AsMap,
}

#[derive(Debug)]
pub(super) struct Operation {
    pub(super) kind: Kind,
    pub(super) x: Place,
    pub(super) out: Place,
    /// Whether x has a gradient, and whether it is added to that of another operation.
    pub(super) gradient: Option<bool>,
}

/// Channels of a buffer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) buffer: usize,
    pub(super) channels: Range<usize>,
    pub(super) planes: Planes,
}

impl Place {
    /// The samples of its planes in the buffer.
    pub(super) fn samples(&self) -> Range<usize> {
        self.channels.start * self.planes.plane()..self.channels.end * self.planes.plane()
    }

    /// The number of its samples without the zeros between the rows.
    pub(super) fn len(&self) -> usize {
        self.channels.len() * self.planes.width() * self.planes.height()
    }
}

#[derive(Debug)]
pub(super) struct Plan {
    pub(super) operations: Vec<Operation>,
    /// Samples of each buffer.
    pub(super) buffers: Vec<usize>,
    pub(super) image: Place,
    pub(super) maps: Vec<Place>,
}

impl Plan {
    pub(super) fn new(network: impl Architecture, size: Size, layout: &ParameterLayout) -> Self {
        // Zeros around an image as wide as its widest kernel reaches.
        let mut reach = Reach { size, pad: 1 };
        network.build(&mut reach, &());
        let mut planner = Planner { size, layout, parameters: 0, values: Vec::new(), operations: Vec::new() };
        let planes = Planes::new(size.width, size.height, reach.pad);
        let image = planner.value(network.interface().planes, planes, false);
        let maps = network.build(&mut planner, &image);
        planner.finish(image, &maps)
    }
}

/// Finds the largest border of a convolution of stride 1.
struct Reach {
    size: Size,
    pad: usize,
}

impl Builder for Reach {
    type Map = ();

    fn conv(&mut self, _name: &str, _x: &(), conv: Conv) {
        if conv.stride == 1 {
            self.pad = self.pad.max(conv.pad);
        }
    }

    fn double(&mut self, _name: &str, _x: &(), _outputs: usize) {}
    fn halve(&mut self, _x: &()) {}
    fn join(&mut self, _a: &(), _b: &()) {}
    fn dense(&mut self, _name: &str, _x: &(), _outputs: usize, _act: Act, _bias: f32) {}
    fn as_map(&mut self, _x: &(), _size: Size) {}
    fn sigmoid(&mut self, _x: &()) {}

    fn size(&self) -> Size {
        self.size
    }
}

/// A map of the network: planes of its own, or a part of those that it was joined into.
#[derive(Debug)]
struct Value {
    channels: usize,
    planes: Planes,
    /// Whether a learned parameter decides it.
    is_learned: bool,
    /// The value that it is a part of, and its first channel there.
    joined: Option<(usize, usize)>,
}

/// An operation between values.
#[derive(Debug)]
struct Step {
    kind: Kind,
    x: usize,
    out: usize,
}

struct Planner<'a> {
    size: Size,
    layout: &'a ParameterLayout,
    parameters: usize,
    values: Vec<Value>,
    operations: Vec<Step>,
}

impl Planner<'_> {
    fn value(&mut self, channels: usize, planes: Planes, is_learned: bool) -> usize {
        self.values.push(Value { channels, planes, is_learned, joined: None });
        self.values.len() - 1
    }

    fn operation(&mut self, kind: Kind, x: usize, channels: usize, planes: Planes) -> usize {
        let learned = matches!(kind, Kind::Layer { learned: true, .. });
        let out = self.value(channels, planes, learned || self.values[x].is_learned);
        self.operations.push(Step { kind, x, out });
        out
    }

    fn layer<L: Layer + Send + 'static>(
        &mut self,
        layer: L,
        activation: Activation,
        x: usize,
        outputs: usize,
        planes: Planes,
    ) -> usize
    where
        L::Weights: Debug + Send,
    {
        let weights = self.parameters;
        self.parameters += 2;
        let learned = !self.layout.parameters[weights].frozen;
        let layer = Box::new(Packed { layer, activation, weights: None });
        self.operation(Kind::Layer { layer, weights, learned }, x, outputs, planes)
    }

    /// The value whose planes hold another's, and the first channel there.
    fn root(&self, value: usize) -> (usize, usize) {
        let Some((whole, first)) = self.values[value].joined else { return (value, 0) };
        let (root, more) = self.root(whole);
        (root, first + more)
    }

    fn place(&self, value: usize, buffers: &[Option<usize>]) -> Place {
        let (root, first) = self.root(value);
        let buffer = buffers[root].expect("a root has a buffer");
        let Value { channels, planes, .. } = self.values[value];
        Place { buffer, channels: first..first + channels, planes }
    }

    fn finish(self, image: usize, maps: &[usize]) -> Plan {
        let (mut buffers, mut sizes, mut written) = (Vec::new(), Vec::new(), Vec::new());
        for value in &self.values {
            let buffer = value.joined.is_none().then_some(sizes.len());
            if buffer.is_some() {
                sizes.push(value.channels * value.planes.plane());
                written.push(vec![false; value.channels]);
            }
            buffers.push(buffer);
        }
        let place = |value: usize| self.place(value, &buffers);
        // Backwards, the first operation that reads a value writes its gradient, the others add to it.
        let mut gradients: Vec<_> = self
            .operations
            .iter()
            .rev()
            .map(|step| {
                let (place, is_learned) = (place(step.x), self.values[step.x].is_learned);
                is_learned.then(|| {
                    let channels = &mut written[place.buffer][place.channels];
                    let add = channels.iter().any(|&written| written);
                    assert!(!add || channels.iter().all(|&written| written), "a part of a joined map was read before");
                    channels.fill(true);
                    add
                })
            })
            .collect();
        gradients.reverse();
        let places: Vec<_> = self.operations.iter().map(|step| (place(step.x), place(step.out))).collect();
        let (image, maps) = (place(image), maps.iter().map(|&map| place(map)).collect());
        let operations = self.operations.into_iter().zip(places).zip(gradients);
        let operations =
            operations.map(|((step, (x, out)), gradient)| Operation { kind: step.kind, x, out, gradient }).collect();
        Plan { operations, buffers: sizes, image, maps }
    }
}

const fn activation(act: Act) -> Activation {
    match act {
        Act::None => Activation::None,
        Act::Relu => Activation::Relu,
    }
}

impl Builder for Planner<'_> {
    type Map = usize;

    fn conv(&mut self, _name: &str, &x: &usize, conv: Conv) -> usize {
        let Value { channels: inputs, planes, .. } = self.values[x];
        let (outputs, kernel, activation) = (conv.outputs, conv.kernel, activation(conv.act));
        if conv.keeps_size() {
            return self.layer(Same { inputs, outputs, planes, kernel, activation }, activation, x, outputs, planes);
        }
        let layer =
            Strided { inputs, outputs, image: planes, kernel, stride: conv.stride, border: conv.pad, activation };
        self.layer(layer, activation, x, outputs, layer.output())
    }

    fn double(&mut self, _name: &str, &x: &usize, outputs: usize) -> usize {
        let Value { channels: inputs, planes: image, .. } = self.values[x];
        let layer = Double { inputs, outputs, image, activation: Activation::Relu };
        self.layer(layer, Activation::Relu, x, outputs, layer.output())
    }

    fn halve(&mut self, &x: &usize) -> usize {
        let Value { channels, planes, .. } = self.values[x];
        self.operation(Kind::Halve, x, channels, planes.resized(planes.width() / 2, planes.height() / 2))
    }

    fn join(&mut self, &a: &usize, &b: &usize) -> usize {
        let [first, second] = [a, b].map(|part| self.values[part].channels);
        let is_learned = [a, b].iter().any(|&part| self.values[part].is_learned);
        let whole = self.value(first + second, self.values[a].planes, is_learned);
        for (part, first) in [(a, 0), (b, first)] {
            let joined = self.values[part].joined.replace((whole, first));
            assert!(joined.is_none(), "a map is joined once");
        }
        whole
    }

    fn dense(&mut self, _name: &str, &x: &usize, outputs: usize, act: Act, _bias: f32) -> usize {
        let Value { channels, planes: image, .. } = self.values[x];
        let layer = Dense { channels, image, outputs, activation: activation(act) };
        self.layer(layer, activation(act), x, outputs, layer.output())
    }

    fn as_map(&mut self, &x: &usize, size: Size) -> usize {
        let planes = self.values[x].planes.resized(size.width, size.height);
        self.operation(Kind::AsMap, x, 1, planes)
    }

    fn sigmoid(&mut self, &x: &usize) -> usize {
        let Value { channels, planes, .. } = self.values[x];
        self.operation(Kind::Sigmoid, x, channels, planes)
    }

    fn size(&self) -> Size {
        self.size
    }
}
