//! Python nodes with the package `depthloom`: the paper's fusion, nodes with memory, sources, sinks, errors.

use std::path::Path;
use std::process::Command;

use super::{output_of, run};
use crate::support::{depthloom, label, number, python_package, read_csv, set, succeed, workspace};

/// A PATH whose `python3` has the package.
pub(crate) fn path_of(python: &Path) -> std::ffi::OsString {
    let own = python.parent().expect("a folder").to_owned();
    let others = std::env::var_os("PATH").unwrap_or_default();
    std::env::join_paths(std::iter::once(own).chain(std::env::split_paths(&others))).expect("a PATH")
}

#[test]
fn the_papers_fusion_in_python_matches_the_built_in_nodes() {
    const TEST: &str = "the_papers_fusion_in_python_matches_the_built_in_nodes";
    let Some(python) = python_package(TEST) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = workspace().join("experiments/own-python-node.yaml");
    let out = |name: &str| folder.path().join(name);
    let start = |name: &str, workers: &str| {
        let mut command = run(&experiment, &out(name), "python");
        succeed(command.args(["--workers", workers]).env("PATH", path_of(&python)));
    };
    start("one", "1");
    let rows = read_csv(&out("one").join("scores.csv"));
    let rows_of = |name: &str| rows.iter().filter(|row| label(row) == name && set(row) == "all").collect::<Vec<_>>();
    let (built_in, own) = (rows_of("fused"), rows_of("own"));
    assert_eq!((built_in.len(), own.len()), (4, 4), "four frames each");
    for (built_in, own) in built_in.iter().zip(own) {
        for column in ["a1", "a2", "a3", "abs_rel", "sq_rel", "rmse", "rmse_log", "silog"] {
            let (built_in, own) = (number(built_in, column), number(own, column));
            assert!((built_in - own).abs() <= 1e-6 * built_in.abs().max(1.0), "{column}: {built_in} and {own}");
        }
    }
    start("four", "4");
    let bytes = |name: &str| std::fs::read(out(name).join("recording.mcap")).expect("a recording");
    assert!(bytes("one") == bytes("four"), "the recordings of one worker and of four differ");

    // Its results are reused as long as its code is the same.
    let mut plan = depthloom();
    plan.arg("plan").arg(&experiment).args(["--reuse", "--allow-exec", "--json", "--out"]).arg(out("next"));
    // Keys contain the imported modules, so the Python must be the same.
    let plan = plan.env_remove("DEPTHLOOM_FRESH").env("PATH", path_of(&python));
    let plan: serde_json::Value = serde_json::from_slice(&succeed(plan).stdout).expect("JSON");
    let own =
        plan["nodes"].as_array().expect("a list").iter().find(|node| node["node"] == "own_fused").expect("a node");
    assert_eq!((&own["runs"], &own["taken"]), (&0.into(), &4.into()), "{own}");
}

const NODES: &str = r#"
import numpy as np
import depthloom

@depthloom.source(outputs={"left": "image", "depth": "depth", "disparity": "disparity", "mask": "mask", "calibration": "calibration"})
class Ramp:
    def __init__(self, params):
        self.count = params["count"]
    def frames(self):
        return [(f"ramp{k}", 1000 * k) for k in range(self.count)]
    def read(self, frame):
        rows, columns = np.mgrid[0:24, 0:32]
        depth = (5 + rows + frame.index).astype(np.float32)
        depth[0] = np.nan
        disparity = (columns / 16).astype(np.float32)
        disparity[1] = np.nan
        camera = depthloom.Calibration(32, 24, 30.0, 16.0, 12.0, 0.5, 0.0)
        image = np.stack([rows, columns, rows * 0 + frame.index], axis=2).astype(np.uint8)
        return {"left": image, "depth": depth, "disparity": disparity, "mask": columns > 3, "calibration": camera}

@depthloom.node(inputs={"left": "image", "depth": "depth", "disparity": "disparity", "mask": "mask", "calibration": "calibration"},
                outputs={"depth": "depth", "curve": "curve"})
