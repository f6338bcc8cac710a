//! A recording as a source: it can replace the recorded source, and it also outputs the values of its nodes.

use depthloom_graphs::plan::{FrameIndex, RunId};
use std::path::{Path, PathBuf};
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_recording::Recording;
use serde_json::{Value as Json, json};

use crate::support::{depthloom, succeed, workspace};

/// A folder with a run of two variants on three small frames.
struct Here {
    folder: tempfile::TempDir,
}

impl Here {
    fn new() -> Self {
        let here = Self { folder: tempfile::tempdir().expect("a folder") };
        let street = "{ kind: synthetic/road, with: { frames: 4..7, width: 320, height: 96 } }";
        here.write("first.yaml", &format!("  street: {street}\n"));
        succeed(&mut here.command(&["run", "--no-page", "first.yaml", "--quiet", "--out", "first"]));
        here
    }

    /// Writes `first-look.yaml` with these sources; the stage reads `street`.
    fn write(&self, name: &str, sources: &str) {
        let look = workspace().join("experiments/first-look.yaml");
        let variants = "variants: { five: {}, nine: { look.stereo.with.block: 9 } }";
        let text = format!("extends: {}\nexperiment: look\nsources:\n{sources}{variants}\n", look.display());
        std::fs::write(self.path().join(name), text).expect("written");
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = depthloom();
        command.current_dir(self.path()).args(arguments);
        command
    }

    fn recording(&self, run: &str) -> Recording {
        Recording::open(self.path().join(run).join("recording.mcap")).expect("a recording")
    }

    /// Standard error of `check` for an invalid `mcap` source, on one line.
    fn check_error(&self, with: &str) -> String {
        self.write("wrong.yaml", &format!("  street: {{ kind: mcap, with: {with} }}\n"));
        let output = self.command(&["check", "wrong.yaml"]).output().expect("the binary starts");
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        stderr.split_whitespace().collect::<Vec<_>>().join(" ")
    }
}

/// Frame ids and depth maps of a topic, as bits.
fn depths(recording: &Recording, topic: &str) -> Vec<(String, Vec<u32>)> {
    let mut reader = recording.reader(RunId(0), &[topic]).expect("a topic");
    let frame = |position: usize| {
        let values = reader.read(FrameIndex(position)).expect("a frame");
        let [Some(Value::Depth(depth))] = &values[..] else { panic!("a depth") };
        let bits = depth.metres.as_raw().iter().map(|metres| metres.to_bits()).collect();
        (recording.frames(RunId(0))[position].id.to_string(), bits)
    };
    (0..recording.frames(RunId(0)).len()).map(frame).collect()
}

#[test]
fn a_recorded_source_has_the_cache_keys_of_the_original() {
    let here = Here::new();
    here.write("again.yaml", "  street: { kind: mcap, with: { path: first } }\n");
    succeed(&mut here.command(&["check", "again.yaml"]));
    succeed(&mut here.command(&["run", "--no-page", "again.yaml", "--quiet", "--fresh", "--out", "again"]));
    let (first, again) = (here.recording("first"), here.recording("again"));
    let keys = |recording: &Recording| {
        let frames = recording.frames(RunId(0)).iter();
        frames.map(|frame| (frame.id.clone(), frame.index, frame.source_key, frame.keys.clone())).collect::<Vec<_>>()
    };
    assert_eq!(keys(&first), keys(&again));
    for topic in ["/look/source/depth", "/look/five/depth/depth", "/look/nine/depth/depth"] {
        assert_eq!(depths(&first, topic), depths(&again, topic), "{topic}");
    }
    let scores = |run: &str| std::fs::read_to_string(here.path().join(run).join("scores.csv")).expect("scores");
    assert_eq!(scores("first"), scores("again"));
    // With a changed parameter of `depth`, the disparities of the first run are still reused.
    let set = ["--set", "look.depth.with.cap=20", "--json", "--out", "less"];
    let output = succeed(here.command(&["run", "--no-page", "again.yaml"]).args(set).env_remove("DEPTHLOOM_FRESH"));
    let run: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    let reused = run["reused"]["nodes"].as_array().unwrap_or_else(|| panic!("{run:#}"));
    assert!(reused.iter().all(|node| node["node"] == "stereo") && reused.len() == 2, "{run:#}");
}

