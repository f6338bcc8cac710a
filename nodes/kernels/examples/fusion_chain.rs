//! Times the fusion chain on raw files.
//!
//! `fusion_chain WIDTH HEIGHT GREY DISPARITY MONO REPEATS` reads grey (u8), disparity (i16, 1/16 px) and mono depth
//! (f32, metres), and prints one JSON line: milliseconds of each kernel (a
//! kernel that runs for several variants: of one run) and of the whole chain, median and best of the repeats.

use std::collections::BTreeMap;
use std::time::Instant;

use depthloom_kernels::fuse::{Weighting, fuse};
use depthloom_kernels::{confidence, depth, edges, median, scale, simd};

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [width, height, repeats] = [0, 1, 5].map(|i| args[i].parse::<usize>().expect("a number"));
    let [grey, disparity, mono] =
        [2, 3, 4].map(|i| std::fs::read(&args[i]).unwrap_or_else(|error| panic!("{}: {error}", args[i])));
    let disparity: Vec<i16> = disparity.as_chunks().0.iter().map(|&bytes| i16::from_le_bytes(bytes)).collect();
    let mono: Vec<f32> = mono.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
    let mut spent: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    let size = width * height;
    let mut mask = vec![0; size];
    let [mut weight, mut stereo, mut minmax, mut average] = std::array::from_fn(|_| vec![0.0; size]);
    let mut merged: [Vec<f32>; 4] = std::array::from_fn(|_| vec![0.0; size]);
    let mut fused = merged.clone();
    for _ in 0..repeats {
        let began = Instant::now();
        let mut lap = {
            let mut last = began;
            let spent = &mut spent;
            move |name| {
                let now = Instant::now();
                spent.entry(name).or_default().push((now - last).as_secs_f64() * 1e3);
                last = now;
            }
        };
        edges::edges(&grey, width, height, 100.0, &mut mask);
        lap("edges");
        confidence::confidence_from_edges(&mask, width, height, 10.0, &mut weight);
        lap("confidence");
        depth::depth_from_disparity(&disparity, 721.5377, 0.532725, 80.0, &mut stereo);
        lap("depth");
        scale::minmax(&mono, &stereo, &mut minmax);
        lap("minmax");
        scale::average(&mono, &stereo, &mut average);
        lap("average");
        let variants = [
            (&minmax, Weighting::Full),
            (&minmax, Weighting::Confidence),
            (&mono, Weighting::Full),
            (&average, Weighting::Full),
        ];
        for (((scaled, weighting), merged), fused) in variants.into_iter().zip(&mut merged).zip(&mut fused) {
            fuse(&stereo, scaled, &weight, weighting, merged);
            lap("fuse");
            median::median5(merged, width, height, fused);
            lap("median5");
        }
        spent.entry("total").or_default().push(began.elapsed().as_secs_f64() * 1e3);
    }
    let line = |pick: fn(&[f64]) -> f64| -> String {
        let laps: Vec<String> = spent.iter().map(|(name, times)| format!("\"{name}\": {:.3}", pick(times))).collect();
        laps.join(", ")
    };
    let (median, best) = (line(|times| sorted(times)[times.len() / 2]), line(|times| sorted(times)[0]));
    println!("{{\"simd\": \"{}\", \"median_ms\": {{{median}}}, \"best_ms\": {{{best}}}}}", simd::Level::best().name());
}

fn sorted(times: &[f64]) -> Vec<f64> {
    let mut times = times.to_vec();
    times.sort_unstable_by(f64::total_cmp);
    times
}
