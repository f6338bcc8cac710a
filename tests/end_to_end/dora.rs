//! Experiments as dataflows of dora's: the same bytes as a run of one process, nodes of somebody else's, and what
//! becomes of parts that end.
//!
//! `dora` and its library for Python come from PyPI (`tests/python/requirements-dora.txt`).

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

    /// Runs the dataflow. dora 1.1 leaves, once in many on a loaded machine, a node waiting at the start: then it is
    /// ended and begun anew, three times.
    fn ran(&self) -> Output {
        for attempt in 0.. {
            let log = fs::File::create(self.path("log")).expect("a log");
            let mut ran =
                self.command().stdout(log.try_clone().expect("a log")).stderr(log).spawn().expect("dora starts");
            let until = Instant::now() + Duration::from_secs(180);
            loop {
                if let Some(status) = ran.try_wait().expect("it is ours") {
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

    /// Writes the dataflow and runs it; what dora printed.
    fn run(&self, arguments: &[&str]) -> (bool, String) {
        let written = self.write(arguments);
        assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
        let ran = self.ran();
        (ran.status.success(), plain(&[ran.stdout, ran.stderr].concat()))
    }

    /// The bytes of a recording.
    fn recording(&self, out: &str) -> Vec<u8> {
        fs::read(self.path(out).join("recording.mcap")).expect("a recording")
    }

    /// The part's processes that there are.
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

/// Without colours.
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

/// Small frames, a stage that learns, and one that compares; with files' bytes in images, values that are absent, and
/// once-values.
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
      teacher: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { steps: 4, batch: 2 } }
  compare:
    source: test
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      mono: { kind: mono/onnx, inputs: { image: source/left, calibration: source/calibration, model: learn.teacher/model } }
      scaled: { kind: fusion/scale, inputs: { mono: mono/depth, stereo: depth/depth } }
    score: { truth: source/depth, estimates: { stereo: depth/depth, mono: scaled/depth } }
variants:
  full: {}
  no_scaling: { compare.scaled.with.method: none }
";

#[test]
fn a_dataflow_gives_the_bytes_of_a_run_with_learning_variants_and_frames_from_files() {
    let Some(flow) = Flow::new("dora: the same bytes", LEARNS) else { return };
    let made = flow.depthloom(&["synth", "street", "--frames", "4", "--width", "320", "--height", "96"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let ran = flow.depthloom(&["run", "own.yaml", "--out", "one", "--quiet"]);
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let (is_fine, printed) = flow.run(&["own.yaml", "--out", "many"]);
    assert!(is_fine, "{printed}");
    assert!(flow.recording("one") == flow.recording("many"), "the recordings differ: {printed}");
    for name in ["table.csv", "scores.csv", "error_vs_distance.csv", "models/learn.teacher.onnx"] {
        let read = |out: &str| fs::read(flow.path(out).join(name)).expect("written");
        assert!(read("one") == read("many"), "{name} differs");
    }
    assert_eq!(flow.parts(), Vec::<u32>::new());
    // One frame at a time, and threads that ask for later ones before it.
    let (is_fine, printed) = flow.run(&["own.yaml", "--out", "narrow", "--window", "1", "--workers", "4"]);
    assert!(is_fine && flow.recording("one") == flow.recording("narrow"), "{printed}");
}

/// A node on small frames of a street.
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
    score: {{ truth: source/depth, estimates: {{ own: own/depth, stereo: depth/depth }} }}
"
    )
}

fn of_dora(more: &str) -> String {
    with_node(&format!(
        "kind: dora, with: {{ path: node.py, ports: {{ inputs: {{ depth: depth }}, outputs: {{ depth: depth }} }}, version: 1, {more} }}"
    ))
}

#[test]
fn a_node_by_somebody_else_stands_in_a_dataflow() {
    for more in ["values: struct", "values: flat"] {
        let Some(flow) = Flow::new("dora: a node by somebody else", &of_dora(more)) else { return };
        let (is_fine, printed) = flow.run(&["own.yaml", "--allow-exec", "--out", "many"]);
        assert!(is_fine, "{more}: {printed}");
        // It gives what it gets.
        let table = fs::read_to_string(flow.path("many/scores.csv")).expect("scores");
        let of = |estimate: &str| -> Vec<String> {
            let lines = table.lines().filter(|line| line.split(',').any(|field| field == estimate));
            lines.map(|line| line.replace(estimate, "")).collect()
        };
        assert_eq!(of("own").len(), 6, "{table}");
        assert_eq!(of("own"), of("stereo"), "{more}");
    }
}

#[test]
fn a_node_by_somebody_else_that_does_not_answer_fails_the_frame_and_one_that_ends_is_named() {
    let cases = [
        // The frames before it are answered within that time also on a loaded machine.
        ("args: [silent], timeout_s: 15", "dora's node gave nothing at `depth` within 15 s"),
        ("args: [ends]", "dora's node has ended"),
        ("values: flat, args: [forgets]", "answered at `depth` without naming its frame"),
        (
            "values: flat, args: [negative]",
            "is not a valid depth: -5.0 m at row 0, column 0 (30720 of 30720 pixels are invalid)",
        ),
    ];
    for (more, told) in cases {
        let Some(flow) = Flow::new("dora: a node that does not answer", &of_dora(more)) else { return };
        let (is_fine, printed) = flow.run(&["own.yaml", "--allow-exec", "--out", "many"]);
        assert!(!is_fine, "{more}: {printed}");
        assert!(
            printed.contains("error: node `look.own` failed on frame 000002_10") && printed.contains(told),
            "{more}: {printed}"
        );
        let recording = Recording::open(flow.path("many.partial/recording.mcap")).expect("readable");
        assert_eq!(recording.frames(RunId(0)).len(), 2, "{more}");
        assert_eq!(flow.parts(), Vec::<u32>::new());
    }
}

#[test]
fn failures_leave_the_tombstones_that_a_run_leaves() {
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
        let (is_fine, printed) =
            flow.run(&[&["own.yaml", "--allow-exec", "--out", "many", "--overwrite"], more].concat());
        assert!(!is_fine && printed.contains("these depths are odd"), "{printed}");
        let (one, many) = (format!("one{suffix}"), format!("many{suffix}"));
        assert!(flow.recording(&one) == flow.recording(&many), "the recordings differ: {printed}");
    }
}

#[test]
fn whatever_is_killed_the_rest_ends_and_the_recording_can_be_read() {
    let long = of_dora("values: struct").replace("0..6", "0..4000");
    for victim in ["look.stereo", "recorder", "look.own.dora", "dora", "stop"] {
        let Some(flow) = Flow::new("dora: parts that are killed", &long) else { return };
        let written = flow.write(&["own.yaml", "--allow-exec", "--out", "many"]);
        assert!(written.status.success());
        let recording = flow.path("many.partial/recording.mcap");
        let is_recording = || fs::metadata(&recording).is_ok_and(|file| file.len() > 2 << 20);
        let mut begun = None;
        // As in `ran`: dora does not always begin.
        for _ in 0..3 {
            let log = fs::File::create(flow.path("log")).expect("a log");
            let mut ran =
                flow.command().stdout(log.try_clone().expect("a log")).stderr(log).spawn().expect("dora starts");
            let until = Instant::now() + Duration::from_secs(150);
            while !is_recording() && Instant::now() < until && ran.try_wait().expect("it is ours").is_none() {
                std::thread::sleep(Duration::from_millis(20));
            }
            if is_recording() {
                begun = Some(ran);
                break;
            }
            let _ = ran.kill();
            ran.wait().expect("it ends");
            wait_for(|| flow.parts().is_empty(), "all parts end");
        }
        let mut ran = begun.expect("one of three dataflows begins");
        match victim {
            "dora" => ran.kill().expect("killed"),
            "stop" => signal("INT", ran.id()),
            part => {
                let is_it = |line: &str| match part.strip_suffix(".dora") {
                    Some(_) => line.contains("node.py"),
                    None => line.contains(&format!("--part\0{part}\0")),
                };
                let cwd = flow.folder.path().canonicalize().expect("there");
                for number in processes(|number, line| {
                    is_it(line) && fs::read_link(format!("/proc/{number}/cwd")).is_ok_and(|at| at == cwd)
                }) {
                    signal("KILL", number);
                }
            }
        }
        let begun = Instant::now();
        let status = ran.wait().expect("it ends");
        assert!(begun.elapsed() < Duration::from_secs(180), "{victim}");
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

fn processes(is_meant: impl Fn(u32, &str) -> bool) -> Vec<u32> {
    let all = fs::read_dir("/proc").expect("/proc").flatten();
    let numbers = all.filter_map(|process| process.file_name().to_str()?.parse::<u32>().ok());
    let line = |number: u32| fs::read(format!("/proc/{number}/cmdline")).unwrap_or_default();
    numbers.filter(|number| is_meant(*number, &String::from_utf8_lossy(&line(*number)))).collect()
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

/// A program that stands for a Python with dora's library: it prints `says`, and waits.
fn stand_in(folder: &Path, name: &str, says: &str) -> PathBuf {
    let program = folder.join(name);
    // It keeps its standard output open, as a bridge that waits does.
    let script = format!("#!/bin/sh\nexec 3>&1\nprintf '{says}'\nexec cat > /dev/null\n");
    // Another process writes it: one that this process has open for writing cannot be started.
    let write = format!("cat > {0} && chmod +x {0}", program.display());
    let mut child = Command::new("sh").args(["-c", &write]).stdin(Stdio::piped()).spawn().expect("sh");
    child.stdin.take().expect("a pipe").write_all(script.as_bytes()).expect("written");
    assert!(child.wait().expect("ended").success());
    program
}

#[test]
fn a_dataflow_that_does_not_start_ends_with_the_names_of_its_nodes() {
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
    // `{"ready":true}` has 14 bytes; its lengths are of 4 and 8 bytes.
    let ready = r#"\016\000\000\000\000\000\000\000\000\000\000\000{"ready":true}"#;
    for (name, says, told) in [
        ("silent", "", "error: dora did not let node `recorder` begin within 1 s"),
        ("ready", ready, "error: not started within 1 s: `look.source`, `look.stereo` of the dataflow"),
    ] {
        let python = stand_in(folder.path(), name, says);
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
        let said = String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(output.status.code() == Some(1) && said.contains(told) && said.contains("--start-timeout"), "{said}");
    }
}

#[test]
fn what_cannot_begin_says_why() {
    let Some(flow) = Flow::new("dora: what cannot begin", &of_dora("values: struct")) else { return };
    let told = |output: &Output| {
        assert_eq!(output.status.code(), Some(2));
        assert_eq!(output.stdout, b"");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    // A stranger's experiment starts nothing.
    let refused = told(&flow.write(&["own.yaml"]));
    assert!(refused.contains("it would start `node.py`") && refused.contains("--allow-exec"), "{refused}");
    let run = told(&flow.depthloom(&["run", "own.yaml", "--allow-exec", "--out", "x"]));
    assert!(run.contains("depthloom dora EXPERIMENT"), "{run}");
    let machine = told(&flow.write(&["own.yaml", "--allow-exec", "--machine", "nobody=jetson"]));
    assert!(
        machine.contains("`nobody`, which is not a node of the dataflow") && machine.contains("look.own.dora"),
        "{machine}"
    );
    // Not started by dora.
    let written = flow.write(&["own.yaml", "--allow-exec", "--out", "many", "--machine", "*.stereo=jetson"]);
    let text = String::from_utf8(written.stdout).expect("UTF-8");
    assert!(text.contains("- id: \"look.stereo\"\n    deploy: { machine: \"jetson\" }\n"), "{text}");
    let line = text.lines().find_map(|line| line.trim().strip_prefix("args: \"dora-node ")).expect("arguments");
    let words: Vec<&str> = line.trim_end_matches('"').split(' ').collect();
    let outside = told(&flow.depthloom(&[&["dora-node"], &words[..]].concat()));
    assert!(outside.contains("dora cannot be reached") && outside.contains("`dora run dataflow.yml`"), "{outside}");
    // Another experiment, and a Python without the library.
    let (is_fine, printed) = {
        let written = flow.write(&["own.yaml", "--allow-exec", "--out", "many"]);
        assert!(written.status.success());
        let changed = of_dora("values: struct").replace("seed: 2", "seed: 3");
        fs::write(flow.path("own.yaml"), changed).expect("written");
        let ran = flow.ran();
        (ran.status.success(), plain(&[ran.stdout, ran.stderr].concat()))
    };
    assert!(
        !is_fine && printed.contains("own.yaml is another experiment than the dataflow was written of"),
        "{printed}"
    );
    let without = flow.depthloom(&["dora", "own.yaml", "--allow-exec", "--out", "many", "--python", "/nowhere/python"]);
    fs::write(flow.path("flow.yml"), without.stdout).expect("written");
    let ran = flow.ran();
    let printed = plain(&[ran.stdout, ran.stderr].concat());
    assert!(
        !ran.status.success() && printed.contains("failed to start `/nowhere/python`, which dora is reached by"),
        "{printed}"
    );
    assert!(!Path::new(&flow.path("many")).exists() && !flow.path("many.partial").exists());
}
