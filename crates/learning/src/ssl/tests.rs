//! `learn/ssl` as the runner calls it, on small samples.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use depthloom_graphs::values::{Artifact, Curve};
use depthloom_graphs::{Context, Fault, Host, Inputs, Instance, Key, Node, Scratch, Value};
use half::f16;
use serde_json::json;

use super::Ssl;
use crate::samples::{Sample, Samples};

/// Bright is near: something a network can learn.
fn samples(count: usize, seed: usize, right: bool) -> Samples {
    let (width, height) = (64, 32);
    let item = |i: usize| {
        let shade = |p: usize| 40 + ((p % width) / 8 * 23 + (p / width) / 8 * 37 + (i + seed) * 51) % 180;
        let image: Vec<u8> = (0..3 * width * height).map(|p| shade(p % (width * height)) as u8).collect();
        let share = (0..width * height)
            .map(|p| if p % 5 == 0 { f16::NAN } else { f16::from_f32(0.005 + shade(p) as f32 / 3000.0) });
        Sample {
            id: i.to_string(),
            right: right.then(|| image.clone()),
            share: share.collect(),
            image,
            depth_scale: Some(0.3),
            cells: None,
        }
    };
    Samples { width: 64, height: 32, has_right: right, items: (0..count).map(item).collect() }
}

/// A host that asks to end after some steps.
struct Patience {
    threads: usize,
    steps: u64,
    seen: AtomicU64,
    cpu_ns: AtomicU64,
    checkpoint: Option<PathBuf>,
    notices: Mutex<Vec<String>>,
}

impl Patience {
    fn endless(threads: usize) -> Self {
        Self {
            threads,
            steps: u64::MAX,
            seen: AtomicU64::new(0),
            cpu_ns: AtomicU64::new(0),
            checkpoint: None,
            notices: Mutex::default(),
        }
    }
}

impl Host for Patience {
    fn cancelled(&self) -> bool {
        false
    }

    fn stopping(&self) -> bool {
        self.seen.load(Ordering::Relaxed) >= self.steps
    }

    fn warn(&self, what: &str) {
        self.notices.lock().expect("the lock is not poisoned").push(what.to_owned());
    }

    fn info(&self, what: &str) {
        self.warn(what);
    }

