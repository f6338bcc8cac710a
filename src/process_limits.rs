//! What this process takes of the machine: priority, cores, memory.

use depthloom_terminal::{CliError, ExitCode};

use crate::args::LimitArgs;

/// Applies the limits. Threads started afterwards inherit them.
pub(crate) fn apply(limits: &LimitArgs) -> Result<(), CliError> {
    system::apply(limits)
}

fn refused(what: String, error: &std::io::Error) -> CliError {
    CliError::because(ExitCode::Usage, what, error)
}

#[cfg(target_os = "linux")]
mod system {
    use std::io;

    use depthloom_terminal::CliError;
    use rustix::process::{Resource, Rlimit, getrlimit, nice, setrlimit};
    use rustix::thread::{CpuSet, sched_setaffinity};

    use super::refused;
    use crate::args::{Cores, LimitArgs};

    pub(super) fn apply(limits: &LimitArgs) -> Result<(), CliError> {
        if let Some(by) = limits.nice {
            nice(by).map_err(|error| {
                refused(format!("failed to change the priority by --nice {by}"), &io::Error::from(error)).remedy(
                    "negative numbers need the right to raise the priority (CAP_SYS_NICE, or LimitNICE of systemd)",
                )
            })?;
        }
        if let Some(Cores(cores)) = &limits.cores {
            let mut set = CpuSet::new();
            cores.iter().for_each(|core| set.set(*core));
            sched_setaffinity(None, &set).map_err(|error| {
                let cores: Vec<String> = cores.iter().map(ToString::to_string).collect();
                refused(format!("failed to run on --cores {}", cores.join(",")), &io::Error::from(error))
                    .remedy("`nproc --all` prints how many there are; they are numbered from 0")
            })?;
        }
        if let Some(bytes) = limits.memory {
            let limit = Rlimit { current: Some(bytes), ..getrlimit(Resource::As) };
            setrlimit(Resource::As, limit).map_err(|error| {
                refused(format!("failed to limit the memory to --memory {bytes}"), &io::Error::from(error))
            })?;
        }
        Ok(())
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    use std::io;

    use depthloom_terminal::CliError;

    use super::refused;
    use crate::args::LimitArgs;

    pub(super) fn apply(limits: &LimitArgs) -> Result<(), CliError> {
        let LimitArgs { nice, cores, memory } = limits;
        if nice.is_none() && cores.is_none() && memory.is_none() {
            return Ok(());
        }
        let error = io::Error::from(io::ErrorKind::Unsupported);
        Err(refused("failed to apply --nice, --cores or --memory".to_owned(), &error))
    }
}
