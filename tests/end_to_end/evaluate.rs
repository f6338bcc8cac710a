//! `depthloom evaluate`: predictions on disk have the metrics of the nodes that made them; broken ones are reported.

use std::fs;
use std::path::PathBuf;
use std::process::Output;

use serde_json::Value as Json;

use crate::support::{depthloom, succeed};

/// A data set `street` in KITTI's layout, and a run `made` on it with exported maps.
struct Predictions {
    folder: tempfile::TempDir,
}

// A disparity of 0 px, which KITTI's PNG cannot hold, does not occur from 1 px on.
const EXPERIMENT: &str = "experiment: made
sources: { street: { kind: kitti/stereo2015, with: { root: street, disparities: true } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { min_disparity: 1 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
    score:
      ground_truth: source/depth
      estimates:
        depth: depth/depth
        disparity: { from: stereo/disparity, ground_truth: source/disp_occ, sets: [valid, filled], mean: pixels, metrics: [epe, d1] }
";

/// An NPY file of 32-bit floats.
fn npy(shape: &str, numbers: impl IntoIterator<Item = f32>) -> Vec<u8> {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n");
    let body = numbers.into_iter().flat_map(f32::to_le_bytes);
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes()].concat().into_iter().chain(body).collect()
}

/// The numbers of an NPY file of 32-bit floats.
fn numbers(path: PathBuf) -> Vec<f32> {
    let bytes = fs::read(path).expect("it is read");
    let start = bytes.iter().position(|byte| *byte == b'\n').expect("a header") + 1;
    bytes[start..].as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
}

impl Predictions {
    fn new() -> Self {
        let this = Self { folder: tempfile::tempdir().expect("a folder") };
        let size = ["--width", "320", "--height", "96", "--frames", "3", "--quiet"];
        succeed(depthloom().current_dir(this.folder.path()).args(["synth", "street"]).args(size));
        fs::write(this.path("made.yaml"), EXPERIMENT).expect("written");
        succeed(&mut this.command(&["run", "made.yaml", "--out", "made", "--quiet", "--no-page"]));
        succeed(&mut this.command(&["export", "made", "stereo/disparity", "--out", "out", "--quiet"]));
        succeed(&mut this.command(&["export", "made", "depth", "--format", "npy", "--out", "out", "--quiet"]));
        this
    }

    fn path(&self, file: &str) -> PathBuf {
        self.folder.path().join(file)
    }

    fn command(&self, arguments: &[&str]) -> std::process::Command {
        let mut command = depthloom();
        command.current_dir(self.folder.path()).args(arguments);
        command
    }

    fn evaluate(&self, arguments: &[&str]) -> Output {
        let target = ["evaluate", "--ground-truth", "kitti/stereo2015:street", "--no-page"];
        self.command(&target).args(arguments).output().expect("it runs")
    }

    /// What is printed to standard error by an evaluation that works.
    fn printed(&self, arguments: &[&str]) -> String {
        let output = self.evaluate(arguments);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{text}");
        text
    }

    /// Message and remedy of an evaluation that is refused.
    fn refused(&self, arguments: &[&str]) -> String {
        let output = self.evaluate(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&output.stdout));
        String::from_utf8_lossy(&output.stderr).into_owned()
    }

    /// The metrics of an estimate in a run's table, by metric.
    fn metrics(&self, run: &str, estimate: &str, pixels: &str) -> Vec<f64> {
        let table = succeed(&mut self.command(&["table", run, "--pixels", pixels, "--json"]));
        let table: Json = serde_json::from_slice(&table.stdout).expect("JSON");
        let row = table["rows"].as_array().expect("rows").iter().find(|row| row["estimate"] == estimate);
        let row = row.unwrap_or_else(|| panic!("{estimate} is not in {table}"));
        let names = ["a1", "abs_rel", "sq_rel", "rmse", "rmse_log", "silog", "epe", "d1"];
        names.iter().filter_map(|name| row["scores"][*name].as_f64().or_else(|| row[*name].as_f64())).collect()
    }
}

#[test]
fn predictions_have_the_metrics_of_the_nodes_that_made_them() {
    let made = Predictions::new();
    let maps: Vec<f32> =
        (0..3).flat_map(|frame| numbers(made.path(&format!("out/look/depth/depth/{frame:06}_10.npy")))).collect();
    fs::write(made.path("all.npy"), npy("(3, 96, 320)", maps)).expect("written");
    let estimates = ["png=out/look/stereo/disparity/*.png", "npy=out/look/depth/depth/*.npy", "all=all.npy"];
    let text = made.printed(&[&estimates[..], &["--out", "evaluated", "--baseline", "png"]].concat());
    assert!(text.contains("png: 3 files, matched by id; disparity in pixels, divided by 256 (detected"), "{text}");
    assert!(text.contains("npy: 3 files, matched by id; depth in metres (detected"), "{text}");
    assert!(text.contains("all: the array all.npy, one map per frame in their order; depth in metres"), "{text}");
    let expected = made.metrics("made", "depth", "all");
    assert_eq!(expected.len(), 6);
    for estimate in ["png", "npy", "all"] {
        assert_eq!(made.metrics("evaluated", estimate, "all"), expected, "{estimate}");
    }
    // The experiment that it prints gives the same run.
    let yaml = made.evaluate(&[&estimates[..], &["--print-yaml"]].concat());
    fs::write(made.path("evaluate.yaml"), yaml.stdout).expect("written");
    succeed(&mut made.command(&["run", "evaluate.yaml", "--out", "from-yaml", "--quiet", "--no-page"]));
    assert_eq!(
        fs::read(made.path("from-yaml/scores.csv")).expect("read"),
        fs::read(made.path("evaluated/scores.csv")).expect("read")
    );
}

#[test]
fn disparities_are_scored_as_benchmarks_do() {
    let made = Predictions::new();
    let arguments = ["sgbm=out/look/stereo/disparity/*.png", "--protocol", "kitti-stereo"];
    made.printed(&[&arguments[..], &["--out", "evaluated"]].concat());
    for pixels in ["valid", "filled"] {
        let expected = made.metrics("made", "disparity", pixels);
        assert_eq!((made.metrics("evaluated", "sgbm", pixels), expected.len()), (expected, 2), "{pixels}");
    }
}

#[test]
fn units_are_detected_and_files_are_matched_by_number_or_by_order() {
    let made = Predictions::new();
    let depth = |frame: usize| numbers(made.path(&format!("out/look/depth/depth/{frame:06}_10.npy")));
    for folder in ["mm", "inverse", "share", "order", "far"] {
        fs::create_dir(made.path(folder)).expect("made");
    }
    for frame in 0..3 {
        let write = |file: String, number: &dyn Fn(f32) -> f32| {
            fs::write(made.path(&file), npy("(96, 320)", depth(frame).into_iter().map(number))).expect("written");
        };
        write(format!("mm/depth_{frame}.npy"), &|metres| metres * 1000.0);
        write(format!("inverse/{frame:03}.npy"), &|metres| 1.0 / metres);
        write(format!("share/{frame:06}_10.npy"), &|metres| 0.2 / metres);
        write(format!("order/{}.npy", ["a", "b", "c"][frame]), &|metres| metres);
        write(format!("far/{frame:06}_10.npy"), &|metres| metres * 3.0);
    }
    let estimates = ["mm=mm/*.npy", "inverse=inverse/*.npy", "ordered=order/*.npy", "far=far/*.npy"];
    let text = made.printed(&[&estimates[..], &["--out", "evaluated"]].concat());
    assert!(text.contains("mm: 3 files, matched by number; depth in millimetres (detected"), "{text}");
    assert!(text.contains("inverse: 3 files, matched by number; inverse depth in 1/m (detected"), "{text}");
    assert!(text.contains("ordered: files are matched to frames by order"), "{text}");
    assert!(text.contains("far: its median is 3.") || text.contains("far: its median is 2."), "{text}");
    let expected = made.metrics("made", "depth", "all");
    for estimate in ["mm", "inverse", "ordered"] {
        for (found, expected) in made.metrics("evaluated", estimate, "all").iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-5 * expected, "{estimate}: {found} for {expected}");
        }
    }
}

