//! Keys contain everything that a program's values depend on: each argument, each variable, the imported modules.

use super::{Case, stderr_of};

/// A source whose depth depends on an environment variable.
const CAMERA: &str = r#"
import os
import numpy as np, depthloom
@depthloom.source(outputs={"left": "image", "depth": "depth", "calibration": "calibration"})
class Camera:
    def frames(self):
        return ["a", "b"]
    def read(self, frame):
        depth = np.full((32, 64), 10 if "MODE" in os.environ else 40, np.float32)
        camera = depthloom.Calibration(64, 32, focal_px=90, cx_px=31.5, cy_px=15.5, baseline_m=0.5, doffs_px=0)
        return {"left": np.full((32, 64), 128, np.uint8), "depth": depth, "calibration": camera}
depthloom.serve(Camera)
"#;

fn camera(command: &str) -> String {
    format!(
        "experiment: camera
sources:
  own: {{ kind: process/source, with: {{ {command}, version: 1, outputs: {{ left: image, depth: depth, calibration: calibration }} }} }}
stages:
  look:
    source: own
    nodes:
      mono: {{ kind: mono/ground-plane, inputs: {{ image: source/left, calibration: source/calibration }} }}
    score: {{ ground_truth: source/depth, estimates: {{ mono: mono/depth }} }}
"
    )
}

#[test]
fn arguments_and_variables_of_a_source_are_not_confused() {
    let Some(case) = Case::with_python("arguments_and_variables_of_a_source_are_not_confused") else { return };
    case.write("camera.py", CAMERA);
    case.write("one.yaml", camera("command: [python3, camera.py, MODE, fast]"));
    case.write("two.yaml", camera("command: [python3, camera.py], env: { MODE: fast }"));
    case.run("one.yaml", "runs/one", &[]);
    case.run_as_fresh("two.yaml", "runs/two", &[]);
    assert_ne!(case.read("runs/one", "scores.csv"), case.read("runs/two", "scores.csv"));
}

/// An experiment with a node that multiplies depths.
fn scaling(contract: &str, with: &str, frames: &str) -> String {
    format!(
        "experiment: scaling
sources: {{ street: {{ kind: synthetic/road, with: {{ frames: {frames}, width: 64, height: 32 }} }} }}
stages:
  look:
    source: street
    nodes:
      own:
        kind: process
        inputs: {{ depth: source/depth }}
        with: {{ command: [python3, own.py], contract: {contract}, {with}, ports: {{ inputs: {{ depth: depth }}, outputs: {{ depth: depth }} }} }}
    score: {{ ground_truth: source/depth, estimates: {{ own: own/depth }} }}
"
    )
}

#[test]
fn a_changed_module_that_a_node_imports_recomputes_its_values() {
    let Some(case) = Case::with_python("a_changed_module_that_a_node_imports_recomputes_its_values") else { return };
    let node = "import depthloom\nfrom library.factor import FACTOR\n\
                @depthloom.node(inputs={\"depth\": \"depth\"}, outputs={\"depth\": \"depth\"})\n\
                def own(depth):\n    return depth * FACTOR\ndepthloom.serve(own)\n";
    case.write("own.py", node);
    case.write("library/__init__.py", "");
    case.write("library/factor.py", "FACTOR = 2\n");
    case.write("own.yaml", scaling("pure", "code: [own.py]", "0..2"));
    case.run("own.yaml", "runs/one", &[]);
    case.write("library/factor.py", "FACTOR = 3\n");
    case.run_as_fresh("own.yaml", "runs/two", &[]);
    assert_ne!(case.read("runs/one", "scores.csv"), case.read("runs/two", "scores.csv"));
}

#[test]
fn a_changed_file_that_a_program_opened_before_it_serves_recomputes_its_values() {
    const TEST: &str = "a_changed_file_that_a_program_opened_before_it_serves_recomputes_its_values";
    let Some(case) = Case::with_python(TEST) else { return };
    let node = "import json\nimport depthloom\nwith open('settings.json') as settings:\n    FACTOR = json.load(settings)\n\
                @depthloom.node(inputs={\"depth\": \"depth\"}, outputs={\"depth\": \"depth\"})\n\
                def own(depth):\n    return depth * FACTOR\ndepthloom.serve(own)\n";
    case.write("own.py", node);
    case.write("settings.json", "2");
    case.write("own.yaml", scaling("pure", "code: [own.py]", "0..2"));
    case.run("own.yaml", "runs/one", &[]);
    case.write("settings.json", "3");
    case.run_as_fresh("own.yaml", "runs/two", &["--audit", "none"]);
    assert_ne!(case.read("runs/one", "scores.csv"), case.read("runs/two", "scores.csv"));
}

#[test]
fn new_values_of_an_ordered_node_that_runs_anyway_are_not_discarded_silently() {
    const TEST: &str = "new_values_of_an_ordered_node_that_runs_anyway_are_not_discarded_silently";
    let Some(case) = Case::with_python(TEST) else { return };
    let node = "import depthloom\n\
                @depthloom.node(inputs={\"depth\": \"depth\"}, outputs={\"depth\": \"depth\"})\n\
                class Own:\n    def process(self, depth, frame):\n        return depth * float(open('factor.txt').read())\n\
                depthloom.serve(Own)\n";
    case.write("own.py", node);
    case.write("factor.txt", "2");
    case.write("own.yaml", scaling("ordered", "code: [own.py]", "0..2"));
    case.run("own.yaml", "runs/one", &[]);
    // `code` does not name the file. An additional frame makes the node run on all frames.
    case.write("factor.txt", "3");
    case.write("own.yaml", scaling("ordered", "code: [own.py]", "0..3"));
    let output = case.attempt("own.yaml", "runs/two", &[]);
    if output.status.success() {
        case.assert_as_fresh("own.yaml", "runs/two", &[]);
    } else {
        assert!(stderr_of(&output).contains("own"), "the error names the node: {}", stderr_of(&output));
    }
}