    fn key(&self) -> Option<Key> {
        Some(Key::of_content(b"this training"))
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

    fn add_cpu_time(&self, cpu_ns: u64) {
        self.cpu_ns.fetch_add(cpu_ns, Ordering::Relaxed);
    }

    fn checkpoint(&self) -> Option<PathBuf> {
        self.checkpoint.clone()
    }
}

/// The model's bytes and the curve.
fn learn(
    params: serde_json::Value,
    samples: &Samples,
    validation: Option<&Samples>,
    host: &dyn Host,
) -> Result<(Vec<u8>, Curve), Fault> {
    let Instance::Once(node) = Ssl::build(serde_json::from_value(params).expect("parameters"))? else {
        panic!("learn/ssl fires once")
    };
    let declaration = Ssl::declaration();
    let value = |samples: &Samples| Value::Samples(Artifact::samples(samples.encode()).into());
    let values = [Some(value(samples)), validation.map(value)];
    let outputs =
        node.run(&Inputs::new(&declaration.inputs, &values), &mut Context::new(host, &mut Scratch::default()))?;
    match outputs.in_order_of(&declaration.outputs)?.as_slice() {
        [Some(Value::Model(model)), Some(Value::Curve(curve))] => Ok((model.bytes.to_vec(), (**curve).clone())),
        other => panic!("a model and a curve, not {other:?}"),
    }
}

#[test]
fn it_learns_with_every_network_and_loss() {
    let learned = samples(4, 0, true);
    let cases = [
        json!({ "network": "unet-lite", "steps": 60 }),
        json!({ "network": "fcn-lite", "loss": "log-depth", "steps": 60 }),
        json!({ "network": "eigen-coarse", "loss": "depth", "steps": 80, "learning_rate": 5e-4, "flip": false }),
        json!({ "network": "unet-lite", "loss": "depth", "photometric": 0.1, "steps": 60 }),
        json!({ "network": "unet-lite", "loaded": 2, "draws": 5, "crop": 0.3, "schedule": "constant", "steps": 60 }),
    ];
    // The hermetic suite has a case per loss.
    let most = if depthloom_test_needs::is_full() { cases.len() } else { 3 };
    for mut params in cases.into_iter().take(most) {
        params["batch"] = json!(4);
        params["curve_every"] = json!(10);
        let (model, curve) = learn(params.clone(), &learned, None, &Patience::endless(2)).expect("it learns");
        let (first, last) = (curve.points[0].loss, curve.points.last().expect("points").loss);
        assert!(last < 0.8 * first, "{params}: from {first} to {last}");
        assert!(model.len() > 1000);
    }
}

#[test]
fn the_papers_network_keeps_its_first_eight_convolutions() {
    use crate::networks::{Network, Size, layout};
    use crate::onnx::weights::decode_weights;
    let folder = tempfile::tempdir().expect("a folder");
    let layout = layout(Network::FcnVgg16.without_spread(), Size { width: 64, height: 32 });
    let pretrained = layout.start(77);
    let frozen = || layout.parameters.iter().zip(&pretrained).filter(|(parameter, _)| parameter.frozen);
    let bytes: Vec<Vec<u8>> =
        frozen().map(|(_, values)| values.iter().flat_map(|v| v.to_le_bytes()).collect()).collect();
    let views = frozen().zip(&bytes).map(|((parameter, _), bytes)| {
        let view = safetensors::tensor::TensorView::new(safetensors::Dtype::F32, parameter.shape.clone(), bytes);
        (parameter.name.clone(), view.expect("a tensor"))
    });
    let file = folder.path().join("vgg.safetensors");
    std::fs::write(&file, safetensors::serialize(views, None).expect("a file")).expect("written");
    let params = json!({ "network": "fcn-vgg16", "weights": file, "loss": "depth", "steps": 2, "batch": 2 });
    let (model, _) = learn(params, &samples(2, 0, false), None, &Patience::endless(2)).expect("it learns");
    let learned = decode_weights(Path::new("vgg.onnx"), &model).expect("an ONNX file");
    let first = layout.start(1);
    for ((parameter, kept), first) in layout.parameters.iter().zip(&pretrained).zip(&first) {
        let tensor = learned.iter().find(|tensor| tensor.name == parameter.name).expect("every parameter is written");
        assert_eq!(tensor.values == *kept, parameter.frozen, "{}", parameter.name);
        assert!(parameter.frozen || tensor.values != *first, "{} has learned", parameter.name);
    }
}

#[test]
fn fault_27_a_training_asked_to_stop_goes_on_later_to_the_same_bytes() {
    let (learned, held_out) = (samples(3, 0, false), samples(2, 7, false));
    let params = || json!({ "steps": 14, "batch": 2, "curve_every": 3, "checkpoint_every": 4, "patience": 50 });
    let whole = learn(params(), &learned, Some(&held_out), &Patience::endless(1)).expect("it learns");
    for steps in [1, 4, 9] {
        let folder = tempfile::tempdir().expect("a folder");
        let checkpoint = Some(folder.path().join("checkpoints/this.checkpoint"));
        let stopped = Patience { steps, checkpoint: checkpoint.clone(), ..Patience::endless(2) };
        assert!(matches!(learn(params(), &learned, Some(&held_out), &stopped), Err(Fault::Cancelled)));
        assert_eq!(stopped.seen.into_inner(), steps, "it stops when it is asked to");
        let resumed = Patience { checkpoint: checkpoint.clone(), ..Patience::endless(3) };
        let again = learn(params(), &learned, Some(&held_out), &resumed).expect("it learns");
        assert!(again == whole, "stopped after {steps} steps");
        assert!(resumed.cpu_ns.into_inner() > 0, "the pool's threads have worked");
        assert_eq!(resumed.seen.into_inner(), 14 - steps, "what was done is not done again");
        let notices = resumed.notices.into_inner().expect("the lock is not poisoned");
        assert_eq!(notices, [format!("resumes at step {steps} of 14 from a checkpoint of an earlier run")]);
        // The run may be stopped after the training: then the checkpoint is there to resume from.
        let after = Patience { checkpoint, ..Patience::endless(1) };
        assert!(learn(params(), &learned, Some(&held_out), &after).expect("it has learned") == whole);
        assert_eq!(after.seen.into_inner(), 0, "no step is done again");
    }
}

#[test]
fn fault_46_a_damaged_checkpoint_is_said_and_learning_begins_again() {
    let (learned, params) = (samples(2, 0, false), || json!({ "steps": 3, "batch": 2, "checkpoint_every": 1 }));
    let whole = learn(params(), &learned, None, &Patience::endless(1)).expect("it learns");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("this.checkpoint");
    let host = || Patience { checkpoint: Some(path.clone()), ..Patience::endless(1) };
    assert!(learn(params(), &learned, None, &Patience { steps: 2, ..host() }).is_err());
    let mut bytes = std::fs::read(&path).expect("a checkpoint");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(&path, bytes).expect("written");
    let again = host();
    assert!(learn(params(), &learned, None, &again).expect("it learns") == whole);
    assert_eq!(again.seen.into_inner(), 3, "from the first step");
    let notices = again.notices.into_inner().expect("the lock is not poisoned");
    assert_eq!(notices, [format!("the checkpoint {} is damaged: training starts from the first step", path.display())]);
}

#[test]
fn fault_13_a_batch_without_a_target_is_no_divergence_and_no_loss_of_zero() {
    let mut sparse = samples(2, 0, false);
    for item in &mut sparse.items {
        let corner = item.share[1];
        item.share.fill(f16::NAN);
        item.share[1] = corner;
    }
    // Windows on a tenth of the sides: few of them show the corner.
    let params = json!({ "steps": 12, "batch": 1, "crop": 0.9, "curve_every": 1, "flip": false });
    let (_, curve) = learn(params, &sparse, None, &Patience::endless(1)).expect("it has not diverged");
    let (measured, missing): (Vec<f64>, Vec<f64>) =
        curve.points.iter().map(|point| point.loss).partition(|loss| loss.is_finite());
    assert!(missing.iter().all(|loss| loss.is_nan()) && !missing.is_empty(), "{curve:?}");
    assert!(measured.iter().all(|&loss| loss > 0.0), "{curve:?}");
}

#[test]
fn patience_stops_and_the_best_network_is_given() {
    let (learned, held_out) = (samples(2, 0, false), samples(2, 11, false));
    // A rate that cannot get better for long.
    let params = json!({ "steps": 200, "batch": 2, "curve_every": 2, "patience": 2, "learning_rate": 0.05, "schedule": "constant" });
    let (model, curve) = learn(params.clone(), &learned, Some(&held_out), &Patience::endless(2)).expect("it learns");
    let errors: Vec<f64> = curve.points.iter().map(|point| point.validation.expect("it was measured")).collect();
    let best = errors.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(curve.points.len() < 100, "it stopped early");
    assert_eq!(errors[errors.len() - 3], best, "two points after the best: {errors:?}");
    // The same steps without validation give the last network instead.
    let mut last = params;
    last["steps"] = json!(curve.points.last().expect("points").step);
    last["patience"] = json!(null);
    assert!(learn(last, &learned, None, &Patience::endless(2)).expect("it learns").0 != model);
}

#[test]
fn what_does_not_fit_is_said_with_a_remedy() {
    let message = |params: serde_json::Value, samples: &Samples, validation: Option<&Samples>| {
        let Err(fault) = learn(params, samples, validation, &Patience::endless(1)) else { panic!("it must not learn") };
        format!("{} | {}", fault.chain(), fault.remedy_text().expect("a remedy"))
    };
    let good = samples(2, 0, false);
    let none = Samples { items: Vec::new(), ..samples(0, 0, false) };
    assert!(message(json!({}), &none, None).contains("no samples at `samples`"));
    assert!(message(json!({ "patience": 2 }), &good, None).contains("wire validation samples"));
    assert!(message(json!({ "photometric": 1.0 }), &good, None).contains("right: source/right"));
    let mut no_depth = samples(2, 0, false);
    no_depth.items.iter_mut().for_each(|item| item.depth_scale = None);
    assert!(message(json!({ "loss": "depth" }), &no_depth, None).contains("calibration: source/calibration"));
    let odd = Samples {
        width: 40,
        height: 32,
        has_right: false,
        items: vec![Sample {
            id: "odd".to_owned(),
            image: vec![9; 3 * 40 * 32],
            right: None,
            share: vec![f16::from_f32(0.1); 40 * 32],
            depth_scale: None,
            cells: None,
        }],
    };
    assert!(message(json!({}), &odd, None).contains("size: [64, 32]"));
    assert!(message(json!({ "learning_rate": 1e30, "steps": 3 }), &good, None).contains("lower `learning_rate`"));
}

#[test]
fn fault_17_weights_of_another_network_are_refused_before_any_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("other.safetensors");
    let one = 1.0_f32.to_le_bytes();
    let view = safetensors::tensor::TensorView::new(safetensors::Dtype::F32, vec![1], &one).expect("a tensor");
    std::fs::write(&file, safetensors::serialize([("other", view)], None).expect("a file")).expect("written");
    let built = |network: &str| {
        Ssl::build(serde_json::from_value(json!({ "network": network, "weights": file })).expect("parameters"))
    };
    for network in ["unet-lite", "unet-tiny", "fcn-lite", "fcn-vgg16"] {
        let Err(fault) = built(network) else { panic!("{network} must be refused") };
        assert!(fault.remedy_text().is_some_and(|remedy| remedy.contains("other")), "{}", fault.chain());
    }
}
