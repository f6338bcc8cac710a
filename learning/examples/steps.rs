//! How long a training step takes: `steps NETWORK STEPS BATCH THREADS` prints milliseconds a step, after as many steps to warm up.
//!
//! Used by `bench/learning.sh`, which runs a peer on the same network and batch in turn.

use std::sync::Mutex;
use std::time::Instant;

use depthloom_graphs::values::Artifact;
use depthloom_graphs::{Context, Host, Inputs, Instance, Node, Scratch, Value};
use depthloom_learning::samples::{Sample, Samples};
use depthloom_learning::ssl::{Ssl, SslParams};

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
        self.done.lock().expect("nobody panics with it").push(Instant::now());
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
    let (width, height) = (320, 96);
    let item = |i: usize| Sample {
        id: i.to_string(),
        image: (0..3 * width * height).map(|p| (p * 31 + i * 17) as u8).collect(),
        right: None,
        share: (0..width * height).map(|p| half::f16::from_f32((p % 97 + 1) as f32 / 1000.0)).collect(),
        depth_scale: Some(0.3),
    };
    let samples =
        Samples { width: width as u32, height: height as u32, has_right: false, items: (0..16).map(item).collect() };
    let text = serde_json::json!({ "network": network, "steps": 2 * steps, "batch": batch.parse::<u32>()? });
    let params: SslParams = serde_json::from_value(text)?;
    let ports = Ssl::declaration().inputs;
    let values = [Some(Value::Samples(Artifact::samples(samples.encode()).into())), None];
    let Instance::Once(node) = Ssl::build(params)? else { return Err("learn/ssl fires once".into()) };
    let clock = Clock { threads: threads.parse()?, done: Mutex::default() };
    node.run(&Inputs::new(&ports, &values), &mut Context::new(&clock, &mut Scratch::default()))?;
    let done = clock.done.into_inner()?;
    let mut each: Vec<f64> =
        done[steps as usize - 1..].windows(2).map(|pair| (pair[1] - pair[0]).as_secs_f64() * 1e3).collect();
    each.sort_by(f64::total_cmp);
    println!("{:.2}", each[each.len() / 2]);
    Ok(())
}
