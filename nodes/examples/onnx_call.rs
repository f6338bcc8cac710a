//! Runs a network by a node `onnx` on images named on standard input, and prints how many milliseconds each call took.
//! `bench/onnx.sh` drives it.
//!
//! `onnx_call MODEL THREADS` prints the engine (`ONNX Runtime 1.31.1`). A line of standard input is `IN OUT WIDTH
//! HEIGHT`: a file of the image's 8-bit RGB samples, and the file that the map is to be written to, as little-endian
//! f32. The map is a depth of a thousand times the network's output: a depth must be above 0.

use std::error::Error;
use std::io::{BufRead, Write};
use std::time::Instant;

use depthloom_graphs::contracts::InlineHost;
use depthloom_graphs::values::{Artifact, Depth, Image, Pixels};
use depthloom_graphs::{Context, Inputs, Instance, Scratch, Value};
use depthloom_nodes::onnx;
use image::RgbImage;
use serde_json::json;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, threads] = &arguments[..] else { return Err("usage: onnx_call MODEL THREADS".into()) };
    let params = json!({
        "ports": { "inputs": { "image": { "type": "image" } }, "outputs": { "map": { "type": "depth", "scale": 1000 } } },
        "threads": threads.parse::<u32>()?,
    });
    let registry = depthloom_nodes::registry();
    let kind = registry.node_kind("onnx").ok_or("there is no kind `onnx`")?;
    let params = kind.resolve(&params).map_err(|error| error.what)?;
    let ports = kind.signature(&params)?.inputs;
    let Instance::Pure(node) = kind.build(&params)? else { return Err("the node is not pure".into()) };
    let model: Value = Value::Model(std::sync::Arc::new(Artifact::model(std::fs::read(model)?)));
    println!("{}", onnx::find()?.title());
    let mut scratch = Scratch::default();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let words: Vec<&str> = line.split(' ').collect();
        let [input, output, width, height] = words[..] else { return Err("a line is `IN OUT WIDTH HEIGHT`".into()) };
        let pixels = RgbImage::from_raw(width.parse()?, height.parse()?, std::fs::read(input)?);
        let image: Value = Image::new(Pixels::Rgb(pixels.ok_or("the image is of another size")?)).into();
        let values = [Some(image), Some(model.clone())];
        let start = Instant::now();
        let given = node.process(&Inputs::new(&ports, &values), &mut Context::new(&InlineHost, &mut scratch))?;
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        let mut given = given.in_order_of(&kind.signature(&params)?.outputs)?;
        let Some(Some(Value::Depth(depth))) = given.pop() else { return Err("the network gave no map".into()) };
        let Depth { metres } = &*depth;
        std::fs::write(output, metres.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())?;
        println!("{milliseconds}");
        std::io::stdout().flush()?;
    }
    Ok(())
}
