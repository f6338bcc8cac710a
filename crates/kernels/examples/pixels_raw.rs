//! Runs pixel kernels on raw files, for comparison with other implementations (`tests/pixels_against_opencv.py`).
//!
//! One job per line on standard input: `KERNEL WIDTH HEIGHT OUT_WIDTH OUT_HEIGHT PARAMETER IN OUT`. Samples are
//! little-endian; `OUT_WIDTH`, `OUT_HEIGHT` and `PARAMETER` are ignored if a kernel does not use them. Prints `done`
//! after each job.

use std::io::{BufRead, Write};

use depthloom_kernels::{confidence, edges, grey, median, resize};

fn main() {
    for line in std::io::stdin().lock().lines() {
        let line = line.expect("standard input can be read");
        let words: Vec<&str> = line.split_whitespace().collect();
        let [kernel, width, height, out_width, out_height, parameter, input, out] = words[..] else {
            panic!("eight words are needed, not {line:?}");
        };
        let [width, height, out_width, out_height] =
            [width, height, out_width, out_height].map(|word| word.parse::<usize>().expect("a size"));
        let parameter: f64 = parameter.parse().expect("a number");
        let bytes = std::fs::read(input).unwrap_or_else(|error| panic!("{input}: {error}"));
        let result = run(kernel, &bytes, (width, height), (out_width, out_height), parameter);
        std::fs::write(out, result).unwrap_or_else(|error| panic!("{out}: {error}"));
        println!("done");
        std::io::stdout().flush().expect("standard output can be written");
    }
}

fn run(
    kernel: &str,
    bytes: &[u8],
    (width, height): (usize, usize),
    (out_width, out_height): (usize, usize),
    parameter: f64,
) -> Vec<u8> {
    let size = width * height;
    let floats = || -> Vec<f32> { bytes.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect() };
    let mut samples = vec![0u8; size];
    let mut depths = vec![0f32; size];
    match kernel {
        "grey" => grey::grey_from_rgb(bytes, width, height, &mut samples),
        "edges" => edges::edges(bytes, width, height, parameter as f32, &mut samples),
        "area" => {
            samples = vec![0; 3 * out_width * out_height];
            resize::area_rgb8(bytes, width, height, out_width, out_height, &mut samples);
        }
        "confidence" => confidence::confidence_from_edges(bytes, width, height, parameter, &mut depths),
        "median3" => median::median3(&floats(), width, height, &mut depths),
        "median5" => median::median5(&floats(), width, height, &mut depths),
        "bilinear" => {
            depths = vec![0.0; out_width * out_height];
            resize::bilinear_f32(&floats(), width, height, out_width, out_height, &mut depths);
        }
        other => panic!("no kernel is called {other:?}"),
    }
    match kernel {
        "grey" | "edges" | "area" => samples,
        _ => depths.into_iter().flat_map(f32::to_le_bytes).collect(),
    }
}
