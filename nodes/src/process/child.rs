//! A process that was started: its streams, its end.
//!
//! Three threads stand between it and whoever calls: one writes to it, one reads what it says, one keeps the end of what it says on its standard error. So
//! whoever calls waits for a channel, and can end the waiting; a pipe that is full or silent holds up nobody but its thread.
//!
//! It runs in a process group of its own, whose first process is a guard: a shell that does nothing until its standard input ends, and then kills the group.
//! That is how all of it goes, what the program started as well: here where it is in the way, and, since a pipe ends with whoever holds it, also when this
//! process is killed and can do nothing any more. The group's number is the guard's, so that it is nobody else's as long as the guard was not waited for.

use std::collections::VecDeque;
use std::io::{Read, Write};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use depthloom_codecs::arrow::{Schema, StreamError, StreamReader, encode, write_schema};
use depthloom_graphs::{Fault, Port};
use depthloom_threads::{locked, look_for_room};

use super::ended::{self, EndedProgram};
use super::launch::{Launch, PROGRAM};
use super::memory::Shared;
use super::permission;
use super::protocol::{self, Elsewhere, Reply, Request};

/// What the guard does: passes on the signals that it is told, and kills the group, itself too, when there is nobody left to tell it any.
const GUARD: &str = "trap '' HUP INT TERM; while read -r signal; do kill -s \"$signal\" 0; done; kill -s KILL 0";
/// The most bytes of its standard error that are kept.
const KEPT: usize = 16 << 10;
/// How long a process may take to end when it is told, before it is killed.
const GRACE: Duration = Duration::from_secs(2);
/// How long it may take by itself after its input has ended.
const LAST_GRACE: Duration = Duration::from_secs(10);
/// How often waiting looks up.
pub(super) const LOOK: Duration = Duration::from_millis(50);

/// The end of what a process said on its standard error.
#[derive(Default)]
struct Said {
    bytes: VecDeque<u8>,
    left_out: bool,
}

/// What the thread that reads found: a reply, or what is wrong and what helps.
type Heard = Result<Reply, (String, &'static str)>;

/// What helps where a program prints to the stream of its answers.
const PRINTS: &str =
    "print to standard error (`print(..., file=sys.stderr)` in Python): standard output belongs to the protocol";

/// A process and all that belongs to it.
pub(super) struct Running {
    child: Child,
    guard: Guard,
    /// Where calls go; gone when it is told to end.
    calls: Option<SyncSender<Request>>,
    replies: Receiver<Heard>,
    said: Arc<Mutex<Said>>,
    listener: Option<JoinHandle<()>>,
    /// The number of the last call.
    pub(super) number: i64,
    /// Whether its last answer was a failure, which is reported already.
    pub(super) has_failed: bool,
    /// Whether it was asked to end before its input did.
    is_terminated: bool,
    /// When its input ended.
    hung_up: Option<Instant>,
    /// The program, for messages.
    command: String,
    /// Whether what it printed, and how it ended, is kept for whoever runs the experiment.
    pub(super) is_reported: bool,
}

/// The first process of a group.
struct Guard {
    shell: Child,
    orders: Option<ChildStdin>,
}

impl Guard {
    fn start() -> std::io::Result<Self> {
        let mut shell = Command::new("/bin/sh");
        shell.args(["-c", GUARD]).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null()).process_group(0);
        let mut shell = shell.spawn()?;
        let orders = shell.stdin.take();
        Ok(Self { shell, orders })
    }

    /// Asks all of the group to end.
    fn terminate(&mut self) {
        if let Some(orders) = &mut self.orders {
            // A guard that is gone is one that killed the group.
            let _ = orders.write_all(b"TERM\n");
        }
    }

    /// Kills all of the group.
    fn kill(&mut self) {
        self.orders = None;
    }

    /// Waits until the group was killed. A guard that the group itself has stopped is no help: then another shell does its work.
    fn wait(&mut self) {
        if ends_within(&mut self.shell, GRACE).is_some() {
            return;
        }
        let mut other = Command::new("/bin/sh");
        other.args(["-c", "kill -s KILL -- \"-$0\"", &self.shell.id().to_string()]);
        let _ = other.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
        let _ = self.shell.kill();
        let _ = self.shell.wait();
    }
}

