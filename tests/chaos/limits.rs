//! Too little of something: memory, threads, descriptors, file size, disk.
//!
//! The whole answer, or an error with a message, and then what is left is readable and the same run begun again, with
//! enough, ends with the same bytes. A file that grows too large may also end the program by the system's own signal
//! (XFSZ).

use std::ffi::OsString;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::answer::Answer;
use crate::case::Case;
use crate::child::{Ended, program};
use crate::ground::{REPORT, RUN};
use crate::left::{begin_again, look};
use crate::verdict::{Verdict, judge};

/// A file grew beyond its limit.
const XFSZ: i32 = 25;
/// Users that own nothing else on this machine: threads are counted by user, cases run side by side.
const USERS: std::ops::Range<u64> = 61_000..63_000;

pub(crate) fn memory(case: &mut Case<'_>) -> Verdict {
    // From where the program itself just fits, in steps that grow.
    let least = case.ground.least_memory();
    let limit = least + (1 << case.random.within(16..32)) + case.random.within(0..1 << 20);
    limited(case, &[format!("--as={limit}")])
}

pub(crate) fn descriptors(case: &mut Case<'_>) -> Verdict {
    let limit = case.random.within(3..40);
    limited(case, &[format!("--nofile={limit}")])
}

pub(crate) fn file_size(case: &mut Case<'_>) -> Verdict {
    let largest = case.ground.street().recording.len() as u64;
    let limit = case.random.within(0..largest + largest / 8);
    if case.random.chance(3) {
        return limited(case, &[format!("--fsize={limit}")]);
    }
    // Without the signal, a write is refused.
    let ignoring = ["sh", "-c", "trap '' XFSZ; exec \"$0\" \"$@\""].map(str::to_owned);
    let [sh, option, script] = ignoring;
    limited(case, &[format!("--fsize={limit}"), sh, option, script])
}

pub(crate) fn threads(case: &mut Case<'_>) -> Verdict {
    if !is_root() {
        return Verdict::Skipped("only root may become a user without other threads".to_owned());
    }
    if program("setpriv").is_none() {
        return Verdict::Skipped("this machine has no `setpriv`".to_owned());
    }
    let user = case.random.within(USERS);
    let limit = case.random.within(1..24);
    fs::set_permissions(&case.folder, fs::Permissions::from_mode(0o777)).expect("the case's own folder");
    let becoming = ["setpriv", "--clear-groups"].map(str::to_owned);
    let user = [format!("--reuid={user}"), format!("--regid={user}")];
    let by: Vec<String> = [format!("--nproc={limit}")].into_iter().chain(becoming).chain(user).collect();
    if !case.ground.can_be_started_by_others() {
        return Verdict::Skipped("other users cannot reach the program's file".to_owned());
    }
    limited(case, &by)
}

/// Runs one of the commands under `prlimit`.
fn limited(case: &mut Case<'_>, limits: &[String]) -> Verdict {
    if program("prlimit").is_none() {
        return Verdict::Skipped("this machine has no `prlimit`".to_owned());
    }
    let by: Vec<String> = ["prlimit".to_owned()].into_iter().chain(limits.iter().cloned()).collect();
    match case.random.below(4) {
        0 => report(case, &by),
        1 => check(case, &by),
        2 => run(case, &by, true),
        _ => run(case, &by, false),
    }
}

fn run(case: &mut Case<'_>, by: &[String], learning: bool) -> Verdict {
    let reference = if learning { case.ground.learn() } else { case.ground.street() };
    case.write("experiment.yaml", reference.experiment);
    let ended = case.run(&mut case.depthloom_by(by, &RUN));
    if let Some(verdict) = not_started(&ended) {
        return verdict;
    }
    let verdict = look(case, reference, &ended, &[XFSZ]);
    begin_again(case, reference, verdict)
}

fn report(case: &mut Case<'_>, by: &[String]) -> Verdict {
    let reference = case.ground.street();
    case.write("recording.mcap", &reference.recording);
    let ended = case.run(&mut case.depthloom_by(by, &REPORT));
    if let Some(verdict) = not_started(&ended) {
        return verdict;
    }
    judge(&ended, || match reference.report.difference(&Answer::new(&ended, &case.at("out"))) {
        None => Verdict::Equal,
        Some(difference) => Verdict::Different(difference),
    })
}

fn check(case: &mut Case<'_>, by: &[String]) -> Verdict {
    case.write("experiment.yaml", case.ground.street().experiment);
    let command = case.random.pick(&["check", "plan", "graph"]);
    let whole = case.run(&mut case.depthloom(&[command, "experiment.yaml"]));
    let ended = case.run(&mut case.depthloom_by(by, &[command, "experiment.yaml"]));
    if let Some(verdict) = not_started(&ended) {
        return verdict;
    }
    judge(&ended, || match ended.stdout == whole.stdout {
        true => Verdict::Equal,
        false => Verdict::different("what was printed differs"),
    })
}

/// Where not even the system's loader or shell had enough, or the file size ended the program, there is nothing of ours
/// to judge.
fn not_started(ended: &Ended) -> Option<Verdict> {
    let by_others = ["error while loading shared libraries", "prlimit:", "setpriv:", "sh: "];
    let others = by_others.iter().any(|text| ended.stderr.contains(text));
    (others || ended.signal == Some(XFSZ)).then_some(Verdict::Error).filter(|_| !ended.succeeded() && !ended.hung)
}

/// A disk that fills during the run, and has room again when it is begun again.
pub(crate) fn disk(case: &mut Case<'_>) -> Verdict {
    if !is_root() {
        return Verdict::Skipped("only root may mount a small disk".to_owned());
    }
    let learning = case.random.chance(3);
    let reference = if learning { case.ground.learn() } else { case.ground.street() };
    let kib = case.random.within(8..reference.recording.len() as u64 / 1024 * 2);
    let Some(_disk) = Disk::mount(&case.folder, kib) else {
        return Verdict::Skipped("no small disk can be mounted here".to_owned());
    };
    case.note(format!("a disk of {kib} KiB"));
    case.write("experiment.yaml", reference.experiment);
    let ended = case.run(&mut case.depthloom(&RUN));
    let verdict = look(case, reference, &ended, &[]);
    if !matches!(verdict, Verdict::Error | Verdict::Said) {
        return verdict;
    }
    let more = mount(&["-o", "remount,size=64m"], &case.folder);
    assert!(more, "a mounted disk can be made larger");
    begin_again(case, reference, verdict)
}

/// A file system in memory over a folder.
struct Disk(PathBuf);

impl Disk {
    fn mount(folder: &Path, kib: u64) -> Option<Self> {
        let size = format!("size={kib}k");
        let mounted = mount(&["-t", "tmpfs", "-o", &size, "none"], folder);
        mounted.then(|| Self(folder.to_owned()))
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // What cannot be given back now goes with the machine; the case's folder then stays.
        let _ = Command::new("umount").arg("--lazy").arg(&self.0).output();
    }
}

fn mount(arguments: &[&str], folder: &Path) -> bool {
    let mut command = Command::new("mount");
    command.args(arguments).arg(OsString::from(folder));
    command.output().is_ok_and(|output| output.status.success())
}

fn is_root() -> bool {
    fs::read_to_string("/proc/self/status").is_ok_and(|status| {
        status
            .lines()
            .find_map(|line| line.strip_prefix("Uid:"))
            .is_some_and(|ids| ids.split_whitespace().nth(1) == Some("0"))
    })
}
