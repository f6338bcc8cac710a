//! Cache keys contain everything that a program can observe: a run that reuses results equals one that computes all.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::python::path_of;
use super::{output_of, run};
use crate::support::{depthloom, python_package, succeed};

/// A folder with an experiment of one Python node, and a common folder of its runs.
struct Programs {
    folder: tempfile::TempDir,
    python: PathBuf,
}

const EXPERIMENT: &str = "
experiment: keys
sources: { street: { kind: synthetic/road, with: { frames: 0..3, width: 96, height: 32 } } }
stages:
  look:
    source: street
    nodes:
      own:
        kind: process
        inputs: { depth: source/depth }
        with: { command: [python3, node.py], ports: { inputs: { depth: depth }, outputs: { depth: depth } }, WITH }
      after: { kind: filter/median, inputs: { depth: own/depth } }
    score: { ground_truth: source/depth, estimates: { after: after/depth } }
";

const NODE: &str = "
import depthloom
from mylib.k import K

@depthloom.node(inputs={'depth': 'depth'}, outputs={'depth': 'depth'})
def node(depth):
    return depth * K

depthloom.serve(node)
";

impl Programs {
    fn new(test: &str) -> Option<Self> {
        let python = python_package(test)?;
        let programs = Self { folder: tempfile::tempdir().expect("a folder"), python };
        std::fs::create_dir(programs.path("mylib")).expect("made");
        programs.write("mylib/k.py", "K = 1.1\n");
        programs.write("node.py", NODE);
        Some(programs)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).expect("written");
    }

    fn experiment(&self, with: &str) -> PathBuf {
        self.write("keys.yaml", &EXPERIMENT.replace("WITH", with));
        self.path("keys.yaml")
    }

    fn command(&self, experiment: &Path, out: &str) -> Command {
        let mut command = run(experiment, &self.path("runs").join(out), "keys");
        command.env("PATH", path_of(&self.python));
        command.current_dir(self.folder.path()).env_remove("DEPTHLOOM_FRESH");
        command
    }

    /// The recording of a run that reuses results of earlier runs.
    fn recording(&self, experiment: &Path, out: &str) -> Vec<u8> {
        succeed(&mut self.command(experiment, out));
        std::fs::read(self.path("runs").join(out).join("recording.mcap")).expect("a recording")
    }

    /// Asserts that a run with reuse writes the same recording as one with `--fresh`.
    fn assert_equals_fresh(&self, experiment: &Path, out: &str) {
        let reusing = self.recording(experiment, out);
        let fresh = format!("{out}-fresh");
        succeed(self.command(experiment, &fresh).arg("--fresh"));
        let fresh = std::fs::read(self.path("runs").join(fresh).join("recording.mcap")).expect("a recording");
        assert!(reusing == fresh, "{out}: the recording of the reusing run differs from a fresh one");
    }

    /// The number of the node's frames that the next run would compute.
    fn computed(&self, experiment: &Path) -> u64 {
        let mut plan = depthloom();
        plan.args(["plan", "--reuse", "--json", "--allow-exec", "--out"]).arg(self.path("runs/next")).arg(experiment);
        plan.env("PATH", path_of(&self.python));
        plan.current_dir(self.folder.path()).env_remove("DEPTHLOOM_FRESH");
        let plan: serde_json::Value = serde_json::from_slice(&succeed(&mut plan).stdout).expect("JSON");
        let nodes = plan["nodes"].as_array().expect("a list");
        nodes.iter().find(|node| node["node"] == "own").expect("a node")["runs"].as_u64().expect("a number")
    }
}

#[test]
fn a_changed_imported_module_changes_the_key() {
    const TEST: &str = "a_changed_imported_module_changes_the_key";
    let Some(programs) = Programs::new(TEST) else { return };
    for with in ["code: [node.py]", "version: 1"] {
        let experiment = programs.experiment(with);
        programs.write("mylib/k.py", "K = 1.1\n");
        let name = with.split(':').next().expect("a word");
        programs.recording(&experiment, &format!("{name}-first"));
        assert_eq!(programs.computed(&experiment), 0, "{with}: nothing changed");
        programs.write("mylib/k.py", "K = 2.0\n");
        programs.assert_equals_fresh(&experiment, &format!("{name}-second"));
    }
    // With `imports: false`, the change is not detected.
    let experiment = programs.experiment("code: [node.py], imports: false");
    programs.recording(&experiment, "off");
    programs.write("mylib/k.py", "K = 3.0\n");
    assert_eq!(programs.computed(&experiment), 0);
}

