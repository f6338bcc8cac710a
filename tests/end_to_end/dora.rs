//! Experiments as dora dataflows: recordings equal to those of one process, foreign dora nodes, and parts that end
//! early.
//!
//! `dora` and its Python library come from PyPI (`tests/python/requirements-dora.txt`).

use depthloom_graphs::plan::RunId;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use depthloom_recording::Recording;
use depthloom_test_needs::{dora, python_package};

use crate::support::{depthloom, workspace};

/// A folder with an experiment, and dora.
struct Flow {
    folder: tempfile::TempDir,
    programs: PathBuf,
}

impl Flow {
    fn new(test: &str, experiment: &str) -> Option<Self> {
        let programs = dora(test)?;
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["node.py", "odd.py"] {
            let script = workspace().join("tests/end_to_end/dora").join(name);
            fs::copy(script, folder.path().join(name)).expect("copied");
        }
        fs::write(folder.path().join("own.yaml"), experiment).expect("written");
        Some(Self { folder, programs })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn depthloom(&self, arguments: &[&str]) -> Output {
        let mut command = depthloom();
        command.current_dir(self.folder.path()).args(arguments).env("DEPTHLOOM_FRESH", "1");
        command.output().expect("it starts")
    }

    /// Writes the dataflow.
    fn write(&self, arguments: &[&str]) -> Output {
        let python = self.programs.join("python");
        let python = python.to_str().expect("UTF-8");
        let written = self.depthloom(&[&["dora"], arguments, &["--python", python]].concat());
        fs::write(self.path("flow.yml"), &written.stdout).expect("written");
        written
    }

    fn command(&self) -> Command {
        let mut command = Command::new(self.programs.join("dora"));
        let path = std::env::var("PATH").unwrap_or_default();
        command.env("PATH", format!("{}:{path}", self.programs.display()));
        command.current_dir(self.folder.path()).args(["run", "flow.yml"]).stdin(Stdio::null());
        command
    }

    /// Runs the dataflow. On a loaded machine, dora 1.1 rarely leaves a node waiting at the start: then the dataflow is
    /// killed and started again, up to three times.
    fn run_dora(&self) -> Output {
        for attempt in 0.. {
            let log = fs::File::create(self.path("log")).expect("a log");
            let mut ran =
                self.command().stdout(log.try_clone().expect("a log")).stderr(log).spawn().expect("dora starts");
            let until = Instant::now() + Duration::from_secs(180);
            loop {
                if let Some(status) = ran.try_wait().expect("a child process") {
                    return Output { status, stdout: fs::read(self.path("log")).expect("a log"), stderr: Vec::new() };
                }
                if Instant::now() > until {
                    break;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            ran.kill().expect("killed");
            ran.wait().expect("it ends");
            assert!(attempt < 2, "{}", plain(&fs::read(self.path("log")).expect("a log")));
        }
        unreachable!("the last attempt returns or panics")
    }

    /// Writes the dataflow and runs it. Returns whether it succeeded, and dora's output.
    fn run(&self, arguments: &[&str]) -> (bool, String) {
        let written = self.write(arguments);
        assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
        let ran = self.run_dora();
        (ran.status.success(), plain(&[ran.stdout, ran.stderr].concat()))
    }

    /// The bytes of a recording.
    fn recording(&self, out: &str) -> Vec<u8> {
        fs::read(self.path(out).join("recording.mcap")).expect("a recording")
    }

    /// Running processes of the dataflow's parts.
    fn parts(&self) -> Vec<u32> {
        let folder = self.folder.path().to_str().expect("UTF-8");
        let processes = fs::read_dir("/proc").expect("/proc").flatten();
        let numbers = processes.filter_map(|process| process.file_name().to_str()?.parse::<u32>().ok());
        numbers
            .filter(|number| {
                let line = fs::read(format!("/proc/{number}/cmdline")).unwrap_or_default();
                let line = String::from_utf8_lossy(&line);
                line.contains("dora-node") && line.contains(folder)
            })
            .collect()
    }
}

/// Removes the escape sequences of colours.
fn plain(printed: &[u8]) -> String {
    let text = String::from_utf8_lossy(printed);
    let mut plain = String::new();
    let mut pieces = text.split('\u{1b}');
    plain.push_str(pieces.next().unwrap_or_default());
    for piece in pieces {
        plain.push_str(piece.split_once('m').map_or("", |(_, rest)| rest));
    }
    plain
}

/// Small frames, a training stage, and a stage that compares; with images that are still encoded, absent values, and
/// aggregate values.
const LEARNS: &str = "
experiment: own
sources:
  train: { kind: synthetic/road, with: { frames: 0..5, seed: 1, width: 320, height: 96 } }
  test: { kind: kitti/stereo2015, with: { root: street } }
stages:
  learn:
    source: train
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples: { kind: learn/samples, inputs: { image: source/left, target: stereo/disparity, mask: edges/mask, calibration: source/calibration }, with: { size: [320, 96] } }
      train: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { steps: 4, batch: 2 } }
  compare:
    source: test
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      mono: { kind: mono/onnx, inputs: { image: source/left, calibration: source/calibration, model: learn.train/model } }
      scaled: { kind: fusion/scale, inputs: { mono: mono/depth, stereo: depth/depth } }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth, mono: scaled/depth } }
