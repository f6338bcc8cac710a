//! `compare`: differences, intervals and tests, checked against SciPy on the scores that the run wrote; limits for CI.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value as Json;

use crate::support::{Row, depthloom, number, python, read_csv, succeed, workspace};

/// Stereo in three variants on seven small frames, scored with and without a median filter.
const EXPERIMENT: &str = "experiment: compared
sources:
  street: { kind: synthetic/road, with: { frames: 0..7, seed: 3, width: 320, height: 96 } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      smooth: { kind: filter/median, inputs: { depth: depth/depth } }
    score:
      ground_truth: source/depth
      estimates:
        raw: { from: depth/depth, sets: [valid, all] }
        smooth: { from: smooth/depth, sets: [valid, all] }
variants:
  plain: {}
  large: { look.stereo.with.block: 9 }
  strict: { look.stereo.with.uniqueness: 20 }
";

/// Runs the experiment with changed parameters into the folder `name`.
fn run(folder: &Path, name: &str, set: &[&str]) -> PathBuf {
    let (file, out) = (folder.join("compared.yaml"), folder.join(name));
    std::fs::write(&file, EXPERIMENT).expect("written");
    let set = set.iter().flat_map(|set| ["--set", set]);
    succeed(
        depthloom().current_dir(folder).args(["run", "--no-page", "compared.yaml", "--quiet", "--out", name]).args(set),
    );
    out
}

fn compare(folder: &Path, arguments: &[&str]) -> Output {
    depthloom().current_dir(folder).arg("compare").args(arguments).output().expect("the binary starts")
}

fn json(folder: &Path, arguments: &[&str]) -> Json {
    let output = compare(folder, &[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Standard error of a command that is refused with exit code 2, on one line.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = compare(folder, arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn differences_intervals_and_tests_match_scipy() {
    let Some(python) = python("differences_intervals_and_tests_match_scipy") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    run(folder, "other", &["look.stereo.with.p1=300", "sources.street.with.frames=1..7"]);
    for (arguments, runs, tests) in [
        (&["run"][..], &["run"][..], 2 * 2 * 8),
        (&["run", "plain", "strict", "--pixels", "valid", "--interval", "percentile"], &["run"], 2 * 8),
        (&["run", "*/smooth", "--mean", "pixels", "--metrics", "abs_rel,rmse,a1", "--seed", "9"], &["run"], 2 * 3),
        (&["run", "plain/raw", "plain/smooth", "--confidence", "90", "--resamples", "999"], &["run"], 8),
        (&["run", "other", "--estimates", "large/*"], &["run", "other"], 2 * 8),
        (&["run:plain/raw", "other:strict/raw", "--metrics", "rmse_log"], &["run", "other"], 1),
        (&["run", "*/smooth", "--group", "blocks:2", "--metrics", "abs_rel,rmse,a1"], &["run"], 2 * 3),
        (&["run", "*/raw", "--group", "blocks:2", "--mean", "pixels", "--metrics", "rmse,a1"], &["run"], 2 * 2),
    ] {
        let resamples: &[&str] = if arguments.contains(&"--resamples") { &[] } else { &["--resamples", "10000"] };
        let compared = json(folder, &[arguments, resamples].concat());
        let file = folder.join("compared.json");
        std::fs::write(&file, compared.to_string()).expect("written");
        let scores = runs.iter().map(|run| format!("{run}={}", folder.join(run).join("scores.csv").display()));
        let mut check = Command::new(&python);
        check.arg(workspace().join("tests/python/check_compare.py")).arg(&file).args(scores);
        let checked = succeed(&mut check);
        assert_eq!(String::from_utf8_lossy(&checked.stdout).trim(), tests.to_string(), "{arguments:?}");
    }
}

#[test]
fn groups_of_frames_are_the_units_of_intervals_and_tests() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    let compare_in =
        |groups: &str| json(folder, &["run", "plain/raw", "strict/raw", "--metrics", "abs_rel", "--group", groups]);
    std::fs::write(folder.join("groups.csv"), "frame,group\n".to_owned() + &lines(7, |frame| usize::from(frame == 3)))
        .expect("written");
    for (groups, units, unit) in
        [("blocks:3", 3, "blocks of 3 frames"), ("sequence", 1, "sequences"), ("groups.csv", 2, "groups of groups.csv")]
    {
        let compared = compare_in(groups);
        assert_eq!(compared["method"]["unit"], unit);
        let row = &compared["rows"][0];
        let count = |name: &str| row[name].as_u64().expect("a number");
        assert_eq!((count("frames"), count("wins") + count("ties") + count("losses")), (7, units), "{groups}");
        // One group cannot be resampled.
        assert_eq!(row["difference_low"].is_null(), units == 1, "{groups}");
    }
    std::fs::write(folder.join("groups.csv"), "frame,group\n".to_owned() + &lines(6, |_| 0)).expect("written");
    let missing = refused(folder, &["run", "plain/raw", "strict/raw", "--group", "groups.csv"]);
    assert!(missing.contains("groups.csv has no group for frame `000006_10`"), "{missing}");
}

/// The lines of a file of groups.
fn lines(frames: usize, group: impl Fn(usize) -> usize) -> String {
    (0..frames).map(|frame| format!("{frame:06}_10,{}\n", group(frame))).collect()
}

#[test]
fn errors_by_distance_match_scipy() {
    let Some(python) = python("errors_by_distance_match_scipy") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    let export =
        ["export", "run", "source/depth", "depth/depth", "smooth/depth", "--format", "npy", "--quiet", "--out", "maps"];
    succeed(depthloom().current_dir(folder).args(export));
    let maps = |node: &str| {
        let listed = succeed(Command::new("find").current_dir(folder).args([
            "maps",
            "-path",
            &format!("*{node}*"),
            "-name",
            "*.npy",
        ]));
        let first = String::from_utf8(listed.stdout).expect("UTF-8").lines().min().expect("a map").to_owned();
        folder.join(first).parent().expect("a folder").to_owned()
    };
    for arguments in [
        &["run", "plain/raw", "strict/smooth", "--bins", "width:5"][..],
        &["run", "plain/raw", "strict/smooth", "--bins", "edges:2,8,20,60", "--interval", "percentile", "--seed", "5"],
        &["run", "strict/smooth", "plain/raw", "--bins", "log:6", "--confidence", "90"],
    ] {
        let compared = json(folder, &[arguments, &["--by", "distance", "--resamples", "300"]].concat());
        let file = folder.join("compared.json");
        std::fs::write(&file, compared.to_string()).expect("written");
        let maps_of =
            |label: &str| if label == "plain/raw" { maps("plain/depth/depth") } else { maps("strict/smooth/depth") };
        let mut check = Command::new(&python);
        check.arg(workspace().join("tests/python/check_distance.py")).arg(&file).arg(maps("source/depth"));
        let checked = succeed(check.arg(maps_of(arguments[1])).arg(maps_of(arguments[2])));
        let rows = compared["rows"].as_array().expect("rows").len();
        assert_eq!(String::from_utf8_lossy(&checked.stdout).trim(), rows.to_string(), "{arguments:?}");
    }
}

#[test]
fn selected_frames_by_distance_are_those_of_a_run_with_these_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    run(folder, "few", &["sources.street.with.frames=2..5"]);
    let by_distance = |run: &str, frames: &[&str]| {
        let arguments = [run, "plain/raw", "strict/smooth", "--by", "distance", "--resamples", "300"];
        json(folder, &[&arguments, frames].concat())
    };
    let selected = by_distance("run", &["--frames", "2..5"]);
    let rows = |compared: &Json| compared["rows"].as_array().expect("rows").clone();
    let numbers = |compared: &Json| rows(compared).iter().map(|row| row["value_m"].clone()).collect::<Vec<_>>();
    assert_eq!(numbers(&selected), numbers(&by_distance("few", &[])));
    assert_ne!(numbers(&selected), numbers(&by_distance("run", &[])));
    assert!(rows(&selected).iter().all(|row| row["frames"].as_u64().is_some_and(|frames| frames <= 3)), "{selected}");
    let error = refused(folder, &["run", "plain", "strict", "--by", "distance", "--frames", "90"]);
    assert!(error.contains("90"), "{error}");
}

#[test]
fn options_that_do_not_apply_by_distance_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    for (arguments, words) in [
        (&["run", "--by", "distance", "--pixels", "all"][..], "on the pixels that are valid in both"),
        (&["run", "--by", "distance", "--baseline", "best"], "there is no best side over all distances"),
        (&["run", "--by", "distance", "--metrics", "rmse"], "cannot be used with"),
        (&["run", "--bins", "width:5"], "required"),
    ] {
        let error = refused(folder, arguments);
        assert!(error.contains(words), "{arguments:?}: {error}");
    }
    // All variants at once, one pair per variant, in every format.
    let compared = json(folder, &["run", "--by", "distance", "--resamples", "200"]);
    assert_eq!(compared["handovers"].as_array().expect("handovers").len(), 2 * 2 * 2, "pairs and statistics");
    for format in ["terminal", "md", "csv", "latex"] {
        let output = compare(folder, &["run", "--by", "distance", "--resamples", "200", "--format", format]);
        assert!(output.status.success() && !output.stdout.is_empty(), "{format}");
    }
}

#[test]
fn differing_parameters_are_listed_and_output_is_reproducible() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    let text = |arguments: &[&str]| String::from_utf8(compare(folder, arguments).stdout).expect("UTF-8");
    let variants = text(&["run", "plain", "large"]);
    for part in [
        "large differs in\n  look.stereo  block: 5 -> 9",
        "large compared with plain: all pixels with ground truth, preset martins2018, mean over 7 frames",
        "95 % BCa bootstrap over frames, 100000 resamples, seed 1",
        "corrected for the 16 tests here",
        "only 7 frames: with so few, intervals are too narrow",
    ] {
        let flat = variants.replace("\n", " ");
        assert!(variants.contains(part) || flat.contains(part), "{part}: {variants}");
    }
    assert_eq!(variants, text(&["run", "plain", "large"]));
    let csv = |arguments: &[&str]| text(&[arguments, &["--format", "csv"]].concat());
    assert_eq!(csv(&["run", "large"]).len(), 0, "one side is compared with nothing");
    let rows = csv(&["run", "--baseline", "strict"]);
    assert_eq!(rows.lines().count(), 1 + 2 * 2 * 8);
    assert!(rows.lines().skip(1).all(|row| row.starts_with("look,plain,") || row.starts_with("look,large,")));

    // A run against one with other frames and another parameter.
    run(folder, "other", &["look.stereo.with.p1=300", "sources.street.with.frames=2..9"]);
    let compared = json(folder, &["run", "other"]);
    let text = compared.to_string();
    assert!(text.contains("5 frames are in both; 2 frames only in the baseline and 2 only in the other"), "{text}");
    let differences = compared["parameters"][0]["differences"].as_array().expect("differences");
    let p1 = differences.iter().find(|difference| difference["path"] == "p1").expect("the parameter");
    assert_eq!((&p1["after"], p1["node"].as_str()), (&Json::from(300), Some("look.stereo of plain")));
    assert!(compared["rows"].as_array().expect("rows").iter().all(|row| row["frames"] == 5));
    // A run against itself: nothing differs, and no verdict is possible.
    let same = json(folder, &["run", "./run"]);
    for row in same["rows"].as_array().expect("rows") {
        let cells = ["difference", "difference_low", "difference_high", "p", "verdict"].map(|name| row[name].clone());
        assert_eq!(cells, [0.0.into(), 0.0.into(), 0.0.into(), 1.0.into(), Json::from("unclear")], "{row}");
    }
}

#[test]
fn estimates_that_are_equal_in_both_runs_are_not_tested() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    // With another filter size, `raw` of each variant stays the same, and `smooth` changes.
    run(folder, "other", &["look.smooth.with.size=3"]);
    let one = json(folder, &["run", "other", "--estimates", "*/smooth", "--metrics", "abs_rel"]);
    let two = json(folder, &["run", "other", "--metrics", "abs_rel"]);
    let p = |compared: &Json, estimate: &str| -> Vec<Json> {
        let rows = compared["rows"].as_array().expect("rows").iter();
        rows.filter(|row| row["estimate"] == estimate).map(|row| row["p_holm"].clone()).collect()
    };
    assert_eq!(p(&two, "smooth"), p(&one, "smooth"), "an estimate that cannot differ does not weaken other tests");
    assert_eq!((p(&two, "raw"), two["method"]["tests"].clone()), (vec![Json::Null; 3], 3.into()));
    assert!(two["notes"].to_string().contains("plain/raw is identical on both sides, so it is not tested"), "{two}");
    // The same run under another name.
    run(folder, "same", &[]);
    let equal = compare(folder, &["run", "same", "--metrics", "abs_rel"]).stdout;
    let equal = String::from_utf8_lossy(&equal).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(equal.contains("nothing was tested, because no value differs"), "{equal}");
    assert!(!equal.contains("0 tests"), "{equal}");
}

