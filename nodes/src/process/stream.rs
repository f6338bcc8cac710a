//! `process/source` with `stream: true`: a program that delivers frames as they arrive.

mod numbering;

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use depthloom_codecs::arrow::Schema;
use depthloom_graphs::contracts::{NextFrame, StreamFrame, StreamingSource};
use depthloom_graphs::{ErrorMessage, Fault, Frame, Host as _, Key, Port, SourceOutputs, counted};

use self::numbering::Numbering;
use super::child::{CLOSED, Failed, NoReply, Running, thread};
use super::imports;
use super::launch::Launch;
use super::pool::{validated, with_trace};
use super::protocol::{self, Call, Content, Request, StatedFrame};
use super::source::{WarningCollector, check_sizes};
use crate::content_key;

const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(5);
/// Time for a frame that was requested when the stream is closed, before the program is terminated.
const LAST_FRAME: Duration = Duration::from_secs(1);
/// Longer than a process takes to end after SIGTERM and SIGKILL.
const LONGEST_END: Duration = Duration::from_secs(10);

enum State {
    /// No call is outstanding.
    Idle(Running),
    Waiting {
        running: Running,
        until: Instant,
    },
    Starting {
        running: Running,
        until: Instant,
    },
    /// A process that failed is being ended by a thread.
    Ending {
        failure: Failure,
        ended: Receiver<Failed>,
    },
    Pausing {
        until: Instant,
        warning: String,
    },
    Ended,
}

struct Failure {
    /// Continues a sentence that starts with the program.
    what: String,
    /// More lines: a traceback.
    details: String,
    remedy: Option<String>,
    /// It closed its standard output, so that its exit code says more.
    is_exit: bool,
    ends_at_once: bool,
}

impl Failure {
    fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), details: String::new(), remedy: None, is_exit: false, ends_at_once: true }
    }

    fn without_reply(error: ErrorMessage) -> Self {
        let is_exit = error.what.starts_with(CLOSED);
        let what = format!("gave no frame: {}", error.what);
        Self { remedy: error.remedy, is_exit, ends_at_once: false, ..Self::new(what) }
    }
}

enum Received {
    Reply(Content, Instant),
    Failed(Failure),
    TimedOut,
}

type Step = ControlFlow<NextFrame>;

pub(super) struct ProcessStream {
    launch: Launch,
    schema: Arc<Schema>,
    outputs: Arc<[Port]>,
    program_key: Key,
    restarts: u32,
    state: State,
    numbering: Numbering,
    was_ready: bool,
    /// Consecutive ones, without a frame.
    failures: u32,
    /// Frames of the current process.
    frames: u64,
    restart_warnings: Vec<String>,
    warnings: WarningCollector,
}

impl ProcessStream {
    /// Starts the program, and waits until it is ready. A failure of this first start is not tried again.
    pub(super) fn start(
        launch: Launch,
        schema: Schema,
        outputs: Vec<Port>,
        restarts: u32,
        program_key: impl FnOnce(&Launch) -> Result<Key, Fault>,
    ) -> Result<Self, Fault> {
        let schema = match launch.modules.are_requested() {
            true => protocol::requesting_modules(schema, false),
            false => schema,
        };
        let mut stream = Self {
            launch,
            schema: Arc::new(schema),
            outputs: outputs.into(),
            program_key: Key::of_content(b""),
            restarts,
            state: State::Ended,
            numbering: Numbering::default(),
            was_ready: false,
            failures: 0,
            frames: 0,
            restart_warnings: Vec::new(),
            warnings: WarningCollector::default(),
        };
        stream.start_process()?;
        while !stream.was_ready {
            // Time limits end this loop.
            let _ = stream.step(Instant::now() + Duration::from_secs(1))?;
        }
        // By now the process has reported what it imports.
        stream.program_key = program_key(&stream.launch)?;
        Ok(stream)
    }

    fn start_process(&mut self) -> Result<(), Fault> {
        let running = Running::start(&self.launch, &self.schema, &self.outputs)?;
        self.state = State::Starting { running, until: Instant::now() + self.launch.start };
        Ok(())
    }

