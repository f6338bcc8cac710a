//! `analyse` and samples, compared with the percentiles of the reference implementation and with NumPy.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::{depthloom, full, python_package, read_csv, shared, succeed, workspace};

/// The golden experiment on real frames, without two of its variants.
fn golden(shared: &Path, out: &Path) {
    let mut run = depthloom();
    run.args(["run", "--no-page", "tests/experiments/golden-ground-plane.yaml", "--quiet", "--samples", "--out"])
        .arg(out);
    succeed(run.env("KITTI_STEREO_2015", shared.join("data/kitti_stereo_2015")));
}

#[test]
fn samples_and_error_statistics_match_numpy() {
    let Some(shared) = shared("samples_and_error_statistics_match_numpy") else { return };
    let Some(python) = python_package("samples_and_error_statistics_match_numpy") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let run = folder.path().join("run");
    golden(&shared, &run);
    let maps = folder.path().join("maps");
    succeed(
        depthloom()
            .arg("export")
            .arg(&run)
            .args(["source/depth", "depth/depth", "--format", "npy", "--quiet", "--out"])
            .arg(&maps),
    );
    let queries: &[(&str, &[&str])] = &[
        ("distance", &["--pixels", "valid,common"]),
        ("estimate", &["--bins", "log:8"]),
        ("weight", &["--pixels", "common"]),
        ("row", &["--bins", "linear:7", "--pixels", "valid,common"]),
        ("frame", &[]),
    ];
    let mut check = Command::new(python);
    check.arg(workspace().join("tests/python/check_analysis.py")).arg(run.join("samples.parquet")).arg(&maps);
    for (by, more) in queries {
        let out = folder.path().join(format!("{by}.json"));
        let mut analyse = depthloom();
        analyse.arg("analyse").arg(&run).args([
            "--percentiles",
            "0,5,50,97.5",
            "--by",
            by,
            "--format",
            "json",
            "--out",
        ]);
        succeed(analyse.arg(&out).args(*more));
        check.arg(out);
    }
    let checked: serde_json::Value = serde_json::from_slice(&succeed(&mut check).stdout).expect("JSON");
    assert!(checked["rows"].as_u64().is_some_and(|rows| rows > 1000), "{checked}");
}

#[test]
fn errors_by_distance_match_the_reference_implementation() {
    if !full("errors_by_distance_match_the_reference_implementation") {
        return;
    }
    let Some(shared) = shared("errors_by_distance_match_the_reference_implementation") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let run = folder.path().join("run");
    golden(&shared, &run);
    let out = folder.path().join("bins.csv");
    succeed(depthloom().arg("analyse").arg(&run).args(["--format", "csv", "--out"]).arg(&out));
    let (ours, theirs) = (read_csv(&out), read_csv(&shared.join("oracle/golden/ground_plane/percentiles.csv")));
    let mut compared = 0;
    for golden in &theirs {
        let (variant, estimate) = golden["estimator"].rsplit_once('/').unwrap_or(("", &golden["estimator"]));
        let is_same_bin = |row: &&crate::support::Row| {
            let bin: f64 = row["bin_from_m"].parse().expect("an edge");
            row["variant"] == variant
                && row["estimate"] == estimate
                && bin == golden["bin_m"].parse::<f64>().expect("a bin")
        };
        let row = ours.iter().find(is_same_bin).unwrap_or_else(|| panic!("no row as {golden:?}"));
        assert_eq!(row["count"], golden["count"], "{golden:?}");
        for percentile in ["p5", "p25", "p50", "p75", "p95"] {
            let number = |text: &str| text.parse::<f64>().expect("a number");
            let (a, b) = (number(&row[format!("error_{percentile}_m").as_str()]), number(&golden[percentile]));
            assert!((a - b).abs() <= 1e-4 * b.max(1.0), "{percentile} of {golden:?}: {a}");
            compared += 1;
        }
    }
    assert!(compared > 1000, "{compared}");
}

fn small(folder: &Path) -> PathBuf {
    let run = folder.join("run");
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    succeed(
        depthloom().args(["run", "--no-page", "experiments/first-look.yaml", "--quiet", "--out"]).arg(&run).args(small),
    );
    run
}

#[test]
fn unwritable_samples_file_error_suggests_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = small(folder.path());
    let marker = std::fs::File::open(run.join("depthloom-run.json")).expect("a run has a marker");
    marker.lock().expect("no other process locks it");
    let refused = depthloom().arg("analyse").arg(&run).output().expect("runs");
    let text = String::from_utf8_lossy(&refused.stderr);
    assert!(!refused.status.success() && text.contains("samples") && text.contains("--out FILE.parquet"), "{text}");
    let other_file = folder.path().join("other_file.parquet");
    succeed(depthloom().args(["analyse", "--samples-only"]).arg(&run).arg("--out").arg(&other_file));
    let table = succeed(depthloom().arg("analyse").arg(&other_file));
    assert!(String::from_utf8_lossy(&table.stdout).contains("bin_from_m"));
    assert!(!run.join("samples.parquet").exists());
}

