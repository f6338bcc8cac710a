//! The output of commands with `--json` matches the published schemas: every required key, and no unknown key.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::{Value as Json, json};

use crate::support::{depthloom, succeed, workspace};

/// Two variants on a generated data set.
const EXPERIMENT: &str = "experiment: outputs
sources:
  street: { kind: kitti/stereo2015, with: { root: data, split: training, ground_truth: occ } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, with: { disparities: 32 }, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
    score:
      ground_truth: source/depth
      sets: [valid, all]
      zones: { distance_m: [10, 20, 80] }
      estimates: { depth: depth/depth }
matrix:
  look.stereo.with.block: [3, 9]
";

/// The violations of a schema by a value. Objects may only have the keys that the schema lists.
fn faults(schema: &Json, root: &Json, value: &Json, at: &str) -> Vec<String> {
    if let Some(reference) = schema["$ref"].as_str() {
        let target = root.pointer(reference.trim_start_matches('#')).expect("a definition");
        return faults(target, root, value, at);
    }
    for any in ["anyOf", "oneOf"] {
        if let Some(alternatives) = schema[any].as_array() {
            let wrong: Vec<Vec<String>> = alternatives.iter().map(|schema| faults(schema, root, value, at)).collect();
            return if wrong.iter().any(Vec::is_empty) { Vec::new() } else { wrong.concat() };
        }
    }
    let mut wrong = Vec::new();
    if schema.get("const").is_some_and(|only| only != value) {
        wrong.push(format!("{at} is {value}, not {}", schema["const"]));
    }
    if schema["enum"].as_array().is_some_and(|values| !values.contains(value)) {
        wrong.push(format!("{at} is {value}, not one of {}", schema["enum"]));
    }
    let is_a = |name: &Json| match name.as_str() {
        Some("object") => value.is_object(),
        Some("array") => value.is_array(),
        Some("string") => value.is_string(),
        Some("boolean") => value.is_boolean(),
        Some("null") => value.is_null(),
        Some("integer") => value.is_i64() || value.is_u64(),
        Some("number") => value.is_number(),
        _ => panic!("a type {name} at {at}"),
    };
    match &schema["type"] {
        Json::Null => {}
        Json::Array(types) if types.iter().any(is_a) => {}
        name @ Json::String(_) if is_a(name) => {}
        name => wrong.push(format!("{at} is {value}, not of type {name}")),
    }
    if let (Some(object), true) = (value.as_object(), schema["type"] != Json::Null) {
        for name in schema["required"].as_array().into_iter().flatten().filter_map(Json::as_str) {
            if !object.contains_key(name) {
                wrong.push(format!("{at} has no `{name}`"));
            }
        }
        for (name, value) in object {
            let at = format!("{at}.{name}");
            match (schema["properties"].get(name), schema.get("additionalProperties")) {
                (Some(schema), _) | (None, Some(schema)) => wrong.extend(faults(schema, root, value, &at)),
                (None, None) => wrong.push(format!("{at} is in no schema")),
            }
        }
    }
    for (index, value) in value.as_array().into_iter().flatten().enumerate() {
        if let Some(schema) = schema.get("items").filter(|items| items.is_object()) {
            wrong.extend(faults(schema, root, value, &format!("{at}[{index}]")));
        }
    }
    wrong
}

/// Runs a command in a folder, and checks its output against the schema of this name.
fn checked_output(seen: &mut BTreeMap<String, u32>, folder: &Path, name: &str, code: i32, arguments: &[&str]) -> Json {
    let output = depthloom().current_dir(folder).args(arguments).output().expect("the binary starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {stderr}");
    let value: Json = serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{arguments:?}: {error}"));
    assert_eq!(value["format"], json!({ "name": format!("depthloom.{name}"), "version": 1 }), "{arguments:?}");
    assert_eq!(value.as_object().and_then(|object| object.keys().next()).map(String::as_str), Some("format"));
    let published = fs::read_to_string(workspace().join(format!("docs/schemas/{name}.json"))).expect("published");
    let schema: Json = serde_json::from_str(&published).expect("JSON");
    assert_eq!(faults(&schema, &schema, &value, name), [] as [String; 0], "{arguments:?}");
    *seen.entry(name.to_owned()).or_default() += 1;
    value
}

#[test]
fn every_json_output_matches_its_schema() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = folder.path();
    let size = ["--width", "320", "--height", "96", "--frames", "3", "--quiet"];
    succeed(depthloom().arg("synth").arg(here.join("data")).args(size));
    fs::write(here.join("outputs.yaml"), EXPERIMENT).expect("written");
    fs::write(here.join("wrong.yaml"), EXPERIMENT.replace("stereo/sgbm", "stereo/sgmb")).expect("written");
    let mut seen = BTreeMap::new();
    let mut check = |name: &str, code: i32, arguments: &[&str]| checked_output(&mut seen, here, name, code, arguments);

    check("doctor", 0, &["doctor", "--json"]);
    succeed(depthloom().env_remove("DEPTHLOOM_FRESH").current_dir(here).args([
        "submit",
        "outputs.yaml",
        "--to",
        "script",
    ]));
    check("jobs", 0, &["jobs", "--json"]);
    check("nodes", 0, &["nodes", "--json"]);
    let network = workspace().join("tests/fixtures/networks/shifts.onnx");
    let onnx = check("inspect-onnx", 0, &["inspect", network.to_str().expect("a path"), "--json"]);
    assert_eq!(onnx["kind"], "stereo/onnx");
    check("nodes-kind", 0, &["nodes", "stereo/sgbm", "--json"]);
    check("nodes-kind", 0, &["nodes", "kitti/stereo2015", "--json"]);
    check("check", 0, &["check", "outputs.yaml", "--data", "--json"]);
    let wrong = check("check", 2, &["check", "wrong.yaml", "--json"]);
    assert!(wrong["error"]["diagnostics"][0]["line"].is_u64(), "{wrong}");
    check("error", 2, &["plan", "wrong.yaml", "--json"]);
    check("plan", 0, &["plan", "outputs.yaml", "--json"]);
    check("graph", 0, &["graph", "outputs.yaml", "--json"]);
    check("inspect-data-set", 0, &["inspect", "data", "--json"]);

    let run = check("run", 0, &["run", "outputs.yaml", "--out", "runs/outputs/first", "--json"]);
    assert_eq!(
        run["frames"],
        json!([{ "stage": "look", "variant": null, "ids": ["000000_10", "000001_10", "000002_10"], "failed": 0 }])
    );
    assert_eq!((&run["failures"], &run["failed_frames"]), (&json!([]), &json!(0)));
    let nodes = run["parameters"]["runs"][0]["nodes"].as_array().expect("nodes");
    let blocks: Vec<&Json> =
        nodes.iter().filter(|node| node["name"] == "stereo").map(|node| &node["with"]["block"]).collect();
    assert_eq!(blocks, [3, 9]);
    let files: Vec<&str> =
        run["files"].as_array().expect("files").iter().filter_map(|file| file["name"].as_str()).collect();
    assert!(files.contains(&"recording.mcap") && files.contains(&"scores.parquet"), "{files:?}");

    // A frame that cannot be read.
    let image = here.join("data/training/image_2/000001_10.png");
    let bytes = fs::read(&image).expect("an image");
    fs::write(&image, &bytes[..bytes.len() / 2]).expect("cut");
    check("check", 2, &["check", "outputs.yaml", "--data", "--json"]);
    let failed = check("run", 3, &["run", "outputs.yaml", "--keep-going", "--out", "runs/outputs/second", "--json"]);
    assert_eq!((&failed["frames"][0]["failed"], &failed["error"]["exit_code"]), (&json!(1), &json!(3)));
    let failure = &failed["failures"][0];
    let place = (&failure["stage"], &failure["position"], &failure["frame"], &failure["node"]);
    assert_eq!(place, (&json!("look"), &json!(1), &json!("000001_10"), &Json::Null));
    assert!(failure["message"].as_str().is_some_and(|message| message.contains("000001_10.png")), "{failure}");

    let first = "runs/outputs/first";
    check("report", 0, &["report", first, "--out", "tables", "--json"]);
    check("report", 0, &["report", first, "--out", "tables", "--paper", "--json"]);
    check("table", 0, &["table", first, "--json"]);
    check("table", 0, &["table", first, "--rows", "score", "--json"]);
    check("table", 0, &["table", first, "--effects", "abs_rel", "--json"]);
    check("table", 0, &["table", first, "--best-per-zone", "abs_rel", "--json"]);
    check("compare", 0, &["compare", first, "--json"]);
    check("compare", 3, &["compare", first, "--fail-if", "abs_rel >= -1000%", "--json"]);
    let explained = check("explain", 0, &["explain", first, "abs_rel", "block=9/depth", "--json"]);
    assert_eq!((&explained["variant"], &explained["estimate"]), (&json!("block=9"), &json!("depth")));
    check("analyse-samples", 0, &["analyse", "--samples-only", first, "--json"]);
    check("analyse", 0, &["analyse", first, "--by", "frame", "--json"]);
    check("figure", 0, &["figure", first, "cdf", "--out", "cdf.pdf", "--csv", "cdf.csv", "--json"]);
    check("figure", 0, &["figure", first, "frames", "--out", "frames.png", "--json"]);
    let by_distance = ["compare", first, "block=3/depth", "block=9/depth", "--by", "distance", "--json"];
    check("compare-by-distance", 0, &by_distance);
    check("runs-timings", 0, &["runs", "timings", first, "--json"]);
    // One frame is damaged.
    let live = check("live", 3, &["live", "outputs.yaml", "--rate", "20", "--no-drop", "--out", "live", "--json"]);
    assert_eq!((&live["offered"], &live["dropped"]["source"]), (&json!(3), &json!(1)));
    check("runs-timings", 0, &["runs", "timings", "live", "--json"]);
    check("inspect-recording", 0, &["inspect", "live", "--json"]);
    check("inspect-recording", 0, &["inspect", first, "--keys", "--verify-bytes", "--json"]);
    check("export", 0, &["export", first, "--out", "maps", "--json"]);
    check("verify", 0, &["verify", first, "--json"]);
    check("plan-cost", 0, &["plan", "outputs.yaml", "--cost", "--from", first, "--json"]);
    check("plan-reuse", 0, &["plan", "outputs.yaml", "--reuse", "--json"]);
    check("runs-list", 0, &["runs", "--json"]);
    check("runs-show", 0, &["runs", "show", first, "--json"]);
    check("runs-notes", 0, &["runs", "tag", first, "paper", "--json"]);
    check("runs-diff", 0, &["runs", "diff", first, "runs/outputs/second", "--json"]);
    check("runs-prune", 0, &["runs", "prune", "--keep", "1", "--dry-run", "--json"]);
    check("runs-rm", 0, &["runs", "rm", "runs/outputs/second", "--json"]);

    // A truncated recording, and one with a changed byte.
    let recording = fs::read(here.join(first).join("recording.mcap")).expect("a recording");
    fs::write(here.join("cut.mcap"), &recording[..recording.len() / 2]).expect("written");
    check("runs-recover", 0, &["runs", "recover", "cut.mcap", "--out", "recovered.mcap", "--json"]);
    let mut flipped = recording;
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    fs::write(here.join("flipped.mcap"), &flipped).expect("written");
    check("report", 3, &["report", "flipped.mcap", "--out", "of-flipped", "--json"]);
    check("inspect-recording", 3, &["inspect", "flipped.mcap", "--verify-bytes", "--json"]);

    let published = fs::read_dir(workspace().join("docs/schemas")).expect("schemas");
    let names = published.map(|file| file.expect("a file").path().file_stem().expect("its name").display().to_string());
    let mut untested: Vec<String> = names.filter(|name| !seen.contains_key(name)).collect();
    untested.sort();
    assert_eq!(untested, [] as [&str; 0], "schemas of outputs that this test does not check");
}

#[test]
fn schemas_are_printed_by_name() {
    let schema = |arguments: &[&str]| -> Json {
        let printed = succeed(Command::arg(&mut depthloom(), "schema").args(arguments)).stdout;
        serde_json::from_slice(&printed).expect("JSON")
    };
    assert_eq!(schema(&["--of", "run"])["title"], "depthloom.run");
    assert!(schema(&[])["properties"]["experiment"].is_object());
}
