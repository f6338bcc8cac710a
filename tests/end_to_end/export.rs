//! `depthloom export`: exported files contain the recorded values, and no foreign file is replaced.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value as Json, json};

use crate::support::{depthloom, python, succeed, workspace};

/// A run over two small frames that has every kind of map.
struct Look {
    folder: tempfile::TempDir,
}

impl Look {
    fn new() -> Self {
        let look = Self { folder: tempfile::tempdir().expect("a folder") };
        let text = "experiment: look
sources: { street: { kind: synthetic/road, with: { frames: 3..5, width: 320, height: 96, disparities: true } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration }, with: { cap: 1000 } }
      sobel: { kind: confidence/sobel, inputs: { image: source/left } }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }
record: [source, stereo, depth, sobel]
";
        std::fs::write(look.path("look.yaml"), text).expect("written");
        succeed(&mut look.command("run", &["look.yaml", "--quiet", "--out", "run"]));
        look
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, command: &str, arguments: &[&str]) -> Command {
        let mut program = depthloom();
        program.current_dir(self.folder.path()).arg(command).args(arguments);
        program
    }

    fn export(&self, arguments: &[&str]) -> Output {
        succeed(self.command("export", &["run"]).args(arguments))
    }

    /// Standard error of an export that must be refused.
    fn refused(&self, arguments: &[&str]) -> String {
        let output = self.command("export", &["run"]).args(arguments).output().expect("the binary starts");
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {stderr}");
        stderr
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("UTF-8")
}

/// The files below a folder, by their paths in it.
fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).expect("a folder") {
            let path = entry.expect("an entry").path();
            match path.is_dir() {
                true => folders.push(path),
                false => found.push(path.strip_prefix(folder).expect("below").to_string_lossy().into_owned()),
            }
        }
    }
    found.retain(|file| !file.starts_with('.'));
    found.sort();
    found
}

#[test]
fn exported_files_contain_the_recorded_values() {
    let Some(python) = python("exported_files_contain_the_recorded_values") else { return };
    let look = Look::new();
    look.export(&["--format", "png,npy,pfm", "--out", "all", "--quiet"]);
    look.export(&["--format", "ply,pcd", "--range", "30..2", "--out", "all", "--quiet"]);
    look.export(&["*/depth", "stereo", "--colormap", "turbo", "--range", "0..40", "--out", "all", "--quiet"]);
    let mut check = Command::new(python);
    check.arg(workspace().join("tests/python/check_export.py")).arg(look.path("run/recording.mcap"));
    let counts: Json = serde_json::from_slice(&succeed(check.arg(look.path("all"))).stdout).expect("JSON");
    // Per frame: two images, three masks or image maps, three depths, a confidence, two disparities of the ground truth
    // and one of stereo. There are two frames.
    let maps = 2 * (3 + 1 + 2 + 1);
    let clouds = 2 * (3 + 2 + 1);
    let images = counts["npy"].as_u64().expect("a count") - maps;
    assert!(images >= 2 * 3, "{counts}");
    assert_eq!(
        counts,
        json!({ "png": maps + images, "npy": maps + images, "pfm": maps, "ply": clouds, "pcd": clouds, "turbo": 6 })
    );
}

#[test]
fn fault_55_images_exported_as_jpeg_are_reported_as_jpeg() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    for camera in ["cam0", "cam1"] {
        std::fs::create_dir(path(camera)).expect("a folder");
        let jpeg = workspace().join("tests/fixtures/golden/decoding/420_60.jpg");
        std::fs::copy(jpeg, path(camera).join("1.jpg")).expect("copied");
    }
    let text = "experiment: jpeg