/// Why there was no reply.
pub(super) enum Silence {
    /// The time is over.
    Late,
    /// The process is of no more use; what is wrong, as a lower-case fragment, and what helps, which may be empty.
    Broken(String, &'static str),
}

impl Running {
    /// Starts a process and its threads, and sends the schema; it is not waited for.
    pub(super) fn start(launch: &Launch, schema: &Arc<Schema>, outputs: &Arc<[Port]>) -> Result<Self, Fault> {
        permission::ask(&launch.command_line())?;
        let name = launch.program();
        let failed = |error: std::io::Error| {
            let fault = Fault::new(format!("`{name}` cannot be started")).because(error);
            fault.remedy(PROGRAM)
        };
        let guard = Guard::start().map_err(failed)?;
        let Some((program, arguments)) = launch.command.split_first() else { return Err(Fault::new("no command")) };
        let mut command = Command::new(&program.0);
        // Python takes a compiled module for that of a file that was changed within the same second and has the same size.
        command.env("PYTHONDONTWRITEBYTECODE", "1");
        // The Python package notes which files such a program opens: their content enters cache keys.
        command.env("DEPTHLOOM_PROGRAM", "1");
        command.args(arguments.iter().map(|argument| &argument.0)).envs(&launch.env);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let group = i32::try_from(guard.shell.id()).map_err(|_| Fault::new("a process has no number"))?;
        let mut child = match command.process_group(group).spawn() {
            Ok(child) => child,
            Err(error) => {
                let (mut guard, error) = (guard, failed(error));
                guard.kill();
                guard.wait();
                return Err(error);
            }
        };
        let (input, output, errors) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
        let (calls, to_write) = sync_channel::<Request>(1);
        let (heard, replies) = sync_channel::<Heard>(1);
        let said = Arc::<Mutex<Said>>::default();
        let mut running = Self {
            child,
            guard,
            calls: Some(calls),
            replies,
            said,
            listener: None,
            number: 0,
            has_failed: false,
            is_terminated: false,
            hung_up: None,
            command: launch.program(),
            is_reported: true,
        };
        let (Some(input), Some(output), Some(errors)) = (input, output, errors) else {
            return Err(Fault::new(format!("`{name}` was started without streams")));
        };
        let shared = Shared::new();
        let schema = protocol::offering(schema, shared.offer());
        let (outputs, keep) = (Arc::clone(outputs), Arc::clone(&running.said));
        let shared = Arc::new(Mutex::new(shared));
        let also = Arc::clone(&shared);
        let threads = || {
            thread("write", move || write(input, &schema, &to_write, &shared))?;
            thread("read", move || read(output, &outputs, &heard, &also))?;
            thread("errors", move || listen(errors, &keep))
        };
        // What was started ends with `running`.
        running.listener = Some(threads().map_err(failed)?);
        Ok(running)
    }

    /// Hands a call over; what became of it, a reply tells.
    pub(super) fn send(&mut self, request: Request) {
        if let Some(calls) = &self.calls {
            // Never full: one call at a time. If the thread is gone, so is the process, and the thread that reads says so.
            let _ = calls.try_send(request);
        }
    }

    /// Tells it that nobody calls any more: its standard input ends.
    pub(super) fn hang_up(&mut self) {
        self.calls = None;
        self.hung_up.get_or_insert_with(Instant::now);
    }

    /// What it says next.
    pub(super) fn hear(&mut self, patience: Duration) -> Result<Reply, Silence> {
        match self.replies.recv_timeout(patience) {
            Ok(Ok(reply)) => Ok(reply),
            Ok(Err((what, remedy))) => Err(Silence::Broken(what, remedy)),
            Err(RecvTimeoutError::Timeout) => Err(Silence::Late),
            Err(RecvTimeoutError::Disconnected) => Err(Silence::Broken("it says nothing more".to_owned(), "")),
        }
    }

