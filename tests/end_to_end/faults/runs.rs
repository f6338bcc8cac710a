//! Faults in the handling of the folder of runs.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use super::small::{stderr_of, under};
use crate::runs::{Here, json_of};
use crate::support::succeed;

/// Runs the program in a folder. Panics if it hangs.
fn guarded(here: &Here, arguments: &[&str]) -> Output {
    let mut command = under("timeout", &["300"]);
    let output = command.current_dir(here.path()).env_remove("DEPTHLOOM_FRESH").args(arguments).output();
    let output = output.expect("it starts");
    assert_ne!(output.status.code(), Some(124), "{arguments:?} hangs");
    output
}

/// Creates a folder with the marker file of a run.
fn make_marked(folder: &Path) {
    fs::create_dir_all(folder).expect("made");
    fs::write(folder.join("depthloom-run.json"), "{}").expect("written");
}

#[test]
fn fault_60_pipes_in_place_of_a_runs_files_do_not_block() {
    let here = Here::new();
    here.run("runs/first", &[]);
    let pipes = here.path().join("runs/pipes");
    make_marked(&pipes);
    for name in ["recording.mcap", "environment.json", "experiment.resolved.yaml"] {
        succeed(Command::new("mkfifo").arg(pipes.join(name)));
    }
    let listed = json_of(&guarded(&here, &["runs", "--json"]));
    let entry = listed["runs"].as_array().expect("runs").iter().find(|run| run["name"] == "pipes").expect("the entry");
    assert_eq!(entry["state"], "unreadable");
    assert!(entry["trouble"].as_str().is_some_and(|trouble| trouble.contains("it is not a regular file")), "{entry}");
    for (arguments, code) in [
        (&["runs", "show", "pipes"][..], 0),
        (&["runs", "prune", "--keep", "1"], 0),
        (&["runs", "diff", "first", "pipes"], 2),
        (&["inspect", "pipes"], 2),
        (&["inspect", "runs/pipes/recording.mcap"], 2),
        (&["runs", "recover", "runs/pipes/recording.mcap", "--out", "out.mcap"], 2),
        (&["report", "pipes"], 2),
        (&["plan", "look.yaml", "--reuse"], 0),
        (&["run", "--no-page", "look.yaml", "--quiet", "--out", "runs/second"], 0),
    ] {
        let output = guarded(&here, arguments);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", stderr_of(&output));
    }
}

#[test]
fn fault_61_an_unusable_earlier_run_is_reported_once_with_the_reason() {
    let here = Here::new();
    here.run("runs/first", &[]);
    for (name, content) in [("text", "no recording at all"), ("begun.partial", "")] {
        make_marked(&here.path().join("runs").join(name));
        fs::write(here.path().join("runs").join(name).join("recording.mcap"), content).expect("written");
    }
    let output = guarded(&here, &["run", "--no-page", "look.yaml", "--out", "runs/second"]);
    let stderr = stderr_of(&output);
    assert_eq!(stderr.matches("cannot reuse values of").count(), 1, "{stderr}");
    assert!(
        stderr.contains("cannot reuse values of runs/text: ") && stderr.contains("is not an MCAP file"),
        "{stderr}"
    );
    assert!(stderr.contains("(from runs/first;"), "{stderr}");
    let planned = json_of(&guarded(&here, &["plan", "look.yaml", "--reuse", "--json"]));
    assert_eq!(planned["warnings"].as_array().map(Vec::len), Some(1), "{planned}");
    let run = json_of(&guarded(&here, &["run", "--no-page", "look.yaml", "--json", "--out", "runs/third"]));
    assert!(run["warnings"][0].as_str().is_some_and(|warning| warning.contains("runs/text")), "{run}");
}

