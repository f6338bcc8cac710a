use proptest::prelude::*;

use super::{
    Activation, Dense, Double, Gradients, ImageGradient, Layer, LayerScratch, Planes, Same, Strided, before_activation,
    halve, halve_back,
};
use crate::simd::{Level, every_level};

fn noise(seed: u64, count: usize) -> Vec<f32> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

/// An operation seen as a list of terms: output sample, input sample, weight.
struct Terms {
    terms: Vec<(usize, usize, usize)>,
    area_out: usize,
}

/// By the definition, on an image padded with zeros.
fn strided_terms(op: &Strided) -> Terms {
    let (w, h, k) = (op.image.width() as isize, op.image.height() as isize, op.kernel as isize);
    let (stride, border) = (op.stride as isize, op.border as isize);
    let (wide, high) = (op.output().width(), op.output().height());
    let mut terms = Vec::new();
    for o in 0..op.outputs {
        for i in 0..op.inputs {
            for (y, x) in (0..high).flat_map(|y| (0..wide).map(move |x| (y, x))) {
                for (ky, kx) in (0..k).flat_map(|ky| (0..k).map(move |kx| (ky, kx))) {
                    let (sy, sx) = (y as isize * stride + ky - border, x as isize * stride + kx - border);
                    if (0..h).contains(&sy) && (0..w).contains(&sx) {
                        let weight = ((o * op.inputs + i) * op.kernel + ky as usize) * op.kernel + kx as usize;
                        terms.push((
                            o * wide * high + y * wide + x,
                            i * (w * h) as usize + (sy * w + sx) as usize,
                            weight,
                        ));
                    }
                }
            }
        }
    }
    Terms { terms, area_out: wide * high }
}

fn same_terms(op: &Same) -> Terms {
    let Same { inputs, outputs, planes: image, kernel, activation } = *op;
    strided_terms(&Strided { inputs, outputs, image, kernel, stride: 1, border: kernel / 2, activation })
}

fn dense_terms(op: &Dense) -> Terms {
    let inputs = op.channels * op.image.width() * op.image.height();
    let terms = |o: usize| (0..inputs).map(move |i| (o, i, o * inputs + i));
    Terms { terms: (0..op.outputs).flat_map(terms).collect(), area_out: 1 }
}

/// By the definition: each input sample is spread over the 4x4 outputs around twice its place.
fn double_terms(op: &Double) -> Terms {
    let (w, h) = (op.image.width() as isize, op.image.height() as isize);
    let mut terms = Vec::new();
    for i in 0..op.inputs {
        for o in 0..op.outputs {
            for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
                for (ky, kx) in (0..4).flat_map(|ky| (0..4).map(move |kx| (ky, kx))) {
                    let (ty, tx) = (2 * y - 1 + ky, 2 * x - 1 + kx);
                    if (0..2 * h).contains(&ty) && (0..2 * w).contains(&tx) {
                        terms.push((
                            o * (w * h) as usize * 4 + (ty * 2 * w + tx) as usize,
                            i * (w * h) as usize + (y * w + x) as usize,
                            ((i * op.outputs + o) * 4 + ky as usize) * 4 + kx as usize,
                        ));
                    }
                }
            }
        }
    }
    Terms { terms, area_out: (w * h) as usize * 4 }
}

struct Case {
    image: Vec<f32>,
    weights: Vec<f32>,
    bias: Vec<f32>,
    slope: Vec<f32>,
    /// Whether the layer has no gradient of the image.
    without_image: bool,
}

impl Case {
    fn new(seed: u64, [image, weights, bias, slope]: [usize; 4]) -> Self {
        let noise = |part: u64, count| noise(seed ^ part, count);
        Self {
            image: noise(0, image),
            weights: noise(1, weights),
            bias: noise(2, bias),
            slope: noise(3, slope),
            without_image: false,
        }
    }
}

/// Output, gradient of image, of weights, of bias.
type Results = [Vec<f32>; 4];

