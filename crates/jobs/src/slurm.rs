//! Slurm: scripts of job arrays, and the commands of its client.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use depthloom_terminal::{CliError, ExitCode};

use crate::submission::{JobId, LOGS, SlurmArray, Submission};

/// The largest array index plus one where Slurm does not say: its default for `MaxArraySize`.
const ARRAY_SIZE: usize = 1001;
/// The most characters of `--array`: Slurm's own limit is larger.
const INDEXES_LENGTH: usize = 8000;

/// A command of Slurm's client.
///
/// # Errors
/// If it cannot be started, or fails.
fn slurm(program: &str, arguments: &[String]) -> Result<String, CliError> {
    let output = Command::new(program).args(arguments).output().map_err(|error| {
        CliError::because(ExitCode::Usage, format_args!("failed to start `{program}`"), &error)
            .remedy("run this on a machine with Slurm's commands, or use `--to local` or `--to script`")
    })?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let errors = String::from_utf8_lossy(&output.stderr);
    let errors = errors.trim();
    let what = format!("`{program}` failed ({}): {errors}", output.status);
    Err(CliError::usage(what, "see Slurm's message; options after `--` are passed to sbatch"))
}

/// The state of a job array's task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TaskState {
    /// As Slurm names it: `PENDING`, `RUNNING`, `TIMEOUT`.
    pub state: String,
    /// Why it waits, or where it runs.
    pub reason: String,
}

impl TaskState {
    /// Whether it waits or runs.
    #[must_use]
    pub fn is_active(&self) -> bool {
        let active = [
            "PENDING",
            "RUNNING",
            "COMPLETING",
            "CONFIGURING",
            "SUSPENDED",
            "REQUEUED",
            "REQUEUE_HOLD",
            "REQUEUE_FED",
            "RESIZING",
            "SIGNALING",
            "STAGE_OUT",
            "STOPPED",
            "SPECIAL_EXIT",
            "RESV_DEL_HOLD",
        ];
        active.contains(&self.state.as_str()) && self.reason != NEVER
    }

    /// Whether it runs.
    #[must_use]
    pub fn is_running(&self) -> bool {
        matches!(self.state.as_str(), "RUNNING" | "COMPLETING" | "SUSPENDED" | "SIGNALING" | "STOPPED")
    }
}

/// Slurm's reason for a task that waits for one that failed.
const NEVER: &str = "DependencyNeverSatisfied";

/// The states of the tasks of job arrays that Slurm knows: by array and index.
///
/// # Errors
/// If Slurm cannot be asked.
pub fn task_states(arrays: &[SlurmArray]) -> Result<BTreeMap<(u64, usize), TaskState>, CliError> {
    if arrays.is_empty() {
        return Ok(BTreeMap::new());
    }
    // All jobs of the user: a list that names an array that Slurm has forgotten is refused.
    let format = ["-h", "-r", "-t", "all", "--me", "-o", "%F|%K|%T|%r"];
    let text = slurm("squeue", &format.map(str::to_owned))?;
    Ok(parsed_states(&text, arrays))
}

fn parsed_states(text: &str, arrays: &[SlurmArray]) -> BTreeMap<(u64, usize), TaskState> {
    let task = |line: &str| {
        let mut fields = line.trim().split('|');
        let (id, index) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
        let (state, reason) = (fields.next()?.to_owned(), fields.next().unwrap_or_default().to_owned());
        arrays.iter().any(|array| array.id == id).then_some(((id, index), TaskState { state, reason }))
    };
    text.lines().filter_map(task).collect()
}

/// Cancels tasks, or whole arrays.
///
/// # Errors
/// If Slurm refuses.
pub fn cancel(tasks: &[String]) -> Result<(), CliError> {
    for some in tasks.chunks(100) {
        slurm("scancel", some)?;
    }
    Ok(())
}

/// The largest array index that Slurm accepts, plus one.
#[must_use]
pub fn array_size() -> usize {
    let config = slurm("scontrol", &["show".to_owned(), "config".to_owned()]).unwrap_or_default();
    let line = config.lines().find_map(|line| line.trim().strip_prefix("MaxArraySize"));
    line.and_then(|line| line.trim_start_matches([' ', '=']).trim().parse().ok()).unwrap_or(ARRAY_SIZE)
}

/// Submits jobs of a step: as many arrays as Slurm's limits need. `after` are tasks and arrays that must have
/// succeeded.
///
/// # Errors
/// If Slurm refuses.
pub fn submit(
    submission: &Submission,
    folder: &Path,
    step: usize,
    jobs: &[usize],
    after: &[String],
    array_size: usize,
) -> Result<Vec<SlurmArray>, CliError> {
    let mut arrays = Vec::new();
    for some in chunks(jobs, array_size) {
        let (first, arguments) = sbatch_arguments(submission, folder, step, &some, after, array_size);
        let text = slurm("sbatch", &arguments)?;
        // `123`, or `123;cluster`.
        let id = text.trim().split(';').next().and_then(|id| id.parse().ok()).ok_or_else(|| {
            let what = format!("sbatch printed `{}` instead of a job's number", text.trim());
            CliError::new(ExitCode::Usage, what)
        })?;
        arrays.push(SlurmArray { step, id, first, jobs: some });
    }
    Ok(arrays)
}

