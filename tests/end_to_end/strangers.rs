//! Untrusted files: folders with links and pipes, and texts with control characters.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use depthloom_graphs::language::{Options, load};
use depthloom_graphs::ready::Ready;
use depthloom_recording::Recorder;
use depthloom_runner::{Interrupt, Unwatched};

use crate::support::{depthloom, succeed, workspace};

/// A small run in a folder.
fn small_run(folder: &Path) -> PathBuf {
    let out = folder.join("run");
    let small = ["frames=0..1", "width=160", "height=48"].map(|set| format!("--set=sources.street.with.{set}"));
    succeed(depthloom().args(["run", "experiments/first-look.yaml", "--quiet", "--out"]).arg(&out).args(small));
    out
}

fn report(run: &Path, out: &Path) -> Output {
    // A report that waits for a pipe is killed.
    let binary = depthloom();
    let mut command = Command::new("timeout");
    command.args(["--signal=KILL", "100"]).arg(binary.get_program()).arg("report").arg(run).arg("--out").arg(out);
    command.output().expect("started")
}

fn make_pipe(path: &Path) {
    succeed(Command::new("mkfifo").arg(path));
}

const REPORTS: [&str; 6] = ["scores.csv", "table.csv", "table.md", "table.tex", "scores.parquet", "report.html"];

#[test]
fn fault_11_a_report_does_not_follow_links_in_a_run_folder() {
    use std::os::unix::fs::symlink;

    let folder = tempfile::tempdir().expect("a folder");
    let run = small_run(folder.path());
    let precious = folder.path().join(".bashrc");
    fs::write(&precious, "years").expect("written");
    for name in REPORTS {
        let path = run.join(name);
        fs::remove_file(&path).expect("removed");
        for link in [path, run.join(format!("{name}.partial")), run.join(format!("{name}.1.partial"))] {
            symlink(&precious, link).expect("linked");
        }
    }
    let output = report(&run, &run);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(fs::read_to_string(&precious).expect("the file"), "years");
    assert!(REPORTS.iter().all(|name| !run.join(name).is_symlink()));
}

#[test]
fn fault_11_pipes_do_not_block_a_report() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = small_run(folder.path());
    make_pipe(&run.join("table.md.partial"));
    let output = report(&run, &run);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // A pipe in place of the file itself is not replaced.
    fs::remove_file(run.join("table.md")).expect("removed");
    make_pipe(&run.join("table.md"));
    let output = report(&run, &run);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("table.md") && stderr.contains("not a regular file"), "{stderr}");
}

#[test]
fn a_report_does_not_replace_the_users_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = small_run(folder.path());
    for name in ["scores.csv", "table.md", "error_vs_distance.svg"] {
        let own = folder.path().join(format!("own-{name}"));
        fs::create_dir(&own).expect("a folder");
        // The file starts like a table of a report.
        fs::write(own.join(name), "stage,variant,mine\n").expect("written");
        let output = report(&run, &own);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && stderr.contains(name), "{stderr}");
        assert_eq!(fs::read_to_string(own.join(name)).expect("the file"), "stage,variant,mine\n");
        assert_eq!(fs::read_dir(&own).expect("a folder").count(), 1);
    }
    // It replaces its own earlier files, and keeps other files in the folder.
    let notes = folder.path().join("notes");
    fs::create_dir(&notes).expect("a folder");
    fs::write(notes.join("notes.txt"), "mine").expect("written");
    for _ in 0..2 {
        let output = report(&run, &notes);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert_eq!(fs::read_to_string(notes.join("notes.txt")).expect("the file"), "mine");
}

/// Experiments with control characters in names and texts.
const HOSTILE: [(&str, &str); 3] = [
    (
        "esc.yaml",
        r#"
experiment: x
sources: { s: { kind: "synthetic/\e]0;OWNED\a\e[2Kroad", with: {} } }
stages: { look: { source: s, nodes: {} } }
"#,
    ),
    (
        "dora.yaml",
        r#"
experiment: d
description: "see \e[8mthis\u202e\u009b2K"
sources: { s: { kind: synthetic/road, with: { frames: 0..2, width: 160, height: 48 } } }
stages:
  look:
    source: s
    nodes:
      far: { kind: dora, inputs: { depth: source/depth }, with: { path: "rm -rf ~\e[2K\rerror: node `look.far` (dora): it would start `ls", ports: { inputs: { depth: depth }, outputs: { far: mask } } } }
"#,
    ),
    // Unescaped control characters.
    ("raw.yaml", "experiment: x\nsources: { s\u{9b}2K\u{202e}: 1 }\nnodes: \u{85}\u{2066}\n"),
];

