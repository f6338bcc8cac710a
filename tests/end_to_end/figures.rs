//! `figure`: every kind as SVG, PNG and PDF of the size that was asked for, with the numbers of `analyse`, `compare`
//! and the tables.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value as Json;

use crate::learning::learn;
use crate::support::{depthloom, full, number, python, read_csv, succeed, workspace};

/// Stereo, mono and their fusion in two variants of a parameter each of two axes, on small frames, beside a stage that
/// learns.
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
      truth: source/depth
      estimates: { stereo: { from: depth/depth, sets: [valid, all] }, mono: mono/depth, fused: fused/depth }
matrix:
  look.fused.with.size: [3, 5]
  look.merged.with.weighting: [full, mean]
";

/// Runs the experiment into `run` below a folder.
fn run(folder: &Path) -> PathBuf {
    let file = folder.join("drawn.yaml");
    std::fs::write(&file, EXPERIMENT.replace("LEARN", &learn(20, 1000))).expect("written");
    succeed(depthloom().current_dir(folder).args(["run", "--no-page", "drawn.yaml", "--quiet", "--out", "run"]));
    folder.join("run")
}

fn figure(folder: &Path, arguments: &[&str]) -> std::process::Output {
    depthloom().current_dir(folder).arg("figure").args(arguments).output().expect("the binary starts")
}

/// What is said of a figure that is refused.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = figure(folder, arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Kinds, what they need beside, and words that are in them.
const KINDS: [(&str, &[&str], &str); 9] = [
    ("error-vs-distance", &["--variant", "size=3*"], "true distance t, m"),
    ("difference", &["--estimates", "stereo,mono", "--resamples", "500"], "difference of mean errors, m"),
    ("histogram", &["--variant", "size=3+weighting=full"], "share of pixels, %"),
    ("cdf", &["--layout", "overlaid"], "share of pixels, %"),
    ("frames", &["--score", "rmse"], "a frame"),
    ("parameter", &[], "weighting"),
    ("reliability", &["--variant", "size=3+weighting=full"], "absolute error"),
    ("learning", &[], "learn/teacher"),
    ("panels", &["--frames", "0,3"], "depth, m"),
];

#[test]
fn every_kind_is_drawn_in_every_format_of_the_size_asked_for() {
    if !full("every_kind_is_drawn_in_every_format_of_the_size_asked_for") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder);
    let mut check = python("every_kind_is_drawn_in_every_format_of_the_size_asked_for").map(|python| {
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
        let told = draw(&format!("{kind}.svg"), &one_column);
        assert_eq!(told["width_mm"], 88.0, "{kind}");
        let height_mm = told["height_mm"].as_f64().expect("a height");
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
        // The same again is the same bytes.
        for ending in ["svg", "pdf"] {
            let (first, again) = (format!("{kind}.{ending}"), format!("again.{ending}"));
            draw(&again, &one_column);
            let read = |name: &str| std::fs::read(folder.join(name)).expect("a file");
            assert!(read(&first) == read(&again), "two drawings of {first} differ");
        }
    }
    if let Some(mut check) = check {
        let told = succeed(&mut check);
        assert_eq!(String::from_utf8_lossy(&told.stdout).trim(), KINDS.len().to_string());
    }
}

