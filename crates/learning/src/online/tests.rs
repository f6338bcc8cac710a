//! `learn/online` as runners call it: batch runs, live runs, and replays of live runs.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use depthloom_graphs::contracts::NodeDeclaration;
use depthloom_graphs::values::{Artifact, Calibration, Curve, Disparity, Image, Mask, Number, Pixels, Raster};
use depthloom_graphs::{Context, Fault, Frame, Host, Inputs, Key, Node, OrderedNode, Outputs, Scratch, Value};
use depthloom_kernels::resize::bilinear_f32;
use image::{Luma, RgbImage};
use serde_json::json;
use tract_onnx::prelude::{Framework, InferenceModelExt, IntoRunnable, TValue, Tensor, tvec};

use super::Online;
use super::params::OnlineParams;
use crate::networks::{Network, Size, export, layout};
use crate::samples::small;

const WIDTH: u32 = 128;
const HEIGHT: u32 = 64;
const CALIBRATION: Calibration = Calibration {
    width: WIDTH,
    height: HEIGHT,
    focal_px: 90.0,
    cx_px: 64.0,
    cy_px: 32.0,
    baseline_m: 0.5,
    doffs_px: 0.0,
};

/// A host that records what a node observed.
struct TestHost {
    width: usize,
    is_live: bool,
    observed: Mutex<Vec<Key>>,
}

impl TestHost {
    fn batch(width: usize) -> Self {
        Self { width, is_live: false, observed: Mutex::default() }
    }

    fn live() -> Self {
        Self { is_live: true, ..Self::batch(2) }
    }

    fn observed(&self) -> Vec<Key> {
        self.observed.lock().expect("the lock is not poisoned").clone()
    }
}

impl Host for TestHost {
    fn cancelled(&self) -> bool {
        false
    }

    fn progress(&self, _done: u64, _total: u64, _message: &str) {}

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).for_each(f);
    }

    fn width(&self) -> usize {
        self.width
    }

    fn is_live(&self) -> bool {
        self.is_live
    }

    fn observe(&self, what: Key) {
        self.observed.lock().expect("the lock is not poisoned").push(what);
    }
}

/// Bright is near: something a network can learn. Every fifth frame has no target.
fn frame_values(index: usize) -> [(&'static str, Value); 4] {
    let shade = |x: u32, y: u32| 40 + ((x / 8 * 23 + y / 8 * 37 + index as u32 * 11) % 180) as u8;
    let image = RgbImage::from_fn(WIDTH, HEIGHT, |x, y| image::Rgb([shade(x, y), shade(x, y), shade(x, y) / 2]));
    let sixteenths_px = Raster::from_fn(WIDTH, HEIGHT, |x, y| Luma([8 + i16::from(shade(x, y))]));
    let set = if index % 5 == 4 { 0 } else { 255 };
    [
        ("image", Image::new(Pixels::Rgb(image)).into()),
        ("target", Disparity { sixteenths_px, min_disparity_px: 0 }.into()),
        ("mask", Mask { set: Raster::from_pixel(WIDTH, HEIGHT, Luma([set])) }.into()),
        ("calibration", CALIBRATION.into()),
    ]
}

fn params(changes: &serde_json::Value) -> OnlineParams {
    let mut params = json!({
        "network": "unet-tiny", "size": [64, 32], "memory": 4, "first": 2, "period": 3, "steps": 3, "batch": 2,
    });
    for (name, value) in changes.as_object().expect("an object") {
        params[name] = value.clone();
    }
    serde_json::from_value(params).expect("parameters")
}

/// A node with its inputs besides those of [`frame_values`].
struct Run<'a> {
    node: Box<Online>,
    declaration: NodeDeclaration,
    model: Option<&'a [u8]>,
    host: &'a TestHost,
    next: usize,
}

/// The bits of a frame's depth, if it has one, and its version.
type FrameOutput = (Option<Vec<u32>>, u64);

