//! How a program is started, as a person declares it.

use std::collections::BTreeMap;
use std::hash::{BuildHasher, RandomState};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use depthloom_graphs::contracts::{Argument, CodePath};
use depthloom_graphs::{Fault, Key};

use super::modules::Modules;

/// The longest time anybody may declare, seconds.
const LONGEST_S: f64 = 31_536_000.0;

/// Where programs are looked for.
pub(super) const PROGRAM: &str =
    "`command` names a program of your PATH, or a file: relative ones stand beside the YAML file";

/// What is started, and how long it may take.
#[derive(Clone, Debug)]
pub(super) struct Launch {
    pub command: Vec<Argument>,
    pub env: BTreeMap<String, String>,
    /// The files that decide what it gives, and a hash of their content.
    pub code: Vec<(CodePath, Key)>,
    /// What it imports.
    pub modules: Modules,
    /// The files of a frame that it declares to read; `None` if a `version` stands for all it reads.
    pub reads: Option<Vec<PathBuf>>,
    /// How many processes there are at most.
    pub instances: usize,
    /// How long a process may take until it is ready.
    pub start: Duration,
    /// How long it may say nothing while it is called for a frame.
    pub frame: Duration,
    /// The same of a call that is of no frame.
    pub once: Duration,
}

/// What is in the files that decide results, as the keys of this run have them: those that `code` names, and with it those that are words of the
/// command (the program itself, weights). Where there is a `version`, that stands for them.
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

impl Launch {
    /// Whether the files that decide results are as they were: a program that was started after one changed would give its results under the keys of the one before.
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

    /// That the program exists, so that a missing one is reported before any frame.
    ///
    /// # Errors
    /// If it is neither a file nor found on the PATH that it is started with.
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

    /// The command, for whoever is to allow it.
    pub(super) fn command_line(&self) -> String {
        command_line(&self.command)
    }

    /// The program, for messages, which recordings keep: of the words behind it the first alone, if it is a file. Others may be secret, and
    /// where files lie concerns nobody.
    pub(super) fn program(&self) -> String {
        let name = |word: &Argument| Path::new(&word.0).file_name().map(|name| name.to_string_lossy().into_owned());
        let script = self.command.get(1).filter(|word| Path::new(&word.0).is_file());
        let words: Vec<String> = self.command.first().into_iter().chain(script).filter_map(name).collect();
        words.join(" ").escape_debug().to_string()
    }
}

/// A command as a person would type it; nothing in it that a terminal would not show.
pub(crate) fn command_line(command: &[Argument]) -> String {
    let quoted = |argument: &Argument| {
        let text = &argument.0;
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
        if !text.is_empty() && text.chars().all(is_plain) { text.clone() } else { format!("{text:?}") }
    };
    command.iter().map(quoted).collect::<Vec<_>>().join(" ")
}

/// What any kind that starts a program must be told, checked.
pub(crate) fn check<const N: usize>(
    command: &[Argument],
    [env, secrets]: [&BTreeMap<String, String>; 2],
    version: Option<u32>,
    code: &[CodePath],
    times: [(&'static str, f64); N],
) -> Result<(), (&'static str, String)> {
    if command.first().is_none_or(|program| program.0.is_empty()) {
        return Err(("command", "command wants the program and its arguments, `[python3, node.py]`".to_owned()));
    }
    if command.iter().any(|argument| argument.0.contains('\0')) {
        return Err(("command", "command holds a zero byte, which no argument can have".to_owned()));
    }
    for (parameter, variables) in [("env", env), ("secrets", secrets)] {
        if let Some(name) = variables.keys().find(|name| name.is_empty() || name.contains(['=', '\0'])) {
            return Err((parameter, format!("{name:?} cannot be the name of a variable")));
        }
        if let Some((name, _)) = variables.iter().find(|(_, value)| value.contains('\0')) {
            return Err((parameter, format!("the value of {name} holds a zero byte")));
        }
    }
    if let Some(name) = secrets.keys().find(|name| env.contains_key(*name)) {
        return Err(("secrets", format!("{name} is in `env` as well: give it in one of them")));
    }
    if version.is_some() && !code.is_empty() {
        let what = "code and version both say what the results depend on: give one of them";
        return Err(("code", what.to_owned()));
    }
    if let Some(fault) = code.iter().find_map(|code| code.files().err()) {
        return Err(("code", fault.to_string()));
    }
    for (name, seconds) in times {
        if !(seconds > 0.0 && seconds <= LONGEST_S) {
            return Err((name, format!("{name} is {seconds}, and is more than 0 and at most {LONGEST_S} seconds")));
        }
    }
    Ok(())
}

/// What of a program decides results besides its parameters: nothing where a version is declared; otherwise the content of its files; and where
/// none are named, it is another program in every run.
pub(crate) fn fingerprint(command: &[Argument], version: Option<u32>, code: &[CodePath]) -> Result<Option<Key>, Fault> {
    static THIS_TIME: OnceLock<Key> = OnceLock::new();
    if version.is_some() {
        return Ok(None);
    }
    if code.is_empty() {
        let random =
            || Key::build("this time").number(RandomState::new().hash_one(0)).number(RandomState::new().hash_one(1));
        return Ok(Some(*THIS_TIME.get_or_init(|| random().number(std::process::id().into()).finish())));
    }
    let files = content(command, version, code)?;
    let key = Key::build("files of a program").number(files.len() as u64);
    Ok(Some(files.iter().fold(key, |key, (_, content)| key.key(content)).finish()))
}

/// Whether a file may be started.
#[cfg(unix)]
fn is_program(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt as _;
    path.metadata().is_ok_and(|there| there.is_file() && there.permissions().mode() & 0o111 != 0)
}

/// Whether a file may be started.
#[cfg(not(unix))]
fn is_program(path: &Path) -> bool {
    path.is_file()
}
