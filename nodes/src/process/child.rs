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
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use depthloom_codecs::arrow::{Schema, StreamReader, encode, write_schema};
use depthloom_graphs::{Fault, Port};
use depthloom_threads::look_for_room;

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
/// How often waiting looks up.
pub(super) const LOOK: Duration = Duration::from_millis(50);

/// The end of what a process said on its standard error.
#[derive(Default)]
struct Said {
    bytes: VecDeque<u8>,
    left_out: bool,
}

/// What the thread that reads found.
type Heard = Result<Reply, String>;

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
    /// The process is of no more use; what is wrong, as a lower-case fragment.
    Broken(String),
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
        let mut running = Self { child, guard, calls: Some(calls), replies, said, listener: None, number: 0 };
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
    }

    /// What it says next.
    pub(super) fn hear(&mut self, patience: Duration) -> Result<Reply, Silence> {
        match self.replies.recv_timeout(patience) {
            Ok(Ok(reply)) => Ok(reply),
            Ok(Err(what)) => Err(Silence::Broken(what)),
            Err(RecvTimeoutError::Timeout) => Err(Silence::Late),
            Err(RecvTimeoutError::Disconnected) => Err(Silence::Broken("it says nothing more".to_owned())),
        }
    }

    /// Asks it to end, all of its group.
    pub(super) fn terminate(&mut self) {
        self.guard.terminate();
    }

    /// Ends it and all that it started, and waits for it. `patience` is how long it may take by itself.
    fn end(&mut self, patience: Duration) -> Option<ExitStatus> {
        self.hang_up();
        let mut status = ends_within(&mut self.child, patience);
        if status.is_none() {
            self.guard.terminate();
            status = ends_within(&mut self.child, GRACE);
        }
        // Whatever it left behind goes as well.
        self.guard.kill();
        if status.is_none() {
            let _ = self.child.kill();
            status = ends_within(&mut self.child, GRACE);
        }
        self.guard.wait();
        status
    }

    /// Ends it after something went wrong; how it ended by itself, if it did, and the end of what it said on its standard error, as lines for a message.
    pub(super) fn last_words(mut self, is_silent: bool) -> String {
        // What has closed its streams is about to end; what is silent, or says what it should not, is not.
        let by_itself =
            ends_within(&mut self.child, if is_silent { Duration::ZERO } else { Duration::from_millis(500) });
        let mut words = by_itself.map_or_else(String::new, |status| format!("; it {}", how(status)));
        self.end(Duration::ZERO);
        if let Some(listener) = self.listener.take() {
            // Somebody who left the group may hold the stream for ever.
            let until = Instant::now() + Duration::from_millis(500);
            while !listener.is_finished() && Instant::now() < until {
                thread::sleep(Duration::from_millis(1));
            }
        }
        let said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        let bytes: Vec<u8> = said.bytes.iter().copied().collect();
        let text = String::from_utf8_lossy(&bytes);
        let lines: Vec<&str> = text.lines().map(str::trim_end).filter(|line| !line.is_empty()).collect();
        if lines.is_empty() {
            words.push_str("; its standard error is empty");
            return words;
        }
        const LINES: usize = 20;
        let shown = &lines[lines.len().saturating_sub(LINES)..];
        let cut = if said.left_out || shown.len() < lines.len() {
            "the end of its standard error"
        } else {
            "its standard error"
        };
        words.push_str(&format!("; {cut}:"));
        for line in shown {
            words.push_str("\n  ");
            words.extend(line.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }));
        }
        words
    }
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
            self.end(GRACE);
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
                let mut shared = shared.lock().unwrap_or_else(PoisonError::into_inner);
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
    let shared = || shared.lock().unwrap_or_else(PoisonError::into_inner);
    let mut stream = StreamReader::new(output);
    let schema = match stream.schema() {
        Ok(Some(schema)) => {
            let agreed = protocol::check_schema(&schema).and_then(|()| shared().agree(protocol::agrees(&schema)));
            agreed.map(|()| schema)
        }
        Ok(None) => Err("it ended, or closed its standard output, before it said anything".to_owned()),
        Err(error) => Err(format!("what it says is not of the protocol: {error}")),
    };
    let schema = match schema {
        Ok(schema) => schema,
        Err(what) => {
            let _ = heard.send(Err(what));
            return;
        }
    };
    loop {
        let next = match stream.batch(&schema) {
            Ok(Some(batch)) => {
                let row = shared().meant(&schema, batch);
                row.and_then(|row| protocol::reply(&schema, &row, outputs))
            }
            Ok(None) => Err("it ended, or closed its standard output".to_owned()),
            Err(error) => Err(format!("what it says is not of the protocol: {error}")),
        };
        let is_over = next.is_err();
        if heard.send(next).is_err() || is_over {
            return;
        }
    }
}

/// Keeps the end of what comes.
fn listen(mut errors: impl Read, said: &Mutex<Said>) {
    let mut chunk = [0; 4096];
    while let Ok(read) = errors.read(&mut chunk) {
        if read == 0 {
            return;
        }
        let mut said = said.lock().unwrap_or_else(PoisonError::into_inner);
        said.bytes.extend(&chunk[..read]);
        let over = said.bytes.len().saturating_sub(KEPT);
        said.left_out |= over > 0;
        said.bytes.drain(..over);
    }
}
