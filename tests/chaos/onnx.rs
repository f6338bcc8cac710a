//! Spoilt networks.
//!
//! An ONNX file has no checksum: a file with another weight is another network, whose answer is unknown. So a spoilt
//! file may give any whole answer or an error; a panic, a hang or an error without a word is a fault. Where it is
//! certain that a network gives NaN or infinity, exit 0 must come with a word about it. What can be seen before any
//! frame (no ONNX, a wrong shape or type) must end with exit 2.

use std::path::PathBuf;

use crate::case::Case;
use crate::child::Ended;
use crate::ground::RUN;
use crate::records;
use crate::verdict::{Verdict, judge};
use depthloom_test_needs::onnx_file::{F32, Tensor, U8, model_with};

const EXPERIMENT: &str = "experiment: network
sources: { street: { kind: synthetic/road, with: { frames: 0..2, width: 96, height: 48 } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 32 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      weight: { kind: confidence/sobel, inputs: { image: source/left } }
      mono:
        kind: mono/onnx
        inputs: { image: source/left, calibration: source/calibration, model: { file: net.onnx } }
        with: MONO
      scaled: { kind: fusion/scale, inputs: { mono: mono/depth, stereo: depth/depth } }
      merged: { kind: fusion/confidence, inputs: { mono: scaled/depth, stereo: depth/depth, weight: weight/weight } }
    score: { ground_truth: source/depth, estimates: { mono: { from: mono/depth, sets: [all] }, fused: { from: merged/depth, sets: [all] } } }
";

/// The network that a training of the project wrote.
fn learned(case: &Case<'_>) -> Vec<u8> {
    records::attachment(&case.ground.learn().recording, "application/onnx").expect("a learned network").to_vec()
}

pub(crate) fn bits(case: &mut Case<'_>) -> Verdict {
    let mut bytes = learned(case);
    // Most of the file is weights; its structure stands around them.
    let within = [bytes.len(), 4096.min(bytes.len())][case.random.below(2)];
    let at_the_end = case.random.chance(3);
    let range = if at_the_end { bytes.len() - within..bytes.len() } else { 0..within };
    for _ in 0..1 + case.random.below(3) {
        let what = case.random.flip(&mut bytes[range.clone()]);
        case.note(what);
    }
    any(case, &bytes, "{}")
}

pub(crate) fn cuts(case: &mut Case<'_>) -> Verdict {
    let bytes = learned(case);
    let at = case.random.below(bytes.len());
    any(case, &bytes[..at], "{}")
}

/// Bytes that are not a network, or pieces of a network in another order.
pub(crate) fn garbage(case: &mut Case<'_>) -> Verdict {
    let mut bytes = learned(case);
    match case.random.below(3) {
        0 => {
            let length = case.random.below(4096);
            bytes = (0..length).map(|_| case.random.number() as u8).collect();
        }
        1 => {
            let at = case.random.below(bytes.len());
            bytes.rotate_left(at);
        }
        _ => {
            let (at, length) = (case.random.below(bytes.len()), case.random.below(64));
            let end = (at + length).min(bytes.len());
            let fill = case.random.number() as u8;
            bytes[at..end].fill(fill);
        }
    }
    any(case, &bytes, "{}")
}

/// Shapes and types that no network of depth has, most of them to be seen before any frame.
pub(crate) fn shapes(case: &mut Case<'_>) -> Verdict {
    let sides = [-1, 0, 1, 2, 3, 7, 32, 96, 1 << 14, 1 << 20, 1 << 31, i64::MAX, i64::MIN];
    let mut shape = |right: [i64; 4]| -> Vec<i64> {
        let rank = if case.random.chance(4) { case.random.below(6) } else { 4 };
        (0..rank)
            .map(|axis| if case.random.chance(2) { *right.get(axis).unwrap_or(&1) } else { case.random.pick(&sides) })
            .collect()
    };
    let (input, output) = (shape([1, 3, 32, 96]), shape([1, 1, 32, 96]));
    let [input_type, output_type] = [0, 1].map(|_| if case.random.chance(8) { U8 } else { F32 });
    let axes = case.random.pick(&[1, 1, 1, 0, 2, -1, 9, i64::MIN]);
    let operator =
        case.random.pick(&["ReduceMean", "ReduceMean", "Softmax", "Identity", "NoSuchOperator", "Reshape", "Loop"]);
    case.note(format!("{operator} over {axes}: {input:?} of type {input_type} to {output:?} of type {output_type}"));
    let bytes = model_with(
        operator,
        &[("axes", &[axes])],
        &[Tensor("image", input_type, &input)],
        &Tensor("share", output_type, &output),
    );
    any(case, &bytes, "{}")
}

/// A network whose every answer is NaN or infinite.
pub(crate) fn not_finite(case: &mut Case<'_>) -> Verdict {
    let (operator, with) = case.random.pick(&[
        // The logarithm and the root of what is below zero; one over zero.
        ("Log", "{ mean: [2, 2, 2] }"),
        ("Sqrt", "{ mean: [2, 2, 2] }"),
        ("Log", "{ mean: [2, 2, 2], output: depth }"),
        ("Sqrt", "{ mean: [2, 2, 2], output: inverse-depth }"),
        ("Log", "{ mean: [2, 2, 2], flip: mean }"),
        ("Exp", "{ mean: [-1, -1, -1], std: [1.0e-4, 1.0e-4, 1.0e-4], output: depth, cap: null }"),
    ]);
    let side = [1, 1, 32, 96];
    case.note(format!("{operator} with {with}"));
    let bytes = model_with(operator, &[], &[Tensor("image", F32, &side)], &Tensor("share", F32, &side));
    let ended = run(case, &bytes, with);
    judge(&ended, || {
        let printed = format!("{}{}", ended.stdout, ended.stderr).to_lowercase();
        match ["nan", "infin", "finite"].iter().any(|word| printed.contains(word)) {
            true => Verdict::Said,
            false => Verdict::different("a network that gives nothing but NaN or infinity, and not a word"),
        }
    })
}

/// Any network: a whole answer or an error; no ONNX at all is found before any frame.
fn any(case: &mut Case<'_>, bytes: &[u8], with: &str) -> Verdict {
    let ended = run(case, bytes, with);
    judge(&ended, || match case.at("run").join("table.csv").is_file() {
        true => Verdict::Equal,
        false => Verdict::different("exit 0 without a table"),
    })
}

fn run(case: &mut Case<'_>, bytes: &[u8], with: &str) -> Ended {
    case.write("net.onnx", bytes);
    case.write("experiment.yaml", EXPERIMENT.replace("MONO", with));
    let mut command = case.depthloom(&RUN);
    // Both engines, where there are two.
    if let Some(library) = onnx_runtime()
        && case.random.chance(2)
    {
        command.env("DEPTHLOOM_ONNX_ENGINE", "onnxruntime").env("ORT_DYLIB_PATH", library);
    }
    case.run(&mut command)
}

/// ONNX Runtime, where the caller names it.
fn onnx_runtime() -> Option<PathBuf> {
    std::env::var_os("DEPTHLOOM_CHAOS_ONNXRUNTIME").map(PathBuf::from).filter(|path| path.is_file())
}