#[test]
fn variants_with_identical_estimates_are_not_called_unknown() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (first, _) = EXPERIMENT.split_once("  large:").expect("variants");
    std::fs::write(folder.join("twins.yaml"), format!("{first}  twin: {{}}\n")).expect("written");
    succeed(depthloom().current_dir(folder).args(["run", "--no-page", "twins.yaml", "--quiet", "--out", "run"]));
    let error = refused(folder, &["run", "plain", "twin"]);
    assert!(error.contains("cannot compare variant `plain`: its estimates are identical in all variants"), "{error}");
    assert!(error.contains("available: `raw`, `smooth`") && !error.contains("did you mean"), "{error}");
}

#[test]
fn too_few_frames_for_any_verdict_are_noted() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    // 7 frames: 2 / 2^7 for each of 32 tests.
    let notes = json(folder, &["run"])["notes"].to_string();
    let note =
        "no verdict is possible: with 32 tests of 7 frames the smallest possible p_holm is 0.500, not below 0.05";
    assert!(notes.contains(note), "{notes}");
    let notes = json(folder, &["run", "plain", "large", "--metrics", "abs_rel"])["notes"].to_string();
    assert!(!notes.contains("no verdict is possible"), "2 tests reach 0.031: {notes}");
}

#[test]
fn frames_and_several_estimates_are_selected() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    let scores = read_csv(&folder.join("run/scores.csv"));
    let mean = |frames: &[&str]| {
        let is = |row: &&Row| {
            (row["variant"].as_str(), row["estimate"].as_str(), row["set"].as_str()) == ("plain", "raw", "all")
                && row["zone"].is_empty()
                && frames.contains(&row["position"].as_str())
        };
        scores.iter().filter(is).map(|row| number(row, "abs_rel")).sum::<f64>() / frames.len() as f64
    };
    for (selection, frames) in [("0..4", &["0", "1", "2", "3"][..]), ("5,6", &["5", "6"]), ("4..=6", &["4", "5", "6"])]
    {
        let compared = json(folder, &["run", "plain", "large", "--frames", selection, "--metrics", "abs_rel"]);
        let row =
            compared["rows"].as_array().expect("rows").iter().find(|row| row["estimate"] == "raw").expect("a row");
        assert_eq!(row["frames"], frames.len(), "{selection}");
        assert!((row["baseline"].as_f64().expect("a number") - mean(frames)).abs() < 1e-12, "{selection}: {row}");
        let arguments = ["table", "run", "--frames", selection, "--format", "csv", "--out", "rows.csv"];
        succeed(depthloom().current_dir(folder).args(arguments));
        let rows = read_csv(&folder.join("rows.csv"));
        let row = rows.iter().find(|row| row["variant"] == "plain" && row["estimate"] == "raw").expect("a row");
        assert!((number(row, "abs_rel") - mean(frames)).abs() < 1e-12, "{selection}: {row:?}");
    }
    assert!(refused(folder, &["run", "plain", "large", "--frames", "9"]).contains("frame"));
    let some = json(folder, &["run", "plain", "large", "--estimates", "plain/raw, large/*"]);
    let names: std::collections::BTreeSet<String> =
        some["rows"].as_array().expect("rows").iter().map(|row| row["estimate"].to_string()).collect();
    assert_eq!(names.len(), 1, "{names:?}");
    assert!(refused(folder, &["run", "plain", "large", "--estimates", "raw,smoth"]).contains("did you mean `smooth`?"));
}

