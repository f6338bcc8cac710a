//! Networks with and without ONNX Runtime, and the engine that a run reports.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value as Json;

use crate::support::{depthloom, label, number, read_csv, set, shared, skipped, succeed, workspace};
use depthloom_test_needs::onnx_file::{self, F32, Tensor};

/// An experiment on a street with a network whose disparity is the mean of the colours.
fn experiment(folder: &Path, with: &str) -> PathBuf {
    let inputs = [Tensor("image", F32, &[1, 3, 32, 96])];
    let output = Tensor("share", F32, &[1, 1, 32, 96]);
    std::fs::write(folder.join("net.onnx"), onnx_file::model("ReduceMean", Some(1), &inputs, &output))
        .expect("written");
    let text = format!(
        "experiment: network
sources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..2, width: 192, height: 64 }} }} }}
stages:
  look:
    source: street
    nodes:
      mono:
        kind: mono/onnx
        inputs: {{ image: source/left, calibration: source/calibration, model: {{ file: net.onnx }} }}
        with: {with}
    score: {{ ground_truth: source/depth, estimates: {{ mono: {{ from: mono/depth, sets: [all] }} }} }}
"
    );
    let path = folder.join("experiment.yaml");
    std::fs::write(&path, text).expect("written");
    path
}

/// The binary with an empty environment, without Python, and in a working folder without a Python environment above it.
fn bare() -> Command {
    let mut command = depthloom();
    command.current_dir("/").env_clear().env("PATH", "").env("NO_COLOR", "1").env("DEPTHLOOM_FRESH", "1");
    command
}

fn json(path: &Path) -> Json {
    serde_json::from_str(&std::fs::read_to_string(path).expect("the file")).expect("JSON")
}

/// Whether the program was built with tract; reports the test as skipped otherwise.
fn has_tract(test: &str) -> bool {
    if !cfg!(feature = "tract") {
        skipped(test, "built without tract");
    }
    cfg!(feature = "tract")
}

#[test]
fn networks_run_in_tract_without_onnx_runtime_and_the_run_records_it() {
    if !has_tract("networks_run_in_tract_without_onnx_runtime_and_the_run_records_it") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = experiment(folder.path(), "{ flip: godard }");
    let doctor = succeed(bare().args(["doctor", "--json"]));
    let doctor: Json = serde_json::from_slice(&doctor.stdout).expect("JSON");
    if doctor["networks"]["engine"] == "onnxruntime" {
        return skipped(
            "networks_run_in_tract_without_onnx_runtime_and_the_run_records_it",
            "ONNX Runtime is part of this system",
        );
    }
    assert_eq!(doctor["networks"]["engine"], "tract");
    assert_eq!(doctor["networks"]["providers"], serde_json::json!(["cpu"]));
    let out = folder.path().join("run");
    succeed(bare().args(["run", "--no-page", "--quiet", "--out"]).arg(&out).arg(&path));
    let networks = &json(&out.join("environment.json"))["networks"];
    assert_eq!(networks["engine"], "tract");
    assert_eq!(networks["found_by"], "fallback");
    assert_eq!(networks["ran_on"], serde_json::json!(["cpu"]));
    let why = networks["instead_of"].as_str().expect("a reason");
    assert!(why.starts_with("this machine has no ONNX Runtime"), "{why}");
    // Selected by name, tract yields the same bytes.
    let again = folder.path().join("again");
    let named = ("DEPTHLOOM_ONNX_ENGINE", "tract");
    succeed(bare().env(named.0, named.1).args(["run", "--no-page", "--quiet", "--out"]).arg(&again).arg(&path));
    let recording = |run: &Path| std::fs::read(run.join("recording.mcap")).expect("a recording");
    assert!(recording(&out) == recording(&again), "two runs of one engine differ");
    // A library or engine that was selected by name has no fallback.
    for (variable, value) in
        [("ORT_DYLIB_PATH", "/nowhere/libonnxruntime.so"), ("DEPTHLOOM_ONNX_ENGINE", "onnxruntime")]
    {
        let output = bare().env(variable, value).args(["run", "--no-page"]).arg(&path).output().expect("started");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains("libonnxruntime.so") || stderr.contains("no ONNX Runtime"), "{stderr}");
    }
}

