//! A started process. One thread writes to it, one reads its replies, one keeps the end of its standard error.
//!
//! It runs in a separate process group. The group's first process is a guard, a shell that kills the group when its
//! standard input ends, also if depthloom itself was killed.

use std::cell::Cell;
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use depthloom_codecs::arrow::{Schema, StreamError, StreamReader, encode, write_schema};
use depthloom_graphs::{ErrorMessage, Fault, Port};
use depthloom_threads::{locked, look_for_room};

use super::ended::{self, EndedProgram};
use super::launch::{Launch, PROGRAM};
use super::memory::Shared;
use super::permission;
use super::protocol::{self, Reply, Request, SharedPlaces};

/// The guard forwards signals to its group, and kills the group when its standard input ends.
const GUARD: &str = "trap '' HUP INT TERM; while read -r signal; do kill -s \"$signal\" 0; done; kill -s KILL 0";
/// Bytes of standard error that are kept.
const STDERR_BYTES: usize = 16 << 10;
/// Time to end after SIGTERM, before SIGKILL.
const GRACE: Duration = Duration::from_secs(2);
/// Time to end after standard input has ended, before SIGTERM.
const LAST_GRACE: Duration = Duration::from_secs(10);
/// Polling interval of waits.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(50);

#[derive(Default)]
struct StderrTail {
    bytes: VecDeque<u8>,
    left_out: bool,
}

type Received = Result<Reply, ErrorMessage>;

/// How errors begin if the process closed its standard output, which it also does when it exits.
pub(super) const CLOSED: &str = "it exited, or closed its standard output";
const PRINTS: &str =
    "print to standard error (`print(..., file=sys.stderr)` in Python): standard output belongs to the protocol";

pub(super) struct Running {
    child: Child,
    guard: Guard,
    calls: Option<SyncSender<Request>>,
    replies: Receiver<Received>,
    stderr: Arc<Mutex<StderrTail>>,
    listener: Option<JoinHandle<()>>,
    /// The number of the last call.
    pub(super) number: i64,
    /// Whether its last reply was a failure, which is reported already.
    pub(super) has_failed: bool,
    is_terminated: bool,
    stdin_closed: Option<Instant>,
    command: String,
    pub(super) is_reported: bool,
}

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

    fn terminate(&mut self) {
        if let Some(orders) = &mut self.orders {
            // A guard that is gone is one that killed the group.
            let _ = orders.write_all(b"TERM\n");
        }
    }

    fn kill(&mut self) {
        self.orders = None;
    }

    /// If the group has stopped its guard, another shell kills the group.
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

/// What is known of a process that was ended after a failure.
#[derive(Debug, Default)]
pub(super) struct Failed {
    /// How it ended, if it did so by itself: `ended with exit code 1`.
    pub status: Option<String>,
    /// The end of its standard error, as the continuation of a message.
    pub stderr: String,
    pub last_line: Option<String>,
}

pub(super) enum NoReply {
    Late,
    /// The process is of no further use.
    Broken(ErrorMessage),
}

impl Running {
    /// Starts a process and its threads and sends the schema, without waiting for a reply.
    pub(super) fn start(launch: &Launch, schema: &Arc<Schema>, outputs: &Arc<[Port]>) -> Result<Self, Fault> {
        permission::check(&launch.command_line())?;
        let name = launch.program();
        let failed =
            |error: std::io::Error| Fault::new(format!("`{name}` cannot be started")).because(error).remedy(PROGRAM);
        let guard = Guard::start().map_err(failed)?;
        let Some((program, arguments)) = launch.command.split_first() else { return Err(Fault::new("no command")) };
        let mut command = Command::new(&program.0);
        // Python takes a compiled module for that of a file that was changed within the same second and has the same
        // size.
        command.env("PYTHONDONTWRITEBYTECODE", "1");
        // The Python package notes which files such a program opens: their content enters cache keys.
        command.env("DEPTHLOOM_PROGRAM", "1");
        command.args(arguments.iter().map(|argument| &argument.0)).envs(&launch.env);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let group = i32::try_from(guard.shell.id()).map_err(|_| Fault::new("a process has no id"))?;
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
        let (received, replies) = sync_channel::<Received>(1);
        let stderr = Arc::<Mutex<StderrTail>>::default();
        let mut running = Self {
            child,
            guard,
            calls: Some(calls),
            replies,
            stderr,
            listener: None,
            number: 0,
            has_failed: false,
            is_terminated: false,
            stdin_closed: None,
            command: launch.program(),
            is_reported: true,
        };
        let (Some(input), Some(output), Some(errors)) = (input, output, errors) else {
            return Err(Fault::new(format!("`{name}` was started without streams")));
        };
        let shared = Shared::new();
        let schema = protocol::offering_shared(schema, shared.offer());
        let (outputs, keep) = (Arc::clone(outputs), Arc::clone(&running.stderr));
        let shared = Arc::new(Mutex::new(shared));
        let also = Arc::clone(&shared);
        let threads = || {
            thread("write", move || write(input, &schema, &to_write, &shared))?;
            thread("read", move || read(output, &outputs, &received, &also))?;
            thread("errors", move || listen(errors, &keep))
        };
        // What was started ends with `running`.
        running.listener = Some(threads().map_err(failed)?);
        Ok(running)
    }

