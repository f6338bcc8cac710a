//! Faults in networks, engines and values that are not numbers.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value as Json;

use crate::support::{depthloom, label, onnx_runtime, read_csv, skipped, succeed};
use depthloom_test_needs::onnx_file::{self, F32, Tensor, U8};

/// An experiment on two frames of a street: the output of `model` for the left image, fused in two ways, all scored.
fn experiment(folder: &Path, model: &[u8], with: &str) -> PathBuf {
    std::fs::write(folder.join("net.onnx"), model).expect("written");
    let text = format!(
        "experiment: network
sources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..2, width: 192, height: 64 }} }} }}
stages:
  look:
    source: street
    nodes:
      stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }}, with: {{ disparities: 32 }} }}
      depth: {{ kind: depth/from-disparity, inputs: {{ disparity: stereo/disparity, calibration: source/calibration }} }}
      weight: {{ kind: confidence/sobel, inputs: {{ image: source/left }} }}
      mono:
        kind: mono/onnx
        inputs: {{ image: source/left, calibration: source/calibration, model: {{ file: net.onnx }} }}
        with: {with}
      scaled: {{ kind: fusion/scale, inputs: {{ mono: mono/depth, stereo: depth/depth }}, with: {{ method: minmax }} }}
      merged: {{ kind: fusion/confidence, inputs: {{ mono: scaled/depth, stereo: depth/depth, weight: weight/weight }} }}
      fused: {{ kind: filter/median, inputs: {{ depth: merged/depth }} }}
    score:
      ground_truth: source/depth
      estimates:
        stereo: {{ from: depth/depth, sets: [valid] }}
        merged: {{ from: merged/depth, sets: [valid] }}
        fused: {{ from: fused/depth, sets: [valid] }}
variants:
  minmax: {{}}
  average: {{ look.scaled.with.method: average }}
  mean: {{ look.merged.with: {{ weighting: mean }} }}
"
    );
    let path = folder.join("experiment.yaml");
    std::fs::write(&path, text).expect("written");
    path
}

/// A network whose disparity is the mean of the colours.
fn mean(width: i64, height: i64) -> Vec<u8> {
    let inputs = [Tensor("image", F32, &[1, 3, height, width])];
    onnx_file::model("ReduceMean", Some(1), &inputs, &Tensor("share", F32, &[1, 1, height, width]))
}

/// The binary with an empty environment, so that networks run in tract by default.
fn bare() -> Command {
    let mut command = depthloom();
    command.current_dir("/").env_clear().env("PATH", "").env("NO_COLOR", "1").env("DEPTHLOOM_FRESH", "1");
    command
}