impl<'a> Run<'a> {
    fn new(changes: &serde_json::Value, host: &'a TestHost) -> Self {
        let node = Box::new(Online::new(params(changes)));
        Self { node, declaration: Online::declaration(), model: None, host, next: 0 }
    }

    fn frame(&mut self, scheduled: Option<f64>) -> Result<FrameOutput, Fault> {
        let index = self.next;
        self.next += 1;
        let of_frame = frame_values(index);
        let value = |name: &str| match name {
            "model" => self.model.map(|model| Value::Model(Artifact::model(model.to_vec()).into())),
            "schedule" => scheduled.map(|value| Number { value }.into()),
            _ => of_frame.iter().find(|(port, _)| *port == name).map(|(_, value)| value.clone()),
        };
        let values: Vec<Option<Value>> = self.declaration.inputs.iter().map(|port| value(port.name)).collect();
        let frame = Frame::at_10_hz(index.to_string(), index as u64);
        let inputs = Inputs::new(&self.declaration.inputs, &values);
        let outputs = self.node.process(&frame, &inputs, &mut Context::new(self.host, &mut Scratch::default()))?;
        let outputs = ordered(outputs, &self.declaration)?;
        let [depth, Some(Value::Number(version)), None, None] = outputs.as_slice() else { panic!("{outputs:?}") };
        let depth = depth.as_ref().map(|depth| {
            let Value::Depth(depth) = depth else { panic!("a depth") };
            depth.metres.iter().map(|metres| metres.to_bits()).collect()
        });
        Ok((depth, version.value as u64))
    }

    fn finish(self) -> (Vec<u8>, Curve) {
        let outputs = self.node.finish(&mut Context::new(self.host, &mut Scratch::default())).expect("it finishes");
        let outputs = outputs.entries().map(|(_, value)| value.clone()).collect::<Vec<_>>();
        let [Value::Model(model), Value::Curve(curve)] = outputs.as_slice() else { panic!("{outputs:?}") };
        (model.bytes.to_vec(), (**curve).clone())
    }
}

fn ordered(outputs: Outputs, declaration: &NodeDeclaration) -> Result<Vec<Option<Value>>, Fault> {
    let mut ports = declaration.outputs.clone();
    ports.iter_mut().for_each(|port| *port = port.clone().optional());
    outputs.in_order_of(&ports)
}

fn versions(outputs: &[FrameOutput]) -> Vec<u64> {
    outputs.iter().map(|(_, version)| *version).collect()
}

fn batch(changes: &serde_json::Value, workers: usize, count: usize) -> (Vec<FrameOutput>, Vec<u8>, Curve) {
    let host = TestHost::batch(workers);
    let mut run = Run::new(changes, &host);
    let outputs = (0..count).map(|_| run.frame(None).expect("it runs")).collect();
    let (model, curve) = run.finish();
    assert_eq!(host.observed(), [], "a run that waits is never disturbed");
    (outputs, model, curve)
}

#[test]
fn batch_runs_replace_networks_on_time_and_do_not_depend_on_workers() {
    let (outputs, model, curve) = batch(&json!({}), 1, 9);
    // The second sample is that of frame 1, and the next round starts with the replacement.
    assert_eq!(versions(&outputs), [0, 0, 0, 0, 1, 1, 1, 2, 2]);
    assert!(outputs.iter().all(|(depth, version)| depth.is_some() == (*version > 0)));
    assert_eq!(curve.points.iter().map(|point| point.step).collect::<Vec<_>>(), [3, 6]);
    let others = batch(&json!({}), 8, 9);
    assert!((outputs, model, curve) == others, "8 workers give other results");
}

