//! The experiment language.

use depthloom_graphs::language::{Options, load};

use crate::Target;

pub(crate) fn target() -> Target {
    let seeds = [
        "experiment: seed
description: every construct
sources:
  street: { kind: synthetic/road, with: { frames: 0..4, width: 64, height: 32 } }
  some: { kind: synthetic/road, with: { frames: [1, 3], seed: 7 } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 16 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      fused: { kind: filter/median, inputs: { depth: depth/depth } }
    score: { ground_truth: source/depth, preset: martins2018, estimates: { stereo: { from: depth/depth, sets: [all, valid] }, fused: fused/depth } }
  other:
    source: some
    nodes: { weight: { kind: confidence/sobel, inputs: { image: source/left } } }
variants: { plain: {}, small: { look.stereo.with.block: 3 } }
matrix: { look.fused.with.size: [3, 5], look.stereo.with.uniqueness: { from: 1, to: 9, steps: 3 } }
record: { topics: ['look.*/depth', 'other.weight', 'look.source', '!look.fused'], every: 2, view: false, points: [look.depth] }
",
        "experiment: anchors\nsources: { s: &s { kind: synthetic/road, with: &with { frames: 0..2 } } }\nstages:\n  a:\n    source: s\n    nodes:\n      w: { kind: confidence/sobel, inputs: { image: source/left }, with: { <<: { sigma: \"${SIGMA:-3}\" } } }\n",
        "extends: experiment.yaml\nexperiment: itself\n",
        "graph: g.yaml\n? [a, b]\n: - |\n  text\n- 0x1f\n- .nan\n- ~\n",
    ];
    Target::new("experiment", seeds.map(|text| text.as_bytes().to_vec()).into(), |bytes, folder| {
        let path = folder.join("experiment.yaml");
        std::fs::write(&path, bytes).expect("the folder takes a file");
        let options = Options { env: Box::new(|_| None), ..Options::default() };
        load(&path, &depthloom_nodes::registry(), &options).map(|_| ()).map_err(|diagnostics| diagnostics.to_string())
    })
}
