//! How a program is started, as a person declares it.

use std::collections::BTreeMap;
use std::hash::{BuildHasher, RandomState};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use depthloom_graphs::contracts::{Argument, CodePath, FramePaths};
use depthloom_graphs::{Fault, Key};

use super::modules::Modules;

const LONGEST_S: f64 = 31_536_000.0;

pub(super) const PROGRAM: &str =
    "`command` names a program of your PATH, or a file: relative paths start at the folder of the YAML file";

#[derive(Clone, Debug)]
pub(super) struct Launch {
    pub command: Vec<Argument>,
    pub env: BTreeMap<String, String>,
    /// Files that decide the results, with a hash of their content.
    pub code: Vec<(CodePath, Key)>,
    pub modules: Modules,
    /// Declared files of a frame; `None` if `version` covers all reads.
    pub reads: Option<Vec<PathBuf>>,
    /// Largest number of processes.
    pub instances: usize,
    /// Time limit until it is ready.
    pub start: Duration,
    /// Time limit without a reply for a frame.
    pub frame: Duration,
    /// Time limit without a reply for a call that concerns no frame.
    pub once: Duration,
}

/// Files that `code` names, and those among the words of the command. Empty if `version` replaces their content.
pub(super) fn content(
    command: &[Argument],
    version: Option<u32>,
    code: &[CodePath],
) -> Result<Vec<(CodePath, Key)>, Fault> {
    if version.is_some() || code.is_empty() {
        return Ok(Vec::new());
    }
    let is_file = |word: &&Argument| word.0.contains(['/', '.']) && Path::new(&word.0).is_file();
    let named = command.iter().filter(is_file).map(|word| CodePath(PathBuf::from(&word.0)));
    code.iter().cloned().chain(named).map(|code| Ok((code.clone(), code.content()?))).collect()
}

/// The parameters of any kind that starts a program.
pub(crate) struct ProgramParams<'a> {
    pub command: &'a [Argument],
    pub env: &'a BTreeMap<String, String>,
    pub secrets: &'a BTreeMap<String, String>,
    pub version: Option<u32>,
    pub code: &'a [CodePath],
}

