//! Faults in training and cache keys.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use depthloom_recording::Recording;

use crate::learning::{learn, learned, run, run_and_kill, step, steps, street};
use crate::support::{depthloom, full, succeed};

/// Starts a run without output.
fn start(experiment: &Path, out: &Path) -> Child {
    let mut run = depthloom();
    run.args(["run", "--no-page"]).arg(experiment).args(["--quiet", "--workers", "2", "--out"]).arg(out);
    run.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the binary starts")
}

/// Waits until the checkpoint next to a run reaches a step, and sends a signal.
fn signal_at(child: &mut Child, out: &Path, at: u64, signal: &str) {
    while step(&out.with_file_name("checkpoints")).unwrap_or(0) < at {
        assert!(child.try_wait().expect("a child").is_none(), "the run ended before the checkpoint of step {at}");
        std::thread::yield_now();
    }
    succeed(Command::new("kill").args([signal, &child.id().to_string()]));
}

/// An experiment with a training stage and a later stage on `frames` frames.
fn with_later_stage(folder: &Path, frames: u32) -> PathBuf {
    let path = folder.join(format!("then-{frames}.yaml"));
    let source = |frames| {
        format!("{{ kind: synthetic/road, with: {{ frames: 0..{frames}, width: 320, height: 96, seed: 4 }} }}")
    };
    let text = format!(
        "experiment: then\nsources:\n  train: {}\n  test: {}\nstages:\n{}  look:\n    source: test\n    nodes:\n      \
         stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }} }}\n",
        source(5),
        source(frames),
        learn(steps(), 1),
    );
    std::fs::write(&path, text).expect("written");
    path
}

#[test]
fn fault_05_concurrent_processes_train_the_same_network() {
    if !full("fault_05_concurrent_processes_train_the_same_network") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let alone = folder.path().join("alone");
    std::fs::create_dir(&alone).expect("a folder");
    let undisturbed = run(&street(&alone, 100), &alone.join("run"), "2");
    // Every step is checkpointed, so that two writers of one file would collide.
    let experiment = street(folder.path(), 1);
    let outs = ["a", "b", "c"].map(|name| folder.path().join(name));
    let children = outs.each_ref().map(|out| start(&experiment, out));
    for mut child in children {
        assert!(child.wait().expect("ended").success());
    }
    for out in &outs {
        assert!(learned(out) == undisturbed, "{}", out.display());
    }
    assert!(!folder.path().join("checkpoints").exists(), "the folder of checkpoints and its lock are removed");
}

#[test]
fn fault_14_checkpoint_interval_and_sample_memory_do_not_change_keys() {
    let folder = tempfile::tempdir().expect("a folder");
    let recorded = |name: &str, set: &[&str]| {
        let (experiment, out) = (street(folder.path(), 100), folder.path().join(name));
        let mut run = depthloom();
        run.args(["run", "--no-page"]).arg(experiment).args(["--quiet", "--out"]).arg(&out);
        run.args(set.iter().flat_map(|set| ["--set", *set]));
        succeed(&mut run);
        let recording = Recording::open(out.join("recording.mcap")).expect("a recording");
        (recording.plan().clone(), format!("{:?}", recording.aggregate_values()), learned(&out))
    };
    let usual = recorded("usual", &["learn.train.with.steps=5"]);
    let often = recorded(
        "often",
        &["learn.train.with.steps=5", "learn.train.with.checkpoint_every=1", "learn.samples.with.memory_mb=0"],
    );
    assert_eq!(usual.0, often.0, "the recorded plan, with every node hash");
    assert!(usual == often);
}

#[test]
fn fault_17_impossible_training_settings_are_found_before_any_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = street(folder.path(), 100);
    for (set, message) in [
        ("learn.samples.with.size=[100, 50]", "set `size: [128, 64]` at `learn/samples`"),
        ("learn.train.with.patience=2", "wire validation samples"),
        ("learn.train.with.photometric=1", "wire `right: source/right`"),
    ] {
        for command in ["check", "run"] {
            let out = folder.path().join("out");
            let mut program = depthloom();
            program.arg(command).arg(&experiment).args(["--set", set]);
            if command == "run" {
                program.arg("--out").arg(&out);
            }
            let output = program.output().expect("the binary starts");
            let stderr = String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
            assert_eq!(output.status.code(), Some(2), "{command} --set {set}: {stderr}");
            assert!(stderr.replace("│ ", "").contains(message), "{command} --set {set}: {stderr}");
            assert!(!out.exists() && !out.with_extension("partial").exists());
        }
    }
}

