//! Faults of a run's folder, signals, streams and what the system refuses.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use crate::support::{depthloom, succeed, workspace};

/// A run of the first experiment on small frames.
fn look(command: &mut Command, frames: &str, out: &Path) {
    let frames = format!("sources.street.with.frames={frames}");
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96", "--set", &frames];
    command.arg("run").arg(workspace().join("experiments/first-look.yaml")).args(["--workers", "2"]).args(small);
    command.arg("--out").arg(out);
}

fn run(frames: &str, out: &Path, arguments: &[&str]) -> Output {
    let mut command = depthloom();
    look(&mut command, frames, out);
    command.args(arguments).output().expect("the binary starts")
}

/// The same program under another one: `prlimit`, `sh`, `timeout`.
fn under(program: &str, arguments: &[&str]) -> Command {
    let binary = depthloom();
    let mut command = Command::new(program);
    command.args(arguments).arg(binary.get_program()).current_dir(workspace());
    for (name, value) in binary.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The bytes of its recording that a run has written so far.
fn recorded(out: &Path) -> u64 {
    fs::metadata(partial(out).join("recording.mcap")).map_or(0, |file| file.len())
}

fn partial(out: &Path) -> PathBuf {
    out.with_extension("partial")
}

/// Waits until something holds of a run that goes on.
fn wait(child: &mut Child, until: impl Fn() -> bool) {
    while !until() {
        assert!(child.try_wait().expect("a child").is_none(), "the run ended by itself");
        std::thread::yield_now();
    }
}

fn send(signal: &str, child: &Child) {
    succeed(Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]));
}

/// Starts a run of more frames than anybody waits for, and waits until it has recorded some.
fn start_long(command: &mut Command, out: &Path) -> Child {
    look(command, "0..100000", out);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the binary starts");
    wait(&mut child, || recorded(out) > 1_000_000);
    child
}

#[test]
fn fault_03_a_closed_or_full_stderr_costs_no_run() {
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
fn fault_03_a_closed_or_full_stdout_costs_no_result() {
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
        assert_eq!(output.status.code(), Some(code), "{name}: {}", said(&output));
        assert!(out.join("table.csv").is_file(), "{name}");
        assert_eq!(said(&output).contains(&format!("the run is whole in {}", out.display())), code == 1, "{name}");
    }
    let full = fs::File::options().write(true).open("/dev/full").expect("a device that is full");
    let help = depthloom().arg("--help").stdout(full).status().expect("the binary starts");
    assert_eq!(help.code(), Some(1), "nobody saw the help");
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
        // More than all frames in flight come to.
        wait(&mut child, || recorded(&out) > before + 3_000_000);
        child.kill().expect("killed");
        child.wait().expect("ended");
    }
}

#[test]
fn a_hangup_that_nobody_ignores_interrupts() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let mut child = start_long(&mut depthloom(), &out);
    send("HUP", &child);
    assert_eq!(child.wait().expect("ended").code(), Some(130));
    succeed(depthloom().arg("report").arg(partial(&out)));
}

#[test]
fn fault_06_overwrite_replaces_runs_and_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("t");
    fs::create_dir(&out).expect("a folder");
    fs::write(out.join("thesis"), "years").expect("written");
    let refused = run("0..2", &out, &["--overwrite"]);
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert!(said(&refused).contains("not of a run"), "{}", said(&refused));
    assert_eq!(fs::read(out.join("thesis")).expect("it is there"), b"years");
    assert!(!partial(&out).exists());
    fs::remove_dir_all(&out).expect("removed");

    for frames in ["0..2", "0..3"] {
        let whole = run(frames, &out, &["--overwrite"]);
        assert_eq!(whole.status.code(), Some(0), "{}", said(&whole));
        assert_eq!(fs::read_to_string(out.join("scores.csv")).expect("scores").contains("000002"), frames == "0..3");
    }
    let left: Vec<_> = fs::read_dir(folder.path()).expect("a folder").flatten().map(|e| e.file_name()).collect();
    assert_eq!(left, ["t"]);
}

#[test]
fn fault_41_a_run_that_goes_on_is_neither_replaced_nor_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("live");
    let mut live = start_long(&mut depthloom(), &out);
    let second = run("0..2", &out, &["--overwrite"]);
    assert_eq!(second.status.code(), Some(2), "{}", said(&second));
    assert!(said(&second).contains("another process is writing to it"), "{}", said(&second));
    let report = depthloom().arg("report").arg(partial(&out)).output().expect("the binary starts");
    assert_eq!(report.status.code(), Some(2), "{}", said(&report));
    // Elsewhere its frames can be looked at while it goes on.
    succeed(depthloom().arg("report").arg(partial(&out)).arg("--out").arg(folder.path().join("so far")));
    let before = recorded(&out);
    wait(&mut live, || recorded(&out) > before);
    live.kill().expect("killed");
    live.wait().expect("ended");
    // Who was killed holds no lock.
    assert_eq!(run("0..2", &out, &["--overwrite"]).status.code(), Some(0));
}

