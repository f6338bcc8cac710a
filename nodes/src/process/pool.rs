//! The processes of a node: started when a worker needs one, borrowed and returned.

use std::collections::HashMap;
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use depthloom_codecs::arrow::Schema;
use depthloom_graphs::{ErrorMessage, Fault, Host, Key, Outputs, Port, Value};
use depthloom_threads::locked;

use super::child::{NoReply, POLL_INTERVAL, Running};
use super::imports::{self, is_python};
use super::launch::Launch;
use super::modules::ModuleReport;
use super::protocol::{self, Call, Content, Request};

pub(super) struct Pool {
    launch: Launch,
    schema: Arc<Schema>,
    outputs: Arc<[Port]>,
    state: Mutex<State>,
    released: Condvar,
}

#[derive(Default)]
struct State {
    idle: Vec<Running>,
    /// Including those in use.
    count: usize,
}

pub(super) enum Answer {
    Values(Vec<Option<Value>>),
    Frames(Vec<String>, Option<Vec<u64>>),
}

impl Pool {
    pub(super) fn new(launch: Launch, schema: Schema, outputs: Vec<Port>) -> Self {
        let schema = match launch.modules.are_requested() {
            true => protocol::requesting_modules(schema, false),
            false => schema,
        };
        let (schema, outputs) = (Arc::new(schema), outputs.into());
        Self { launch, schema, outputs, state: Mutex::default(), released: Condvar::new() }
    }

    pub(super) const fn launch(&self) -> &Launch {
        &self.launch
    }

    pub(super) fn outputs(&self, call: Call, inputs: Vec<Option<Value>>, host: &dyn Host) -> Result<Outputs, Fault> {
        let Answer::Values(values) = self.call(call, inputs, host)? else {
            return Err(Fault::new(format!("`{}` sent frames instead of values", self.launch.program())));
        };
        validated(&self.outputs, values).map_err(|what| Fault::new(format!("`{}` {what}", self.launch.program())))
    }

    pub(super) fn call(&self, call: Call, inputs: Vec<Option<Value>>, host: &dyn Host) -> Result<Answer, Fault> {
        let taken = self.take(host)?;
        let mut slot = Slot { pool: self, running: None };
        let mut running = match taken {
            Some(running) => running,
            None => {
                let started = Running::start(&self.launch, &self.schema, &self.outputs)?;
                let (mut running, says) = self.receive(started, 0, self.launch.start, false, host)?;
                match says {
                    Content::Ready => {
                        // By now it has read them.
                        self.launch.check_code()?;
                        running
                    }
                    Content::Failure { message, trace } => {
                        running.has_failed = true;
                        drop(running);
                        return Err(self.failure("when it was started", &message, &trace));
                    }
                    _ => {
                        return Err(self.broken(running, ErrorMessage::new("sent values before `ready`"), false));
                    }
                }
            }
        };
        running.number += 1;
        let number = running.number;
        let is_of_a_frame = matches!(call, Call::Process(_) | Call::Frames);
        let patience = if is_of_a_frame { self.launch.frame } else { self.launch.once };
        let started_at = Instant::now();
        running.send(Request { number, call, inputs });
        let (mut running, says) = self.receive(running, number, patience, !is_of_a_frame, host)?;
        running.has_failed = false;
        let answer = match says {
            Content::Values { values, cpu_ns } => {
                host.add_cpu_time(cpu_ns.min(most_cpu_ns(started_at.elapsed())));
                Ok(Answer::Values(values))
            }
            Content::Frames { ids, times_ns } => Ok(Answer::Frames(ids, times_ns)),
            Content::Failure { message, trace } => {
                running.has_failed = true;
                Err(self.failure("", &message, &trace))
            }
            Content::Frame(_) | Content::End => {
                let what = "sent a frame of a stream instead of a reply";
                return Err(self.broken(running, ErrorMessage::new(what), false));
            }
            Content::Ready | Content::Progress { .. } | Content::Warning { .. } | Content::Modules(_) => {
                let what = "sent `ready` instead of a reply";
                return Err(self.broken(running, ErrorMessage::new(what), false));
            }
        };
        slot.running = Some(running);
        answer
    }