#[test]
fn a_map_of_another_size_fails_only_its_frame() {
    const TEST: &str = "a_map_of_another_size_fails_only_its_frame";
    let Some(programs) = Programs::new(TEST) else { return };
    let sizes = "
import depthloom

@depthloom.node(inputs={'depth': 'depth'}, outputs={'depth': 'depth'})
class Node:
    def process(self, depth, frame):
        return depth[:-1].copy() if frame.index == 1 else depth

depthloom.serve(Node)
";
    programs.write("node.py", sizes);
    let experiment = programs.experiment("contract: ordered, code: [node.py]");
    let output = programs.command(&experiment, "sizes").arg("--keep-going").output().expect("it runs");
    assert_eq!(output.status.code(), Some(3), "{}", output_of(&output));
    let table = crate::support::read_csv(&programs.path("runs/sizes/table.csv"));
    assert_eq!(table[0]["frames"], "2", "{table:?}");
    succeed(depthloom().args(["analyse", "--samples-only"]).arg(programs.path("runs/sizes")));
}

#[test]
fn the_order_of_parameters_is_part_of_the_key() {
    const TEST: &str = "the_order_of_parameters_is_part_of_the_key";
    let Some(programs) = Programs::new(TEST) else { return };
    let steps = "
import depthloom
import numpy as np

@depthloom.node(inputs={'depth': 'depth'}, outputs={'depth': 'depth'})
def node(depth, params):
    for step, value in params['steps'].items():
        depth = depth * np.float32(value) if step == 'times' else depth + np.float32(value)
    return depth

depthloom.serve(node)
";
    programs.write("node.py", steps);
    for (with, out) in [("code: [node.py]", "code"), ("version: 1, imports: false", "version")] {
        let experiment = programs.experiment(&format!("{with}, params: {{ steps: {{ times: 2, plus: 10 }} }}"));
        programs.recording(&experiment, &format!("{out}-first"));
        let experiment = programs.experiment(&format!("{with}, params: {{ steps: {{ plus: 10, times: 2 }} }}"));
        programs.assert_equals_fresh(&experiment, &format!("{out}-second"));
    }
}

#[test]
fn reading_an_undeclared_file_fails_the_frame_or_warns_without_reads() {
    const TEST: &str = "reading_an_undeclared_file_fails_the_frame_or_warns_without_reads";
    let Some(programs) = Programs::new(TEST) else { return };
    let reading = "
import depthloom
import numpy as np

@depthloom.node(inputs={'depth': 'depth'}, outputs={'depth': 'depth'})
def node(depth, FRAME):
    return depth * np.float32(open(PATH).read())

depthloom.serve(node)
";
    std::fs::create_dir(programs.path("factors")).expect("made");
    std::fs::create_dir(programs.path("others")).expect("made");
    for frame in 0..3 {
        programs.write(&format!("factors/{frame:06}_10.txt"), "2");
        programs.write(&format!("others/{frame:06}_10.txt"), "3");
    }
    let with = "code: [node.py], reads: \"factors/{frame}.txt\"";
    let program = |path: &str| programs.write("node.py", &reading.replace("FRAME", "frame").replace("PATH", path));
    program("f'factors/{frame.id}.txt'");
    let output = programs.command(&programs.experiment(with), "named").output().expect("it runs");
    assert!(output.status.success() && !output_of(&output).contains("factors"), "{}", output_of(&output));
    program("f'others/{frame.id}.txt'");
    let output = programs.command(&programs.experiment(with), "others").output().expect("it runs");
    assert_eq!(output.status.code(), Some(3), "{}", output_of(&output));
    assert!(
        output_of(&output).contains("others") && output_of(&output).contains("neither `reads`"),
        "{}",
        output_of(&output)
    );
    programs.write("node.py", &reading.replace(", FRAME", "").replace("PATH", "'factors/000000_10.txt'"));
    let output = succeed(&mut programs.command(&programs.experiment("code: [node.py]"), "warned"));
    assert!(output_of(&output).contains("000000_10.txt after it began to serve"), "{}", output_of(&output));
}

#[test]
fn a_late_import_fails_the_frame_unless_code_names_the_module() {
    const TEST: &str = "a_late_import_fails_the_frame_unless_code_names_the_module";
    let Some(programs) = Programs::new(TEST) else { return };
    let late =
        NODE.replace("from mylib.k import K\n", "").replace("    return", "    from mylib.k import K\n    return");
    programs.write("node.py", &late);
    let output = programs.command(&programs.experiment("code: [node.py]"), "late").output().expect("it runs");
    assert_eq!(output.status.code(), Some(3), "{}", output_of(&output));
    let printed = output_of(&output);
    assert!(printed.contains("k.py after it was started") && printed.contains("name it in `code`"), "{printed}");
    let experiment = programs.experiment("code: [node.py, mylib]");
    programs.recording(&experiment, "named");
    programs.write("mylib/k.py", "K = 2.0\n");
    programs.assert_equals_fresh(&experiment, "named-again");
}

