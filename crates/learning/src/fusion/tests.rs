//! `learn/fusion` as the runner calls it, on small samples.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

use depthloom_graphs::values::{Artifact, Curve};
use depthloom_graphs::{Context, Fault, Host, Inputs, Instance, Node, Scratch, Value};
use depthloom_kernels::learned::{BLOCK, Cell, MAPS, Opinion, block_means, ln};
use depthloom_random::SplitMix64;
use half::f16;
use serde_json::{Value as Json, json};

use super::TrainFusion;
use super::batch::hidden;
use super::params::FusionParams;
use crate::compute::{Engine, Input};
use crate::networks::{FusionUnet, Size, layout};
use crate::onnx::weights::decode_weights;
use crate::samples::{Sample, Samples, SamplesView, cell_bytes};

const WIDTH: usize = 64;
const HEIGHT: usize = 32;

/// A road that comes nearer towards the bottom, and a monocular estimate that is off by up to 0.3 in log depth, in
/// blocks that nothing predicts. Stereo is right, but in the right quarter, where the image is bright, confidently
/// twice as far.
fn samples(count: usize, seed: usize) -> Samples {
    let item = |index: usize| {
        let share =
            |at: usize| 0.01 + 0.03 * ((at / WIDTH) as f32 / HEIGHT as f32) + 0.002 * ((index + seed) % 5) as f32;
        let is_wrong = |at: usize| at % WIDTH >= 3 * WIDTH / 4;
        let grey = |at: usize| {
            let at = at % (WIDTH * HEIGHT);
            let noise = (at * 7919 + (index + seed) * 104_729) % 40;
            if is_wrong(at) { 180 + noise } else { 60 + noise }
        };
        let cell = |at: usize| {
            let stereo = if is_wrong(at) { share(at) * 0.5 } else { share(at) };
            let block = (at / WIDTH / 4 * 16 + at % WIDTH / 4 + (index + seed) * 128) as u64;
            let mono = share(at) * (0.3 * SplitMix64::part(9, block).sign_unit()).exp();
            cell_bytes(&Cell { stereo, covered: 1.0, consistent: 1.0, mono, weight: 0.5 })
        };
        Sample {
            id: index.to_string(),
            image: (0..3 * WIDTH * HEIGHT).map(|at| grey(at) as u8).collect(),
            right: None,
            share: (0..WIDTH * HEIGHT).map(|at| f16::from_f32(share(at))).collect(),
            depth_scale: Some(0.3),
            cells: Some((0..WIDTH * HEIGHT).map(cell).collect()),
        }
    };
    Samples { width: 64, height: 32, has_right: false, items: (0..count).map(item).collect() }
}

/// A host that asks to end after some steps.
struct Steps {
    threads: usize,
    most: u64,
    seen: AtomicU64,
    checkpoint: Option<PathBuf>,
}

impl Steps {
    fn endless(threads: usize) -> Self {
        Self { threads, most: u64::MAX, seen: AtomicU64::new(0), checkpoint: None }
    }
}

impl Host for Steps {
    fn cancelled(&self) -> bool {
        false
    }

    fn stopping(&self) -> bool {
        self.seen.load(Ordering::Relaxed) >= self.most
    }

    fn progress(&self, _done: u64, _total: u64, _message: &str) {
        self.seen.fetch_add(1, Ordering::Relaxed);
    }

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).for_each(f);
    }

    fn width(&self) -> usize {
        self.threads
    }

    fn checkpoint(&self) -> Option<PathBuf> {
        self.checkpoint.clone()
    }
}

/// The model's bytes and the curve.
fn learn(
    params: &Json,
    samples: &Samples,
    validation: Option<&Samples>,
    host: &dyn Host,
) -> Result<(Vec<u8>, Curve), Fault> {
    let params: FusionParams = serde_json::from_value(params.clone()).expect("parameters");
    TrainFusion::check(&params).map_err(|(_, what)| Fault::new(what))?;
    let Instance::Once(node) = TrainFusion::build(params)? else { panic!("learn/fusion runs once") };
    let declaration = TrainFusion::declaration();
    let value = |samples: &Samples| Value::Samples(Artifact::samples(samples.encode()).into());
    let values = [Some(value(samples)), validation.map(value)];
    let outputs =
        node.run(&Inputs::new(&declaration.inputs, &values), &mut Context::new(host, &mut Scratch::default()))?;
    match outputs.in_order_of(&declaration.outputs)?.as_slice() {
        [Some(Value::Model(model)), Some(Value::Curve(curve))] => Ok((model.bytes.to_vec(), (**curve).clone())),
        other => panic!("a model and a curve, not {other:?}"),
    }
}

fn small() -> Json {
    json!({ "steps": 10, "batch": 3, "window": [32, 32], "curve_every": 5, "checkpoint_every": 4 })
}

