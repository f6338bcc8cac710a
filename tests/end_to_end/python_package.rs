//! The package `python/`: its types, its own tests, equality with depthloom's reader, its notebook, and the example in
//! the README.

use depthloom_graphs::plan::{FrameIndex, RunId};
use std::path::Path;
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_graphs::values::Pixels;
use depthloom_recording::Recording;

use crate::support::{depthloom, python_package, succeed, workspace};

/// A Python module or script that finds the binary under test.
fn command(python: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(python);
    command.current_dir(workspace()).args(arguments).env("DEPTHLOOM", env!("CARGO_BIN_EXE_depthloom"));
    command.env_remove("DEPTHLOOM_FRESH").env("PYTHONDONTWRITEBYTECODE", "1");
    command
}

#[test]
fn the_package_passes_type_checking() {
    let Some(python) = python_package("the_package_passes_type_checking") else { return };
    let cache = tempfile::tempdir().expect("a folder");
    let check = ["-m", "mypy", "--config-file", "python/pyproject.toml", "python/src", "python/tests"];
    succeed(command(&python, &check).arg("--cache-dir").arg(cache.path()));
}

#[test]
fn the_package_reads_the_format_that_is_written() {
    let format = |file: &str, before: &str| {
        let text = std::fs::read_to_string(workspace().join(file)).expect("a source file");
        let (_, rest) = text.split_once(before).unwrap_or_else(|| panic!("{file} has no `{before}`"));
        rest.split('"').next().expect("a format").to_owned()
    };
    let written = format("recording/src/lib.rs", "const FORMAT: &str = \"");
    assert_eq!(format("python/src/depthloom/_recording.py", "\nFORMAT = \""), written);
}

#[test]
fn the_package_passes_its_tests() {
    let Some(python) = python_package("the_package_passes_its_tests") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let tests = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "python/tests"];
    succeed(command(&python, &tests).arg("--basetemp").arg(folder.path().join("runs")));
}

/// The bytes, type name and shape of a value as an array.
fn bytes_of(value: &Value) -> (Vec<u8>, &'static str, Vec<u32>) {
    let floats = |floats: &[f32], (width, height): (u32, u32)| {
        (floats.iter().flat_map(|float| float.to_le_bytes()).collect(), "float32", vec![height, width])
    };
    match value {
        Value::Depth(depth) => floats(&depth.metres, depth.metres.dimensions()),
        Value::Weight(weight) => floats(&weight.share, weight.share.dimensions()),
        Value::TrueDisparity(disparity) => floats(&disparity.px, disparity.px.dimensions()),
        Value::Disparity(disparity) => {
            let minimum = disparity.min_disparity_px * 16;
            let px = disparity.sixteenths_px.iter().map(|&sixteenths| match i32::from(sixteenths) {
                found if found >= minimum => f32::from(sixteenths) / 16.0,
                _ => f32::NAN,
            });
            floats(&px.collect::<Vec<f32>>(), disparity.sixteenths_px.dimensions())
        }
        Value::Mask(mask) => {
            let (width, height) = mask.set.dimensions();
            (mask.set.iter().map(|set| u8::from(*set != 0)).collect(), "bool", vec![height, width])
        }
        Value::Image(image) => match image.pixels() {
            Pixels::Grey(grey) => (grey.as_raw().clone(), "uint8", vec![grey.height(), grey.width()]),
            Pixels::Rgb(rgb) => (rgb.as_raw().clone(), "uint8", vec![rgb.height(), rgb.width(), 3]),
        },
        other => panic!("{} is not a map", other.value_type()),
    }
}

/// Whether two arrays have the same bits; NaNs are equal.
fn equal(ours: &[u8], theirs: &[u8], type_name: &str) -> bool {
    let is_nan = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes).is_nan();
    match type_name {
        "float32" => {
            let (ours, theirs) = (ours.as_chunks().0, theirs.as_chunks().0);
            let mut pairs = ours.iter().zip(theirs);
            ours.len() == theirs.len() && pairs.all(|(a, b)| a == b || is_nan(a) && is_nan(b))
        }
        _ => ours == theirs,
    }
}

/// Asserts that the package and depthloom's reader yield the same maps. Returns the number of maps.
fn assert_same_maps(python: &Path, run: &Path) -> usize {
    let folder = tempfile::tempdir().expect("a folder");
    succeed(command(python, &["tests/python/dump_maps.py"]).arg(run).arg(folder.path()));
    let listed = std::fs::read_to_string(folder.path().join("maps.json")).expect("the list of maps");
    let listed: Vec<(String, usize, String, String, Vec<u32>)> = serde_json::from_str(&listed).expect("JSON");
    let recording = Recording::open(run.join("recording.mcap")).expect("a recording");
    let plan = recording.plan();
    for (number, (stage, position, topic, type_name, shape)) in listed.iter().enumerate() {
        let run = plan.runs.iter().position(|run| run.name() == stage).expect("a stage");
        let mut reader = recording.reader(RunId(run), &[topic]).expect("a topic");
        let values = reader.read(FrameIndex(*position)).expect("a frame");
        let [Some(value)] = &values[..] else { panic!("{topic} has no value on frame {position}") };
        let (ours, our_type, our_shape) = bytes_of(value);
        assert_eq!((our_type, &our_shape), (type_name.as_str(), shape), "{topic}");
        let theirs = std::fs::read(folder.path().join(number.to_string())).expect("an array");
        assert!(equal(&ours, &theirs, type_name), "{topic} of frame {position} differs");
    }
    listed.len()
}

