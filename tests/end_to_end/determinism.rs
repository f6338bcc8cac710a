//! The recording of an experiment does not depend on the number of workers.

use std::path::Path;

use depthloom_test_needs::is_full;

use crate::support::{depthloom, succeed, workspace};

fn run(experiment: &Path, out: &Path, workers: &str) -> Vec<u8> {
    succeed(depthloom().args(["run", "--no-page"]).arg(experiment).args(["--workers", workers, "--out"]).arg(out));
    std::fs::read(out.join("recording.mcap")).expect("a recording")
}

#[test]
fn recordings_are_equal_with_one_two_and_eight_workers() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("small.yaml");
    let table1 = workspace().join("experiments/table1.yaml");
    // The hermetic suite runs fewer frames and steps.
    let (train, test, steps, curve_every) = if is_full() { (4, 5, 12, 4) } else { (2, 3, 3, 1) };
    let text = format!(
        "extends: {}\nexperiment: small\nsources:\n  train: {{ with: {{ frames: 0..{train}, width: 320, height: 96 }} }}\n  test: {{ with: {{ frames: 0..{test}, width: 320, height: 96 }} }}\nstages: {{ learn: {{ nodes: {{ train: {{ with: {{ steps: {steps}, curve_every: {curve_every} }} }} }} }} }}\n",
        table1.display()
    );
    std::fs::write(&experiment, text).expect("written");
    let runs = ["1", "2", "8"].map(|workers| run(&experiment, &folder.path().join(workers), workers));
    assert!(runs[0] == runs[1], "recordings with 1 and 2 workers differ");
    assert!(runs[0] == runs[2], "recordings with 1 and 8 workers differ");
}
