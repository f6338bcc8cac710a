//! Networks as ONNX files, layer by layer.
//!
//! ```
//! use depthloom_learning::onnx::{Batch, GraphBuilder, Meaning, Metadata, Weights};
//!
//! let mut graph = GraphBuilder::new("small", Batch::Open);
//! let image = graph.input("image", &[3, 96, 320]);
//! let weights = Weights { dims: [1, 3, 3, 3], values: &[0.1; 27] };
//! let map = graph.conv2d("head", image, weights, &[-2.0], 1, 1);
//! let share = graph.sigmoid(map);
//! let metadata = Metadata { size: [320, 96], meaning: Meaning::DisparityShare, training_key: "none" };
//! let bytes = graph.finish(share, &metadata);
//! assert!(bytes.len() > 27 * 4);
//! ```

use prost::Message;

use super::metadata::{Metadata, NORMALISATION, names};
use super::proto::{
    AttributeProto, Dimension, DimensionProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto,
    StringStringEntryProto, TensorProto, TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto, attribute_type,
    data_type,
};

/// The version of ONNX's operators that is written.
pub const OPSET: i64 = 13;
/// The version of the file format: that of ONNX 1.9 to 1.12, which every engine of today reads.
const IR_VERSION: i64 = 8;

/// How many images a network takes at once: the first side of all its tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Batch {
    /// Any number.
    Open,
    /// This many.
    Of(usize),
}

/// A value in a graph under construction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tensor(usize);

/// The weights of a convolution: four sides, the last fastest.
#[derive(Clone, Copy, Debug)]
pub struct Weights<'a> {
    /// Sides; which channels come first depends on the layer.
    pub dims: [usize; 4],
    /// As many values as the sides say.
    pub values: &'a [f32],
}

struct Known {
    name: String,
    /// Sides after the batch's.
    dims: Vec<usize>,
}

/// A network in the making. The bytes depend on the calls alone.
///
/// Layers check what they are given and panic where it does not fit: a network is written by code, not by a user.
pub struct GraphBuilder {
    name: String,
    batch: Batch,
    values: Vec<Known>,
    inputs: Vec<Tensor>,
    nodes: Vec<NodeProto>,
    initializers: Vec<TensorProto>,
}

impl GraphBuilder {
    /// An empty graph.
    #[must_use]
    pub fn new(name: &str, batch: Batch) -> Self {
        let (values, inputs, nodes, initializers) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { name: name.to_owned(), batch, values, inputs, nodes, initializers }
    }

    /// An input of f32; `dims` are its sides after the batch's, e.g. `[3, 96, 320]`.
    ///
    /// # Panics
    /// If the name is taken.
    pub fn input(&mut self, name: &str, dims: &[usize]) -> Tensor {
        let input = self.value(name, dims.to_vec());
        self.inputs.push(input);
        input
    }

    /// The sides of a value after the batch's.
    #[must_use]
    pub fn dims(&self, tensor: Tensor) -> &[usize] {
        &self.values[tensor.0].dims
    }

    /// A convolution (as neural networks mean it: correlation); weights `[out, in, rows, columns]`, zeros around the image.
    ///
    /// # Panics
    /// If weights, bias or image do not fit each other.
    pub fn conv2d(
        &mut self,
        name: &str,
        input: Tensor,
        weights: Weights<'_>,
        bias: &[f32],
        stride: usize,
        padding: usize,
    ) -> Tensor {
        let [channels, height, width] = self.map_dims(input);
        let [out, of, rows, columns] = weights.dims;
        assert_eq!(of, channels, "{name}: the weights' input channels are the image's");
        let side = |side: usize, kernel: usize| {
            let room = (side + 2 * padding).checked_sub(kernel).expect("the kernel fits into the image");
            room / stride + 1
        };
        let dims = vec![out, side(height, rows), side(width, columns)];
        self.layer(name, "Conv", input, weights, bias, out, window([rows, columns], stride, padding), dims)
    }

    /// A transposed convolution; weights `[in, out, rows, columns]`; a side becomes `stride * (side - 1) + kernel - 2 * padding`.
    ///
    /// # Panics
    /// If weights, bias or image do not fit each other.
    pub fn conv_transpose2d(
        &mut self,
        name: &str,
        input: Tensor,
        weights: Weights<'_>,
        bias: &[f32],
        stride: usize,
        padding: usize,
    ) -> Tensor {
        let [channels, height, width] = self.map_dims(input);
        let [of, out, rows, columns] = weights.dims;
        assert_eq!(of, channels, "{name}: the weights' input channels are the image's");
        let side = |side: usize, kernel: usize| stride * (side - 1) + kernel - 2 * padding;
        let dims = vec![out, side(height, rows), side(width, columns)];
        let attributes = window([rows, columns], stride, padding);
        self.layer(name, "ConvTranspose", input, weights, bias, out, attributes, dims)
    }

