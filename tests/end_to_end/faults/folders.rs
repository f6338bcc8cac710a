//! Faults in the handling of run folders.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use super::small::{partial, recorded, run, start_long, stderr_of, street, under, wait};
use crate::support::{depthloom, succeed, workspace};

#[test]
fn fault_06_overwrite_replaces_only_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("t");
    fs::create_dir(&out).expect("a folder");
    fs::write(out.join("thesis"), "years").expect("written");
    let refused = run("0..2", &out, &["--overwrite"]);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr_of(&refused));
    assert!(stderr_of(&refused).contains("not of a run"), "{}", stderr_of(&refused));
    assert_eq!(fs::read(out.join("thesis")).expect("the file"), b"years");
    assert!(!partial(&out).exists());
    fs::remove_dir_all(&out).expect("removed");

    for frames in ["0..2", "0..3"] {
        let replaced = run(frames, &out, &["--overwrite"]);
        assert_eq!(replaced.status.code(), Some(0), "{}", stderr_of(&replaced));
        assert_eq!(fs::read_to_string(out.join("scores.csv")).expect("scores").contains("000002"), frames == "0..3");
    }
    let remaining: Vec<_> = fs::read_dir(folder.path()).expect("a folder").flatten().map(|e| e.file_name()).collect();
    assert_eq!(remaining, ["t"]);
}

#[test]
fn fault_41_an_unfinished_run_is_neither_replaced_nor_reported_in_place() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("live");
    let mut live = start_long(&mut depthloom(), &out);
    let second = run("0..2", &out, &["--overwrite"]);
    assert_eq!(second.status.code(), Some(2), "{}", stderr_of(&second));
    assert!(stderr_of(&second).contains("another process is writing to it"), "{}", stderr_of(&second));
    let report = depthloom().arg("report").arg(partial(&out)).output().expect("the binary starts");
    assert_eq!(report.status.code(), Some(2), "{}", stderr_of(&report));
    // A report in another folder is possible while the run continues.
    succeed(depthloom().arg("report").arg(partial(&out)).arg("--out").arg(folder.path().join("so far")));
    let before = recorded(&out);
    wait(&mut live, || recorded(&out) > before);
    live.kill().expect("killed");
    live.wait().expect("ended");
    // A killed process does not keep the lock.
    assert_eq!(run("0..2", &out, &["--overwrite"]).status.code(), Some(0));
}

#[test]
fn fault_41_the_current_folder_and_the_experiments_folder_are_not_replaced() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    assert_eq!(run("0..2", &out, &[]).status.code(), Some(0));
    let overwrite = |experiment: &OsStr, current: &Path, out: &Path| {
        let mut command = depthloom();
        command
            .current_dir(current)
            .args(["run", "--no-page"])
            .arg(experiment)
            .arg("--out")
            .arg(out)
            .arg("--overwrite");
        command.args(["--set", "sources.street.with.frames=0..2"]).output().expect("the binary starts")
    };
    let experiment = workspace().join("experiments/first-look.yaml");
    let current = overwrite(experiment.as_os_str(), &out, &out);
    let own_folder = overwrite(out.join("experiment.yaml").as_os_str(), folder.path(), &out);
    // A socket stands for any special file: a program with the fault would replace a device.
    let socket = folder.path().join("socket");
    let _bound = std::os::unix::net::UnixListener::bind(&socket).expect("a socket");
    let special_file = overwrite(experiment.as_os_str(), folder.path(), &socket);
    for refused in [current, own_folder, special_file] {
        assert_eq!(refused.status.code(), Some(2), "{}", stderr_of(&refused));
    }
    assert!(out.join("experiment.yaml").is_file() && !socket.is_dir() && socket.exists());
}

#[test]
fn fault_25_a_trained_model_is_a_file_of_its_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let output = succeed(depthloom().args(["run", "--no-page"]).arg(street(folder.path(), 2)).arg("--out").arg(&out));
    assert!(String::from_utf8_lossy(&output.stdout).contains("learnt models"), "{output:?}");
    let model = fs::read(out.join("models/learn.train.onnx")).expect("the model");
    let recording = depthloom_recording::Recording::open(out.join("recording.mcap")).expect("a recording");
    let is_model = |name: &&depthloom_recording::AttachmentEntry| name.name.starts_with("artifacts/");
    let models: Vec<_> = recording.attachments().iter().filter(is_model).collect();
    assert!(models.iter().any(|entry| recording.attachment(&entry.name).expect("its bytes") == model));
    // An untrusted run may contain links: the model is not written through them to another file or folder.
    use std::os::unix::fs::symlink;
    let precious = folder.path().join(".bashrc");
    fs::write(&precious, "years").expect("written");
    fs::remove_file(out.join("models/learn.train.onnx")).expect("removed");
    for name in ["learn.train.onnx", "learn.train.onnx.partial"] {
        symlink(&precious, out.join("models").join(name)).expect("linked");
    }
    succeed(depthloom().arg("report").arg(&out).arg("--no-page"));
    assert_eq!(fs::read_to_string(&precious).expect("the file"), "years");
    assert!(fs::read(out.join("models/learn.train.onnx")).expect("the model") == model);
    let other_folder = folder.path().join("other_folder");
    fs::rename(out.join("models"), &other_folder).expect("renamed");
    fs::remove_file(other_folder.join("learn.train.onnx")).expect("removed");
    symlink(&other_folder, out.join("models")).expect("linked");
    let refused = depthloom().arg("report").arg(&out).arg("--no-page").output().expect("the binary starts");
    assert_eq!(refused.status.code(), Some(1), "{}", stderr_of(&refused));
    assert!(stderr_of(&refused).contains("models is a symbolic link, not a folder"), "{}", stderr_of(&refused));
    assert!(!other_folder.join("learn.train.onnx").exists());
}

