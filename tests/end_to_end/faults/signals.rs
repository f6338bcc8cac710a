//! Faults in the handling of signals, and of closed or full streams.

use std::fs;
use std::process::Stdio;

use super::small::{look, partial, recorded, send, start_long, stderr_of, street, under, wait};
use crate::support::{depthloom, succeed};

#[test]
fn fault_03_a_closed_or_full_stderr_does_not_fail_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let (reader, closed) = std::io::pipe().expect("a pipe");
    drop(reader);
    let full = fs::File::options().write(true).open("/dev/full").expect("a device that is full");
    for (name, stderr) in [("closed", Stdio::from(closed)), ("full", Stdio::from(full))] {
        let out = folder.path().join(name);
        let mut command = depthloom();
        look(&mut command, "0..4", &out);
        let ended = command.stdout(Stdio::null()).stderr(stderr).status().expect("the binary starts");
        assert_eq!(ended.code(), Some(0), "{name}");
        assert!(out.join("table.csv").is_file(), "{name}");
    }
}

#[test]
fn fault_03_a_closed_or_full_stdout_does_not_lose_results() {
    let folder = tempfile::tempdir().expect("a folder");
    let (reader, closed) = std::io::pipe().expect("a pipe");
    drop(reader);
    let full = fs::File::options().write(true).open("/dev/full").expect("a device that is full");
    for (name, stdout, code) in [("closed", Stdio::from(closed), 0), ("full", Stdio::from(full), 1)] {
        let out = folder.path().join(name);
        let mut command = depthloom();
        look(&mut command, "0..4", &out);
        let child = command.stdout(stdout).stderr(Stdio::piped()).spawn().expect("the binary starts");
        let output = child.wait_with_output().expect("ended");
        assert_eq!(output.status.code(), Some(code), "{name}: {}", stderr_of(&output));
        assert!(out.join("table.csv").is_file(), "{name}");
        assert_eq!(
            stderr_of(&output).contains(&format!("the run is complete in {}", out.display())),
            code == 1,
            "{name}"
        );
    }
    let full = fs::File::options().write(true).open("/dev/full").expect("a device that is full");
    let help = depthloom().arg("--help").stdout(full).status().expect("the binary starts");
    assert_eq!(help.code(), Some(1), "the help could not be printed");
}

#[test]
fn fault_04_signals_that_were_ignored_stay_ignored() {
    let folder = tempfile::tempdir().expect("a folder");
    for signal in ["HUP", "INT", "TERM"] {
        let out = folder.path().join(signal);
        let ignoring = format!("trap '' {signal}; exec \"$0\" \"$@\"");
        let mut child = start_long(&mut under("sh", &["-c", &ignoring]), &out);
        send(signal, &child);
        let before = recorded(&out);
        // More bytes than all frames in flight.
        wait(&mut child, || recorded(&out) > before + 3_000_000);
        child.kill().expect("killed");
        child.wait().expect("ended");
    }
}

#[test]
fn a_hangup_signal_interrupts_a_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let mut child = start_long(&mut depthloom(), &out);
    send("HUP", &child);
    assert_eq!(child.wait().expect("ended").code(), Some(130));
    succeed(depthloom().arg("report").arg(partial(&out)));
}

#[test]
fn fault_18_27_the_first_signal_ends_training_at_a_checkpoint() {
    let folder = tempfile::tempdir().expect("a folder");
    // More steps than are trained until the signal arrives.
    let experiment = street(folder.path(), 5_000);
    for signal in ["INT", "TERM"] {
        // Separate folders of checkpoints, so that the second run does not see those of the first.
        let home = folder.path().join(signal);
        fs::create_dir(&home).expect("a folder");
        let (out, checkpoints) = (home.join("run"), home.join("checkpoints"));
        let is_checkpoint = |file: fs::DirEntry| file.path().extension().is_some_and(|ending| ending == "checkpoint");
        let mut command = depthloom();
        command.args(["run", "--no-page"]).arg(&experiment).args(["--workers", "2", "--out"]).arg(&out);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the binary starts");
        wait(&mut child, || fs::read_dir(&checkpoints).is_ok_and(|files| files.flatten().any(is_checkpoint)));
        send(signal, &child);
        let output = child.wait_with_output().expect("ended");
        assert_eq!(output.status.code(), Some(130), "{}", stderr_of(&output));
        let stderr = stderr_of(&output);
        assert!(stderr.contains("4 frames can be read from"), "{stderr}");
        // The guide repeats this remedy.
        let remedy = "repeat the command with the same --out to resume: after these frames, training from";
        assert!(stderr.split_whitespace().collect::<Vec<_>>().join(" ").contains(remedy), "{stderr}");
        assert!(fs::read_dir(&checkpoints).expect("a folder").next().is_some(), "the checkpoint is gone");
        succeed(depthloom().arg("report").arg(partial(&out)));
    }
}

#[test]
fn fault_47_a_signal_during_the_analysis_ends_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let mut command = depthloom();
    look(&mut command, "0..60", &out);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the binary starts");
    // The analysis writes this file first; afterwards it reads the maps of all frames.
    wait(&mut child, || partial(&out).join("table.csv").exists());
    send("TERM", &child);
    let output = child.wait_with_output().expect("ended");
    assert_eq!(output.status.code(), Some(130), "{}", stderr_of(&output));
    assert!(stderr_of(&output).contains("the recording is complete"), "{}", stderr_of(&output));
    assert!(!out.exists());
    let files = fs::read_dir(partial(&out)).expect("a folder").flatten();
    let hidden: Vec<_> =
        files.map(|e| e.file_name()).filter(|name| name.as_encoded_bytes().starts_with(b".")).collect();
    assert!(hidden.is_empty(), "{hidden:?} were not removed");
    succeed(depthloom().arg("report").arg(partial(&out)));
}
