//! `plan --cost`: predictions from a small run, compared with what larger runs measured.

use std::fs;
use std::path::Path;

use serde_json::Value as Json;

use crate::support::{depthloom, succeed};

/// Three variants, with nodes that all share and nodes of single variants.
const EXPERIMENT: &str = "experiment: costs
sources:
  street: { kind: synthetic/road, with: { frames: 0..20, seed: 1, width: 224, height: 72 } }
stages:
  compare:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, with: { disparities: 32 }, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      weight: { kind: confidence/sobel, inputs: { image: source/left } }
      mono: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/calibration } }
      merged: { kind: fusion/confidence, inputs: { mono: mono/depth, stereo: depth/depth, weight: weight/weight } }
    score:
      ground_truth: source/depth
      estimates: { stereo: depth/depth, merged: merged/depth }
variants:
  full: {}
  confidence: { compare.merged.with.weighting: confidence }
  mean: { compare.merged.with.weighting: mean }
";

/// A training on one source, and its network on another.
const TRAINING: &str = "experiment: training
sources:
  train: { kind: synthetic/road, with: { frames: 0..4, seed: 1, width: 160, height: 64 } }
  test: { kind: synthetic/road, with: { frames: 0..2, seed: 2, width: 160, height: 64 } }
stages:
  learn:
    source: train
    nodes:
      stereo: { kind: stereo/sgbm, with: { disparities: 32 }, inputs: { left: source/left, right: source/right } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples:
        kind: learn/samples
        inputs: { image: source/left, target: stereo/disparity, mask: edges/mask, calibration: source/calibration }
        with: { size: [64, 32] }
      train: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { steps: 3, batch: 2 } }
  compare:
    source: test
    nodes:
      mono:
        kind: mono/onnx
        inputs: { image: source/left, calibration: source/calibration, model: learn.train/model }
    score:
      ground_truth: source/depth
      estimates: { mono: mono/depth }
";

fn run(folder: &Path, arguments: &[&str]) -> Json {
    succeed(depthloom().current_dir(folder).arg("run").args(arguments).arg("--quiet"));
    let out = arguments.iter().skip_while(|argument| **argument != "--out").nth(1).expect("--out");
    let environment = fs::read(folder.join(out).join("environment.json")).expect("a file");
    serde_json::from_slice(&environment).expect("JSON")
}

fn predict(folder: &Path, arguments: &[&str]) -> Json {
    let output = succeed(depthloom().current_dir(folder).arg("plan").args(arguments).args(["--cost", "--json"]));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Checks that a prediction and a measurement differ by this factor at most.
fn check_factor(what: &str, predicted: f64, measured: f64, factor: f64) {
    let quotient = predicted / measured;
    println!("{what}: predicted {predicted:.2}, measured {measured:.2}, quotient {quotient:.3}");
    assert!((1.0 / factor..factor).contains(&quotient), "{what}: predicted {predicted}, measured {measured}");
}

fn bytes_in(folder: &Path) -> f64 {
    let sizes =
        fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").metadata().expect("a size"));
    sizes.map(|metadata| metadata.len() as f64).sum()
}

/// The sum of a number over the parts of this class.
fn part(prediction: &Json, class: &str, number: &str) -> f64 {
    let steps = prediction["steps"].as_array().expect("steps").iter();
    let parts = steps.flat_map(|step| step["parts"].as_array().expect("parts"));
    parts.filter(|part| part["part"] == class).map(|part| part[number].as_f64().expect("a number")).sum()
}

#[test]
fn a_run_of_20_frames_predicts_one_of_100() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = folder.path();
    fs::write(here.join("costs.yaml"), EXPERIMENT).expect("written");
    run(here, &["costs.yaml", "--out", "runs/costs/small", "--workers", "1"]);
    let large = ["costs.yaml", "--set", "sources.street.with.frames=0..100", "--out", "large", "--workers", "2"];
    let measured = run(here, &large);

    let predicted = predict(here, &["costs.yaml", "--frames", "100", "--workers", "2"]);
    assert_eq!(predicted["from"], "runs/costs/small");
    assert_eq!((&predicted["not_included"], &predicted["by_kind"]), (&serde_json::json!([]), &serde_json::json!([])));
    let number = |json: &Json| json.as_f64().expect("a number");
    let recording = fs::metadata(here.join("large/recording.mcap")).expect("a file").len() as f64;
    let page = part(&predicted, "page", "written_bytes");
    check_factor(
        "written",
        number(&predicted["written_bytes"]) - page,
        bytes_in(&here.join("large")) - page_bytes(here),
        1.1,
    );
    check_factor("encoded", part(&predicted, "write", "written_bytes"), recording, 1.1);
    // The images of a page become smaller when there are many.
    check_factor("page", page, page_bytes(here), 1.25);
    // Clocks differ between runs on a busy machine.
    check_factor("CPU time", number(&predicted["cpu_s"]), number(&measured["cpu_s"]), 1.5);
    let without_page = predict(here, &["costs.yaml", "--frames", "100", "--workers", "2", "--no-page"]);
    let measured_without = number(&measured["cpu_s"]) - number(&measured["page"]["cpu_s"]);
    check_factor("CPU time without page", number(&without_page["cpu_s"]), measured_without, 1.5);
    // The wall-clock time is that of two workers.
    assert!(number(&predicted["wall_s"]) >= 0.49 * number(&predicted["cpu_s"]), "{predicted}");

    // The own frames of the experiment: the run itself.
    let own = predict(here, &["costs.yaml", "--from", "runs/costs/small"]);
    let environment: Json =
        serde_json::from_slice(&fs::read(here.join("runs/costs/small/environment.json")).expect("a file"))
            .expect("JSON");
    check_factor("the run itself", number(&own["cpu_s"]), number(&environment["cpu_s"]), 1.05);
    check_factor("its bytes", number(&own["written_bytes"]), bytes_in(&here.join("runs/costs/small")), 1.05);
}