variants:
  full: {}
  no_scaling: { compare.scaled.with.method: none }
";

#[test]
fn a_dataflow_writes_the_same_recording_as_a_run() {
    let Some(flow) = Flow::new("dora: the same bytes", LEARNS) else { return };
    let made = flow.depthloom(&["synth", "street", "--frames", "4", "--width", "320", "--height", "96"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let ran = flow.depthloom(&["run", "own.yaml", "--out", "one", "--quiet"]);
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let (succeeded, printed) = flow.run(&["own.yaml", "--out", "many"]);
    assert!(succeeded, "{printed}");
    assert!(flow.recording("one") == flow.recording("many"), "the recordings differ: {printed}");
    for name in ["table.csv", "scores.csv", "error_vs_distance.csv", "models/learn.train.onnx"] {
        let read = |out: &str| fs::read(flow.path(out).join(name)).expect("written");
        assert!(read("one") == read("many"), "{name} differs");
    }
    assert_eq!(flow.parts(), Vec::<u32>::new());
    // A window of one frame, with threads that request later frames early.
    let (succeeded, printed) = flow.run(&["own.yaml", "--out", "narrow", "--window", "1", "--workers", "4"]);
    assert!(succeeded && flow.recording("one") == flow.recording("narrow"), "{printed}");
}

/// An experiment with this node on small frames of a street.
fn with_node(node: &str) -> String {
    format!(
        "
experiment: own
sources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..6, seed: 2, width: 320, height: 96 }} }} }}
stages:
  look:
    source: street
    nodes:
      stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }} }}
      depth: {{ kind: depth/from-disparity, inputs: {{ disparity: stereo/disparity, calibration: source/calibration }} }}
      own: {{ inputs: {{ depth: depth/depth }}, {node} }}
    score: {{ ground_truth: source/depth, estimates: {{ own: own/depth, stereo: depth/depth }} }}
"
    )
}

fn with_dora_node(more: &str) -> String {
    with_node(&format!(
        "kind: dora, with: {{ path: node.py, ports: {{ inputs: {{ depth: depth }}, outputs: {{ depth: depth }} }}, version: 1, {more} }}"
    ))
}

#[test]
fn a_foreign_dora_node_takes_part_in_a_dataflow() {
    for more in ["values: struct", "values: flat"] {
        let Some(flow) = Flow::new("dora: a foreign node", &with_dora_node(more)) else { return };
        let (succeeded, printed) = flow.run(&["own.yaml", "--allow-exec", "--out", "many"]);
        assert!(succeeded, "{more}: {printed}");
        // The node outputs its input.
        let table = fs::read_to_string(flow.path("many/scores.csv")).expect("scores");
        let rows_of = |estimate: &str| -> Vec<String> {
            let lines = table.lines().filter(|line| line.split(',').any(|field| field == estimate));
            lines.map(|line| line.replace(estimate, "")).collect()
        };
        assert_eq!(rows_of("own").len(), 6, "{table}");
        assert_eq!(rows_of("own"), rows_of("stereo"), "{more}");
    }
}

