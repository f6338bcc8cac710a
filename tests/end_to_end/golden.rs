//! Metrics and percentiles checked against the reference implementation: OpenCV, NumPy, ONNX Runtime
//! (`../shared/oracle`).

use std::path::Path;

use crate::support::{Row, depthloom, label, number, onnx_runtime, read_csv, set, shared, succeed};

const SCORES: [&str; 8] = ["a1", "a2", "a3", "abs_rel", "sq_rel", "rmse", "rmse_log", "silog"];

fn agree(ours: f64, theirs: f64, relative: f64) -> bool {
    (ours - theirs).abs() <= relative * theirs.abs().max(1e-9)
}

pub(crate) fn assert_scores_agree(ours: &Path, theirs: &Path, relative: f64) {
    let (ours, theirs) = (read_csv(ours), read_csv(theirs));
    let name = |row: &Row| (row["frame"].clone(), label(row), set(row).to_owned());
    let ours: std::collections::BTreeMap<_, _> = ours.iter().map(|row| (name(row), row)).collect();
    assert_eq!(ours.len(), theirs.len(), "as many rows as the reference");
    for golden in &theirs {
        let row = ours.get(&name(golden)).unwrap_or_else(|| panic!("no row {:?}", name(golden)));
        assert_eq!(row["pixels"], golden["pixels"], "pixels of {:?}", name(golden));
        for score in SCORES {
            let (a, b) = (number(row, score), number(golden, score));
            assert!(
                agree(a, b, relative),
                "{score} of {:?}: {a} differs from {b} by more than {relative}",
                name(golden)
            );
        }
    }
}

/// Error against distance on the pixel set `valid`, with the column names of the reference.
pub(crate) fn valid_bins(path: &Path) -> Vec<Row> {
    let mut rows = read_csv(path);
    rows.retain(|row| row["set"] == "valid");
    for row in &mut rows {
        assert_eq!(number(row, "bin_to_m"), number(row, "bin_from_m") + 1.0, "{row:?}");
        let renamed = row.iter().map(|(name, value)| {
            let percentile = name.strip_prefix("error_").and_then(|name| name.strip_suffix("_m"));
            let name = if name == "bin_from_m" { "bin_m" } else { percentile.unwrap_or(name) };
            (name.to_owned(), value.clone())
        });
        *row = renamed.collect();
    }
    rows
}

/// `tolerance` maps a percentile and its distance to the allowed difference, all in metres.
pub(crate) fn assert_percentiles_agree(ours: &Path, theirs: &Path, tolerance: impl Fn(f64, f64) -> f64) {
    let (ours, theirs) = (valid_bins(ours), read_csv(theirs));
    let name = |row: &Row| (label(row), row["bin_m"].parse::<u32>().expect("a bin"));
    let ours: std::collections::BTreeMap<_, _> = ours.iter().map(|row| (name(row), row)).collect();
    assert_eq!(ours.len(), theirs.len(), "as many bins as the reference");
    for golden in &theirs {
        let row = ours.get(&name(golden)).unwrap_or_else(|| panic!("no bin {:?}", name(golden)));
        assert_eq!(row["count"], golden["count"], "count of {:?}", name(golden));
        for percentile in ["p5", "p25", "p50", "p75", "p95"] {
            let (a, b) = (number(row, percentile), number(golden, percentile));
            let max = tolerance(b, number(golden, "bin_m"));
            assert!(
                (a - b).abs() <= max,
                "{percentile} of {:?}: {a} differs from {b} by more than {max:.1e}",
                name(golden)
            );
        }
    }
}

/// A tolerance relative to the error, and absolute for errors below one metre.
fn relative(share: f64) -> impl Fn(f64, f64) -> f64 {
    move |error_m, _| share * error_m.max(1.0)
}

#[test]
fn ground_plane_metrics_match_the_reference() {
    let Some(shared) = shared("ground_plane_metrics_match_the_reference") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    succeed(
        depthloom()
            .args(["run", "--no-page", "tests/experiments/golden-ground-plane.yaml", "--out"])
            .arg(&out)
            .env("KITTI_STEREO_2015", shared.join("data/kitti_stereo_2015")),
    );
    let golden = shared.join("oracle/golden/ground_plane");
    assert_scores_agree(&out.join("scores.csv"), &golden.join("scores.csv"), 1e-4);
    assert_percentiles_agree(&out.join("error_vs_distance.csv"), &golden.join("percentiles.csv"), relative(1e-4));
}

#[test]
fn network_metrics_match_the_reference() {
    let Some(shared) = shared("network_metrics_match_the_reference") else { return };
    let Some(library) = onnx_runtime("network_metrics_match_the_reference") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    succeed(
        depthloom()
            .args(["run", "--no-page", "tests/experiments/golden-onnx.yaml", "--out"])
            .arg(&out)
            .env("KITTI_STEREO_2015", shared.join("data/kitti_stereo_2015"))
            .env("MONO_MODEL", shared.join("models/ssl_unet.onnx"))
            .env("ORT_DYLIB_PATH", library),
    );
    let golden = shared.join("oracle/golden/ssl_unet");
    assert_scores_agree(&out.join("scores.csv"), &golden.join("scores.csv"), 1e-3);
    assert_percentiles_agree(&out.join("error_vs_distance.csv"), &golden.join("percentiles.csv"), relative(1e-3));
}

#[test]
fn the_table_is_the_mean_over_frames() {
    let Some(shared) = shared("the_table_is_the_mean_over_frames") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    succeed(
        depthloom()
            .args(["run", "--no-page", "tests/experiments/golden-ground-plane.yaml", "--out"])
            .arg(&out)
            .env("KITTI_STEREO_2015", shared.join("data/kitti_stereo_2015")),
    );
    let ours = read_csv(&out.join("table.csv"));
    let golden = read_csv(&shared.join("oracle/golden/ground_plane/table.csv"));
    assert_eq!(ours.len(), golden.len());
    for row in &golden {
        let same = |other: &&Row| label(other) == label(row) && set(other) == set(row);
        let own = ours.iter().find(same).unwrap_or_else(|| panic!("no row {row:?}"));
        for score in SCORES {
            // The table of the reference is rounded to four decimals.
            assert!((number(own, score) - number(row, score)).abs() <= 1e-4, "{score}: {own:?} {row:?}");
        }
    }
}