    /// A dense layer, `y = W x + b`, of all that a sample has; `weights` are `outputs x inputs`, the inputs fastest.
    ///
    /// # Panics
    /// If weights, bias and input do not fit each other.
    pub fn linear(&mut self, name: &str, input: Tensor, weights: &[f32], bias: &[f32]) -> Tensor {
        let inputs: usize = self.dims(input).iter().product();
        let flat = if self.dims(input).len() == 1 {
            input
        } else {
            self.unnamed("Flatten", &[input], vec![int("axis", 1)], vec![inputs])
        };
        assert_eq!(weights.len(), bias.len() * inputs, "{name}: one weight for each output and input");
        let weights = self.constant(format!("{name}.weight"), &[bias.len(), inputs], weights);
        let bias_name = self.constant(format!("{name}.bias"), &[bias.len()], bias);
        let inputs = vec![self.name_of(flat), weights, bias_name];
        self.node(name, "Gemm", inputs, vec![int("transB", 1)], vec![bias.len()])
    }

    /// `max(x, 0)`.
    pub fn relu(&mut self, input: Tensor) -> Tensor {
        self.unnamed("Relu", &[input], Vec::new(), self.dims(input).to_vec())
    }

    /// `1 / (1 + exp(-x))`.
    pub fn sigmoid(&mut self, input: Tensor) -> Tensor {
        self.unnamed("Sigmoid", &[input], Vec::new(), self.dims(input).to_vec())
    }

    /// `exp(x)`.
    pub fn exp(&mut self, input: Tensor) -> Tensor {
        self.unnamed("Exp", &[input], Vec::new(), self.dims(input).to_vec())
    }

    /// `factor * x`.
    pub fn scale(&mut self, input: Tensor, factor: f32) -> Tensor {
        self.with_scalar("Mul", input, factor)
    }

    /// `x + term`.
    pub fn shift(&mut self, input: Tensor, term: f32) -> Tensor {
        self.with_scalar("Add", input, term)
    }

    /// The largest value of each window of `size x size`; the surroundings do not count.
    ///
    /// # Panics
    /// If the padding is not smaller than the window, or the image than it.
    pub fn max_pool(&mut self, input: Tensor, size: usize, stride: usize, padding: usize) -> Tensor {
        assert!(padding < size, "every window holds a pixel");
        let [channels, height, width] = self.map_dims(input);
        let side =
            |side: usize| (side + 2 * padding).checked_sub(size).expect("the window fits into the image") / stride + 1;
        self.unnamed(
            "MaxPool",
            &[input],
            window([size, size], stride, padding),
            vec![channels, side(height), side(width)],
        )
    }

    /// The channels of all inputs, in order.
    ///
    /// # Panics
    /// If there are none, or their images differ in size.
    pub fn concat(&mut self, inputs: &[Tensor]) -> Tensor {
        let dims: Vec<[usize; 3]> = inputs.iter().map(|&input| self.map_dims(input)).collect();
        let [_, height, width] = *dims.first().expect("something to concatenate");
        assert!(dims.iter().all(|&[_, h, w]| (h, w) == (height, width)), "{dims:?} have one size");
        let channels = dims.iter().map(|[channels, ..]| channels).sum();
        self.unnamed("Concat", inputs, vec![int("axis", 1)], vec![channels, height, width])
    }

    /// The same values with other sides after the batch's.
    ///
    /// # Panics
    /// If that changes their number.
    pub fn reshape(&mut self, input: Tensor, dims: &[usize]) -> Tensor {
        let count: usize = self.dims(input).iter().product();
        assert_eq!(count, dims.iter().product::<usize>(), "reshaping keeps all values");
        // A side of 0 is that of the input: the batch.
        let sides: Vec<i64> = std::iter::once(0).chain(dims.iter().map(|&side| side as i64)).collect();
        let shape = self.integers(&sides);
        self.unnamed_of("Reshape", vec![self.name_of(input), shape], Vec::new(), dims.to_vec())
    }