#[test]
fn samples_are_written_on_demand_and_are_reproducible() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = small(folder.path());
    let samples = run.join("samples.parquet");
    assert!(!samples.exists());
    let text = succeed(depthloom().arg("analyse").arg(&run).args(["--bins", "edges:0,10,80"]));
    let text = String::from_utf8(text.stdout).expect("text");
    assert!(text.contains("bin_from_m") && text.lines().count() < 12, "{text}");
    let first = std::fs::read(&samples).expect("written by the first query");
    let other_file = folder.path().join("again.parquet");
    succeed(depthloom().args(["analyse", "--samples-only"]).arg(&run).arg("--out").arg(&other_file));
    assert_eq!(std::fs::read(&other_file).expect("written"), first, "equal files");
    // Samples of another recording are replaced. `analyse` also reads a samples file alone.
    let other = folder.path().join("other");
    succeed(
        depthloom().args(["run", "--no-page", "experiments/first-look.yaml", "--quiet", "--out"]).arg(&other).args([
            "--set",
            "sources.street.with.width=320",
            "--set",
            "sources.street.with.height=96",
            "--set",
            "sources.street.with.frames=0..1",
        ]),
    );
    std::fs::copy(&samples, other.join("samples.parquet")).expect("copied");
    succeed(depthloom().arg("analyse").arg(&other));
    assert_ne!(std::fs::read(other.join("samples.parquet")).expect("there"), first, "they belonged to another run");
    let both =
        succeed(depthloom().arg("analyse").args([&other_file, &other]).args(["--by", "frame", "--format", "csv"]));
    let both = String::from_utf8(both.stdout).expect("text");
    assert!(both.starts_with("run,stage,variant,estimate,set,position,frame,pixels,count,"), "{both}");
    assert_eq!(both.lines().count(), 1 + 4 + 1);
    // The samples belong to the run, so `runs rm` removes them with the folder.
    succeed(depthloom().args(["runs", "rm"]).arg(&other));
    assert!(!other.exists());
}

#[test]
fn invalid_analyse_arguments_list_the_available_values() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = small(folder.path());
    let refused = |run: &Path, arguments: &[&str]| {
        let output = depthloom().arg("analyse").arg(run).args(arguments).output().expect("the binary starts");
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        String::from_utf8(output.stderr).expect("text")
    };
    let relative = succeed(depthloom().arg("analyse").arg(&run).args(["--by", "error", "--relative"]));
    assert!(String::from_utf8_lossy(&relative.stdout).contains("by relative error"));
    for (arguments, words) in [
        (&["--by", "colour"][..], "no column `colour`"),
        (&["--by", "weight"], "no confidence was recorded"),
        (&["--estimates", "mono"], "available: stereo"),
        (&["--percentiles", "101"], "percentile 101 is out of range"),
        (&["--bins", "edges:5,1"], "ascending"),
        (&["--bins", "width:0.00001"], "the maximum is 20000"),
        (&["--by", "frame", "--bins", "log:3"], "does not support --bins"),
        (&["--outlier", "big"], "is not a limit"),
    ] {
        let error = refused(&run, arguments);
        assert!(error.contains(words), "{arguments:?}: {error}");
    }
    // A Parquet file that does not contain samples.
    let file = folder.path().join("table.parquet");
    std::fs::copy(run.join("table.parquet"), &file).expect("copied");
    let error = refused(&file, &[]);
    assert!(
        error.contains("is not a samples file") && error.contains("depthloom analyse RUN --samples-only"),
        "{error}"
    );
    // Maps that were not recorded.
    let scores = folder.path().join("scores");
    succeed(
        depthloom()
            .args([
                "run",
                "experiments/first-look.yaml",
                "--quiet",
                "--set",
                "record=[]",
                "--set",
                "sources.street.with.frames=0..1",
                "--out",
            ])
            .arg(&scores),
    );
    let error = refused(&scores, &[]);
    assert!(error.contains("not recorded") && error.contains("`record:`"), "{error}");
}