#[test]
fn a_range_of_frames_beyond_the_run_is_noted() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    let noted = "note: --frames is longer than run/recording.mcap: of the frames 5 to 19, 13 of 15 do not exist: 2 are used, 5 to 6";
    for arguments in [
        &["table", "run"][..],
        &["compare", "run", "plain", "large"],
        &["compare", "run", "plain/raw", "large/raw", "--by", "distance", "--resamples", "200"],
        &["analyse", "run"],
        &["analyse", "run", "--samples-only", "--out", "part.parquet"],
        &["explain", "run", "abs_rel", "plain/raw"],
    ] {
        let output = |frames: &str| {
            let mut command = depthloom();
            command.current_dir(folder).args(arguments).args(["--frames", frames]).output().expect("started")
        };
        let beyond = output("5..20");
        let stderr = String::from_utf8_lossy(&beyond.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(beyond.status.success() && stderr.contains(noted), "{arguments:?}: {stderr}");
        let within = output("5..7");
        assert!(!String::from_utf8_lossy(&within.stderr).contains("--frames"), "{arguments:?}");
        let none = output("20..30");
        assert_eq!(none.status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn a_table_of_several_runs_has_a_column_per_differing_setting() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let runs = [("one", "200"), ("two", "300"), ("three", "400")];
    for (name, p1) in runs {
        run(folder, name, &[&format!("look.stereo.with.p1={p1}")]);
    }
    let board = |arguments: &[&str]| {
        let all = [&["table", "one", "two", "three", "--format", "csv", "--out", "board.csv"], arguments].concat();
        succeed(depthloom().current_dir(folder).args(all));
        read_csv(&folder.join("board.csv"))
    };
    let rows = board(&["--columns", "abs_rel"]);
    assert_eq!(rows.len(), 3 * 6);
    let errors: Vec<f64> = rows.iter().map(|row| number(row, "abs_rel")).collect();
    assert!(errors.windows(2).all(|two| two[0] <= two[1]), "{errors:?}");
    for (name, p1) in runs {
        let own = read_csv(&folder.join(name).join("table.csv"));
        for row in rows.iter().filter(|row| row["run"] == name) {
            assert_eq!(row["look.stereo.p1"], p1, "{row:?}");
            let is_same = |other: &&Row| ["variant", "estimate", "set"].iter().all(|key| other[*key] == row[*key]);
            assert_eq!(own.iter().find(is_same).map(|other| number(other, "abs_rel")), Some(number(row, "abs_rel")));
        }
    }
    assert_eq!(board(&["--estimates", "raw", "--top", "2"]).len(), 2);
    let output =
        succeed(depthloom().current_dir(folder).args(["table", "one", "two", "three", "--columns", "abs_rel"]));
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    assert_eq!(
        text.lines().skip(2).filter(|line| line.ends_with('*')).count(),
        1,
        "one best value over all runs: {text}"
    );
    let refused =
        depthloom().current_dir(folder).args(["table", "one", "two", "--ci"]).output().expect("the binary starts");
    assert_eq!(refused.status.code(), Some(2));
}

#[test]
fn an_estimate_shared_by_variants_is_tested_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let text = EXPERIMENT.split("variants:").next().expect("a part");
    let text = format!("{text}matrix:\n  look.stereo.with.block: [3, 5]\n  look.smooth.with.size: [3, 5]\n");
    std::fs::write(folder.join("shared.yaml"), text).expect("written");
    succeed(depthloom().current_dir(folder).args(["run", "--no-page", "shared.yaml", "--quiet", "--out", "shared"]));
    // `raw` depends only on the block size, so against block=3 two variants share one test.
    let compared = json(
        folder,
        &["shared", "block=3+size=3/raw", "block=5+size=3/raw", "block=5+size=5/raw", "--metrics", "abs_rel"],
    );
    assert_eq!(compared["method"]["tests"], 1, "{compared}");
    let rows = compared["rows"].as_array().expect("rows");
    let p: Vec<_> = rows.iter().map(|row| row["p_holm"].as_f64().expect("a number")).collect();
    assert!(p.len() == 2 && p[0] == p[1] && rows[0]["p"].as_f64() == Some(p[0]), "{compared}");
}

#[test]
fn a_table_of_several_runs_shows_the_settings_of_each_variant() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let plain = EXPERIMENT.split("variants:").next().expect("a part");
    for (name, blocks) in [("wide", "[3, 5, 7]"), ("narrow", "[5, 11]")] {
        let text = format!("{plain}matrix:\n  look.stereo.with.block: {blocks}\n");
        std::fs::write(folder.join(format!("{name}.yaml")), text).expect("written");
        let file = format!("{name}.yaml");
        succeed(depthloom().current_dir(folder).args(["run", "--no-page", &file, "--quiet", "--out", name]));
    }
    let arguments = ["table", "wide", "narrow", "--format", "csv", "--out", "blocks.csv"];
    succeed(depthloom().current_dir(folder).args(arguments));
    let rows = read_csv(&folder.join("blocks.csv"));
    assert_eq!(rows.len(), 5 * 2);
    for row in &rows {
        assert_eq!(row["variant"], format!("block={}", row["look.stereo.block"]), "{row:?}");
    }
}

