//! What an earlier run made is not made again, and nothing but time tells.

use std::path::{Path, PathBuf};

use serde_json::Value as Json;

use crate::support::{depthloom, full, succeed, workspace};

/// Two stages, one of which learns, on a small street.
pub(crate) fn experiment(folder: &Path) -> PathBuf {
    let path = folder.join("small.yaml");
    let table1 = workspace().join("experiments/table1.yaml");
    let text = format!(
        "extends: {}\nexperiment: small\nsources:\n  train: {{ with: {{ frames: 0..6, width: 160, height: 64 }} }}\n  test: {{ with: {{ frames: 0..6, width: 160, height: 64 }} }}\n\
         stages:\n  learn:\n    nodes:\n      samples: {{ with: {{ size: [64, 32] }} }}\n      teacher: {{ with: {{ steps: 4, batch: 2 }} }}\n",
        table1.display()
    );
    std::fs::write(&path, text).expect("written");
    path
}

/// Runs it beside the others, or afresh; gives what it says of itself.
fn run(experiment: &Path, out: &Path, fresh: bool, set: &[&str]) -> Json {
    let mut command = depthloom();
    if !fresh {
        command.env_remove("DEPTHLOOM_FRESH");
    }
    // There is no `runs` folder there.
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

/// What `plan` says that a run would take.
fn foreseen(experiment: &Path, out: &Path, set: &[&str]) -> Json {
    let mut command = depthloom();
    command.current_dir(experiment.parent().expect("a folder")).args(["plan", "--reuse", "--json", "--out"]).arg(out);
    command.arg(experiment).args(set.iter().flat_map(|set| ["--set", set]));
    serde_json::from_slice(&succeed(&mut command).stdout).expect("JSON")
}

fn recording(out: &Path) -> Vec<u8> {
    std::fs::read(out.join("recording.mcap")).expect("a recording")
}

/// How often a node's values were taken, and how often they were there in all; nothing where it was not taken at all.
fn taken(run: &Json, stage: &str, node: &str) -> Option<(u64, u64)> {
    let nodes = run["reused"]["nodes"].as_array().expect("nodes");
    let of = nodes.iter().find(|of| of["stage"] == stage && of["node"] == node)?;
    Some((of["reused"].as_u64()?, of["of"].as_u64()?))
}

#[test]
fn a_run_that_takes_what_is_there_writes_the_bytes_of_a_fresh_one() {
    if !full("a_run_that_takes_what_is_there_writes_the_bytes_of_a_fresh_one") {
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
        ("learning", &["learn.teacher.with.steps=5"]),
        ("stereo", &["compare.stereo.with.block=7"]),
        ("every", &["record.every=2"]),
        ("a-view", &["record.view=true"]),
        ("frames", &["sources.test.with.frames=3..9"]),
        ("a-variant-less", &["variants.no_scaling=null"]),
        ("little-recorded", &["record=[source/depth, fused]"]),
    ];
    for (name, set) in changes {
        let foreseen = foreseen(&experiment, &shelf.join(name), set);
        let told = run(&experiment, &shelf.join(name), false, set);
        run(&experiment, &apart.join(name), true, set);
        assert!(recording(&shelf.join(name)) == recording(&apart.join(name)), "{name}: {}", told["reused"]);
        for file in ["scores.csv", "table.csv", "error_vs_distance.csv"] {
            let of = |out: &Path| std::fs::read(out.join(name).join(file)).expect("a table");
            assert!(of(&shelf) == of(&apart), "{name}: {file}");
        }
        let seen = foreseen["nodes"].as_array().expect("nodes").iter().filter(|node| node["taken"] != 0);
        let seen = seen.map(|node| (node["stage"].clone(), node["node"].clone(), node["taken"].clone()));
        let taken_of = told["reused"]["nodes"].as_array().expect("nodes").iter();
        let taken_of = taken_of.map(|node| (node["stage"].clone(), node["node"].clone(), node["reused"].clone()));
        assert_eq!(seen.collect::<Vec<_>>(), taken_of.collect::<Vec<_>>(), "{name}: foreseen, and done");
        match name {
            "nothing" => {
                let nodes = told["reused"]["nodes"].as_array().expect("nodes");
                assert_eq!(nodes.len(), 27);
                assert!(nodes.iter().all(|node| node["reused"] == node["of"]), "{told}");
            }
            "a-filter" => {
                assert_eq!(taken(&told, "learn", "teacher"), Some((1, 1)));
                assert_eq!(taken(&told, "compare", "stereo"), Some((6, 6)));
                assert_eq!(taken(&told, "compare", "fused"), None);
            }
            "learning" => {
                assert_eq!(taken(&told, "learn", "stereo"), Some((6, 6)), "no stereo is computed");
                assert_eq!(taken(&told, "learn", "samples"), Some((6, 6)));
                assert_eq!(taken(&told, "learn", "teacher"), None);
                assert_eq!(taken(&told, "compare", "stereo"), Some((6, 6)));
                assert_eq!(taken(&told, "compare", "mono"), None);
            }
            "frames" => assert_eq!(taken(&told, "compare", "stereo"), Some((3, 6))),
            _ => {}
        }
    }
}

#[test]
fn with_fresh_nothing_is_taken() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    run(&experiment, &folder.path().join("first"), false, &[]);
    let mut command = depthloom();
    command.env_remove("DEPTHLOOM_FRESH").args(["run", "--fresh", "--json", "--out"]).arg(folder.path().join("second"));
    let told: Json = serde_json::from_slice(&succeed(command.arg(&experiment)).stdout).expect("JSON");
    assert_eq!(told["reused"], serde_json::json!({ "nodes": [], "from": [], "audited": 0 }));
}

