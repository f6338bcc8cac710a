//! Faults of a run's folder.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use super::small::{partial, recorded, run, said, start_long, street, under, wait};
use crate::support::{depthloom, succeed, workspace};

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

#[test]
fn fault_25_a_learnt_model_is_a_file_of_its_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let output = succeed(depthloom().args(["run", "--no-page"]).arg(street(folder.path(), 2)).arg("--out").arg(&out));
    assert!(String::from_utf8_lossy(&output.stdout).contains("learnt models"), "{output:?}");
    let model = fs::read(out.join("models/learn.teacher.onnx")).expect("the model");
    let recording = depthloom_recording::Recording::open(out.join("recording.mcap")).expect("a recording");
    let of_model = |name: &&depthloom_recording::AttachmentEntry| name.name.starts_with("artifacts/");
    let kept: Vec<_> = recording.attachments().iter().filter(of_model).collect();
    assert!(kept.iter().any(|entry| recording.attachment(&entry.name).expect("its bytes") == model));
    // The model's bytes are a stranger's choice where the run is: no link takes them to another file or folder.
    use std::os::unix::fs::symlink;
    let precious = folder.path().join(".bashrc");
    fs::write(&precious, "years").expect("written");
    fs::remove_file(out.join("models/learn.teacher.onnx")).expect("removed");
    for name in ["learn.teacher.onnx", "learn.teacher.onnx.partial"] {
        symlink(&precious, out.join("models").join(name)).expect("linked");
    }
    succeed(depthloom().arg("report").arg(&out).arg("--no-page"));
    assert_eq!(fs::read_to_string(&precious).expect("it is there"), "years");
    assert!(fs::read(out.join("models/learn.teacher.onnx")).expect("the model") == model);
    let elsewhere = folder.path().join("elsewhere");
    fs::rename(out.join("models"), &elsewhere).expect("renamed");
    fs::remove_file(elsewhere.join("learn.teacher.onnx")).expect("removed");
    symlink(&elsewhere, out.join("models")).expect("linked");
    let refused = depthloom().arg("report").arg(&out).arg("--no-page").output().expect("the binary starts");
    assert_eq!(refused.status.code(), Some(1), "{}", said(&refused));
    assert!(said(&refused).contains("models is a symbolic link, not a folder"), "{}", said(&refused));
    assert!(!elsewhere.join("learn.teacher.onnx").exists());
}

#[test]
fn fault_28_runs_begun_at_once_have_folders_of_their_own() {
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

#[test]
fn a_report_elsewhere_names_what_lies_there() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, elsewhere) = (folder.path().join("run"), folder.path().join("report"));
    assert_eq!(run("0..2", &out, &[]).status.code(), Some(0));
    let report = succeed(depthloom().arg("report").arg(&out).arg("--out").arg(&elsewhere));
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
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("is a run's folder, and holds what the run wrote and nothing else"), "{said}");
    }
    assert_eq!(fs::read(other.join("scores.csv")).expect("it is there"), scores);
    assert!(!other.join("below").exists() && !one.join("below").exists());
    // Its own is where it belongs, by whatever name.
    succeed(depthloom().arg("report").arg(&one).arg("--out").arg(&one));
    succeed(depthloom().current_dir(&one).args(["report", "recording.mcap", "--out", "."]));
}

#[test]
fn fault_66_a_report_replaces_no_file_that_no_report_wrote() {
    let folder = tempfile::tempdir().expect("a folder");
    let (one, own) = (folder.path().join("one"), folder.path().join("own"));
    assert_eq!(run("0..1", &one, &[]).status.code(), Some(0));
    fs::create_dir(&own).expect("created");
    let report = || depthloom().arg("report").arg(&one).arg("--out").arg(&own).output().expect("the binary starts");
    for name in ["scores.csv", "scores.parquet", "true_distances.csv", "learning_curves.parquet"] {
        fs::write(own.join(name), "mine,a1\n").expect("written");
        let refused = report();
        assert_eq!(refused.status.code(), Some(2), "{name}: {}", said(&refused));
        assert!(said(&refused).contains(&format!("{name} exists already")), "{}", said(&refused));
        assert_eq!(fs::read(own.join(name)).expect("it is there"), b"mine,a1\n");
        fs::remove_file(own.join(name)).expect("removed");
    }
    // What a report wrote, one replaces; one of 0.1.0 too, whose Parquet files do not say what they are.
    assert_eq!([report(), report()].map(|again| again.status.code()), [Some(0); 2]);
    fs::write(own.join("table.csv"), "estimate,scored_on,a1\n").expect("written");
    fs::write(own.join("table.parquet"), "PAR1").expect("written");
    assert_eq!(report().status.code(), Some(0));
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
    let whole =
        depthloom().args(["run", "--no-page"]).arg(&main).arg("--out").arg(&out).output().expect("the binary starts");
    assert_eq!(whole.status.code(), Some(0), "{}", said(&whole));
    assert_eq!(fs::read_dir(out.join("models")).expect("models").count(), 2);
    // All of it is known as a run's.
    let again = depthloom().args(["run", "--no-page"]).arg(&main).arg("--out").arg(&out).arg("--overwrite").output();
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
            command.current_dir(here("elsewhere")).args([
                "run",
                "--no-page",
                "../exps/main.yaml",
                "--overwrite",
                "--out",
                out,
            ]);
            let refused = command.output().expect("the binary starts");
            assert_eq!(refused.status.code(), Some(2), "{text}: {}", said(&refused));
            assert!(said(&refused).contains("which this run reads"), "{text}: {}", said(&refused));
        }
        let before = fs::read(here("old/experiment.yaml")).expect("it is there");
        assert!(!before.is_empty() && here("old/recording.mcap").is_file());
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