    /// Bilinear interpolation to `height` rows and `width` columns, with half-pixel centres and repeated borders.
    ///
    /// # Panics
    /// If the input is no image or a side is 0.
    pub fn resize_bilinear(&mut self, input: Tensor, height: usize, width: usize) -> Tensor {
        assert!(height > 0 && width > 0, "an image has pixels");
        let [channels, from_height, from_width] = self.map_dims(input);
        let attributes = vec![text("coordinate_transformation_mode", "half_pixel"), text("mode", "linear")];
        let (image, left_out) = (self.name_of(input), String::new());
        let inputs = match self.batch {
            Batch::Of(batch) => {
                let sizes = self.integers(&[batch as i64, channels as i64, height as i64, width as i64]);
                vec![image, left_out.clone(), left_out, sizes]
            }
            // Sizes would have to name the batch's.
            Batch::Open => {
                let name = self.unused("scales");
                let scales = [1.0, 1.0, factor(from_height, height), factor(from_width, width)];
                let scales = self.constant(name, &[4], &scales);
                vec![image, left_out, scales]
            }
        };
        self.unnamed_of("Resize", inputs, attributes, vec![channels, height, width])
    }

    /// The file: the graph with one output, which is named after its meaning.
    ///
    /// # Panics
    /// If an input is named like the output.
    #[must_use]
    pub fn finish(mut self, output: Tensor, metadata: &Metadata<'_>) -> Vec<u8> {
        let (before, after) = (self.name_of(output), metadata.meaning.name().replace('-', "_"));
        let taken = self.values.iter().any(|known| known.name == after && known.name != before);
        assert!(!taken, "no other value is called {after}");
        assert!(!self.inputs.contains(&output), "the output is calculated");
        let mentions = self.nodes.iter_mut().flat_map(|node| node.input.iter_mut().chain(&mut node.output));
        mentions.filter(|name| **name == before).for_each(|name| name.clone_from(&after));
        self.values[output.0].name = after;
        let [width, height] = metadata.size;
        let said = [
            (names::INPUT_SIZE, format!("{width}x{height}")),
            (names::NORMALISATION, NORMALISATION.to_owned()),
            (names::OUTPUT, metadata.meaning.name().to_owned()),
            (names::TRAINING_KEY, metadata.training_key.to_owned()),
        ];
        let graph = GraphProto {
            input: self.inputs.iter().map(|&input| self.value_info(input)).collect(),
            output: vec![self.value_info(output)],
            node: self.nodes,
            name: self.name,
            initializer: self.initializers,
        };
        let model = ModelProto {
            ir_version: IR_VERSION,
            producer_name: "depthloom".to_owned(),
            producer_version: env!("CARGO_PKG_VERSION").to_owned(),
            graph: Some(graph),
            opset_import: vec![OperatorSetIdProto { domain: String::new(), version: OPSET }],
            metadata_props: said
                .into_iter()
                .map(|(key, value)| StringStringEntryProto { key: key.to_owned(), value })
                .collect(),
        };
        model.encode_to_vec()
    }

    fn value(&mut self, name: &str, dims: Vec<usize>) -> Tensor {
        assert!(self.is_unused(name), "the name {name} is taken");
        self.values.push(Known { name: name.to_owned(), dims });
        Tensor(self.values.len() - 1)
    }

    fn is_unused(&self, name: &str) -> bool {
        self.values.iter().all(|known| known.name != name) && self.initializers.iter().all(|known| known.name != name)
    }

    /// A name that no value has yet.
    fn unused(&self, stem: &str) -> String {
        let stem = stem.to_ascii_lowercase();
        let numbered = (1..).map(|number| format!("{stem}_{number}"));
        numbered.into_iter().find(|name| self.is_unused(name)).expect("numbers do not end")
    }

    fn name_of(&self, tensor: Tensor) -> String {
        self.values[tensor.0].name.clone()
    }

    /// Channels, rows and columns.
    fn map_dims(&self, tensor: Tensor) -> [usize; 3] {
        let known = &self.values[tensor.0];
        let dims = known.dims.as_slice().try_into();
        dims.unwrap_or_else(|_| panic!("{} has the sides {:?}: it is no image", known.name, known.dims))
    }

    fn constant(&mut self, name: String, dims: &[usize], values: &[f32]) -> String {
        assert_eq!(values.len(), dims.iter().product::<usize>(), "{name} has the sides {dims:?}");
        let raw = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.initializer(name, dims, data_type::FLOAT, raw)
    }

    fn integers(&mut self, values: &[i64]) -> String {
        let raw = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.initializer(self.unused("sides"), &[values.len()], data_type::INT64, raw)
    }

