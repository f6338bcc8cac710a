//! Faults of processes: each yields a clear error with node and frame, leaves no process, does not hang, and leaves a
//! readable recording.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use super::{Peer, output_of, processes, run, until};
use crate::support::{depthloom, succeed, system_python};

/// Modes of the script, and a part of the expected message.
const FAULTS: [(&str, &str); 66] = [
    // Before the process is ready.
    (
        "exits-at-once",
        "did not start: it exited, or closed its standard output, before its first message; it ended with exit code 3",
    ),
    ("exits-silently", "it ended with exit code 0; its standard error is empty"),
    ("kills-itself-at-start", "it was killed by signal 9"),
    ("prints-text", "it is not an Arrow stream: it begins with \"load\" instead of a message"),
    ("prints-zeros", "it is not an Arrow stream"),
    ("prints-three-bytes", "the stream ended within a message"),
    ("hangs-at-start", "was not ready within 2 s, and was ended"),
    ("ready-never", "was not ready within 2 s, and was ended"),
    ("closes-stdout-at-start", "before its first message"),
    ("no-protocol", "the metadata of its schema lack `depthloom.protocol`"),
    ("other-protocol", "it speaks version 2 of the protocol, and this is version 1"),
    ("no-says", "its schema has no column `says`"),
    ("cut-schema", "the stream ended within a message"),
    ("batch-before-schema", "a record batch came instead of a schema"),
    ("huge-head", "the description of a message is 2147483647 bytes long"),
    ("random-head", "its message violates the protocol"),
    ("huge-body", "a message states 1099511627776 bytes of values"),
    ("negative-body", "a message states -1 bytes of values"),
    ("values-before-ready", "sent values before `ready`"),
    ("ready-of-another-call", "replied to call 5 instead of call 0"),
    ("fails-at-start", "failed when it was started: ImportError: no torch line 3, in load"),
    ("raises", "KeyError: 'weights'"),
    ("floods-stderr-and-exits", "the end of its standard error: no weights"),
    ("floods-stdout", "it begins with \"xxxx\" instead of a message"),
    // During a call.
    ("exits-within-a-call", "gave no answer: it exited, or closed its standard output; it ended with exit code 4"),
    ("exits", "it ended with exit code 7; its standard error: the model is gone"),
    ("segfaults", "it was killed by signal 11"),
    ("ends-between-calls", "it ended with exit code 0"),
    ("hangs", "did not answer within 2 s, and was ended"),
    ("ignores-sigterm", "did not answer within 2 s, and was ended"),
    ("forks-and-hangs", "did not answer within 2 s, and was ended"),
    ("forks-and-exits", "it ended with exit code 1"),
    ("stops-itself", "did not answer within 2 s, and was ended"),
    ("stops-its-group", "did not answer within 2 s, and was ended"),
    ("kills-its-group", "it was killed by signal 9"),
    ("closes-stdout", "gave no answer: it exited, or closed its standard output"),
    ("closes-stdin", "did not answer within 2 s, and was ended"),
    ("reads-nothing", "did not answer within 2 s, and was ended"),
    ("ends-the-stream", "gave no answer: it exited, or closed its standard output"),
    ("half-a-batch-and-exits", "the stream ended within a message"),
    ("half-a-batch-and-hangs", "did not answer within 2 s, and was ended"),
    ("longer-than-it-says", "lie outside of the batch"),
    ("shorter-than-it-says", "did not answer within 2 s, and was ended"),
    ("floods-stderr-and-hangs", "the end of its standard error: still here"),
    ("tells-a-failure", "failed: ValueError: too dark line 7, in fuse"),
    // Invalid replies.
    ("wrong-type", "`data` is of type list<float64>, expected list<float32>"),
    ("too-few-samples", "its value at `depth` is not a valid depth: it has 2047 samples, which is not 64x32 pixels"),
    ("no-samples", "it has 0 samples, which is not 64x32 pixels"),
    ("negative-width", "its `width` is -64"),
    ("zero-width", "its `width` is 0"),
    ("giant-width", "which is not 2147483647x2147483647 pixels"),
    ("no-output", "gave no value at `depth`"),
    ("two-rows", "a batch has 2 rows, and 1 is what a call has"),
    ("no-rows", "a batch has 0 rows"),
    ("unknown-word", "it says `perhaps`, which is not a message of the protocol"),
    ("says-nothing", "a reply has no value in the column `says`"),
    ("another-number", "replied to call 2 instead of call 1"),
    ("ready-again", "sent `ready` instead of a reply"),
    ("a-schema-again", "a schema came instead of a record batch"),
    ("negative-depth", "returned an invalid depth at port `depth`: -5.0 m at row 2, column 5: a depth must be finite"),
    ("infinite-depth", "returned an invalid depth at port `depth`: inf m at row 31, column 63: a depth must be finite"),
    ("zero-depth", "0.0 m at row 0, column 0 (2048 of 2048 pixels are invalid): a depth must be finite"),
    ("offsets-lead-out", "the offsets of `data` lead out of its values"),
    // Shared memory.
    ("shared-wrong-word", "its reply refers to shared memory, but it was given none"),
    ("shared-not-agreed", "its reply refers to shared memory, but it was given none"),
    ("shared-not-given", "its reply refers to shared memory, but it was given none"),
];

