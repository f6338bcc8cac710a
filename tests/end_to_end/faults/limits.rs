//! Faults under limits of the system: descriptors, threads, memory, disk space, permissions.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use super::small::{look, partial, run, stderr_of, under};
use crate::support::{depthloom, full, succeed, workspace};

/// Runs under a limit of the system. Panics if the run hangs.
fn limited(limit: &str, frames: &str, out: &Path) -> Output {
    let mut command = under("timeout", &["300", "prlimit", limit]);
    look(&mut command, frames, out);
    let output = command.output().expect("it starts");
    assert_ne!(output.status.code(), Some(124), "it hangs: {}", stderr_of(&output));
    output
}

#[test]
fn fault_43_few_descriptors_end_a_run_with_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    for limit in 4..=24 {
        let out = folder.path().join(limit.to_string());
        let output = limited(&format!("--nofile={limit}"), "0..2", &out);
        let stderr = stderr_of(&output);
        assert!(matches!(output.status.code(), Some(0 | 1 | 2 | 127)), "{limit}: {:?} {stderr}", output.status);
        assert_eq!(out.exists(), output.status.code() == Some(0), "{limit}: {stderr}");
        if limit < 5 || output.status.code() == Some(127) {
            // The system's loader may fail before the program starts.
            continue;
        }
        if output.status.code() != Some(0) {
            assert!(stderr.contains("Too many open files") && stderr.contains("`ulimit -n`"), "{limit}: {stderr}");
            assert!(!stderr.contains("panicked"), "{limit}: {stderr}");
            let error = stderr.lines().find(|line| line.starts_with("error")).expect("an error");
            assert!(error.matches("failed to write").count() <= 1, "{limit}: {stderr}");
        }
        // The remaining folder is marked as a run's, so the next run may replace it.
        if partial(&out).exists() {
            assert!(partial(&out).join("depthloom-run.json").is_file(), "{limit}: {stderr}");
        }
    }
}

#[test]
fn fault_43_few_threads_end_a_run_with_an_error() {
    let name = "fault_43_few_threads_end_a_run_with_an_error";
    let folder = tempfile::tempdir().expect("a folder");
    let set_mode = |path: &Path| succeed(Command::new("chmod").arg("777").arg(path));
    set_mode(folder.path());
    // The limit counts a user's threads, and does not count for root.
    let as_other_user = ["300", "setpriv", "--reuid=65534", "--clear-groups"];
    let version = under("timeout", &as_other_user).arg("--version").output().expect("it starts");
    if !version.status.success() {
        return crate::support::skipped(name, "needs root and setpriv, and a binary that others may read");
    }
    for limit in 1..=12 {
        let out = folder.path().join(limit.to_string());
        let limited = format!("--nproc={limit}");
        let mut command = under("timeout", &[&as_other_user[..], &["prlimit", &limited]].concat());
        look(&mut command, "0..2", &out);
        let output = command.output().expect("it starts");
        let stderr = stderr_of(&output);
        assert!(matches!(output.status.code(), Some(0 | 1)), "{limit}: {:?} {stderr}", output.status);
        assert_eq!(out.exists(), output.status.code() == Some(0), "{limit}: {stderr}");
    }
}

#[test]
fn commands_on_an_unfinished_run_name_its_partial_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let output = limited("--fsize=1500000", "0..100", &out);
    assert_eq!(output.status.code(), Some(1), "{}", stderr_of(&output));
    for (command, path) in
        [("report", out.clone()), ("report", out.join("recording.mcap")), ("runs timings", out.clone())]
    {
        let output = depthloom().args(command.split(' ')).arg(&path).output().expect("the binary starts");
        assert_eq!(output.status.code(), Some(2), "{}", stderr_of(&output));
        let reads = format!("`depthloom {command} {}` reads its complete frames", partial(&out).display());
        let is_readable = command == "report" || partial(&out).join("timings.parquet").is_file();
        assert_eq!(stderr_of(&output).contains(&reads), is_readable, "{}", stderr_of(&output));
    }
    succeed(depthloom().arg("report").arg(partial(&out)));
}