#[test]
fn fault_41_neither_the_current_folder_nor_the_experiments_is_replaced() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    assert_eq!(run("0..2", &out, &[]).status.code(), Some(0));
    let there = |experiment: &OsStr, current: &Path, out: &Path| {
        let mut command = depthloom();
        command.current_dir(current).arg("run").arg(experiment).arg("--out").arg(out).arg("--overwrite");
        command.args(["--set", "sources.street.with.frames=0..2"]).output().expect("the binary starts")
    };
    let experiment = workspace().join("experiments/first-look.yaml");
    let current = there(experiment.as_os_str(), &out, &out);
    let its_own = there(out.join("experiment.yaml").as_os_str(), folder.path(), &out);
    // As a device is: nobody's folder. A program with the fault would replace the machine's own.
    let socket = folder.path().join("socket");
    let _bound = std::os::unix::net::UnixListener::bind(&socket).expect("a socket");
    let no_folder = there(experiment.as_os_str(), folder.path(), &socket);
    for refused in [current, its_own, no_folder] {
        assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    }
    assert!(out.join("experiment.yaml").is_file() && !socket.is_dir() && socket.exists());
}

/// An experiment that learns on a street.
fn street(folder: &Path, steps: u64) -> PathBuf {
    let path = folder.join(format!("street-{steps}.yaml"));
    let text = format!(
        "experiment: street
sources:
  train: {{ kind: synthetic/road, with: {{ frames: 0..4, width: 320, height: 96, seed: 4 }} }}
stages:
  learn:
    source: train
    nodes:
      stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }} }}
      edges: {{ kind: confidence/edges, inputs: {{ image: source/left }} }}
      samples:
        kind: learn/samples
        inputs: {{ image: source/left, target: stereo/disparity, mask: edges/mask, calibration: source/calibration }}
        with: {{ size: [64, 32] }}
      teacher:
        kind: learn/ssl
        inputs: {{ samples: samples/samples }}
        with: {{ steps: {steps}, batch: 2, curve_every: 7, checkpoint_every: 2 }}
"
    );
    fs::write(&path, text).expect("written");
    path
}

#[test]
fn fault_18_27_the_first_signal_ends_learning_at_a_checkpoint() {
    let folder = tempfile::tempdir().expect("a folder");
    // More than are learnt while a signal is on its way.
    let experiment = street(folder.path(), 5_000);
    for signal in ["INT", "TERM"] {
        // Each beside checkpoints of its own: those of the first would be there before the second has begun.
        let home = folder.path().join(signal);
        fs::create_dir(&home).expect("a folder");
        let (out, checkpoints) = (home.join("run"), home.join("checkpoints"));
        let is_checkpoint = |file: fs::DirEntry| file.path().extension().is_some_and(|ending| ending == "checkpoint");
        let mut command = depthloom();
        command.arg("run").arg(&experiment).args(["--workers", "2", "--out"]).arg(&out);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the binary starts");
        wait(&mut child, || fs::read_dir(&checkpoints).is_ok_and(|files| files.flatten().any(is_checkpoint)));
        send(signal, &child);
        let output = child.wait_with_output().expect("ended");
        assert_eq!(output.status.code(), Some(130), "{}", said(&output));
        let said = said(&output);
        assert!(said.contains("4 frames can be read from"), "{said}");
        // As the README says it goes on.
        let way = "run the same again, with the same --out, to go on: behind these frames, learning from";
        assert!(said.split_whitespace().collect::<Vec<_>>().join(" ").contains(way), "{said}");
        assert!(fs::read_dir(&checkpoints).expect("a folder").next().is_some(), "the checkpoint is gone");
        succeed(depthloom().arg("report").arg(partial(&out)));
    }
}

#[test]
fn fault_25_a_learnt_model_is_a_file_of_its_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let output = succeed(depthloom().arg("run").arg(street(folder.path(), 2)).arg("--out").arg(&out));
    assert!(String::from_utf8_lossy(&output.stdout).contains("learnt models"), "{output:?}");
    let model = fs::read(out.join("models/learn.teacher.onnx")).expect("the model");
    let recording = depthloom_recording::Recording::open(out.join("recording.mcap")).expect("a recording");
    let of_model = |name: &&depthloom_recording::AttachmentEntry| name.name.starts_with("artifacts/");
    let kept: Vec<_> = recording.attachments().iter().filter(of_model).collect();
    assert!(kept.iter().any(|entry| recording.attachment(&entry.name).expect("its bytes") == model));
}

