//! What a program in Python has imported: its own modules by content, installed packages by version.
//!
//! `depthloom.serve` reports it. The report enters the cache keys of the program's results, so it must be known before any frame: the program is
//! started once for it, and ends without making its node. Later processes report too; what they add to the first report is in no key.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};

use depthloom_graphs::contracts::{CodePath, Observation};
use depthloom_graphs::language::glob;
use depthloom_graphs::{Fault, Key, counted};
use depthloom_threads::locked;
use serde::Deserialize;

use super::launch::Launch;

/// What a program says it has imported.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ModuleReport {
    /// The file of the program itself.
    main: PathBuf,
    /// Modules that belong neither to Python nor to an installed package.
    modules: Vec<Module>,
    /// Versions by name, of Python too.
    packages: BTreeMap<String, String>,
    /// Other files that it had opened for reading when it began to serve: settings, weights, archives of modules.
    files: Vec<Module>,
    /// Files that it opened for reading after it began to serve.
    late: Vec<PathBuf>,
}

/// A file that was imported or opened.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(deny_unknown_fields)]
struct Module {
    /// Its path, relative to the program.
    name: String,
    file: PathBuf,
    /// A hash of its content.
    hash: String,
}

/// The largest report that is read, bytes.
const MOST_BYTES: usize = 16 << 20;

impl ModuleReport {
    /// Reads what a program says.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        if text.len() > MOST_BYTES {
            return Err(format!("its report of modules has {} bytes", text.len()));
        }
        serde_json::from_str(text).map_err(|error| format!("its report of modules cannot be read: {error}"))
    }

    /// What of it enters keys. The content of the program itself does not where a `version` stands for it.
    pub(super) fn key(&self, has_version: bool) -> Key {
        let mut modules: Vec<&Module> = self.modules.iter().collect();
        modules.retain(|module| !has_version || module.file != self.main);
        modules.sort_unstable();
        let key = Key::build("modules of a program").number(modules.len() as u64);
        let key = modules.iter().fold(key, |key, module| key.text(&module.name).text(&module.hash));
        let key = key.number(self.packages.len() as u64);
        let key = self.packages.iter().fold(key, |key, (name, version)| key.text(name).text(version));
        let mut files: Vec<&Module> = self.files.iter().collect();
        files.sort_unstable();
        let key = key.number(files.len() as u64);
        files.iter().fold(key, |key, file| key.text(&file.name).text(&file.hash)).finish()
    }
}

/// What is known of the modules of a program before it is called.
#[derive(Clone, Debug, Default)]
pub(super) enum Modules {
    /// They are not asked for.
    #[default]
    Ignored,
    /// Those that the keys contain; unset until a source's first process has reported. `None`: it reports nothing.
    Known(OnceLock<Option<Arc<ModuleReport>>>),
}

impl Modules {
    /// What is known already: by [`report_of`].
    pub(super) fn known(report: Option<Arc<ModuleReport>>) -> Self {
        Self::Known(OnceLock::from(report))
    }

    /// Whether a process is asked for them.
    pub(super) const fn are_asked_for(&self) -> bool {
        matches!(self, Self::Known(_))
    }

    /// The report that the keys contain, from now on.
    pub(super) fn settled(&self) -> Option<Arc<ModuleReport>> {
        match self {
            Self::Ignored => None,
            Self::Known(report) => report.get_or_init(|| None).clone(),
        }
    }