/// The arguments of `sbatch`, and the job with index 0.
#[must_use]
pub fn sbatch_arguments(
    submission: &Submission,
    folder: &Path,
    step: usize,
    jobs: &[usize],
    after: &[String],
    array_size: usize,
) -> (usize, Vec<String>) {
    let first = first_of(jobs, array_size);
    let indexes: Vec<usize> = jobs.iter().map(|job| job - first).collect();
    let mut arguments = vec!["--parsable".to_owned(), format!("--array={}", ranges(&indexes))];
    if first > 0 {
        let log = folder.join(LOGS).join(format!("{}-{first}+%a.log", step + 1));
        arguments.push(format!("--output={}", log.display()));
    }
    let of_user = submission.options.iter().find_map(|option| option.strip_prefix(DEPENDENCY));
    let own = (!after.is_empty()).then(|| format!("afterok:{}", after.join(":")));
    // What the user waits for, the first step waits for, and so do those after it.
    if let Some(dependency) = own.or(of_user.map(str::to_owned)) {
        arguments.push(format!("{DEPENDENCY}{dependency}"));
        arguments.push("--kill-on-invalid-dep=yes".to_owned());
    }
    arguments.extend(submission.options.iter().filter(|option| !option.starts_with(DEPENDENCY)).cloned());
    arguments.push(script_path(folder, step).display().to_string());
    arguments.extend(["array".to_owned(), first.to_string()]);
    (first, arguments)
}

/// The option of `sbatch` that steps and users share.
const DEPENDENCY: &str = "--dependency=";

/// The options of `sbatch` that a submission sets itself.
const OWN_OPTIONS: [&str; 8] = ["--array", "-a", "--output", "-o", "--chdir", "-D", "--wrap", "--parsable"];

/// Why options cannot be passed to `sbatch`; `None` if they can.
#[must_use]
pub fn refused_option(options: &[String]) -> Option<String> {
    let name = |option: &str| option.split('=').next().unwrap_or_default().to_owned();
    if let Some(option) = options.iter().find(|option| OWN_OPTIONS.contains(&name(option).as_str())) {
        return Some(format!("`{option}` is set by depthloom for every step"));
    }
    let unjoined = options.iter().find(|option| ["-d", "--dependency"].contains(&option.as_str()));
    unjoined.map(|option| format!("`{option}`: write `{DEPENDENCY}...` as one word"))
}

/// The job with index 0 of an array: 0 where Slurm accepts the numbers of the jobs as indexes.
fn first_of(jobs: &[usize], array_size: usize) -> usize {
    jobs.first().map_or(0, |job| job / array_size.max(1) * array_size)
}

/// Divides jobs into arrays whose indexes Slurm accepts: those below the limit, then as many, and so on.
fn chunks(jobs: &[usize], array_size: usize) -> Vec<Vec<usize>> {
    let mut chunks: Vec<Vec<usize>> = Vec::new();
    let mut length = 0;
    for &job in jobs {
        match chunks.last_mut() {
            Some(last) if job / array_size == last[0] / array_size && length < INDEXES_LENGTH => last.push(job),
            _ => {
                chunks.push(vec![job]);
                length = 0;
            }
        }
        // At most this for a job that does not continue a range.
        length += 7;
    }
    chunks
}

/// `0-3,7`.
fn ranges(indexes: &[usize]) -> String {
    let mut text = String::new();
    let mut at = 0;
    while at < indexes.len() {
        let mut end = at;
        while end + 1 < indexes.len() && indexes[end + 1] == indexes[end] + 1 {
            end += 1;
        }
        let separator = if text.is_empty() { "" } else { "," };
        let _ = match end - at {
            0 => write!(text, "{separator}{}", indexes[at]),
            _ => write!(text, "{separator}{}-{}", indexes[at], indexes[end]),
        };
        at = end + 1;
    }
    text
}

/// The script of a step.
#[must_use]
pub fn script_path(folder: &Path, step: usize) -> std::path::PathBuf {
    folder.join(format!("step-{}.sh", step + 1))
}

/// How a script calls depthloom.
#[derive(Clone, Debug)]
pub struct JobCommand {
    /// Lines before the command.
    pub setup: Vec<String>,
    /// The command, without the job.
    pub command: String,
    /// The cores of each job.
    pub cores: Option<u16>,
    /// By step, what its jobs request. Empty: nothing.
    pub requests: Vec<JobRequest>,
}

/// What a job requests from the scheduler.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct JobRequest {
    /// Wall-clock time, minutes.
    pub minutes: Option<u64>,
    /// Memory, MB.
    pub memory_mb: Option<u64>,
}