#[test]
fn latex_tables_take_caption_label_and_digits_and_keep_intervals_in_cells() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    let latex = |arguments: &[&str]| {
        let all = [&["table", "run", "--format", "latex"], arguments].concat();
        let output = succeed(depthloom().current_dir(folder).args(all));
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    let plain = latex(&["--ci"]);
    let rows = plain.lines().filter(|line| line.ends_with("\\\\") && line.contains('['));
    for row in rows.clone() {
        // The interval is in the cell of its metric.
        assert!(row.split('&').all(|cell| !cell.trim_start().starts_with('[')), "{row}");
    }
    assert!(rows.count() >= 6, "{plain}");
    let label = |text: &str| text.lines().find(|line| line.starts_with("\\label")).expect("a label").to_owned();
    let labels = [
        latex(&[]),
        plain,
        latex(&["--rows", "score"]),
        latex(&["--pixels", "valid"]),
        latex(&["--effects", "abs_rel"]),
    ];
    let labels: std::collections::BTreeSet<String> = labels.iter().map(|text| label(text)).collect();
    assert_eq!(labels.len(), 5, "{labels:?}");
    let own = latex(&["--caption", "Ours, $n = 7$.", "--label", "ours", "--digits", "2", "--columns", "abs_rel"]);
    assert!(own.contains("\\caption{Ours, $n = 7$.}\n\\label{tab:ours}"), "{own}");
    let cells =
        own.lines().filter(|line| line.contains("raw")).flat_map(|line| line.split('&')).last().expect("a cell");
    let digits = cells.trim().trim_start_matches("\\textbf{").split(|c: char| !c.is_ascii_digit() && c != '.').next();
    assert!(digits.expect("a number").split('.').nth(1).is_some_and(|fraction| fraction.len() == 2), "{own}");
    // Intervals depend on the seed, and are reproducible.
    let seeded = |seed: &str| latex(&["--ci", "--resamples", "500", "--seed", seed, "--columns", "abs_rel"]);
    assert!(seeded("1") == seeded("1") && seeded("1") != seeded("2"));
}

