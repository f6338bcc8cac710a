//! What a process imports, compared with what the cache keys contain.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use depthloom_graphs::contracts::{CodePath, Observation};
use depthloom_graphs::language::glob;
use depthloom_graphs::{Fault, Key, counted};
use depthloom_threads::locked;

use super::launch::Launch;
use super::modules::{Module, ModuleReport, Modules};

/// Fails if a module changed, or was imported too late to be in the keys and is not in `code`.
pub(super) fn check(report: ModuleReport, launch: &Launch) -> Result<(), Fault> {
    let Modules::Known(known) = &launch.modules else { return Ok(()) };
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

/// Kept out of recordings, which are equal with any number of workers.
static WARNINGS: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// By program: files read after it began to serve that neither `reads` nor `code` names.
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

pub(super) fn is_python(launch: &Launch) -> bool {
    launch.command.iter().any(|word| {
        let path = Path::new(&word.0);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("python") || name.starts_with("pypy") || path.extension().is_some_and(|ending| ending == "py")
    })
}