    /// Compares what a process reports with what the keys contain.
    ///
    /// # Errors
    /// If a module has another content, or was imported too late to be in the keys and is not in `code`.
    pub(super) fn check(&self, report: ModuleReport, launch: &Launch) -> Result<(), Fault> {
        let Self::Known(known) = self else { return Ok(()) };
        let report = Arc::new(report);
        let Some(known) = known.get_or_init(|| Some(Arc::clone(&report))) else {
            if is_python(launch) {
                // As where the machine was too busy to start it in time.
                let what = format!("`{}` did not report its imports before the first frame", launch.program());
                return Err(Fault::new(what).remedy("run again; raise `start_timeout_s` if it needs longer"));
            }
            let what = "reports its imports, but they are not in its cache keys: name its `.py` file in `command`";
            warn(format!("`{}` {what}", launch.program()));
            return Ok(());
        };
        if let Some(reads) = &launch.reads {
            let mut undeclared = report.late.iter().filter(|file| !is_declared(file, reads, launch));
            match (undeclared.next(), reads.first()) {
                (None, _) => {}
                (Some(file), None) => note_late(launch.program(), file, undeclared),
                (Some(file), Some(named)) => {
                    let what = format!(
                        "the program read {}, which neither `reads` ({}) nor `code` names, so that its content is not in the cache key",
                        file.display(),
                        named.display()
                    );
                    return Err(Fault::new(what).remedy(
                        "name it there; a relative path in the program is one in the folder in which you call depthloom, and `reads` is relative to the YAML file",
                    ));
                }
            }
        }
        if Arc::ptr_eq(known, &report) {
            return Ok(());
        }
        // A file that only one of the two opened depends on chance or time, which no key contains.
        let opened: HashMap<&Path, &Module> = known.files.iter().map(|of| (of.file.as_path(), of)).collect();
        let is_changed = |file: &&Module| opened.get(file.file.as_path()).is_some_and(|known| known.hash != file.hash);
        if let Some(file) = report.files.iter().find(is_changed) {
            return Err(changed(&format!("{}, which the program reads,", file.file.display())));
        }
        let before: HashMap<&Path, &Module> = known.modules.iter().map(|of| (of.file.as_path(), of)).collect();
        let mut code = None;
        for module in &report.modules {
            match before.get(module.file.as_path()) {
                Some(known) if known.hash == module.hash => {}
                Some(_) => return Err(changed(&format!("{}, which the program imports,", module.file.display()))),
                None => {
                    let code = code.get_or_insert_with(|| files_of(&launch.code));
                    if !code.contains(&canonical(&module.file)) {
                        let what = format!(
                            "the program imported {} after it was started, so that its content is not in the cache key",
                            module.file.display()
                        );
                        return Err(Fault::new(what).remedy(
                            "import it at the top of the program, or name it in `code`; `imports: false` turns this check off",
                        ));
                    }
                }
            }
        }
        for (name, version) in &report.packages {
            match known.packages.get(name) {
                Some(known) if known == version => {}
                Some(_) => return Err(changed(&format!("the installed version of `{name}`"))),
                None => warn(format!(
                    "`{}` imported the package `{name}` {version} after it was started: its version is not in the cache key; import it at \
                     the top of the program",
                    launch.program()
                )),
            }
        }
        Ok(())
    }
}

/// Warnings of this process: a recording does not contain them, for it is equal with any number of workers.
static WARNINGS: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// Files that programs read after they began to serve and that nothing names, by program.
static LATE: Mutex<BTreeMap<String, BTreeSet<PathBuf>>> = Mutex::new(BTreeMap::new());

fn note_late<'a>(program: String, file: &Path, others: impl Iterator<Item = &'a PathBuf>) {
    let mut late = locked(&LATE);
    let files = late.entry(program).or_default();
    files.insert(file.to_owned());
    files.extend(others.cloned());
}

fn warn(what: String) {
    locked(&WARNINGS).insert(what);
}

/// Takes the warnings about imports of programs since the last call, each once.
#[must_use]
pub fn take_import_warnings() -> Vec<String> {
    let late = std::mem::take(&mut *locked(&LATE)).into_iter().map(|(program, files)| {
        let first = files.first().map(|file| file.display().to_string()).unwrap_or_default();
        let others = match files.len().saturating_sub(1) {
            0 => String::new(),
            others => format!(" and {}", counted(others, "other file")),
        };
        format!("`{program}` read {first}{others} after it began to serve: their content is not in the cache key; name them in `reads` or `code`")
    });
    std::mem::take(&mut *locked(&WARNINGS)).into_iter().chain(late).collect()
}