#[test]
fn the_numbers_of_a_figure_are_those_of_the_tables() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let of_run = run(folder);
    let data = |arguments: &[&str]| -> PathBuf {
        let files = ["--out", "figure.svg", "--data", "figure.csv"];
        let output = figure(folder, &[arguments, &files].concat());
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        folder.join("figure.csv")
    };
    let csv = |command: &str, arguments: &[&str]| -> String {
        let asked = [arguments, &["--format", "csv"]].concat();
        let output = succeed(depthloom().current_dir(folder).arg(command).args(asked));
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    let text = |path: &Path| std::fs::read_to_string(path).expect("a file");
    let bins = ["--bins", "width:2"];
    for (kind, asked) in [
        ("error-vs-distance", &["--set", "common,valid", "--bins", "width:2"][..]),
        ("reliability", &["--set", "common,valid", "--by", "weight"]),
        ("histogram", &["--set", "common", "--by", "error", "--bins", "width:2", "--percentiles", ""]),
    ] {
        let more = if kind == "reliability" { &[][..] } else { &bins[..] };
        let drawn = data(&[&["run", kind, "--variant", "size=3*"], more].concat());
        if kind == "histogram" {
            // Without percentiles: of the columns that both have the same numbers.
            let inquiry = ["run", "--variant", "size=3*", "--set", "common", "--by", "error", "--bins", "width:2"];
            std::fs::write(folder.join("asked.csv"), csv("analyse", &inquiry)).expect("written");
            let (drawn, asked) = (read_csv(&drawn), read_csv(&folder.join("asked.csv")));
            assert_eq!(drawn.len(), asked.len());
            for (drawn, asked) in drawn.iter().zip(&asked) {
                assert!(drawn.iter().all(|(column, value)| asked[column] == *value), "{drawn:?} is not {asked:?}");
            }
            continue;
        }
        assert_eq!(text(&drawn), csv("analyse", &[&["run", "--variant", "size=3*"], asked].concat()), "{kind}");
    }
    let compared = csv("compare", &["run", "stereo", "mono", "--by", "distance", "--resamples", "500"]);
    let drawn = data(&["run", "difference", "--estimates", "stereo,mono", "--resamples", "500"]);
    assert_eq!(text(&drawn), compared, "the difference of a figure is that of `compare --by distance`");

    // Scores: by frame those that the run wrote, by parameter the means of its table.
    let scores = read_csv(&of_run.join("scores.csv"));
    let frames = read_csv(&data(&["run", "frames", "--score", "rmse"]));
    let is_same = |one: &crate::support::Row, two: &crate::support::Row| {
        ["stage", "variant", "estimate", "set", "position"].iter().all(|column| one[*column] == two[*column])
    };
    assert_eq!(frames.len(), 5 * (2 + 4), "stereo and mono are shared by all variants");
    for row in &frames {
        let scored = scores.iter().find(|score| is_same(row, score)).unwrap_or_else(|| panic!("{row:?}"));
        assert_eq!(row["rmse"], scored["rmse"]);
    }
    let table = read_csv(&of_run.join("table.csv"));
    let parameter = read_csv(&data(&["run", "parameter", "--score", "abs_rel", "--estimates", "fused"]));
    assert_eq!(parameter.len(), 4);
    for row in &parameter {
        let is_it = |of: &&crate::support::Row| of["size"] == row["size"] && of["weighting"] == row["weighting"];
        let of_table = table.iter().find(|of| of["estimate"] == "fused" && is_it(of)).expect("a row of the table");
        assert_eq!(row["abs_rel"], of_table["abs_rel"]);
    }
    let one = read_csv(&data(&["run", "parameter", "--axes", "size", "--estimates", "fused"]));
    let mean: f64 =
        parameter.iter().filter(|row| row["size"] == "3").map(|row| number(row, "abs_rel")).sum::<f64>() / 2.0;
    assert!((number(&one[0], "abs_rel") - mean).abs() < 1e-12 && one[0]["rows"] == "2", "{one:?}");
    // What no value of the parameter changes is in the figure, and in its numbers.
    let both =
        read_csv(&data(&["run", "parameter", "--axes", "size", "--estimates", "fused,mono", "--score", "abs_rel"]));
    let mono = table.iter().find(|of| of["estimate"] == "mono").expect("a row of the table");
    let level: Vec<_> = both.iter().filter(|row| row["size"].is_empty()).collect();
    assert!(level.len() == 1 && level[0]["estimate"] == "mono" && level[0]["abs_rel"] == mono["abs_rel"], "{both:?}");
    let curves = text(&of_run.join("learning_curves.csv"));
    assert_eq!(text(&data(&["run", "learning"])), curves);
    let maps = read_csv(&data(&["run", "panels", "--frames", "0,3", "--variant", "size=3+weighting=full"]));
    assert_eq!(maps.len(), 2 * 6, "stereo, mono, fused, weight, difference and truth of two frames");
}