    pub(super) fn send(&mut self, request: Request) {
        if let Some(calls) = &self.calls {
            // Never full: one call at a time. If the thread is gone, so is the process, and the thread that reads says
            // so.
            let _ = calls.try_send(request);
        }
    }

    pub(super) fn close_stdin(&mut self) {
        self.calls = None;
        self.stdin_closed.get_or_insert_with(Instant::now);
    }

    pub(super) fn receive(&mut self, patience: Duration) -> Result<Reply, NoReply> {
        match self.replies.recv_timeout(patience) {
            Ok(Ok(reply)) => Ok(reply),
            Ok(Err(error)) => Err(NoReply::Broken(error)),
            Err(RecvTimeoutError::Timeout) => Err(NoReply::Late),
            Err(RecvTimeoutError::Disconnected) => Err(NoReply::Broken(ErrorMessage::new("it closed its output"))),
        }
    }

    pub(super) fn terminate(&mut self) {
        self.is_terminated = true;
        self.guard.terminate();
    }

    /// Ends the whole group. Returns the status if the process ended by itself within `patience`.
    fn end(&mut self, patience: Duration) -> Option<ExitStatus> {
        self.close_stdin();
        let by_itself = ends_within(&mut self.child, patience);
        let mut status = by_itself;
        if status.is_none() {
            self.guard.terminate();
            status = ends_within(&mut self.child, GRACE);
        }
        // Processes that it left in the group are killed, too.
        self.guard.kill();
        if status.is_none() {
            let _ = self.child.kill();
            ends_within(&mut self.child, GRACE);
        }
        self.guard.wait();
        by_itself
    }

    /// Ends a process after a failure. Returns its status and the end of its standard error, for a message.
    pub(super) fn end_with_context(self, ends_at_once: bool) -> String {
        let Failed { status, stderr, .. } = self.end_after_failure(ends_at_once);
        status.map_or_else(String::new, |status| format!("; it {status}")) + &stderr
    }

    /// Ends a process after a failure.
    pub(super) fn end_after_failure(mut self, ends_at_once: bool) -> Failed {
        // A process that closed its streams is about to exit; a silent or misbehaving one is not.
        let by_itself = ends_within(&mut self.child, if ends_at_once { Duration::ZERO } else { GRACE });
        self.end(Duration::ZERO);
        let (printed, is_cut) = self.standard_error();
        let last_line = printed.lines().map(str::trim).rfind(|line| !line.is_empty());
        let last_line = last_line.map(|line| line.chars().take(200).collect());
        let failed = Failed { status: by_itself.map(how), stderr: last_lines(&printed, is_cut), last_line };
        ended::put(EndedProgram { command: self.command.clone(), failure: None, printed, is_cut });
        failed
    }

    /// Without control characters; `true` if the beginning was dropped.
    fn standard_error(&mut self) -> (String, bool) {
        if let Some(listener) = self.listener.take() {
            // A process that left the group may keep the stream open.
            let until = Instant::now() + GRACE;
            while !listener.is_finished() && Instant::now() < until {
                thread::sleep(Duration::from_millis(1));
            }
        }
        let stderr = locked(&self.stderr);
        let bytes: Vec<u8> = stderr.bytes.iter().copied().collect();
        let plain = |c: char| if c == '\n' || c == '\t' || !c.is_control() { c } else { ' ' };
        (String::from_utf8_lossy(&bytes).chars().map(plain).collect(), stderr.left_out)
    }

