//! `figure`: every kind as SVG, PNG and PDF of the requested size, with the numbers of `analyse`, `compare` and the
//! tables.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value as Json;

use crate::learning::learn;
use crate::support::{depthloom, full, number, python, read_csv, succeed, workspace};

/// Stereo, monocular depth and their fusion, with two axes of two values, on small frames; and a training stage.
const EXPERIMENT: &str = "experiment: drawn
sources:
  train: { kind: synthetic/road, with: { frames: 0..5, width: 320, height: 96, seed: 4 } }
  street: { kind: synthetic/road, with: { frames: 0..5, seed: 3, width: 320, height: 96 } }
stages:
LEARN  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      weight: { kind: confidence/sobel, inputs: { image: source/left } }
      mono: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/calibration } }
      merged: { kind: fusion/confidence, inputs: { mono: mono/depth, stereo: depth/depth, weight: weight/weight } }
      fused: { kind: filter/median, inputs: { depth: merged/depth } }
    score:
      ground_truth: source/depth
      estimates: { stereo: { from: depth/depth, sets: [valid, all] }, mono: mono/depth, fused: fused/depth }
matrix:
  look.fused.with.size: [3, 5]
  look.merged.with.weighting: [full, mean]
";

/// Runs the experiment into the folder `run`.
fn run(folder: &Path) -> PathBuf {
    let file = folder.join("drawn.yaml");
    std::fs::write(&file, EXPERIMENT.replace("LEARN", &learn(20, 1000))).expect("written");
    succeed(depthloom().current_dir(folder).args(["run", "--no-page", "drawn.yaml", "--quiet", "--out", "run"]));
    folder.join("run")
}

fn figure(folder: &Path, arguments: &[&str]) -> std::process::Output {
    depthloom().current_dir(folder).arg("figure").args(arguments).output().expect("the binary starts")
}

/// Standard error of a figure that must be refused, on one line.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = figure(folder, arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Kinds of figures, their arguments, and words that they contain.
const KINDS: [(&str, &[&str], &str); 9] = [
    ("error-vs-distance", &["--variant", "size=3*"], "ground-truth distance t, m"),
    ("difference", &["--estimates", "stereo,mono", "--resamples", "500"], "difference of mean errors, m"),
    ("histogram", &["--variant", "size=3+weighting=full"], "share of pixels, %"),
    ("cdf", &["--layout", "overlaid"], "share of pixels, %"),
    ("frames", &["--metric", "rmse"], "one frame"),
    ("parameter", &[], "weighting"),
    ("reliability", &["--variant", "size=3+weighting=full"], "absolute error"),
    ("learning", &[], "learn/train"),
    ("panels", &["--frames", "0,3"], "depth, m"),
];

#[test]
fn every_kind_is_drawn_in_every_format_at_the_requested_size() {
    if !full("every_kind_is_drawn_in_every_format_at_the_requested_size") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder);
    let mut check = python("every_kind_is_drawn_in_every_format_at_the_requested_size").map(|python| {
        let mut check = Command::new(python);
        check.arg(workspace().join("tests/python/check_figures.py"));
        check
    });
    for (kind, more, words) in KINDS {
        let draw = |file: &str, options: &[&str]| -> Json {
            let output = figure(folder, &[&["run", kind, "--out", file, "--json"], more, options].concat());
            assert!(output.status.success(), "{kind}: {}", String::from_utf8_lossy(&output.stderr));
            serde_json::from_slice(&output.stdout).expect("JSON")
        };
        let one_column = ["--width", "one-column"];
        let drawn = draw(&format!("{kind}.svg"), &one_column);
        assert_eq!(drawn["width_mm"], 88.0, "{kind}");
        let height_mm = drawn["height_mm"].as_f64().expect("a height");
        let svg = std::fs::read_to_string(folder.join(format!("{kind}.svg"))).expect("a figure");
        assert!(svg.contains("width=\"88mm\"") && svg.contains(words), "{kind}: no `{words}`");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{kind}: a coordinate is missing");
        draw(&format!("{kind}.pdf"), &one_column);
        draw(&format!("{kind}.png"), &["--width", "one-column", "--dpi", "100"]);
        let png = image::open(folder.join(format!("{kind}.png"))).expect("a PNG");
        let pixels = |mm: f64| (mm / 25.4 * 100.0).round() as u32;
        assert_eq!((png.width(), png.height()), (pixels(88.0), pixels(height_mm)), "{kind}");
        if let Some(check) = &mut check {
            check.arg(format!("{}:{height_mm}:{words}", folder.join(kind).display()));
        }
        // A second drawing has the same bytes.
        for extension in ["svg", "pdf"] {
            let (first, again) = (format!("{kind}.{extension}"), format!("again.{extension}"));
            draw(&again, &one_column);
            let read = |name: &str| std::fs::read(folder.join(name)).expect("a file");
            assert!(read(&first) == read(&again), "two drawings of {first} differ");
        }
    }
    if let Some(mut check) = check {
        let checked = succeed(&mut check);
        assert_eq!(String::from_utf8_lossy(&checked.stdout).trim(), KINDS.len().to_string());
    }
}