#[cfg(unix)]
#[test]
fn fault_62_a_link_to_a_run_is_neither_listed_nor_reused() {
    let here = Here::new();
    let first = here.run("elsewhere/first", &[]);
    fs::create_dir(here.path().join("runs")).expect("made");
    std::os::unix::fs::symlink(&first, here.path().join("runs/link")).expect("linked");
    assert_eq!(here.json(&["runs"])["runs"], serde_json::json!([]));
    let run = json_of(&guarded(&here, &["run", "--no-page", "look.yaml", "--json", "--out", "runs/second"]));
    assert_eq!(run["reused"]["from"], serde_json::json!([]), "{run}");
    // The folder of runs itself may be a link.
    fs::rename(here.path().join("runs"), here.path().join("disk")).expect("moved");
    std::os::unix::fs::symlink(here.path().join("disk"), here.path().join("runs")).expect("linked");
    assert_eq!(here.json(&["runs"])["runs"].as_array().map(Vec::len), Some(1));
    let run = json_of(&guarded(&here, &["run", "--no-page", "look.yaml", "--json", "--out", "apart/third"]));
    assert_eq!(run["reused"]["from"], serde_json::json!(["runs/second/recording.mcap"]), "{run}");
}

#[test]
fn fault_63_removing_a_run_without_permission_names_the_missing_right() {
    let here = Here::new();
    let run = here.run("runs/first", &[]);
    let make_readable = |path: &Path| succeed(Command::new("chmod").arg("755").arg(path));
    [here.path(), &here.path().join("runs"), &run].into_iter().for_each(|path| drop(make_readable(path)));
    let mut command = under("setpriv", &["--reuid=65534", "--clear-groups"]);
    let version = command.arg("--version").output();
    if !version.is_ok_and(|version| version.status.success()) {
        return crate::support::skipped(
            "fault_63_removing_a_run_without_permission_names_the_missing_right",
            "needs root and setpriv, and a binary that others may read",
        );
    }
    let mut command = under("setpriv", &["--reuid=65534", "--clear-groups"]);
    let refused = command.current_dir(here.path()).args(["runs", "rm", "first"]).output().expect("it starts");
    let stderr = stderr_of(&refused).split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(refused.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("requires write permission") && !stderr.contains("--out"), "{stderr}");
    assert!(run.join("recording.mcap").exists());
}

#[test]
fn fault_64_prune_keeps_a_run_that_another_run_reads_through_a_variable() {
    let here = Here::new();
    let first = here.run("runs/first", &[]);
    let recording =
        "extends: look.yaml\nexperiment: again\nsources: { street: { kind: mcap, with: { path: \"${FIRST}\" } } }\n";
    fs::write(here.path().join("again.yaml"), recording).expect("written");
    let again = |out: &str| {
        let mut command = here.command(&["run", "--no-page", "again.yaml", "--quiet", "--out", out]);
        succeed(command.env("FIRST", &first));
    };
    again("runs/second");
    let kept_runs = |prune: &[&str]| here.json(&[&["runs", "prune", "--dry-run"], prune].concat())["kept"].clone();
    let kept_for = |by: &str| serde_json::json!([{ "path": "runs/first", "why": format!("{by} reads it") }]);
    let prune = ["--keep", "0", "--experiment", "look"];
    assert_eq!(kept_runs(&prune), kept_for("second"));
    // An incomplete run reads it as well.
    let bytes = fs::metadata(here.path().join("runs/second/recording.mcap")).expect("a recording").len();
    succeed(&mut here.command(&["runs", "rm", "second"]));
    assert_eq!(kept_runs(&prune), serde_json::json!([]));
    let mut limited = under("prlimit", &[&format!("--fsize={}", bytes * 2 / 3)]);
    limited.current_dir(here.path()).args(["run", "--no-page", "again.yaml", "--quiet", "--out", "runs/third"]);
    let ended = limited.env("FIRST", &first).output().expect("prlimit");
    assert_eq!(ended.status.code(), Some(1), "{}", stderr_of(&ended));
    assert_eq!(kept_runs(&prune), kept_for("third.partial"));
}
