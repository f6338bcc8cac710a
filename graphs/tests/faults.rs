//! Faults found in released versions, each named `fault_<number>_<what holds now>`; what they print is in
//! `tests/broken/`.

mod toys;

use std::path::Path;

use depthloom_graphs::language::{Loaded, Options, load};
use depthloom_graphs::plan::{Origin, Plan};

/// Files in a folder of their own.
fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder can be made");
    for (name, text) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("it is in the folder")).expect("a folder can be made");
        std::fs::write(path, text).expect("a file can be written");
    }
    folder
}

fn loaded(path: &Path, set: &[(&str, &str)], data: &str) -> Result<Loaded, String> {
    let set = set.iter().map(|(path, value)| ((*path).to_owned(), (*value).to_owned())).collect();
    let env = Box::new(|name: &str| (name == "DATA").then(|| data.to_owned()));
    load(path, &toys::registry(), &Options { set, env, ..Options::default() })
        .map_err(|diagnostics| diagnostics.to_string())
}

fn plan_of(text: &str, set: &[(&str, &str)]) -> Result<Plan, String> {
    let folder = folder(&[("main.yaml", text)]);
    loaded(&folder.path().join("main.yaml"), set, "/data").map(|loaded| loaded.plan)
}

/// An experiment whose `train` has an optional parameter, and whose `weight` has an optional input.
fn learning(weights: &str, mask: &str, more: &str) -> String {
    format!(
        "experiment: learning
sources: {{ train: {{ kind: synthetic/road }} }}
stages:
  learn:
    source: train
    nodes:
      stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }} }}
      edges: {{ kind: confidence/edges, inputs: {{ image: source/left }} }}
      samples: {{ kind: learn/samples, inputs: {{ image: source/left, target: stereo/disparity, mask: edges/mask }} }}
      train: {{ kind: learn/ssl, inputs: {{ samples: samples/samples }}, with: {{ {weights} }} }}
      weight: {{ kind: confidence/sobel, inputs: {{ image: source/left, {mask} }} }}
record: [learn.weight/weight, learn.train/model]
{more}"
    )
}

#[test]
fn fault_10_a_name_that_becomes_a_path_is_one_part_of_it() {
    let experiment = |name: &str| learning("", "mask: edges/mask", "").replace("experiment: learning", name);
    for name in ["table1", "Table 1.b", "Tiefenschätzung 深度", "017", "1.0", "a-b_c"] {
        plan_of(&experiment(&format!("experiment: '{name}'")), &[]).expect(name);
    }
    let long = "x".repeat(101);
    for name in [
        "../../evil",
        "/tmp/evil",
        "a/b",
        "..",
        ".",
        ".hidden",
        "a\\\\b",
        "a\\0b",
        "a\\nb",
        " a",
        "a ",
        "a.",
        "~/x",
        "c:x",
        &long,
    ] {
        let message = plan_of(&experiment(&format!("experiment: \"{name}\"")), &[]).expect_err(name);
        assert!(message.contains("the name of an experiment"), "{name}: {message}");
    }
    let message = plan_of(&learning("", "mask: edges/mask", "").replace("  learn:", &format!("  {long}:")), &[]);
    assert!(message.expect_err("too long").contains("the name of a stage is longer than 100 characters"));
}

#[test]
fn fault_10_a_combination_of_nothing_has_no_name() {
    let message = plan_of(&learning("", "mask: edges/mask", "matrix: { include: [{}] }"), &[]).expect_err("no name");
    assert!(message.contains("includes no change"), "{message}");
}

#[test]
fn fault_15_variants_are_named_by_the_file_not_by_the_machine() {
    let text = learning(
        "",
        "mask: edges/mask",
        "matrix: { learn.train.with.weights: ['${DATA}/a.onnx', '${DATA:-x}/b.onnx', near/c.onnx, '$${x'] }",
    );
    let folder = folder(&[("main.yaml", &text)]);
    let names = |data: &str| loaded(&folder.path().join("main.yaml"), &[], data).expect("right").plan.variants;
    let here = names("/home/alice/data");
    assert_eq!(here, ["weights=DATA-a.onnx", "weights=DATA-x-b.onnx", "weights=near-c.onnx", "weights=-x"]);
    assert_eq!(names("/mnt/elsewhere"), here);
}

