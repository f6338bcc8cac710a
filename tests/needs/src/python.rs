//! Python with the packages of `tests/python/requirements.txt`, in an environment of the tests' own.

use std::fs::{self, File};
use std::path::PathBuf;
use std::process::{Command, Output};
use std::sync::OnceLock;

use crate::{miss, target, workspace};

/// The Python of `target/python-tests`, which the first test that asks makes; `None`, and the test is skipped, where there is no Python or no
/// package index.
///
/// # Panics
/// If it cannot be made and `DEPTHLOOM_REQUIRE_PYTHON` is set.
#[must_use]
pub fn python(test: &str) -> Option<PathBuf> {
    static PYTHON: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    match PYTHON.get_or_init(|| environment("python-tests", "requirements.txt")) {
        Ok(python) => Some(python.clone()),
        Err(why) => {
            miss("DEPTHLOOM_REQUIRE_PYTHON", test, why);
            None
        }
    }
}

/// The ONNX Runtime library of [that Python](python).
///
/// # Panics
/// If there is none and `DEPTHLOOM_REQUIRE_PYTHON` is set.
#[must_use]
pub fn onnx_runtime(test: &str) -> Option<PathBuf> {
    let code = "import onnxruntime, pathlib; print(next((pathlib.Path(onnxruntime.__file__).parent / 'capi').glob('libonnxruntime*.*')))";
    let output = told(Command::new(python(test)?).args(["-c", code])).expect("the environment has onnxruntime");
    Some(PathBuf::from(String::from_utf8(output.stdout).expect("a path of UTF-8").trim()))
}

/// The Python of an environment under `target` with the packages that a file of `tests/python` names.
pub(crate) fn environment(name: &str, requirements: &str) -> Result<PathBuf, String> {
    let venv = &target().join(name);
    let requirements = workspace().join("tests/python").join(requirements);
    let python = venv.join("bin/python");
    let done = venv.join("installed.txt");
    let wanted = fs::read_to_string(&requirements).map_err(|error| format!("{}: {error}", requirements.display()))?;
    // Test programs run at once, under several cargos: the first makes the environment, the others wait for it.
    let lock = File::create(venv.with_extension("lock")).map_err(|error| format!("{}: {error}", venv.display()))?;
    lock.lock().map_err(|error| format!("{}: {error}", venv.display()))?;
    if fs::read_to_string(&done).is_ok_and(|have| have == wanted) {
        return Ok(python);
    }
    told(Command::new("python3").args(["-m", "venv", "--clear"]).arg(venv))?;
    told(Command::new(&python).args(["-m", "pip", "install", "--quiet", "-r"]).arg(&requirements))?;
    fs::write(&done, wanted).map_err(|error| format!("{}: {error}", done.display()))?;
    Ok(python)
}

/// Runs a command; what it said last, where it fails.
pub(crate) fn told(command: &mut Command) -> Result<Output, String> {
    let program = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| format!("{program} cannot be run: {error}"))?;
    if output.status.success() {
        return Ok(output);
    }
    let said = String::from_utf8_lossy(&output.stderr);
    Err(format!("{program} failed: {}", said.lines().last().unwrap_or_default()))
}