#[test]
fn an_unusable_named_library_is_an_error_with_remedies() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = experiment(folder.path(), "{}");
    let text = folder.path().join("libonnxruntime.so");
    std::fs::write(&text, "<html>404</html>").expect("written");
    for library in ["/nowhere/libonnxruntime.so".as_ref(), text.as_path(), folder.path()] {
        for command in ["run", "doctor"] {
            let mut program = bare();
            program.env("ORT_DYLIB_PATH", library).arg(command);
            if command == "run" {
                program.arg(&path).arg("--out").arg(folder.path().join("run"));
            }
            let output = program.output().expect("started");
            assert_eq!(output.status.code(), Some(if command == "run" { 2 } else { 0 }), "{output:?}");
            let printed = [output.stdout, output.stderr].concat();
            let printed = String::from_utf8_lossy(&printed);
            assert!(printed.contains(&format!("{}", library.display())), "{printed}");
            assert!(
                printed.contains("unset ORT_DYLIB_PATH") && printed.contains("let it name libonnxruntime.so"),
                "{printed}"
            );
            assert_eq!(printed.contains("DEPTHLOOM_ONNX_ENGINE=tract"), cfg!(feature = "tract"), "{printed}");
        }
    }
}

#[test]
fn unknown_engines_and_missing_providers_are_found_before_any_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = experiment(folder.path(), "{ provider: directml }");
    let run = |engine: &str| {
        let mut command = bare();
        command
            .env("DEPTHLOOM_ONNX_ENGINE", engine)
            .args(["run", "--no-page", "--out"])
            .arg(folder.path().join("run"))
            .arg(&path);
        let output = command.output().expect("started");
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let unknown = run("caffe");
    assert!(unknown.contains("DEPTHLOOM_ONNX_ENGINE is `caffe`, which is not an engine"), "{unknown}");
    if has_tract("unknown_engines_and_missing_providers_are_found_before_any_frame") {
        let missing = run("tract");
        assert!(missing.contains("has no provider `directml`; it has cpu"), "{missing}");
        assert!(missing.contains("use `provider: cpu`"), "{missing}");
    }
    assert!(!folder.path().join("run").exists() && !folder.path().join("run.partial").exists());
}

#[test]
fn tract_metrics_match_the_reference() {
    let Some(shared) = shared("tract_metrics_match_the_reference") else { return };
    if !has_tract("tract_metrics_match_the_reference") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let shared = shared.canonicalize().expect("an absolute path");
    let mut command = bare();
    command
        .args(["run", "--no-page", "--quiet", "--out"])
        .arg(&out)
        .arg(workspace().join("tests/experiments/golden-onnx.yaml"));
    command.env("KITTI_STEREO_2015", shared.join("data/kitti_stereo_2015"));
    succeed(command.env("MONO_MODEL", shared.join("models/ssl_unet.onnx")).env("DEPTHLOOM_ONNX_ENGINE", "tract"));
    let ours = read_csv(&out.join("scores.csv"));
    let golden = read_csv(&shared.join("oracle/golden/ssl_unet/scores.csv"));
    assert_eq!(ours.len(), golden.len());
    for row in &golden {
        let same = |other: &&crate::support::Row| {
            other["frame"] == row["frame"] && label(other) == label(row) && set(other) == set(row)
        };
        let own = ours.iter().find(same).unwrap_or_else(|| panic!("no row {row:?}"));
        for score in ["a1", "abs_rel", "rmse", "silog"] {
            let (a, b) = (number(own, score), number(row, score));
            assert!((a - b).abs() <= 1e-3 * b.abs(), "{score}: {a} differs from {b} in {row:?}");
        }
    }
}