/// Faults in later frames, or without a reply.
const LATER: [(&str, &str, &str); 16] = [
    ("answers-twice", "replied to call 1 instead of call 2", "000001_10"),
    ("answers-and-floods", "replied to call 9 instead of call 1", "000000_10"),
    ("offsets-go-back", "the offsets of `data` lead out of its values", "000000_10"),
    ("no-utf-8", "`says` is not UTF-8", "000000_10"),
    ("frames-instead", "a reply with frames lacks the column `frames`", "000000_10"),
    ("shared-nowhere", "the row in shared memory is not of the protocol: there is no row", "000001_10"),
    ("shared-beyond", "it states a row of 1099511627776 bytes of shared memory, which has 1048576", "000001_10"),
    ("shared-before", "it states a row of -1 bytes of shared memory", "000001_10"),
    ("shared-nothing-there", "it is not an Arrow stream", "000001_10"),
    ("shared-cut", "the stream ended within a message", "000001_10"),
    ("shared-noise", "it is not an Arrow stream: it begins with \"load\"", "000001_10"),
    ("shared-another-number", "it replies to call 2, but the row in shared memory replies to call 5", "000001_10"),
    ("shared-leads-on", "it says `shared`, which is not a message of the protocol", "000001_10"),
    ("shared-a-schema", "a schema came instead of a record batch", "000001_10"),
    ("shared-holds-others", "it holds file 99 of shared memory, which holds no call", "000001_10"),
    ("shared-shrinks", "it ended with exit code 9", "000001_10"),
];

/// Runs two frames through a process; the output must contain `expected`.
fn fails(peer: &Peer, mode: &str, expected: &str, frame: &str) -> Result<(), String> {
    // A time-out is short only if the process never replies, so that a slow machine does not cause failures.
    let is_silent = expected.contains("did not answer within 2 s") || mode == "floods-stderr-and-hangs";
    let times = match expected.contains("was not ready") {
        true => "start_timeout_s: 2, timeout_s: 120",
        false if is_silent => "start_timeout_s: 120, timeout_s: 2",
        // A remaining child process keeps the standard output open.
        false if mode == "forks-and-exits" => "start_timeout_s: 120, timeout_s: 20",
        false => "start_timeout_s: 120, timeout_s: 120",
    };
    let experiment = peer.experiment_in_mode(mode, "0..2", times);
    let (out, mark) = (peer.path(&format!("run-{mode}")), format!("{}-{mode}", std::process::id()));
    let start = Instant::now();
    let output = run(&experiment, &out, &mark).args(["--workers", "1", "--keep-going"]).output();
    let output = output.map_err(|error| error.to_string())?;
    let (printed, took) = (output_of(&output), start.elapsed());
    if output.status.code() != Some(3) {
        return Err(format!("ended with {}: {printed}", output.status));
    }
    for part in [expected, "own", frame] {
        if !printed.contains(&part.split_whitespace().collect::<Vec<_>>().join(" ")) {
            return Err(format!("{part:?} is missing: {printed}"));
        }
    }
    // Enough for two frames, each with start, time-out and two grace periods, on a loaded machine.
    if took > Duration::from_secs(200) {
        return Err(format!("took {took:?}"));
    }
    let remaining = processes(&mark);
    if !remaining.is_empty() {
        return Err(format!("{remaining:?} still run"));
    }
    let info = depthloom().arg("inspect").arg(&out).output().map_err(|error| error.to_string())?;
    if !info.status.success() {
        return Err(format!("its recording cannot be read: {}", output_of(&info)));
    }
    Ok(())
}

