//! `depthloom export`: what other programs read is what was recorded, and nothing of anybody's is in danger.

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
    score: { truth: source/depth, estimates: { stereo: depth/depth } }
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

    /// Exports what must be refused; what is said.
    fn refused(&self, arguments: &[&str]) -> String {
        let output = self.command("export", &["run"]).args(arguments).output().expect("the binary starts");
        let said = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        said
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
fn what_is_exported_is_what_was_recorded() {
    let Some(python) = python("what_is_exported_is_what_was_recorded") else { return };
    let look = Look::new();
    look.export(&["--format", "png,npy,pfm", "--out", "all", "--quiet"]);
    look.export(&["--format", "ply,pcd", "--range", "30..2", "--out", "all", "--quiet"]);
    look.export(&["*/depth", "stereo", "--colormap", "turbo", "--range", "0..40", "--out", "all", "--quiet"]);
    let mut check = Command::new(python);
    check.arg(workspace().join("tests/python/check_export.py")).arg(look.path("run/recording.mcap"));
    let counts: Json = serde_json::from_slice(&succeed(check.arg(look.path("all"))).stdout).expect("JSON");
    // Two frames of: two images; three masks or maps of them; of numbers three depths, a weight, two true disparities
    // and one of stereo.
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
fn fault_55_images_that_are_exported_as_jpeg_are_reported_as_that() {
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
    let told = command(&["export", "run", "source/left", "--format", "png", "--out", "all", "--json"]);
    let told: Json = serde_json::from_slice(&told.stdout).expect("JSON");
    let shown = told.to_string();
    assert!(shown.contains("<frame>.jpg") && !shown.contains("<frame>.png"), "{told:#}");
    assert!(files(&path("all")).iter().all(|file| file.ends_with(".jpg")), "{:?}", files(&path("all")));
}

#[test]
fn a_frame_number_means_the_same_frame_to_export_and_figure() {
    let look = Look::new();
    for frames in ["4", "4..5", "000004_10"] {
        let figure = ["run", "panels", "--out", "panels.svg", "--frames", frames];
        let about = text(&succeed(&mut look.command("figure", &figure)).stdout);
        assert!(about.contains("000004_10") && !about.contains("000003_10"), "{frames}: {about}");
    }
    // There are the frames 3 and 4.
    for command in [["export", "run", "--out", "none"], ["figure", "run", "panels", "--out=none.svg"]] {
        let output = look.command(command[0], &command[1..]).args(["--frames", "0"]).output().expect("it starts");
        let said = text(&output.stderr);
        assert!(output.status.code() == Some(2) && said.contains("there is no frame 0"), "{said}");
    }
}

#[test]
fn topics_and_frames_are_named_as_people_name_them() {
    let look = Look::new();
    for (arguments, wanted) in [
        (
            &["depth/depth", "--frames", "3,4"][..],
            &["look/depth/depth/000003_10.png", "look/depth/depth/000004_10.png"][..],
        ),
        (&["/look/stereo/*", "--frames", "3..4"], &["look/stereo/disparity/000003_10.png"]),
        (&["sobel", "--frames", "4", "--format", "npy"], &["look/sobel/weight/000004_10.npy"]),
        (&["sobel", "--frames", "000004_10", "--format", "npy"], &["look/sobel/weight/000004_10.npy"]),
        // An output of the source, where no node has that name; `depth` is the node.
        (&["calibration"], &["look/source/calibration.parquet"]),
        (&["depth", "--frames", "3"], &["look/depth/depth/000003_10.png"]),
    ] {
        let out = look.path("out");
        look.export(&[arguments, &["--out", "out", "--quiet"]].concat());
        assert_eq!(files(&out), wanted, "{arguments:?}");
        std::fs::remove_dir_all(out).expect("removed");
    }
    let told: Json = serde_json::from_slice(&look.export(&["stereo", "--out", "out", "--json"]).stdout).expect("JSON");
    let topic = json!({
        "topic": "/look/stereo/disparity", "type": "disparity", "format": "png", "path": "look/stereo/disparity/<frame>.png",
        "files": 2, "clipped_pixels": told["topics"][0]["clipped_pixels"],
    });
    assert_eq!(told, json!({ "format": told["format"], "folder": "out", "condition": "whole", "topics": [topic] }));
    for (arguments, said) in [
        (&["detph"][..], "did you mean `depth`?"),
        (&["source/calibration", "--format", "png"], "it can be parquet"),
        (&["source/left", "--format", "pfm"], "it can be png, npy"),
        (&["--format", "onnx"], "nothing that was recorded can be exported as onnx"),
        (&["--frames", "9"], "there is no frame 9"),
        (&["--frames", "000009_10"], "there is no frame `000009_10`"),
        (&["--frames", "3-4"], "did you mean `3..=4`?"),
        (&["--range", "0..40"], "add --colormap"),
        (&["--range", "3..3", "--format", "ply"], "two different numbers"),
        (&["source/left", "--colormap", "grey"], "--colormap colours nothing"),
    ] {
        let refused = look.refused(&[arguments, &["--out", "none"]].concat());
        assert!(refused.contains(said), "{arguments:?}: {refused}");
        assert!(!look.path("none").exists(), "{arguments:?}");
    }
}

#[test]
fn nothing_of_anybodys_is_replaced_unless_asked_for() {
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
    // An export's own folder takes another.
    look.export(&["depth/depth", "--out", "ours"]);
    look.export(&["depth/depth", "--out", "ours"]);
    assert!(look.refused(&["--out", "run"]).contains("is a run's folder"));
    assert!(look.refused(&["--out", "run/exported", "--overwrite"]).contains("is a run's folder"));
    assert!(look.refused(&["--out", "look.yaml", "--overwrite"]).contains("is not a folder"));
}

#[test]
fn of_a_damaged_recording_what_can_be_read_is_exported() {
    let look = Look::new();
    let recording = look.path("run/recording.mcap");
    let mut bytes = std::fs::read(&recording).expect("a recording");
    // All through the first frame's values.
    let first = bytes.len() / 8..bytes.len() * 3 / 8;
    first.step_by(512).for_each(|at| bytes[at] ^= 1);
    std::fs::write(&recording, bytes).expect("written");
    let output = look.command("export", &["run", "--out", "left"]).output().expect("the binary starts");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("left out") && said.contains("000003_10"), "{said}");
    assert!(files(&look.path("left")).iter().all(|file| !file.contains("000003_10")));
    assert!(files(&look.path("left")).contains(&"look/depth/depth/000004_10.png".to_owned()));
}

#[test]
fn without_a_calibration_there_are_no_points() {
    let look = Look::new();
    let yaml = std::fs::read_to_string(look.path("look.yaml")).expect("a file");
    std::fs::write(look.path("bare.yaml"), yaml.replace("record: [source,", "record: [")).expect("written");
    succeed(&mut look.command("run", &["bare.yaml", "--quiet", "--out", "bare"]));
    let mut export = look.command("export", &["bare", "depth", "--format", "ply", "--out", "none"]);
    let output = export.output().expect("the binary starts");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("`source/calibration`"), "{}", text(&output.stderr));
    let not_there =
        look.command("export", &["bare", "source/left", "--out", "none"]).output().expect("the binary starts");
    assert!(text(&not_there.stderr).contains("was not recorded"), "{}", text(&not_there.stderr));
}

