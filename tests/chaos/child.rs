//! A child process: started in its own group, with its output read, and ended at its time limit.

use std::io::Read;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// More than this of what a child says is not kept.
const HEARD: u64 = 4 << 20;
/// A child has at least this long to end once nothing more is done to it.
const AT_THE_END: Duration = Duration::from_secs(60);
/// How often is looked whether it has ended.
const LOOK_EVERY: Duration = Duration::from_millis(1);

/// How a child ended.
#[derive(Clone, Debug)]
pub(crate) struct Ended {
    pub code: Option<i32>,
    pub signal: Option<i32>,
    pub stdout: String,
    pub stderr: String,
    /// It did not end by itself in its time.
    pub hung: bool,
}

impl Ended {
    pub(crate) fn succeeded(&self) -> bool {
        self.code == Some(0)
    }

    /// How it ended, in a few words.
    pub(crate) fn summary(&self) -> String {
        let how = match (self.hung, self.code, self.signal) {
            (true, ..) => "hung".to_owned(),
            (_, Some(code), _) => format!("exit {code}"),
            (_, _, Some(signal)) => format!("signal {signal}"),
            _ => "ended somehow".to_owned(),
        };
        let last = self.stderr.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("nothing said");
        let last: String = last.chars().take(200).collect();
        format!("{how} ({last})")
    }
}

/// A child under way.
pub(crate) struct Running {
    child: Child,
    stdout: Option<JoinHandle<Vec<u8>>>,
    stderr: Option<JoinHandle<Vec<u8>>>,
    ended: Option<ExitStatus>,
    deadline: Instant,
}

/// Starts a command; standard output and error are listened to unless they were set before by [`Command::stdout`].
pub(crate) fn start(command: &mut Command, stdout: Option<Stdio>, stderr: Option<Stdio>, limit: Duration) -> Running {
    command.process_group(0).stdin(Stdio::null());
    command.stdout(stdout.unwrap_or_else(Stdio::piped)).stderr(stderr.unwrap_or_else(Stdio::piped));
    let mut child = command.spawn().unwrap_or_else(|error| panic!("{command:?} cannot be started: {error}"));
    let stdout = child.stdout.take().map(listen);
    let stderr = child.stderr.take().map(listen);
    Running { child, stdout, stderr, ended: None, deadline: Instant::now() + limit }
}

fn listen(from: impl Read + Send + 'static) -> JoinHandle<Vec<u8>> {
    std::thread::spawn(move || {
        let mut heard = Vec::new();
        let mut from = from.take(HEARD);
        // What a child that was ended had said until then is enough.
        let _ = from.read_to_end(&mut heard);
        let _ = std::io::copy(&mut from.into_inner(), &mut std::io::sink());
        heard
    })
}

impl Running {
    /// Whether it has ended by itself.
    pub(crate) fn has_ended(&mut self) -> bool {
        if self.ended.is_none() {
            self.ended = self.child.try_wait().expect("a child can be asked");
        }
        self.ended.is_some()
    }

    /// The name of the program it is by now; `None` where the system does not tell.
    pub(crate) fn name(&self) -> Option<String> {
        let name = std::fs::read_to_string(format!("/proc/{}/comm", self.child.id())).ok()?;
        Some(name.trim_end().to_owned())
    }

    /// Sends a signal (`INT`, `TERM`, `HUP`, `KILL`) unless it has ended.
    pub(crate) fn signal(&mut self, name: &str) {
        if !self.has_ended() {
            send(name, &self.child.id().to_string());
        }
    }

    /// Waits for a moment of the child's life: until `come` returns true, it has ended, or its time limit is reached.
    /// Returns whether the moment came.
    pub(crate) fn until(&mut self, mut come: impl FnMut(&Self) -> bool) -> bool {
        loop {
            if come(self) {
                return true;
            }
            if self.has_ended() || Instant::now() > self.deadline {
                return false;
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    /// Waits some time, or until it has ended.
    pub(crate) fn wait(&mut self, time: Duration) {
        let end = Instant::now() + time;
        while !self.has_ended() && Instant::now() < end {
            std::thread::sleep(LOOK_EVERY.min(end.saturating_duration_since(Instant::now())));
        }
    }

    /// Waits until it ends; ends it at the time limit, and then reports what each of its threads was doing.
    pub(crate) fn end(mut self) -> Ended {
        // A delay of this process or of an earlier `kill` is not a fault of the child: it may have waited for them.
        let deadline = self.deadline.max(Instant::now() + AT_THE_END);
        while !self.has_ended() && Instant::now() < deadline {
            std::thread::sleep(LOOK_EVERY);
        }
        let hung = !self.has_ended();
        let mut threads = String::new();
        if hung {
            threads = threads_of(self.child.id());
            // The group: nothing it started may hold the pipes open.
            send("KILL", &format!("-{}", self.child.id()));
        }
        let status = self.ended.unwrap_or_else(|| self.child.wait().expect("a child can be waited for"));
        let heard = |thread: Option<JoinHandle<Vec<u8>>>| {
            let bytes = thread.map(|thread| thread.join().expect("listening does not panic")).unwrap_or_default();
            String::from_utf8_lossy(&bytes).into_owned()
        };
        let (stdout, stderr) = (heard(self.stdout.take()), heard(self.stderr.take()));
        Ended { code: status.code(), signal: status.signal(), stdout, stderr: stderr + &threads, hung }
    }
}

/// Every thread of a process: its name, its state, and what it waits for in the system.
fn threads_of(process: u32) -> String {
    let mut report = String::from("== threads at the time limit\n");
    for task in std::fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten() {
        let read = |name| std::fs::read_to_string(task.path().join(name)).unwrap_or_default();
        let status = read("status");
        let state = status.lines().find(|line| line.starts_with("State:")).unwrap_or("State: unknown");
        let (name, at, call) = (read("comm"), read("wchan"), read("syscall"));
        report.push_str(&format!("{}: {state}, in {at}, system call {}\n", name.trim_end(), call.trim_end()));
    }
    report
}

fn send(name: &str, to: &str) {
    // It may have ended meanwhile.
    let _ = Command::new("kill").args(["-s", name, "--", to]).stderr(Stdio::null()).status();
}

/// Where a program of the system is, if it is there.
pub(crate) fn program(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(name)).find(|file| file.is_file())
}