#[test]
fn it_learns_to_prefer_the_monocular_estimate_where_stereo_is_wrong() {
    let learned = samples(5, 0);
    let params = json!({ "steps": 800, "batch": 4, "window": null, "flip": false, "distortion": 0.05, "curve_every": 40,
        "learning_rate": 4e-3 });
    let (model, curve) = learn(&params, &learned, None, &Steps::endless(2)).expect("it learns");
    let (first, last) = (curve.points[0].loss, curve.points.last().expect("points").loss);
    assert!(last < first - 0.25, "from {first} to {last}");
    // Other frames of the same road, all of stereo as it is.
    let other = samples(2, 3).encode();
    let other = SamplesView::read(&other).expect("samples");
    let size = Size { width: WIDTH, height: HEIGHT };
    let layout = layout(FusionUnet, size);
    let weights = decode_weights(std::path::Path::new("fusion.onnx"), &model).expect("an ONNX file");
    let parameters: Vec<Vec<f32>> = layout
        .parameters
        .iter()
        .map(|parameter| {
            let weights = weights.iter().find(|weights| weights.name == parameter.name).expect("it is written");
            weights.values.clone()
        })
        .collect();
    let sample = &other.items[0];
    let cells: Vec<Cell> = (0..WIDTH * HEIGHT).map(|at| sample.cell(at)).collect();
    let mut planes: Vec<f32> = sample.image.iter().map(|&value| f32::from(value) / 255.0).collect();
    (0..5).for_each(|plane| planes.extend(cells.iter().map(|cell| cell.planes()[plane])));
    let planes = Input { values: planes, shape: [1, 8, HEIGHT, WIDTH] };
    let maps = Engine::new(FusionUnet, &layout).maps(&planes, &parameters);
    assert_eq!(maps.len(), MAPS * WIDTH * HEIGHT);
    let (residuals, ..) = block_means(&maps[cells.len()..2 * cells.len()], WIDTH, HEIGHT);
    let (mut wrong, mut right) = ((0.0, 0.0), (0.0, 0.0));
    for (at, cell) in cells.iter().enumerate() {
        let residual = residuals[at / WIDTH / BLOCK * (WIDTH / BLOCK) + at % WIDTH / BLOCK];
        let opinion = Opinion::new([maps[at], residual, maps[2 * cells.len() + at]]);
        let fused = opinion.log_share(Some(ln(cell.stereo)), ln(cell.mono));
        let error = (fused - ln(sample.share(at).to_f32())).abs();
        let sums = if at % WIDTH >= 3 * WIDTH / 4 { &mut wrong } else { &mut right };
        *sums = (sums.0 + error, sums.1 + opinion.gate);
    }
    let mean = |sum: f32, share: f32| sum / (share * cells.len() as f32);
    // Stereo is off by 0.69, and the monocular estimate by 0.15 on average.
    assert!(mean(wrong.0, 0.25) < 0.25, "error where stereo is wrong: {}", mean(wrong.0, 0.25));
    assert!(mean(right.0, 0.75) < 0.05, "error where stereo is right: {}", mean(right.0, 0.75));
    assert!(mean(wrong.1, 0.25) < mean(right.1, 0.75) - 0.25, "gates {} {}", mean(wrong.1, 0.25), mean(right.1, 0.75));
}

#[test]
fn bytes_are_equal_with_any_number_of_threads_and_after_a_stop() {
    let (learned, held_out) = (samples(3, 0), samples(2, 7));
    let whole = learn(&small(), &learned, Some(&held_out), &Steps::endless(1)).expect("it learns");
    assert!(learn(&small(), &learned, Some(&held_out), &Steps::endless(3)).expect("it learns") == whole);
    let folder = tempfile::tempdir().expect("a folder");
    let checkpoint = Some(folder.path().join("this.checkpoint"));
    let stopped = Steps { most: 6, checkpoint: checkpoint.clone(), ..Steps::endless(2) };
    assert!(matches!(learn(&small(), &learned, Some(&held_out), &stopped), Err(Fault::Cancelled)));
    let resumed = Steps { checkpoint, ..Steps::endless(2) };
    assert!(learn(&small(), &learned, Some(&held_out), &resumed).expect("it learns") == whole);
    assert_eq!(resumed.seen.into_inner(), 4, "what was done is not done again");
    let mut other = small();
    other["seed"] = json!(2);
    assert!(learn(&other, &learned, Some(&held_out), &Steps::endless(1)).expect("it learns") != whole);
}

#[test]
fn validation_hides_the_same_blocks_each_time() {
    let bytes = samples(2, 0).encode();
    let samples = SamplesView::read(&bytes).expect("samples");
    let params = FusionParams::default();
    let (all, seen) = hidden(&params, &samples, 0..2);
    let (second, _) = hidden(&params, &samples, 1..2);
    assert_eq!(all.shape, [2, 8, HEIGHT, WIDTH]);
    assert!(all.values[8 * WIDTH * HEIGHT..] == second.values);
    assert!(seen.iter().any(|seen| seen.stereo.is_none()));
}

#[test]
fn what_does_not_fit_is_reported_with_a_remedy() {
    let message = |params: Json, samples: &Samples| match learn(&params, samples, None, &Steps::endless(1)) {
        Ok(_) => panic!("{params} must not learn"),
        Err(fault) => format!("{} | {}", fault.chain(), fault.remedy_text().unwrap_or_default()),
    };
    let good = samples(2, 0);
    assert!(message(json!({ "patience": 2, "window": null }), &good).contains("wire validation samples"));
    assert!(message(json!({}), &good).contains("`window` is 320x96, larger than the samples at `samples` (64x32)"));
    assert!(message(json!({ "window": [24, 32] }), &good).contains("not multiples of 16"));
    assert!(message(json!({ "hidden": 0.8, "wrong": 0.3 }), &good).contains("add up to 1.1"));
    let mut plain = samples(1, 0);
    plain.items[0].cells = None;
    assert!(message(json!({ "window": null }), &plain).contains("collect them with `learn/fusion-samples`"));
    let none = Samples { items: Vec::new(), ..samples(1, 0) };
    assert!(message(json!({ "window": null }), &none).contains("no frame had a target"));
    assert!(message(json!({ "window": null, "learning_rate": 1e30, "steps": 3 }), &good).contains("learning_rate"));
}