#[test]
fn estimates_of_one_name_in_two_stages_are_distinguished() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let stage = |source: &str| {
        format!(
            "
    source: {source}
    nodes:
      stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }} }}
      depth: {{ kind: depth/from-disparity, inputs: {{ disparity: stereo/disparity, calibration: source/calibration }} }}
    score: {{ ground_truth: source/depth, estimates: {{ stereo: depth/depth }} }}"
        )
    };
    let source =
        |frames: &str| format!("{{ kind: synthetic/road, with: {{ frames: {frames}, width: 320, height: 96 }} }}");
    let text = format!(
        "experiment: two\nsources: {{ first: {}, later: {} }}\nstages:\n  develop:{}\n  hold:{}\n\
         variants: {{ plain: {{}}, large: {{ develop.stereo.with.block: 9, hold.stereo.with.block: 9 }} }}\n",
        source("0..3"),
        source("3..6"),
        stage("first"),
        stage("later")
    );
    std::fs::write(folder.join("two.yaml"), text).expect("written");
    succeed(depthloom().current_dir(folder).args(["run", "--no-page", "two.yaml", "--quiet", "--out", "run"]));
    let table = read_csv(&folder.join("run/table.csv"));
    let labels: Vec<String> =
        table.iter().map(|row| format!("{} {} {}", row["stage"], row["variant"], row["estimate"])).collect();
    assert_eq!(labels, ["develop plain stereo", "hold plain stereo", "develop large stereo", "hold large stereo"]);
    // Estimates are compared within their stage.
    let compared = json(folder, &["run", "plain", "large", "--metrics", "abs_rel"]);
    let rows = compared["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 2, "{compared}");
    for (row, stage) in rows.iter().zip(["develop", "hold"]) {
        let value = |variant: &str| {
            let row = table.iter().find(|row| row["stage"] == stage && row["variant"] == variant).expect("a row");
            number(row, "abs_rel")
        };
        assert_eq!(row["stage"], stage);
        let difference = row["difference"].as_f64().expect("a number");
        assert!((difference - (value("large") - value("plain"))).abs() < 1e-12, "{row}");
    }
}