#[test]
fn recorded_node_outputs_keep_node_and_frame_names() {
    let here = Here::new();
    let nodes = "{ depth: { kind: depth/from-disparity, inputs: { disparity: source/stereo.disparity, calibration: source/calibration } } }";
    let with =
        "{ path: first/recording.mcap, variant: nine, outputs: [calibration, depth, 'stereo.*'], frames: [6, 4] }";
    let text = format!(
        "experiment: later\nsources: {{ recorded: {{ kind: mcap, with: {with} }} }}\nstages:\n  look:\n    source: recorded\n    nodes: {nodes}\n    \
         score: {{ ground_truth: source/depth, estimates: {{ stereo: depth/depth }} }}\n"
    );
    std::fs::write(here.path().join("later.yaml"), text).expect("written");
    succeed(&mut here.command(&["run", "--no-page", "later.yaml", "--quiet", "--out", "later"]));
    let first = depths(&here.recording("first"), "/look/nine/depth/depth");
    let later = depths(&here.recording("later"), "/look/depth/depth");
    assert_eq!(later, [first[2].clone(), first[0].clone()]);
    // Keys depend on the recorded values: they differ for another variant, and are equal for a copy of the recording.
    let keys =
        |run: &str| here.recording(run).frames(RunId(0)).iter().map(|frame| frame.source_key).collect::<Vec<_>>();
    let moved = here.path().join("moved.mcap");
    std::fs::copy(here.path().join("first/recording.mcap"), &moved).expect("copied");
    for (name, set) in [("moved", "path=moved.mcap"), ("five", "variant=five")] {
        let set = format!("sources.recorded.with.{set}");
        succeed(&mut here.command(&["run", "--no-page", "later.yaml", "--quiet", "--set", &set, "--out", name]));
    }
    assert_eq!(keys("later"), keys("moved"));
    assert!(keys("later").iter().zip(keys("five")).all(|(nine, five)| *nine != five));
    // Two recordings, one after the other.
    let join = "[{ kind: mcap, with: { path: first } }, { kind: mcap, with: { path: moved.mcap, frames: [5] } }]";
    here.write("two.yaml", &format!("  street: {{ concat: {join} }}\n"));
    succeed(&mut here.command(&["run", "--no-page", "two.yaml", "--quiet", "--out", "two"]));
    assert_eq!(here.recording("two").frames(RunId(0)).len(), 4);
}

#[test]
fn check_validates_the_outputs_of_a_recording() {
    let here = Here::new();
    let error = here.check_error("{ path: nowhere }");
    assert!(error.contains("the outputs of this `mcap` are not known") && error.contains("nowhere"), "{error}");
    assert!(!error.contains("has no output"), "the cause is reported, not its consequences: {error}");
    assert!(here.check_error("{}").contains("path is missing"));
    assert!(here.check_error("{ path: first, stage: lok }").contains("its stages are `look`"));
    assert!(here.check_error("{ path: first, variant: nin }").contains("did you mean `nine`?"));
    let error = here.check_error("{ path: first, outputs: [left, right, calibration, depth, stereo.disparity] }");
    assert!(error.contains("set `variant` to read nodes that differ between variants"), "{error}");
    let error = here.check_error("{ path: first, outputs: [left, calibration, depth] }");
    assert!(error.contains("source `street` has no output `right`"), "{error}");
    let error = here.check_error("{ path: first, outputs: [lfet] }");
    assert!(error.contains("did you mean `left`?"), "{error}");
}

#[test]
fn a_truncated_recording_yields_its_complete_frames_with_a_warning() {
    let here = Here::new();
    let bytes = std::fs::read(here.path().join("first/recording.mcap")).expect("a recording");
    let cut: PathBuf = here.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).expect("written");
    here.write("cut.yaml", "  street: { kind: mcap, with: { path: cut.mcap } }\n");
    let output = succeed(&mut here.command(&["run", "--no-page", "cut.yaml", "--json", "--out", "rest"]));
    let run: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    let complete = Recording::open(&cut).expect("a recording").frames(RunId(0)).len();
    assert!((1..3).contains(&complete));
    assert_eq!(here.recording("rest").frames(RunId(0)).len(), complete);
    let warning = run["warnings"][0].as_str().expect("a warning");
    assert!(warning.contains("cut.mcap is unfinished") || warning.contains("cut.mcap is damaged"), "{warning}");
    // A selected frame that was cut off is an error.
    here.write("cut.yaml", "  street: { kind: mcap, with: { path: cut.mcap, frames: 4..7 } }\n");
    let output =
        here.command(&["run", "--no-page", "cut.yaml", "--json", "--out", "none"]).output().expect("the binary starts");
    let run: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!((output.status.code(), &run["error"]["exit_code"]), (Some(2), &json!(2)), "{run:#}");
}