impl Terms {
    /// In f64, term by term; where the sum is next to zero, `ours` says on which side of the bend of ReLU it is.
    fn reference(&self, case: &Case, activation: Activation, ours: &[f32]) -> Results {
        let mut out: Vec<f64> = (0..case.slope.len()).map(|p| f64::from(case.bias[p / self.area_out])).collect();
        for &(o, i, w) in &self.terms {
            out[o] += f64::from(case.image[i]) * f64::from(case.weights[w]);
        }
        let slope = |o: usize| match activation {
            Activation::Relu if out[o].abs() < 1e-4 && ours[o] <= 0.0 => 0.0,
            Activation::Relu if out[o] <= -1e-4 => 0.0,
            _ => f64::from(case.slope[o]),
        };
        let mut image = vec![0.0; case.image.len()];
        let mut weights = vec![0.0; case.weights.len()];
        let mut bias = vec![0.0; case.bias.len()];
        for &(o, i, w) in &self.terms {
            image[i] += slope(o) * f64::from(case.weights[w]);
            weights[w] += slope(o) * f64::from(case.image[i]);
        }
        (0..case.slope.len()).for_each(|o| bias[o / self.area_out] += slope(o));
        let out = out.into_iter().map(|v| if activation == Activation::Relu { v.max(0.0) } else { v }).collect();
        [out, image, weights, bias].map(|values: Vec<f64>| values.into_iter().map(|v| v as f32).collect())
    }
}

/// In planes; of a strided convolution without the gradient of the image.
fn run<L: Layer>(op: &L, [planes, output]: [Planes; 2], activation: Activation, case: &Case, level: Level) -> Results {
    let channels = |samples: &[f32], planes: &Planes| samples.len() / (planes.width() * planes.height());
    let in_planes = |samples: &[f32], planes: &Planes| {
        let mut memory = planes.zeros(channels(samples, planes));
        planes.spread(samples, &mut memory);
        memory
    };
    let weights = op.weights(level, &case.weights, true);
    // What an earlier call of another size left must not matter.
    let mut scratch = LayerScratch { planes: vec![f32::NAN; 90_000], sums: vec![f32::NAN; 9000] };
    let image = in_planes(&case.image, &planes);
    let mut out = output.zeros(channels(&case.slope, &output));
    op.forward(level, &image, &weights, &case.bias, &mut out, &mut scratch);
    let mut samples = vec![f32::NAN; case.slope.len()];
    output.collect(&out, &mut samples);
    assert!(bits_of(&in_planes(&samples, &output)) == bits_of(&out), "something lies between the rows");
    let mut slopes = in_planes(&case.slope, &output);
    before_activation(level, activation, &output, &out, &mut slopes);
    let mut of_image = vec![0.25; image.len()];
    let [mut of_weights, mut bias] = [&case.weights, &case.bias].map(|like| vec![f32::NAN; like.len()]);
    let has_image = !case.without_image;
    let gradient = ImageGradient { planes: &mut of_image, add: true };
    let mut gradients =
        Gradients { image: has_image.then_some(gradient), weights: Some(&mut of_weights), bias: Some(&mut bias) };
    op.backward(level, &image, &weights, &slopes, &mut gradients, &mut scratch);
    let mut image_gradient = vec![0.0; if has_image { case.image.len() } else { 0 }];
    planes.collect(&of_image, &mut image_gradient);
    if has_image {
        // Written, it is what was added above.
        let mut written = vec![f32::NAN; image.len()];
        let image_only = ImageGradient { planes: &mut written, add: false };
        let mut gradients = Gradients { image: Some(image_only), ..Gradients::default() };
        op.backward(level, &image, &weights, &slopes, &mut gradients, &mut scratch);
        let mut again = image_gradient.clone();
        planes.collect(&written, &mut again);
        assert!(again.iter().zip(&image_gradient).all(|(set, added)| (set + 0.25 - added).abs() < 1e-5));
        image_gradient = again;
    }
    [samples, image_gradient, of_weights, bias]
}