/// Whether `reads` names a file, on any frame, or `code` does.
fn is_declared(file: &Path, reads: &[PathBuf], launch: &Launch) -> bool {
    let file = canonical(file);
    let is_of = |pattern: &PathBuf| {
        let is_fixed = |part: &&Path| Observation::is_per_frame(part).is_ok_and(|is_per_frame| !is_per_frame);
        let fixed = pattern.ancestors().find(is_fixed).unwrap_or(Path::new(""));
        let rest = pattern.strip_prefix(fixed).unwrap_or(Path::new(""));
        let fixed = canonical(if fixed.as_os_str().is_empty() { Path::new(".") } else { fixed });
        let whole = if rest.as_os_str().is_empty() { fixed } else { fixed.join(rest) };
        let any = whole.to_string_lossy().replace("{frame}", "*").replace("{index}", "*");
        glob(&any, &file.to_string_lossy())
    };
    reads.iter().any(is_of) || files_of(&launch.code).contains(&file)
}

fn changed(what: &str) -> Fault {
    Fault::new(format!("{what} changed since the run began")).remedy("run again")
}

fn canonical(file: &Path) -> PathBuf {
    file.canonicalize().unwrap_or_else(|_| file.to_owned())
}

fn files_of(code: &[(CodePath, Key)]) -> Vec<PathBuf> {
    let files = code.iter().filter_map(|(code, _)| code.files().ok()).flatten();
    files.map(|file| canonical(&file)).collect()
}

/// Whether a command starts Python, as far as its words show.
fn is_python(launch: &Launch) -> bool {
    launch.command.iter().any(|word| {
        let path = Path::new(&word.0);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("python") || name.starts_with("pypy") || path.extension().is_some_and(|ending| ending == "py")
    })
}

/// What a program imports before it makes its node: it is started for this, once for equal commands. `None` if it does not report; what is wrong
/// with it is told where it is called.
#[cfg(unix)]
pub(super) fn report_of(launch: &Launch) -> Option<Arc<ModuleReport>> {
    type Reports = Mutex<HashMap<Key, Option<Arc<ModuleReport>>>>;
    static REPORTS: OnceLock<Reports> = OnceLock::new();
    if !is_python(launch) {
        return None;
    }
    let key = Key::build("command").number(launch.command.len() as u64);
    let key = launch.command.iter().fold(key, |key, word| key.text(&word.0)).number(launch.env.len() as u64);
    let key = launch.env.iter().fold(key, |key, (name, value)| key.text(name).text(value)).finish();
    let mut reports = locked(REPORTS.get_or_init(Mutex::default));
    reports.entry(key).or_insert_with(|| super::pool::modules(launch).map(Arc::new)).clone()
}

#[cfg(not(unix))]
pub(super) fn report_of(_: &Launch) -> Option<Arc<ModuleReport>> {
    None
}

#[cfg(test)]
mod tests {
    use super::ModuleReport;

    fn report(text: &str) -> ModuleReport {
        ModuleReport::parse(text).expect("a report")
    }

    #[test]
    fn modules_and_versions_are_in_the_key_and_the_place_of_the_program_is_not() {
        let of = |folder: &str, hash: &str, version: &str| {
            report(&format!(
                r#"{{"main": "{folder}/n.py", "modules": [{{"name": "n.py", "file": "{folder}/n.py", "hash": "0"}},
                    {{"name": "lib/k.py", "file": "{folder}/lib/k.py", "hash": "{hash}"}}], "packages": {{"numpy": "{version}"}}}}"#
            ))
        };
        let key = of("/a", "1", "2.1").key(false);
        assert_eq!(key, of("/b", "1", "2.1").key(false));
        assert_ne!(key, of("/a", "2", "2.1").key(false));
        assert_ne!(key, of("/a", "1", "2.2").key(false));
        assert_ne!(key, of("/a", "1", "2.1").key(true), "a version stands for the program alone");
        let with_file = |hash: &str| {
            report(&format!(
                r#"{{"main": "/a/n.py", "files": [{{"name": "offsets.json", "file": "/a/offsets.json", "hash": "{hash}"}}]}}"#
            ))
        };
        assert_ne!(with_file("1").key(true), with_file("2").key(true), "a file that was opened");
        assert!(ModuleReport::parse("1").is_err());
    }
}
