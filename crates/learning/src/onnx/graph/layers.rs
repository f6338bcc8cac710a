//! The layers of a graph: what each computes, and its ONNX operator.

use super::{GraphBuilder, Tensor, Weights};
use depthloom_onnx::{AttributeProto, attribute_type};

impl GraphBuilder {
    /// A convolution (as neural networks mean it: correlation); weights `[out, in, rows, columns]`, zeros around the
    /// image.
    pub(crate) fn conv2d(
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

    /// A transposed convolution; weights `[in, out, rows, columns]`; a side becomes `stride * (side - 1) + kernel - 2 *
    /// padding`.
    pub(crate) fn conv_transpose2d(
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
    pub(crate) fn linear(&mut self, name: &str, input: Tensor, weights: &[f32], bias: &[f32]) -> Tensor {
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

    pub(crate) fn relu(&mut self, input: Tensor) -> Tensor {
        self.unnamed("Relu", &[input], Vec::new(), self.dims(input).to_vec())
    }

    pub(crate) fn sigmoid(&mut self, input: Tensor) -> Tensor {
        self.unnamed("Sigmoid", &[input], Vec::new(), self.dims(input).to_vec())
    }

    /// `factor * x`.
    pub(crate) fn scale(&mut self, input: Tensor, factor: f32) -> Tensor {
        self.with_scalar("Mul", input, factor)
    }

    /// The largest value of each window of `size x size`; the surroundings do not count.
    pub(crate) fn max_pool(&mut self, input: Tensor, size: usize, stride: usize, padding: usize) -> Tensor {
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

    pub(crate) fn concat(&mut self, inputs: &[Tensor]) -> Tensor {
        let dims: Vec<[usize; 3]> = inputs.iter().map(|&input| self.map_dims(input)).collect();
        let [_, height, width] = *dims.first().expect("something to concatenate");
        assert!(dims.iter().all(|&[_, h, w]| (h, w) == (height, width)), "{dims:?} have one size");
        let channels = dims.iter().map(|[channels, ..]| channels).sum();
        self.unnamed("Concat", inputs, vec![int("axis", 1)], vec![channels, height, width])
    }

    /// The same values with other sides after the batch's.
    pub(crate) fn reshape(&mut self, input: Tensor, dims: &[usize]) -> Tensor {
        let count: usize = self.dims(input).iter().product();
        assert_eq!(count, dims.iter().product::<usize>(), "reshaping keeps all values");
        // A side of 0 is that of the input: the batch.
        let sides: Vec<i64> = std::iter::once(0).chain(dims.iter().map(|&side| side as i64)).collect();
        let shape = self.integers(&sides);
        self.unnamed_of("Reshape", vec![self.name_of(input), shape], Vec::new(), dims.to_vec())
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
        assert_eq!(bias.len(), channels, "{name}: one bias per channel");
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
