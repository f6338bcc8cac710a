//! Samples, and what is asked of them, against the oracle's percentiles and NumPy.

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
fn samples_and_errors_are_numpys() {
    let Some(shared) = shared("samples_and_errors_are_numpys") else { return };
    let Some(python) = python_package("samples_and_errors_are_numpys") else { return };
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
    let inquiries: &[(&str, &[&str])] = &[
        ("distance", &["--set", "valid,common"]),
        ("estimate", &["--bins", "log:8"]),
        ("weight", &["--set", "common"]),
        ("row", &["--bins", "linear:7", "--set", "valid,common"]),
        ("frame", &[]),
    ];
    let mut check = Command::new(python);
    check.arg(workspace().join("tests/python/check_analysis.py")).arg(run.join("samples.parquet")).arg(&maps);
    for (by, more) in inquiries {
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
    let told: serde_json::Value = serde_json::from_slice(&succeed(&mut check).stdout).expect("JSON");
    assert!(told["rows"].as_u64().is_some_and(|rows| rows > 1000), "{told}");
}

#[test]
fn errors_against_distance_are_the_oracles() {
    if !full("errors_against_distance_are_the_oracles") {
        return;
    }
    let Some(shared) = shared("errors_against_distance_are_the_oracles") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let run = folder.path().join("run");
    golden(&shared, &run);
    let out = folder.path().join("bins.csv");
    succeed(depthloom().arg("analyse").arg(&run).args(["--format", "csv", "--out"]).arg(&out));
    let (ours, theirs) = (read_csv(&out), read_csv(&shared.join("oracle/golden/ground_plane/percentiles.csv")));
    let mut compared = 0;
    for golden in &theirs {
        let (variant, estimate) = golden["estimate"].rsplit_once('/').unwrap_or(("", &golden["estimate"]));
        let is_it = |row: &&crate::support::Row| {
            let bin: f64 = row["bin_from_m"].parse().expect("an edge");
            row["variant"] == variant
                && row["estimate"] == estimate
                && bin == golden["bin_m"].parse::<f64>().expect("a bin")
        };
        let row = ours.iter().find(is_it).unwrap_or_else(|| panic!("no row as {golden:?}"));
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
fn where_samples_cannot_be_written_beside_the_recording_the_error_names_another_way() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = small(folder.path());
    let marker = std::fs::File::open(run.join("depthloom-run.json")).expect("a run has a marker");
    marker.lock().expect("nobody else writes to it");
    let refused = depthloom().arg("analyse").arg(&run).output().expect("runs");
    let text = String::from_utf8_lossy(&refused.stderr);
    assert!(!refused.status.success() && text.contains("samples") && text.contains("--out FILE.parquet"), "{text}");
    let elsewhere = folder.path().join("elsewhere.parquet");
    succeed(depthloom().arg("samples").arg(&run).arg("--out").arg(&elsewhere));
    let table = succeed(depthloom().arg("analyse").arg(&elsewhere));
    assert!(String::from_utf8_lossy(&table.stdout).contains("bin_from_m"));
    assert!(!run.join("samples.parquet").exists());
}

#[test]
fn samples_are_made_when_they_are_asked_for_and_are_equal_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = small(folder.path());
    let samples = run.join("samples.parquet");
    assert!(!samples.exists());
    let text = succeed(depthloom().arg("analyse").arg(&run).args(["--bins", "edges:0,10,80"]));
    let text = String::from_utf8(text.stdout).expect("text");
    assert!(text.contains("bin_from_m") && text.lines().count() < 12, "{text}");
    let made = std::fs::read(&samples).expect("made by the first question");
    let elsewhere = folder.path().join("again.parquet");
    succeed(depthloom().arg("samples").arg(&run).arg("--out").arg(&elsewhere));
    assert_eq!(std::fs::read(&elsewhere).expect("written"), made, "equal files");
    // Those of another recording are made again; a file may be asked by itself.
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
    assert_ne!(std::fs::read(other.join("samples.parquet")).expect("there"), made, "they were another run's");
    let both =
        succeed(depthloom().arg("analyse").args([&elsewhere, &other]).args(["--by", "frame", "--format", "csv"]));
    let both = String::from_utf8(both.stdout).expect("text");
    assert!(both.starts_with("run,stage,variant,estimate,set,position,frame,pixels,count,"), "{both}");
    assert_eq!(both.lines().count(), 1 + 4 + 1);
    // It is the run's: the folder may be removed as one.
    succeed(depthloom().args(["runs", "rm"]).arg(&other));
    assert!(!other.exists());
}

#[test]
fn questions_that_have_no_answer_say_what_there_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = small(folder.path());
    let refused = |run: &Path, arguments: &[&str]| {
        let ended = depthloom().arg("analyse").arg(run).args(arguments).output().expect("the binary starts");
        assert_eq!(ended.status.code(), Some(2), "{arguments:?}");
        String::from_utf8(ended.stderr).expect("text")
    };
    let relative = succeed(depthloom().arg("analyse").arg(&run).args(["--by", "error", "--relative"]));
    assert!(String::from_utf8_lossy(&relative.stdout).contains("by relative error"));
    for (arguments, words) in [
        (&["--by", "colour"][..], "no column `colour`"),
        (&["--by", "weight"], "no weight was recorded"),
        (&["--estimates", "mono"], "there are stereo"),
        (&["--percentiles", "101"], "no percentile 101"),
        (&["--bins", "edges:5,1"], "ascending"),
        (&["--bins", "width:0.00001"], "more than 20000"),
        (&["--by", "frame", "--bins", "log:3"], "takes no --bins"),
        (&["--gross", "big"], "no limit"),
    ] {
        let told = refused(&run, arguments);
        assert!(told.contains(words), "{arguments:?}: {told}");
    }
    // What is no file of samples, under the name of one.
    let file = folder.path().join("table.parquet");
    std::fs::copy(run.join("table.parquet"), &file).expect("copied");
    let told = refused(&file, &[]);
    assert!(told.contains("is no file of samples") && told.contains("depthloom samples RUN"), "{told}");
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
    let told = refused(&scores, &[]);
    assert!(told.contains("not recorded") && told.contains("`record:`"), "{told}");
}
