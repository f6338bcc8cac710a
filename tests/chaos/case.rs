//! A case: its random choices, its folder, and what it did so far.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::child::{self, Ended, Running};
use crate::ground::Ground;
use depthloom_test_needs::random::Random;

/// A case.
pub(crate) struct Case<'a> {
    pub random: Random,
    /// A private folder, empty at first; the program runs in it.
    pub folder: PathBuf,
    /// The folder around it, for files that the program does not see.
    pub home: PathBuf,
    pub ground: &'a Ground,
    /// What was done and how it ended: printed where the case fails.
    pub notes: Vec<String>,
}

impl Case<'_> {
    pub(crate) fn note(&mut self, what: impl Into<String>) {
        self.notes.push(what.into());
    }

    /// Whether a running child is the program by now, not what started it.
    pub(crate) fn is_depthloom(&self, running: &Running) -> bool {
        running.name().is_none_or(|name| name == "depthloom")
    }

    /// A path in its folder.
    pub(crate) fn at(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes a file into its folder.
    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let path = self.at(name);
        let parent = path.parent().expect("a file in a folder");
        fs::create_dir_all(parent).and_then(|()| fs::write(&path, bytes)).expect("the case's folder takes files");
    }

    /// The program with some arguments, in the case's folder.
    pub(crate) fn depthloom(&self, arguments: &[&str]) -> Command {
        let mut command = self.ground.command(&self.folder);
        command.args(arguments);
        command
    }

    /// The program with some arguments, started by another one: `prlimit`, `sh`.
    pub(crate) fn depthloom_by(&self, by: &[impl AsRef<OsStr>], arguments: &[&str]) -> Command {
        let mut command = Command::new(&by[0]);
        self.ground.surroundings(&mut command, &self.folder);
        command.args(&by[1..]).arg(&self.ground.binary).args(arguments);
        command
    }

    /// Starts a command.
    pub(crate) fn start(&mut self, command: &mut Command) -> Running {
        self.start_into(command, None, None)
    }

    /// Starts a command that prints elsewhere.
    pub(crate) fn start_into(
        &mut self,
        command: &mut Command,
        stdout: Option<Stdio>,
        stderr: Option<Stdio>,
    ) -> Running {
        let arguments: Vec<_> = command.get_args().map(OsStr::to_string_lossy).collect();
        self.note(format!("{} {}", command.get_program().to_string_lossy(), arguments.join(" ")));
        child::start(command, stdout, stderr, self.ground.patience)
    }

    /// Waits for a child's end.
    pub(crate) fn end(&mut self, running: Running) -> Ended {
        let ended = running.end();
        self.note(format!("  {}", ended.summary()));
        let count = self.notes.len();
        self.keep(&format!("said/{count}.err"), &ended.stderr);
        self.keep(&format!("said/{count}.out"), &ended.stdout);
        ended
    }

    /// Runs a command to its end.
    pub(crate) fn run(&mut self, command: &mut Command) -> Ended {
        let running = self.start(command);
        self.end(running)
    }

    /// Waits up to some time, a random part of it.
    pub(crate) fn wait_within(&mut self, running: &mut Running, most: Duration) {
        let time = most.mul_f64(self.random.within(0..10_000) as f64 / 10_000.0);
        self.note(format!("  waited {:.1} ms", time.as_secs_f64() * 1e3));
        running.wait(time);
    }

    /// Evidence.
    fn keep(&self, name: &str, text: &str) {
        if !text.is_empty() {
            let path = self.home.join(name);
            let _ = fs::create_dir_all(path.parent().expect("a folder")).and_then(|()| fs::write(&path, text));
        }
    }
}

/// Copies a folder with everything in it.
pub(crate) fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder can be made");
    for entry in fs::read_dir(from).expect("a folder").flatten() {
        let (path, copy) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy_folder(&path, &copy);
        } else {
            fs::copy(&path, &copy).expect("a file can be copied");
        }
    }
}
