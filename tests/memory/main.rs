//! Memory is bounded by the window and not by the number of frames, and each training sample is stored once.
//!
//! What is measured are allocated bytes, counted by the allocator of this program, which is also the program under
//! test: unlike resident memory they do not depend on what else the machine does.
//!
//! ```sh
//! DEPTHLOOM_FULL_TESTS=1 cargo test --release --test memory
//! ```

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use depthloom_test_needs::full;
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATED: PeakAlloc = PeakAlloc;

/// The file to which this program, as `depthloom`, writes the largest number of bytes that were allocated at one time.
const PEAK_FILE: &str = "DEPTHLOOM_TEST_PEAK_FILE";

fn main() -> ExitCode {
    if let Some(file) = std::env::var_os(PEAK_FILE) {
        let code = depthloom::main(depthloom::registry());
        std::fs::write(file, ALLOCATED.peak_usage().to_string()).expect("the peak can be written");
        return code;
    }
    if !full("memory") {
        return ExitCode::SUCCESS;
    }
    let folder = tempfile::tempdir().expect("a folder");
    a_run_keeps_less_than_a_tenth_of_a_map_per_frame(folder.path());
    each_sample_is_stored_once_while_a_network_is_trained(folder.path());
    ExitCode::SUCCESS
}

/// The peak of allocated bytes in a run of `frames` frames of a source.
fn peak_bytes(experiment: &Path, source: &str, frames: u32) -> f64 {
    let out = experiment.with_extension(format!("{frames}"));
    let peak = PathBuf::from(format!("{}.peak", out.display()));
    let mut run = Command::new(std::env::current_exe().expect("a running program has a path"));
    // One worker and a small window: how many values several workers hold at one time is chance.
    run.env(PEAK_FILE, &peak).args(["run", "--fresh", "--no-page", "--workers", "1", "--window", "2", "--set"]);
    run.arg(format!("sources.{source}.with.frames=0..{frames}")).arg("--out").arg(&out).arg(experiment);
    let output = run.output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    std::fs::remove_dir_all(&out).expect("removed");
    std::fs::read_to_string(peak).expect("the peak").parse().expect("a number")
}

/// A run stores for each frame the places of its chunks, its rows of metrics and its keys. One map of 320 x 96 numbers
/// of 4 bytes has 123 kB. The stored data does not depend on the size of the images; small images need a fifth of the
/// time.
fn a_run_keeps_less_than_a_tenth_of_a_map_per_frame(folder: &Path) {
    let experiment = folder.join("small.yaml");
    // No training: its memory would hide what the frames need.
    let text = "experiment: small
sources: { street: { kind: synthetic/road, with: { width: 160, height: 48 } } }
stages:
  compare:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      mono: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/calibration } }
      scaled: { kind: fusion/scale, inputs: { mono: mono/depth, stereo: depth/depth } }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth, mono: mono/depth, scaled: scaled/depth } }
";
    std::fs::write(&experiment, text).expect("written");
    let (few, many) = (peak_bytes(&experiment, "street", 500), peak_bytes(&experiment, "street", 2000));
    let per_frame = (many - few) / 1500.0;
    let map = f64::from(320 * 96 * 4);
    let (few, many) = (few / 1e6, many / 1e6);
    println!("a run stores {per_frame:.0} bytes per frame: {few:.1} MB for 500 frames, {many:.1} MB for 2,000");
    assert!(per_frame < map / 10.0, "more than a tenth of a map of {map} bytes");
}

fn each_sample_is_stored_once_while_a_network_is_trained(folder: &Path) {
    let experiment = folder.join("learn.yaml");
    let text = "experiment: learn
sources: { street: { kind: synthetic/road, with: { width: 160, height: 64 } } }
stages:
  learn:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples:
        kind: learn/samples
        inputs: { image: source/left, target: stereo/disparity, mask: edges/mask }
        with: { size: [160, 64] }
      train: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { steps: 2, batch: 1 } }
";
    std::fs::write(&experiment, text).expect("written");
    let (few, many) = (50, 550);
    let grown = peak_bytes(&experiment, "street", many) - peak_bytes(&experiment, "street", few);
    let stored = grown / f64::from(many - few);
    // Three bytes of colour and an IEEE half for every pixel.
    let sample = f64::from(160 * 64 * (3 + 2));
    println!("training keeps {stored:.0} bytes per sample of {sample}");
    assert!(stored >= 0.5 * sample, "the measured bytes are not those of samples");
    assert!(stored <= 1.8 * sample, "samples are stored more than once");
}