#[test]
fn fault_28_runs_started_at_once_have_separate_folders() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = workspace().join("experiments/first-look.yaml");
    let start = |_| {
        let mut command = depthloom();
        command.current_dir(folder.path()).args(["run", "--no-page"]).arg(&experiment).args([
            "--quiet",
            "--workers",
            "1",
        ]);
        command.args(["--set", "sources.street.with.frames=0..2"]).stdout(Stdio::null()).spawn().expect("it starts")
    };
    let children: Vec<Child> = (0..4).map(start).collect();
    for mut child in children {
        assert_eq!(child.wait().expect("ended").code(), Some(0));
    }
    assert_eq!(fs::read_dir(folder.path().join("runs/first-look")).expect("runs").count(), 4);
}

#[test]
fn fault_34_report_on_a_folder_of_runs_lists_them() {
    let folder = tempfile::tempdir().expect("a folder");
    for out in ["b", "a"] {
        assert_eq!(run("0..2", &folder.path().join(out), &[]).status.code(), Some(0));
    }
    for above in [folder.path(), folder.path().parent().expect("a parent folder")] {
        let report = depthloom().arg("report").arg(above).output().expect("the binary starts");
        assert_eq!(report.status.code(), Some(2));
        let stderr = stderr_of(&report);
        if above == folder.path() {
            assert!(stderr.contains("has no recording.mcap") && stderr.contains("it contains 2 runs"), "{stderr}");
            assert!(stderr.contains(&format!("depthloom report {}", folder.path().join("b").display())), "{stderr}");
        }
    }
}

#[test]
fn a_report_in_another_folder_lists_only_its_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, other_folder) = (folder.path().join("run"), folder.path().join("report"));
    assert_eq!(run("0..2", &out, &[]).status.code(), Some(0));
    let report = succeed(depthloom().arg("report").arg(&out).arg("--out").arg(&other_folder));
    let printed = String::from_utf8_lossy(&report.stdout);
    assert!(printed.contains("scores.{csv,parquet}") && !printed.contains("recording.mcap"), "{printed}");
}

#[test]
fn fault_65_a_report_is_never_written_into_another_runs_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
    assert_eq!(run("0..1", &one, &[]).status.code(), Some(0));
    assert_eq!(run("1..3", &other, &[]).status.code(), Some(0));
    let scores = fs::read(other.join("scores.csv")).expect("written");
    for out in [other.clone(), other.join("below"), one.join("below")] {
        let output = depthloom().arg("report").arg(&one).arg("--out").arg(&out).output().expect("the binary starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains("--out is the folder of another run"), "{stderr}");
    }
    assert_eq!(fs::read(other.join("scores.csv")).expect("the file"), scores);
    assert!(!other.join("below").exists() && !one.join("below").exists());
    // The run's own folder is accepted, under every path to it.
    succeed(depthloom().arg("report").arg(&one).arg("--out").arg(&one));
    succeed(depthloom().current_dir(&one).args(["report", "recording.mcap", "--out", "."]));
}

#[test]
fn fault_66_a_report_replaces_only_files_of_reports() {
    let folder = tempfile::tempdir().expect("a folder");
    let (one, own) = (folder.path().join("one"), folder.path().join("own"));
    assert_eq!(run("0..1", &one, &[]).status.code(), Some(0));
    fs::create_dir(&own).expect("created");
    let report = || depthloom().arg("report").arg(&one).arg("--out").arg(&own).output().expect("the binary starts");
    for name in ["scores.csv", "scores.parquet", "true_distances.csv", "learning_curves.parquet"] {
        fs::write(own.join(name), "mine,a1\n").expect("written");
        let refused = report();
        assert_eq!(refused.status.code(), Some(2), "{name}: {}", stderr_of(&refused));
        assert!(
            stderr_of(&refused).contains(&format!("has a file that no report wrote: {}", own.join(name).display())),
            "{}",
            stderr_of(&refused)
        );
        assert_eq!(fs::read(own.join(name)).expect("the file"), b"mine,a1\n");
        fs::remove_file(own.join(name)).expect("removed");
    }
    // Files of an earlier report are replaced, also those of 0.1.0, whose Parquet files have no mark.
    assert_eq!([report(), report()].map(|again| again.status.code()), [Some(0); 2]);
    fs::write(own.join("table.csv"), "estimate,scored_on,a1\n").expect("written");
    fs::write(own.join("table.parquet"), "PAR1").expect("written");
    assert_eq!(report().status.code(), Some(0));
}

