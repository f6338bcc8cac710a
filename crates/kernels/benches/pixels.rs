//! Each pixel kernel on a frame of KITTI's size, 1242 x 375.
//!
//! `DEPTHLOOM_SIMD=portable|sse2|avx2` holds the instruction set down.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use depthloom_kernels::fuse::{Weighting, fuse};
use depthloom_kernels::mixture::{
    self, Alignment, Disparities, Fused, Local, Mixture, MixtureScratch, Prior, Rules, StereoEvidence,
};
use depthloom_kernels::{confidence, depth, edges, grey, median, resize, scale, simd};

const WIDTH: usize = 1242;
const HEIGHT: usize = 375;
const SIZE: usize = WIDTH * HEIGHT;

/// A frame as the kernels meet it: edges on every tenth pixel, stereo answering four fifths.
struct Frame {
    rgb: Vec<u8>,
    grey: Vec<u8>,
    mask: Vec<u8>,
    disparity: Vec<i16>,
    stereo: Vec<f32>,
    mono: Vec<f32>,
    weight: Vec<f32>,
}

const KITTI: depth::Geometry = depth::Geometry { focal_px: 721.5377, baseline_metres: 0.532725, doffs_px: 0.0 };

fn frame() -> Frame {
    // A linear congruential generator: the same noise everywhere, and no dependency.
    let mut state = 1u32;
    let mut below = |n: u32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) % n
    };
    let rgb: Vec<u8> = (0..3 * SIZE).map(|_| below(256) as u8).collect();
    let mut grey = vec![0; SIZE];
    grey::grey_from_rgb(&rgb, WIDTH, HEIGHT, &mut grey);
    let mask: Vec<u8> = (0..SIZE).map(|_| if below(10) == 0 { edges::EDGE } else { 0 }).collect();
    let disparity: Vec<i16> = (0..SIZE).map(|_| if below(5) == 0 { -16 } else { 64 + below(900) as i16 }).collect();
    let mut stereo = vec![0.0; SIZE];
    depth::depth_from_disparity(&disparity, KITTI, 80.0, &mut stereo);
    let mono: Vec<f32> = (0..SIZE).map(|_| 2.0 + below(7800) as f32 / 100.0).collect();
    let mut weight = vec![0.0; SIZE];
    confidence::confidence_from_edges(&mask, WIDTH, HEIGHT, 10.0, &mut weight);
    Frame { rgb, grey, mask, disparity, stereo, mono, weight }
}

/// The mixture without and with alignment, with the defaults of `fusion/mixture`.
fn mixtures() -> [(&'static str, Mixture); 2] {
    let local = Local { sigma: 18.0, regulariser: 0.05, iterations: 4, least_spread: 0.05 };
    [("mixture/none", Alignment::None), ("mixture/local", Alignment::Local(local))].map(|(name, alignment)| {
        let prior = Prior::Rules(Rules {
            consistent: 0.99,
            close: 0.8,
            inconsistent: 0.35,
            keep: 0.97,
            not_unique: 0.5,
            near_factor: 1.5,
            near: 0.02,
            unique_most: 0.9,
            support: None,
            unconfident: 1.0,
        });
        let outliers = 128_f32.ln();
        (name, Mixture { alignment, stereo_noise: 1.0, mono_spread: 0.4, outliers, cap: 80.0, prior })
    })
}

fn pixels(criterion: &mut Criterion) {
    let Frame { rgb, grey, mask, disparity, stereo, mono, weight } = frame();
    let mut bytes = vec![0u8; SIZE];
    let mut floats = vec![0f32; SIZE];
    let mut group = criterion.benchmark_group(format!("pixels/{}", simd::Level::best().name()));
    group.throughput(Throughput::Elements(SIZE as u64)).sample_size(30);

    group.bench_function("grey", |b| b.iter(|| grey::grey_from_rgb(black_box(&rgb), WIDTH, HEIGHT, &mut bytes)));
    group.bench_function("edges", |b| b.iter(|| edges::edges(black_box(&grey), WIDTH, HEIGHT, 100.0, &mut bytes)));
    group.bench_function("confidence", |b| {
        b.iter(|| confidence::confidence_from_edges(black_box(&mask), WIDTH, HEIGHT, 10.0, &mut floats));
    });
    group.bench_function("depth", |b| {
        b.iter(|| depth::depth_from_disparity(black_box(&disparity), KITTI, 80.0, &mut floats));
    });
    group.bench_function("minmax", |b| b.iter(|| scale::minmax(black_box(&mono), &stereo, &mut floats)));
    group.bench_function("average", |b| b.iter(|| scale::average(black_box(&mono), &stereo, &mut floats)));
    for weighting in [Weighting::Full, Weighting::Confidence] {
        group.bench_function(format!("fuse/{weighting:?}"), |b| {
            b.iter(|| fuse(black_box(&stereo), &mono, &weight, weighting, &mut floats));
        });
    }
    group.bench_function("median3", |b| b.iter(|| median::median3(black_box(&mono), WIDTH, HEIGHT, &mut floats)));
    group.bench_function("median5", |b| b.iter(|| median::median5(black_box(&mono), WIDTH, HEIGHT, &mut floats)));

    let right: Vec<i16> = disparity.iter().map(|&fixed| 8 - fixed).collect();
    let frame = mixture::Frame {
        width: WIDTH,
        height: HEIGHT,
        disparity: Disparities { sixteenths: &disparity, invalid: -16 },
        range_end: 64.0,
        geometry: KITTI,
        mono: &mono,
        mono_deviation: None,
        evidence: StereoEvidence {
            right: Some(Disparities { sixteenths: &right, invalid: 24 }),
            unique: Some(Disparities { sixteenths: &disparity, invalid: -16 }),
            ..StereoEvidence::default()
        },
    };
    for (name, mixture) in mixtures() {
        let mut scratch = MixtureScratch::default();
        let mut maps = [(); 4].map(|()| vec![0f32; SIZE]);
        group.bench_function(name, |b| {
            let [depth, deviation, inlier, aligned] = &mut maps;
            let mut out = Fused { depth, deviation, inlier, aligned };
            b.iter(|| mixture::fuse(&mixture, black_box(&frame), &mut scratch, &mut out));
        });
    }

    let (small_width, small_height) = (320, 96);
    let mut small_rgb = vec![0; 3 * small_width * small_height];
    group.bench_function("area to 320x96", |b| {
        b.iter(|| resize::area_rgb8(black_box(&rgb), WIDTH, HEIGHT, small_width, small_height, &mut small_rgb));
    });
    group.bench_function("bilinear from 320x96", |b| {
        let small = &mono[..small_width * small_height];
        b.iter(|| resize::bilinear_f32(black_box(small), small_width, small_height, WIDTH, HEIGHT, &mut floats));
    });
    group.finish();
}

criterion_group!(benches, pixels);
criterion_main!(benches);