#[test]
fn fault_28_runs_begun_at_once_have_folders_of_their_own() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = workspace().join("experiments/first-look.yaml");
    let start = |_| {
        let mut command = depthloom();
        command.current_dir(folder.path()).arg("run").arg(&experiment).args(["--quiet", "--workers", "1"]);
        command.args(["--set", "sources.street.with.frames=0..2"]).stdout(Stdio::null()).spawn().expect("it starts")
    };
    let children: Vec<Child> = (0..4).map(start).collect();
    for mut child in children {
        assert_eq!(child.wait().expect("ended").code(), Some(0));
    }
    assert_eq!(fs::read_dir(folder.path().join("runs/first-look")).expect("runs").count(), 4);
}

#[test]
fn fault_34_a_folder_of_runs_is_told_from_a_run() {
    let folder = tempfile::tempdir().expect("a folder");
    for out in ["b", "a"] {
        assert_eq!(run("0..2", &folder.path().join(out), &[]).status.code(), Some(0));
    }
    for above in [folder.path(), folder.path().parent().expect("it is in one")] {
        let report = depthloom().arg("report").arg(above).output().expect("the binary starts");
        assert_eq!(report.status.code(), Some(2));
        let told = said(&report);
        if above == folder.path() {
            assert!(told.contains("has no recording.mcap") && told.contains("it holds 2 runs"), "{told}");
            assert!(told.contains(&format!("depthloom report {}", folder.path().join("b").display())), "{told}");
        }
    }
}

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
fn a_run_that_is_not_whole_yet_is_named_to_who_asks_for_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let output = limited("--fsize=1500000", "0..100", &out);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    for (command, path) in [("report", out.clone()), ("report", out.join("recording.mcap")), ("timings", out.clone())] {
        let asked = depthloom().arg(command).arg(&path).output().expect("the binary starts");
        assert_eq!(asked.status.code(), Some(2), "{}", said(&asked));
        let reads = format!("`depthloom {command} {}` reads what there is", partial(&out).display());
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
    command.current_dir(folder.path()).arg("run").arg(workspace().join("experiments/first-look.yaml"));
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
fn a_report_elsewhere_names_what_lies_there() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, elsewhere) = (folder.path().join("run"), folder.path().join("report"));
    assert_eq!(run("0..2", &out, &[]).status.code(), Some(0));
    let report = succeed(depthloom().arg("report").arg(&out).arg("--out").arg(&elsewhere));
    let printed = String::from_utf8_lossy(&report.stdout);
    assert!(printed.contains("scores.csv") && !printed.contains("recording.mcap"), "{printed}");
}

#[test]
fn names_as_long_as_they_may_be_cost_no_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let (stage, node, variant) = ("\u{e4}".repeat(100), "n".repeat(100), "v".repeat(100));
    let text = fs::read_to_string(street(folder.path(), 2)).expect("written");
    let text =
        text.replace("  learn:\n", &format!("  {stage}:\n")).replace("      teacher:", &format!("      {node}:"));
    let variants = format!("variants: {{ {variant}: {{}}, other: {{ {stage}.{node}.with.steps: 1 }} }}\n");
    let long = folder.path().join(format!("{}.yaml", "x".repeat(250)));
    fs::write(&long, text + &variants).expect("written");
    let main = folder.path().join("main.yaml");
    fs::write(&main, format!("extends: {}\n", long.display())).expect("written");
    let out = folder.path().join("run");
    let whole = depthloom().arg("run").arg(&main).arg("--out").arg(&out).output().expect("the binary starts");
    assert_eq!(whole.status.code(), Some(0), "{}", said(&whole));
    assert_eq!(fs::read_dir(out.join("models")).expect("models").count(), 2);
    // All of it is known as a run's.
    let again = depthloom().arg("run").arg(&main).arg("--out").arg(&out).arg("--overwrite").output();
    let again = again.expect("the binary starts");
    assert_eq!(again.status.code(), Some(0), "{}", said(&again));
}