sources: { pairs: { kind: images, with: { root: ., left: cam0/*.jpg, right: cam1/*.jpg } } }
stages: { look: { source: pairs, nodes: { edges: { kind: confidence/sobel, inputs: { image: source/left } } } } }
record: [source, edges]
";
    std::fs::write(path("jpeg.yaml"), text).expect("written");
    // Fault 18: `root: .` of an experiment in the working folder.
    let command = |arguments: &[&str]| {
        let mut program = depthloom();
        program.current_dir(folder.path()).args(arguments);
        succeed(&mut program)
    };
    command(&["run", "--no-page", "jpeg.yaml", "--quiet", "--out", "run"]);
    let output = command(&["export", "run", "source/left", "--format", "png", "--out", "all", "--json"]);
    let export: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    let text = export.to_string();
    assert!(text.contains("<frame>.jpg") && !text.contains("<frame>.png"), "{export:#}");
    assert!(files(&path("all")).iter().all(|file| file.ends_with(".jpg")), "{:?}", files(&path("all")));
}

#[test]
fn a_frame_number_means_the_same_frame_to_export_and_figure() {
    let look = Look::new();
    for frames in ["4", "4..5", "000004_10"] {
        let figure = ["run", "panels", "--out", "panels.svg", "--frames", frames];
        let printed = text(&succeed(&mut look.command("figure", &figure)).stdout);
        assert!(printed.contains("000004_10") && !printed.contains("000003_10"), "{frames}: {printed}");
    }
    // The run has frames 3 and 4.
    for command in [["export", "run", "--out", "none"], ["figure", "run", "panels", "--out=none.svg"]] {
        let output = look.command(command[0], &command[1..]).args(["--frames", "0"]).output().expect("it starts");
        let stderr = text(&output.stderr);
        assert!(output.status.code() == Some(2) && stderr.contains("there is no frame 0"), "{stderr}");
    }
}

#[test]
fn topics_and_frames_are_selected_by_name() {
    let look = Look::new();
    for (arguments, expected) in [
        (
            &["depth/depth", "--frames", "3,4"][..],
            &["look/depth/depth/000003_10.png", "look/depth/depth/000004_10.png"][..],
        ),
        (&["/look/stereo/*", "--frames", "3..4"], &["look/stereo/disparity/000003_10.png"]),
        (&["sobel", "--frames", "4", "--format", "npy"], &["look/sobel/weight/000004_10.npy"]),
        (&["sobel", "--frames", "000004_10", "--format", "npy"], &["look/sobel/weight/000004_10.npy"]),
        // An output of the source, because no node has that name; `depth` is a node.
        (&["calibration"], &["look/source/calibration.parquet"]),
        (&["depth", "--frames", "3"], &["look/depth/depth/000003_10.png"]),
    ] {
        let out = look.path("out");
        look.export(&[arguments, &["--out", "out", "--quiet"]].concat());
        assert_eq!(files(&out), expected, "{arguments:?}");
        std::fs::remove_dir_all(out).expect("removed");
    }
    let export: Json =
        serde_json::from_slice(&look.export(&["stereo", "--out", "out", "--json"]).stdout).expect("JSON");
    let topic = json!({
        "topic": "/look/stereo/disparity", "type": "disparity", "format": "png", "path": "look/stereo/disparity/<frame>.png",
        "files": 2, "clipped_pixels": export["topics"][0]["clipped_pixels"],
    });
    assert_eq!(
        export,
        json!({ "format": export["format"], "folder": "out", "condition": "complete", "topics": [topic] })
    );
    for (arguments, message) in [
        (&["detph"][..], "did you mean `depth`?"),
        (&["source/calibration", "--format", "png"], "it can be parquet"),
        (&["source/left", "--format", "pfm"], "it can be png, npy"),
        (&["--format", "onnx"], "nothing that was recorded can be exported as onnx"),
        (&["--frames", "9"], "there is no frame 9"),
        (&["--frames", "000009_10"], "there is no frame `000009_10`"),
        (&["--frames", "3-4"], "did you mean `3..=4`?"),
        (&["--range", "0..40"], "add `--colormap turbo`"),
        (&["--range", "3..3", "--format", "ply"], "two different numbers"),
        (&["source/left", "--colormap", "grey"], "--colormap has no effect"),
    ] {
        let refused = look.refused(&[arguments, &["--out", "none"]].concat());
        assert!(refused.contains(message), "{arguments:?}: {refused}");
        assert!(!look.path("none").exists(), "{arguments:?}");
    }
}

#[test]
fn existing_files_are_replaced_only_with_overwrite() {
    let look = Look::new();
    let file = look.path("mine/look/depth/depth/000003_10.png");
    std::fs::create_dir_all(file.parent().expect("a folder")).expect("made");
    std::fs::write(&file, "mine").expect("written");
    let refused = look.refused(&["depth/depth", "--out", "mine"]);
    assert!(refused.contains("000003_10.png exists already") && refused.contains("--overwrite"), "{refused}");
    assert_eq!(files(&look.path("mine")).len(), 1);
    assert_eq!(std::fs::read(&file).expect("a file"), b"mine");
    look.export(&["depth/depth", "--out", "mine", "--overwrite"]);
    assert_ne!(std::fs::read(&file).expect("a file"), b"mine");
    // The folder of an earlier export may be reused.
    look.export(&["depth/depth", "--out", "ours"]);
    look.export(&["depth/depth", "--out", "ours"]);
    assert!(look.refused(&["--out", "run"]).contains("is a run's folder"));
    assert!(look.refused(&["--out", "run/exported", "--overwrite"]).contains("is a run's folder"));
    assert!(look.refused(&["--out", "look.yaml", "--overwrite"]).contains("is not a folder"));
}

#[test]
fn readable_frames_of_a_damaged_recording_are_exported() {
    let look = Look::new();
    let recording = look.path("run/recording.mcap");
    let mut bytes = std::fs::read(&recording).expect("a recording");
    // Throughout the first frame's values.
    let first = bytes.len() / 8..bytes.len() * 3 / 8;
    first.step_by(512).for_each(|at| bytes[at] ^= 1);
    std::fs::write(&recording, bytes).expect("written");
    let output = look.command("export", &["run", "--out", "left"]).output().expect("the binary starts");
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{stderr}");
    assert!(stderr.contains("not exported") && stderr.contains("000003_10"), "{stderr}");
    assert!(files(&look.path("left")).iter().all(|file| !file.contains("000003_10")));
    assert!(files(&look.path("left")).contains(&"look/depth/depth/000004_10.png".to_owned()));
}

#[test]
fn point_clouds_need_a_calibration() {
    let look = Look::new();
    let yaml = std::fs::read_to_string(look.path("look.yaml")).expect("a file");
    std::fs::write(look.path("bare.yaml"), yaml.replace("record: [source,", "record: [")).expect("written");
    succeed(&mut look.command("run", &["bare.yaml", "--quiet", "--out", "bare"]));
    let mut export = look.command("export", &["bare", "depth", "--format", "ply", "--out", "none"]);
    let output = export.output().expect("the binary starts");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("`source/calibration`"), "{}", text(&output.stderr));
    let missing =
        look.command("export", &["bare", "source/left", "--out", "none"]).output().expect("the binary starts");
    assert!(text(&missing.stderr).contains("was not recorded"), "{}", text(&missing.stderr));
    // A misspelt topic that was not recorded is not suggested.
    let misspelt =
        look.command("export", &["bare", "source/lef", "--out", "none"]).output().expect("the binary starts");
    let error = text(&misspelt.stderr);
    assert!(error.contains("the run has no topic `source/lef`") && !error.contains("source/left"), "{error}");
}

#[test]
fn rows_are_exported_as_one_parquet_file_per_topic() {
    let look = Look::new();
    let rows = ["score.stereo", "source/calibration"];
    let output = look.export(&[&rows[..], &["--out", "out", "--json"]].concat());
    let export: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    let topics = export["topics"].as_array().expect("topics").iter();
    let topics: Vec<_> =
        topics.map(|topic| (topic["type"].clone(), topic["format"].clone(), topic["files"].clone())).collect();
    let parquet = |value_type: &str| (json!(value_type), json!("parquet"), json!(1));
    assert_eq!(topics, [parquet("calibration"), parquet("scores")]);
    let expected = ["look/score.stereo/rows.parquet", "look/source/calibration.parquet"];
    assert_eq!(files(&look.path("out")), expected);
    for file in expected {
        let bytes = std::fs::read(look.path("out").join(file)).expect("a file");
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"), "{file}");
    }
}

#[test]
fn exported_networks_and_curves_equal_those_of_the_run_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    let (experiment, out) = (crate::reuse::experiment(folder.path()), folder.path().join("run"));
    succeed(depthloom().args(["run", "--no-page"]).arg(&experiment).args(["--quiet", "--out"]).arg(&out));
    let export = folder.path().join("export");
    succeed(depthloom().arg("export").arg(&out).args(["train", "--quiet", "--out"]).arg(&export));
    assert_eq!(files(&export), ["learn/train/curve.parquet", "learn/train/model.onnx"]);
    let model = std::fs::read(export.join("learn/train/model.onnx")).expect("a model");
    assert_eq!(files(&out.join("models")), ["learn.train.onnx"]);
    assert!(std::fs::read(out.join("models/learn.train.onnx")).expect("a model") == model);
    assert!(std::fs::metadata(export.join("learn/train/curve.parquet")).expect("a curve").len() > 100);
    // It equals the recorded network that the run's stages used.
    let recording = depthloom_recording::Recording::open(out.join("recording.mcap")).expect("a recording");
    let artifacts = recording.attachments().iter().filter(|attachment| attachment.name.starts_with("artifacts/"));
    assert!(artifacts.clone().any(|entry| recording.attachment(&entry.name).expect("its bytes") == model));
}