#[test]
fn fault_13_control_characters_from_files_are_not_printed() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in HOSTILE {
        let path = folder.path().join(name);
        fs::write(&path, text).expect("written");
        for command in [
            &["check"][..],
            &["check", "--json"],
            &["check", "--sarif"],
            &["plan"],
            &["plan", "--json"],
            &["graph"],
            &["graph", "--format", "dot"],
            &["dora"],
            &["run", "--json"],
            &["--color", "always", "check"],
        ] {
            let mut printed = depthloom();
            printed.args(command).arg(&path).current_dir(folder.path());
            let output = printed.output().expect("started");
            for stream in [&output.stdout, &output.stderr] {
                let mut text = String::from_utf8(stream.clone()).expect("UTF-8");
                if command[0] == "--color" {
                    for own in ["\u{1b}[0m", "\u{1b}[31m", "\u{1b}[36m", "\u{1b}[1m", "\u{1b}[4m"] {
                        text = text.replace(own, "");
                    }
                    // Other sequences of miette end in `m`; these here would not come from it.
                    assert!(!text.contains("\u{1b}]") && !text.contains("\u{1b}[2K") && !text.contains("\u{1b}[8m"));
                    continue;
                }
                let is_control = |c: char| {
                    c.is_control() && !matches!(c, '\n' | '\t')
                        || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
                };
                assert!(!text.contains(is_control), "{name} {command:?}: {text:?}");
            }
        }
    }
}

#[test]
fn fault_13_the_permission_error_escapes_the_command() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("dora.yaml");
    fs::write(&path, HOSTILE[1].1).expect("written");
    let output = depthloom().arg("dora").arg(&path).env("HOME", folder.path()).env_remove("XDG_CONFIG_HOME").output();
    let output = output.expect("started");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains(r#"it would start `"rm -rf ~\u{1b}[2K\rerror: node"#), "{stderr}");
}

/// Writes a forged run: its recording has the values of one experiment under the keys of another.
fn forge(experiment: &Path, folder: &Path) {
    let registry = depthloom::registry();
    let ready = |set: &[(String, String)]| {
        let options = Options { set: set.to_vec(), ..Options::default() };
        let plan = load(experiment, &registry, &options).expect("a valid experiment").plan;
        Ready::new(plan, &registry).unwrap_or_else(|missing| panic!("{missing:?}"))
    };
    let claimed = ready(&[]).plan;
    let mut other = ready(&[("look.stereo.with.block".to_owned(), "11".to_owned())]);
    for (run, claimed) in other.plan.runs.iter_mut().zip(&claimed.runs) {
        for (node, claimed) in run.nodes.iter_mut().zip(&claimed.nodes) {
            node.node_hash = claimed.node_hash;
        }
    }
    fs::create_dir_all(folder).expect("made");
    fs::write(folder.join("depthloom-run.json"), "{}").expect("written");
    let recorder = Recorder::create(folder.join("recording.mcap"), &claimed).expect("a recording");
    let options = depthloom_runner::Options::default();
    depthloom_runner::run(other, &recorder, &options, &Unwatched, &Interrupt::default()).expect("it runs");
    recorder.finish(&[]).expect("closed");
}

#[test]
fn suspicion_g_wrong_values_under_valid_keys_are_detected() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = workspace().join("experiments/first-look.yaml");
    forge(&experiment, &folder.path().join("runs/forged"));
    let out = folder.path().join("runs/mine");
    let mut run = depthloom();
    run.args(["run", "--no-page"]).arg(&experiment).arg("--out").arg(&out).env_remove("DEPTHLOOM_FRESH");
    let output = run.current_dir(folder.path()).output().expect("started");
    // A sample of the reused values is recomputed. Wrong values fail the run, and the error names their recording.
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "{stderr}");
    assert!(stderr.contains("a reused value is not what") && stderr.contains("forged"), "{stderr}");
}
