//! Values of earlier runs are reused, and the results equal those of a fresh run.

use std::path::{Path, PathBuf};

use serde_json::Value as Json;

use crate::support::{depthloom, full, succeed, workspace};

/// Two stages, one with training, on a small street.
pub(crate) fn experiment(folder: &Path) -> PathBuf {
    let path = folder.join("small.yaml");
    let table1 = workspace().join("experiments/table1.yaml");
    let text = format!(
        "extends: {}\nexperiment: small\nsources:\n  train: {{ with: {{ frames: 0..6, width: 160, height: 64 }} }}\n  test: {{ with: {{ frames: 0..6, width: 160, height: 64 }} }}\n\
         stages:\n  learn:\n    nodes:\n      samples: {{ with: {{ size: [64, 32] }} }}\n      train: {{ with: {{ steps: 4, batch: 2 }} }}\n",
        table1.display()
    );
    std::fs::write(&path, text).expect("written");
    path
}

/// Runs the experiment with reuse, or fresh. Returns the JSON report.
fn run(experiment: &Path, out: &Path, fresh: bool, set: &[&str]) -> Json {
    let mut command = depthloom();
    if !fresh {
        command.env_remove("DEPTHLOOM_FRESH");
    }
    // This folder has no `runs`, so only runs in the folder of `out` are reused.
    command.current_dir(experiment.parent().expect("a folder")).args([
        "run",
        "--no-page",
        "--json",
        "--workers",
        "2",
        "--out",
    ]);
    command.arg(out).arg(experiment).args(set.iter().flat_map(|set| ["--set", set]));
    serde_json::from_slice(&succeed(&mut command).stdout).expect("JSON")
}

/// The reuse that `plan` predicts for a run.
fn predicted_reuse(experiment: &Path, out: &Path, set: &[&str]) -> Json {
    let mut command = depthloom();
    command.current_dir(experiment.parent().expect("a folder")).args(["plan", "--reuse", "--json", "--out"]).arg(out);
    command.arg(experiment).args(set.iter().flat_map(|set| ["--set", set]));
    serde_json::from_slice(&succeed(&mut command).stdout).expect("JSON")
}

fn recording(out: &Path) -> Vec<u8> {
    std::fs::read(out.join("recording.mcap")).expect("a recording")
}

/// The number of reused values of a node, and the number of all its values; `None` if none was reused.
fn reused(run: &Json, stage: &str, node: &str) -> Option<(u64, u64)> {
    let nodes = run["reused"]["nodes"].as_array().expect("nodes");
    let entry = nodes.iter().find(|entry| entry["stage"] == stage && entry["node"] == node)?;
    Some((entry["reused"].as_u64()?, entry["of"].as_u64()?))
}

#[test]
fn a_run_with_reuse_writes_the_same_bytes_as_a_fresh_one() {
    if !full("a_run_with_reuse_writes_the_same_bytes_as_a_fresh_one") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    let (shelf, apart) = (folder.path().join("shelf"), folder.path().join("apart"));
    let first = run(&experiment, &shelf.join("first"), false, &[]);
    assert_eq!(first["reused"]["nodes"], serde_json::json!([]));
    let changes: [(&str, &[&str]); 9] = [
        ("nothing", &[]),
        ("a-filter", &["compare.fused.with.size=3"]),
        ("learning", &["learn.train.with.steps=5"]),
        ("stereo", &["compare.stereo.with.block=7"]),
        ("every", &["record.every=2"]),
        ("a-view", &["record.view=true"]),
        ("frames", &["sources.test.with.frames=3..9"]),
        ("one-variant-fewer", &["variants.no_scaling=null"]),
        ("little-recorded", &["record=[source/depth, fused]"]),
    ];
    for (name, set) in changes {
        let predicted = predicted_reuse(&experiment, &shelf.join(name), set);
        let report = run(&experiment, &shelf.join(name), false, set);
        run(&experiment, &apart.join(name), true, set);
        assert!(recording(&shelf.join(name)) == recording(&apart.join(name)), "{name}: {}", report["reused"]);
        for file in ["scores.csv", "table.csv", "error_vs_distance.csv"] {
            let table = |out: &Path| std::fs::read(out.join(name).join(file)).expect("a table");
            assert!(table(&shelf) == table(&apart), "{name}: {file}");
        }
        let predicted = predicted["nodes"].as_array().expect("nodes").iter().filter(|node| node["taken"] != 0);
        let predicted = predicted.map(|node| (node["stage"].clone(), node["node"].clone(), node["taken"].clone()));
        let actual = report["reused"]["nodes"].as_array().expect("nodes").iter();
        let actual = actual.map(|node| (node["stage"].clone(), node["node"].clone(), node["reused"].clone()));
        assert_eq!(predicted.collect::<Vec<_>>(), actual.collect::<Vec<_>>(), "{name}: predicted and actual reuse");
        match name {
            "nothing" => {
                let nodes = report["reused"]["nodes"].as_array().expect("nodes");
                assert_eq!(nodes.len(), 27);
                assert!(nodes.iter().all(|node| node["reused"] == node["of"]), "{report}");
            }
            "a-filter" => {
                assert_eq!(reused(&report, "learn", "train"), Some((1, 1)));
                assert_eq!(reused(&report, "compare", "stereo"), Some((6, 6)));
                assert_eq!(reused(&report, "compare", "fused"), None);
            }
            "learning" => {
                assert_eq!(reused(&report, "learn", "stereo"), Some((6, 6)), "no stereo is computed");
                assert_eq!(reused(&report, "learn", "samples"), Some((6, 6)));
                assert_eq!(reused(&report, "learn", "train"), None);
                assert_eq!(reused(&report, "compare", "stereo"), Some((6, 6)));
                assert_eq!(reused(&report, "compare", "mono"), None);
            }
            "frames" => assert_eq!(reused(&report, "compare", "stereo"), Some((3, 6))),
            _ => {}
        }
    }
}