#[test]
fn fault_26_null_means_none_wherever_it_is_written() {
    let weights = |plan: &Plan, node: usize| {
        let nodes: Vec<_> = plan.runs[0].nodes.iter().filter(|node| node.name == "train").collect();
        nodes[node].params["weights"].clone()
    };
    let mask = |plan: &Plan, node: usize| {
        let nodes: Vec<_> = plan.runs[0].nodes.iter().filter(|node| node.name == "weight").collect();
        nodes[node].inputs.iter().any(|input| input.port.name == "mask" && matches!(input.from, Some(Origin::Here(_))))
    };
    let (some, wired) = ("weights: a.onnx", "mask: edges/mask");
    let plan = plan_of(&learning(some, wired, ""), &[]).expect("right");
    assert!(weights(&plan, 0).is_string() && mask(&plan, 0));
    let in_the_file = plan_of(&learning("weights: null", "mask: null", ""), &[]).expect("right");
    let set = [("learn.train.with.weights", "null"), ("learn.weight.inputs.mask", "null")];
    let on_the_command_line = plan_of(&learning(some, wired, ""), &set).expect("right");
    let variants = "variants: { full: {}, none: { learn.train.with.weights: null, learn.weight.inputs.mask: ~ } }";
    let in_a_variant = plan_of(&learning(some, wired, variants), &[]).expect("right");
    for (plan, node) in [(&in_the_file, 0), (&on_the_command_line, 0), (&in_a_variant, 1)] {
        assert!(weights(plan, node).is_null() && !mask(plan, node), "{:?}", plan.variants);
    }
    let node_hash = |plan: &Plan| plan.runs[0].nodes.iter().map(|node| node.node_hash).collect::<Vec<_>>();
    assert_eq!(node_hash(&in_the_file), node_hash(&on_the_command_line));
    // What cannot be none is refused alike.
    let cannot = "`steps` must be a whole number, not `null`";
    assert!(plan_of(&learning("steps: null", wired, ""), &[]).expect_err("in the file").contains(cannot));
    let set = [("learn.train.with.steps", "null")];
    assert!(plan_of(&learning("steps: 5", wired, ""), &set).expect_err("by --set").contains(cannot));
    let variants = "variants: { none: { learn.train.with.steps: null } }";
    assert!(plan_of(&learning("steps: 5", wired, variants), &[]).expect_err("in a variant").contains(cannot));
    let set = [("learn.weight.inputs.image", "null")];
    assert!(plan_of(&learning("", wired, ""), &set).expect_err("needed").contains("the input `image` (image)"));
    let set = [("learn.weight.inputs.maks", "null")];
    assert!(plan_of(&learning("", wired, ""), &set).expect_err("misspelt").contains("did you mean `mask`?"));
}

const SCORED: &str = "experiment: scored
sources: { test: { kind: synthetic/road } }
stages:
  compare:
    source: test
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      fused: { kind: filter/median, inputs: { depth: depth/depth } }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth, fused: fused/depth } }
";

#[test]
fn fault_26_an_estimate_that_is_nothing_is_not_scored() {
    let labels = |plan: &Plan| plan.runs[0].estimates.iter().map(|e| e.label.clone()).collect::<Vec<_>>();
    assert_eq!(labels(&plan_of(SCORED, &[]).expect("right")), ["stereo", "fused"]);
    let set = [("compare.score.estimates.fused", "null")];
    assert_eq!(labels(&plan_of(SCORED, &set).expect("right")), ["stereo"]);
    let written = plan_of(&SCORED.replace("fused: fused/depth", "fused: null"), &[]).expect("right");
    assert_eq!(labels(&written), ["stereo"]);
    let set = [("compare.score.estimates.fused", "null"), ("compare.score.estimates.stereo", "null")];
    assert!(plan_of(SCORED, &set).expect_err("none left").contains("every entry of `estimates` is removed"));
}

#[test]
fn fault_32_a_file_of_frames_has_the_look_of_one_or_is_there() {
    let with = |frames: &str| {
        SCORED.replace("kind: synthetic/road", &format!("kind: synthetic/road, with: {{ frames: {frames} }}"))
    };
    for frames in ["ids", "151-155", "'151,152'", "'[1, 2]'", "[3, 3]", "[]", "''", "1.5"] {
        plan_of(&with(frames), &[]).expect_err(frames);
    }
    let folder = folder(&[("main.yaml", &with("ids")), ("ids", "000001_10\n")]);
    let plan = loaded(&folder.path().join("main.yaml"), &[], "").expect("there is such a file").plan;
    assert_eq!(plan.runs[0].source.parts[0].params["frames"], folder.path().join("ids").to_str().expect("text"));
}