#[test]
fn an_exceeded_limit_exits_with_3_and_an_unmatched_limit_with_2() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    let change = json(folder, &["run", "plain/raw", "strict/raw", "--metrics", "abs_rel"])["rows"][0]["change"].clone();
    let percent = 100.0 * change.as_f64().expect("a number");
    let (below, above) =
        (format!("strict/raw.abs_rel > {}%", percent - 0.01), format!("strict/raw.abs_rel > {}%", percent + 0.01));
    let sides = ["run", "plain", "strict"];
    let exit = |limits: &[&str]| {
        let limits = limits.iter().flat_map(|limit| ["--fail-if", limit]);
        let output = compare(folder, &sides.into_iter().chain(limits).chain(["--json"]).collect::<Vec<_>>());
        let json: Json = serde_json::from_slice(&output.stdout).expect("JSON");
        (output.status.code(), json)
    };
    assert_eq!(exit(&[&above]).0, Some(0));
    let (code, compared) = exit(&[&above, &below]);
    assert_eq!(code, Some(3));
    let exceeded: Vec<_> =
        compared["limits"].as_array().expect("limits").iter().map(|limit| limit["exceeded"].clone()).collect();
    assert_eq!(exceeded, [Json::from(false), Json::from(true)]);
    assert_eq!(compared["error"]["exit_code"], 3);
    // Density has no row of its own; it is the mean over the frames' scores.
    let (code, compared) = exit(&["raw.density < -0.0001", "raw.density > 50%"]);
    let density = |variant: &str| -> f64 {
        let scores = read_csv(&folder.join("run/scores.csv"));
        let is_selected = |row: &&Row| row["variant"] == variant && row["estimate"] == "raw" && row["set"] == "all";
        let densities: Vec<f64> = scores.iter().filter(is_selected).map(|row| number(row, "density")).collect();
        densities.iter().sum::<f64>() / densities.len() as f64
    };
    let (limits, expected) = (&compared["limits"], density("strict") - density("plain"));
    assert!((limits[0]["change"].as_f64().expect("a number") - expected).abs() < 1e-12, "{limits}: {expected}");
    assert!(code == Some(3) && expected < -0.0001 && limits[0]["row"].is_null(), "{limits}");
    assert_eq!((&limits[0]["exceeded"], &limits[1]["exceeded"]), (&Json::from(true), &Json::from(false)));
    // Without an estimate, the limit applies to all pairs that have the metric.
    assert_eq!(exit(&["a1 < -100%"]).1["limits"].as_array().map(Vec::len), Some(2));
    for (limit, message) in [
        ("fused.abs_rel > 1%", "matches no compared estimate with this metric"),
        ("raw.d1 > 0", "matches no compared estimate with this metric"),
        ("raw.abs_rle > 1%", "did you mean `abs_rel`?"),
        ("raw.abs_rel", "has no `>` or `<`"),
    ] {
        let error = refused(folder, &["run", "plain", "strict", "--fail-if", limit]);
        assert!(error.contains(message), "{limit}: {error}");
    }
    // Metrics that were computed in two ways are not compared with a limit.
    run(folder, "near", &["look.score.max_m=40"]);
    let error = refused(folder, &["run", "near", "--fail-if", "abs_rel > 1%"]);
    assert!(error.contains("scored in different ways"), "{error}");
    let compared = json(folder, &["run", "near"]).to_string();
    assert!(compared.contains("differences also include the difference of scoring"), "{compared}");
}