impl ProgramParams<'_> {
    pub(super) fn launch(
        &self,
        instances: usize,
        reads: &FramePaths,
        [start_s, frame_s, aggregate_s]: [f64; 3],
    ) -> Result<Launch, Fault> {
        let variables = self.env.iter().chain(self.secrets);
        Ok(Launch {
            command: self.command.to_vec(),
            env: variables.map(|(name, value)| (name.clone(), value.clone())).collect(),
            code: content(self.command, self.version, self.code)?,
            modules: Modules::Ignored,
            reads: self.version.is_none().then(|| reads.0.clone()),
            instances,
            start: Duration::from_secs_f64(start_s),
            frame: Duration::from_secs_f64(frame_s),
            once: Duration::from_secs_f64(aggregate_s),
        })
    }

    /// Whether imports of the program enter cache keys, if it reports them.
    pub(super) fn has_keys(&self) -> bool {
        self.version.is_some() || !self.code.is_empty()
    }

    pub(crate) fn check(&self, times: &[(&'static str, f64)]) -> Result<(), (&'static str, String)> {
        let Self { command, env, secrets, version, code } = self;
        if command.first().is_none_or(|program| program.0.is_empty()) {
            return Err((
                "command",
                "command is missing: the program and its arguments, e.g. `[python3, node.py]`".to_owned(),
            ));
        }
        if command.iter().any(|argument| argument.0.contains('\0')) {
            return Err(("command", "command holds a zero byte, which no argument can have".to_owned()));
        }
        for (parameter, variables) in [("env", *env), ("secrets", *secrets)] {
            if let Some(name) = variables.keys().find(|name| name.is_empty() || name.contains(['=', '\0'])) {
                return Err((parameter, format!("{name:?} cannot be the name of a variable")));
            }
            if let Some((name, _)) = variables.iter().find(|(_, value)| value.contains('\0')) {
                return Err((parameter, format!("the value of {name} holds a zero byte")));
            }
        }
        if let Some(name) = secrets.keys().find(|name| env.contains_key(*name)) {
            return Err(("secrets", format!("{name} is also in `env`: keep one of the two")));
        }
        if version.is_some() && !code.is_empty() {
            let what = "code cannot be combined with version: use one of the two";
            return Err(("code", what.to_owned()));
        }
        if let Some(fault) = code.iter().find_map(|code| code.files().err()) {
            return Err(("code", fault.to_string()));
        }
        for &(name, seconds) in times {
            if !(seconds > 0.0 && seconds <= LONGEST_S) {
                return Err((
                    name,
                    format!("{name} is {seconds}, expected more than 0 and at most {LONGEST_S} seconds"),
                ));
            }
        }
        Ok(())
    }

    /// `None` with a `version`; otherwise a hash of the files' content, or without any a key that differs in every run.
    pub(crate) fn fingerprint(&self) -> Result<Option<Key>, Fault> {
        static THIS_TIME: OnceLock<Key> = OnceLock::new();
        if self.version.is_some() {
            return Ok(None);
        }
        if self.code.is_empty() {
            let random = || {
                Key::build("this time").number(RandomState::new().hash_one(0)).number(RandomState::new().hash_one(1))
            };
            return Ok(Some(*THIS_TIME.get_or_init(|| random().number(std::process::id().into()).finish())));
        }
        let files = content(self.command, self.version, self.code)?;
        let key = Key::build("files of a program").number(files.len() as u64);
        Ok(Some(files.iter().fold(key, |key, (_, content)| key.key(content)).finish()))
    }
}

impl Launch {
    /// Fails if a file changed: results of a later start would be stored under the wrong keys.
    pub(super) fn check_code(&self) -> Result<(), Fault> {
        for (code, before) in &self.code {
            if code.content()? != *before {
                let what =
                    format!("{}, which `code` or `command` names, changed since the run began", code.path().display());
                return Err(Fault::new(what).remedy("run again"));
            }
        }
        Ok(())
    }

    /// Reports a missing program before the first frame.
    pub(super) fn check_program(&self) -> Result<(), Fault> {
        let Some(program) = self.command.first() else { return Ok(()) };
        let program = Path::new(&program.0);
        let is_found = if program.components().count() > 1 || program.is_absolute() {
            is_program(program)
        } else {
            let path = self.env.get("PATH").map(Into::into).or_else(|| std::env::var_os("PATH")).unwrap_or_default();
            std::env::split_paths(&path).any(|folder| is_program(&folder.join(program)))
        };
        if is_found {
            return Ok(());
        }
        Err(Fault::new(format!(
            "`{}` cannot be started: there is no program {} that may be executed",
            self.program(),
            program.display()
        ))
        .remedy(PROGRAM))
    }

    pub(super) fn command_line(&self) -> String {
        command_line(&self.command)
    }

    /// For messages, which recordings store: only the program and, if it is a file, the first argument, without
    /// folders. Other arguments may be secret.
    pub(super) fn program(&self) -> String {
        let name = |word: &Argument| Path::new(&word.0).file_name().map(|name| name.to_string_lossy().into_owned());
        let script = self.command.get(1).filter(|word| Path::new(&word.0).is_file());
        let words: Vec<String> = self.command.first().into_iter().chain(script).filter_map(name).collect();
        words.join(" ").escape_debug().to_string()
    }
}

pub(crate) fn command_line(command: &[Argument]) -> String {
    let quoted = |argument: &Argument| {
        let text = &argument.0;
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
        if !text.is_empty() && text.chars().all(is_plain) { text.clone() } else { format!("{text:?}") }
    };
    command.iter().map(quoted).collect::<Vec<_>>().join(" ")
}

#[cfg(unix)]
fn is_program(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt as _;
    path.metadata().is_ok_and(|there| there.is_file() && there.permissions().mode() & 0o111 != 0)
}

#[cfg(not(unix))]
fn is_program(path: &Path) -> bool {
    path.is_file()
}
