//! Faults in the experiment language and in the files that sources read.

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{depthloom, read_csv, succeed};

/// A folder with a small data set in KITTI's layout in `data/`, and an experiment on it that extends a file in the
/// parent folder.
struct Project {
    folder: tempfile::TempDir,
}

const BASE: &str = "experiment: base
sources: { street: { kind: kitti/stereo2015, with: { root: data, ground_truth: occ } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 64 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
    score: { ground_truth: source/depth, estimates: { stereo: { from: depth/depth, sets: [valid] } } }
";

impl Project {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let size = ["--width", "320", "--height", "96", "--frames", "3", "--quiet"];
        succeed(depthloom().arg("synth").arg(folder.path().join("data")).args(size));
        fs::create_dir(folder.path().join("exps")).expect("created");
        let project = Self { folder };
        project.write("base.yaml", BASE);
        project.write("exps/main.yaml", "# As written.\nextends: ../base.yaml\nexperiment: main\n");
        project
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        fs::write(self.path(name), text).expect("written");
        self.path(name)
    }

    fn run(&self, experiment: &Path, out: &str, arguments: &[&str]) -> (Option<i32>, String) {
        let mut run = depthloom();
        run.current_dir(self.folder.path()).args(["run", "--no-page"]).arg(experiment).args([
            "--quiet",
            "--workers",
            "2",
            "--out",
            out,
        ]);
        let output = run.args(arguments).output().expect("the binary starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }

    /// Exit code and standard error of `check`.
    fn check(&self, experiment: &Path, arguments: &[&str]) -> (Option<i32>, String) {
        let mut check = depthloom();
        let output = check.current_dir(self.folder.path()).arg("check").arg(experiment).args(arguments).output();
        let output = output.expect("the binary starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

#[test]
fn fault_10_an_experiments_name_cannot_leave_the_runs_folder() {
    let project = Project::new();
    let evil = project.write("evil.yaml", &BASE.replace("experiment: base", "experiment: ../../evil"));
    fs::create_dir_all(project.path("a/b")).expect("created");
    let mut run = depthloom();
    let output = run
        .current_dir(project.path("a/b"))
        .args(["run", "--no-page", "--quiet"])
        .arg(&evil)
        .output()
        .expect("started");
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(!project.path("a/evil").exists() && !project.path("evil").exists() && !project.path("a/b/runs").exists());
}

#[test]
fn fault_29_and_32_recorded_frames_are_counted_within_the_selection() {
    let project = Project::new();
    let set = |frames: &str| format!("sources.street.with.frames={frames}");
    // Frames that do not exist are an error, unless `available` is given.
    let main = project.path("exps/main.yaml");
    let (code, stderr) = project.run(&main, "beyond", &["--set", &set("1..=7")]);
    assert_eq!(code, Some(2), "{stderr}");
    assert!(stderr.contains("there is no frame 3") && stderr.contains("`1..=7 available`"), "{stderr}");
    // Repeated frames and invalid syntax are found by `check`.
    for frames in ["[1, 1]", "1-2", "\"1,2\"", "ids"] {
        let (code, stderr) = project.check(&main, &["--set", &set(frames)]);
        assert_eq!(code, Some(2), "{frames}: {stderr}");
    }
    // Of frames 1 and 2, the first is recorded, although no index is a multiple of 100.
    let more = ["--set", &set("1..=7 available"), "--set", "record={every: 100}"];
    let (code, stderr) = project.run(&main, "run", &more);
    assert_eq!(code, Some(0), "{stderr}");
    let stderr = stderr.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(stderr.contains("of the frames 1 to 7, 5 of 7 do not exist: 2 are used, 1 to 2"), "{stderr}");
    let scores = read_csv(&project.path("run/scores.csv"));
    assert_eq!(scores.len(), 2, "{scores:?}");
    let distances =
        fs::read_to_string(project.path("run/error_vs_distance.csv")).expect("the maps of a frame were recorded");
    assert!(distances.lines().count() > 1, "{distances}");
}

#[test]
fn fault_35_the_experiment_in_a_run_folder_can_be_checked_and_run() {
    let project = Project::new();
    let (code, stderr) =
        project.run(&project.path("exps/main.yaml"), "first", &["--set", "look.stereo.with.disparities=48"]);
    assert_eq!(code, Some(0), "{stderr}");
    let written = fs::read_to_string(project.path("first/experiment.yaml")).expect("the copy");
    assert_eq!(written.lines().nth(1), Some("# As written."), "after a line about the run's settings: {written}");
    // The run folder was moved, and the extended files were removed.
    fs::remove_dir_all(project.path("exps")).expect("removed");
    fs::remove_file(project.path("base.yaml")).expect("removed");
    fs::create_dir(project.path("moved")).expect("created");
    fs::rename(project.path("first"), project.path("moved/first")).expect("moved");
    for name in ["experiment.yaml", "experiment.resolved.yaml"] {
        let copy = project.path("moved/first").join(name);
        let (code, stderr) = project.check(&copy, &[]);
        assert_eq!(code, Some(0), "{name}: {stderr}");
    }
    let (code, stderr) = project.run(&project.path("moved/first/experiment.resolved.yaml"), "second", &[]);
    assert_eq!(code, Some(0), "{stderr}");
    let scores = |run: &str| read_csv(&project.path(run).join("scores.csv"));
    assert_eq!(scores("second"), scores("moved/first"));
}

#[test]
fn fault_52_an_oversized_image_is_refused_with_its_size() {
    let project = Project::new();
    let left = project.path("data/training/image_2/000000_10.png");
    let mut bytes = fs::read(&left).expect("read");
    bytes[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
    let checksum = crc(&bytes[12..29]).to_be_bytes();
    bytes[29..33].copy_from_slice(&checksum);
    fs::write(&left, bytes).expect("written");
    let (code, stderr) = project.run(&project.path("exps/main.yaml"), "run", &[]);
    assert_eq!(code, Some(3), "{stderr}");
    assert!(stderr.contains("60000x60000, which takes") && stderr.contains("more than the 512 MiB"), "{stderr}");
    assert!(!stderr.contains("download"), "{stderr}");
}

/// The checksum of a PNG's chunk.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 })
    })
}

#[cfg(unix)]
#[test]
fn special_files_are_refused_without_waiting() {
    let project = Project::new();
    let pipe = project.path("pipe.yaml");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo").success());
    let main = |text: &str| project.write("exps/other.yaml", text);
    for name in ["../pipe.yaml", "/dev/zero", "..", "/dev/tty", "loop.yaml"] {
        let link = project.path("exps/loop.yaml");
        let _ = fs::remove_file(&link);
        std::os::unix::fs::symlink("loop.yaml", &link).expect("a link to itself");
        for text in [
            format!("extends: {name}\nexperiment: x\n"),
            BASE.replace("nodes:\n", &format!("nodes:\n      graph: {name}\n")),
        ] {
            let (code, stderr) = project.check(&main(&text), &[]);
            assert_eq!(code, Some(2), "{name}: {stderr}");
            assert!(stderr.contains("failed to read"), "{name}: {stderr}");
        }
    }
    let (code, _) = project.check(&pipe, &[]);
    assert_eq!(code, Some(2));
    let frames = ["--set", "sources.street.with.frames=./pipe.yaml"];
    let (code, stderr) = project.run(&project.path("exps/main.yaml"), "run", &frames);
    assert_eq!(code, Some(2), "{stderr}");
    let left = project.path("data/training/image_2/000000_10.png");
    fs::remove_file(&left).expect("removed");
    fs::rename(&pipe, &left).expect("moved");
    let (code, stderr) = project.run(&project.path("exps/main.yaml"), "run", &[]);
    assert_eq!(code, Some(3), "{stderr}");
}
