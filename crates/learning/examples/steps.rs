//! How long a training step takes: `steps NETWORK STEPS BATCH THREADS` prints milliseconds a step, after as many steps
//! to warm up.
//!
//! Used by `bench/learning.sh`, which runs a peer on the same network and batch in turn.

use std::sync::Mutex;
use std::time::Instant;

use depthloom_graphs::contracts::InlineHost;
use depthloom_graphs::registry::NodeKind;
use depthloom_graphs::values::{Calibration, Disparity, Image, Mask, Pixels, Raster};
use depthloom_graphs::{Context, Frame, Host, Inputs, Instance, Registry, Scratch, Value};
use image::RgbImage;
use serde_json::json;

/// Notes when each step was done.
struct Clock {
    threads: usize,
    done: Mutex<Vec<Instant>>,
}

impl Host for Clock {
    fn cancelled(&self) -> bool {
        false
    }

    fn progress(&self, _done: u64, _total: u64, _message: &str) {
        self.done.lock().expect("the lock is not poisoned").push(Instant::now());
    }

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).for_each(f);
    }

    fn width(&self) -> usize {
        self.threads
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [network, steps, batch, threads] = args.as_slice() else {
        return Err("steps NETWORK STEPS BATCH THREADS".into());
    };
    let steps: u64 = steps.parse()?;
    let registry = depthloom_learning::register(Registry::default());
    let kind = |name: &str| registry.node_kind(name).ok_or("it is not registered");
    let samples = samples(kind("learn/samples")?)?;
    let ssl = kind("learn/ssl")?;
    let batch: u32 = batch.parse()?;
    let params = json!({ "network": network, "steps": 2 * steps, "batch": batch });
    let Instance::Once(node) = ssl.build(&ssl.resolve(&params).map_err(|error| error.what)?)? else {
        return Err("learn/ssl fires once".into());
    };
    let ports = &ssl.declaration.inputs;
    let values: Vec<_> = ports.iter().map(|port| (port.name == "samples").then(|| samples.clone())).collect();
    let clock = Clock { threads: threads.parse()?, done: Mutex::default() };
    node.run(&Inputs::new(ports, &values), &mut Context::new(&clock, &mut Scratch::default()))?;
    let done = clock.done.into_inner()?;
    let mut each: Vec<f64> =
        done[steps as usize - 1..].windows(2).map(|pair| (pair[1] - pair[0]).as_secs_f64() * 1e3).collect();
    each.sort_by(f64::total_cmp);
    println!("{:.2}", each[each.len() / 2]);
    Ok(())
}

/// Sixteen samples of 320 x 96.
fn samples(kind: &NodeKind) -> Result<Value, Box<dyn std::error::Error>> {
    let (width, height) = (320, 96);
    let resolved = kind.resolve(&json!({ "size": [width, height] })).map_err(|error| error.what)?;
    let Instance::Ordered(mut node) = kind.build(&resolved)? else { return Err("learn/samples is ordered".into()) };
    let mut scratch = Scratch::default();
    let disparity = Raster::from_fn(width, height, |x, y| image::Luma([5 * ((y * width + x) % 97 + 2) as i16]));
    let (focal_px, baseline_m) = (480.0, 0.2);
    let (cx_px, cy_px) = (f64::from(width) / 2.0, f64::from(height) / 2.0);
    for frame in 0..16 {
        let pixels = (0..3 * width * height).map(|at| (at * 31 + frame * 17) as u8).collect();
        let pixels = RgbImage::from_raw(width, height, pixels).ok_or("as many bytes as pixels")?;
        let inputs: [(&str, Value); 4] = [
            ("image", Value::Image(Image::new(Pixels::Rgb(pixels)).into())),
            ("target", Value::Disparity(Disparity { sixteenths_px: disparity.clone(), min_disparity_px: 0 }.into())),
            ("mask", Value::Mask(Mask { set: Raster::from_pixel(width, height, image::Luma([255])) }.into())),
            (
                "calibration",
                Value::Calibration(
                    Calibration { width, height, focal_px, cx_px, cy_px, baseline_m, doffs_px: 0.0 }.into(),
                ),
            ),
        ];
        let ports = &kind.declaration.inputs;
        let value = |name: &str| inputs.iter().find(|(input, _)| *input == name).map(|(_, value)| value.clone());
        let values: Vec<_> = ports.iter().map(|port| value(port.name)).collect();
        let frame = Frame::at_10_hz(frame.to_string(), frame.into());
        node.process(&frame, &Inputs::new(ports, &values), &mut Context::new(&InlineHost, &mut scratch))?;
    }
    let outputs = node.finish(&mut Context::new(&InlineHost, &mut scratch))?;
    let samples = outputs.in_order_of(&kind.declaration.outputs)?.into_iter().next().flatten();
    Ok(samples.ok_or("there are samples")?)
}