#[test]
fn rows_are_exported_as_parquet_a_file_a_topic() {
    let look = Look::new();
    let rows = ["score.stereo", "source/calibration"];
    let told = look.export(&[&rows[..], &["--out", "out", "--json"]].concat());
    let told: Json = serde_json::from_slice(&told.stdout).expect("JSON");
    let topics = told["topics"].as_array().expect("topics").iter();
    let topics: Vec<_> = topics.map(|of| (of["type"].clone(), of["format"].clone(), of["files"].clone())).collect();
    let of = |value_type: &str| (json!(value_type), json!("parquet"), json!(1));
    assert_eq!(topics, [of("calibration"), of("scores")]);
    let wanted = ["look/score.stereo/rows.parquet", "look/source/calibration.parquet"];
    assert_eq!(files(&look.path("out")), wanted);
    for file in wanted {
        let bytes = std::fs::read(look.path("out").join(file)).expect("a file");
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"), "{file}");
    }
}

#[test]
fn learnt_networks_and_curves_are_exported_as_they_lie_beside_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let (experiment, out) = (crate::reuse::experiment(folder.path()), folder.path().join("run"));
    succeed(depthloom().args(["run", "--no-page"]).arg(&experiment).args(["--quiet", "--out"]).arg(&out));
    let export = folder.path().join("export");
    succeed(depthloom().arg("export").arg(&out).args(["teacher", "--quiet", "--out"]).arg(&export));
    assert_eq!(files(&export), ["learn/teacher/curve.parquet", "learn/teacher/model.onnx"]);
    let model = std::fs::read(export.join("learn/teacher/model.onnx")).expect("a model");
    assert_eq!(files(&out.join("models")), ["learn.teacher.onnx"]);
    assert!(std::fs::read(out.join("models/learn.teacher.onnx")).expect("a model") == model);
    assert!(std::fs::metadata(export.join("learn/teacher/curve.parquet")).expect("a curve").len() > 100);
    // It is the network that the run's own stages read: another experiment takes it as a file.
    let recording = depthloom_recording::Recording::open(out.join("recording.mcap")).expect("a recording");
    let kept = recording.attachments().iter().filter(|of| of.name.starts_with("artifacts/"));
    assert!(kept.clone().any(|of| recording.attachment(&of.name).expect("its bytes") == model));
}