#[test]
fn a_foreign_dora_node_that_stalls_or_ends_fails_the_frame() {
    let cases = [
        // Long enough for the frames before it on a loaded machine.
        ("args: [silent], timeout_s: 15", "dora's node gave nothing at `depth` within 15 s"),
        ("args: [ends]", "dora's node has ended"),
        ("values: flat, args: [forgets]", "replied at `depth` without naming its frame"),
        (
            "values: flat, args: [negative]",
            "is not a valid depth: -5.0 m at row 0, column 0 (30720 of 30720 pixels are invalid)",
        ),
    ];
    for (more, message) in cases {
        let Some(flow) = Flow::new("dora: a node that does not reply", &with_dora_node(more)) else { return };
        let (succeeded, printed) = flow.run(&["own.yaml", "--allow-exec", "--out", "many"]);
        assert!(!succeeded, "{more}: {printed}");
        assert!(
            printed.contains("error: node `look.own` failed on frame 000002_10") && printed.contains(message),
            "{more}: {printed}"
        );
        let recording = Recording::open(flow.path("many.partial/recording.mcap")).expect("readable");
        assert_eq!(recording.frames(RunId(0)).len(), 2, "{more}");
        assert_eq!(flow.parts(), Vec::<u32>::new());
    }
}

#[test]
fn failures_leave_the_same_failure_records_as_a_run() {
    let test = "dora: frames that fail";
    let Some(python) = python_package(test) else { return };
    let node = format!(
        "kind: process, with: {{ command: [{:?}, odd.py], ports: {{ inputs: {{ depth: depth }}, outputs: {{ depth: depth }} }}, version: 1 }}",
        python.display().to_string()
    );
    let Some(flow) = Flow::new(test, &with_node(&node)) else { return };
    for (more, suffix) in [(&["--keep-going"][..], ""), (&[][..], ".partial")] {
        let ran = flow.depthloom(&[&["run", "own.yaml", "--allow-exec", "--out", "one", "--overwrite"], more].concat());
        assert_eq!(ran.status.code(), Some(3), "{}", String::from_utf8_lossy(&ran.stderr));
        let (succeeded, printed) =
            flow.run(&[&["own.yaml", "--allow-exec", "--out", "many", "--overwrite"], more].concat());
        assert!(!succeeded && printed.contains("these depths are odd"), "{printed}");
        let (one, many) = (format!("one{suffix}"), format!("many{suffix}"));
        assert!(flow.recording(&one) == flow.recording(&many), "the recordings differ: {printed}");
    }
}