/// The script of a step: a job array of Slurm, which other schedulers can run with an index as its argument.
#[must_use]
pub fn script(submission: &Submission, folder: &Path, step: usize, command: &JobCommand) -> String {
    let JobCommand { setup, command, cores, requests } = command;
    let JobRequest { minutes, memory_mb } = requests.get(step).copied().unwrap_or_default();
    let name = format!("{}-{}", submission.experiment, submission.steps[step].name);
    let log = folder.join(LOGS).join(format!("{}-%a.log", step + 1));
    let mut text = String::from("#!/bin/sh\n");
    let mut option = |text_of: &str| {
        let _ = writeln!(text, "#SBATCH {text_of}");
    };
    option(&format!("--job-name={}", quoted(&name)));
    option(&format!("--output={}", quoted(&log.display().to_string())));
    option("--open-mode=append");
    option(&format!("--chdir={}", quoted(&submission.directory.display().to_string())));
    if let Some(cores) = cores {
        option(&format!("--cpus-per-task={cores}"));
    }
    if let Some(minutes) = minutes {
        option(&format!("--time={minutes}"));
    }
    if let Some(memory) = memory_mb {
        option(&format!("--mem={memory}M"));
    }
    option("--requeue");
    // A minute before its time limit, and before it is preempted, the job stores what it has.
    option("--signal=B:TERM@60");
    let _ = write!(
        text,
        "
# The job of the step: the index of Slurm, PBS, LSF or Grid Engine, or the argument of this script; counted
# from 0. A second argument is added to it.
index=${{SLURM_ARRAY_TASK_ID:-${{PBS_ARRAY_INDEX:-${{1:-}}}}}}
if [ -z \"$index\" ]; then
  # Arrays of LSF and Grid Engine count from 1.
  number=${{LSB_JOBINDEX:-${{SGE_TASK_ID:-}}}}
  [ -n \"$number\" ] || {{ echo \"usage: $0 JOB, from 0 to {}\" >&2; exit 2; }}
  index=$(( number - 1 ))
fi
cd {} || exit 1
{}exec {command} --step {} --job $(( index + ${{2:-0}} ))
",
        submission.steps[step].jobs() - 1,
        shell_quoted(&submission.directory.display().to_string()),
        setup.iter().map(|line| format!("{line}\n")).collect::<String>(),
        step + 1
    );
    text
}

/// For a line of `#SBATCH`.
fn quoted(text: &str) -> String {
    if text.chars().all(|c| !c.is_whitespace() && c != '"') {
        text.to_owned()
    } else {
        format!("\"{}\"", text.replace('"', "\\\""))
    }
}

/// One word for a shell.
#[must_use]
pub fn shell_quoted(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=+:,@%".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    }
}

impl SlurmArray {
    /// The job of an index in the array.
    #[must_use]
    pub fn job(&self, index: usize) -> JobId {
        JobId { step: self.step, job: self.first + index }
    }

    /// The name of a job's task: `123_4`.
    #[must_use]
    pub fn task(&self, job: usize) -> String {
        format!("{}_{}", self.id, job - self.first)
    }
}

#[cfg(test)]
mod tests {
    use super::{SlurmArray, chunks, first_of, parsed_states, ranges, shell_quoted};

    #[test]
    fn indexes_are_written_as_ranges() {
        assert_eq!(ranges(&[0, 1, 2, 3, 7, 9, 10]), "0-3,7,9-10");
        assert_eq!(ranges(&[5]), "5");
    }

    #[test]
    fn arrays_stay_within_the_largest_index() {
        assert_eq!(chunks(&[0, 1, 2, 3, 4], 2), [vec![0, 1], vec![2, 3], vec![4]]);
        assert_eq!(chunks(&[3, 900, 1100], 1001), [vec![3, 900], vec![1100]]);
        assert_eq!([first_of(&[3, 900], 1001), first_of(&[1100], 1001)], [0, 1001]);
        let many: Vec<usize> = (0..5000).collect();
        let arrays = chunks(&many, 1001);
        assert_eq!(arrays.iter().flatten().copied().collect::<Vec<_>>(), many);
        assert!(arrays.iter().all(|array| array[array.len() - 1] - first_of(array, 1001) < 1001));
    }

    #[test]
    fn states_of_other_jobs_are_left_out() {
        let arrays = [SlurmArray { step: 0, id: 12, first: 0, jobs: vec![0, 1, 2] }];
        let text = "12|0|RUNNING|None\n12|1|PENDING|DependencyNeverSatisfied\n12|2|TIMEOUT|TimeLimit\n13|0|RUNNING|None\n14|N/A|RUNNING|None\n";
        let states = parsed_states(text, &arrays);
        let active: Vec<bool> = states.values().map(super::TaskState::is_active).collect();
        assert_eq!(active, [true, false, false]);
    }

    #[test]
    fn words_for_a_shell() {
        for (text, word) in [("runs/a", "runs/a"), ("it's", "'it'\\''s'"), ("a b", "'a b'"), ("", "''")] {
            assert_eq!(shell_quoted(text), word);
        }
    }
}