    /// One step towards the next frame.
    fn step(&mut self, deadline: Instant) -> Result<Step, Fault> {
        match std::mem::replace(&mut self.state, State::Ended) {
            State::Idle(mut running) => {
                running.number += 1;
                running.send(Request { number: running.number, call: Call::Next, inputs: Vec::new() });
                self.state = State::Waiting { running, until: Instant::now() + self.launch.frame };
                Ok(Step::Continue(()))
            }
            State::Waiting { mut running, mut until } => match self.receive(&mut running, &mut until, deadline)? {
                Received::TimedOut => {
                    self.state = State::Waiting { running, until };
                    Ok(Step::Break(NextFrame::TimedOut))
                }
                Received::Failed(failure) => self.fail(running, failure),
                Received::Reply(content, arrived) => self.reply(running, content, arrived),
            },
            State::Starting { mut running, mut until } => match self.receive(&mut running, &mut until, deadline)? {
                Received::TimedOut => {
                    self.state = State::Starting { running, until };
                    Ok(Step::Break(NextFrame::TimedOut))
                }
                Received::Failed(failure) => self.fail(running, failure),
                Received::Reply(Content::Ready, _) => {
                    // By now it has read them.
                    self.launch.check_code()?;
                    self.was_ready = true;
                    self.frames = 0;
                    self.numbering.restart();
                    self.state = State::Idle(running);
                    Ok(Step::Continue(()))
                }
                Received::Reply(Content::Failure { message, trace }, _) => {
                    self.fail_with_trace(running, "failed when it was started", &message, &trace)
                }
                Received::Reply(..) => self.fail(running, Failure::new("sent a reply before `ready`")),
            },
            State::Ending { failure, ended } => {
                let failed = match ended.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                    Ok(failed) => failed,
                    Err(RecvTimeoutError::Timeout) => {
                        self.state = State::Ending { failure, ended };
                        return Ok(Step::Break(NextFrame::TimedOut));
                    }
                    // The thread could not be started, and the process was ended at once.
                    Err(RecvTimeoutError::Disconnected) => Failed::default(),
                };
                self.pause_or_give_up(&failure, &failed)?;
                Ok(Step::Continue(()))
            }
            State::Pausing { until, warning } => {
                std::thread::sleep(until.min(deadline).saturating_duration_since(Instant::now()));
                if Instant::now() < until {
                    self.state = State::Pausing { until, warning };
                    return Ok(Step::Break(NextFrame::TimedOut));
                }
                self.restart_warnings.push(warning);
                self.start_process()?;
                Ok(Step::Continue(()))
            }
            State::Ended => Ok(Step::Break(NextFrame::Ended)),
        }
    }

    /// Waits for a reply. Collects warnings; progress restarts the time limit.
    fn receive(&self, running: &mut Running, until: &mut Instant, deadline: Instant) -> Result<Received, Fault> {
        let number = running.number;
        loop {
            match running.receive((*until).min(deadline).saturating_duration_since(Instant::now())) {
                Err(NoReply::Late) if Instant::now() >= *until => {
                    let (what, limit, name) = match number {
                        0 => ("was not ready", self.launch.start, "start_timeout_s"),
                        _ => ("sent no frame", self.launch.frame, "timeout_s"),
                    };
                    let what = format!("{what} within {} s", limit.as_secs_f64());
                    let remedy = Some(format!("raise `{name}` if it needs longer"));
                    return Ok(Received::Failed(Failure { remedy, ..Failure::new(what) }));
                }
                Err(NoReply::Late) if Instant::now() >= deadline => return Ok(Received::TimedOut),
                Err(NoReply::Late) => {}
                Err(NoReply::Broken(error)) => return Ok(Received::Failed(Failure::without_reply(error))),
                Ok(reply) if reply.number != number => {
                    let what = format!("replied to call {} instead of call {number}", reply.number);
                    return Ok(Received::Failed(Failure::new(what)));
                }
                Ok(reply) => match reply.content {
                    Content::Progress { .. } => {
                        let limit = if number == 0 { self.launch.start } else { self.launch.frame };
                        *until = Instant::now() + limit;
                    }
                    Content::Modules(report) => imports::check(report, &self.launch)?,
                    Content::Warning { count, message } => self.warnings.warn_n(count, &message),
                    content => return Ok(Received::Reply(content, reply.arrived)),
                },
            }
        }
    }

    fn reply(&mut self, running: Running, content: Content, arrived: Instant) -> Result<Step, Fault> {
        match content {
            Content::Frame(stated) => match self.frame(stated, arrived) {
                Ok(frame) => {
                    self.failures = 0;
                    self.frames += 1;
                    self.state = State::Idle(running);
                    Ok(Step::Break(NextFrame::Captured(Box::new(frame))))
                }
                Err(what) => self.fail(running, Failure::new(what)),
            },
            Content::End => {
                // It has nothing to do any more, and ends with its input.
                drop(running);
                Ok(Step::Break(NextFrame::Ended))
            }
            Content::Failure { message, trace } => self.fail_with_trace(running, "failed", &message, &trace),
            _ => self.fail(running, Failure::new("sent another reply instead of a frame")),
        }
    }

    fn frame(&mut self, stated: StatedFrame, arrived: Instant) -> Result<StreamFrame, String> {
        let outputs = validated(&self.outputs, stated.values)?;
        check_sizes(&outputs).map_err(|fault| format!("returned invalid values: {fault}"))?;
        let numbered = self.numbering.next(stated.id, stated.index, stated.missed)?;
        let captured = arrived.checked_sub(Duration::from_nanos(stated.age_ns)).unwrap_or(arrived);
        let time_ns = stated.time_ns.unwrap_or_else(|| wall_clock_ns(captured));
        let key = content_key::of_frame("process/source stream", &self.program_key, &outputs);
        Ok(StreamFrame {
            frame: Frame { id: numbered.id.into(), index: numbered.index, time_ns },
            read: SourceOutputs { outputs, key },
            captured,
            missed: numbered.missed,
        })
    }

    fn fail_with_trace(&mut self, running: Running, when: &str, message: &str, trace: &str) -> Result<Step, Fault> {
        let first_line = message.lines().next().unwrap_or_default();
        let whole = with_trace(message, trace);
        let details = whole.strip_prefix(first_line).unwrap_or(&whole).to_owned();
        self.fail(running, Failure { details, ..Failure::new(format!("{when}: {first_line}")) })
    }

    /// Ends a process of no further use, without waiting for it.
    fn fail(&mut self, running: Running, failure: Failure) -> Result<Step, Fault> {
        let (sender, ended) = sync_channel(1);
        let ends_at_once = failure.ends_at_once;
        let end = move || {
            let _ = sender.send(running.end_after_failure(ends_at_once));
        };
        // If there is no room for a thread, dropping the closure ends the process.
        let _ = thread("end", end);
        self.state = State::Ending { failure, ended };
        Ok(Step::Continue(()))
    }

    fn pause_or_give_up(&mut self, failure: &Failure, failed: &Failed) -> Result<(), Fault> {
        let program = self.launch.program();
        let what = failed.status.as_ref().filter(|_| failure.is_exit).unwrap_or(&failure.what);
        let after =
            if self.was_ready { format!(" after {}", counted(self.frames as usize, "frame")) } else { String::new() };
        if !self.was_ready || self.failures >= self.restarts {
            let tried = match self.failures {
                0 => String::new(),
                restarts => format!(", and {} gave no frame", counted(restarts as usize, "restart")),
            };
            let what = format!("`{program}` {what}{after}{tried}{}{}", failure.details, failed.stderr);
            return Err(Fault::Failed(ErrorMessage { remedy: failure.remedy.clone(), ..ErrorMessage::new(what) }));
        }
        let last_line = failed.last_line.as_ref().map_or_else(String::new, |line| format!(" ({line})"));
        let warning = format!("`{program}` {what}{after}{last_line}; started again");
        let pause = FIRST_PAUSE.saturating_mul(1 << self.failures.min(16)).min(LONGEST_PAUSE);
        self.failures += 1;
        self.state = State::Pausing { until: Instant::now() + pause, warning };
        Ok(())
    }
}

