//! Python environments of the tests, with the packages of `tests/python/requirements*.txt`.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use crate::{miss, target, workspace};

/// Whether there is a `python3` on the PATH, without packages. If not, the test is reported as skipped.
///
/// # Panics
/// Without Python, if `DEPTHLOOM_REQUIRE_PYTHON` is set.
#[must_use]
pub fn system_python(test: &str) -> bool {
    if !crate::full(test) {
        return false;
    }
    let runs = Command::new("python3").arg("--version").output().is_ok_and(|output| output.status.success());
    if !runs {
        miss("DEPTHLOOM_REQUIRE_PYTHON", test, "there is no `python3` on the PATH");
    }
    runs
}

/// The Python of `target/python-tests`, which the first test that needs it creates. `None` without Python or a package
/// index: the test is then reported as skipped.
///
/// # Panics
/// If it cannot be created and `DEPTHLOOM_REQUIRE_PYTHON` is set.
#[must_use]
pub fn python(test: &str) -> Option<PathBuf> {
    static PYTHON: Shared<PathBuf> = OnceLock::new();
    get_or_create(test, &PYTHON, || environment("python-tests", "requirements.txt"))
}

/// A Python in `target/package-tests` with the installed package `python/` and the packages of
/// `tests/python/requirements-package.txt`. `None` without Python or a package index: the test is then reported as
/// skipped.
///
/// # Panics
/// If it cannot be created and `DEPTHLOOM_REQUIRE_PYTHON` is set, or the package cannot be installed.
#[must_use]
pub fn python_package(test: &str) -> Option<PathBuf> {
    static PYTHON: Shared<PathBuf> = OnceLock::new();
    let python = get_or_create(test, &PYTHON, || environment("package-tests", "requirements-package.txt"))?;
    static INSTALLED: OnceLock<()> = OnceLock::new();
    INSTALLED.get_or_init(|| install_package(&python).expect("the package can be installed"));
    Some(python)
}

/// A folder of `target/dora-tests` with the programs `dora` and a `python` with its library. `None` without Python or a
/// package index: the test is then reported as skipped.
///
/// # Panics
/// If it cannot be created and `DEPTHLOOM_REQUIRE_PYTHON` is set.
#[must_use]
pub fn dora(test: &str) -> Option<PathBuf> {
    static PYTHON: Shared<PathBuf> = OnceLock::new();
    get_or_create(test, &PYTHON, || environment("dora-tests", "requirements-dora.txt"))?.parent().map(Path::to_owned)
}

/// A Python in `target/viewer-tests` with a client of WebSockets and Foxglove's messages. `None` without Python or a
/// package index: the test is then reported as skipped.
///
/// # Panics
/// If it cannot be created and `DEPTHLOOM_REQUIRE_PYTHON` is set.
#[must_use]
pub fn viewer_client(test: &str) -> Option<PathBuf> {
    static PYTHON: Shared<PathBuf> = OnceLock::new();
    get_or_create(test, &PYTHON, || environment("viewer-tests", "requirements-viewer.txt"))
}

/// The Python of `target/packaging-tests`, with maturin and linters for the files of `packaging/`. `None` without
/// Python or a package index: the test is then reported as skipped.
///
/// # Panics
/// If it cannot be created and `DEPTHLOOM_REQUIRE_PYTHON` is set.
#[must_use]
pub fn packaging(test: &str) -> Option<PathBuf> {
    static PYTHON: Shared<PathBuf> = OnceLock::new();
    get_or_create(test, &PYTHON, || environment("packaging-tests", "requirements-packaging.txt"))
}

/// A value that the first test that needs it creates for the others.
pub(crate) type Shared<T> = OnceLock<Result<T, String>>;

/// Creates a value once. `None` outside of the full suite, or if that fails: the test is then reported as skipped.
pub(crate) fn get_or_create<T: Clone>(
    test: &str,
    once: &Shared<T>,
    create: impl FnOnce() -> Result<T, String>,
) -> Option<T> {
    if !crate::full(test) {
        return None;
    }
    match once.get_or_init(create) {
        Ok(value) => Some(value.clone()),
        Err(why) => {
            miss("DEPTHLOOM_REQUIRE_PYTHON", test, why);
            None
        }
    }
}

fn install_package(python: &Path) -> Result<(), String> {
    let failed = |error: std::io::Error| format!("{}: {error}", python.display());
    let lock = File::create(target().join("package-tests.lock")).map_err(failed)?;
    lock.lock().map_err(failed)?;
    let package = workspace().join("python");
    let mut files = vec![package.join("pyproject.toml"), package.join("README.md")];
    let sources = fs::read_dir(package.join("src/depthloom")).map_err(failed)?;
    files.extend(sources.flatten().map(|file| file.path()).filter(|path| path.is_file()));
    files.sort_unstable();
    let texts = files.iter().map(|file| Ok(format!("{}\n{}", file.display(), fs::read_to_string(file)?)));
    let contents = texts.collect::<std::io::Result<String>>().map_err(failed)?;
    let done = target().join("package-tests/package.txt");
    if fs::read_to_string(&done).is_ok_and(|installed| installed == contents) {
        return Ok(());
    }
    let pip = ["-m", "pip", "install", "--quiet", "--no-index", "--no-build-isolation"];
    output_of(Command::new(python).args(pip).arg(&package))?;
    fs::write(done, contents).map_err(failed)
}

/// The ONNX Runtime library of [that Python](python).
///
/// # Panics
/// Without Python, if `DEPTHLOOM_REQUIRE_PYTHON` is set.
#[must_use]
pub fn onnx_runtime(test: &str) -> Option<PathBuf> {
    let code = "import onnxruntime, pathlib; print(next((pathlib.Path(onnxruntime.__file__).parent / 'capi').glob('libonnxruntime*.*')))";
    let output = output_of(Command::new(python(test)?).args(["-c", code])).expect("the environment has onnxruntime");
    Some(PathBuf::from(String::from_utf8(output.stdout).expect("a path of UTF-8").trim()))
}

pub(crate) fn environment(name: &str, requirements: &str) -> Result<PathBuf, String> {
    let venv = &target().join(name);
    let requirements = workspace().join("tests/python").join(requirements);
    let python = venv.join("bin/python");
    let done = venv.join("installed.txt");
    let required = fs::read_to_string(&requirements).map_err(|error| format!("{}: {error}", requirements.display()))?;
    // Test programs run concurrently, also of several cargos: the first creates the environment, the others wait.
    let lock = File::create(venv.with_extension("lock")).map_err(|error| format!("{}: {error}", venv.display()))?;
    lock.lock().map_err(|error| format!("{}: {error}", venv.display()))?;
    if fs::read_to_string(&done).is_ok_and(|installed| installed == required) {
        return Ok(python);
    }
    output_of(Command::new("python3").args(["-m", "venv", "--clear"]).arg(venv))?;
    output_of(Command::new(&python).args(["-m", "pip", "install", "--quiet", "-r"]).arg(&requirements))?;
    fs::write(&done, required).map_err(|error| format!("{}: {error}", done.display()))?;
    Ok(python)
}

pub(crate) fn output_of(command: &mut Command) -> Result<Output, String> {
    let program = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| format!("{program} cannot be run: {error}"))?;
    if output.status.success() {
        return Ok(output);
    }
    let stderr = String::from_utf8_lossy(&output.stderr);
    Err(format!("{program} failed: {}", stderr.lines().last().unwrap_or_default()))
}
