//! What the tests share: the binary, the data, a Python environment of their own.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The root of the workspace.
pub fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The folder of real frames and golden results, or `None` with a visible line.
pub fn shared(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("DEPTHLOOM_SHARED").map_or_else(|| workspace().join("../shared"), PathBuf::from);
    if folder.join("oracle/golden").is_dir() {
        return Some(folder);
    }
    skipped(test, "../shared is absent");
    None
}

/// Says that a test did not run, on the standard error itself: the test harness captures `eprintln!` alone.
pub fn skipped(test: &str, why: &str) {
    use std::io::Write;
    let line = format!("SKIPPED {test}: {why}\n");
    std::io::stderr().write_all(line.as_bytes()).expect("standard error is open");
}

/// The binary under test.
pub fn depthloom() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_depthloom"));
    command.current_dir(workspace()).env_remove("KITTI_STEREO_2015").env_remove("MONO_MODEL").env("NO_COLOR", "1");
    command
}

/// Runs a command that must succeed.
pub fn succeed(command: &mut Command) -> Output {
    let output = command.output().expect("the binary starts");
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
pub type Row = std::collections::BTreeMap<String, String>;

/// Reads a CSV file without quoting: what the oracle writes, and what we write.
pub fn read_csv(path: &Path) -> Vec<Row> {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    lines
        .map(|line| header.iter().zip(line.split(',')).map(|(k, v)| ((*k).to_owned(), v.to_owned())).collect())
        .collect()
}

/// A number in a row.
pub fn number(row: &Row, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|error| panic!("{column} of {row:?}: {error}"))
}

/// The Python of a private environment with `tests/python/requirements.txt`, made on first use under `target/`; or `None`
/// with a visible line where there is no Python or no package index.
pub fn python(test: &str) -> Option<PathBuf> {
    static PYTHON: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    match PYTHON.get_or_init(make_python) {
        Ok(python) => Some(python.clone()),
        Err(why) => {
            skipped(test, why);
            None
        }
    }
}

fn make_python() -> Result<PathBuf, String> {
    let requirements = workspace().join("tests/python/requirements.txt");
    let venv = Path::new(env!("CARGO_TARGET_TMPDIR")).join("../python-tests");
    let python = venv.join("bin/python");
    let done = venv.join("installed.txt");
    let wanted = std::fs::read_to_string(&requirements).expect("the requirements are in the tree");
    if std::fs::read_to_string(&done).is_ok_and(|have| have == wanted) {
        return Ok(python);
    }
    let attempt = |command: &mut Command| -> Result<(), String> {
        let output = command.output().map_err(|error| format!("{command:?}: {error}"))?;
        if output.status.success() {
            return Ok(());
        }
        let said = String::from_utf8_lossy(&output.stderr);
        Err(format!("{:?} failed: {}", command.get_program(), said.lines().last().unwrap_or_default()))
    };
    attempt(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&venv))?;
    attempt(Command::new(&python).args(["-m", "pip", "install", "--quiet", "-r"]).arg(&requirements))?;
    std::fs::write(&done, wanted).map_err(|error| error.to_string())?;
    Ok(python)
}

/// The ONNX Runtime library of the private Python environment.
pub fn onnx_runtime(test: &str) -> Option<PathBuf> {
    let python = python(test)?;
    let code = "import onnxruntime, pathlib; print(next((pathlib.Path(onnxruntime.__file__).parent / 'capi').glob('libonnxruntime*.*')))";
    let output = succeed(Command::new(python).args(["-c", code]));
    Some(PathBuf::from(String::from_utf8(output.stdout).expect("a path").trim()))
}