#[cfg(unix)]
#[test]
fn fault_27_the_next_run_resumes_training_that_a_signal_ended() {
    if !full("fault_27_the_next_run_resumes_training_that_a_signal_ended") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let alone = folder.path().join("alone");
    std::fs::create_dir(&alone).expect("a folder");
    let undisturbed = run(&street(&alone, 100), &alone.join("run"), "2");
    let experiment = street(folder.path(), 1);
    let checkpoints = folder.path().join("checkpoints");
    let mut reached = 0;
    for (signal, at) in [("-INT", 5), ("-TERM", 20)] {
        let out = folder.path().join(signal);
        let mut child = start(&experiment, &out);
        signal_at(&mut child, &out, at, signal);
        assert_eq!(child.wait().expect("ended").code(), Some(130), "{signal}");
        assert!(!out.exists(), "an interrupted run must not look like a finished one");
        let step = step(&checkpoints).expect("a checkpoint");
        assert!((at.max(reached)..steps()).contains(&step), "{signal} at {at}: {step}");
        reached = step;
    }
    assert!(run(&experiment, &folder.path().join("last"), "2") == undisturbed);
    assert!(!checkpoints.exists(), "a finished run removes its checkpoint");
}

#[cfg(unix)]
#[test]
fn fault_27_a_signal_after_training_keeps_the_trained_network() {
    if !full("fault_27_a_signal_after_training_keeps_the_trained_network") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let (experiment, out) = (with_later_stage(folder.path(), 100_000), folder.path().join("long"));
    let mut child = start(&experiment, &out);
    let recording = out.with_extension("partial").join("recording.mcap");
    signal_at(&mut child, &out, steps(), "-0");
    let trained_bytes = std::fs::metadata(&recording).expect("a recording").len();
    // Wait until the later stage has started.
    while std::fs::metadata(&recording).expect("a recording").len() < trained_bytes + 100_000 {
        assert!(child.try_wait().expect("a child").is_none(), "the run ended by itself");
        std::thread::yield_now();
    }
    signal_at(&mut child, &out, steps(), "-INT");
    assert_eq!(child.wait().expect("ended").code(), Some(130));
    let checkpoints = folder.path().join("checkpoints");
    assert_eq!(step(&checkpoints), Some(steps()), "the checkpoint has all steps");
    let short = with_later_stage(folder.path(), 2);
    let resumed = run(&short, &folder.path().join("short"), "2");
    assert!(!checkpoints.exists(), "the run resumed the training and finished");
    assert!(resumed == run(&short, &folder.path().join("again"), "1"));
}

#[test]
fn fault_46_a_damaged_checkpoint_does_not_change_the_network() {
    if !full("fault_46_a_damaged_checkpoint_does_not_change_the_network") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let alone = folder.path().join("alone");
    std::fs::create_dir(&alone).expect("a folder");
    let undisturbed = run(&street(&alone, 100), &alone.join("run"), "2");
    let experiment = street(folder.path(), 1);
    run_and_kill(&experiment, &folder.path().join("killed"), 0, 20);
    let mut files = std::fs::read_dir(folder.path().join("checkpoints")).expect("a folder").flatten();
    let checkpoint = files.find(|file| file.path().extension().is_some_and(|extension| extension == "checkpoint"));
    let checkpoint = checkpoint.expect("a checkpoint").path();
    let intact = std::fs::read(&checkpoint).expect("a checkpoint");
    for at in [intact.len() / 3, intact.len() - 20] {
        let mut damaged = intact.clone();
        damaged[at] ^= 8;
        std::fs::create_dir_all(checkpoint.parent().expect("a folder")).expect("a folder");
        std::fs::write(&checkpoint, damaged).expect("written");
        assert!(run(&experiment, &folder.path().join(format!("damaged-{at}")), "2") == undisturbed, "byte {at}");
    }
}
