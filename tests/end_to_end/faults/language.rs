//! Faults of the experiment language and what sources read.

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{depthloom, read_csv, succeed};

/// A folder with a small data set of KITTI's layout in `data/`, and an experiment on it that extends a file one folder
/// up.
struct Project {
    folder: tempfile::TempDir,
}

const BASE: &str = "experiment: base
sources: { street: { kind: kitti/stereo2015, with: { root: data, truth: occ } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 64 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
    score: { truth: source/depth, estimates: { stereo: { from: depth/depth, sets: [valid] } } }
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

    /// The exit code and what was said of an experiment.
    fn check(&self, experiment: &Path, arguments: &[&str]) -> (Option<i32>, String) {
        let mut check = depthloom();
        let output = check.current_dir(self.folder.path()).arg("check").arg(experiment).args(arguments).output();
        let output = output.expect("the binary starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

#[test]
fn fault_10_no_name_leads_out_of_the_folder_of_runs() {
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
fn fault_29_and_32_frames_are_counted_as_they_are_selected() {
    let project = Project::new();
    let set = |frames: &str| format!("sources.street.with.frames={frames}");
    // Beyond what is there: an error that says so, unless what is there is enough.
    let main = project.path("exps/main.yaml");
    let (code, said) = project.run(&main, "beyond", &["--set", &set("1..=7")]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("there is no frame 3") && said.contains("`1..=7 available`"), "{said}");
    // Twice, or of no form: found by `check`.
    for frames in ["[1, 1]", "1-2", "\"1,2\"", "ids"] {
        let (code, said) = project.check(&main, &["--set", &set(frames)]);
        assert_eq!(code, Some(2), "{frames}: {said}");
    }
    // Of frames 1 and 2, the first is kept, though no index is a multiple of 100.
    let more = ["--set", &set("1..=7 available"), "--set", "record={every: 100}"];
    let (code, said) = project.run(&main, "run", &more);
    assert_eq!(code, Some(0), "{said}");
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(said.contains("of the frames 1 to 7, 5 of 7 do not exist: 2 are used, 1 to 2"), "{said}");
    let scores = read_csv(&project.path("run/scores.csv"));
    assert_eq!(scores.len(), 2, "{scores:?}");
    let distances =
        fs::read_to_string(project.path("run/error_vs_distance.csv")).expect("the maps of a frame were kept");
    assert!(distances.lines().count() > 1, "{distances}");
}

#[test]
fn fault_35_a_run_can_be_checked_and_run_again_from_its_own_folder() {
    let project = Project::new();
    let (code, said) =
        project.run(&project.path("exps/main.yaml"), "first", &["--set", "look.stereo.with.disparities=48"]);
    assert_eq!(code, Some(0), "{said}");
    let written = fs::read_to_string(project.path("first/experiment.yaml")).expect("kept");
    assert_eq!(written.lines().nth(1), Some("# As written."), "behind a line on what the run set: {written}");
    // From elsewhere, with what it extended gone.
    fs::remove_dir_all(project.path("exps")).expect("removed");
    fs::remove_file(project.path("base.yaml")).expect("removed");
    fs::create_dir(project.path("kept")).expect("created");
    fs::rename(project.path("first"), project.path("kept/first")).expect("moved");
    for name in ["experiment.yaml", "experiment.resolved.yaml"] {
        let kept = project.path("kept/first").join(name);
        let (code, said) = project.check(&kept, &[]);
        assert_eq!(code, Some(0), "{name}: {said}");
    }
    let (code, said) = project.run(&project.path("kept/first/experiment.resolved.yaml"), "second", &[]);
    assert_eq!(code, Some(0), "{said}");
    let scores = |run: &str| read_csv(&project.path(run).join("scores.csv"));
    assert_eq!(scores("second"), scores("kept/first"));
}

#[test]
fn fault_52_a_bomb_of_an_image_is_refused_with_its_size() {
    let project = Project::new();
    let left = project.path("data/training/image_2/000000_10.png");
    let mut bytes = fs::read(&left).expect("read");
    bytes[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
    let checksum = crc(&bytes[12..29]).to_be_bytes();
    bytes[29..33].copy_from_slice(&checksum);
    fs::write(&left, bytes).expect("written");
    let (code, said) = project.run(&project.path("exps/main.yaml"), "run", &[]);
    assert_eq!(code, Some(3), "{said}");
    assert!(said.contains("60000x60000, which takes") && said.contains("more than the 512 MiB"), "{said}");
    assert!(!said.contains("download"), "{said}");
}

/// The checksum of a PNG's chunk.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 })
    })
}

#[cfg(unix)]
#[test]
fn what_is_no_regular_file_is_refused_and_nobody_waits_for_it() {
    let project = Project::new();
    let pipe = project.path("pipe.yaml");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo is there").success());
    let main = |text: &str| project.write("exps/other.yaml", text);
    for name in ["../pipe.yaml", "/dev/zero", "..", "/dev/tty", "loop.yaml"] {
        let link = project.path("exps/loop.yaml");
        let _ = fs::remove_file(&link);
        std::os::unix::fs::symlink("loop.yaml", &link).expect("a link to itself");
        for text in [
            format!("extends: {name}\nexperiment: x\n"),
            BASE.replace("nodes:\n", &format!("nodes:\n      graph: {name}\n")),
        ] {
            let (code, said) = project.check(&main(&text), &[]);
            assert_eq!(code, Some(2), "{name}: {said}");
            assert!(said.contains("failed to read"), "{name}: {said}");
        }
    }
    let (code, _) = project.check(&pipe, &[]);
    assert_eq!(code, Some(2));
    let frames = ["--set", "sources.street.with.frames=./pipe.yaml"];
    let (code, said) = project.run(&project.path("exps/main.yaml"), "run", &frames);
    assert_eq!(code, Some(2), "{said}");
    let left = project.path("data/training/image_2/000000_10.png");
    fs::remove_file(&left).expect("removed");
    fs::rename(&pipe, &left).expect("moved");
    let (code, said) = project.run(&project.path("exps/main.yaml"), "run", &[]);
    assert_eq!(code, Some(3), "{said}");
}
