//! Completion at places of complete and incomplete documents.

use serde_json::Value as Json;

use super::EXPERIMENT;
use super::client::{Client, edited, position, uri};

/// The labels at the cursor `|` of a text.
fn labels(client: &mut Client, address: &str, version: i32, marked: &str) -> (String, Vec<Json>) {
    let cursor = marked.find('|').expect("a cursor");
    let text = marked.replacen('|', "", 1);
    client.replace(address, version, &text);
    let list = client.at("completion", address, position(&text, cursor));
    (text, list["items"].as_array().expect("a list").clone())
}

fn names(items: &[Json]) -> Vec<&str> {
    items.iter().map(|item| item["label"].as_str().expect("text")).collect()
}

/// What is replaced in the experiment (the cursor is at `|`), and words that are completed there.
const PLACES: [(&str, &str, &[&str]); 40] = [
    // Keys.
    ("variants:\n", "var|\nvariants:\n", &["description", "extends", "record"]),
    ("    source: street\n", "    |\n    source: street\n", &["source", "nodes", "score"]),
    ("  second:\n    source: street\n    nodes:\n", "  second:\n    source: street\n    n|\n    nodes:\n", &["nodes"]),
    (
        "stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with",
        "stereo: { kind: stereo/sgbm, |, inputs: { left: source/left, right: source/right }, with",
        &["inputs", "with"],
    ),
    (
        "street: { kind: synthetic/road, with: { frames: 0..2, seed: 1 } }",
        "street: { kind: synthetic/road, w|",
        &["with", "concat"],
    ),
    (
        "      preset: martins2018\n",
        "      |\n      preset: martins2018\n",
        &["ground_truth", "estimates", "sets", "zones"],
    ),
    (
        "smooth: { from: smooth/depth, sets: [valid, all] }",
        "smooth: { from: smooth/depth, | }",
        &["sets", "ground_truth", "deviation"],
    ),
    (
        "record: [second.depth/depth, \"/second/smooth\", first.train/model]",
        "record: { | }",
        &["topics", "every", "view"],
    ),
    // Kinds.
    (
        "depth:\n        kind: depth/from-disparity",
        "depth:\n        kind: dep|",
        &["depth/from-disparity", "stereo/sgbm"],
    ),
    ("smooth: { kind: filter/median", "smooth: { kind: |", &["filter/median", "fusion/scale"]),
    ("other: { kind: synthetic/road", "other: { kind: sy|", &["synthetic/road", "kitti/stereo2015"]),
    // Ports and references.
    (
        "inputs: { disparity: stereo/disparity, calibration: source/calibration }\n        with: { cap",
        "inputs: { | }\n        with: { cap",
        &["disparity", "calibration"],
    ),
    (
        "inputs: { disparity: stereo/disparity, calibration: source/calibration }\n        with: { cap",
        "inputs:\n          dis|\n        with: { cap",
        &["disparity"],
    ),
    ("disparity: stereo/disparity", "disparity: |", &["stereo/disparity", "source/calibration"]),
    ("disparity: stereo/disparity", "disparity: stereo/|", &["stereo/disparity"]),
    ("model: first.train/model", "model: fir|", &["first.train/model"]),
    (
        "image: source/left, calibration: source/calibration, model",
        "image: source/|, calibration: source/calibration, model",
        &["source/left", "source/right"],
    ),
    ("ground_truth: source/depth", "ground_truth: |", &["source/depth", "depth/depth"]),
    ("raw: depth/depth", "raw: |", &["depth/depth", "smooth/depth", "mono/depth"]),
    ("smooth: { from: smooth/depth", "smooth: { from: sm|", &["smooth/depth"]),
    ("    source: street", "    source: |", &["street", "other"]),
    // Parameters and their values.
    ("with: { cap: 80 }", "with: { | }", &["cap"]),
    ("with: { cap: 80 }\n      smooth", "with:\n          c|\n      smooth", &["cap"]),
    ("with: { frames: 0..2, seed: 1 } }", "with: { frames: 0..2, s", &[]),
    ("frames: 0..2, seed: 1", "frames: |, seed: 1", &["0..8", "1..=40"]),
    ("network: unet-tiny", "network: |", &["unet-tiny", "unet-lite"]),
    ("preset: martins2018", "preset: |", &["martins2018", "kitti-depth"]),
    ("sets: [valid, all]", "sets: [valid, |]", &["valid", "all", "filled"]),
    // Variants and the matrix.
    (
        "full: {}",
        "full: { | }",
        &["second.depth.with.cap", "second.smooth.inputs.depth", "second.mono.kind", "sources.street.with.seed"],
    ),
    ("full: {}", "full: { second.de|", &["second.depth.with.cap"]),
    ("full: {}", "full:\n    |", &["second.depth.with.cap", "first.train.with.network"]),
    ("second.depth.with.cap: 120", "second.smooth.kind: |", &["filter/median"]),
    ("second.depth.with.cap: 120", "first.train.with.network: |", &["unet-lite"]),
    ("second.smooth.inputs.depth: depth/depth", "second.smooth.inputs.depth: |", &["depth/depth", "mono/depth"]),
    ("second.depth.with.cap: 120", "second.source: |", &["street", "other"]),
    ("matrix:\n", "matrix:\n  |\n", &["second.depth.with.cap", "sample", "exclude"]),
    (
        "second.stereo.with.block: [5, 7, 9]\n",
        "net: { paths: first.train.with.network, values: [|] }\n",
        &["unet-lite"],
    ),
    ("exclude: [{ second.stereo.with.block: 7 }]", "exclude: [{ | }]", &["second.stereo.with.block"]),
    ("only: [\"full+*\", ", "only: [|, ", &["full", "far"]),
    (
        "record: [second.depth/depth, ",
        "record: [|, ",
        &["second.depth/depth", "first.train/model", "second.source/left"],
    ),
];