#[test]
fn what_looks_wrong_is_a_warning() {
    let made = Predictions::new();
    let depth = |frame: usize| numbers(made.path(&format!("out/look/depth/depth/{frame:06}_10.npy")));
    for folder in ["normalised", "zeros", "mixed"] {
        fs::create_dir(made.path(folder)).expect("made");
    }
    for frame in 0..3 {
        let write = |folder: &str, number: &dyn Fn(f32) -> f32| {
            let file = made.path(&format!("{folder}/{frame:06}_10.npy"));
            fs::write(file, npy("(96, 320)", depth(frame).into_iter().map(number))).expect("written");
        };
        let unit = if frame == 1 { 1000.0 } else { 1.0 };
        write("normalised", &|metres| metres / 80.0);
        write("zeros", &|metres| if metres.is_nan() { 0.0 } else { 1.0 / metres });
        write("mixed", &|metres| if frame == 2 { f32::NAN } else { metres * unit });
    }
    let text = made.printed(&["x=normalised/*.npy", "--align", "median", "--out", "one"]);
    assert!(text.contains("x: 3 files, matched by id; depth in metres (detected"), "{text}");
    assert!(!text.contains("warning"), "{text}");
    // As many frames as the array has maps: one.
    let text = made.printed(&["x=normalised/*.npy", "--frames", "0..1", "--align", "median", "--out", "two"]);
    assert!(text.contains("2 files match no frame and are not used"), "{text}");
    // Warnings are in the JSON object, where programs read them.
    let arguments = ["zeros=zeros/*.npy", "mixed=mixed/*.npy", "--json", "--out", "three"];
    let printed = made.evaluate(&arguments);
    let run: Json = serde_json::from_slice(&printed.stdout).expect("JSON");
    let warnings = run["warnings"].to_string();
    for expected in [
        "% of its numbers are 0, which is the largest depth",
        "mixed: numbers differ by a factor of",
        "mixed: all pixels are invalid in mixed/000002_10.npy",
    ] {
        assert!(warnings.contains(expected), "{expected} is not in {warnings}");
    }
    let text = made.printed(&["x=normalised/*.npy", "--quantity", "inverse-depth", "--out", "four"]);
    assert!(text.contains("x: its numbers contradict --quantity"), "{text}");
    // Two folders with files of the same names are two estimates, also where they are compared.
    let arguments = ["a=normalised/*.npy", "b=mixed/*.npy", "--align", "median", "--baseline", "a", "--out", "five"];
    let printed = String::from_utf8_lossy(&made.evaluate(&arguments).stdout).into_owned();
    assert!(printed.contains("p_holm") && !printed.contains("identical on both sides"), "{printed}");
}

