//! Convolutions of the default network's levels, forward and backward, one image, one thread.
//!
//! `cargo bench -p depthloom-kernels --bench convolve`. Throughput counts multiply-adds (the backward pass has twice
//! those of the forward pass): divide by the clock and by the lanes of a fused multiply-add to see how far from the
//! roofline they are.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use depthloom_kernels::convolve::{Activation, Double, Gradients, ImageGradient, Layer, LayerScratch, Planes, Same};
use depthloom_kernels::simd::Level;

fn noise(count: usize) -> Vec<f32> {
    (0..count).map(|i| ((i * 7919 + 13) % 1000) as f32 / 500.0 - 1.0).collect()
}

fn same(c: &mut Criterion) {
    for (inputs, outputs, width, height) in [
        (3, 8, 320, 96),
        (8, 8, 320, 96),
        (16, 16, 160, 48),
        (64, 32, 80, 24),
        (128, 64, 40, 12),
        (192, 96, 20, 6),
        (128, 128, 10, 3),
    ] {
        let planes = Planes::new(width, height, 1);
        let op = Same { inputs, outputs, planes, kernel: 3, activation: Activation::Relu };
        let (image, slopes_out) = (noise(inputs * planes.plane()), noise(outputs * planes.plane()));
        let (weights, bias) = (noise(inputs * outputs * 9), noise(outputs));
        let (mut scratch, mut out) = (LayerScratch::default(), slopes_out.clone());
        let mut slopes = [image.clone(), weights.clone(), bias.clone()];
        let mut group = c.benchmark_group("same");
        group.throughput(Throughput::Elements((inputs * outputs * 9 * width * height) as u64));
        for level in Level::available().into_iter().filter(|level| level.name().starts_with("avx")) {
            let packed = op.weights(level, &weights, true);
            let name = format!("{inputs}-{outputs}-{width}x{height}");
            group.bench_function(BenchmarkId::new(format!("forward-{}", level.name()), &name), |b| {
                b.iter(|| op.forward(level, black_box(&image), &packed, &bias, &mut out, &mut scratch));
            });
            group.bench_function(BenchmarkId::new(format!("backward-{}", level.name()), &name), |b| {
                b.iter(|| {
                    let [image_slope, weights_slope, bias_slope] = &mut slopes;
                    let mut gradients = Gradients {
                        image: Some(ImageGradient { planes: image_slope, add: false }),
                        weights: Some(weights_slope),
                        bias: Some(bias_slope),
                    };
                    op.backward(level, black_box(&image), &packed, &slopes_out, &mut gradients, &mut scratch);
                });
            });
        }
    }
}

fn double(c: &mut Criterion) {
    for (inputs, outputs, width, height) in [(128, 96, 10, 3), (64, 32, 40, 12), (16, 8, 160, 48)] {
        let planes = Planes::new(width, height, 1);
        let op = Double { inputs, outputs, image: planes, activation: Activation::Relu };
        let (image, slopes_out) = (noise(inputs * planes.plane()), noise(outputs * op.output().plane()));
        let (weights, bias) = (noise(inputs * outputs * 16), noise(outputs));
        let (mut scratch, mut out) = (LayerScratch::default(), slopes_out.clone());
        let mut slopes = [image.clone(), weights.clone(), bias.clone()];
        let mut group = c.benchmark_group("double");
        group.throughput(Throughput::Elements((inputs * outputs * 16 * width * height) as u64));
        let level = Level::best();
        let packed = op.weights(level, &weights, true);
        let name = format!("{inputs}-{outputs}-{width}x{height}");
        group.bench_function(BenchmarkId::new("forward", &name), |b| {
            b.iter(|| op.forward(level, black_box(&image), &packed, &bias, &mut out, &mut scratch));
        });
        group.bench_function(BenchmarkId::new("backward", &name), |b| {
            b.iter(|| {
                let [image_slope, weights_slope, bias_slope] = &mut slopes;
                let mut gradients = Gradients {
                    image: Some(ImageGradient { planes: image_slope, add: false }),
                    weights: Some(weights_slope),
                    bias: Some(bias_slope),
                };
                op.backward(level, black_box(&image), &packed, &slopes_out, &mut gradients, &mut scratch);
            });
        });
    }
}

criterion_group!(benches, same, double);
criterion_main!(benches);