#[test]
fn tables_have_intervals_if_requested() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    let rows = |arguments: &[&str], file: &str| -> Vec<Row> {
        succeed(depthloom().current_dir(folder).args(arguments));
        read_csv(&folder.join(file))
    };
    let variants = rows(&["table", "run", "--ci", "--format", "csv", "--out", "rows.csv"], "rows.csv");
    let report = rows(&["report", "run", "--ci=95", "--out", "tables"], "tables/table.csv");
    let ends = |row: &Row| ["abs_rel_low", "abs_rel", "abs_rel_high"].map(|name| number(row, name));
    let key = |row: &Row| (row["variant"].clone(), row["estimate"].clone());
    for row in &variants {
        let [low, value, high] = ends(row);
        assert!(low < value && value < high, "{row:?}");
        let same = report.iter().find(|other| key(other) == key(row) && other["set"] == "all").expect("the same row");
        assert_eq!(ends(same), [low, value, high]);
    }
    assert_eq!(variants.len(), 6);
    let latex = std::fs::read_to_string(folder.join("tables/table.tex")).expect("the table");
    let stated = "intervals in square brackets (95 \\% BCa bootstrap over frames, 100000 resamples, seed 1)";
    assert!(latex.contains(stated) && latex.contains("\\label{tab:compared}"), "{latex}");
    // Higher confidence yields wider intervals. Intervals are not written by default.
    let wider = rows(&["table", "run", "--ci=99", "--format", "csv", "--out", "rows.csv"], "rows.csv");
    assert!(wider.iter().zip(&variants).all(|(wider, row)| ends(wider)[0] < ends(row)[0]));
    assert!(!read_csv(&folder.join("run/table.csv"))[0].contains_key("abs_rel_low"));
}

#[test]
fn sides_that_cannot_be_compared_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    run(folder, "run", &[]);
    for (arguments, message) in [
        (&["run", "plian"][..], "did you mean `plain`?"),
        (&["run:plian", "run"], "`plian` is neither a run nor a variant or estimate of run"),
        (&["run", "plain"], "there is nothing to compare plain with"),
        (&["run", "plain", "large/raw"], "cannot be compared with one another"),
        (&["run", "plain", "large", "--baseline", "larg"], "did you mean `large`?"),
        (&["run", "plain", "large", "--metrics", "d1"], "`d1`"),
        (&["run", "plain", "large", "--zone", "0..10"], "no zone"),
        (&["nothing", "plain"], "failed to open nothing"),
    ] {
        let error = refused(folder, arguments);
        assert!(error.contains(message), "{arguments:?}: {error}");
    }
}