#[test]
fn what_cannot_be_drawn_is_refused_in_words() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder);
    for (arguments, words) in [
        (&["run", "cdf", "--out", "a.jpg"][..], "end it in `.svg`, `.png` or `.pdf`"),
        (&["run", "cdf", "--out", "a.svg", "--format", "png"], "contradicts the extension"),
        (&["run", "cdf", "--out", "no/a.svg"], "there is no folder no"),
        (&["run", "cdf", "--out", "run/scores.csv", "--format", "svg"], "it is a file of a run"),
        (&["run", "cdf", "--out", "a.svg", "--estimates", "nobody"], "no estimate is `nobody`"),
        (&["run", "cdf", "--out", "a.svg", "--set", "all"], "a pixel without an answer has no error"),
        (&["run", "cdf", "--out", "a.svg", "--height", "20"], "it needs a height of"),
        (&["run", "cdf", "--out", "a.svg", "--score", "rmse"], "takes no --score"),
        (&["run", "difference", "--out", "a.svg", "--estimates", "stereo,fused"], "are several"),
        (&["run", "frames", "--out", "a.svg", "--score", "d1"], "score of disparities"),
        (&["run", "parameter", "--out", "a.svg", "--axes", "sise"], "did you mean `size`?"),
        (&["run", "parameter", "--out", "a.svg", "--variant", "size=3+weighting=full"], "no parameter differs"),
        (&["run", "panels", "--out", "a.svg", "--frames", "77"], "there is no frame 77"),
        (&["run", "run", "panels", "--out", "a.svg"], "this kind of figure is of one run"),
        (&["nowhere", "cdf", "--out", "a.svg"], "failed to open nowhere"),
    ] {
        let said = refused(folder, arguments);
        assert!(said.contains(words), "{arguments:?}: {said}");
    }
    assert!(!folder.join("a.svg").exists(), "nothing was written");
}

#[test]
fn a_learning_curve_of_one_point_is_drawn_with_a_note() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    std::fs::write(folder.join("drawn.yaml"), EXPERIMENT.replace("LEARN", &learn(1, 1000))).expect("written");
    succeed(depthloom().current_dir(folder).args(["run", "--no-page", "drawn.yaml", "--quiet", "--out", "run"]));
    let output = figure(folder, &["run", "learning", "--out", "a.svg"]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("note: learn/teacher has one point only"), "{text}");
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
    let said = refused(folder, &["run", "panels", "--out", "a.svg"]);
    assert!(said.contains("panels show depths, and this run scores only disparities"), "{said}");
}

/// A depth that is scored after its alignment is shown aligned; a variant without a parameter is one level line.
#[test]
fn faults_26_and_46_maps_are_shown_as_they_are_scored_and_what_lacks_a_parameter_is_one_line() {
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
    score: { truth: source/depth, SCORE estimates: { near: smooth/depth } }
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
            ["figure", name, "panels", "--frames", "0", "--variant", "block=5*", "--out", "m.svg", "--data", "m.csv"];
        succeed(depthloom().current_dir(folder).args(arguments));
        let svg = std::fs::read_to_string(folder.join("m.svg")).expect("a figure");
        assert_eq!(svg.contains("near, aligned"), name == "aligned");
        maps.push(std::fs::read_to_string(folder.join("m.csv")).expect("a table"));
    }
    assert_ne!(maps[0], maps[1]);
    let arguments = ["figure", "plain", "parameter", "--axes", "size", "--out", "p.svg"];
    succeed(depthloom().current_dir(folder).args(arguments));
    let svg = std::fs::read_to_string(folder.join("p.svg")).expect("a figure");
    assert_eq!(svg.matches("without size").count(), 1, "one line of all variants without it");
}