#[test]
fn figures_show_the_numbers_of_the_tables() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let run_folder = run(folder);
    let data = |arguments: &[&str]| -> PathBuf {
        let files = ["--out", "figure.svg", "--csv", "figure.csv"];
        let output = figure(folder, &[arguments, &files].concat());
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        folder.join("figure.csv")
    };
    let csv = |command: &str, arguments: &[&str]| -> String {
        let arguments = [arguments, &["--format", "csv"]].concat();
        let output = succeed(depthloom().current_dir(folder).arg(command).args(arguments));
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    let text = |path: &Path| std::fs::read_to_string(path).expect("a file");
    let bins = ["--bins", "width:2"];
    for (kind, query) in [
        ("error-vs-distance", &["--pixels", "common,valid", "--bins", "width:2"][..]),
        ("reliability", &["--pixels", "common,valid", "--by", "weight"]),
        ("histogram", &["--pixels", "common", "--by", "error", "--bins", "width:2", "--percentiles", ""]),
    ] {
        let more = if kind == "reliability" { &[][..] } else { &bins[..] };
        let drawn = data(&[&["run", kind, "--variant", "size=3*"], more].concat());
        if kind == "histogram" {
            // The figure has no percentiles: compare the columns that both tables have.
            let query = ["run", "--variant", "size=3*", "--pixels", "common", "--by", "error", "--bins", "width:2"];
            std::fs::write(folder.join("analysed.csv"), csv("analyse", &query)).expect("written");
            let (drawn, analysed) = (read_csv(&drawn), read_csv(&folder.join("analysed.csv")));
            assert_eq!(drawn.len(), analysed.len());
            for (drawn, analysed) in drawn.iter().zip(&analysed) {
                assert!(
                    drawn.iter().all(|(column, value)| analysed[column] == *value),
                    "{drawn:?} differs from {analysed:?}"
                );
            }
            continue;
        }
        assert_eq!(text(&drawn), csv("analyse", &[&["run", "--variant", "size=3*"], query].concat()), "{kind}");
    }
    let compared = csv("compare", &["run", "stereo", "mono", "--by", "distance", "--resamples", "500"]);
    let drawn = data(&["run", "difference", "--estimates", "stereo,mono", "--resamples", "500"]);
    assert_eq!(text(&drawn), compared, "the difference of a figure is that of `compare --by distance`");

    // Metrics per frame equal `scores.csv`; metrics by parameter equal the means in `table.csv`.
    let scores = read_csv(&run_folder.join("scores.csv"));
    let frames = read_csv(&data(&["run", "frames", "--metric", "rmse"]));
    let is_same = |one: &crate::support::Row, two: &crate::support::Row| {
        ["stage", "variant", "estimate", "set", "position"].iter().all(|column| one[*column] == two[*column])
    };
    assert_eq!(frames.len(), 5 * (2 + 4), "stereo and mono are shared by all variants");
    for row in &frames {
        let scored = scores.iter().find(|score| is_same(row, score)).unwrap_or_else(|| panic!("{row:?}"));
        assert_eq!(row["rmse"], scored["rmse"]);
    }
    let table = read_csv(&run_folder.join("table.csv"));
    let parameter = read_csv(&data(&["run", "parameter", "--metric", "abs_rel", "--estimates", "fused"]));
    assert_eq!(parameter.len(), 4);
    for row in &parameter {
        let is_same = |other: &&crate::support::Row| {
            other["estimate"] == "fused" && other["size"] == row["size"] && other["weighting"] == row["weighting"]
        };
        let in_table = table.iter().find(is_same).expect("a row of the table");
        assert_eq!(row["abs_rel"], in_table["abs_rel"]);
    }
    let one = read_csv(&data(&["run", "parameter", "--axes", "size", "--estimates", "fused"]));
    let mean: f64 =
        parameter.iter().filter(|row| row["size"] == "3").map(|row| number(row, "abs_rel")).sum::<f64>() / 2.0;
    assert!((number(&one[0], "abs_rel") - mean).abs() < 1e-12 && one[0]["rows"] == "2", "{one:?}");
    // An estimate that the parameter does not affect is in the figure and in its table.
    let both =
        read_csv(&data(&["run", "parameter", "--axes", "size", "--estimates", "fused,mono", "--metric", "abs_rel"]));
    let mono = table.iter().find(|row| row["estimate"] == "mono").expect("a row of the table");
    let level: Vec<_> = both.iter().filter(|row| row["size"].is_empty()).collect();
    assert!(level.len() == 1 && level[0]["estimate"] == "mono" && level[0]["abs_rel"] == mono["abs_rel"], "{both:?}");
    let curves = text(&run_folder.join("learning_curves.csv"));
    assert_eq!(text(&data(&["run", "learning"])), curves);
    let maps = read_csv(&data(&["run", "panels", "--frames", "0,3", "--variant", "size=3+weighting=full"]));
    assert_eq!(maps.len(), 2 * 6, "stereo, mono, fused, confidence, difference and ground truth of two frames");
}

