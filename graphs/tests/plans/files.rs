//! What an experiment is put together from: other files, paths, variables, anchors.

use std::path::PathBuf;

use depthloom_graphs::plan::{Origin, Plan};

use super::{Written, experiment, loaded_with, nodes, plan_of, stereo, try_load};

#[test]
fn extending_swaps_sources_and_keeps_the_rest() {
    let base = loaded_with(&experiment("table1.yaml"), &[]).plan;
    let kitti = loaded_with(&experiment("table1-kitti.yaml"), &[]).plan;
    assert_eq!(kitti.experiment, "table1-kitti");
    assert_eq!(kitti.description, base.description);
    let part = &kitti.runs[1].source.parts[0];
    assert_eq!(part.kind, "kitti/stereo2015");
    // The old source's seed is gone: a new kind drops the old parameters.
    assert_eq!(
        part.params,
        serde_json::json!({ "root": "/data/kitti/training", "frames": "150..156", "ground_truth": "noc" })
    );
    let node_hashes =
        |plan: &Plan| plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.node_hash).collect::<Vec<_>>();
    assert_eq!(node_hashes(&base), node_hashes(&kitti), "what is computed does not depend on where frames come from");
    assert_eq!(
        kitti.written.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(),
        ["table1-kitti.yaml", "table1.yaml"]
    );
}

#[test]
fn files_enter_recipes_by_content_and_not_by_place() {
    let text = "experiment: weights
sources: { test: { kind: synthetic/road } }
stages:
  compare:
    source: test
    nodes:
      mono: { kind: mono/onnx, inputs: { image: source/left, calibration: source/calibration, model: { file: NET } } }
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples: { kind: learn/samples, inputs: { image: source/left, target: stereo/disparity, mask: edges/mask } }
      train: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { weights: WEIGHTS } }
";
    let node_hashes = |net: &str, weights: &str, content: &str| {
        let text = text.replace("NET", net).replace("WEIGHTS", weights);
        let written = Written::new(&[("main.yaml", &text), (net, content), (weights, content)]);
        let plan = written.plan(&[]);
        let path = plan.runs[0].nodes[0].inputs[2].from.clone();
        assert_eq!(path, Some(Origin::File(written.path(net))), "paths start at the folder of the YAML file");
        (nodes(&plan, 0, "mono")[0].node_hash, nodes(&plan, 0, "train")[0].node_hash)
    };
    let base = node_hashes("a.onnx", "w.bin", "content");
    assert_eq!(node_hashes("deep/b.onnx", "deep/v.bin", "content"), base);
    let other = node_hashes("a.onnx", "w.bin", "other content");
    assert!(other.0 != base.0 && other.1 != base.1);
}

#[test]
fn relative_paths_start_at_the_file_they_are_written_in() {
    let files = [
        (
            "main.yaml",
            "extends: lib/base.yaml
experiment: main
sources: { test: { with: { frames: ids.txt } } }
variants: { full: {}, elsewhere: { sources.test.with.root: here } }",
        ),
        (
            "lib/base.yaml",
            "experiment: base
sources: { test: { kind: kitti/stereo2015, with: { root: ../data, frames: 0..4 } } }
stages:
  compare:
    source: test
    nodes: { graph: graphs/stereo.yaml }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }
",
        ),
        (
            "lib/graphs/stereo.yaml",
            "description: Stereo.
nodes:
  stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
  depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
",
        ),
    ];
    let written = Written::new(&files);
    let plan = written.plan(&[]);
    let params = |run: usize| plan.runs[run].source.parts[0].params.clone();
    let text = |path: PathBuf| path.to_str().unwrap().to_owned();
    assert_eq!(params(0)["root"], text(written.path("data")));
    assert_eq!(params(0)["frames"], text(written.path("ids.txt")));
    assert_eq!(params(1)["root"], text(written.path("here")));
    assert_eq!(plan.runs[0].nodes.len(), 3);
    let names: Vec<&str> = plan.written.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["main.yaml", "lib/base.yaml", "lib/graphs/stereo.yaml"]);
    // What was typed, and what the environment gives, starts at the working directory.
    let plan = written.plan(&[("sources.test.with.root", "typed")]);
    assert_eq!(plan.runs[0].source.parts[0].params["root"], "typed");
    let plan = written.plan(&[("sources.test.with.root", "${HERE}")]);
    assert_eq!(plan.runs[0].source.parts[0].params["root"], "there/it/is");
    let plan = written.plan(&[("sources.test.with.root", "${NOT_SET:-by/default}")]);
    assert_eq!(plan.runs[0].source.parts[0].params["root"], "by/default");
}

