//! The example nodes in other languages and libraries.

use std::process::Command;

use super::python::path_of;
use super::run;
use crate::support::{full, label, number, python_package, read_csv, skipped, succeed, workspace};

#[test]
fn a_javascript_node_works_with_only_arrows_library() {
    const TEST: &str = "a_javascript_node_works_with_only_arrows_library";
    // It installs a package with npm.
    if !full(TEST) {
        return;
    }
    let folder = depthloom_test_needs::target().join("javascript-tests");
    std::fs::create_dir_all(&folder).expect("made");
    for name in ["package.json", "nearest.mjs", "nearest.yaml"] {
        std::fs::copy(workspace().join("examples/process-node-js").join(name), folder.join(name)).expect("copied");
    }
    if !folder.join("node_modules/apache-arrow").is_dir() {
        let install = ["install", "--no-audit", "--no-fund", "--ignore-scripts", "--no-package-lock"];
        let installed = Command::new("npm").current_dir(&folder).args(install).output();
        if !installed.is_ok_and(|output| output.status.success()) {
            skipped(TEST, "there is no npm, or no registry for apache-arrow");
            return;
        }
    }
    let out = tempfile::tempdir().expect("a folder");
    let out = out.path().join("run");
    succeed(&mut run(&folder.join("nearest.yaml"), &out, "javascript"));
    let rows = read_csv(&out.join("scores.csv"));
    assert_eq!(rows.len(), 4);
    for row in rows {
        // Nearly every pixel with ground truth has a valid depth below 60 m in one of the two inputs.
        assert!(label(&row) == "nearest" && number(&row, "a1") > 0.8, "{row:?}");
    }
}

#[test]
fn a_pytorch_network_runs_as_a_node() {
    const TEST: &str = "a_pytorch_network_runs_as_a_node";
    let Some(python) = python_package(TEST) else { return };
    if !Command::new(&python).args(["-c", "import torch"]).output().is_ok_and(|output| output.status.success()) {
        skipped(TEST, "the Python of the tests has no torch");
        return;
    }
    let out = tempfile::tempdir().expect("a folder");
    let out = out.path().join("run");
    let experiment = workspace().join("examples/process-node-torch/confidence.yaml");
    succeed(run(&experiment, &out, "torch").env("PATH", path_of(&python)));
    assert_eq!(read_csv(&out.join("scores.csv")).len(), 2);
}