#[test]
fn a_postponed_replacement_is_observed_and_its_replay_has_the_same_bits() {
    let changes = json!({ "period": 1, "steps": 40 });
    let host = TestHost::live();
    let mut run = Run::new(&changes, &host);
    let mut outputs = Vec::new();
    while outputs.last().is_none_or(|(_, version)| *version < 3) && outputs.len() < 5000 {
        outputs.push(run.frame(None).expect("it runs"));
        if outputs.len() > 6 {
            std::thread::sleep(Duration::from_millis(2));
        }
    }
    let (model, curve) = run.finish();
    let recorded = versions(&outputs);
    assert_eq!(recorded.last(), Some(&3), "three rounds in {} frames", recorded.len());
    // Due are the frame after the second sample (frame 2), and each frame after a replacement. A frame on which
    // a replacement was due without being made was disturbed.
    let expected = recorded.iter().enumerate().skip(2).filter(|(at, version)| **version == recorded[at - 1]).count();
    assert!(expected > 0, "nothing was postponed: {recorded:?}");
    let observed = host.observed();
    assert_eq!(observed.len(), expected);
    let different: std::collections::BTreeSet<String> = observed.iter().map(Key::to_string).collect();
    assert_eq!(different.len(), expected, "each has a key of its own");

    let host = TestHost::batch(3);
    let mut run = Run::new(&changes, &host);
    let replayed: Vec<FrameOutput> =
        recorded.iter().map(|version| run.frame(Some(*version as f64)).expect("it runs")).collect();
    assert!(replayed == outputs, "the replay has other depths or versions");
    assert!(run.finish() == (model, curve), "the replay has another network");
    assert_eq!(host.observed(), []);
}

#[test]
fn a_live_run_that_is_not_disturbed_observes_nothing_and_equals_a_batch_run() {
    let host = TestHost::live();
    let mut run = Run::new(&json!({}), &host);
    let mut outputs = Vec::new();
    for _ in 0..9 {
        run.node.wait_for_training();
        outputs.push(run.frame(None).expect("it runs"));
    }
    let (model, curve) = run.finish();
    assert_eq!(host.observed(), []);
    assert!((outputs, model, curve) == batch(&json!({}), 2, 9));
}

#[test]
fn depth_is_what_an_onnx_engine_computes_from_the_output_model() {
    let (outputs, model, _) = batch(&json!({ "steps": 30 }), 2, 9);
    let session = tract_onnx::onnx().model_for_read(&mut model.as_slice()).expect("tract reads it");
    let session = session.into_optimized().expect("a network").into_runnable().expect("a network");
    let last = frame_values(8);
    let Value::Image(image) = &last[0].1 else { panic!("an image") };
    let planes = small([64, 32], "image", image).expect("it shrinks");
    let seen: Vec<f32> = planes.iter().map(|&sample| f32::from(sample) / 255.0).collect();
    let seen = Tensor::from_shape(&[1, 3, 32, 64], &seen).expect("a tensor");
    let output = session.run(tvec![TValue::from(seen)]).expect("tract runs it");
    let share: Vec<f32> = output[0].to_plain_array_view::<f32>().expect("numbers").iter().copied().collect();
    let mut full = vec![0.0; (WIDTH * HEIGHT) as usize];
    bilinear_f32(&share, 64, 32, WIDTH as usize, HEIGHT as usize, &mut full);
    let depth = outputs[8].0.as_ref().expect("version 2 gives depth");
    let mut spread = (f32::MAX, f32::MIN);
    for (&bits, share) in depth.iter().zip(full) {
        let metres = f32::from_bits(bits);
        let found = (CALIBRATION.focal_baseline_px_m() / f64::from(metres) / f64::from(WIDTH)) as f32;
        // As in `written_networks`: a share of the output's range, 0.1.
        assert!((found - share).abs() <= 1e-4 * 0.1, "{found} is not {share}");
        spread = (spread.0.min(metres), spread.1.max(metres));
    }
    assert!(spread.1 > 1.01 * spread.0, "one depth would equal whatever the layers do: {spread:?}");
}

#[test]
fn a_run_continues_with_the_network_at_its_input() {
    let (outputs, model, _) = batch(&json!({}), 2, 9);
    let host = TestHost::batch(2);
    let mut run = Run { model: Some(&model), ..Run::new(&json!({}), &host) };
    run.next = 8;
    let (depth, version) = run.frame(None).expect("it runs");
    assert_eq!((version, &depth), (0, &outputs[8].0));
    let (unchanged, curve) = run.finish();
    assert!(unchanged == model && curve.points.is_empty());
}