#[test]
fn invalid_figure_arguments_are_refused_with_a_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder);
    for (arguments, words) in [
        (&["run", "cdf", "--out", "a.jpg"][..], "use `.svg`, `.png` or `.pdf`"),
        (&["run", "cdf", "--out", "a.svg", "--format", "png"], "contradicts the extension"),
        (&["run", "cdf", "--out", "no/a.svg"], "there is no folder no"),
        (&["run", "cdf", "--out", "run/scores.csv", "--format", "svg"], "it is a file of a run"),
        (&["run", "cdf", "--out", "a.svg", "--estimates", "absent"], "no samples match estimate `absent`"),
        (&["run", "cdf", "--out", "a.svg", "--pixels", "all"], "an invalid pixel has no error to draw"),
        (&["run", "cdf", "--out", "a.svg", "--height", "20"], "it needs a height of"),
        (&["run", "cdf", "--out", "a.svg", "--metric", "rmse"], "does not support --metric"),
        (&["run", "difference", "--out", "a.svg", "--estimates", "stereo,fused"], "matches several estimates"),
        (&["run", "frames", "--out", "a.svg", "--metric", "d1"], "metric of disparities"),
        (&["run", "parameter", "--out", "a.svg", "--axes", "sise"], "did you mean `size`?"),
        (&["run", "parameter", "--out", "a.svg", "--variant", "size=3+weighting=full"], "no parameter differs"),
        (&["run", "panels", "--out", "a.svg", "--frames", "77"], "there is no frame 77"),
        (&["run", "run", "panels", "--out", "a.svg"], "this kind of figure shows a single run"),
        (&["nowhere", "cdf", "--out", "a.svg"], "failed to open nowhere"),
    ] {
        let error = refused(folder, arguments);
        assert!(error.contains(words), "{arguments:?}: {error}");
    }
    assert!(!folder.join("a.svg").exists(), "nothing was written");
}