#[cfg(target_os = "linux")]
#[test]
fn an_unwritable_folder_error_suggests_out() {
    let name = "an_unwritable_folder_error_suggests_out";
    let folder = tempfile::tempdir().expect("a folder");
    let set_mode = |path: &Path, mode: &str| succeed(Command::new("chmod").arg(mode).arg(path));
    set_mode(folder.path(), "755");
    let as_other_user = ["--reuid=65534", "--clear-groups"];
    let version = under("setpriv", &as_other_user).arg("--version").output();
    if !version.is_ok_and(|version| version.status.success()) {
        return crate::support::skipped(name, "needs root and setpriv, and a binary that others may read");
    }
    let mut command = under("setpriv", &as_other_user);
    command.current_dir(folder.path()).args(["run", "--no-page"]).arg(workspace().join("experiments/first-look.yaml"));
    let refused = command.output().expect("it starts");
    assert_eq!(refused.status.code(), Some(1), "{}", stderr_of(&refused));
    assert!(stderr_of(&refused).contains("may be written with --out"), "{}", stderr_of(&refused));
    // A report on a run of another user.
    let out = folder.path().join("run");
    assert_eq!(run("0..2", &out, &[]).status.code(), Some(0));
    let refused = under("setpriv", &as_other_user).arg("report").arg(&out).output().expect("it starts");
    assert_eq!(refused.status.code(), Some(1), "{}", stderr_of(&refused));
    assert!(stderr_of(&refused).contains("may be written with --out"), "{}", stderr_of(&refused));
    // Every command that writes ends with the same code.
    let file = |name: &str| folder.path().join(name).into_os_string().into_string().expect("a path in UTF-8");
    let run_folder = file("run");
    for arguments in [
        vec!["table", &run_folder, "--out", &file("table.csv")],
        vec!["export", &run_folder, "depth", "--out", &file("exported")],
        vec!["new", &file("first.yaml")],
        vec!["synth", &file("street"), "--frames", "1"],
        vec!["runs", "rm", &run_folder],
    ] {
        let refused = under("setpriv", &as_other_user).args(&arguments).output().expect("it starts");
        assert_eq!(refused.status.code(), Some(1), "{arguments:?}: {}", stderr_of(&refused));
        assert!(stderr_of(&refused).contains("help:"), "{arguments:?}: {}", stderr_of(&refused));
    }
    // A folder without read permission is not reported as missing.
    set_mode(&out, "700");
    let refused = under("setpriv", &as_other_user).arg("report").arg(&out).output().expect("it starts");
    assert_eq!(refused.status.code(), Some(2), "{}", stderr_of(&refused));
    assert!(stderr_of(&refused).contains("Permission denied"), "{}", stderr_of(&refused));
}

#[test]
fn fault_50_a_full_disk_is_reported_first_and_written_frames_are_readable() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    // A write beyond the limit of file sizes fails in the same way as one on a full disk.
    let output = limited("--fsize=1500000", "0..100", &out);
    let stderr = stderr_of(&output);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    let error = stderr.lines().find(|line| line.starts_with("error")).expect("an error");
    assert!(error.contains("recording.mcap") && error.contains("failed to record frame"), "{stderr}");
    assert!(stderr.contains("frames can be read from") && !out.exists(), "{stderr}");
    for entry in fs::read_dir(partial(&out)).expect("a folder").flatten() {
        assert!(entry.metadata().expect("a file").len() > 0, "{} is empty", entry.path().display());
        let name = entry.file_name().into_string().expect("UTF-8");
        assert!(!name.ends_with(".new") && !name.ends_with(".partial"), "{name} was not removed");
    }
    succeed(depthloom().arg("report").arg(partial(&out)));
    // Without any space, no folder remains.
    let out = folder.path().join("none");
    let output = limited("--fsize=1", "0..2", &out);
    assert!(matches!(output.status.code(), Some(1 | 2)), "{}", stderr_of(&output));
    assert!(!out.exists() && !partial(&out).exists(), "{}", stderr_of(&output));
}

#[cfg(target_os = "linux")]
#[test]
fn fault_12_refused_memory_is_an_error_not_an_abort() {
    if !full("fault_12_refused_memory_is_an_error_not_an_abort") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let limited = |kib: u64| under("prlimit", &[&format!("--as={}", kib << 10)]);
    let run = |kib: u64| {
        let out = folder.path().join(kib.to_string());
        let mut command = limited(kib);
        look(&mut command, "0..2", &out);
        command.output().expect("prlimit")
    };
    // The kernel ends a program that it cannot load with SIGSEGV.
    let is_loaded = |kib: u64| limited(kib).arg("--version").output().expect("prlimit").status.code().is_some();
    // The smallest sufficient address space, to 1 MiB.
    let (mut too_little, mut enough) = (0, 8 << 20);
    while enough - too_little > 1 << 10 {
        let middle = u64::midpoint(too_little, enough);
        if run(middle).status.success() { enough = middle } else { too_little = middle }
    }
    // Just below that size, allocations fail at places that vary from run to run.
    for step in 1..=40 {
        let kib = too_little - step * 512;
        let output = run(kib);
        if output.status.code().is_none() && !is_loaded(kib) {
            continue;
        }
        let stderr = stderr_of(&output);
        // The C library ends the program if it cannot allocate a thread's bookkeeping.
        let from_system = ["Fatal glibc error", "cannot allocate memory for thread-local data"];
        // The standard library does the same for a new thread's stack for reporting overflows.
        let from_std = "failed to allocate an alternative stack";
        if from_system.into_iter().chain([from_std]).any(|message| stderr.contains(message)) {
            continue;
        }
        assert!(output.status.code().is_some(), "{} KiB below: {}\n{stderr}", step * 512, output.status);
        assert!(!stderr.contains("memory allocation of") && !stderr.contains("panicked"), "{stderr}");
        assert!(output.status.success() || !stderr.is_empty(), "{output:?}");
    }
}