fn page_bytes(here: &Path) -> f64 {
    fs::metadata(here.join("large/report.html")).expect("a page").len() as f64
}

#[test]
fn variants_workers_and_bandwidth_change_a_prediction() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = folder.path();
    fs::write(here.join("costs.yaml"), EXPERIMENT.replace("0..20", "0..2")).expect("written");
    run(here, &["costs.yaml", "--out", "runs/costs/one", "--no-page"]);
    let number = |json: &Json, key: &str| json[key].as_f64().expect("a number");
    let one = predict(here, &["costs.yaml", "--workers", "1"]);

    // Only what single variants use doubles.
    let more = predict(here, &["costs.yaml", "--workers", "1", "--variants", "6"]);
    assert_eq!(more["variants"], 6);
    let [before, after] = [&one, &more].map(|json| part(json, "nodes", "cpu_s"));
    assert!(before < after && after < 2.0 * before, "{before} and {after}");
    assert_eq!(part(&one, "read", "cpu_s"), part(&more, "read", "cpu_s"));
    let written = |json: &Json| part(json, "write", "written_bytes");
    assert!(written(&one) < written(&more) && written(&more) < 2.0 * written(&one));

    // The file system becomes the limit.
    let limit = number(&one["file_system"], "workers_at_limit");
    let many = predict(here, &["costs.yaml", "--workers", "1", "--bandwidth", "1000000"]);
    assert!(number(&many["file_system"], "workers_at_limit") > limit);
    let few = predict(here, &["costs.yaml", "--workers", "1000", "--bandwidth", "1", "--frames", "1000"]);
    assert_eq!((&few["wall_limit"], &few["bandwidth_mb_s"]), (&"file_system".into(), &1.0.into()));

    // A node with other parameters costs as much as before; one of a new kind is not included.
    let changed = predict(here, &["costs.yaml", "--set", "compare.stereo.with.block=9"]);
    let by_kind = changed["by_kind"].as_array().expect("a list");
    assert!(by_kind.contains(&"compare.stereo (stereo/sgbm)".into()), "{by_kind:?}");
    let median = "      smooth: { kind: filter/median, inputs: { depth: depth/depth } }\n    score:";
    let text = EXPERIMENT.replace("0..20", "0..2").replace("    score:", median);
    fs::write(here.join("added.yaml"), text).expect("written");
    let added = predict(here, &["added.yaml"]);
    assert_eq!(added["not_included"], serde_json::json!(["compare.smooth (filter/median)"]));

    // Another size is another cost.
    let size = "sources.street.with.width=640";
    let output = succeed(depthloom().current_dir(here).args(["plan", "costs.yaml", "--cost", "--set", size]));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("the source of stage `compare` differs"), "{stderr}");
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert!(stdout.contains("core-hours") && stdout.contains("500 MB/s"), "{stdout}");

    // Without a run there is nothing to predict from.
    let output = depthloom().current_dir(here).args(["plan", "costs.yaml", "--cost", "--runs", "none"]).output();
    let output = output.expect("the binary starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("no finished run in none") && stderr.contains("--from"), "{stderr}");
}

#[test]
fn a_training_keeps_its_frames_and_reused_values_are_not_measurements() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = folder.path();
    fs::write(here.join("training.yaml"), TRAINING).expect("written");
    run(here, &["training.yaml", "--out", "runs/training/one", "--no-page"]);
    let predicted = predict(here, &["training.yaml", "--frames", "50"]);
    let stages: Vec<_> = predicted["steps"].as_array().expect("steps").iter().map(|step| &step["frames"]).collect();
    assert_eq!(stages, [&Json::Null, &4.into(), &50.into(), &Json::Null]);
    assert_eq!(predicted["own_frames"], serde_json::json!(["learn"]));
    let own = predict(here, &["training.yaml"]);
    let trained = |json: &Json| part(json, "aggregate", "cpu_s");
    assert!(trained(&own) > 0.0);
    assert_eq!(trained(&own), trained(&predicted));

    // The newest run reused everything: the first one has the measurements.
    let repeat = |out: &str, set: &str| {
        let arguments = ["run", "training.yaml", "--out", out, "--set", set, "--no-page", "--quiet"];
        succeed(depthloom().current_dir(here).env_remove("DEPTHLOOM_FRESH").args(arguments));
    };
    repeat("runs/training/two", "compare.mono.with.cap=80");
    assert_eq!(predict(here, &["training.yaml"])["from"], "runs/training/one");
    let output =
        depthloom().current_dir(here).args(["plan", "training.yaml", "--cost", "--from", "training/two"]).output();
    let output = output.expect("the binary starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("runs/training/two has no measurement"), "{stderr}");
    repeat("runs/training/three", "compare.mono.with.cap=50");
    let output = predict(here, &["training.yaml", "--from", "training/three"]);
    assert!(output["warnings"].to_string().contains("reused values of 4 nodes"), "{output}");
    assert!(output["not_included"].to_string().contains("learn.train (learn/ssl)"), "{output}");
    assert_eq!(output["by_kind"].as_array().map(|list| list.contains(&"compare.mono (mono/onnx)".into())), Some(true));
}
