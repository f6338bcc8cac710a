//! `depthloom lsp` as editors use it: dialogues over the standard streams.

mod client;
mod completion;
mod dialogue;
mod extension;
mod latency;
mod navigation;
mod neovim;

/// An experiment with most of the language.
const EXPERIMENT: &str = "\
experiment: look
sources:
  street: { kind: synthetic/road, with: { frames: 0..2, seed: 1 } }
  other: { kind: synthetic/road, with: { frames: 0..2, seed: 2 } }
stages:
  first:
    source: other
    nodes:
      samples:
        kind: learn/samples
        inputs: { image: source/left, target: pair/disparity, mask: edges/mask, calibration: source/calibration }
      pair: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      train: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { network: unet-tiny, steps: 1, batch: 1 } }
  second:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { block: 5 } }
      depth:
        kind: depth/from-disparity
        inputs: { disparity: stereo/disparity, calibration: source/calibration }
        with: { cap: 80 }
      smooth: { kind: filter/median, inputs: { depth: depth/depth }, with: { size: 3 } }
      mono:
        kind: mono/onnx
        inputs: { image: source/left, calibration: source/calibration, model: first.train/model }
    score:
      ground_truth: source/depth
      preset: martins2018
      estimates:
        raw: depth/depth
        smooth: { from: smooth/depth, sets: [valid, all] }
        mono: mono/depth
variants:
  full: {}
  far: { second.depth.with.cap: 120 }
  direct: { second.smooth.inputs.depth: depth/depth, second.smooth.with.size: 5 }
matrix:
  second.stereo.with.block: [5, 7, 9]
  exclude: [{ second.stereo.with.block: 7 }]
only: [\"full+*\", \"far+*\", \"direct+*\"]
record: [second.depth/depth, \"/second/smooth\", first.train/model]
";