#[test]
fn every_network_is_restored_from_its_file() {
    for network in [Network::UnetLite, Network::UnetTiny, Network::FcnLite, Network::FcnVgg16, Network::EigenCoarse] {
        let changes = json!({ "network": network.name() });
        let (host, layout) = (TestHost::batch(1), layout(network.without_spread(), Size { width: 64, height: 32 }));
        let values = layout.start(7);
        let file = export(network.without_spread(), Size { width: 64, height: 32 }, &values, "a test");
        let mut run = Run { model: Some(&file), ..Run::new(&changes, &host) };
        run.frame(None).expect("it runs");
        assert!(*run.node.values() == values, "{}", network.name());
    }
}

#[test]
fn another_network_at_the_input_is_refused() {
    let file = export(
        Network::FcnLite.without_spread(),
        Size { width: 64, height: 32 },
        &layout(Network::FcnLite.without_spread(), Size { width: 64, height: 32 }).start(1),
        "a test",
    );
    let host = TestHost::batch(1);
    let fault = Run { model: Some(&file), ..Run::new(&json!({}), &host) }.frame(None).unwrap_err();
    assert!(fault.remedy_text().unwrap_or_default().contains("`network`"), "{}", fault.chain());
    let fault = Run { model: Some(b"text"), ..Run::new(&json!({}), &host) }.frame(None).unwrap_err();
    assert!(fault.chain().contains("failed to read the network at `model`"), "{}", fault.chain());
}

#[test]
fn a_schedule_of_another_run_is_refused() {
    let host = TestHost::batch(1);
    let fault = Run::new(&json!({}), &host).frame(Some(1.0)).unwrap_err();
    assert!(fault.chain().contains("no training has started since version 0"), "{}", fault.chain());
    for wrong in [2.0, 0.5, -1.0] {
        let mut run = Run::new(&json!({}), &host);
        for _ in 0..2 {
            run.frame(Some(0.0)).expect("it runs");
        }
        let fault = run.frame(Some(wrong)).unwrap_err();
        assert!(fault.chain().contains(&format!("`schedule` is {wrong} after 0")), "{}", fault.chain());
    }
}

#[test]
fn the_memory_is_bounded() {
    let host = TestHost::batch(1);
    let mut run = Run::new(&json!({ "first": 100 }), &host);
    for _ in 0..12 {
        run.frame(None).expect("it runs");
    }
    assert_eq!(run.node.memory_len(), 4);
}

#[test]
fn dropping_the_node_ends_its_training() {
    let host = TestHost::live();
    let mut run = Run::new(&json!({ "steps": 1_000_000_000, "first": 1 }), &host);
    for _ in 0..4 {
        run.frame(None).expect("it runs");
    }
    let start = Instant::now();
    drop(run);
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
}

#[test]
fn a_cancelled_run_does_not_wait() {
    struct Cancelled(TestHost);

    impl Host for Cancelled {
        fn cancelled(&self) -> bool {
            true
        }

        fn progress(&self, _done: u64, _total: u64, _message: &str) {}

        fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
            self.0.tiles(n, f);
        }

        fn width(&self) -> usize {
            1
        }
    }

    let host = TestHost::batch(1);
    let mut run = Run::new(&json!({ "steps": 1_000_000_000, "first": 1, "period": 1 }), &host);
    run.frame(None).expect("it runs");
    let declaration = Online::declaration();
    let values: Vec<Option<Value>> = declaration.inputs.iter().map(|_| None).collect();
    let (frame, host) = (Frame::at_10_hz("1".to_owned(), 1), Cancelled(TestHost::batch(1)));
    let mut scratch = Scratch::default();
    let mut context = Context::new(&host, &mut scratch);
    let fault = run.node.process(&frame, &Inputs::new(&declaration.inputs, &values), &mut context).unwrap_err();
    assert!(matches!(fault, Fault::Cancelled));
}
