//! The example as a person uses it: its kinds are in every command, and what they compute is right.

use std::path::Path;
use std::process::{Command, Output};

fn own_node(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_own-node")).args(arguments).output().expect("it starts")
}

fn text(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout.clone()).expect("text")
}

const EXPERIMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/plane.yaml");

#[test]
fn own_kinds_run_and_stereo_finds_the_planes() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    text(&own_node(&["run", EXPERIMENT, "--quiet", "--out", run.to_str().unwrap()]));
    let column = |name: &str| column(&run, name);
    // Integer disparities: stereo answers exactly, and one plane of four is farther than 15 m.
    for (name, frames) in [("stereo", 4), ("nearer", 4)] {
        let rows = column(name);
        assert_eq!(rows.len(), frames, "{name}");
    }
    let all: Vec<f64> = column("stereo").iter().map(|row| row.1).collect();
    assert!(all.iter().all(|a1| *a1 > 0.99), "{all:?}");
    let pixels: Vec<f64> = column("nearer").iter().map(|row| row.0).collect();
    assert_eq!(pixels[0], 0.0, "20 m is farther than 15");
    assert!(pixels[1..].iter().all(|pixels| *pixels > 10_000.0), "{pixels:?}");
}

/// By frame: scored pixels and a1 of an estimate.
fn column(run: &Path, estimate: &str) -> Vec<(f64, f64)> {
    let text = std::fs::read_to_string(run.join("scores.csv")).expect("scores");
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().expect("a head");
    let at = |name: &str| head.iter().position(|column| *column == name).expect("a column");
    let number = |cell: &str| cell.parse().unwrap_or(f64::NAN);
    let of_estimate = lines.filter(|line| line[at("estimate")] == estimate);
    of_estimate.map(|line| (number(line[at("pixels")]), number(line[at("a1")]))).collect()
}

#[test]
fn own_kinds_are_in_reference_schema_and_diagnostics() {
    assert!(text(&own_node(&["nodes"])).contains("example/nearer"));
    let reference = text(&own_node(&["nodes", "example/nearer"]));
    assert!(reference.contains("farthest depth that is kept"), "{reference}");
    let schema = text(&own_node(&["schema"]));
    assert!(schema.contains("example/plane") && schema.contains("example/nearer"));
    let wrong = own_node(&["check", EXPERIMENT, "--set", "look.nearer.with.far_m=-1"]);
    assert_eq!(wrong.status.code(), Some(2));
    let stderr = String::from_utf8(wrong.stderr).unwrap();
    assert!(stderr.contains("far_m"), "{stderr}");
}

#[test]
fn own_kinds_are_completed_under_the_own_name() {
    let script = text(&own_node(&["completions", "bash"]));
    assert!(script.contains("_clap_complete_own_node own-node\n"), "{script}");
    let mut ask = Command::new(env!("CARGO_BIN_EXE_own-node"));
    ask.env("DEPTHLOOM_COMPLETE", "bash").env("_CLAP_IFS", "\n").env("_CLAP_COMPLETE_INDEX", "2");
    let offered = text(&ask.args(["--", "own-node", "nodes", "example/"]).output().unwrap());
    let mut kinds: Vec<&str> = offered.lines().collect();
    kinds.sort_unstable();
    assert_eq!(kinds, ["example/nearer", "example/plane"]);
}
