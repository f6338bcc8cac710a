//! What recording a KITTI-sized frame costs: encoding part by part, and writing.
//!
//! The maps are made to compress as those of real frames do: piecewise smooth disparities with noise, depths of them,
//! sparse truth, and noisy floats.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use depthloom_graphs::contracts::{Commit, Sink, Slot};
use depthloom_graphs::plan::{FrameIndex, NodeId, PartId, Plan, PortId, RunId};
use depthloom_graphs::values::{Calibration, Depth, Disparity, Encoded, Image, ImageFormat, Pixels, Raster, Weight};
use depthloom_graphs::{Frame, Value};
use depthloom_recording::{Recorder, Recording};
use image::RgbImage;

#[expect(dead_code, reason = "the bench takes the plan and the noise from the tests' fixture")]
#[path = "../tests/recording/fixture.rs"]
mod fixture;

const WIDTH: u32 = 1242;
const HEIGHT: u32 = 375;
/// Computed depths beyond the one of the fixture's `fused`: in all nine depth maps with stereo.
const MORE_MAPS: usize = 7;

fn plan() -> Plan {
    let mut plan = fixture::plan();
    let nodes = &mut plan.runs[0].nodes;
    for map in 0..MORE_MAPS {
        let mut node = nodes[3].clone();
        node.outputs[0].topic = format!("/compare/map{map}/depth");
        nodes.push(node);
    }
    plan
}

/// The values of a frame, in plan order, without scores.
fn values(frame: &Frame) -> Vec<(Slot, Value)> {
    let mut noise = fixture::Noise(frame.index + 1);
    let mut image = || {
        let mut image = RgbImage::new(WIDTH, HEIGHT);
        for (x, y, pixel) in image.enumerate_pixels_mut() {
            *pixel =
                image::Rgb([(x / 3) as u8, (y / 2) as u8, ((x + y) / 5) as u8].map(|c| c ^ (noise.bits() % 16) as u8));
        }
        // Any bytes do: recordings keep them as they are. A KITTI image has about 850 kB.
        let bytes: Arc<[u8]> = (0..850_000).map(|_| noise.bits() as u8).collect();
        Value::from(Image::with_encoded(Pixels::Rgb(image), Encoded { format: ImageFormat::Png, bytes }))
    };
    let (left, right) = (image(), image());
    let mut column = 0_u32;
    let sixteenths_px: Raster<i16> = fixture::raster(WIDTH, HEIGHT, || {
        column += 1;
        let (x, y) = (column % WIDTH, column / WIDTH);
        let surface = (x / 40 * 37 % 20 + y / 8) as i16 * 16;
        if noise.bits().is_multiple_of(9) { -16 } else { surface + (noise.bits() % 4) as i16 }
    });
    let metres = sixteenths_px.iter().map(|&d| if d > 0 { (386.0 * 16.0 / f32::from(d)).min(80.0) } else { f32::NAN });
    let stereo = Raster::from_raw(WIDTH, HEIGHT, metres.collect()).expect("as large as the disparities");
    let mut noisy = || fixture::raster(WIDTH, HEIGHT, || noise.share() * 80.0);
    let maps: Vec<Depth> = (0..=MORE_MAPS).map(|_| Depth { metres: noisy() }).collect();
    let weight = Weight { share: noisy() };
    let truth = fixture::raster(WIDTH, HEIGHT, || match noise.bits() % 5 {
        0 => 386.0 * 256.0 / (1 + noise.bits() % 20_000) as f32,
        _ => f32::NAN,
    });
    let calibration = Calibration {
        width: WIDTH,
        height: HEIGHT,
        focal_px: 721.5377,
        cx_px: 609.5593,
        cy_px: 172.854,
        baseline_m: 0.532_725,
        doffs_px: 0.0,
    };
    let node = |node| Slot::Node { node, port: PortId(0) };
    let source = |port| Slot::Source { port };
    let mut values: Vec<(Slot, Value)> = vec![
        (source(PortId(0)), left),
        (source(PortId(1)), right),
        (source(PortId(2)), Depth { metres: truth }.into()),
        (source(PortId(3)), calibration.into()),
        (node(NodeId(0)), Disparity { sixteenths_px, min_disparity_px: 0 }.into()),
        (node(NodeId(1)), Depth { metres: stereo }.into()),
        (node(NodeId(2)), weight.into()),
    ];
    // `fused` is node 3, the further maps come after the fixture's six nodes.
    let nodes = std::iter::once(3).chain(6..);
    values.extend(maps.into_iter().zip(nodes).map(|(map, of)| (node(NodeId(of)), map.into())));
    values
}

