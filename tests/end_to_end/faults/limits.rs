//! Faults of what the system refuses: descriptors, threads, memory, room on a disk, rights.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use super::small::{look, partial, run, said, under};
use crate::support::{depthloom, full, succeed, workspace};

/// A run under limits of the system: ended by itself, and not by a guard against hanging.
fn limited(limit: &str, frames: &str, out: &Path) -> Output {
    let mut command = under("timeout", &["300", "prlimit", limit]);
    look(&mut command, frames, out);
    let output = command.output().expect("it starts");
    assert_ne!(output.status.code(), Some(124), "it hangs: {}", said(&output));
    output
}

#[test]
fn fault_43_few_descriptors_end_a_run_with_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    for limit in 4..=24 {
        let out = folder.path().join(limit.to_string());
        let output = limited(&format!("--nofile={limit}"), "0..2", &out);
        let told = said(&output);
        assert!(matches!(output.status.code(), Some(0 | 1 | 2 | 127)), "{limit}: {:?} {told}", output.status);
        assert_eq!(out.exists(), output.status.code() == Some(0), "{limit}: {told}");
        if limit < 5 || output.status.code() == Some(127) {
            // Before the program's own first word the system's loader may have the last.
            continue;
        }
        if output.status.code() != Some(0) {
            assert!(told.contains("Too many open files") && told.contains("`ulimit -n`"), "{limit}: {told}");
            assert!(!told.contains("panicked"), "{limit}: {told}");
            let error = told.lines().find(|line| line.starts_with("error")).expect("an error");
            assert!(error.matches("failed to write").count() <= 1, "{limit}: {told}");
        }
        // What stays is known as a run's, and the next one may have its name.
        if partial(&out).exists() {
            assert!(partial(&out).join("depthloom-run.json").is_file(), "{limit}: {told}");
        }
    }
}

#[test]
fn fault_43_few_threads_end_a_run_with_an_error() {
    let name = "fault_43_few_threads_end_a_run_with_an_error";
    let folder = tempfile::tempdir().expect("a folder");
    let open = |path: &Path| succeed(Command::new("chmod").arg("777").arg(path));
    open(folder.path());
    // The limit counts a user's threads, and does not count for root.
    let as_nobody = ["300", "setpriv", "--reuid=65534", "--clear-groups"];
    let version = under("timeout", &as_nobody).arg("--version").output().expect("it starts");
    if !version.status.success() {
        return crate::support::skipped(name, "needs root and setpriv, and a binary that others may read");
    }
    for limit in 1..=12 {
        let out = folder.path().join(limit.to_string());
        let limited = format!("--nproc={limit}");
        let mut command = under("timeout", &[&as_nobody[..], &["prlimit", &limited]].concat());
        look(&mut command, "0..2", &out);
        let output = command.output().expect("it starts");
        let told = said(&output);
        assert!(matches!(output.status.code(), Some(0 | 1)), "{limit}: {:?} {told}", output.status);
        assert_eq!(out.exists(), output.status.code() == Some(0), "{limit}: {told}");
    }
}

#[test]
fn a_run_that_is_not_whole_yet_is_named_to_who_asks_for_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let output = limited("--fsize=1500000", "0..100", &out);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    for (command, path) in [("report", out.clone()), ("report", out.join("recording.mcap")), ("timings", out.clone())] {
        let asked = depthloom().arg(command).arg(&path).output().expect("the binary starts");
        assert_eq!(asked.status.code(), Some(2), "{}", said(&asked));
        let reads = format!("`depthloom {command} {}` reads its complete frames", partial(&out).display());
        let there = command == "report" || partial(&out).join("timings.parquet").is_file();
        assert_eq!(said(&asked).contains(&reads), there, "{}", said(&asked));
    }
    succeed(depthloom().arg("report").arg(partial(&out)));
}

