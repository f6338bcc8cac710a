//! Broken data: the error names the file and a remedy, and no partial run gets the final name.

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{depthloom, succeed, workspace};

/// A small generated data set in KITTI's layout, with an experiment on it, in a temporary folder.
struct Bench {
    folder: tempfile::TempDir,
    data: PathBuf,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let data = folder.path().join("data");
        let size = ["--width", "320", "--height", "96", "--frames", "3", "--quiet"];
        succeed(depthloom().arg("synth").arg(&data).args(size));
        let look = workspace().join("experiments/first-look.yaml");
        let source = "{ kind: kitti/stereo2015, with: { root: data, split: training, ground_truth: occ } }";
        let text = format!("extends: {}\nsources:\n  street: {source}\n", look.display());
        fs::write(folder.path().join("experiment.yaml"), text).expect("written");
        Self { folder, data }
    }

    fn file(&self, name: &str) -> PathBuf {
        let path = self.data.join("training").join(name);
        assert!(path.exists(), "{} is in the data set", path.display());
        path
    }

    /// Runs the experiment. Returns the exit code and standard error with shortened paths.
    fn run(&self, arguments: &[&str]) -> (Option<i32>, String) {
        let out = self.folder.path().join("run");
        let output = depthloom()
            .args(["run", "--no-page"])
            .arg(self.folder.path().join("experiment.yaml"))
            .args(["--quiet", "--workers", "2", "--out"])
            .arg(&out)
            .args(arguments)
            .output()
            .expect("the binary starts");
        (output.status.code(), self.shorten(&String::from_utf8_lossy(&output.stderr)))
    }

    fn shorten(&self, text: &str) -> String {
        text.replace(&self.folder.path().display().to_string(), "<folder>")
    }

    fn assert_no_finished_run(&self) {
        assert!(!self.folder.path().join("run").exists(), "a failed run must not look like a finished one");
    }
}

fn snapshot(name: &str, stderr: &str) {
    insta::with_settings!({ omit_expression => true }, { insta::assert_snapshot!(name, stderr); });
}

fn halve(path: &Path) {
    let bytes = fs::read(path).expect("read");
    fs::write(path, &bytes[..bytes.len() / 2]).expect("written");
}

#[test]
fn a_truncated_image_fails_its_frame() {
    let bench = Bench::new();
    halve(&bench.file("image_2/000001_10.png"));
    let (code, stderr) = bench.run(&[]);
    assert_eq!(code, Some(3), "{stderr}");
    bench.assert_no_finished_run();
    snapshot("truncated_image", &stderr);
}

#[test]
fn keep_going_skips_only_the_broken_frame() {
    let bench = Bench::new();
    halve(&bench.file("image_2/000001_10.png"));
    let (code, stderr) = bench.run(&["--keep-going"]);
    assert_eq!(code, Some(3), "{stderr}");
    let scores = fs::read_to_string(bench.folder.path().join("run/scores.csv")).expect("scores of the other frames");
    assert!(scores.contains("000000_10") && scores.contains("000002_10") && !scores.contains("000001_10"), "{scores}");
}

#[test]
fn a_missing_right_image_is_named() {
    let bench = Bench::new();
    fs::remove_file(bench.file("image_3/000002_10.png")).expect("removed");
    let (code, stderr) = bench.run(&[]);
    assert!(matches!(code, Some(2 | 3)), "{stderr}");
    bench.assert_no_finished_run();
    snapshot("missing_right_image", &stderr);
}

#[test]
fn a_pair_of_unequal_sizes_is_named() {
    let bench = Bench::new();
    let right = bench.file("image_3/000000_10.png");
    image::open(&right).expect("read").crop_imm(0, 0, 300, 96).save(&right).expect("written");
    let (code, stderr) = bench.run(&[]);
    assert_eq!(code, Some(3), "{stderr}");
    bench.assert_no_finished_run();
    snapshot("unequal_pair", &stderr);
}

#[test]
fn eight_bit_ground_truth_is_refused() {
    let bench = Bench::new();
    let ground_truth = bench.file("disp_occ_0/000000_10.png");
    image::DynamicImage::from(image::open(&ground_truth).expect("read").to_luma8())
        .save(&ground_truth)
        .expect("written");
    let (code, stderr) = bench.run(&[]);
    assert_eq!(code, Some(3), "{stderr}");
    bench.assert_no_finished_run();
    snapshot("eight_bit_truth", &stderr);
}

#[test]
fn a_bad_calibration_line_is_named() {
    let bench = Bench::new();
    let calibration = bench.data.join("training/calib_cam_to_cam/000000.txt");
    let text = fs::read_to_string(&calibration).expect("read");
    fs::write(&calibration, text.replace("P_rect_03: ", "P_rect_03: seven ")).expect("written");
    let (code, stderr) = bench.run(&[]);
    assert!(matches!(code, Some(2 | 3)), "{stderr}");
    bench.assert_no_finished_run();
    snapshot("bad_calibration", &stderr);
}

#[test]
fn an_empty_folder_is_found_before_any_frame() {
    let bench = Bench::new();
    fs::remove_dir_all(&bench.data).expect("removed");
    fs::create_dir(&bench.data).expect("created");
    let (code, stderr) = bench.run(&[]);
    assert_eq!(code, Some(2), "{stderr}");
    bench.assert_no_finished_run();
    snapshot("empty_folder", &stderr);
}

#[test]
fn a_range_without_frames_is_found_before_any_frame() {
    let bench = Bench::new();
    let (code, stderr) = bench.run(&["--set", "sources.street.with.frames=150..=155"]);
    assert_eq!(code, Some(2), "{stderr}");
    snapshot("no_frames", &stderr);
}

#[test]
fn a_missing_model_is_found_before_any_frame() {
    let bench = Bench::new();
    let output = depthloom()
        .args(["run", "--no-page", "tests/experiments/golden-onnx.yaml", "--quiet", "--out"])
        .arg(bench.folder.path().join("run"))
        .args(["--set", "sources.test.with.frames=0..3"])
        .env("KITTI_STEREO_2015", &bench.data)
        .env("MONO_MODEL", bench.folder.path().join("none.onnx"))
        .output()
        .expect("the binary starts");
    let stderr = bench.shorten(&String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("none.onnx"), "{stderr}");
    bench.assert_no_finished_run();
}