#[test]
fn a_late_package_import_is_a_warning_outside_the_recording() {
    const TEST: &str = "a_late_package_import_is_a_warning_outside_the_recording";
    let Some(programs) = Programs::new(TEST) else { return };
    programs.write("node.py", &NODE.replace("    return", "    import fontTools\n    return"));
    let experiment = programs.experiment("code: [node.py]");
    let recording = |workers: &str| {
        let output = succeed(programs.command(&experiment, workers).args(["--fresh", "--workers", workers]));
        assert!(output_of(&output).contains("imported the package `fonttools`"), "{}", output_of(&output));
        std::fs::read(programs.path("runs").join(workers).join("recording.mcap")).expect("a recording")
    };
    assert!(recording("1") == recording("3"), "the recordings differ");
}

#[test]
fn code_accepts_folders_and_patterns_and_check_reports_missing_files() {
    const TEST: &str = "code_accepts_folders_and_patterns_and_check_reports_missing_files";
    let Some(programs) = Programs::new(TEST) else { return };
    for (code, name) in [("mylib", "folder"), ("'my*/*.py'", "pattern")] {
        let experiment = programs.experiment(&format!("code: [node.py, {code}], imports: false"));
        programs.recording(&experiment, name);
        assert_eq!(programs.computed(&experiment), 0, "{name}: nothing changed");
        programs.write("mylib/new.py", name);
        programs.assert_equals_fresh(&experiment, &format!("{name}-again"));
    }
    for (code, message) in [("gone.py", "gone.py"), ("'mylib/*.rs'", "mylib/*.rs, which matches no file")] {
        let mut check = depthloom();
        let output = check.arg("check").arg(programs.experiment(&format!("code: [{code}]"))).output().expect("it runs");
        assert_eq!(output.status.code(), Some(2), "{}", output_of(&output));
        assert!(output_of(&output).replace(' ', "").contains(&message.replace(' ', "")), "{}", output_of(&output));
    }
}

#[test]
fn files_in_reads_are_part_of_the_frames_key() {
    const TEST: &str = "files_in_reads_are_part_of_the_frames_key";
    let Some(programs) = Programs::new(TEST) else { return };
    programs.write(
        "node.py",
        "
import os
import depthloom

@depthloom.node(inputs={'depth': 'depth'}, outputs={'depth': 'depth'})
class Node:
    def process(self, depth, frame):
        file = os.path.join(os.path.dirname(__file__), 'preds', frame.id + '.txt')
        return depth * (float(open(file).read()) if os.path.exists(file) else 9)

@depthloom.node(inputs={'depth': 'depth'}, outputs={'depth': 'depth'})
def pure(depth, frame):
    return Node().process(depth, frame)

depthloom.serve(Node, pure)
",
    );
    std::fs::create_dir(programs.path("preds")).expect("made");
    for (contract, program, changed) in [("pure", "pure", 1), ("ordered", "Node", 3)] {
        for frame in ["000000_10", "000002_10"] {
            programs.write(&format!("preds/{frame}.txt"), "1.5");
        }
        let more = format!("code: [node.py], contract: {contract}, reads: 'preds/{{frame}}.txt'");
        let experiment = programs.experiment(&more);
        let text = std::fs::read_to_string(&experiment).expect("read");
        std::fs::write(&experiment, text.replace("node.py], ports", &format!("node.py, {program}], ports")))
            .expect("written");
        programs.recording(&experiment, &format!("{contract}-first"));
        programs.write("preds/000000_10.txt", "2.5");
        // The state of an ordered node depends on all earlier frames.
        assert_eq!(programs.computed(&experiment), changed, "{contract}");
        programs.assert_equals_fresh(&experiment, &format!("{contract}-changed"));
        std::fs::remove_file(programs.path("preds/000002_10.txt")).expect("removed");
        programs.assert_equals_fresh(&experiment, &format!("{contract}-removed"));
    }
}

#[test]
fn an_ordered_node_on_a_recording_gets_other_times_and_shares_no_results() {
    const TEST: &str = "an_ordered_node_on_a_recording_gets_other_times_and_shares_no_results";
    let Some(programs) = Programs::new(TEST) else { return };
    programs.write(
        "node.py",
        "
import numpy as np
import depthloom

@depthloom.node(inputs={'depth': 'depth'}, outputs={'depth': 'depth'})
class Clock:
    def __init__(self):
        self.before = None
    def process(self, depth, frame):
        seconds = 1.0 if self.before is None else 1 + (frame.time_ns - self.before) / 1e9
        self.before = frame.time_ns
        return np.full(depth.shape, 1 + seconds, np.float32)

depthloom.serve(Clock)
",
    );
    let experiment = programs.experiment("code: [node.py], contract: ordered");
    let first = std::fs::read_to_string(&experiment).expect("read").replace("0..3", "[3, 7, 8]");
    std::fs::write(&experiment, &first).expect("written");
    programs.recording(&experiment, "first");
    let source = "kind: mcap, with: { path: runs/first/recording.mcap }";
    let second = first.replace("kind: synthetic/road, with: { frames: [3, 7, 8], width: 96, height: 32 }", source);
    assert_ne!(first, second);
    programs.write("second.yaml", &second);
    programs.assert_equals_fresh(&programs.path("second.yaml"), "second");
}