fn stderr_of(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn doctor(command: &mut Command) -> Json {
    serde_json::from_slice(&succeed(command.args(["doctor", "--json"])).stdout).expect("JSON")
}

/// Compiles a library with `rustc`. Returns whether it succeeded; reports the test as skipped otherwise.
fn library(test: &str, at: &Path, source: &str) -> bool {
    std::fs::create_dir_all(at.parent().expect("a folder")).expect("a folder");
    let code = at.with_extension("rs");
    std::fs::write(&code, source).expect("written");
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let mut command = Command::new(rustc);
    command.args(["--edition=2024", "--crate-type=cdylib", "--crate-name=planted", "-o"]).arg(at).arg(&code);
    let compiled = command.output().is_ok_and(|output| output.status.success());
    std::fs::remove_file(code).expect("removed");
    if !compiled {
        skipped(test, "no rustc to compile a library with");
    }
    compiled
}

/// Writes a file at `DEPTHLOOM_TRAP` when it is loaded.
const TRAP: &str = r#"
#[used]
#[unsafe(link_section = ".init_array")]
static WHEN_LOADED: extern "C" fn() = when_loaded;
extern "C" fn when_loaded() {
    if let Some(path) = std::env::var_os("DEPTHLOOM_TRAP") { let _ = std::fs::write(path, "loaded"); }
}
"#;

/// An ONNX Runtime of an unsupported version.
const OLD: &str = r#"
use std::ffi::{c_char, c_void};
#[repr(C)] pub struct Base { api: extern "C" fn(u32) -> *const c_void, version: extern "C" fn() -> *const c_char }
extern "C" fn api(_: u32) -> *const c_void { std::ptr::null() }
extern "C" fn version() -> *const c_char { c"1.16.3".as_ptr() }
static BASE: Base = Base { api, version };
#[unsafe(no_mangle)] pub extern "C" fn OrtGetApiBase() -> *const Base { &BASE }
"#;

/// The folder of the wheel's library in a Python environment.
const IN_PYTHON: &str = "lib/python3.12/site-packages/onnxruntime/capi";

#[test]
#[cfg(target_os = "linux")]
fn fault_09_files_near_an_experiment_are_neither_loaded_nor_run() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().canonicalize().expect("an absolute path");
    let inner = root.join("project/deeper");
    let trap_library = root.join("trap.so");
    if !library("fault_09_files_near_an_experiment_are_neither_loaded_nor_run", &trap_library, TRAP) {
        return;
    }
    for place in [".venv", "project/venv", "project/deeper/.venv", "project/deeper/target/venv-onnx"] {
        let capi = root.join(place).join(IN_PYTHON);
        std::fs::create_dir_all(&capi).expect("a folder");
        std::fs::copy(&trap_library, capi.join("libonnxruntime.so")).expect("copied");
    }
    let bin = root.join("bin");
    std::fs::create_dir_all(&bin).expect("a folder");
    let trap = root.join("trap");
    for program in ["python3", "python"] {
        std::fs::write(bin.join(program), format!("#!/bin/sh\necho run > '{}'\n", trap.display())).expect("written");
        std::fs::set_permissions(bin.join(program), PermissionsExt::from_mode(0o755)).expect("executable");
    }
    let path = experiment(&inner, &mean(192, 64), "{}");
    let near = |arguments: &[&str]| {
        let mut command = bare();
        command.current_dir(&inner).env("PATH", &bin).env("DEPTHLOOM_TRAP", &trap).args(arguments);
        // Relative paths refer to the working folder as well.
        command.env("LD_LIBRARY_PATH", format!(":.:{IN_PYTHON}")).env("VIRTUAL_ENV", ".venv").env("CONDA_PREFIX", "");
        command
    };
    let path = path.to_str().expect("UTF-8");
    for arguments in [&["check", path][..], &["plan", path], &["graph", path], &["doctor"]] {
        succeed(&mut near(arguments));
        assert!(!trap.exists(), "{arguments:?} loaded or ran a file near the experiment");
    }
    if cfg!(feature = "tract") {
        succeed(near(&["run", "--no-page", "--quiet", "--out"]).arg(inner.join("out")).arg(path));
        assert!(!trap.exists(), "a run loaded or ran a file near the experiment");
    }
    // The trap works: it is loaded if the environment is active, or if LD_LIBRARY_PATH names its folder.
    let active = inner.join(".venv");
    for (variable, value) in [("VIRTUAL_ENV", active.clone()), ("LD_LIBRARY_PATH", active.join(IN_PYTHON))] {
        let doctor = doctor(bare().env("DEPTHLOOM_TRAP", &trap).env(variable, value));
        assert!(trap.exists(), "{variable}: {doctor}");
        std::fs::remove_file(&trap).expect("removed");
        // `check` never opens a library.
        succeed(bare().env("DEPTHLOOM_TRAP", &trap).env(variable, &active).args(["check", path]));
        assert!(!trap.exists(), "check opened a library");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn fault_44_unusable_onnx_runtimes_are_reported_and_tract_is_used() {
    let test = "fault_44_unusable_onnx_runtimes_are_reported_and_tract_is_used";
    if !cfg!(feature = "tract") {
        return skipped(test, "built without tract");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let libraries = folder.path().join(IN_PYTHON);
    std::fs::create_dir_all(&libraries).expect("a folder");
    std::fs::write(libraries.join("libonnxruntime.so"), "<html>404</html>").expect("written");
    if !library(test, &libraries.join("libonnxruntime.so.1"), TRAP)
        || !library(test, &libraries.join("libonnxruntime.so.1.16.3"), OLD)
    {
        return;
    }
    let refused = ["does not load", "exports no OrtGetApiBase: it is not an ONNX Runtime", "is ONNX Runtime 1.16.3"];
    let found = doctor(bare().env("VIRTUAL_ENV", folder.path()));
    if found["networks"]["engine"] == "onnxruntime" {
        return skipped(test, "ONNX Runtime is part of this system");
    }
    assert_eq!(found["networks"]["engine"], "tract", "{found}");
    for why in refused {
        assert!(found["networks"]["refused"].to_string().contains(why), "{why}: {found}");
    }
    let path = experiment(folder.path(), &mean(192, 64), "{}");
    succeed(bare().env("VIRTUAL_ENV", folder.path()).arg("check").arg(&path));
    let out = folder.path().join("run");
    let ran =
        succeed(bare().env("VIRTUAL_ENV", folder.path()).args(["run", "--no-page", "--out"]).arg(&out).arg(&path));
    for why in refused {
        assert!(stderr_of(&ran).contains(why), "{}", stderr_of(&ran));
    }
    assert!(!stderr_of(&ran).contains("panicked"), "{}", stderr_of(&ran));
    // An explicitly named library has no replacement: the error comes before any frame, and without a panic.
    for (name, why) in ["libonnxruntime.so", "libonnxruntime.so.1", "libonnxruntime.so.1.16.3"].iter().zip(refused) {
        let output = bare()
            .env("ORT_DYLIB_PATH", libraries.join(name))
            .args(["run", "--no-page"])
            .arg(&path)
            .output()
            .expect("started");
        assert_eq!(output.status.code(), Some(2), "{}", stderr_of(&output));
        assert!(
            stderr_of(&output).contains(why) && stderr_of(&output).contains("ORT_DYLIB_PATH"),
            "{}",
            stderr_of(&output)
        );
    }
}

/// The available engines: environment variables for each.
fn engines(test: &str) -> Vec<Vec<(&'static str, std::ffi::OsString)>> {
    let mut engines = Vec::new();
    if cfg!(feature = "tract") {
        engines.push(vec![("DEPTHLOOM_ONNX_ENGINE", "tract".into())]);
    }
    if let Some(library) = onnx_runtime(test) {
        engines.push(vec![("ORT_DYLIB_PATH", library.into_os_string())]);
    }
    engines
}

/// A model with the values of a weight in another file: `initializer`, field 5 of the graph.
fn with_external_data() -> Vec<u8> {
    let field =
        |number: u8, bytes: &[u8]| [&[number << 3 | 2, u8::try_from(bytes.len()).expect("short")], bytes].concat();
    let entry = [field(1, b"location"), field(2, b"net.onnx.data")].concat();
    // Dims 1 and 4, f32, a name, the location of its values.
    let weight = [&[0x08, 4, 0x10, 1][..], &field(8, b"w"), &field(13, &entry), &[0x70, 1]].concat();
    let mut model = mean(192, 64);
    // A second graph field is merged with the first.
    model.extend(field(7, &field(5, &weight)));
    model
}

#[test]
fn fault_36_and_51_both_engines_refuse_unusable_models_before_any_frame() {
    let rgb = Tensor("x", F32, &[1, 3, 64, 192]);
    let one = |input: Tensor<'_>, output: Tensor<'_>| onnx_file::model("Identity", None, &[input], &output);
    let broken: Vec<(&str, Vec<u8>, &str)> = vec![
        ("no ONNX at all", b"<html>404</html>".to_vec(), "it is not an ONNX file"),
        ("an empty file", Vec::new(), "it holds no graph"),
        ("rank", one(Tensor("x", F32, &[64, 192]), Tensor("y", F32, &[64, 192])), "has the shape 64x192"),
        ("type", one(Tensor("x", U8, &[1, 3, 64, 192]), Tensor("y", U8, &[1, 3, 64, 192])), "it has y (u8 1x3x64x192)"),
        ("output", one(rgb, Tensor("y", F32, &[1, 3, 64, 192])), "which is 3 maps for one image"),
        (
            "open output",
            one(Tensor("x", F32, &[1, 3, 64, 192]), Tensor("y", F32, &[-1, -1, -1, -1])),
            "which is 3 maps for one image",
        ),
        ("external data", with_external_data(), "keeps weights in another file (`net.onnx.data`)"),
        ("an image of 16384 x 16384", mean(16384, 16384), "and 8 GiB is the most"),
        ("an image of a million by a million", mean(1_000_000, 1_000_000), "and 8 GiB is the most"),
    ];
    for engine in engines("fault_36_and_51_both_engines_refuse_unusable_models_before_any_frame") {
        for (what, model, why) in &broken {
            let folder = tempfile::tempdir().expect("a folder");
            let path = experiment(folder.path(), model, "{}");
            let mut command = bare();
            command.envs(engine.iter().map(|(name, value)| (name, value.as_os_str())));
            let out = folder.path().join("run");
            let output = command.args(["run", "--no-page", "--out"]).arg(&out).arg(&path).output().expect("started");
            let stderr = stderr_of(&output);
            assert_eq!(output.status.code(), Some(2), "{what} with {engine:?}: {stderr}");
            assert!(stderr.contains(why) && stderr.contains("help"), "{what} with {engine:?}: {stderr}");
            assert!(!out.exists() && !out.with_extension("partial").exists(), "{what}: a run was begun");
            let files: Vec<_> =
                std::fs::read_dir(folder.path()).expect("a folder").flatten().map(|e| e.file_name()).collect();
            assert!(
                files.iter().all(|name| [OsStr::new("net.onnx"), OsStr::new("experiment.yaml")].contains(&&**name)),
                "{files:?}"
            );
        }
    }
}

#[test]
fn fault_42_nan_pixels_of_a_network_are_counted_and_do_not_remove_stereo_pixels() {
    // The square root of grey minus a half: darker pixels are NaN.
    let (input, output) = (Tensor("image", F32, &[1, 1, 64, 192]), Tensor("share", F32, &[1, 1, 64, 192]));
    let model = onnx_file::model("Sqrt", None, &[input], &output);
    for engine in engines("fault_42_nan_pixels_of_a_network_are_counted_and_do_not_remove_stereo_pixels") {
        let folder = tempfile::tempdir().expect("a folder");
        let path = experiment(folder.path(), &model, "{ mean: [0.5, 0.5, 0.5] }");
        let run = |out: &Path, arguments: &[&str]| {
            let mut command = bare();
            command.envs(engine.iter().map(|(name, value)| (name, value.as_os_str())));
            succeed(command.args(["run", "--no-page"]).args(arguments).arg("--out").arg(out).arg(&path))
        };
        let out = folder.path().join("run");
        let ran = run(&out, &["--workers", "1"]);
        let warning = stderr_of(&ran).lines().find(|line| line.starts_with("warning: ")).map(str::to_owned);
        let warning = warning.unwrap_or_else(|| panic!("no warning: {}", stderr_of(&ran)));
        assert!(warning.starts_with("warning: look.mono: "), "{warning}");
        assert!(
            warning.ends_with(" pixels of the network's output are NaN or infinite, and so invalid, on 2 frames"),
            "{warning}"
        );
        // The same, in JSON, with eight workers.
        let again = folder.path().join("again");
        let json: Json = serde_json::from_slice(&run(&again, &["--workers", "8", "--json"]).stdout).expect("JSON");
        assert_eq!(json["warnings"], serde_json::json!([warning.trim_start_matches("warning: ")]));
        // A run that reuses these pixels prints the same warning.
        let reusing = folder.path().join("reusing");
        let mut command = bare();
        command.envs(engine.iter().map(|(name, value)| (name, value.as_os_str()))).env_remove("DEPTHLOOM_FRESH");
        let output = succeed(command.args(["run", "--no-page", "--json", "--out"]).arg(&reusing).arg(&path));
        let run: Json = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_eq!((&run["warnings"], run["reused"]["nodes"].is_array()), (&json["warnings"], true));
        assert!(run["reused"]["nodes"].as_array().expect("nodes").iter().any(|node| node["node"] == "mono"), "{run}");
        let bytes = |run: &Path| std::fs::read(run.join("recording.mcap")).expect("a recording");
        assert!(bytes(&reusing) == bytes(&out));

        let rows = read_csv(&out.join("scores.csv"));
        let valid = |frame: &str, estimate: &str| {
            let mut rows = rows.iter().filter(|row| row["frame"] == frame && label(row) == estimate);
            rows.next().unwrap_or_else(|| panic!("no row of {estimate}"))["pixels"].parse::<u64>().expect("a count")
        };
        let frames: std::collections::BTreeSet<&str> = rows.iter().map(|row| row["frame"].as_str()).collect();
        assert_eq!(frames.len(), 2);
        for frame in frames {
            let stereo = valid(frame, "stereo");
            assert!(stereo > 100, "{stereo}");
            for variant in ["minmax", "average", "mean"] {
                for estimate in ["merged", "fused"] {
                    let pixels = valid(frame, &format!("{variant}/{estimate}"));
                    assert!(pixels >= stereo, "{variant}/{estimate} on {frame}: {pixels} of stereo's {stereo}");
                }
            }
        }
    }
}

#[test]
fn a_panic_in_tract_becomes_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let image = Tensor("image", F32, &[1, 3, 64, 192]);
    let model = onnx_file::model("ReduceMean", Some(9), &[image], &Tensor("share", F32, &[1, 1, 64, 192]));
    let experiment = experiment(folder.path(), &model, "{ output: disparity-share }");
    let output = bare()
        .args(["run", "--no-page"])
        .arg(&experiment)
        .arg("--out")
        .arg(folder.path().join("run"))
        .output()
        .expect("run");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("rank and axis: 4 and 9") && !stderr.contains("panicked"), "{stderr}");
}