#[test]
fn what_is_damaged_is_made_afresh_and_said() {
    if !full("what_is_damaged_is_made_afresh_and_said") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    let shelf = folder.path().join("shelf");
    run(&experiment, &shelf.join("first"), false, &[]);
    let whole = recording(&shelf.join("first"));
    // Every so many bytes one bit: in frames of both stages, in what was learnt, in what stands between.
    for part in 1..16 {
        let mut bytes = whole.clone();
        let at = bytes.len() / 16 * part + part;
        bytes[at] ^= 1 << (part % 8);
        std::fs::write(shelf.join("first/recording.mcap"), bytes).expect("written");
        let out = shelf.join("again");
        let told = run(&experiment, &out, false, &[]);
        assert!(recording(&out) == whole, "bit of byte {at}: {}", told["reused"]);
        let warnings = told["warnings"].as_array().expect("warnings");
        let is_said = warnings.iter().any(|warning| warning.as_str().is_some_and(|text| text.contains("recomputed")));
        // Unless not all of it was needed, or nothing could be read of it at all.
        let taken = told["reused"]["nodes"].as_array().expect("nodes");
        let all = taken.len() == 27 && taken.iter().all(|node| node["reused"] == node["of"]);
        assert!(is_said || all || taken.is_empty(), "bit of byte {at}: {told}");
        std::fs::remove_dir_all(&out).expect("removed");
    }
}

#[test]
fn of_a_run_that_recorded_scores_alone_the_scores_are_taken() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    let shelf = folder.path().join("shelf");
    run(&experiment, &shelf.join("first"), false, &["record=[teacher/model]"]);
    let told = run(&experiment, &shelf.join("again"), false, &["record=[teacher/model]"]);
    assert_eq!(taken(&told, "compare", "score.fused"), Some((6, 6)), "{told}");
    assert_eq!(taken(&told, "compare", "stereo"), Some((6, 6)), "{told}");
    assert!(recording(&shelf.join("first")) == recording(&shelf.join("again")));
}

#[test]
fn a_newer_run_that_kept_less_hides_no_richer_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = experiment(folder.path());
    let shelf = folder.path().join("shelf");
    run(&experiment, &shelf.join("rich"), false, &[]);
    run(&experiment, &shelf.join("poor"), false, &["record=[teacher/model]"]);
    let told = run(&experiment, &shelf.join("again"), false, &[]);
    assert!(told["reused"]["nodes"].as_array().expect("nodes").iter().all(|node| node["reused"] == node["of"]));
    assert_eq!(taken(&told, "compare", "stereo"), Some((6, 6)), "{told}");
    assert!(recording(&shelf.join("rich")) == recording(&shelf.join("again")));
}