#[cfg(unix)]
#[test]
fn fault_41_a_run_that_holds_what_this_one_extends_or_names_is_not_replaced() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = |name: &str| folder.path().join(name);
    let first = run("0..2", &here("old"), &[]);
    assert_eq!(first.status.code(), Some(0), "{}", said(&first));
    fs::create_dir(here("exps")).expect("created");
    fs::create_dir(here("elsewhere")).expect("created");
    std::os::unix::fs::symlink("../old/experiment.yaml", here("exps/link.yaml")).expect("a link");
    std::os::unix::fs::symlink("../old", here("exps/way")).expect("a link");
    let extends = |name: &str| format!("extends: {name}\nexperiment: next\n");
    let graph = "sources: { street: { kind: synthetic/road, with: { frames: 0..2, width: 320, height: 96 } } }
stages:
  look:
    source: street
    nodes: { graph: GRAPH }
    score: { truth: source/depth, estimates: { stereo: depth/depth } }
experiment: next
";
    let nodes = "nodes:
  stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
  depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
";
    fs::create_dir(here("old/experiment")).expect("created");
    fs::write(here("old/experiment/graph.yaml"), nodes).expect("written");
    let cases = [
        extends("../old/experiment.yaml"),
        extends("link.yaml"),
        extends("way/experiment.resolved.yaml"),
        extends("between.yaml"),
        graph.replace("GRAPH", "../old/experiment/graph.yaml"),
        graph.replace("GRAPH", "way/experiment/graph.yaml"),
        extends(&here("old/experiment.yaml").display().to_string()),
    ];
    fs::write(here("exps/between.yaml"), extends("../exps/../old/experiment.yaml")).expect("written");
    for text in cases {
        fs::write(here("exps/main.yaml"), &text).expect("written");
        // From another folder than the experiment's, and by two ways to the same folder.
        for out in ["../old", "../exps/way/../old", "../elsewhere/../old"] {
            let mut command = depthloom();
            command.current_dir(here("elsewhere")).args(["run", "../exps/main.yaml", "--overwrite", "--out", out]);
            let refused = command.output().expect("the binary starts");
            assert_eq!(refused.status.code(), Some(2), "{text}: {}", said(&refused));
            assert!(said(&refused).contains("which this run reads"), "{text}: {}", said(&refused));
        }
        let before = fs::read(here("old/experiment.yaml")).expect("it is there");
        assert!(!before.is_empty() && here("old/recording.mcap").is_file());
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

#[cfg(unix)]
#[test]
fn fault_45_a_path_that_is_no_utf_8_is_told_as_it_is() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join(OsStr::from_bytes(b"r\xffn"));
    let refused = run("0..2", &out, &["--json"]);
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 0, "found before any frame");
    let whole = run("0..2", &out, &["--quiet"]);
    assert_eq!(whole.status.code(), Some(0), "{}", said(&whole));
    assert_eq!(whole.stdout, [b"run: ", out.as_os_str().as_bytes(), b"\n"].concat());
    assert!(out.join("environment.json").is_file());
    succeed(depthloom().arg("report").arg(&out));
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

#[test]
fn fault_50_a_pipe_is_no_recording() {
    let folder = tempfile::tempdir().expect("a folder");
    let pipe = folder.path().join("pipe");
    succeed(Command::new("mkfifo").arg(&pipe));
    let mut report = under("timeout", &["100"]);
    assert_eq!(report.arg("report").arg(&pipe).status().expect("it starts").code(), Some(2));
}

#[test]
fn fault_23_doctor_names_instruction_sets_that_kernels_use() {
    let doctor = succeed(depthloom().args(["doctor", "--json"]));
    let doctor: serde_json::Value = serde_json::from_slice(&doctor.stdout).expect("JSON");
    for name in doctor["simd"].as_array().expect("a list") {
        assert!(["sse2", "avx2", "avx512", "avx512-popcnt"].contains(&name.as_str().expect("a name")), "{name}");
    }
}

#[test]
fn fault_47_a_signal_during_the_analysis_ends_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let mut command = depthloom();
    look(&mut command, "0..60", &out);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the binary starts");
    // Written first of the analysis: the maps of all frames are still to be read.
    wait(&mut child, || partial(&out).join("table.csv").exists());
    send("TERM", &child);
    let output = child.wait_with_output().expect("ended");
    assert_eq!(output.status.code(), Some(130), "{}", said(&output));
    assert!(said(&output).contains("the recording is whole"), "{}", said(&output));
    assert!(!out.exists());
    let left = fs::read_dir(partial(&out)).expect("a folder").flatten();
    let hidden: Vec<_> = left.map(|e| e.file_name()).filter(|name| name.as_encoded_bytes().starts_with(b".")).collect();
    assert!(hidden.is_empty(), "{hidden:?} stays");
    succeed(depthloom().arg("report").arg(partial(&out)));
}

#[cfg(target_os = "linux")]
#[test]
fn fault_12_memory_that_the_system_refuses_is_an_error_not_an_abort() {
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