#[test]
fn the_package_reads_every_map_bit_for_bit() {
    let Some(python) = python_package("the_package_reads_every_map_bit_for_bit") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (out, data) = (folder.path().join("run"), folder.path().join("data"));
    let set = [
        "sources.train.with.frames=0..2",
        "sources.train.with.width=320",
        "sources.train.with.height=96",
        "sources.test.with.frames=2..4",
        "sources.test.with.width=320",
        "sources.test.with.height=96",
        "sources.test.with.disparities=true",
        "learn.train.with.steps=2",
        // Disparities that begin below zero.
        "compare.stereo.with.min_disparity=-5",
    ];
    let set = set.iter().flat_map(|set| ["--set", set]);
    succeed(depthloom().args(["run", "--no-page", "experiments/table1.yaml", "--quiet", "--out"]).arg(&out).args(set));
    // `learn`: a pair, two depths of ground truth, a mask, stereo, edges. `compare`: a pair, two depths and two
    // disparities of ground truth, two masks, stereo, depth, confidence, mono; over all variants three scalings, four
    // fusions and four filters.
    assert_eq!(assert_same_maps(&python, &out), 2 * 7 + 2 * 23);
    // Images that are still encoded, and KITTI's ground truth.
    succeed(depthloom().args(["synth", "--frames", "2", "--width", "320", "--height", "96", "--quiet"]).arg(&data));
    let out = folder.path().join("pairs");
    let pairs = [
        "run",
        "--no-page",
        "experiments/own-pairs.yaml",
        "--quiet",
        "--set",
        "sources.pairs.with.ground_truth=noc",
        "--out",
    ];
    succeed(depthloom().args(pairs).arg(&out).env("OWN_PAIRS", &data));
    assert!(assert_same_maps(&python, &out) > 12);
}

#[test]
fn the_readmes_python_example_reads_a_run() {
    let Some(python) = python_package("the_readmes_python_example_reads_a_run") else { return };
    let readme = std::fs::read_to_string(workspace().join("README.md")).expect("the README");
    let (_, rest) = readme.split_once("```python\n").expect("a block of Python");
    let (lines, _) = rest.split_once("```").expect("its end");
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("runs/first-look/run");
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    succeed(
        depthloom().args(["run", "--no-page", "experiments/first-look.yaml", "--quiet", "--out"]).arg(&out).args(small),
    );
    let statement = "\nprint(depth.dtype, *depth.shape, numpy.isfinite(depth).sum(), float(numpy.nanmax(depth)))\n";
    let script = format!("import numpy\n{lines}{statement}");
    let output = succeed(command(&python, &["-c", &script]).current_dir(folder.path()));
    let printed = String::from_utf8(output.stdout).expect("text");

    let recording = Recording::open(out.join("recording.mcap")).expect("a recording");
    let mut reader = recording.reader(RunId(0), &["/look/depth/depth"]).expect("a topic");
    let position = recording.frames(RunId(0)).iter().position(|frame| &*frame.id == "000003_10").expect("a frame");
    let values = reader.read(FrameIndex(position)).expect("a frame");
    let [Some(Value::Depth(depth))] = &values[..] else { panic!("a depth") };
    let finite: Vec<f32> = depth.metres.iter().copied().filter(|metres| metres.is_finite()).collect();
    let max = finite.iter().copied().fold(0.0, f32::max);
    let expected = format!("float32 96 320 {} {:?}", finite.len(), f64::from(max));
    assert_eq!(printed.lines().last(), Some(expected.as_str()), "{printed}");
}

#[test]
fn the_notebooks_stored_output_is_reproduced() {
    let Some(python) = python_package("the_notebooks_stored_output_is_reproduced") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let docs = folder.path().join("docs");
    std::fs::create_dir(&docs).expect("made");
    std::fs::create_dir(folder.path().join("experiments")).expect("made");
    for file in ["docs/python.ipynb", "experiments/first-look.yaml"] {
        std::fs::copy(workspace().join(file), folder.path().join(file)).expect("copied");
    }
    succeed(command(&python, &["tests/python/run_notebook.py"]).arg(docs.join("python.ipynb")));
}

/// The chunks of a stream depend on timing: on a loaded machine the text of one `print` arrives in several.
#[test]
fn the_notebook_test_ignores_the_chunks_of_streams() {
    const TEST: &str = "the_notebook_test_ignores_the_chunks_of_streams";
    let Some(python) = python_package(TEST) else { return };
    let script = r#"
import sys
sys.path.insert(0, "tests/python")
from run_notebook import texts

def stream(text, name="stdout"):
    return {"output_type": "stream", "name": name, "text": text}

def notebook(*outputs):
    return {"cells": [{"cell_type": "markdown"}, {"cell_type": "code", "outputs": list(outputs)}]}

result = {"output_type": "execute_result", "data": {"text/plain": "3"}}
picture = {"output_type": "display_data", "data": {"image/png": "", "text/plain": "<Figure>"}}
one_chunk = notebook(stream("first 000000_10\n"), result)
two_chunks = notebook(stream("first"), stream("building the font cache", "stderr"), stream(" 000000_10\n"), picture, result)
assert texts(one_chunk) == texts(two_chunks) == [["first 000000_10\n", "3"]], texts(two_chunks)
assert texts(one_chunk) != texts(notebook(stream("first 000001_10\n"), result))
assert texts(notebook(stream("a"), result, stream("b"))) != texts(notebook(stream("ab"), result))
"#;
    succeed(&mut command(&python, &["-c", script]));
}