#[cfg(target_os = "linux")]
#[test]
fn where_nothing_can_be_written_the_remedy_is_another_folder() {
    let name = "where_nothing_can_be_written_the_remedy_is_another_folder";
    let folder = tempfile::tempdir().expect("a folder");
    let open = |path: &Path, mode: &str| succeed(Command::new("chmod").arg(mode).arg(path));
    open(folder.path(), "755");
    let as_nobody = ["--reuid=65534", "--clear-groups"];
    let version = under("setpriv", &as_nobody).arg("--version").output();
    if !version.is_ok_and(|version| version.status.success()) {
        return crate::support::skipped(name, "needs root and setpriv, and a binary that others may read");
    }
    let mut command = under("setpriv", &as_nobody);
    command.current_dir(folder.path()).args(["run", "--no-page"]).arg(workspace().join("experiments/first-look.yaml"));
    let refused = command.output().expect("it starts");
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert!(said(&refused).contains("may be written with --out"), "{}", said(&refused));
    // A report of what somebody else has.
    let out = folder.path().join("run");
    assert_eq!(run("0..2", &out, &[]).status.code(), Some(0));
    let refused = under("setpriv", &as_nobody).arg("report").arg(&out).output().expect("it starts");
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert!(said(&refused).contains("may be written with --out"), "{}", said(&refused));
    // What may not even be looked at is not said to be missing.
    open(&out, "700");
    let refused = under("setpriv", &as_nobody).arg("report").arg(&out).output().expect("it starts");
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert!(said(&refused).contains("Permission denied"), "{}", said(&refused));
}

#[test]
fn fault_50_a_full_disk_is_named_first_and_what_was_written_can_be_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    // A write beyond the limit of file sizes fails as one on a full disk does.
    let output = limited("--fsize=1500000", "0..100", &out);
    let told = said(&output);
    assert_eq!(output.status.code(), Some(1), "{told}");
    let error = told.lines().find(|line| line.starts_with("error")).expect("an error");
    assert!(error.contains("recording.mcap") && error.contains("failed to record frame"), "{told}");
    assert!(told.contains("frames can be read from") && !out.exists(), "{told}");
    for entry in fs::read_dir(partial(&out)).expect("a folder").flatten() {
        assert!(entry.metadata().expect("a file").len() > 0, "{} is empty", entry.path().display());
        let name = entry.file_name().into_string().expect("UTF-8");
        assert!(!name.ends_with(".new") && !name.ends_with(".partial"), "{name} stays");
    }
    succeed(depthloom().arg("report").arg(partial(&out)));
    // No room for anything at all: then nothing stays.
    let out = folder.path().join("none");
    let output = limited("--fsize=1", "0..2", &out);
    assert!(matches!(output.status.code(), Some(1 | 2)), "{}", said(&output));
    assert!(!out.exists() && !partial(&out).exists(), "{}", said(&output));
}

#[cfg(target_os = "linux")]
#[test]
fn fault_12_memory_that_the_system_refuses_is_an_error_not_an_abort() {
    if !full("fault_12_memory_that_the_system_refuses_is_an_error_not_an_abort") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let run = |kib: u64| {
        let out = folder.path().join(kib.to_string());
        let mut command = under("prlimit", &[&format!("--as={}", kib << 10)]);
        look(&mut command, "0..2", &out);
        command.output().expect("prlimit is there")
    };
    // The least address space it takes, nearly.
    let (mut too_little, mut enough) = (0, 8 << 20);
    while enough - too_little > 1 << 10 {
        let middle = u64::midpoint(too_little, enough);
        if run(middle).status.success() { enough = middle } else { too_little = middle }
    }
    // Where memory ends differs from moment to moment: just below it, it ends anywhere.
    for step in 1..=40 {
        let output = run(too_little - step * 512);
        let said = said(&output);
        // Where the C library itself has no room for a thread's bookkeeping it ends the program, and nobody is asked.
        let of_the_system = ["Fatal glibc error", "cannot allocate memory for thread-local data"];
        // And the standard library, for the stack on which a thread that begins would tell of an overflow.
        let of_std = "failed to allocate an alternative stack";
        if of_the_system.into_iter().chain([of_std]).any(|own| said.contains(own)) {
            continue;
        }
        assert!(output.status.code().is_some(), "{} KiB below: {}\n{said}", step * 512, output.status);
        assert!(!said.contains("memory allocation of") && !said.contains("panicked"), "{said}");
        assert!(output.status.success() || !said.is_empty(), "{output:?}");
    }
}