#[test]
fn each_of_82_faults_is_an_error_with_node_and_frame_and_leaves_no_process() {
    if !system_python("each_of_82_faults_is_an_error_with_node_and_frame_and_leaves_no_process") {
        return;
    }
    let peer = Peer::new();
    let first = FAULTS.iter().map(|(mode, expected)| (*mode, *expected, "000000_10"));
    let all: Vec<(&str, &str, &str)> = first.chain(LATER).collect();
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    // Four threads, because the tests mostly wait.
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                while let Some((mode, expected, frame)) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Err(what) = fails(&peer, mode, expected, frame) {
                        wrong.lock().expect("no panic").push(format!("{mode}: {what}"));
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().expect("no panic");
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), all.len(), wrong.join("\n\n"));
}

#[test]
fn printing_to_standard_output_is_an_error_that_suggests_standard_error() {
    if !system_python("printing_to_standard_output_is_an_error_that_suggests_standard_error") {
        return;
    }
    let peer = Peer::new();
    let experiment = peer.experiment_in_mode("prints-text", "0..1", "start_timeout_s: 120");
    let output = run(&experiment, &peer.path("run"), "prints").output().expect("started");
    let printed = output_of(&output);
    assert_eq!(output.status.code(), Some(3), "{printed}");
    assert!(printed.contains("it begins with \"load\" instead of a message"), "{printed}");
    assert!(printed.contains("help: print to standard error (`print(..., file=sys.stderr)` in Python)"), "{printed}");
}

#[test]
fn replies_in_shared_memory_work_and_concurrent_changes_are_harmless() {
    if !system_python("replies_in_shared_memory_work_and_concurrent_changes_are_harmless") {
        return;
    }
    let peer = Peer::new();
    for mode in ["shared-works", "shared-scribbles"] {
        let mark = format!("{}-{mode}", std::process::id());
        let experiment = peer.experiment_in_mode(mode, "0..2", "timeout_s: 20");
        let output = run(&experiment, &peer.path(&format!("run-{mode}")), &mark).args(["--workers", "1"]).output();
        let output = output.expect("started");
        let is_expected = output.status.success() || mode == "shared-scribbles" && output.status.code() == Some(3);
        assert!(is_expected, "{mode}: {}", output_of(&output));
        assert_eq!(processes(&mark), Vec::<String>::new());
    }
}

#[test]
fn fault_60_a_program_that_cannot_be_started_is_reported_before_the_run() {
    let peer = Peer::new();
    std::fs::write(peer.path("plain.txt"), "no program").expect("written");
    for (name, command) in
        [("nothing", "[./nothing]"), ("plain", "[./plain.txt]"), ("unknown", "[no-such-program-at-all]")]
    {
        let out = peer.path(&format!("run-{name}"));
        let output =
            run(&peer.experiment(name, "0..1", command, "timeout_s: 5"), &out, "none").output().expect("started");
        let printed = output_of(&output);
        assert_eq!(output.status.code(), Some(2), "{printed}");
        assert!(printed.contains("cannot be started") && !printed.contains("frame 000000_10"), "{printed}");
    }
}

#[test]
fn an_ended_process_is_replaced_and_leaves_no_zombie() {
    if !system_python("an_ended_process_is_replaced_and_leaves_no_zombie") {
        return;
    }
    let peer = Peer::new();
    // All twelve processes end.
    let experiment = peer.experiment_in_mode("exits", "0..12", "timeout_s: 30");
    let (out, mark) = (peer.path("run"), format!("{}-zombies", std::process::id()));
    let output = run(&experiment, &out, &mark).args(["--keep-going", "--workers", "2"]).output().expect("started");
    assert!(output_of(&output).contains("12 frames failed"), "{}", output_of(&output));
    assert_eq!(processes(&mark), Vec::<String>::new());

    let experiment = peer.experiment_in_mode("hangs", "0..1", "timeout_s: 20");
    let mut child = run(&experiment, &peer.path("waits"), &mark).spawn().expect("started");
    until("a process is called", || processes(&mark).len() >= 3);
    let zombies = || {
        let all = std::fs::read_dir("/proc").expect("a Linux").flatten();
        let stat =
            |process: std::fs::DirEntry| std::fs::read_to_string(process.path().join("stat")).unwrap_or_default();
        let of_run = all.map(stat).filter(|stat| {
            let mut fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
            fields.next() == Some("Z") && fields.next() == Some(&child.id().to_string())
        });
        of_run.count()
    };
    assert_eq!(zombies(), 0);
    child.kill().expect("killed");
    child.wait().expect("ended");
    until("all processes of a killed run have ended", || processes(&mark).is_empty());
}