    /// Asks it to end, all of its group.
    pub(super) fn terminate(&mut self) {
        self.is_terminated = true;
        self.guard.terminate();
    }

    /// Ends it and all that it started, and waits for it. `patience` is how long it may take by itself; how it ended, if it did so within that time.
    fn end(&mut self, patience: Duration) -> Option<ExitStatus> {
        self.hang_up();
        let by_itself = ends_within(&mut self.child, patience);
        let mut status = by_itself;
        if status.is_none() {
            self.guard.terminate();
            status = ends_within(&mut self.child, GRACE);
        }
        // Whatever it left behind goes as well.
        self.guard.kill();
        if status.is_none() {
            let _ = self.child.kill();
            ends_within(&mut self.child, GRACE);
        }
        self.guard.wait();
        by_itself
    }

    /// Ends it after something went wrong; how it ended by itself, if it did, and the end of what it said on its standard error, as lines for a message.
    pub(super) fn last_words(mut self, is_silent: bool) -> String {
        // What has closed its streams is about to end; what is silent, or says what it should not, is not.
        let by_itself = ends_within(&mut self.child, if is_silent { Duration::ZERO } else { GRACE });
        let mut words = by_itself.map_or_else(String::new, |status| format!("; it {}", how(status)));
        self.end(Duration::ZERO);
        let (printed, is_cut) = self.standard_error();
        words.push_str(&last_lines(&printed, is_cut));
        ended::put(EndedProgram { command: self.command.clone(), failure: None, printed, is_cut });
        words
    }

    /// What it wrote to standard error, as lines without control characters, and whether it wrote more before that.
    fn standard_error(&mut self) -> (String, bool) {
        if let Some(listener) = self.listener.take() {
            // Somebody who left the group may hold the stream for ever.
            let until = Instant::now() + GRACE;
            while !listener.is_finished() && Instant::now() < until {
                thread::sleep(Duration::from_millis(1));
            }
        }
        let said = locked(&self.said);
        let bytes: Vec<u8> = said.bytes.iter().copied().collect();
        let plain = |c: char| if c == '\n' || c == '\t' || !c.is_control() { c } else { ' ' };
        (String::from_utf8_lossy(&bytes).chars().map(plain).collect(), said.left_out)
    }

    /// Keeps what there is to report of a process that was told that nobody calls it any more: how it ended by itself, if it did.
    fn report(&mut self, by_itself: Option<ExitStatus>) {
        if !self.is_reported {
            return;
        }
        let failure = match by_itself {
            _ if self.is_terminated || self.has_failed => None,
            Some(status) if status.success() => None,
            Some(status) => Some(format!("{} after its last answer", how(status))),
            None => {
                Some(format!("was ended {} s after its last answer: it did not end by itself", LAST_GRACE.as_secs()))
            }
        };
        let (printed, is_cut) = self.standard_error();
        let failure = failure.map(|how| how + &last_lines(&printed, is_cut));
        ended::put(EndedProgram { command: self.command.clone(), failure, printed, is_cut });
    }
}

/// The last lines of a standard error, for a message.
fn last_lines(printed: &str, is_cut: bool) -> String {
    const LINES: usize = 20;
    let lines: Vec<&str> = printed.lines().map(str::trim_end).filter(|line| !line.is_empty()).collect();
    if lines.is_empty() {
        return "; its standard error is empty".to_owned();
    }
    let shown = &lines[lines.len().saturating_sub(LINES)..];
    let is_cut = is_cut || shown.len() < lines.len();
    let mut words = format!("; {}:", if is_cut { "the end of its standard error" } else { "its standard error" });
    for line in shown {
        words.push_str("\n  ");
        words.extend(line.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }));
    }
    words
}

