//! Networks with an input, and the output that the training library gives.

use burn::tensor::ops::{ConvOptions, ConvTransposeOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, TensorData, activation, module};
use depthloom_random::SplitMix64;

use crate::compute::Input;
use crate::compute::library::Engine;
use crate::networks::{Architecture, FusionUnet, Interface, Monocular, Network, NetworkOutput, Size, export, layout};
use crate::onnx::{GraphBuilder, Metadata, Weights};

const BATCH: usize = 2;

pub(crate) struct Numbers {
    pub(crate) shape: Vec<usize>,
    pub(crate) values: Vec<f32>,
}

pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) file: Vec<u8>,
    pub(crate) input: Numbers,
    pub(crate) output: Numbers,
    /// The output's name in the file.
    pub(crate) output_name: String,
    /// How large the output can become.
    pub(crate) range: f32,
}

pub(crate) fn cases() -> Vec<Case> {
    let small = Size { width: 64, height: 32 };
    vec![
        of_network(Network::UnetLite.without_spread(), Size { width: 320, height: 96 }, 1.5),
        of_network(Network::UnetTiny.without_spread(), Size { width: 320, height: 96 }, 1.5),
        of_network(Network::FcnLite.without_spread(), Size { width: 320, height: 96 }, 1.5),
        of_network(Network::FcnVgg16.without_spread(), small, 1.7),
        of_network(Network::EigenCoarse.without_spread(), small, 2.0),
        of_network(FusionUnet, small, 1.5),
        every_operator(),
    ]
}

fn noise(seed: u64, count: usize, limit: f32) -> Vec<f32> {
    let mut random = SplitMix64::new(seed);
    (0..count).map(|_| random.sign_unit() * limit).collect()
}

/// Noise around grey, so that no channel is like another.
fn image(planes: usize, size: Size) -> Numbers {
    let shape = vec![BATCH, planes, size.height, size.width];
    let values = noise(5, shape.iter().product(), 0.5).into_iter().map(|value| value + 0.5).collect();
    Numbers { shape, values }
}

/// Weights of a start let little through to the end: `enlarged` (He, Zhang, Ren, Sun 2015), the map has all of its
/// values.
fn of_network(network: impl Architecture, size: Size, enlarged: f32) -> Case {
    let layout = layout(network, size);
    let mut parameters = layout.start(7);
    parameters.iter_mut().step_by(2).flatten().for_each(|weight| *weight *= enlarged);
    let file = export(network, size, &parameters, "a test");
    let Interface { planes, outputs, .. } = network.interface();
    let NetworkOutput { name: output, scale } = outputs[0];
    let input = image(planes, size);
    let shape = [BATCH, planes, size.height, size.width];
    let images = Input { values: input.values.clone(), shape };
    let maps = Engine::on(Device::flex(), network, &layout).maps(&images, &parameters);
    let Size { width, height } = layout.map;
    let shape = vec![BATCH, maps.len() / (BATCH * width * height), height, width];
    let output_numbers = Numbers { shape, values: maps.into_iter().map(|value| value * scale).collect() };
    let (name, output_name) = (network.name(), output.replace('-', "_"));
    Case { name, file, input, output: output_numbers, output_name, range: scale }
}

/// A network with two outputs, the first of them in the case.
pub(crate) fn with_spread() -> (Case, Numbers) {
    let network = Monocular { network: Network::UnetTiny, spread: true };
    let mut case = of_network(network, Size { width: 64, height: 32 }, 1.5);
    let Numbers { shape, values } = &case.output;
    let [batch, maps, height, width] = shape[..] else { panic!("batch x maps x rows x columns") };
    assert_eq!((batch, maps), (BATCH, 2));
    let map = |map: usize, scale: f32| {
        let of_image = |image: usize| &values[(image * maps + map) * height * width..][..height * width];
        let values = (0..batch).flat_map(of_image).map(|value| value / case.range * scale).collect();
        Numbers { shape: vec![batch, 1, height, width], values }
    };
    let [first, spread] = [map(0, case.range), map(1, std::f32::consts::SQRT_2)];
    case.output = first;
    (case, spread)
}

