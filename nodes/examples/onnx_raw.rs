//! Runs a network on raw tensors named on standard input, and prints the milliseconds each run took. What `bench/onnx.sh` drives.
//!
//! `onnx_raw MODEL THREADS` prints the engine and the input's size (`ONNX Runtime 1.31.1 3 96 320`). A line: `IN OUT`, files of little-endian
//! f32 values: the input tensor, and where its map is to be written.

use std::io::{BufRead, Write};
use std::time::Instant;

use depthloom_graphs::values::Artifact;
use depthloom_nodes::onnx::{self, Network, OnnxParams};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, threads] = &arguments[..] else { return Err("usage: onnx_raw MODEL THREADS".into()) };
    let params = OnnxParams { threads: threads.parse()?, ..OnnxParams::default() };
    let network = Network::load(&Artifact::model(std::fs::read(model)?), &params).map_err(|fault| fault.chain())?;
    let (title, size) = (onnx::find().map_err(|fault| fault.chain())?.title(), network.size);
    println!("{title} {} {} {}", size.channels, size.height, size.width);
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let (input, output) = line.split_once(' ').ok_or("a line is `IN OUT`")?;
        let bytes = std::fs::read(input)?;
        let tensor: Vec<f32> = bytes.as_chunks().0.iter().map(|&value| f32::from_le_bytes(value)).collect();
        let start = Instant::now();
        let maps = network.run(&tensor).map_err(|fault| fault.chain())?;
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        std::fs::write(output, maps.values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())?;
        println!("{milliseconds}");
        std::io::stdout().flush()?;
    }
    Ok(())
}