/// How a process ended, if it did within a time.
fn ends_within(child: &mut Child, patience: Duration) -> Option<ExitStatus> {
    let until = Instant::now() + patience;
    let mut pause = Duration::from_millis(1);
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return Some(status),
            Ok(None) if Instant::now() < until => thread::sleep(pause),
            Ok(None) | Err(_) => return None,
        }
        pause = (2 * pause).min(Duration::from_millis(20));
    }
}

/// How a process ended.
fn how(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("ended with exit code {code}"),
        (None, Some(signal)) => format!("was killed by signal {signal}"),
        (None, None) => "ended".to_owned(),
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if self.guard.orders.is_some() {
            self.hang_up();
            let waited = self.hung_up.map_or(Duration::ZERO, |at| at.elapsed());
            let by_itself = self.end(if self.is_terminated { GRACE } else { LAST_GRACE.saturating_sub(waited) });
            self.report(by_itself);
        }
    }
}

fn thread(name: &str, work: impl FnOnce() + Send + 'static) -> std::io::Result<JoinHandle<()>> {
    look_for_room()?;
    thread::Builder::new().name(format!("depthloom-process-{name}")).spawn(work)
}

/// Writes the schema, then every call. The stream ends when nobody calls any more.
fn write(mut input: ChildStdin, schema: &Schema, calls: &Receiver<Request>, shared: &Mutex<Shared>) {
    let mut write = || -> std::io::Result<()> {
        write_schema(schema, &mut input)?;
        while let Ok(request) = calls.recv() {
            let mut elsewhere = Elsewhere::default();
            {
                let mut shared = locked(shared);
                elsewhere.call = shared.lay(&encode(schema, request.row(&Elsewhere::default())));
                elsewhere.answer = shared.room();
            }
            encode(schema, request.row(&elsewhere)).write(&mut input)?;
        }
        input.write_all(&[0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0])
    };
    // A process that does not read ends, or is silent: the thread that reads tells it better.
    let _ = write();
}

/// Reads replies until there are none, or one that is none.
fn read(output: impl Read, outputs: &[Port], heard: &SyncSender<Heard>, shared: &Mutex<Shared>) {
    let shared = || locked(shared);
    let mut stream = StreamReader::new(output);
    let schema = match stream.schema() {
        Ok(Some(schema)) => protocol::check_schema(&schema).map(|()| schema).map_err(|what| (what, "")),
        Ok(None) => Err(("it ended, or closed its standard output, before it said anything".to_owned(), "")),
        Err(error) => Err(not_of_the_protocol(&error)),
    };
    let schema = match schema {
        Ok(schema) => schema,
        Err(wrong) => {
            let _ = heard.send(Err(wrong));
            return;
        }
    };
    shared().agree(protocol::agrees(&schema));
    loop {
        let next = match stream.batch(&schema) {
            Ok(Some(batch)) => {
                let row = shared().meant(&schema, batch);
                row.and_then(|row| protocol::reply(&schema, &row, outputs)).map_err(|what| (what, ""))
            }
            Ok(None) => Err(("it ended, or closed its standard output".to_owned(), "")),
            Err(error) => Err(not_of_the_protocol(&error)),
        };
        let is_over = next.is_err();
        if heard.send(next).is_err() || is_over {
            return;
        }
    }
}

fn not_of_the_protocol(error: &StreamError) -> (String, &'static str) {
    let remedy = if matches!(error, StreamError::Text(_)) { PRINTS } else { "" };
    (format!("what it says is not of the protocol: {error}"), remedy)
}

/// Keeps the end of what comes.
fn listen(mut errors: impl Read, said: &Mutex<Said>) {
    let mut chunk = [0; 4096];
    while let Ok(read) = errors.read(&mut chunk) {
        if read == 0 {
            return;
        }
        let mut said = locked(said);
        said.bytes.extend(&chunk[..read]);
        let over = said.bytes.len().saturating_sub(KEPT);
        said.left_out |= over > 0;
        said.bytes.drain(..over);
    }
}
