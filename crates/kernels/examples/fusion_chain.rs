//! Times the fusion chain on raw files; the measuring half that is ours of `bench/fusion.sh`.
//!
//! `fusion_chain WIDTH HEIGHT FOCAL_PX GREY DISPARITY MONO OUT` reads grey (u8), disparity (i16, 1/16 px) and mono
//! depth (f32, metres), little-endian. Each line of standard input is a number of threads, 1 or 2: the chain runs once,
//! its scalings and variants on that many threads, and one line of JSON has the milliseconds of each step and of all of
//! it took. The line `write` writes `OUT/<variant>.raw`.

use std::io::{BufRead, Write};
use std::sync::Mutex;
use std::time::Instant;

use depthloom_kernels::fuse::{Weighting, fuse};
use depthloom_kernels::tiles::{Serial, Tiles};
use depthloom_kernels::{confidence, depth, edges, median, scale};
use depthloom_threads::Budget;

const BASELINE_METRES: f64 = 0.532725;
const CAP_METRES: f32 = 80.0;
const SIGMA_PX: f64 = 10.0;
const VARIANTS: [&str; 4] = ["full", "no_weighting", "no_scaling", "average_scaling"];

struct Frame {
    width: usize,
    height: usize,
    focal_px: f64,
    grey: Vec<u8>,
    disparity: Vec<i16>,
    mono: Vec<f32>,
}

/// What the chain makes, kept from run to run as the runner keeps its buffers.
struct Maps {
    mask: Vec<u8>,
    weight: Vec<f32>,
    stereo: Vec<f32>,
    minmax: Vec<f32>,
    average: Vec<f32>,
    merged: [Vec<f32>; 4],
    fused: [Vec<f32>; 4],
}

impl Maps {
    fn new(size: usize) -> Self {
        let map = || vec![0.0; size];
        Self {
            mask: vec![0; size],
            weight: map(),
            stereo: map(),
            minmax: map(),
            average: map(),
            merged: std::array::from_fn(|_| map()),
            fused: std::array::from_fn(|_| map()),
        }
    }
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [width, height] = [0, 1].map(|i| args[i].parse::<usize>().expect("a size"));
    let [grey, disparity, mono] =
        [3, 4, 5].map(|i| std::fs::read(&args[i]).unwrap_or_else(|error| panic!("{}: {error}", args[i])));
    let frame = Frame {
        width,
        height,
        focal_px: args[2].parse().expect("a focal length"),
        grey,
        disparity: disparity.as_chunks().0.iter().map(|&bytes| i16::from_le_bytes(bytes)).collect(),
        mono: mono.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect(),
    };
    let mut maps = Maps::new(width * height);
    let budget = Budget::new(2);
    let _own = budget.permit();
    for line in std::io::stdin().lock().lines() {
        let answer = match line.expect("standard input can be read").trim() {
            "1" => chain(&frame, &mut maps, &Serial),
            "2" => chain(&frame, &mut maps, &budget),
            "write" => {
                for (name, fused) in VARIANTS.iter().zip(&maps.fused) {
                    let path = format!("{}/{name}.raw", args[6]);
                    let bytes: Vec<u8> = fused.iter().flat_map(|depth| depth.to_le_bytes()).collect();
                    std::fs::write(&path, bytes).unwrap_or_else(|error| panic!("{path}: {error}"));
                }
                "{}".to_owned()
            }
            other => panic!("1, 2 or write is expected, not {other:?}"),
        };
        println!("{answer}");
        std::io::stdout().flush().expect("standard output can be written");
    }
}

/// Runs the chain once; its times as JSON.
fn chain(frame: &Frame, maps: &mut Maps, tiles: &dyn Tiles) -> String {
    let Frame { width, height, focal_px, grey, disparity, mono } = frame;
    let (width, height) = (*width, *height);
    let mut laps = Vec::new();
    let began = Instant::now();
    let mut last = began;
    let mut lap = |step: &str| {
        let now = Instant::now();
        laps.push(format!("\"{step}\": {:.4}", (now - last).as_secs_f64() * 1e3));
        last = now;
    };

    edges::edges(grey, width, height, 100.0, &mut maps.mask);
    lap("edges");

    confidence::confidence_from_edges(&maps.mask, width, height, SIGMA_PX, &mut maps.weight);
    lap("confidence");

    let pair = depth::Geometry { focal_px: *focal_px, baseline_metres: BASELINE_METRES, doffs_px: 0.0 };
    depth::depth_from_disparity(disparity, pair, CAP_METRES, &mut maps.stereo);
    lap("depth");

    let Maps { weight, stereo, minmax, average, merged, fused, .. } = maps;
    let scaled = [Mutex::new(minmax), Mutex::new(average)];
    tiles.run(2, &|index| {
        let mut out = scaled[index].lock().expect("no tile panicked");
        [scale::minmax, scale::average][index](mono, stereo, &mut out);
    });
    let [minmax, average] = scaled.map(|map| map.into_inner().expect("no tile panicked"));
    lap("scale");

    let variants = [
        (&*minmax, Weighting::Full),
        (&*minmax, Weighting::Confidence),
        (mono, Weighting::Full),
        (&*average, Weighting::Full),
    ];
    let outs: Vec<_> = merged.iter_mut().zip(fused).map(Mutex::new).collect();
    tiles.run(4, &|index| {
        let (scaled, weighting) = variants[index];
        let (merged, fused) = &mut *outs[index].lock().expect("no tile panicked");
        fuse(stereo, scaled, weight, weighting, merged);
        median::median5(merged, width, height, fused);
    });
    lap("fuse and median");
    lap_total(&laps, began)
}

fn lap_total(laps: &[String], began: Instant) -> String {
    format!("{{{}, \"total\": {:.4}}}", laps.join(", "), began.elapsed().as_secs_f64() * 1e3)
}
