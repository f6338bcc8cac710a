//! Every benchmark in `bench/` runs at its smallest size.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;

use depthloom_test_needs::{chromium, dora, packaging, target};

use crate::support::{full, python, shared, skipped, workspace};

/// Requirements of a benchmark besides bash and the programs of this workspace.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Need {
    /// Packages of `tests/python/requirements.txt`.
    Python,
    /// The same packages, and the folder of reference data.
    PythonAndShared,
    /// Packages of `tests/python/requirements-dora.txt`.
    Dora,
    Chromium,
    /// Packages of `tests/python/requirements-packaging.txt`.
    Packaging,
    /// TensorFlow takes 1.5 GB of disk, so the tests use it only if it is installed already.
    TensorFlow,
}

/// A script's name, arguments, requirement, expected output, and the examples that it runs.
type Script = (&'static str, &'static [&'static str], Need, &'static str, &'static [&'static str]);

/// Each script with the arguments for its smallest size.
const SCRIPTS: [Script; 13] = [
    ("ablation", &["1", "1"], Need::PythonAndShared, "ratio ablation-2t ", &[]),
    ("analysis", &["--samples", "1000", "--rounds", "1"], Need::Python, "ratio analysis-polars ", &[]),
    ("fusion", &["--frames", "150", "--rounds", "1"], Need::PythonAndShared, "ratio fusion-1t ", &["fusion_chain"]),
    ("learning", &["--rounds", "1", "--steps", "1"], Need::TensorFlow, "ratio step-1t ", &["steps"]),
    ("live", &["--seconds", "1", "--steps", "1", "--frames", "2"], Need::Python, "ratio live-rate ", &[]),
    ("newcomer", &["2"], Need::Packaging, "newcomer wheel first-table ", &[]),
    (
        "onnx",
        &["--count", "1", "--rounds", "2", "--threads", "1"],
        Need::PythonAndShared,
        "ratio onnx-1t ",
        &["onnx_call"],
    ),
    ("page", &["2", "1"], Need::Chromium, "page slider-again-fps ", &[]),
    ("pipeline", &["1", "--one"], Need::PythonAndShared, "ratio pipeline-2t ", &[]),
    ("process", &["--rounds", "3"], Need::Dora, "ratio process ", &["process_call"]),
    ("reading", &["--rounds", "1", "--threads", "1"], Need::PythonAndShared, "ratio read ", &["read_frames"]),
    ("shards", &["--shards", "3", "--frames", "2", "--parts", "2"], Need::Python, "ratio join-copy ", &[]),
    (
        "stereo",
        &["--count", "1", "--repeat", "1", "--modes", "sgbm", "--threads", "1"],
        Need::PythonAndShared,
        "ratio sgbm-1t ",
        &["sgbm_raw", "bm_raw", "census_raw"],
    ),
];

/// The environment of Python packages for a script, if it needs one. `None` if a requirement is missing: the script is
/// then skipped.
fn needs(test: &str, need: Need) -> Option<Option<PathBuf>> {
    let venv = |python: PathBuf| python.ancestors().nth(2).map(ToOwned::to_owned);
    match need {
        Need::Python => Some(venv(python(test)?)),
        Need::PythonAndShared => {
            shared(test)?;
            Some(venv(python(test)?))
        }
        Need::Dora => Some(dora(test)?.parent().map(ToOwned::to_owned)),
        Need::Chromium => chromium(test).map(|_| None),
        Need::Packaging => Some(venv(packaging(test)?)),
        Need::TensorFlow => {
            let venv = target().join("venv-tensorflow");
            if venv.join("bin/python").is_file() {
                return Some(Some(venv));
            }
            skipped(test, "TensorFlow is not installed: `bench/learning.sh` installs it");
            None
        }
    }
}

#[test]
fn every_benchmark_runs_at_its_smallest_size() {
    if !full("every_benchmark_runs_at_its_smallest_size") {
        return;
    }
    let programs = PathBuf::from(env!("CARGO_BIN_EXE_depthloom"));
    let programs = programs.parent().expect("it is in a folder");
    let mut failed = Vec::new();
    for (name, size, need, printed, examples) in SCRIPTS {
        let test = format!("bench/{name}.sh");
        if let Some(missing) = examples.iter().find(|example| !programs.join("examples").join(example).is_file()) {
            skipped(&test, &format!("the example `{missing}` is not built: the tests of the whole workspace build it"));
            continue;
        }
        let Some(venv) = needs(&test, need) else { continue };
        let mut script = Command::new("bash");
        script.current_dir(workspace()).arg(format!("bench/{name}.sh")).args(size);
        script.env("DEPTHLOOM_BENCH_PROGRAMS", programs).env("CARGO_TARGET_DIR", target()).env("NO_COLOR", "1");
        script.env_remove("KITTI_STEREO_2015");
        script.envs(shared_folder().map(|folder| ("DEPTHLOOM_SHARED", folder)));
        script.envs(venv.map(|venv| ("DEPTHLOOM_BENCH_VENV", venv)));
        let output = script.output().expect("bash starts");
        let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
        if !output.status.success() || !out.contains(printed) {
            failed.push(format!("{test} ended with {}, without `{printed}`:\n{out}\n{err}", output.status));
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n\n"));
}

/// The folder of reference data, if it exists.
fn shared_folder() -> Option<PathBuf> {
    let named = std::env::var_os("DEPTHLOOM_SHARED").map(PathBuf::from);
    let folder = workspace().join(named.unwrap_or_else(|| "../shared".into()));
    folder.is_dir().then_some(folder)
}

#[test]
fn every_benchmark_script_is_tested() {
    let listed: BTreeSet<String> = SCRIPTS.iter().map(|(name, ..)| format!("{name}.sh")).collect();
    let scripts = std::fs::read_dir(workspace().join("bench")).expect("bench/").flatten();
    let names = scripts.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let found: BTreeSet<String> = names.filter(|name| name.ends_with(".sh") && name != "shared.sh").collect();
    assert_eq!(found, listed);
}

#[test]
fn the_page_of_results_is_that_of_the_recorded_results() {
    let test = "the_page_of_results_is_that_of_the_recorded_results";
    if !full(test) {
        return;
    }
    let Some(python) = python(test) else { return };
    let check = Command::new(python).arg("bench/record.py").arg("--check").current_dir(workspace()).output();
    let check = check.expect("python starts");
    assert!(check.status.success(), "{}", String::from_utf8_lossy(&check.stderr));
}