#[test]
fn broken_predictions_are_reported_before_anything_runs() {
    let made = Predictions::new();
    let write = |file: &str, bytes: &[u8]| {
        let path = made.path(file);
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(path, bytes).expect("written");
    };
    let map = |number: f32| npy("(96, 320)", vec![number; 96 * 320]);
    for frame in 0..3 {
        write(&format!("good/{frame:06}_10.npy"), &map(5.0));
        write(&format!("small/{frame:06}_10.npy"), &npy("(48, 160)", vec![5.0; 48 * 160]));
        write(&format!("nan/{frame:06}_10.npy"), &map(f32::NAN));
        write(&format!("text/{frame:06}_10.png"), b"not an image");
        write(&format!("mixed/{frame:06}_10.npy"), if frame == 1 { b"\x93NUMPY\x01" } else { &[] });
        write(&format!("double/a_{frame:06}_10.npy"), &map(5.0));
        write(&format!("double/b_{frame:06}_10.npy"), &map(5.0));
        if frame != 1 {
            write(&format!("missing/{frame:06}_10.npy"), &map(5.0));
        }
    }
    write("colour/000000_10.png", &{
        let mut bytes = std::io::Cursor::new(Vec::new());
        image::RgbImage::from_fn(320, 96, |x, _| image::Rgb([x as u8, 0, 9]))
            .write_to(&mut bytes, image::ImageFormat::Png)
            .expect("PNG");
        bytes.into_inner()
    });
    write("bra{ces}/000000_10.npy", &map(5.0));
    write("low.npy", &npy("(3, 50, 320)", vec![1.0; 3 * 50 * 320]));
    write("two.npy", &npy("(2, 96, 320)", vec![1.0; 2 * 96 * 320]));
    for (arguments, expected) in [
        (&["x=nothing/*.npy"][..], "x: no file matches `nothing/*.npy`"),
        (&["good/*.npy"], "`good/*.npy` has no name"),
        (&["Bad=good/*.npy"], "`Bad` is not a name of an estimate"),
        (&["source=good/*.npy"], "`source` is not a name of an estimate"),
        (&["x=good/*.npy", "y=nan/*.npy"], "y: no file has a valid number"),
        (&["x=good/*.npy", "x=good/*.npy"], "the name `x` is taken by another estimate"),
        (&["x=small/*.npy"], "is 160x48, and the image is 320x96"),
        (&["x=nan/*.npy"], "no file has a valid number"),
        (&["x=good/*.npy", "--invalid", "5"], "no file has a valid number"),
        (&["x=text/*.png"], "000000_10.png"),
        (&["x=mixed/*.npy"], "3 maps cannot be used"),
        (&["x=missing/*.npy"], "no single file for 1 of 3 frames: 000001_10"),
        (&["x=double/*.npy"], "no single file for 3 of 3 frames"),
        (&["x=missing/*.npy", "--match", "order"], "2 files for 3 frames"),
        (&["x=two.npy"], "two.npy has 2 maps, and 3 frames are evaluated"),
        (&["x=colour/*.png", "--frames", "0..1"], "000000_10.png"),
        (&["x=good/*.npy", "--unit", "y=metres"], "--unit names `y`, which is not among the predictions: x"),
        (&["x=good/*.npy", "--unit", "metres", "--quantity", "disparity"], "--unit does not fit the quantity"),
        (&["x=good/*.npy", "--divide-by", "0"], "--divide-by is 0"),
        (&["x=good/*.npy", "--baseline", "z"], "--baseline names `z`"),
        (&["x=out/look/depth/depth/*.npy", "--protocol", "middlebury"], "they are depths"),
        (&["x=good/*.npy", "--protocol", "kitti-stereo", "--align", "median"], "--align is not part"),
        (&["x=good"], "it is a folder: name its files"),
        (&["x=bra{ces}/*.npy"], "has braces"),
        (&["x=low.npy"], "the map of 000000_10 in low.npy is 320x50"),
        (&["x=good/*.npy", "--frames", "7..9"], "7"),
        (&["x=good/*.npy", "--with", "split"], "--with is `split`, expected KEY=VALUE"),
        (&["x=good/*.npy", "--with", "spilt=training"], "spilt"),
    ] {
        let text = made.refused(arguments);
        assert!(text.contains(expected) && text.contains("help: "), "{arguments:?}: {text}");
        assert!(!text.contains("panicked"), "{text}");
    }
    for (target, expected) in [
        ("street", "expected KIND:FOLDER"),
        ("kitti/stereo2016:street", "`kitti/stereo2016` is not a kind of source"),
        ("kitti/stereo2015:nowhere", "nowhere"),
    ] {
        let output = made.command(&["evaluate", "--ground-truth", target, "x=good/*.npy"]).output().expect("it runs");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && text.contains(expected) && text.contains("help: "), "{target}: {text}");
    }
    assert!(!made.path("runs").exists(), "nothing ran");
    // What is not wrong: files that match no frame are reported.
    let text = made.printed(&["x=good/*.npy", "--frames", "0..2", "--out", "two"]);
    assert!(text.contains("x: 1 file matches no frame and is not used: good/000002_10.npy"), "{text}");
}