#[test]
fn figures_and_tables_beside_a_recording_without_a_run_folder_are_replaced() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder);
    std::fs::create_dir(folder.join("loose")).expect("a folder");
    std::fs::copy(folder.join("run/recording.mcap"), folder.join("loose/one.mcap")).expect("copied");
    for _ in 0..2 {
        let drawn = ["figure", "loose/one.mcap", "cdf", "--out", "loose/a.svg", "--csv", "loose/a.csv"];
        succeed(depthloom().current_dir(folder).args(drawn));
        let analyse = ["analyse", "loose/one.mcap", "--format", "csv", "--out", "loose/b.csv"];
        succeed(depthloom().current_dir(folder).args(analyse));
    }
    let error = refused(folder, &["loose/one.mcap", "cdf", "--out", "loose/one.mcap", "--format", "svg"]);
    assert!(error.contains("it is a recording"), "{error}");
    let error = refused(folder, &["loose/one.mcap", "cdf", "--out", "loose/samples.parquet", "--format", "svg"]);
    assert!(error.contains("it is a file of the run"), "{error}");
}

#[test]
fn a_learning_curve_of_one_point_is_drawn_with_a_note() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    std::fs::write(folder.join("drawn.yaml"), EXPERIMENT.replace("LEARN", &learn(1, 1000))).expect("written");
    succeed(depthloom().current_dir(folder).args(["run", "--no-page", "drawn.yaml", "--quiet", "--out", "run"]));
    let output = figure(folder, &["run", "learning", "--out", "a.svg"]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("note: learn/train has only one point"), "{text}");
}

#[test]
fn panels_of_a_run_that_scores_only_disparities_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let estimates =
        "estimates: { stereo: { from: depth/depth, sets: [valid, all] }, mono: mono/depth, fused: fused/depth }";
    let disparities = EXPERIMENT
        .replace("LEARN", "")
        .replace("seed: 3", "seed: 3, disparities: true")
        .replace("source/depth", "source/disp_occ");
    let disparities = disparities.replace(estimates, "estimates: { stereo: stereo/disparity }");
    std::fs::write(folder.join("drawn.yaml"), disparities).expect("written");
    succeed(depthloom().current_dir(folder).args(["run", "--no-page", "drawn.yaml", "--quiet", "--out", "run"]));
    let error = refused(folder, &["run", "panels", "--out", "a.svg"]);
    assert!(error.contains("`panels` shows depths, but this run scores only disparities"), "{error}");
}

/// A depth that is aligned before scoring is shown aligned; variants without the parameter are one level line.
#[test]
fn faults_26_and_46_panels_show_aligned_maps_and_missing_parameters_are_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let experiment = "experiment: aligned
sources: { street: { kind: synthetic/road, with: { frames: 0..2, seed: 3, width: 320, height: 96 } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      smooth: { kind: filter/median, inputs: { depth: depth/depth } }
    score: { ground_truth: source/depth, SCORE estimates: { near: smooth/depth } }
matrix:
  look.stereo.with.block: [3, 5, 7]
  look.smooth.with.size: { values: [3, 5], when: { look.stereo.with.block: 3 } }
";
    let mut maps = Vec::new();
    for (name, score) in [("plain", ""), ("aligned", "align: median,")] {
        let file = format!("{name}.yaml");
        std::fs::write(folder.join(&file), experiment.replace("SCORE", score)).expect("written");
        succeed(depthloom().current_dir(folder).args(["run", "--no-page", &file, "--quiet", "--out", name]));
        let arguments =
            ["figure", name, "panels", "--frames", "0", "--variant", "block=5*", "--out", "m.svg", "--csv", "m.csv"];
        succeed(depthloom().current_dir(folder).args(arguments));
        let svg = std::fs::read_to_string(folder.join("m.svg")).expect("a figure");
        assert_eq!(svg.contains("near, aligned"), name == "aligned");
        maps.push(std::fs::read_to_string(folder.join("m.csv")).expect("a table"));
    }
    assert_ne!(maps[0], maps[1]);
    let arguments = ["figure", "plain", "parameter", "--axes", "size", "--out", "p.svg"];
    succeed(depthloom().current_dir(folder).args(arguments));
    let svg = std::fs::read_to_string(folder.join("p.svg")).expect("a figure");
    assert_eq!(svg.matches("without size").count(), 1, "one line for all variants without the parameter");
}