#[test]
fn fault_35_what_a_run_keeps_is_right_wherever_it_lies() {
    let main = "# As it was written.
extends: ../base.yaml
experiment: stored   # a comment
sources:
  train: { kind: kitti/stereo2015, with: { root: data/kitti, frames: ids.txt } }
stages:
  learn:
    nodes: { graph: graph.yaml }
";
    let base = learning("weights: net.onnx", "mask: edges/mask", "");
    let graph = "nodes: { graph: parts/more.yaml, stereo: { with: { block: 7 } } }";
    let more = "nodes: { edges: { with: { threshold: 50 } } }";
    let files =
        [("exps/main.yaml", main), ("base.yaml", &base), ("exps/graph.yaml", graph), ("exps/parts/more.yaml", more)];
    let project = folder(&files);
    let set = [("learn.train.with.steps", "7")];
    let first = loaded(&project.path().join("exps/main.yaml"), &set, "").unwrap_or_else(|message| panic!("{message}"));
    let names: Vec<&str> = first.stored.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names.len(), 5, "{names:?}");
    assert_eq!((names[0], names[4]), ("experiment.yaml", "experiment.resolved.yaml"));
    let stored: Vec<(&str, &str)> = first.stored.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    assert!(stored[0].1.contains("# a comment") && stored[0].1.contains("# As it was written."), "{}", stored[0].1);
    let run = folder(&stored);
    let resolved =
        loaded(&run.path().join("experiment.resolved.yaml"), &[], "").unwrap_or_else(|message| panic!("{message}"));
    assert_eq!(resolved.plan.summary_json(), first.plan.summary_json());
    assert_eq!(
        resolved.plan.runs[0].source.parts, first.plan.runs[0].source.parts,
        "the paths of the data do not change"
    );
    let written = loaded(&run.path().join("experiment.yaml"), &set, "").unwrap_or_else(|message| panic!("{message}"));
    assert_eq!(written.plan.summary_json(), first.plan.summary_json());
    // Kept again, from there: nothing is lost.
    let again = folder(&written.stored.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect::<Vec<_>>());
    let thrice = loaded(&again.path().join("experiment.yaml"), &set, "").unwrap_or_else(|message| panic!("{message}"));
    assert_eq!(thrice.plan.summary_json(), first.plan.summary_json());
}

#[test]
fn what_an_experiment_is_read_from_and_names_is_known_by_its_path() {
    let main = "extends: ../base.yaml
sources: { train: { kind: kitti/stereo2015, with: { root: data, frames: ./ids.txt } } }
stages: { learn: { nodes: { graph: parts/graph.yaml } } }
";
    let base = learning("weights: net.onnx", "mask: edges/mask", "");
    let files = [("exps/main.yaml", main), ("base.yaml", &base), ("exps/parts/graph.yaml", "nodes: {}")];
    let project = folder(&files);
    let first = loaded(&project.path().join("exps/main.yaml"), &[], "").unwrap_or_else(|message| panic!("{message}"));
    let mut read: Vec<_> = first.read.iter().map(|path| path.strip_prefix(project.path()).expect("in it")).collect();
    read.sort();
    let expected = ["base.yaml", "exps/data", "exps/ids.txt", "exps/main.yaml", "exps/parts/graph.yaml", "net.onnx"];
    assert_eq!(read, expected.map(Path::new));
}

#[test]
fn large_files_are_refused_before_they_fill_the_memory() {
    let deep = format!("learn.train.with{}", ".x".repeat(20_000));
    let message = plan_of(&learning("", "mask: edges/mask", ""), &[(&deep, "1")]).expect_err("too deep");
    assert!(message.contains("the path is deeper than 32 keys"));
    let axes: String = (0..5000).map(|i| format!("  learn.train.with.p{i}: [1]\n")).collect();
    let text = learning(
        "",
        "mask: edges/mask",
        &format!("matrix:\n  learn.train.with.batch: [{}]\n{axes}", "1,".repeat(9000)),
    );
    assert!(plan_of(&text, &[]).expect_err("too many").contains("a matrix of 5001 paths: more than 64"));
    let changes: String = (0..5000).map(|i| format!("    learn.train.with.p{i}: 1\n")).collect();
    let text = learning("", "mask: edges/mask", &format!("variants:\n  full:\n{changes}"));
    assert!(plan_of(&text, &[]).expect_err("too many").contains("changes more than 1000 paths"));
    let nodes: String = (0..9000).map(|i| format!("  n{i}: {{ kind: filter/median }}\n")).collect();
    let stages: String =
        (0..3000).map(|i| format!("  s{i}: {{ source: test, nodes: {{ graph: g.yaml }} }}\n")).collect();
    let main = format!("experiment: large\nsources: {{ test: {{ kind: synthetic/road }} }}\nstages:\n{stages}");
    let folder = folder(&[("main.yaml", &main), ("g.yaml", &format!("nodes:\n{nodes}"))]);
    let message = loaded(&folder.path().join("main.yaml"), &[], "").expect_err("too large");
    assert!(
        message.contains("the graph files of this experiment have more than 1000000 values"),
        "{}",
        &message[..200]
    );
}
