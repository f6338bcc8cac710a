//! Helpers of the tests: the binary under test, and readers of its output.

#[cfg(target_os = "linux")]
pub(crate) mod slurm;

use std::path::Path;
use std::process::{Command, Output};

pub(crate) use depthloom_test_needs::{
    full, onnx_runtime, python, python_package, shared, skipped, system_python, workspace,
};

/// The binary under test.
pub(crate) fn depthloom() -> Command {
    #[cfg(unix)]
    depthloom_test_needs::signals::restore_defaults();
    let mut command = Command::new(env!("CARGO_BIN_EXE_depthloom"));
    command.current_dir(workspace()).env_remove("KITTI_STEREO_2015").env_remove("MONO_MODEL").env("NO_COLOR", "1");
    // Tests compare computed results, not values reused from neighbouring runs.
    command.env("DEPTHLOOM_FRESH", "1");
    command
}

/// Runs a command that must succeed.
pub(crate) fn succeed(command: &mut Command) -> Output {
    let output = loop {
        match command.output() {
            // The binary was just copied: a child process that another test forked meanwhile may hold it open for
            // writing until its exec.
            Err(error) if error.kind() == std::io::ErrorKind::ExecutableFileBusy => std::thread::yield_now(),
            output => break output.expect("the binary starts"),
        }
    };
    assert!(
        output.status.success(),
        "{command:?} ended with {}\n{}\n{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// A row of a small CSV file, by column name.
pub(crate) type Row = std::collections::BTreeMap<String, String>;

/// Reads a CSV file without quoting, as depthloom and the reference implementation write them.
pub(crate) fn read_csv(path: &Path) -> Vec<Row> {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    lines
        .map(|line| header.iter().zip(line.split(',')).map(|(k, v)| ((*k).to_owned(), v.to_owned())).collect())
        .collect()
}

/// The label of a row's estimate, `variant/estimate`, or `estimate` if all variants share it. The reference
/// implementation writes the label to a column `estimator`.
pub(crate) fn label(row: &Row) -> String {
    let estimate = row.get("estimate").unwrap_or_else(|| &row["estimator"]);
    match row.get("variant").map(String::as_str) {
        None | Some("") => estimate.clone(),
        Some(variant) => format!("{variant}/{estimate}"),
    }
}

/// The pixel set of a row, also of the reference implementation, which calls `valid` answered.
pub(crate) fn set(row: &Row) -> &str {
    match row.get("set") {
        Some(set) => set,
        None if row["scored_on"] == "answered" => "valid",
        None => &row["scored_on"],
    }
}

/// A number in a row.
pub(crate) fn number(row: &Row, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|error| panic!("{column} of {row:?}: {error}"))
}