    fn initializer(&mut self, name: String, dims: &[usize], data_type: i32, raw: Vec<u8>) -> String {
        assert!(self.is_unused(&name), "the name {name} is taken");
        let dims = dims.iter().map(|&side| side as i64).collect();
        let raw_data = Some(raw);
        self.initializers.push(TensorProto { name: name.clone(), dims, data_type, raw_data, ..TensorProto::default() });
        name
    }

    #[expect(clippy::too_many_arguments, reason = "what the two convolutions share")]
    fn layer(
        &mut self,
        name: &str,
        op: &str,
        input: Tensor,
        weights: Weights<'_>,
        bias: &[f32],
        channels: usize,
        attributes: Vec<AttributeProto>,
        dims: Vec<usize>,
    ) -> Tensor {
        assert_eq!(bias.len(), channels, "{name}: one bias a channel");
        let weights = self.constant(format!("{name}.weight"), &weights.dims, weights.values);
        let bias = self.constant(format!("{name}.bias"), &[channels], bias);
        self.node(name, op, vec![self.name_of(input), weights, bias], attributes, dims)
    }

    fn with_scalar(&mut self, op: &str, input: Tensor, scalar: f32) -> Tensor {
        let scalar = self.constant(self.unused("scalar"), &[], &[scalar]);
        self.unnamed_of(op, vec![self.name_of(input), scalar], Vec::new(), self.dims(input).to_vec())
    }

    fn unnamed(&mut self, op: &str, inputs: &[Tensor], attributes: Vec<AttributeProto>, dims: Vec<usize>) -> Tensor {
        let inputs = inputs.iter().map(|&input| self.name_of(input)).collect();
        self.unnamed_of(op, inputs, attributes, dims)
    }

    fn unnamed_of(
        &mut self,
        op: &str,
        inputs: Vec<String>,
        attributes: Vec<AttributeProto>,
        dims: Vec<usize>,
    ) -> Tensor {
        let name = self.unused(op);
        self.node(&name, op, inputs, attributes, dims)
    }

    fn node(
        &mut self,
        name: &str,
        op: &str,
        input: Vec<String>,
        attribute: Vec<AttributeProto>,
        dims: Vec<usize>,
    ) -> Tensor {
        let output = self.value(name, dims);
        let (name, op_type) = (name.to_owned(), op.to_owned());
        self.nodes.push(NodeProto { input, output: vec![name.clone()], name, op_type, attribute });
        output
    }

    fn value_info(&self, tensor: Tensor) -> ValueInfoProto {
        let known = &self.values[tensor.0];
        let batch = match self.batch {
            Batch::Open => Dimension::Param("N".to_owned()),
            Batch::Of(batch) => Dimension::Value(batch as i64),
        };
        let sides = known.dims.iter().map(|&side| Dimension::Value(side as i64));
        let dim = std::iter::once(batch).chain(sides).map(|side| DimensionProto { value: Some(side) }).collect();
        let shape = Some(TensorShapeProto { dim });
        let tensor_type = Some(TensorTypeProto { elem_type: data_type::FLOAT, shape });
        ValueInfoProto { name: known.name.clone(), r#type: Some(TypeProto { tensor_type }) }
    }
}

/// The factor by which engines, who round down, come from one side to the other, whether they multiply in f32 or in f64.
fn factor(from: usize, to: usize) -> f32 {
    let mut factor = to as f32 / from as f32;
    while ((from as f64 * f64::from(factor)) as usize) < to {
        factor = factor.next_up();
    }
    factor
}

/// The attributes of a window that moves over an image.
fn window(kernel: [usize; 2], stride: usize, padding: usize) -> Vec<AttributeProto> {
    assert!(stride > 0, "a window moves");
    vec![ints("kernel_shape", &kernel), ints("pads", &[padding; 4]), ints("strides", &[stride; 2])]
}

fn int(name: &str, value: i64) -> AttributeProto {
    let name = name.to_owned();
    AttributeProto { name, i: Some(value), r#type: attribute_type::INT, ..AttributeProto::default() }
}

fn ints(name: &str, values: &[usize]) -> AttributeProto {
    let (name, ints) = (name.to_owned(), values.iter().map(|&value| value as i64).collect());
    AttributeProto { name, ints, r#type: attribute_type::INTS, ..AttributeProto::default() }
}

fn text(name: &str, value: &str) -> AttributeProto {
    let (name, s) = (name.to_owned(), Some(value.as_bytes().to_vec()));
    AttributeProto { name, s, r#type: attribute_type::STRING, ..AttributeProto::default() }
}
