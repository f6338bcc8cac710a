//! The processes of a node: started where a worker needs one, taken and given back.

use std::collections::HashMap;
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use depthloom_codecs::arrow::Schema;
use depthloom_graphs::{Fault, Host, Key, Outputs, Port, Value};
use depthloom_threads::locked;

use super::child::{LOOK, Running, Silence};
use super::imports::{self, is_python};
use super::launch::Launch;
use super::modules::ModuleReport;
use super::protocol::{self, Call, Request, Says};

pub(super) struct Pool {
    launch: Launch,
    schema: Arc<Schema>,
    outputs: Arc<[Port]>,
    state: Mutex<State>,
    given_back: Condvar,
}

#[derive(Default)]
struct State {
    idle: Vec<Running>,
    /// Including those in use.
    there: usize,
}

pub(super) enum Answer {
    Values(Vec<Option<Value>>),
    Frames(Vec<String>, Option<Vec<u64>>),
}

impl Pool {
    pub(super) fn new(launch: Launch, schema: Schema, outputs: Vec<Port>) -> Self {
        let schema = match launch.modules.are_asked_for() {
            true => protocol::asking_for_modules(schema, false),
            false => schema,
        };
        let (schema, outputs) = (Arc::new(schema), outputs.into());
        Self { launch, schema, outputs, state: Mutex::default(), given_back: Condvar::new() }
    }

    pub(super) const fn launch(&self) -> &Launch {
        &self.launch
    }

    pub(super) fn outputs(&self, call: Call, inputs: Vec<Option<Value>>, host: &dyn Host) -> Result<Outputs, Fault> {
        let Answer::Values(values) = self.call(call, inputs, host)? else {
            return Err(Fault::new(format!("`{}` gave frames where values are wanted", self.launch.program())));
        };
        let mut outputs = Outputs::none();
        for (port, value) in self.outputs.iter().zip(values) {
            let Some(value) = value else { continue };
            value.validate().map_err(|what| {
                let (told, name, value_type) = (self.launch.program(), port.name, port.value_type);
                Fault::new(format!("`{told}` returned an invalid {value_type} at port `{name}`: {what}"))
            })?;
            outputs = outputs.with(port.name, value);
        }
        Ok(outputs)
    }

    pub(super) fn call(&self, call: Call, inputs: Vec<Option<Value>>, host: &dyn Host) -> Result<Answer, Fault> {
        let taken = self.take(host)?;
        let mut slot = Slot { pool: self, running: None };
        let mut running = match taken {
            Some(running) => running,
            None => {
                let started = Running::start(&self.launch, &self.schema, &self.outputs)?;
                let (mut running, says) = self.hear(started, 0, self.launch.start, false, host)?;
                match says {
                    Says::Ready => {
                        // By now it has read them.
                        self.launch.check_code()?;
                        running
                    }
                    Says::Failure { message, trace } => {
                        running.has_failed = true;
                        drop(running);
                        return Err(self.failure("when it was started", &message, &trace));
                    }
                    _ => return Err(self.broken(running, "gave values before it said `ready`", "", false)),
                }
            }
        };
        running.number += 1;
        let number = running.number;
        let is_of_a_frame = matches!(call, Call::Process(_) | Call::Frames);
        let patience = if is_of_a_frame { self.launch.frame } else { self.launch.once };
        let begun = Instant::now();
        running.send(Request { number, call, inputs });
        let (mut running, says) = self.hear(running, number, patience, !is_of_a_frame, host)?;
        running.has_failed = false;
        let answer = match says {
            Says::Values { values, cpu_ns } => {
                host.add_cpu_time(cpu_ns.min(most_cpu_ns(begun.elapsed())));
                Ok(Answer::Values(values))
            }
            Says::Frames { ids, times_ns } => Ok(Answer::Frames(ids, times_ns)),
            Says::Failure { message, trace } => {
                running.has_failed = true;
                Err(self.failure("", &message, &trace))
            }
            Says::Ready | Says::Progress { .. } | Says::Warning { .. } | Says::Modules(_) => {
                return Err(self.broken(running, "said `ready` where an answer is wanted", "", false));
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
            if state.there < self.launch.instances {
                state.there += 1;
                return Ok(None);
            }
            if host.cancelled() {
                return Err(Fault::Cancelled);
            }
            state = self.given_back.wait_timeout(state, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Forwards warnings and progress. Ends the process if there is no valid reply.
    fn hear(
        &self,
        mut running: Running,
        number: i64,
        patience: Duration,
        may_be_stopped: bool,
        host: &dyn Host,
    ) -> Result<(Running, Says), Fault> {
        let mut until = Instant::now() + patience;
        loop {
            if host.cancelled() || may_be_stopped && host.stopping() {
                running.terminate();
                return Err(Fault::Cancelled);
            }
            let left = until.saturating_duration_since(Instant::now());
            match running.hear(left.min(LOOK)) {
                Err(Silence::Late) if left.is_zero() => {
                    let what = if number == 0 { "was not ready" } else { "did not answer" };
                    let (seconds, name) =
                        (patience.as_secs_f64(), if number == 0 { "start_timeout_s" } else { "timeout_s" });
                    let (what, remedy) = (
                        format!("{what} within {seconds} s, and was ended"),
                        format!("raise `{name}` if it needs longer"),
                    );
                    return Err(self.broken(running, &what, &remedy, true));
                }
                Err(Silence::Late) => {}
                Err(Silence::Broken(what, remedy)) => {
                    let when = if number == 0 { "did not start" } else { "gave no answer" };
                    return Err(self.broken(running, &format!("{when}: {what}"), remedy, false));
                }
                Ok(reply) if reply.number != number => {
                    let what = format!("answered call {} where call {number} is to be answered", reply.number);
                    return Err(self.broken(running, &what, "", false));
                }
                Ok(reply) => match reply.says {
                    Says::Progress { done, total, message } => {
                        until = Instant::now() + patience;
                        host.progress(done, total, &message);
                    }
                    Says::Modules(report) => imports::check(report, &self.launch)?,
                    Says::Warning { count: 0, message } => host.warn(&message),
                    Says::Warning { count, message } => host.warn_n(count, &message),
                    says => return Ok((running, says)),
                },
            }
        }
    }

    fn failure(&self, when: &str, message: &str, trace: &str) -> Fault {
        let when = if when.is_empty() { String::new() } else { format!(" {when}") };
        let mut what = format!("`{}` failed{when}: {}", self.launch.program(), message.trim_end());
        for line in trace.trim_end().lines().filter(|line| !line.is_empty()) {
            what.push_str("\n  ");
            what.push_str(line);
        }
        Fault::new(what)
    }

    fn broken(&self, running: Running, what: &str, remedy: &str, is_silent: bool) -> Fault {
        let fault = Fault::new(format!("`{}` {what}{}", self.launch.program(), running.last_words(is_silent)));
        if remedy.is_empty() { fault } else { fault.remedy(remedy) }
    }
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
    let schema = Arc::new(protocol::asking_for_modules(schema, true));
    let mut running = Running::start(launch, &schema, &Arc::from([])).ok()?;
    // What it prints, and how it ends, is reported of the one that is called.
    running.is_reported = false;
    match running.hear(launch.start).map(|reply| reply.says) {
        Ok(Says::Modules(report)) => Some(report),
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
            None => state.there -= 1,
        }
        drop(state);
        self.pool.given_back.notify_one();
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        let idle = &mut self.state.get_mut().unwrap_or_else(PoisonError::into_inner).idle;
        // All are told before any is waited for.
        idle.iter_mut().for_each(Running::hang_up);
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