/// A convolution with stride and padding, the maximum of overlapping windows, a transposed convolution, a join, the
/// functions, a dense layer and a map of its units.
fn every_operator() -> Case {
    let size = Size { width: 24, height: 13 };
    let input = image(3, size);
    let (conv, conv_bias) = (noise(11, 4 * 3 * 5 * 3, 0.3), noise(12, 4, 0.3));
    let (double, double_bias) = (noise(13, 4 * 2 * 4 * 4, 0.5), noise(14, 2, 0.3));
    let (dense, dense_bias) = (noise(15, 30 * 6 * 6 * 12, 0.2), noise(16, 30, 0.3));
    let (last, last_bias) = (noise(17, 6 * 30, 0.4), noise(18, 6, 0.3));

    let mut graph = GraphBuilder::new("every-operator");
    let x = graph.input("image", &[3, size.height, size.width]);
    let weights = Weights { dims: [4, 3, 5, 3], values: &conv };
    let x = graph.conv2d("conv", x, weights, &conv_bias, 2, 1);
    assert_eq!(graph.dims(x), [4, 6, 12]);
    let relu = graph.relu(x);
    let pooled = graph.max_pool(relu, 3, 2, 1);
    let weights = Weights { dims: [4, 2, 4, 4], values: &double };
    let up = graph.conv_transpose2d("double", pooled, weights, &double_bias, 2, 1);
    assert_eq!(graph.dims(up), [2, 6, 12]);
    let joined = graph.concat(&[up, relu]);
    let units = graph.linear("dense", joined, &dense, &dense_bias);
    let units = graph.sigmoid(units);
    // Again, of what is flat already.
    let units = graph.linear("last", units, &last, &last_bias);
    let map = graph.reshape(units, &[1, 2, 3]);
    let map = graph.scale(map, 0.5);
    let size = [size.width, size.height];
    let metadata = Metadata { size, normalisation: "none", training_key: "none" };
    let file = graph.finish(&[(map, "depth")], &metadata);

    let x = tensor(&input.values, [BATCH, 3, size[1], size[0]]);
    let options = ConvOptions::new([2, 2], [1, 1], [1, 1], 1);
    let x = module::conv2d(x, tensor(&conv, [4, 3, 5, 3]), Some(tensor(&conv_bias, [4])), options);
    let relu = activation::relu(x);
    let pooled = module::max_pool2d(relu.clone(), MaxPoolOptions::new([3, 3]).with_stride([2, 2]).with_padding([1, 1]));
    let options = ConvTransposeOptions::new([2, 2], [1, 1], [0, 0], [1, 1], 1);
    let up = module::conv_transpose2d(pooled, tensor(&double, [4, 2, 4, 4]), Some(tensor(&double_bias, [2])), options);
    let flat: Tensor<2> = Tensor::cat(vec![up, relu], 1).reshape([BATCH, 6 * 6 * 12]);
    let linear = |x: Tensor<2>, weights: &[f32], bias: &[f32]| {
        let [_, inputs] = x.dims();
        let bias: Tensor<1> = tensor(bias, [bias.len()]);
        x.matmul(tensor(weights, [bias.dims()[0], inputs]).transpose()) + bias.unsqueeze()
    };
    let units = linear(activation::sigmoid(linear(flat, &dense, &dense_bias)), &last, &last_bias);
    let map: Tensor<4> = units.reshape([BATCH, 1, 2, 3]);
    let output = numbers(map * 0.5);
    Case { name: "every-operator", file, input, output, output_name: "depth".to_owned(), range: 1.0 }
}

fn tensor<const D: usize>(values: &[f32], shape: [usize; D]) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape), &Device::flex())
}

fn numbers(tensor: Tensor<4>) -> Numbers {
    let shape = tensor.dims().to_vec();
    Numbers { shape, values: tensor.into_data().try_to_vec().expect("f32") }
}