class Mean:
    def __init__(self, params):
        self.sum, self.count, self.losses = 0, 0, []
        print("this goes to standard error")
    def process(self, left, depth, disparity, mask, calibration, frame):
        assert left.shape == (24, 32, 3) and left.dtype == np.uint8 and left[2, 5].tolist() == [2, 5, frame.index]
        assert np.isnan(depth[0]).all() and depth[3, 0] == 8 + frame.index, depth
        assert np.isnan(disparity[1]).all() and disparity[2, 9] == 9 / 16 and disparity[2, 0] == 0, disparity
        assert mask.dtype == bool and not mask[0, 3] and mask[0, 4]
        assert calibration.focal_px * calibration.baseline_m == 15
        assert frame.id == f"ramp{frame.index}" and frame.time_ns == 1000 * frame.index
        depthloom.progress(1, 2, "half")
        depthloom.warn("pixels of the top row", 32)
        self.sum, self.count = self.sum + depth, self.count + 1
        self.losses.append(float(np.nanmean(depth)))
        return {"depth": self.sum / self.count}
    def finish(self):
        steps = range(1, 1 + self.count)
        nothing = [float("nan")] * self.count
        return {"curve": {"step": steps, "loss": self.losses, "validation": nothing, "learning_rate": [0.1] * self.count}}

@depthloom.node(inputs={"depth": "depth"}, outputs={})
class Log:
    def __init__(self, params):
        self.file = open(params["to"], "w")
    def process(self, depth, frame):
        self.file.write(f"{frame.id} {np.nanmin(depth):.1f}\n")
    def finish(self):
        self.file.write("end\n")
        self.file.close()

@depthloom.node(inputs={"depth": "depth"}, outputs={"depth": "depth"})
def broken(depth):
    if depth[1, 0] > 6:
        raise ValueError("too deep")
    return depth

depthloom.serve(Ramp, Mean, Log, broken)
"#;

const EXPERIMENT: &str = "
experiment: own
sources:
  ramp:
    kind: process/source
    with:
      command: [python3, nodes.py, Ramp]
      outputs: { left: image, depth: depth, disparity: disparity, mask: mask, calibration: calibration }
      params: { count: 3 }
      version: 1