    fn take(&self, host: &dyn Host) -> Result<Option<Running>, Fault> {
        let mut state = locked(&self.state);
        loop {
            if let Some(running) = state.idle.pop() {
                return Ok(Some(running));
            }
            if state.count < self.launch.instances {
                state.count += 1;
                return Ok(None);
            }
            if host.cancelled() {
                return Err(Fault::Cancelled);
            }
            state = self.released.wait_timeout(state, POLL_INTERVAL).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Forwards warnings and progress. Ends the process if there is no valid reply.
    fn receive(
        &self,
        mut running: Running,
        number: i64,
        patience: Duration,
        may_be_stopped: bool,
        host: &dyn Host,
    ) -> Result<(Running, Content), Fault> {
        let mut until = Instant::now() + patience;
        loop {
            if host.cancelled() || may_be_stopped && host.stopping() {
                running.terminate();
                return Err(Fault::Cancelled);
            }
            let left = until.saturating_duration_since(Instant::now());
            match running.receive(left.min(POLL_INTERVAL)) {
                Err(NoReply::Late) if left.is_zero() => {
                    let (what, name) = match number {
                        0 => ("was not ready", "start_timeout_s"),
                        _ => ("did not answer", "timeout_s"),
                    };
                    let what = format!("{what} within {} s, and was ended", patience.as_secs_f64());
                    let error = ErrorMessage::new(what).remedy(format!("raise `{name}` if it needs longer"));
                    return Err(self.broken(running, error, true));
                }
                Err(NoReply::Late) => {}
                Err(NoReply::Broken(error)) => {
                    let when = if number == 0 { "did not start" } else { "gave no answer" };
                    let error = ErrorMessage { what: format!("{when}: {}", error.what), ..error };
                    return Err(self.broken(running, error, false));
                }
                Ok(reply) if reply.number != number => {
                    let what = format!("replied to call {} instead of call {number}", reply.number);
                    return Err(self.broken(running, ErrorMessage::new(what), false));
                }
                Ok(reply) => match reply.content {
                    Content::Progress { done, total, message } => {
                        until = Instant::now() + patience;
                        host.progress(done, total, &message);
                    }
                    Content::Modules(report) => imports::check(report, &self.launch)?,
                    Content::Warning { count: 0, message } => host.warn(&message),
                    Content::Warning { count, message } => host.warn_n(count, &message),
                    says => return Ok((running, says)),
                },
            }
        }
    }

    fn failure(&self, when: &str, message: &str, trace: &str) -> Fault {
        let when = if when.is_empty() { String::new() } else { format!(" {when}") };
        Fault::new(format!("`{}` failed{when}: {}", self.launch.program(), with_trace(message, trace)))
    }

    fn broken(&self, running: Running, error: ErrorMessage, ends_at_once: bool) -> Fault {
        let (program, context) = (self.launch.program(), running.end_with_context(ends_at_once));
        Fault::Failed(ErrorMessage { what: format!("`{program}` {}{context}", error.what), ..error })
    }
}

/// The values of a reply by port.
pub(super) fn validated(ports: &[Port], values: Vec<Option<Value>>) -> Result<Outputs, String> {
    let mut outputs = Outputs::none();
    for (port, value) in ports.iter().zip(values) {
        let Some(value) = value else { continue };
        value
            .validate()
            .map_err(|what| format!("returned an invalid {} at port `{}`: {what}", port.value_type, port.name))?;
        outputs = outputs.with(port.name, value);
    }
    Ok(outputs)
}

/// The message of a failure, and its traceback line by line.
pub(super) fn with_trace(message: &str, trace: &str) -> String {
    let mut what = message.trim_end().to_owned();
    for line in trace.trim_end().lines().filter(|line| !line.is_empty()) {
        what.push_str("\n  ");
        what.push_str(line);
    }
    what
}

/// Starts a Python program, once per command, to report what it imports. `None` without a report: errors appear when it
/// is called.
pub(super) fn report_of(launch: &Launch) -> Option<Arc<ModuleReport>> {
    type Reports = Mutex<HashMap<Key, Option<Arc<ModuleReport>>>>;
    static REPORTS: OnceLock<Reports> = OnceLock::new();
    if !is_python(launch) {
        return None;
    }
    let key = Key::build("command").number(launch.command.len() as u64);
    let key = launch.command.iter().fold(key, |key, word| key.text(&word.0)).number(launch.env.len() as u64);
    let key = launch.env.iter().fold(key, |key, (name, value)| key.text(name).text(value)).finish();
    let mut reports = locked(REPORTS.get_or_init(Mutex::default));
    reports.entry(key).or_insert_with(|| modules(launch).map(Arc::new)).clone()
}

fn modules(launch: &Launch) -> Option<ModuleReport> {
    let schema = protocol::request_schema("pure", &[], &[], &serde_json::Map::new());
    let schema = Arc::new(protocol::requesting_modules(schema, true));
    let mut running = Running::start(launch, &schema, &Arc::from([])).ok()?;
    // What it prints, and how it ends, is reported of the one that is called.
    running.is_reported = false;
    match running.receive(launch.start).map(|reply| reply.content) {
        Ok(Content::Modules(report)) => Some(report),
        Ok(_) | Err(_) => {
            running.terminate();
            None
        }
    }
}

/// A program reports its own CPU time, which may be any number.
fn most_cpu_ns(duration: Duration) -> u64 {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    // Clocks have different resolutions.
    let duration = duration.saturating_add(Duration::from_millis(20));
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX).saturating_mul(cores as u64)
}

struct Slot<'a> {
    pool: &'a Pool,
    running: Option<Running>,
}

impl Drop for Slot<'_> {
    fn drop(&mut self) {
        let mut state = locked(&self.pool.state);
        match self.running.take() {
            Some(running) => state.idle.push(running),
            None => state.count -= 1,
        }
        drop(state);
        self.pool.released.notify_one();
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        let idle = &mut self.state.get_mut().unwrap_or_else(PoisonError::into_inner).idle;
        // All are closed before any is waited for.
        idle.iter_mut().for_each(Running::close_stdin);
    }
}

#[cfg(test)]
mod tests {
    use super::{Duration, most_cpu_ns};

    #[test]
    fn a_call_takes_at_most_the_cpu_time_of_all_cores() {
        let cores = std::thread::available_parallelism().map_or(1, usize::from) as u64;
        assert_eq!(most_cpu_ns(Duration::from_secs(1)), 1_020_000_000 * cores);
        assert_eq!(most_cpu_ns(Duration::MAX), u64::MAX);
    }
}
