use proptest::prelude::*;

use super::{Activation, Convolution, ConvolutionScratch, Double, Gradients, Same};
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

/// By the definition, on a `height x width` image padded with zeros.
fn same_terms(op: &Same) -> Terms {
    let (w, h, k) = (op.width as isize, op.height as isize, op.kernel as isize);
    let mut terms = Vec::new();
    for o in 0..op.outputs {
        for i in 0..op.inputs {
            for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
                for (ky, kx) in (0..k).flat_map(|ky| (0..k).map(move |kx| (ky, kx))) {
                    let (sy, sx) = (y + ky - k / 2, x + kx - k / 2);
                    if (0..h).contains(&sy) && (0..w).contains(&sx) {
                        let weight = ((o * op.inputs + i) * op.kernel + ky as usize) * op.kernel + kx as usize;
                        terms.push((
                            o * op.width * op.height + (y * w + x) as usize,
                            i * op.width * op.height + (sy * w + sx) as usize,
                            weight,
                        ));
                    }
                }
            }
        }
    }
    Terms { terms, area_out: op.width * op.height }
}

/// By the definition: each input sample is spread over the 4x4 outputs around twice its place.
fn double_terms(op: &Double) -> Terms {
    let (w, h) = (op.width as isize, op.height as isize);
    let mut terms = Vec::new();
    for i in 0..op.inputs {
        for o in 0..op.outputs {
            for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
                for (ky, kx) in (0..4).flat_map(|ky| (0..4).map(move |kx| (ky, kx))) {
                    let (ty, tx) = (2 * y - 1 + ky, 2 * x - 1 + kx);
                    if (0..2 * h).contains(&ty) && (0..2 * w).contains(&tx) {
                        terms.push((
                            o * op.width * op.height * 4 + (ty * 2 * w + tx) as usize,
                            i * op.width * op.height + (y * w + x) as usize,
                            ((i * op.outputs + o) * 4 + ky as usize) * 4 + kx as usize,
                        ));
                    }
                }
            }
        }
    }
    Terms { terms, area_out: op.width * op.height * 4 }
}

struct Case {
    image: Vec<f32>,
    weights: Vec<f32>,
    bias: Vec<f32>,
    slope: Vec<f32>,
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

fn run<C: Convolution>(op: &C, case: &Case, level: Level) -> Results {
    let weights = op.weights(level, &case.weights, true);
    let mut scratch = ConvolutionScratch::default();
    // What an earlier call of another size left must not matter.
    scratch.source.resize(9000, f32::NAN);
    scratch.slopes.resize(9000, f32::NAN);
    scratch.sums.resize(9000, f32::NAN);
    let mut out = vec![f32::NAN; case.slope.len()];
    op.forward(level, &case.image, &weights, &case.bias, &mut out, &mut scratch);
    let [mut image, mut of_weights, mut bias] =
        [&case.image, &case.weights, &case.bias].map(|like| vec![f32::NAN; like.len()]);
    let mut gradients = Gradients { image: Some(&mut image), weights: Some(&mut of_weights), bias: Some(&mut bias) };
    op.backward(level, &case.image, &weights, &out, &case.slope, &mut gradients, &mut scratch);
    [out, image, of_weights, bias]
}

fn bits(results: &Results) -> Vec<Vec<u32>> {
    results.iter().map(|values| values.iter().map(|v| v.to_bits()).collect()).collect()
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
        let op = Same { inputs, outputs, width, height, kernel, activation };
        let case = Case {
            image: noise(seed, inputs * width * height),
            weights: noise(seed ^ 1, outputs * inputs * kernel * kernel),
            bias: noise(seed ^ 2, outputs),
            slope: noise(seed ^ 3, outputs * width * height),
        };
        every_level(|level| bits(&run(&op, &case, level)));
        let ours = run(&op, &case, Level::best());
        close(&ours, &same_terms(&op).reference(&case, activation, &ours[0]));
    }

    #[test]
    fn double_is_its_definition_and_equal_on_every_instruction_set(
        (inputs, outputs) in (1_usize..12, 1_usize..12), (width, height) in (1_usize..30, 1_usize..7),
        activation in activation(), seed in any::<u64>(),
    ) {
        let op = Double { inputs, outputs, width, height, activation };
        let case = Case {
            image: noise(seed, inputs * width * height),
            weights: noise(seed ^ 1, outputs * inputs * 16),
            bias: noise(seed ^ 2, outputs),
            slope: noise(seed ^ 3, outputs * width * height * 4),
        };
        every_level(|level| bits(&run(&op, &case, level)));
        let ours = run(&op, &case, Level::best());
        close(&ours, &double_terms(&op).reference(&case, activation, &ours[0]));
    }
}

#[test]
fn lines_longer_than_a_span_are_summed_completely() {
    let op = Same { inputs: 2, outputs: 9, width: 320, height: 5, kernel: 3, activation: Activation::Relu };
    let case =
        Case { image: noise(1, 2 * 1600), weights: noise(2, 9 * 2 * 9), bias: noise(3, 9), slope: noise(4, 9 * 1600) };
    let ours = run(&op, &case, Level::best());
    close(&ours, &same_terms(&op).reference(&case, Activation::Relu, &ours[0]));
}