#[test]
fn with_fresh_nothing_is_reused() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    run(&experiment, &folder.path().join("first"), false, &[]);
    let mut command = depthloom();
    command.env_remove("DEPTHLOOM_FRESH").args(["run", "--fresh", "--json", "--out"]).arg(folder.path().join("second"));
    let report: Json = serde_json::from_slice(&succeed(command.arg(&experiment)).stdout).expect("JSON");
    assert_eq!(report["reused"], serde_json::json!({ "nodes": [], "from": [], "audited": 0 }));
}

#[test]
fn damaged_values_are_recomputed_with_a_warning() {
    if !full("damaged_values_are_recomputed_with_a_warning") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    let shelf = folder.path().join("shelf");
    run(&experiment, &shelf.join("first"), false, &[]);
    let intact = recording(&shelf.join("first"));
    // Bits throughout the file: in frames of both stages, in the trained network, and between them.
    for part in 1..16 {
        let mut bytes = intact.clone();
        let at = bytes.len() / 16 * part + part;
        bytes[at] ^= 1 << (part % 8);
        std::fs::write(shelf.join("first/recording.mcap"), bytes).expect("written");
        let out = shelf.join("again");
        let report = run(&experiment, &out, false, &[]);
        assert!(recording(&out) == intact, "bit of byte {at}: {}", report["reused"]);
        let warnings = report["warnings"].as_array().expect("warnings");
        let is_warned = warnings.iter().any(|warning| warning.as_str().is_some_and(|text| text.contains("recomputed")));
        // There is no warning if the damaged value was not needed, or if nothing could be read.
        let reused = report["reused"]["nodes"].as_array().expect("nodes");
        let all = reused.len() == 27 && reused.iter().all(|node| node["reused"] == node["of"]);
        assert!(is_warned || all || reused.is_empty(), "bit of byte {at}: {report}");
        std::fs::remove_dir_all(&out).expect("removed");
    }
}

#[test]
fn scores_of_a_run_without_recorded_maps_are_reused() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    let shelf = folder.path().join("shelf");
    run(&experiment, &shelf.join("first"), false, &["record=[train/model]"]);
    let report = run(&experiment, &shelf.join("again"), false, &["record=[train/model]"]);
    assert_eq!(reused(&report, "compare", "score.fused"), Some((6, 6)), "{report}");
    assert_eq!(reused(&report, "compare", "stereo"), Some((6, 6)), "{report}");
    assert!(recording(&shelf.join("first")) == recording(&shelf.join("again")));
}

#[test]
fn a_newer_run_with_fewer_recorded_values_does_not_hide_an_older_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    let shelf = folder.path().join("shelf");
    run(&experiment, &shelf.join("rich"), false, &[]);
    run(&experiment, &shelf.join("poor"), false, &["record=[train/model]"]);
    let report = run(&experiment, &shelf.join("again"), false, &[]);
    assert!(report["reused"]["nodes"].as_array().expect("nodes").iter().all(|node| node["reused"] == node["of"]));
    assert_eq!(reused(&report, "compare", "stereo"), Some((6, 6)), "{report}");
    assert!(recording(&shelf.join("rich")) == recording(&shelf.join("again")));
}