stages:
  look:
    source: ramp
    nodes:
      mean:
        kind: process
        inputs: { left: source/left, depth: source/depth, disparity: source/disparity, mask: source/mask, calibration: source/calibration }
        with:
          command: [python3, nodes.py, Mean]
          contract: ordered
          ports:
            inputs: { left: image, depth: depth, disparity: disparity, mask: mask, calibration: calibration }
            outputs: { depth: depth, curve: { type: curve, rate: once } }
          version: 1
      log:
        kind: process
        inputs: { depth: mean/depth }
        with: { command: [python3, nodes.py, Log], contract: ordered, ports: { inputs: { depth: depth } }, params: { to: LOG } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
    score: { ground_truth: source/depth, estimates: { mean: { from: mean/depth, sets: [valid] } } }
";

#[test]
fn python_sources_ordered_nodes_and_sinks_work_in_a_graph() {
    let Some(python) = python_package("python_sources_ordered_nodes_and_sinks_work_in_a_graph") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (experiment, log) = (folder.path().join("own.yaml"), folder.path().join("log.txt"));
    std::fs::write(folder.path().join("nodes.py"), NODES).expect("written");
    std::fs::write(&experiment, EXPERIMENT.replace("LOG", &log.to_string_lossy())).expect("written");
    let out = folder.path().join("run");
    let output = succeed(run(&experiment, &out, "own").args(["--workers", "3"]).env("PATH", path_of(&python)));
    let printed = output_of(&output);
    assert!(printed.contains("96 pixels of the top row"), "{printed}");
    assert_eq!(std::fs::read_to_string(log).expect("a log"), "ramp0 6.0\nramp1 6.5\nramp2 7.0\nend\n");
    let rows = read_csv(&out.join("scores.csv"));
    // The node outputs the mean over the frames so far of 5 + row + frame: 0.5 m too small on the second frame, 1 m on
    // the third.
    let rmse: Vec<f64> = rows.iter().map(|row| number(row, "rmse")).collect();
    assert!(rmse.iter().zip([0.0, 0.5, 1.0]).all(|(found, expected)| (found - expected).abs() < 1e-6), "{rmse:?}");
    assert!(out.join("learning_curves.csv").is_file(), "the curve is missing");
}

#[test]
fn an_exception_is_reported_with_its_line_and_the_next_frame_runs() {
    const TEST: &str = "an_exception_is_reported_with_its_line_and_the_next_frame_runs";
    let Some(python) = python_package(TEST) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("broken.yaml");
    std::fs::write(folder.path().join("nodes.py"), NODES).expect("written");
    let run_function = |function: &str, inputs: &str| {
        let text = format!(
            "experiment: broken\nsources: {{ ramp: {{ kind: process/source, with: {{ command: [python3, nodes.py, Ramp], \
             outputs: {{ left: image, depth: depth, disparity: disparity, mask: mask, calibration: calibration }}, params: {{ count: 3 }} }} }} }}\n\
             stages:\n  look:\n    source: ramp\n    nodes:\n      own: {{ kind: process, inputs: {{ {inputs} }}, with: {{ \
             command: [python3, nodes.py, {function}], ports: {{ inputs: {{ depth: depth }}, outputs: {{ depth: depth }} }} }} }}\n\
             \x20   score: {{ ground_truth: source/depth, estimates: {{ own: {{ from: own/depth, sets: [valid] }} }} }}\n"
        );
        std::fs::write(&experiment, text).expect("written");
        let out = folder.path().join(function);
        let mut command: Command = run(&experiment, &out, "broken");
        let output =
            command.args(["--workers", "1", "--keep-going"]).env("PATH", path_of(&python)).output().expect("started");
        (output.status.code(), output_of(&output), out)
    };
    let (code, printed, out) = run_function("broken", "depth: source/depth");
    assert_eq!(code, Some(3), "{printed}");
    for part in ["ValueError: too deep", "nodes.py", "in broken", "ramp1", "2 frames failed"] {
        assert!(printed.contains(part), "{part:?} is missing: {printed}");
    }
    assert_eq!(read_csv(&out.join("scores.csv")).len(), 1, "the first frame is scored");
    // Ports that differ from those of the code, and an unknown name.
    let (_, printed, _) = run_function("Mean", "depth: source/depth");
    let message = "the inputs of the node in Python are left: image, depth: depth, disparity: disparity, mask: mask, calibration: calibration; the experiment declares depth: depth";
    assert!(printed.contains(message), "{printed}");
    let (_, printed, _) = run_function("absent", "depth: source/depth");
    assert!(
        printed.contains("the first argument must be one of the nodes Ramp, Mean, Log, broken; it is 'absent'"),
        "{printed}"
    );
}

const LARGE: &str = r#"
import os
import numpy as np
import depthloom
from depthloom import _serve, _shared

pipes = os.environ["DEPTHLOOM_TEST_LANE"] == "pipes"
if pipes:
    _shared.shared_word = lambda path: None

@depthloom.source(outputs={"image": "image", "depth": "depth"})
class Frames:
    def frames(self):
        return [f"frame{k}" for k in range(14)]
    def read(self, frame):
        # Sizes change, and one is small.
        rows, columns = np.mgrid[0 : 30 if frame.index == 9 else 300 + 100 * (frame.index % 3), 0:400]
        image = np.stack([rows, columns, rows * 0 + frame.index], axis=2).astype(np.uint8)
        return {"image": image, "depth": (1 + rows + frame.index).astype(np.float32)}

@depthloom.node(inputs={"image": "image", "depth": "depth"}, outputs={"depth": "depth"})
class Keeps:
    """Keeps its inputs: the last two, then all, then none."""
    def __init__(self):
        self.kept, self.files = [], set()
    def process(self, image, depth, frame):
        if frame.index == 6:
            depthloom.progress(1, 2)
        for array, copy in self.kept:
            assert np.array_equal(array, copy), "a kept array has changed"
        assert not image.flags.writeable and not depth.flags.writeable
        assert image[5, 7].tolist() == [5, 7, frame.index] and (depth[:, 0] == np.arange(len(depth)) + 1 + frame.index).all()
        self.kept.append((depth[::2], depth[::2].copy()))
        self.kept.append((image, image.copy()))
        if frame.index < 4:
            self.kept = self.kept[-4:]
        elif frame.index == 11:
            self.kept = []
        shared = _serve._current.shared
        if shared is not None:
            self.files |= set(shared.files)
            assert len(shared.held()) <= 4
        if frame.index == 2:
            return depth
        return np.where(image[..., 0] > 100, depth, np.nan)
    def finish(self):
        assert pipes == (not self.files), self.files
        return {}

depthloom.serve(Frames, Keeps)
"#;

const LARGE_EXPERIMENT: &str = "
experiment: large
sources:
  frames: { kind: process/source, with: { command: [python3, nodes.py, Frames], outputs: { image: image, depth: depth }, version: 1 } }
stages:
  look:
    source: frames
    nodes:
      keeps:
        kind: process
        inputs: { image: source/image, depth: source/depth }
        with: { command: [python3, nodes.py, Keeps], contract: ordered, ports: { inputs: { image: image, depth: depth }, outputs: { depth: depth } }, version: 1 }
    score: { ground_truth: source/depth, estimates: { keeps: { from: keeps/depth, sets: [valid] } } }
";

#[test]
fn kept_inputs_do_not_change_and_shared_memory_equals_pipes() {
    const TEST: &str = "kept_inputs_do_not_change_and_shared_memory_equals_pipes";
    let Some(python) = python_package(TEST) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("large.yaml");
    std::fs::write(folder.path().join("nodes.py"), LARGE).expect("written");
    std::fs::write(&experiment, LARGE_EXPERIMENT).expect("written");
    let bytes = |lane: &str, workers: &str| {
        let out = folder.path().join(format!("{lane}-{workers}"));
        let mut command = run(&experiment, &out, "large");
        let command = command.args(["--workers", workers]).env("PATH", path_of(&python));
        succeed(command.env("DEPTHLOOM_TEST_LANE", lane));
        std::fs::read(out.join("recording.mcap")).expect("a recording")
    };
    let first = bytes("memory", "1");
    assert!(first == bytes("memory", "3"), "recordings with one and three workers differ");
    assert!(first == bytes("pipes", "1"), "recordings with shared memory and pipes differ");
}

const ONCE: &str = r#"
import depthloom

@depthloom.node(inputs={"depth": "depth"}, outputs={"curve": "curve"})
class Collect:
    def __init__(self):
        self.losses = []
    def process(self, depth):
        self.losses.append(float(len(self.losses)))
    def finish(self):
        steps = range(1, len(self.losses) + 1)
        return {"step": steps, "loss": self.losses, "validation": self.losses, "learning_rate": self.losses}

@depthloom.node(inputs={"curve": "curve"}, outputs={"curve": "curve", "model": "model"})
def train(curve, params):
    depthloom.progress(1, 1, "learnt")
    return {"curve": {**curve, "loss": curve["loss"] * params["times"]}, "model": b"the bytes of a model"}

depthloom.serve(Collect, train)
"#;

#[test]
fn python_aggregate_nodes_run_once_and_their_values_are_recorded() {
    let Some(python) = python_package("python_aggregate_nodes_run_once_and_their_values_are_recorded") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let once = "curve: { type: curve, rate: once }";
    let text = format!(
        "experiment: once\nsources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..3, width: 64, height: 32 }} }} }}\n\
         stages:\n  learn:\n    source: street\n    nodes:\n      collect:\n        kind: process\n        inputs: {{ depth: source/depth }}\n\
         \x20       with: {{ command: [python3, nodes.py, Collect], contract: ordered, ports: {{ inputs: {{ depth: depth }}, outputs: {{ {once} }} }} }}\n\
         \x20     train:\n        kind: process\n        inputs: {{ curve: collect/curve }}\n        with:\n          command: [python3, nodes.py, train]\n\
         \x20         contract: once\n          params: {{ times: 4 }}\n\
         \x20         ports: {{ inputs: {{ {once} }}, outputs: {{ {once}, model: {{ type: model, rate: once }} }} }}\n"
    );
    std::fs::write(folder.path().join("nodes.py"), ONCE).expect("written");
    let (experiment, out) = (folder.path().join("once.yaml"), folder.path().join("run"));
    std::fs::write(&experiment, text).expect("written");
    succeed(run(&experiment, &out, "once").env("PATH", path_of(&python)));
    let model = std::fs::read(out.join("models/learn.train.onnx")).expect("a model");
    assert_eq!(model, b"the bytes of a model");
    let losses = read_csv(&out.join("learning_curves.csv"));
    let train_losses: Vec<f64> =
        losses.iter().filter(|row| row["node"] == "train").map(|row| number(row, "loss")).collect();
    assert_eq!(train_losses, [0.0, 4.0, 8.0]);
}

const INVALID: &str = r#"
import numpy as np
import pyarrow as pa
import depthloom
from depthloom import _columns

OUTPUTS = {"depth": "depth", "weight": "weight", "camera": "calibration", "disparity": "disparity", "px": "ground-truth-disparity"}

@depthloom.node(inputs={"depth": "depth"}, outputs=OUTPUTS)
def own(depth, params):
    def map(value, invalid):
        samples = np.full(depth.shape, value, np.float32)
        if invalid is not None:
            samples[3, 7] = invalid
        return samples
    if params.get("nulls"):
        # Stands for a library that writes missing samples as null, not as NaN.
        _columns._list = lambda array: pa.ListArray.from_arrays(pa.array([0, array.size], pa.int32()), pa.array([None, *array.reshape(-1)[1:]], array.dtype.name))
    camera = {"focal_px": 30.0, "cx_px": 16.0, "cy_px": 12.0, "baseline_m": 0.5, "doffs_px": 0.0} | params.get("camera", {})
    numbers = {name: float(params[name]) for name in ("depth", "weight", "disparity", "px") if name in params}
    return {
        "depth": map(5.0, numbers.get("depth")),
        "weight": map(0.5, numbers.get("weight")),
        "disparity": map(3.0, numbers.get("disparity")),
        "px": map(3.0, numbers.get("px")),
        "camera": depthloom.Calibration(64, 32, **{name: float(number) for name, number in camera.items()}),
    }

@depthloom.source(outputs={"left": "image", "camera": "calibration"})
class Frames:
    def frames(self):
        depthloom.warn("folders without an image", 3)
        return ["one"]
    def read(self, frame):
        return {"left": np.zeros((32, 64), np.uint8), "camera": depthloom.Calibration(128, 64, 30.0, 16.0, 12.0, 0.5, 0.0)}

depthloom.serve(own, Frames)
"#;

/// Runs the node `own` with these parameters. Returns the exit code and the output.
fn run_own(python: &Path, folder: &Path, name: &str, params: &str) -> (Option<i32>, String) {
    let outputs =
        "{ depth: depth, weight: weight, camera: calibration, disparity: disparity, px: ground-truth-disparity }";
    let text = format!(
        "experiment: own\nsources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..1, width: 64, height: 32 }} }} }}\n\
         stages:\n  look:\n    source: street\n    nodes:\n      own:\n        kind: process\n        inputs: {{ depth: source/depth }}\n\
         \x20       with: {{ command: [python3, nodes.py, own], ports: {{ inputs: {{ depth: depth }}, outputs: {outputs} }}, params: {{ {params} }} }}\n\
         \x20   score: {{ ground_truth: source/depth, estimates: {{ own: {{ from: own/depth, sets: [all] }} }} }}\n"
    );
    let experiment = folder.join(format!("{name}.yaml"));
    std::fs::write(&experiment, text).expect("written");
    let output =
        run(&experiment, &folder.join(name), "invalid").env("PATH", path_of(python)).output().expect("started");
    (output.status.code(), output_of(&output))
}

#[test]
fn invalid_values_fail_the_frame_with_node_port_and_pixel() {
    const TEST: &str = "invalid_values_fail_the_frame_with_node_port_and_pixel";
    let Some(python) = python_package(TEST) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("nodes.py"), INVALID).expect("written");
    let (code, printed) =
        run_own(&python, folder.path(), "right", "depth: \"nan\", px: \"nan\", disparity: \"nan\", weight: 1");
    assert_eq!(code, Some(0), "{printed}");
    let cases = [
        (
            "depth: -5",
            "invalid depth at port `depth`: -5.0 m at row 3, column 7: a depth must be finite and greater than 0",
        ),
        ("depth: 0", "invalid depth at port `depth`: 0.0 m at row 3, column 7"),
        ("depth: \"inf\"", "invalid depth at port `depth`: inf m at row 3, column 7"),
        ("weight: 7.5", "invalid weight at port `weight`: 7.5 at row 3, column 7: a weight must be in [0, 1]"),
        ("weight: -0.1", "invalid weight at port `weight`: -0.1 at row 3, column 7"),
        ("weight: \"nan\"", "invalid weight at port `weight`: NaN at row 3, column 7"),
        ("disparity: \"inf\"", "the value of output 'disparity' is inf px at row 3, column 7"),
        ("px: \"-inf\"", "invalid ground-truth-disparity at port `px`: -inf px at row 3, column 7"),
        (
            "camera: { focal_px: -90 }",
            "invalid calibration at port `camera`: its `focal_px` is -90.0; it must be finite and greater than 0",
        ),
        (
            "camera: { baseline_m: -0.5 }",
            "its `baseline_m` is -0.5; it must be finite, and greater than 0 or, for a single camera, 0",
        ),
        ("camera: { cx_px: \"nan\" }", "its `cx_px` is NaN"),
        ("nulls: true", "its value at `depth` is not a valid depth: an item of `data` is null"),
    ];
    for (at, (params, expected)) in cases.into_iter().enumerate() {
        let (code, printed) = run_own(&python, folder.path(), &format!("run-{at}"), params);
        assert_eq!(code, Some(3), "{params}: {printed}");
        for part in [expected, "look.own", "000000_10"] {
            assert!(printed.contains(part), "{params}: {part:?} is not in {printed}");
        }
    }
}