#[test]
fn killing_any_part_ends_the_dataflow_and_leaves_a_readable_recording() {
    let long = with_dora_node("values: struct").replace("0..6", "0..4000");
    for victim in ["look.stereo", "recorder", "look.own.dora", "dora", "stop"] {
        let Some(flow) = Flow::new("dora: parts that are killed", &long) else { return };
        let written = flow.write(&["own.yaml", "--allow-exec", "--out", "many"]);
        assert!(written.status.success());
        let recording = flow.path("many.partial/recording.mcap");
        let is_recording = || fs::metadata(&recording).is_ok_and(|file| file.len() > 2 << 20);
        let mut started = None;
        // As in `run_dora`: dora does not always start.
        for _ in 0..3 {
            let log = fs::File::create(flow.path("log")).expect("a log");
            let mut ran =
                flow.command().stdout(log.try_clone().expect("a log")).stderr(log).spawn().expect("dora starts");
            let until = Instant::now() + Duration::from_secs(150);
            while !is_recording() && Instant::now() < until && ran.try_wait().expect("a child process").is_none() {
                std::thread::sleep(Duration::from_millis(20));
            }
            if is_recording() {
                started = Some(ran);
                break;
            }
            let _ = ran.kill();
            ran.wait().expect("it ends");
            wait_for(|| flow.parts().is_empty(), "all parts end");
        }
        let mut ran = started.expect("one of three dataflows starts");
        match victim {
            "dora" => ran.kill().expect("killed"),
            "stop" => signal("INT", ran.id()),
            part => {
                let is_victim = |line: &str| match part.strip_suffix(".dora") {
                    Some(_) => line.contains("node.py"),
                    None => line.contains(&format!("--part\0{part}\0")),
                };
                let cwd = flow.folder.path().canonicalize().expect("there");
                for number in processes(|number, line| {
                    is_victim(line) && fs::read_link(format!("/proc/{number}/cwd")).is_ok_and(|at| at == cwd)
                }) {
                    signal("KILL", number);
                }
            }
        }
        let killed_at = Instant::now();
        let status = ran.wait().expect("it ends");
        assert!(killed_at.elapsed() < Duration::from_secs(180), "{victim}");
        assert!(!status.success(), "{victim}");
        wait_for(|| flow.parts().is_empty(), "all parts end");
        let log = plain(&fs::read(flow.path("log")).expect("a log"));
        let recording = Recording::open(&recording).expect("readable");
        assert!(recording.frames(RunId(0)).len() > 1, "{victim}: {log}");
        match victim {
            "look.stereo" => assert!(log.contains("error: node `look.stereo` failed on frame"), "{log}"),
            "look.own.dora" => assert!(log.contains("dora's node has ended"), "{log}"),
            "stop" => assert!(log.contains("frames can be read from many.partial"), "{log}"),
            _ => {}
        }
    }
}

fn processes(matches: impl Fn(u32, &str) -> bool) -> Vec<u32> {
    let all = fs::read_dir("/proc").expect("/proc").flatten();
    let numbers = all.filter_map(|process| process.file_name().to_str()?.parse::<u32>().ok());
    let line = |number: u32| fs::read(format!("/proc/{number}/cmdline")).unwrap_or_default();
    numbers.filter(|number| matches(*number, &String::from_utf8_lossy(&line(*number)))).collect()
}

fn signal(name: &str, number: u32) {
    let sent = Command::new("kill").args(["-s", name, &number.to_string()]).status().expect("kill");
    assert!(sent.success(), "{name} {number}");
}