#[test]
fn words_are_completed_at_forty_places() {
    let folder = tempfile::tempdir().expect("a folder");
    let address = uri(&folder.path().join("look.yaml"));
    let mut client = Client::initialized(folder.path());
    client.open(&address, EXPERIMENT);
    let mut missing = Vec::new();
    for (index, (from, to, expected)) in PLACES.into_iter().enumerate() {
        assert!(EXPERIMENT.contains(from), "{from}");
        let marked = EXPERIMENT.replacen(from, to, 1);
        let version = i32::try_from(index).expect("small") + 2;
        if expected.is_empty() {
            continue;
        }
        let (_, items) = labels(&mut client, &address, version, &marked);
        let names = names(&items);
        for word in expected.iter().filter(|word| !names.contains(word)) {
            missing.push(format!("{to}: `{word}` is not among {names:?}"));
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
    assert_eq!(client.finish(), 0);
}

#[test]
fn the_best_candidates_come_first_with_their_documentation() {
    let folder = tempfile::tempdir().expect("a folder");
    let address = uri(&folder.path().join("look.yaml"));
    let mut client = Client::initialized(folder.path());
    client.open(&address, EXPERIMENT);
    let mut complete =
        |version: i32, from: &str, to: &str| labels(&mut client, &address, version, &EXPERIMENT.replacen(from, to, 1));
    // Outputs with the input's type come first. The node's own outputs are left out.
    let (_, items) = complete(2, "disparity: stereo/disparity", "disparity: |");
    assert_eq!(names(&items)[0], "stereo/disparity");
    assert!(!names(&items).contains(&"depth/depth"));
    // An accepted candidate replaces the whole word.
    let (text, items) = complete(3, "with: { cap: 80 }", "with: { c|op: 80 }");
    let cap = items.iter().find(|item| item["label"] == "cap").expect("a parameter");
    assert!(cap["detail"].as_str().expect("facts").contains("default"), "{cap}");
    assert!(cap["documentation"]["value"].as_str().is_some_and(|text| text.len() > 10), "{cap}");
    assert_eq!(edited(&text, &Json::Array(vec![cap["textEdit"].clone()])), EXPERIMENT);
    // A new key gets its colon.
    let (text, items) = complete(4, "with: { cap: 80 }", "with: { ca| }");
    let cap = items.iter().find(|item| item["label"] == "cap").expect("a parameter");
    let text = edited(&text, &Json::Array(vec![cap["textEdit"].clone()]));
    assert!(text.contains("with: { cap:  }"), "{text}");
    // Nothing in comments.
    let (_, items) = complete(5, "variants:\n", "# var|\nvariants:\n");
    assert!(items.is_empty());
    assert_eq!(client.finish(), 0);
}

#[test]
fn a_graph_file_is_completed_by_itself() {
    let folder = tempfile::tempdir().expect("a folder");
    let address = uri(&folder.path().join("nodes.yaml"));
    let graph = "nodes:\n  stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }\n  depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity } }\n";
    let mut client = Client::initialized(folder.path());
    assert_eq!(client.open(&address, graph), [] as [Json; 0], "by itself it is not an experiment, and no error");
    let (_, items) =
        labels(&mut client, &address, 2, &graph.replacen("disparity: stereo/disparity", "disparity: |", 1));
    assert!(names(&items).contains(&"stereo/disparity"), "{items:?}");
    let (_, items) =
        labels(&mut client, &address, 3, &graph.replacen("inputs: { disparity", "| , inputs: { disparity", 1));
    assert!(names(&items).contains(&"with"), "{items:?}");
    assert_eq!(client.finish(), 0);
}