fn bits_of(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

fn bits(results: &Results) -> Vec<Vec<u32>> {
    results.iter().map(|values| bits_of(values)).collect()
}

fn close(ours: &Results, reference: &Results) {
    for (what, (ours, reference)) in ["output", "image", "weights", "bias"].iter().zip(ours.iter().zip(reference)) {
        assert_eq!(ours.len(), reference.len());
        for (at, (a, b)) in ours.iter().zip(reference).enumerate() {
            assert!((a - b).abs() <= 2e-4 * (1.0 + b.abs()), "{what}[{at}]: {a} where {b} is right");
        }
    }
}

fn activation() -> impl Strategy<Value = Activation> {
    prop_oneof![Just(Activation::None), Just(Activation::Relu)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: if cfg!(miri) { 3 } else { 60 }, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn same_is_its_definition_and_equal_on_every_instruction_set(
        (inputs, outputs) in (1_usize..12, 1_usize..20), (width, height) in (1_usize..40, 1_usize..9),
        kernel in prop_oneof![Just(1_usize), Just(3), Just(5)], activation in activation(), seed in any::<u64>(),
    ) {
        // Planes whose zeros reach farther than the kernel serve as well.
        let planes = Planes::new(width, height, 2);
        let op = Same { inputs, outputs, planes, kernel, activation };
        let area = width * height;
        let case = Case::new(seed, [inputs * area, outputs * inputs * kernel * kernel, outputs, outputs * area]);
        every_level(|level| bits(&run(&op, [planes; 2], activation, &case, level)));
        let ours = run(&op, [planes; 2], activation, &case, Level::best());
        close(&ours, &same_terms(&op).reference(&case, activation, &ours[0]));
    }

    #[test]
    fn strided_is_its_definition_and_equal_on_every_instruction_set(
        (inputs, outputs) in (1_usize..4, 1_usize..12), (width, height) in (7_usize..40, 7_usize..20),
        (kernel, stride, border) in (1_usize..8, 1_usize..5, 0_usize..4), activation in activation(), seed in any::<u64>(),
    ) {
        let image = Planes::new(width, height, 1);
        let op = Strided { inputs, outputs, image, kernel, stride, border, activation };
        let area = op.output().width() * op.output().height();
        let sizes = [inputs * width * height, outputs * inputs * kernel * kernel, outputs, outputs * area];
        let case = Case { without_image: true, ..Case::new(seed, sizes) };
        every_level(|level| bits(&run(&op, [image, op.output()], activation, &case, level)));
        let ours = run(&op, [image, op.output()], activation, &case, Level::best());
        let [out, _, weights, bias] = strided_terms(&op).reference(&case, activation, &ours[0]);
        close(&ours, &[out, Vec::new(), weights, bias]);
    }

    #[test]
    fn double_is_its_definition_and_equal_on_every_instruction_set(
        (inputs, outputs) in (1_usize..12, 1_usize..12), (width, height, pad) in (1_usize..30, 1_usize..7, 1_usize..3),
        activation in activation(), seed in any::<u64>(),
    ) {
        let image = Planes::new(width, height, pad);
        let op = Double { inputs, outputs, image, activation };
        let area = width * height;
        let case = Case::new(seed, [inputs * area, inputs * outputs * 16, outputs, outputs * area * 4]);
        every_level(|level| bits(&run(&op, [image, op.output()], activation, &case, level)));
        let ours = run(&op, [image, op.output()], activation, &case, Level::best());
        close(&ours, &double_terms(&op).reference(&case, activation, &ours[0]));
    }

    #[test]
    fn dense_is_its_definition_and_equal_on_every_instruction_set(
        (channels, outputs) in (1_usize..6, 1_usize..20), rows in 1_usize..4,
        activation in activation(), seed in any::<u64>(),
    ) {
        let image = Planes::new(16, rows, 1);
        let op = Dense { channels, image, outputs, activation };
        let inputs = channels * 16 * rows;
        let case = Case::new(seed, [inputs, inputs * outputs, outputs, outputs]);
        every_level(|level| bits(&run(&op, [image, op.output()], activation, &case, level)));
        let ours = run(&op, [image, op.output()], activation, &case, Level::best());
        close(&ours, &dense_terms(&op).reference(&case, activation, &ours[0]));
    }
}

#[test]
fn lines_longer_than_a_span_are_summed_completely() {
    let planes = Planes::new(320, 5, 1);
    let op = Same { inputs: 2, outputs: 9, planes, kernel: 3, activation: Activation::Relu };
    let case = Case::new(1, [2 * 1600, 9 * 2 * 9, 9, 9 * 1600]);
    let ours = run(&op, [planes; 2], Activation::Relu, &case, Level::best());
    close(&ours, &same_terms(&op).reference(&case, Activation::Relu, &ours[0]));
}

#[test]
fn the_first_of_equal_samples_has_the_gradient() {
    let (planes, half) = (Planes::new(4, 2, 1), Planes::new(2, 1, 1));
    let (mut image, mut slopes) = (planes.zeros(1), half.zeros(1));
    planes.spread(&[1.0, 5.0, 2.0, 2.0, 5.0, 3.0, 1.0, 0.0], &mut image);
    half.spread(&[10.0, 20.0], &mut slopes);
    let gradients = every_level(|level| {
        let (mut out, mut gradient) = (half.zeros(1), planes.zeros(1));
        halve(level, &planes, &image, &mut out);
        let mut maxima = [0.0; 2];
        half.collect(&out, &mut maxima);
        assert_eq!(maxima, [5.0, 2.0]);
        for add in [false, true] {
            halve_back(level, &planes, &image, &out, &slopes, &mut ImageGradient { planes: &mut gradient, add });
        }
        let mut samples = [0.0; 8];
        planes.collect(&gradient, &mut samples);
        samples
    });
    assert_eq!(gradients, [0.0, 20.0, 40.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
}