#[test]
fn names_of_maximal_length_work() {
    let folder = tempfile::tempdir().expect("a folder");
    let (stage, node, variant) = ("\u{e4}".repeat(100), "n".repeat(100), "v".repeat(100));
    let text = fs::read_to_string(street(folder.path(), 2)).expect("written");
    let text = text.replace("  learn:\n", &format!("  {stage}:\n")).replace("      train:", &format!("      {node}:"));
    let variants = format!("variants: {{ {variant}: {{}}, other: {{ {stage}.{node}.with.steps: 1 }} }}\n");
    let long = folder.path().join(format!("{}.yaml", "x".repeat(250)));
    fs::write(&long, text + &variants).expect("written");
    let main = folder.path().join("main.yaml");
    fs::write(&main, format!("extends: {}\n", long.display())).expect("written");
    let out = folder.path().join("run");
    let finished =
        depthloom().args(["run", "--no-page"]).arg(&main).arg("--out").arg(&out).output().expect("the binary starts");
    assert_eq!(finished.status.code(), Some(0), "{}", stderr_of(&finished));
    assert_eq!(fs::read_dir(out.join("models")).expect("models").count(), 2);
    // All files of the run are recognised as its own.
    let again = depthloom().args(["run", "--no-page"]).arg(&main).arg("--out").arg(&out).arg("--overwrite").output();
    let again = again.expect("the binary starts");
    assert_eq!(again.status.code(), Some(0), "{}", stderr_of(&again));
}

#[cfg(unix)]
#[test]
fn fault_41_a_run_folder_that_the_experiment_reads_is_not_replaced() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = |name: &str| folder.path().join(name);
    let first = run("0..2", &here("old"), &[]);
    assert_eq!(first.status.code(), Some(0), "{}", stderr_of(&first));
    fs::create_dir(here("exps")).expect("created");
    fs::create_dir(here("other_folder")).expect("created");
    std::os::unix::fs::symlink("../old/experiment.yaml", here("exps/link.yaml")).expect("a link");
    std::os::unix::fs::symlink("../old", here("exps/way")).expect("a link");
    let extends = |name: &str| format!("extends: {name}\nexperiment: next\n");
    let graph = "sources: { street: { kind: synthetic/road, with: { frames: 0..2, width: 320, height: 96 } } }
stages:
  look:
    source: street
    nodes: { graph: GRAPH }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }
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
        // From another folder than the experiment's, and under several paths to the same folder.
        for out in ["../old", "../exps/way/../old", "../other_folder/../old"] {
            let mut command = depthloom();
            command.current_dir(here("other_folder")).args([
                "run",
                "--no-page",
                "../exps/main.yaml",
                "--overwrite",
                "--out",
                out,
            ]);
            let refused = command.output().expect("the binary starts");
            assert_eq!(refused.status.code(), Some(2), "{text}: {}", stderr_of(&refused));
            assert!(stderr_of(&refused).contains("which this run reads"), "{text}: {}", stderr_of(&refused));
        }
        let before = fs::read(here("old/experiment.yaml")).expect("the file");
        assert!(!before.is_empty() && here("old/recording.mcap").is_file());
    }
}

#[cfg(unix)]
#[test]
fn fault_45_a_path_that_is_not_utf_8_is_printed_unchanged() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join(OsStr::from_bytes(b"r\xffn"));
    let refused = run("0..2", &out, &["--json"]);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr_of(&refused));
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 0, "found before any frame");
    let finished = run("0..2", &out, &["--quiet"]);
    assert_eq!(finished.status.code(), Some(0), "{}", stderr_of(&finished));
    assert_eq!(finished.stdout, [b"run: ", out.as_os_str().as_bytes(), b"\n"].concat());
    assert!(out.join("environment.json").is_file());
    succeed(depthloom().arg("report").arg(&out));
}

#[test]
fn fault_50_a_pipe_is_refused_as_a_recording() {
    let folder = tempfile::tempdir().expect("a folder");
    let pipe = folder.path().join("pipe");
    succeed(Command::new("mkfifo").arg(&pipe));
    let mut report = under("timeout", &["100"]);
    assert_eq!(report.arg("report").arg(&pipe).status().expect("it starts").code(), Some(2));
}

#[test]
fn fault_23_doctor_lists_the_instruction_sets_of_the_kernels() {
    let doctor = succeed(depthloom().args(["doctor", "--json"]));
    let doctor: serde_json::Value = serde_json::from_slice(&doctor.stdout).expect("JSON");
    for name in doctor["simd"].as_array().expect("a list") {
        assert!(
            ["sse2", "avx2", "avx512", "avx512-popcnt", "neon"].contains(&name.as_str().expect("a name")),
            "{name}"
        );
    }
}