#[test]
fn stereo_networks_and_networks_with_custom_ports_run_and_replay() {
    const TEST: &str = "stereo_networks_and_networks_with_custom_ports_run_and_replay";
    if !has_tract(TEST) {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let run = |name: &str, workers: &str| {
        let out = folder.path().join(name);
        let mut command = depthloom();
        command.args([
            "run",
            "experiments/stereo-networks.yaml",
            "--workers",
            workers,
            "--quiet",
            "--no-page",
            "--out",
        ]);
        succeed(command.arg(&out).args([
            "--set",
            "sources.test.with.width=317",
            "--set",
            "sources.test.with.height=94",
        ]));
        out
    };
    let (one, eight) = (run("one", "1"), run("eight", "8"));
    let [a, b] = [&one, &eight].map(|out| std::fs::read(out.join("recording.mcap")).expect("a recording"));
    assert!(a == b, "the recordings of one and of eight workers differ");
    let scores = read_csv(&one.join("scores.csv"));
    let rows: Vec<String> = scores.iter().map(label).collect();
    assert!(
        ["sgbm", "network", "checked", "mono", "fused"].iter().all(|name| rows.iter().any(|row| row == name)),
        "{rows:?}"
    );
    let replayed = succeed(depthloom().args(["verify"]).arg(&one));
    let printed = String::from_utf8_lossy(&replayed.stdout);
    assert!(printed.contains("network"), "{printed}");
}

#[test]
fn onnx_prints_inputs_and_a_valid_node_definition() {
    let fixture = |file: &str| workspace().join("tests/fixtures/networks").join(file);
    let shown = |file: &str| {
        let output = succeed(depthloom().arg("inspect").arg(fixture(file)).args(["--size", "160x96"]));
        String::from_utf8(output.stdout).expect("text")
    };
    let shifts = shown("shifts.onnx");
    for part in
        ["input          left  f32 1x3x?x?", "AveragePool 3", "operator set 13", "kind: stereo/onnx", "left_name: left"]
    {
        assert!(shifts.contains(part), "{part}: {shifts}");
    }
    if cfg!(feature = "tract") {
        assert!(shifts.contains("multiply-adds  ") && !shifts.contains("not counted"), "{shifts}");
    }
    assert!(shown("pair.onnx").contains("order: left-right"));
    let fusion = shown("fusion.onnx");
    assert!(fusion.contains("kind: onnx") && fusion.contains("mono: { type: depth, name: mono }"), "{fusion}");
    // The printed lines are valid in an experiment.
    let folder = tempfile::tempdir().expect("a folder");
    let stanza: String =
        shifts.split("\n\n").nth(1).expect("the lines").lines().map(|line| format!("      {line}\n")).collect();
    let text = format!(
        "experiment: pasted\nsources: {{ test: {{ kind: synthetic/road, with: {{ frames: 0..1, width: 192, height: 64 }} }} }}\nstages:\n  look:\n    source: test\n    \
         nodes:\n{stanza}    score: {{ ground_truth: source/depth, estimates: {{ network: stereo/depth }} }}\n"
    );
    let path = folder.path().join("pasted.yaml");
    std::fs::write(&path, text).expect("written");
    succeed(depthloom().arg("check").arg(&path));
    let output = depthloom().arg("inspect").arg(fixture("left.png")).output().expect("it runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.code() == Some(2) && stderr.contains("is not a bag, a recording, an ONNX file or a folder"),
        "{stderr}"
    );
}

#[test]
fn faults_51_and_59_onnx_prints_a_working_node_definition_or_the_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("net.onnx");
    let shown = |inputs: &[Tensor<'_>], output: &Tensor<'_>| {
        let kernel: [(&str, &[i64]); 1] = [("kernel_shape", &[1, 1])];
        std::fs::write(&path, onnx_file::model_with("MaxPool", &kernel, inputs, output)).expect("written");
        String::from_utf8(succeed(depthloom().arg("inspect").arg(&path)).stdout).expect("text")
    };
    let image = |name, element| Tensor(name, element, &[1, 3, 64, 192]);
    for (why, input, output) in [
        ("takes 4 images at once", Tensor("x", F32, &[4, 3, 64, 192]), Tensor("depth", F32, &[4, 3, 64, 192])),
        ("holds i64", image("x", 7), image("depth", 7)),
        ("no output can be a map of its image: it has pose (1x16)", image("x", F32), Tensor("pose", F32, &[1, 16])),
        ("an image has 1 or 3 channels", Tensor("x", F32, &[1, 5, 64, 192]), Tensor("y", F32, &[1, 5, 64, 192])),
    ] {
        let text = shown(&[input], &output);
        assert!(text.contains("no kind of node runs this model: ") && text.contains(why), "{why}: {text}");
        assert!(!text.contains("kind: "), "{text}");
    }
    const F16: u64 = 10;
    for (element, name, means) in [
        (F32, "depth", "output: depth"),
        (F16, "inv_depth", "output: inverse-depth"),
        (F32, "disp", "output: disparity-share"),
    ] {
        let text = shown(&[image("x", element)], &image(name, element));
        assert!(text.contains(means) && text.contains("head: 0"), "{text}");
        if depthloom_nodes::onnx::find().is_err() {
            continue;
        }
        let lines: String =
            text.split("\n\n").nth(1).expect("the lines").lines().map(|line| format!("      {line}\n")).collect();
        let experiment = format!(
            "experiment: pasted\nsources: {{ test: {{ kind: synthetic/road, with: {{ frames: 0..1, width: 192, height: 64 }} }} }}\nstages:\n  look:\n    source: test\n    \
             nodes:\n{lines}    score: {{ ground_truth: source/depth, estimates: {{ network: depth/depth }} }}\n"
        );
        let file = folder.path().join("pasted.yaml");
        std::fs::write(&file, experiment).expect("written");
        succeed(
            depthloom()
                .args(["run", "--no-page"])
                .arg(&file)
                .args(["--quiet", "--fresh", "--out"])
                .arg(folder.path().join(name)),
        );
    }
}

/// A file of a page of the guide: the block after `<!-- file: NAME -->`.
fn file_of_page(page: &str, name: &str) -> String {
    let (_, after) = page.split_once(&format!("<!-- file: {name} -->\n```yaml\n")).expect("the page has the file");
    after.split_once("```").expect("the block ends").0.to_owned()
}

/// The experiments of `how-to/foundation-models.md` with generated networks of the same signatures
/// (`tests/fixtures/networks.py`): nearness that grows with the row, as on a road.
#[test]
fn the_page_of_foundation_models_runs_with_networks_of_their_signatures() {
    let folder = tempfile::tempdir().expect("a folder");
    let page = std::fs::read_to_string(workspace().join("docs/how-to/foundation-models.md")).expect("the page");
    for name in ["depth-anything.yaml", "midas.yaml"] {
        std::fs::write(folder.path().join(name), file_of_page(&page, name)).expect("written");
    }
    let run = |name: &str, network: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let mut command = depthloom();
        command.env("MONO_MODEL", workspace().join("tests/fixtures/networks").join(network)).args(["run", "--no-page"]);
        command.arg("--out").arg(&out).arg(folder.path().join(format!("{name}.yaml")));
        // Small frames: the networks see them enlarged.
        command.args(["--set", "sources.street.with={ frames: 0..2, seed: 2, width: 320, height: 96 }"]).args(more);
        (command, out)
    };
    for (name, network) in [("depth-anything", "depth_anything.onnx"), ("midas", "midas.onnx")] {
        let (mut command, out) = run(name, network, &[]);
        let output = command.output().expect("started");
        let stderr = String::from_utf8_lossy(&output.stderr);
        if stderr.contains("no ONNX Runtime") {
            return skipped("the_page_of_foundation_models_runs_with_networks_of_their_signatures", &stderr);
        }
        assert!(output.status.success(), "{stderr}");
        let rows = read_csv(&out.join("scores.csv"));
        for method in ["least-squares", "robust", "local", "median"] {
            let abs_rel = |estimate: &str| {
                let wanted = format!("{method}/{estimate}");
                let values: Vec<f64> = rows
                    .iter()
                    .filter(|row| label(row) == wanted && set(row) == "all")
                    .map(|row| number(row, "abs_rel"))
                    .collect();
                assert!(!values.is_empty(), "no row {wanted}");
                values.iter().sum::<f64>() / values.len() as f64
            };
            println!("{name} {method}: abs_rel of mono {}, fused {}", abs_rel("mono"), abs_rel("fused"));
            assert!(abs_rel("mono") < 1.0 && abs_rel("fused") < 0.6, "{name} {method}");
        }
    }
    // The network's numbers are not metres: neither scored nor fused.
    for (change, what) in [
        ("compare.score.estimates.mono=mono/inverse", "relative-inverse-depth"),
        ("compare.merged.inputs.mono=mono/inverse", "relative-inverse-depth"),
        ("compare.aligned.with.mono=depth", "relative-inverse-depth"),
    ] {
        let (mut command, _) = run("depth-anything", "depth_anything.onnx", &["--set", change]);
        let output = command.output().expect("started");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{change}: {stderr}");
        assert!(stderr.contains(what), "{change}: {stderr}");
    }
}
