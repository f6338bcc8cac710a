//! Signals that end a run: from Ctrl-C, a scheduler, a terminal that closes.
//!
//! After the first signal the frames in flight finish, training stores a checkpoint, and the analysis stops. The second
//! abandons the frames in flight. The third ends the process, even if everything else hangs. A signal that was ignored
//! when the program started stays ignored, as `nohup` and background jobs of a shell need it.

use depthloom_runner::Interrupt;
use depthloom_terminal::{CliError, ExitCode, say};

use crate::args::TriggerSignal;

/// Listens for signals from now on; before, they end the process. `stopping` is the message for the first one.
pub(crate) fn listen(stopping: &'static str) -> Result<Interrupt, CliError> {
    let interrupt = Interrupt::default();
    system::listen(interrupt.clone(), stopping).map_err(|error| {
        CliError::because(ExitCode::Engine, "failed to listen for signals", &error)
            .remedy("raise the limits of threads and open files (`ulimit -u`, `ulimit -n`)")
    })?;
    Ok(interrupt)
}

/// Calls `trigger` whenever the signal arrives, from now on; before, it ends the process.
pub(crate) fn on(signal: TriggerSignal, trigger: impl Fn() + Send + 'static) -> Result<(), CliError> {
    system::on(signal, trigger)
        .map_err(|error| CliError::because(ExitCode::Engine, "failed to listen for the signal of --on", &error))
}

/// Lets a write beyond the limit of file sizes (`ulimit -f`) fail as one on a full disk does; by default it kills the
/// process.
pub(crate) fn outlive_file_size_limit() {
    system::outlive_file_size_limit();
}

/// Ends the process at once, without waiting for anything it still holds.
pub(crate) fn leave(exit: ExitCode) -> ! {
    system::leave(exit as i32)
}

fn raise(interrupt: &Interrupt, stopping: &str) {
    if interrupt.aborts() {
        leave(ExitCode::Interrupted);
    }
    match interrupt.raise() {
        1 => say(format_args!("{stopping}; again to abort")),
        _ => say("aborting"),
    }
}

#[cfg(unix)]
mod system {
    use std::io;
    use std::os::raw::c_int;
    use std::sync::Arc;

    use depthloom_runner::Interrupt;

    use crate::args::TriggerSignal;
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2, SIGXFSZ};
    use signal_hook::iterator::Signals;

    pub(super) fn listen(interrupt: Interrupt, stopping: &'static str) -> io::Result<()> {
        let handled: Vec<c_int> = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| !is_ignored(*signal)).collect();
        let mut signals = Signals::new(handled)?;
        let listener = move || {
            for signal in signals.forever() {
                // A terminal that closes sends several, which count as one.
                if signal != SIGHUP || !interrupt.stops_admission() {
                    super::raise(&interrupt, stopping);
                }
            }
        };
        let thread = std::thread::Builder::new().name("depthloom-signals".to_owned());
        depthloom_threads::look_for_room().and_then(|()| thread.spawn(listener)).map(drop)
    }

    pub(super) fn on(signal: TriggerSignal, trigger: impl Fn() + Send + 'static) -> io::Result<()> {
        let signal = match signal {
            TriggerSignal::User1 => SIGUSR1,
            TriggerSignal::User2 => SIGUSR2,
        };
        let mut signals = Signals::new([signal])?;
        let listener = move || signals.forever().for_each(|_| trigger());
        let thread = std::thread::Builder::new().name("depthloom-trigger".to_owned());
        depthloom_threads::look_for_room().and_then(|()| thread.spawn(listener)).map(drop)
    }

    /// Whether a signal was ignored when the program began. Where the system does not tell (no `/proc`), a hangup is
    /// taken to be: a run that `nohup` did not protect then ends by it, and keeps its frames.
    fn is_ignored(signal: c_int) -> bool {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        match mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()) {
            Some(mask) => mask >> (signal - 1) & 1 == 1,
            None => signal == SIGHUP,
        }
    }

    pub(super) fn outlive_file_size_limit() {
        // A handler that does nothing of note; one that cannot be set leaves what was.
        let _ = signal_hook::flag::register(SIGXFSZ, Arc::default());
    }

    pub(super) fn leave(code: i32) -> ! {
        signal_hook::low_level::exit(code)
    }
}

#[cfg(not(unix))]
mod system {
    use std::io;

    use depthloom_runner::Interrupt;

    pub fn listen(interrupt: Interrupt, stopping: &'static str) -> io::Result<()> {
        ctrlc::set_handler(move || super::raise(&interrupt, stopping)).map_err(io::Error::other)
    }

    pub fn on(_: crate::args::TriggerSignal, _: impl Fn() + Send + 'static) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }

    pub fn outlive_file_size_limit() {}

    pub fn leave(code: i32) -> ! {
        std::process::exit(code)
    }
}