fn wait_for(is_there: impl Fn() -> bool, what: &str) {
    let until = Instant::now() + Duration::from_secs(180);
    while !is_there() {
        assert!(Instant::now() < until, "{what} within three minutes");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A program in place of a Python with dora's library: it prints `output`, and waits.
fn stand_in(folder: &Path, name: &str, output: &str) -> PathBuf {
    let program = folder.join(name);
    // It keeps its standard output open, as a waiting bridge does.
    let script = format!("#!/bin/sh\nexec 3>&1\nprintf '{output}'\nexec cat > /dev/null\n");
    // Another process writes the file, because a file that this process has open for writing cannot be started.
    let write = format!("cat > {0} && chmod +x {0}", program.display());
    let mut child = Command::new("sh").args(["-c", &write]).stdin(Stdio::piped()).spawn().expect("sh");
    child.stdin.take().expect("a pipe").write_all(script.as_bytes()).expect("written");
    assert!(child.wait().expect("ended").success());
    program
}

#[test]
fn a_dataflow_that_does_not_start_names_the_missing_nodes() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = "experiment: own
sources: { street: { kind: synthetic/road, with: { frames: 0..2, width: 320, height: 96 } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
record: [stereo]
";
    fs::write(folder.path().join("own.yaml"), experiment).expect("written");
    // `{"ready":true}` has 14 bytes; its length fields have 4 and 8 bytes.
    let ready = r#"\016\000\000\000\000\000\000\000\000\000\000\000{"ready":true}"#;
    for (name, printed, message) in [
        ("silent", "", "error: dora did not let node `recorder` begin within 1 s"),
        ("ready", ready, "error: not started within 1 s: `look.source`, `look.stereo` of the dataflow"),
    ] {
        let python = stand_in(folder.path(), name, printed);
        let python = python.to_str().expect("UTF-8");
        let mut write = depthloom();
        write.current_dir(folder.path()).args([
            "dora",
            "own.yaml",
            "--out",
            "many",
            "--start-timeout",
            "1",
            "--python",
            python,
        ]);
        let written = write.output().expect("it starts");
        assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
        let text = String::from_utf8(written.stdout).expect("UTF-8");
        let lines = text.lines().filter_map(|line| line.trim().strip_prefix("args: \"dora-node "));
        let line = lines.into_iter().find(|line| line.contains("--part recorder")).expect("the recorder");
        let words: Vec<&str> = line.trim_end_matches('"').split(' ').collect();
        let mut node = depthloom();
        let output = node.current_dir(folder.path()).arg("dora-node").args(words).output().expect("it starts");
        let stderr = String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(
            output.status.code() == Some(1) && stderr.contains(message) && stderr.contains("--start-timeout"),
            "{stderr}"
        );
    }
}

#[test]
fn a_dataflow_that_cannot_start_reports_the_reason() {
    let Some(flow) = Flow::new("dora: a dataflow that cannot start", &with_dora_node("values: struct")) else { return };
    let stderr_of = |output: &Output| {
        assert_eq!(output.status.code(), Some(2));
        assert_eq!(output.stdout, b"");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    // Without permission, the experiment starts no program.
    let refused = stderr_of(&flow.write(&["own.yaml"]));
    assert!(refused.contains("it would start `node.py`") && refused.contains("--allow-exec"), "{refused}");
    let run = stderr_of(&flow.depthloom(&["run", "own.yaml", "--allow-exec", "--out", "x"]));
    assert!(run.contains("depthloom dora EXPERIMENT"), "{run}");
    let machine = stderr_of(&flow.write(&["own.yaml", "--allow-exec", "--machine", "absent=jetson"]));
    assert!(
        machine.contains("`absent`, which is not a node of the dataflow") && machine.contains("look.own.dora"),
        "{machine}"
    );
    // A part that dora did not start.
    let written = flow.write(&["own.yaml", "--allow-exec", "--out", "many", "--machine", "*.stereo=jetson"]);
    let text = String::from_utf8(written.stdout).expect("UTF-8");
    assert!(text.contains("- id: \"look.stereo\"\n    deploy: { machine: \"jetson\" }\n"), "{text}");
    let line = text.lines().find_map(|line| line.trim().strip_prefix("args: \"dora-node ")).expect("arguments");
    let words: Vec<&str> = line.trim_end_matches('"').split(' ').collect();
    let outside = stderr_of(&flow.depthloom(&[&["dora-node"], &words[..]].concat()));
    assert!(outside.contains("dora cannot be reached") && outside.contains("`dora run dataflow.yml`"), "{outside}");
    // Another experiment, and a Python without the library.
    let (succeeded, printed) = {
        let written = flow.write(&["own.yaml", "--allow-exec", "--out", "many"]);
        assert!(written.status.success());
        let changed = with_dora_node("values: struct").replace("seed: 2", "seed: 3");
        fs::write(flow.path("own.yaml"), changed).expect("written");
        let ran = flow.run_dora();
        (ran.status.success(), plain(&[ran.stdout, ran.stderr].concat()))
    };
    assert!(
        !succeeded && printed.contains("own.yaml differs from the experiment that the dataflow was written for"),
        "{printed}"
    );
    let without = flow.depthloom(&["dora", "own.yaml", "--allow-exec", "--out", "many", "--python", "/nowhere/python"]);
    fs::write(flow.path("flow.yml"), without.stdout).expect("written");
    let ran = flow.run_dora();
    let printed = plain(&[ran.stdout, ran.stderr].concat());
    assert!(
        !ran.status.success() && printed.contains("failed to start `/nowhere/python`, which dora is reached by"),
        "{printed}"
    );
    assert!(!Path::new(&flow.path("many")).exists() && !flow.path("many.partial").exists());
}