#[test]
fn a_killed_run_leaves_no_process_even_if_it_ignores_signals() {
    if !system_python("a_killed_run_leaves_no_process_even_if_it_ignores_signals") {
        return;
    }
    let peer = Peer::new();
    for mode in ["works", "ignores-sigterm", "forks-and-hangs"] {
        let mark = format!("{}-killed-{mode}", std::process::id());
        let experiment = peer.experiment_in_mode(mode, "0..100000", "timeout_s: 60");
        let mut child = run(&experiment, &peer.path(mode), &mark).spawn().expect("started");
        until("a process is called", || processes(&mark).iter().any(|line| line.contains("peer.py")));
        child.kill().expect("killed");
        child.wait().expect("ended");
        until("all processes have ended", || processes(&mark).is_empty());
    }
}

#[test]
fn an_interrupt_waits_for_calls_and_a_second_one_kills_them() {
    if !system_python("an_interrupt_waits_for_calls_and_a_second_one_kills_them") {
        return;
    }
    let peer = Peer::new();
    for (mode, times) in [("works", 1), ("ignores-sigterm", 2)] {
        let mark = format!("{}-interrupted-{mode}", std::process::id());
        let experiment = peer.experiment_in_mode(mode, "0..100000", "timeout_s: 60");
        let out = peer.path(&format!("interrupted-{mode}"));
        let child = run(&experiment, &out, &mark).stderr(std::process::Stdio::piped()).spawn().expect("started");
        until("a process is called", || processes(&mark).iter().any(|line| line.contains("peer.py")));
        if mode == "works" {
            let partial = peer.path(&format!("interrupted-{mode}.partial")).join("recording.mcap");
            until("frames are written", || partial.metadata().is_ok_and(|file| file.len() > 100_000));
        } else {
            std::thread::sleep(Duration::from_secs(1));
        }
        for _ in 0..times {
            succeed(std::process::Command::new("kill").args(["-TERM", &child.id().to_string()]));
            std::thread::sleep(Duration::from_millis(300));
        }
        let output = child.wait_with_output().expect("ended");
        assert_eq!(output.status.code(), Some(130), "{mode}: {}", output_of(&output));
        until("all processes have ended", || processes(&mark).is_empty());
    }
}

#[test]
fn a_process_yields_the_same_recording_with_one_and_eight_workers() {
    if !system_python("a_process_yields_the_same_recording_with_one_and_eight_workers") {
        return;
    }
    let peer = Peer::new();
    let experiment = peer.experiment_in_mode("works-with-noise", "0..8", "version: 1");
    let bytes = |workers: &str| {
        let out = peer.path(&format!("run-{workers}"));
        succeed(run(&experiment, &out, "works").args(["--workers", workers]));
        std::fs::read(out.join("recording.mcap")).expect("a recording")
    };
    assert!(bytes("1") == bytes("8"), "the recordings differ");
}

#[test]
fn changed_code_fails_the_frame_and_programs_are_found_next_to_the_experiment() {
    if !system_python("changed_code_fails_the_frame_and_programs_are_found_next_to_the_experiment") {
        return;
    }
    let peer = Peer::new();
    std::fs::write(peer.path("code.txt"), "one").expect("written");
    let works = format!("exec python3 peer.py works {}", peer.folder.path().display());
    // The program changes the file when it starts.
    let command = format!("[sh, -c, {:?}]", format!("echo two > code.txt; {works}"));
    let experiment = peer.experiment("changes", "0..1", &command, "code: [code.txt]");
    let output =
        run(&experiment, &peer.path("out"), "code-changes").current_dir(peer.folder.path()).output().expect("runs");
    assert_eq!(output.status.code(), Some(3), "{}", output_of(&output));
    assert!(
        output_of(&output).contains("code.txt, which `code` or `command` names, changed since the run began"),
        "{}",
        output_of(&output)
    );

    // The experiment is given without a folder.
    let program = peer.path("prog.sh");
    std::fs::write(&program, format!("#!/bin/sh\n{works}\n")).expect("written");
    std::process::Command::new("chmod").arg("+x").arg(&program).status().expect("chmod");
    peer.experiment("beside", "0..1", "[./prog.sh]", "version: 1");
    let output = run(std::path::Path::new("beside.yaml"), &peer.path("beside"), "beside")
        .current_dir(peer.folder.path())
        .output();
    let output = output.expect("runs");
    assert_eq!(output.status.code(), Some(0), "{}", output_of(&output));
}