fn megabytes(path: &std::path::Path) -> f64 {
    std::fs::metadata(path).map_or(f64::NAN, |metadata| metadata.len() as f64 / 1e6)
}

fn recording_a_frame(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("recording.mcap");
    let frame = fixture::frame(0);
    let values = values(&frame);
    let recorder = Recorder::create(&path, &plan()).expect("a recorder");
    let of_part = |part| {
        let of_part = values.iter().filter(|(slot, _)| recorder.part(RunId(0), *slot) == Some(part));
        of_part.cloned().collect::<Vec<_>>()
    };
    let encode = |part, values: &[_]| recorder.encode(RunId(0), (FrameIndex(0), &frame), part, values).expect("a part");
    let raw: usize = values.iter().map(|(_, value)| size(value)).sum();
    let mut group = criterion.benchmark_group("KITTI frame");
    for (part, name) in ["camera", "truth", "fixed point", "maps"].into_iter().enumerate() {
        let values = of_part(PartId(part));
        group.throughput(Throughput::Bytes(values.iter().map(|(_, value)| size(value) as u64).sum()));
        group.bench_function(format!("encode {name}"), |bencher| {
            bencher.iter(|| black_box(encode(PartId(part), &values)));
        });
    }
    let parts: Vec<_> = PartId::all(4).map(of_part).collect();
    let commit = Commit {
        run: RunId(0),
        frame: &frame,
        source_key: None,
        keys: &[],
        failures: &[],
        absent: &[],
        warnings: &[],
        live: None,
    };
    group.throughput(Throughput::Bytes(raw as u64));
    group.bench_function("write", |bencher| {
        bencher.iter_custom(|times| {
            let mut spent = Duration::ZERO;
            let mut target = Recorder::create(&path, &plan()).expect("a recorder");
            for time in 0..times {
                if time % 20 == 19 {
                    // A file of bounded size, so that the machine's memory and not its disk is measured.
                    target = Recorder::create(&path, &plan()).expect("a recorder");
                }
                let encoded = parts.iter().enumerate().map(|(part, values)| encode(PartId(part), values)).collect();
                let start = Instant::now();
                target.write(&commit, encoded).expect("written");
                spent += start.elapsed();
            }
            spent
        });
    });
    group.finish();

    let frames = folder.path().join("frames.mcap");
    let recorder = Recorder::create(&frames, &plan()).expect("a recorder");
    for _ in 0..10 {
        let parts = parts
            .iter()
            .enumerate()
            .map(|(part, values)| recorder.encode(RunId(0), (FrameIndex(0), &frame), PartId(part), values));
        let parts = parts.collect::<Result<_, _>>().expect("parts");
        recorder.write(&commit, parts).expect("written");
    }
    recorder.finish(&[]).expect("finished");
    println!("a frame: {:.1} MB of values, {:.1} MB in the recording", raw as f64 / 1e6, megabytes(&frames) / 10.0);
    let recording = Recording::open(&frames).expect("a recording");
    let topics = ["/compare/source/depth", "/compare/fused/depth", "/compare/depth/depth"];
    criterion.bench_function("read truth, stereo and one map of a frame", |bencher| {
        let mut reader = recording.reader(RunId(0), &topics).expect("topics");
        bencher.iter(|| black_box(reader.read(FrameIndex(3)).expect("values")));
    });
}

/// Bytes of a value's pixels, or of its file.
fn size(value: &Value) -> usize {
    match value {
        Value::Image(image) => image.encoded().map_or(0, |encoded| encoded.bytes.len()),
        Value::Disparity(disparity) => 2 * disparity.sixteenths_px.len(),
        Value::Depth(depth) => 4 * depth.metres.len(),
        Value::Weight(weight) => 4 * weight.share.len(),
        _ => 0,
    }
}

criterion_group! { name = benches; config = Criterion::default().sample_size(20); targets = recording_a_frame }
criterion_main!(benches);
