//! A recording as a source: it stands for the source it was made from, and gives what its nodes gave.

use depthloom_graphs::plan::{FrameIndex, RunId};
use std::path::{Path, PathBuf};
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_recording::Recording;
use serde_json::{Value as Json, json};

use crate::support::{depthloom, succeed, workspace};

/// A folder with a run of two variants on three small frames, to call the program in.
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

    /// The first look on other sources, of which `street` is the stage's.
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

    /// What `check` says of an experiment that is wrong.
    fn wrong(&self, with: &str) -> String {
        self.write("wrong.yaml", &format!("  street: {{ kind: mcap, with: {with} }}\n"));
        let output = self.command(&["check", "wrong.yaml"]).output().expect("the binary starts");
        let said = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "{said}");
        said.split_whitespace().collect::<Vec<_>>().join(" ")
    }
}

/// Of each frame the depths of a topic, bit for bit.
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
fn a_recording_stands_for_the_source_it_was_made_from_key_by_key() {
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
    // So nothing is matched again that the first run has matched: but the parameter of a node behind is a new one.
    let set = ["--set", "look.depth.with.cap=20", "--json", "--out", "less"];
    let told = succeed(here.command(&["run", "--no-page", "again.yaml"]).args(set).env_remove("DEPTHLOOM_FRESH"));
    let told: Json = serde_json::from_slice(&told.stdout).expect("JSON");
    let reused = told["reused"]["nodes"].as_array().unwrap_or_else(|| panic!("{told:#}"));
    assert!(reused.iter().all(|node| node["node"] == "stereo") && reused.len() == 2, "{told:#}");
}

#[test]
fn what_nodes_gave_is_there_under_their_names_and_frames_keep_theirs() {
    let here = Here::new();
    let nodes = "{ depth: { kind: depth/from-disparity, inputs: { disparity: source/stereo.disparity, calibration: source/calibration } } }";
    let with =
        "{ path: first/recording.mcap, variant: nine, outputs: [calibration, depth, 'stereo.*'], frames: [6, 4] }";
    let text = format!(
        "experiment: behind\nsources: {{ taken: {{ kind: mcap, with: {with} }} }}\nstages:\n  look:\n    source: taken\n    nodes: {nodes}\n    \
         score: {{ truth: source/depth, estimates: {{ stereo: depth/depth }} }}\n"
    );
    std::fs::write(here.path().join("behind.yaml"), text).expect("written");
    succeed(&mut here.command(&["run", "--no-page", "behind.yaml", "--quiet", "--out", "behind"]));
    let first = depths(&here.recording("first"), "/look/nine/depth/depth");
    let behind = depths(&here.recording("behind"), "/look/depth/depth");
    assert_eq!(behind, [first[2].clone(), first[0].clone()]);
    // Keys name the values: of another variant they are others, of the same recording elsewhere the same.
    let keys =
        |run: &str| here.recording(run).frames(RunId(0)).iter().map(|frame| frame.source_key).collect::<Vec<_>>();
    let moved = here.path().join("moved.mcap");
    std::fs::copy(here.path().join("first/recording.mcap"), &moved).expect("copied");
    for (name, set) in [("moved", "path=moved.mcap"), ("five", "variant=five")] {
        let set = format!("sources.taken.with.{set}");
        succeed(&mut here.command(&["run", "--no-page", "behind.yaml", "--quiet", "--set", &set, "--out", name]));
    }
    assert_eq!(keys("behind"), keys("moved"));
    assert!(keys("behind").iter().zip(keys("five")).all(|(nine, five)| *nine != five));
    // Two recordings, one after the other.
    let join = "[{ kind: mcap, with: { path: first } }, { kind: mcap, with: { path: moved.mcap, frames: [5] } }]";
    here.write("two.yaml", &format!("  street: {{ join: {join} }}\n"));
    succeed(&mut here.command(&["run", "--no-page", "two.yaml", "--quiet", "--out", "two"]));
    assert_eq!(here.recording("two").frames(RunId(0)).len(), 4);
}

#[test]
fn check_knows_the_outputs_and_says_what_a_recording_has_not() {
    let here = Here::new();
    let said = here.wrong("{ path: nowhere }");
    assert!(said.contains("the outputs of this `mcap` are not known") && said.contains("nowhere"), "{said}");
    assert!(!said.contains("has no output"), "one thing is wrong, not all that follows from it: {said}");
    assert!(here.wrong("{}").contains("path is missing"));
    assert!(here.wrong("{ path: first, stage: lok }").contains("its stages are `look`"));
    assert!(here.wrong("{ path: first, variant: nin }").contains("did you mean `nine`?"));
    let said = here.wrong("{ path: first, outputs: [left, right, calibration, depth, stereo.disparity] }");
    assert!(said.contains("what differs between variants needs `variant`"), "{said}");
    let said = here.wrong("{ path: first, outputs: [left, calibration, depth] }");
    assert!(said.contains("source `street` has no output `right`"), "{said}");
    let said = here.wrong("{ path: first, outputs: [lfet] }");
    assert!(said.contains("did you mean `left`?"), "{said}");
}

#[test]
fn a_recording_that_was_cut_gives_its_whole_frames_and_says_so() {
    let here = Here::new();
    let bytes = std::fs::read(here.path().join("first/recording.mcap")).expect("a recording");
    let cut: PathBuf = here.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).expect("written");
    here.write("cut.yaml", "  street: { kind: mcap, with: { path: cut.mcap } }\n");
    let told = succeed(&mut here.command(&["run", "--no-page", "cut.yaml", "--json", "--out", "rest"]));
    let told: Json = serde_json::from_slice(&told.stdout).expect("JSON");
    let whole = Recording::open(&cut).expect("a recording").frames(RunId(0)).len();
    assert!((1..3).contains(&whole));
    assert_eq!(here.recording("rest").frames(RunId(0)).len(), whole);
    let warning = told["warnings"][0].as_str().expect("a warning");
    assert!(warning.contains("cut.mcap is unfinished") || warning.contains("cut.mcap is damaged"), "{warning}");
    // A frame that is asked for and was cut off is missing.
    here.write("cut.yaml", "  street: { kind: mcap, with: { path: cut.mcap, frames: 4..7 } }\n");
    let output =
        here.command(&["run", "--no-page", "cut.yaml", "--json", "--out", "none"]).output().expect("the binary starts");
    let told: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!((output.status.code(), &told["error"]["exit_code"]), (Some(2), &json!(2)), "{told:#}");
}
