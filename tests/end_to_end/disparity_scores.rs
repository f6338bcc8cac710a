//! Disparities and depths scored side by side, by zone: `experiments/stereo-scores.yaml`, small.

use std::collections::BTreeSet;

use crate::support::{Row, depthloom, number, read_csv, succeed};

#[test]
fn depths_and_disparities_have_their_own_metrics_and_zones() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = folder.path().join("run");
    let small = ["frames=0..3", "width=320", "height=96"].map(|set| format!("sources.street.with.{set}"));
    let mut command = depthloom();
    command.args(["run", "--no-page", "experiments/stereo-scores.yaml", "--out"]).arg(&run);
    for set in &small {
        command.args(["--set", set]);
    }
    let output = succeed(&mut command);
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("but over all pixels of these frames for disparity"), "{text}");

    let rows = read_csv(&run.join("scores.csv"));
    let rows_of = |estimate: &str, set: &str, zone: &str| -> Vec<&Row> {
        let is_selected = |row: &&Row| row["estimate"] == estimate && row["set"] == set && row["zone"] == zone;
        rows.iter().filter(is_selected).collect()
    };
    let zones: BTreeSet<&str> = rows.iter().map(|row| row["zone"].as_str()).collect();
    for zone in
        ["", "0..10", "50..80", "row_3_of_3", "edges", "textureless", "visible", "occluded", "background", "foreground"]
    {
        assert!(zones.contains(zone), "no zone `{zone}` among {zones:?}");
    }
    for (estimate, own, others) in [("depth", "abs_rel", "d1"), ("disparity", "d1", "abs_rel")] {
        let whole = rows_of(estimate, "valid", "");
        assert_eq!(whole.len(), 3);
        assert!(whole.iter().all(|row| row[others].is_empty() && number(row, own) < 1.0), "{whole:?}");
        // The bands of distance partition the image.
        for (frame, row) in whole.iter().enumerate() {
            let bands = ["0..10", "10..20", "20..30", "30..50", "50..80"];
            let pixels: f64 = bands.iter().map(|band| number(rows_of(estimate, "valid", band)[frame], "pixels")).sum();
            let far = if estimate == "depth" { 0.0 } else { number(row, "pixels") - pixels };
            assert!(far >= 0.0 && (pixels + far - number(row, "pixels")).abs() < 0.5, "{estimate} {frame}");
        }
    }
    // An invalid pixel counts as wrong; filling makes some of them right.
    for ((valid, filled), all) in rows_of("disparity", "valid", "")
        .iter()
        .zip(rows_of("disparity", "filled", ""))
        .zip(rows_of("disparity", "all", ""))
    {
        let d1 = |row: &Row| number(row, "d1");
        assert!(d1(valid) <= d1(filled) && d1(filled) <= d1(all), "{valid:?} {filled:?} {all:?}");
        let wrong = d1(valid) * number(valid, "pixels") + number(all, "pixels") - number(valid, "pixels");
        assert!((d1(all) * number(all, "pixels") - wrong).abs() < 1e-6);
    }
    // Depths over all pixels and filled disparities share one row.
    let table_of = |arguments: &[&str]| {
        let output = succeed(depthloom().arg("table").arg(&run).args(arguments));
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    let both: serde_json::Value =
        serde_json::from_str(&table_of(&["--columns", "abs_rel,d1", "--pixels", "filled", "--json"])).expect("JSON");
    let row = both["rows"].as_array().expect("rows").iter().find(|row| row["d1"].is_number()).expect("a row");
    assert!(row["abs_rel"].is_number() && row["set"] == "all+filled", "{row}");
    let filled: Vec<f64> =
        rows_of("disparity", "filled", "").iter().map(|row| number(row, "d1") * number(row, "pixels")).collect();
    let pixels: f64 = rows_of("disparity", "filled", "").iter().map(|row| number(row, "pixels")).sum();
    let d1 = row["d1"].as_f64().expect("a number");
    assert!((d1 - filled.iter().sum::<f64>() / pixels).abs() < 1e-12, "{row}");

    // In the table, metrics of disparity are pooled over the pixels of all frames, whose numbers differ.
    let table = read_csv(&run.join("table.csv"));
    let pooled = table.iter().find(|row| row["estimate"] == "disparity" && row["set"] == "all").expect("a row");
    let frames = rows_of("disparity", "all", "");
    let sum = |weight: &dyn Fn(&Row) -> f64| frames.iter().map(|row| weight(row)).sum::<f64>();
    let expected = sum(&|row| number(row, "d1") * number(row, "pixels")) / sum(&|row| number(row, "pixels"));
    assert!((number(pooled, "d1") - expected).abs() < 1e-12, "{pooled:?}");
}