    fn report(&mut self, by_itself: Option<ExitStatus>) {
        if !self.is_reported {
            return;
        }
        let failure = match by_itself {
            _ if self.is_terminated || self.has_failed => None,
            Some(status) if status.success() => None,
            Some(status) => Some(format!("{} after its last reply", how(status))),
            None => {
                Some(format!("was terminated {} s after its last reply, because it did not exit", LAST_GRACE.as_secs()))
            }
        };
        let (printed, is_cut) = self.standard_error();
        let failure = failure.map(|how| how + &last_lines(&printed, is_cut));
        ended::put(EndedProgram { command: self.command.clone(), failure, printed, is_cut });
    }
}

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
            self.close_stdin();
            let waited = self.stdin_closed.map_or(Duration::ZERO, |at| at.elapsed());
            let by_itself = self.end(if self.is_terminated { GRACE } else { LAST_GRACE.saturating_sub(waited) });
            self.report(by_itself);
        }
    }
}

pub(super) fn thread(name: &str, work: impl FnOnce() + Send + 'static) -> std::io::Result<JoinHandle<()>> {
    look_for_room()?;
    thread::Builder::new().name(format!("depthloom-process-{name}")).spawn(work)
}

fn write(mut input: ChildStdin, schema: &Schema, calls: &Receiver<Request>, shared: &Mutex<Shared>) {
    let mut write = || -> std::io::Result<()> {
        write_schema(schema, &mut input)?;
        while let Ok(request) = calls.recv() {
            let mut places = SharedPlaces::default();
            {
                let mut shared = locked(shared);
                places.call = shared.store_call(&encode(schema, request.row(&SharedPlaces::default())));
                places.answer = shared.reply_place();
            }
            encode(schema, request.row(&places)).write(&mut input)?;
        }
        input.write_all(&[0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0])
    };
    // A process that does not read ends, or is silent: the thread that reads tells it better.
    let _ = write();
}

/// A reader that notes when the first byte since the last reset arrived.
struct Timed<'a, R> {
    inner: R,
    first_byte: &'a Cell<Option<Instant>>,
}

impl<R: Read> Read for Timed<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.inner.read(buffer)?;
        if self.first_byte.get().is_none() {
            self.first_byte.set(Some(Instant::now()));
        }
        Ok(count)
    }
}

fn read(output: impl Read, outputs: &[Port], received: &SyncSender<Received>, shared: &Mutex<Shared>) {
    let shared = || locked(shared);
    let first_byte = Cell::new(None);
    let mut stream = StreamReader::new(Timed { inner: output, first_byte: &first_byte });
    let schema = match stream.schema() {
        Ok(Some(schema)) => protocol::check_schema(&schema).map(|()| schema).map_err(ErrorMessage::new),
        Ok(None) => Err(ErrorMessage::new(format!("{CLOSED}, before its first message"))),
        Err(error) => Err(not_of_the_protocol(&error)),
    };
    let schema = match schema {
        Ok(schema) => schema,
        Err(error) => {
            let _ = received.send(Err(error));
            return;
        }
    };
    shared().finish_handshake(protocol::shared_word(&schema));
    loop {
        first_byte.set(None);
        let next = match stream.batch(&schema) {
            Ok(Some(batch)) => {
                let arrived = first_byte.get().unwrap_or_else(Instant::now);
                let row = shared().resolve(&schema, batch);
                row.and_then(|row| protocol::reply(&schema, &row, outputs, arrived)).map_err(ErrorMessage::new)
            }
            Ok(None) => Err(ErrorMessage::new(CLOSED)),
            Err(error) => Err(not_of_the_protocol(&error)),
        };
        let is_over = next.is_err();
        if received.send(next).is_err() || is_over {
            return;
        }
    }
}

fn not_of_the_protocol(error: &StreamError) -> ErrorMessage {
    let message = ErrorMessage::new(format!("its message violates the protocol: {error}"));
    if matches!(error, StreamError::Text(_)) { message.remedy(PRINTS) } else { message }
}

fn listen(mut errors: impl Read, stderr: &Mutex<StderrTail>) {
    let mut chunk = [0; 4096];
    while let Ok(read) = errors.read(&mut chunk) {
        if read == 0 {
            return;
        }
        let mut tail = locked(stderr);
        tail.bytes.extend(&chunk[..read]);
        let over = tail.bytes.len().saturating_sub(STDERR_BYTES);
        tail.left_out |= over > 0;
        tail.bytes.drain(..over);
    }
}
