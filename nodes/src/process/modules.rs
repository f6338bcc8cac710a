//! What a Python program has imported: its own modules by content, installed packages by version.
//!
//! The report enters cache keys, so it must be known before the first frame: the program is started once for it.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use depthloom_graphs::Key;
use serde::Deserialize;

#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ModuleReport {
    main: PathBuf,
    /// Modules that belong neither to Python nor to an installed package.
    pub modules: Vec<Module>,
    /// Versions by name, of Python too.
    pub packages: BTreeMap<String, String>,
    /// Files opened for reading before it began to serve: settings, weights, archives of modules.
    pub files: Vec<Module>,
    /// Files opened for reading after it began to serve.
    pub late: Vec<PathBuf>,
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Module {
    /// Its path, relative to the program.
    pub name: String,
    pub file: PathBuf,
    pub hash: String,
}

const MOST_BYTES: usize = 16 << 20;

impl ModuleReport {
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        if text.len() > MOST_BYTES {
            return Err(format!("its report of modules has {} bytes", text.len()));
        }
        serde_json::from_str(text).map_err(|error| format!("its report of modules cannot be read: {error}"))
    }

    /// Without the program itself if `version` replaces its content.
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

#[derive(Clone, Debug, Default)]
pub(super) enum Modules {
    #[default]
    Ignored,
    /// The report that the keys contain; unset until a source's first process has reported, `None` if it reports
    /// nothing.
    Known(OnceLock<Option<Arc<ModuleReport>>>),
}

impl Modules {
    pub(super) fn known(report: Option<Arc<ModuleReport>>) -> Self {
        Self::Known(OnceLock::from(report))
    }

    pub(super) const fn are_requested(&self) -> bool {
        matches!(self, Self::Known(_))
    }

    pub(super) fn fixed(&self) -> Option<Arc<ModuleReport>> {
        match self {
            Self::Ignored => None,
            Self::Known(report) => report.get_or_init(|| None).clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::ModuleReport;

    fn report(text: &str) -> ModuleReport {
        ModuleReport::parse(text).expect("a report")
    }

    #[test]
    fn modules_and_versions_are_in_the_key_and_the_place_of_the_program_is_not() {
        let report_from = |folder: &str, hash: &str, version: &str| {
            report(&format!(
                r#"{{"main": "{folder}/n.py", "modules": [{{"name": "n.py", "file": "{folder}/n.py", "hash": "0"}},
                    {{"name": "lib/k.py", "file": "{folder}/lib/k.py", "hash": "{hash}"}}], "packages": {{"numpy": "{version}"}}}}"#
            ))
        };
        let key = report_from("/a", "1", "2.1").key(false);
        assert_eq!(key, report_from("/b", "1", "2.1").key(false));
        assert_ne!(key, report_from("/a", "2", "2.1").key(false));
        assert_ne!(key, report_from("/a", "1", "2.2").key(false));
        assert_ne!(key, report_from("/a", "1", "2.1").key(true), "a version stands for the program alone");
        let with_file = |hash: &str| {
            report(&format!(
                r#"{{"main": "/a/n.py", "files": [{{"name": "offsets.json", "file": "/a/offsets.json", "hash": "{hash}"}}]}}"#
            ))
        };
        assert_ne!(with_file("1").key(true), with_file("2").key(true), "a file that was opened");
        assert!(ModuleReport::parse("1").is_err());
    }
}