impl StreamingSource for ProcessStream {
    fn next(&mut self, deadline: Instant) -> Result<NextFrame, Fault> {
        loop {
            if let ControlFlow::Break(found) = self.step(deadline)? {
                return Ok(found);
            }
        }
    }

    fn take_warnings(&mut self) -> Vec<String> {
        let mut warnings = std::mem::take(&mut self.restart_warnings);
        warnings.extend(self.warnings.take());
        warnings
    }
}

impl Drop for ProcessStream {
    fn drop(&mut self) {
        match std::mem::replace(&mut self.state, State::Ended) {
            State::Idle(_) | State::Pausing { .. } | State::Ended => {}
            State::Waiting { mut running, .. } => {
                running.close_stdin();
                let until = Instant::now() + LAST_FRAME;
                loop {
                    match running.receive(until.saturating_duration_since(Instant::now())) {
                        Ok(reply) if matches!(reply.content, Content::Progress { .. } | Content::Warning { .. }) => {}
                        // After its reply, it sees the end of its input.
                        Ok(_) | Err(NoReply::Broken(_)) => break,
                        Err(NoReply::Late) => {
                            running.terminate();
                            break;
                        }
                    }
                }
            }
            State::Starting { mut running, .. } => running.terminate(),
            State::Ending { ended, .. } => {
                // Its standard error is then in the log of the run.
                let _ = ended.recv_timeout(LONGEST_END);
            }
        }
    }
}

fn wall_clock_ns(at: Instant) -> u64 {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since_epoch.saturating_sub(at.elapsed()).as_nanos()).unwrap_or(u64::MAX)
}