#[test]
fn a_calibration_for_another_size_fails_the_frame_and_warnings_are_counted() {
    const TEST: &str = "a_calibration_for_another_size_fails_the_frame_and_warnings_are_counted";
    let Some(python) = python_package(TEST) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("nodes.py"), INVALID).expect("written");
    let experiment = folder.path().join("own.yaml");
    let text = "experiment: own\n\
                sources: { own: { kind: process/source, with: { command: [python3, nodes.py, Frames], outputs: { left: image, camera: calibration } } } }\n\
                stages: { look: { source: own, nodes: { mono: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/camera } } } } }\n";
    std::fs::write(&experiment, text).expect("written");
    let output = run(&experiment, &folder.path().join("out"), "size").env("PATH", path_of(&python)).output();
    let output = output.expect("started");
    let printed = output_of(&output);
    assert_eq!(output.status.code(), Some(3), "{printed}");
    assert!(printed.contains("`camera` is for 128x64 pixels, but `left` is 64x32"), "{printed}");
    assert!(printed.contains("3 folders without an image"), "{printed}");
}

#[test]
fn check_refuses_numbers_that_cannot_be_passed_to_a_program() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("own.yaml");
    let text = |params: &str| {
        format!(
            "experiment: own\nsources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..1, width: 64, height: 32 }} }} }}\n\
             stages:\n  look:\n    source: street\n    nodes:\n      own: {{ kind: process, inputs: {{ depth: source/depth }}, with: {{ command: [cat], \
             ports: {{ inputs: {{ depth: depth }}, outputs: {{ depth: depth }} }}, params: {params} }} }}\n"
        )
    };
    let check = |params: &str, more: &[&str]| {
        std::fs::write(&experiment, text(params)).expect("written");
        let output = depthloom().arg("check").arg(&experiment).args(more).output().expect("started");
        (output.status.code(), output_of(&output))
    };
    let (code, printed) = check("{ a: 18446744073709551615, b: [1e300, \".nan\"], c: '99999999999999999999' }", &[]);
    assert_eq!(code, Some(0), "{printed}");
    let (code, printed) = check("{ a: 18446744073709551616, b: [1e400, { c: .nan }] }", &[]);
    assert_eq!(code, Some(2), "{printed}");
    for expected in [
        "`18446744073709551616` is an integer beyond 64 bits",
        "`1e400` is beyond the largest number of 64 bits",
        "`.nan` cannot be passed to a program: numbers are finite",
        "put it in quotes to pass it as text",
    ] {
        assert!(printed.contains(expected), "{expected:?} is not in {printed}");
    }
    let (code, printed) = check("{ a: 1 }", &["--set", "look.own.with.params.a=-.inf"]);
    assert_eq!(code, Some(2), "{printed}");
    assert!(printed.contains("`-.inf` cannot be passed to a program"), "{printed}");
}