#[test]
fn caption_label_and_digits_of_the_latex_table_of_errors() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = small(folder.path());
    let latex = |more: &[&str]| {
        let mut analyse = depthloom();
        analyse.arg("analyse").arg(&run).args(["--bins", "edges:0,10,80", "--format", "latex"]).args(more);
        String::from_utf8(succeed(&mut analyse).stdout).expect("text")
    };
    let own = latex(&["--caption", "Ours, $n = 4$.", "--label", "tab:ours", "--digits", "5"]);
    assert!(own.contains("\\caption{Ours, $n = 4$.}\n\\label{tab:ours}"), "{own}");
    // A wide table is cut into several: the row is in each of them.
    let rows = own.lines().filter(|line| line.starts_with("stereo & 0 & 10 &"));
    let numbers = rows.flat_map(|row| row.trim_end_matches(" \\\\").split(" & ")).filter(|number| number.contains('.'));
    let digits: Vec<usize> = numbers.map(|number| number.split_once('.').map_or(0, |(_, end)| end.len())).collect();
    // Eight errors; then the share of outliers, which has digits of its own.
    assert_eq!(digits, [5, 5, 5, 5, 5, 5, 5, 5, 4], "{own}");
    assert!(latex(&[]).contains("\\label{tab:first-look-errors-by-ground-truth-distance}"), "{}", latex(&[]));
    let text = succeed(depthloom().arg("analyse").arg(&run).args(["--bins", "edges:0,10,80", "--digits", "1"]));
    let text = String::from_utf8(text.stdout).expect("text");
    let row = text.lines().find(|line| line.starts_with("stereo")).unwrap_or_else(|| panic!("{text}"));
    // Those that fit beside the bins.
    let errors = row.split_whitespace().skip(5);
    assert!(errors.clone().all(|number| number.split_once('.').is_some_and(|(_, end)| end.len() == 1)), "{row}");
    assert!(errors.count() >= 5, "{row}");
    let refused = depthloom().arg("analyse").arg(&run).args(["--samples-only", "--digits", "2"]).output();
    assert_eq!(refused.expect("the binary starts").status.code(), Some(2));
}

#[test]
fn a_run_that_cannot_write_its_samples_fails_before_its_first_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let mut run = depthloom();
    run.args(["run", "experiments/first-look.yaml", "--samples", "--set", "record=[]", "--out"]).arg(&out);
    let output = run.output().expect("the binary starts");
    assert_eq!(output.status.code(), Some(2));
    let error = String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
    let missing = "the ground truth `look.source/depth` and the estimate `look.depth/depth` are not recorded";
    assert!(error.contains(missing) && error.contains("or run without --samples"), "{error}");
    assert_eq!(folder.path().read_dir().expect("a folder").count(), 0, "nothing was written");
}

#[test]
fn frames_of_variants_with_sources_of_their_own_are_selected() {
    let folder = tempfile::tempdir().expect("a folder");
    let (experiment, run) = (folder.path().join("seeds.yaml"), folder.path().join("run"));
    let look = workspace().join("experiments/first-look.yaml");
    let text = format!(
        "extends: {}\nsources: {{ street: {{ with: {{ width: 320, height: 96 }} }} }}\n\
         variants: {{ one: {{}}, two: {{ sources.street.with.seed: 2 }} }}\n",
        look.display()
    );
    std::fs::write(&experiment, text).expect("written");
    succeed(depthloom().args(["run", "--no-page", "--quiet"]).arg(&experiment).arg("--out").arg(&run));
    let table =
        succeed(depthloom().arg("analyse").arg(&run).args(["--by", "frame", "--frames", "2", "--format", "csv"]));
    let rows = String::from_utf8(table.stdout).expect("text");
    assert_eq!(rows.lines().count(), 1 + 2, "one frame of each variant: {rows}");
}

#[test]
fn selected_frames_are_those_of_a_run_with_these_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = small(folder.path());
    let few = folder.path().join("few");
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    succeed(
        depthloom()
            .args([
                "run",
                "--no-page",
                "experiments/first-look.yaml",
                "--quiet",
                "--set",
                "sources.street.with.frames=1..3",
            ])
            .args(small)
            .arg("--out")
            .arg(&few),
    );
    let csv = |run: &Path, more: &[&str]| {
        let out = folder.path().join("bins.csv");
        succeed(depthloom().arg("analyse").arg(run).args(["--format", "csv", "--out"]).arg(&out).args(more));
        std::fs::read_to_string(&out).expect("a table")
    };
    assert_eq!(csv(&run, &["--frames", "1..3"]), csv(&few, &[]));
    assert_ne!(csv(&run, &[]), csv(&few, &[]));
    let refused = |run: &Path, frames: &str| {
        let output = depthloom().arg("analyse").arg(run).args(["--frames", frames]).output().expect("started");
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(refused(&run, "99").contains("99"));
    // A file of samples with these frames alone. It is not taken for the samples of the run.
    let part = folder.path().join("part.parquet");
    let only = ["--samples-only", "--frames", "1..3", "--out"];
    succeed(depthloom().arg("analyse").arg(&run).args(only).arg(&part));
    assert_eq!(csv(&part, &[]), csv(&few, &[]));
    let all = csv(&run, &[]);
    std::fs::copy(&part, run.join("samples.parquet")).expect("copied");
    assert_eq!(csv(&run, &[]), all, "samples of some frames are replaced");
    let output = depthloom().arg("analyse").arg(&run).args(&only[..3]).output().expect("started");
    assert!(output.status.code() == Some(2) && String::from_utf8_lossy(&output.stderr).contains("needs --out"));
    let samples = refused(&run.join("samples.parquet"), "1");
    assert!(samples.contains("--frames needs a run"), "{samples}");
}
