//! How long a call of a node `process` takes: `process_call PYTHON SCRIPT FUNCTION ROUNDS`, of three maps of KITTI's
//! size in and one out.
//!
//! Prints the median and the quartiles in milliseconds.

use std::error::Error;
use std::time::Instant;

use depthloom_graphs::contracts::{InlineHost, Port};
use depthloom_graphs::values::{Depth, Raster, Weight};
use depthloom_graphs::{Context, Inputs, Instance, Scratch, Value};
use depthloom_nodes::process::permission;
use serde_json::json;

const SIZE: (u32, u32) = (1242, 375);

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [python, script, function, rounds] = &arguments[..] else { return Err("PYTHON SCRIPT FUNCTION ROUNDS".into()) };
    let params = json!({
        "command": [python, script, function],
        "ports": { "inputs": { "mono": "depth", "stereo": "depth", "weight": "weight" }, "outputs": { "depth": "depth" } },
    });
    permission::allow();
    let registry = depthloom_nodes::registry();
    let kind = registry.node_kind("process").ok_or("no such kind")?;
    let params = kind.resolve(&params).map_err(|error| error.what)?;
    let ports: Vec<Port> = kind.signature(&params)?.inputs;
    let Instance::Pure(node) = kind.build(&params)? else { return Err("it is pure".into()) };
    let map = |of: fn(u32) -> f32| {
        let samples = (0..SIZE.0 * SIZE.1).map(of).collect();
        Raster::from_raw(SIZE.0, SIZE.1, samples).ok_or("a map")
    };
    let stereo = map(|k| if k % 5 == 0 { f32::NAN } else { 5.0 + (k % 64) as f32 })?;
    let values: [Option<Value>; 3] = [
        Some(Depth { metres: map(|k| 5.0 + (k % 71) as f32)? }.into()),
        Some(Depth { metres: stereo }.into()),
        Some(Weight { share: map(|k| (k % 17) as f32 / 16.0)? }.into()),
    ];
    let mut scratch = Scratch::default();
    let mut times = Vec::new();
    // The first call starts the process.
    for round in 0..=rounds.parse::<usize>()? {
        let start = Instant::now();
        node.process(&Inputs::new(&ports, &values), &mut Context::new(&InlineHost, &mut scratch))?;
        if round > 0 {
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
    }
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    println!("{:.3} {:.3} {:.3}", at(0.5), at(0.25), at(0.75));
    Ok(())
}