#[test]
fn variables_become_what_they_look_like() {
    let depth = |with: &str| {
        let text = stereo("").replace(
            "calibration: source/calibration } }",
            &format!("calibration: source/calibration }}, with: {with} }}"),
        );
        nodes(&plan_of(&text), 0, "depth")[0].params["cap"].clone()
    };
    assert_eq!(depth("{ cap: \"${CAP}\" }"), 50.0);
    assert_eq!(depth("{ cap: \"${NOT_SET:-60.5}\" }"), 60.5);
    // Where text is wanted, a number out of the environment is text.
    let text = stereo("").replace("ground_truth: source/depth", "ground_truth: source/depth\n      preset: ${CAP}");
    assert_eq!(nodes(&plan_of(&text), 0, "score.fused")[0].params["preset"], "50");
}

#[test]
fn a_variable_that_nothing_needs_may_be_unset() {
    let files = [
        ("main.yaml", "extends: base.yaml\nsources: { test: { kind: synthetic/road } }".to_owned()),
        (
            "base.yaml",
            stereo("")
                .replace("{ kind: synthetic/road }", "{ kind: kitti/stereo2015, with: { root: \"${NOT_SET}\" } }"),
        ),
    ];
    let files: Vec<(&str, &str)> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let written = Written::new(&files);
    assert_eq!(written.plan(&[]).runs[0].source.parts[0].kind, "synthetic/road");
    let base = try_load(&written.path("base.yaml"), &[("sources.test.with.root", "/data")]).unwrap();
    assert_eq!(base.plan.runs[0].source.parts[0].params["root"], "/data");
    assert!(try_load(&written.path("base.yaml"), &[]).is_err());
    let empty = try_load(&written.path("base.yaml"), &[("sources.test.with.root", "${EMPTY}")]).unwrap_err();
    assert!(empty.to_string().contains("the environment variable `EMPTY` is empty"), "{empty}");
    let base = try_load(&written.path("base.yaml"), &[("sources.test.with.root", "${EMPTY:-by/default}")]).unwrap();
    assert_eq!(base.plan.runs[0].source.parts[0].params["root"], "by/default");
}

#[test]
fn graph_files_give_nodes_that_the_stage_may_change() {
    let graph = "nodes:
  stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { block: 3 } }
  depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
";
    let main = "experiment: main
sources: { test: { kind: synthetic/road } }
stages:
  compare:
    source: test
    nodes:
      graph: graph.yaml
      stereo: { with: { p1: 100 } }
      fused: { kind: filter/median, inputs: { depth: depth/depth } }
";
    let plan = Written::new(&[("main.yaml", main), ("graph.yaml", graph)]).plan(&[]);
    let stereo = nodes(&plan, 0, "stereo")[0];
    assert_eq!((&stereo.params["block"], &stereo.params["p1"]), (&3.into(), &100.into()));
    assert_eq!(nodes(&plan, 0, "fused").len(), 1);
}

#[test]
fn anchors_and_merges_are_ordinary_yaml() {
    let text = stereo("").replace("with: { block: 5 }", "with: &settings { block: 9, p1: 10 }").replace(
        "      fused:",
        "      other: { kind: stereo/sgbm, inputs: { left: source/right, right: source/left }, with: { <<: *settings, p1: 20 } }\n      fused:",
    );
    let plan = plan_of(&text);
    let other = nodes(&plan, 0, "other")[0];
    assert_eq!((&other.params["block"], &other.params["p1"]), (&9.into(), &20.into()));
}
