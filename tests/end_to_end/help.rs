//! Every example of every help text is run, in a folder with the files that `depthloom new` and two runs wrote.
//!
//! An example fails the test if its command fails. What follows a pipe runs if the machine has the program.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::{depthloom, succeed};

/// Options of examples that need the run with a matrix and zones.
const OF_A_MATRIX: [&str; 4] = ["--effects", "--axes", "--pareto", "--best-per-zone"];
/// Examples that may end with exit code 3: a limit may be exceeded.
const MAY_FAIL: &str = "--fail-if";

/// The long help text of a command, in lines as they were written.
fn help(command: &[&str]) -> String {
    let output = succeed(depthloom().args(command).arg("--help").env("COLUMNS", "10000"));
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// The commands that a help text lists.
fn commands_of(command: &[&str]) -> Vec<String> {
    let help = help(command);
    let lines = help.lines().take_while(|line| *line != "Options:");
    let names = lines.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
    names.filter(|name| name.starts_with(|c: char| c.is_ascii_lowercase())).map(str::to_owned).collect()
}

/// All examples of all help texts.
fn examples() -> Vec<String> {
    let mut helps = vec![help(&[])];
    for name in commands_of(&[]) {
        helps.push(help(&[&name]));
        if name == "runs" {
            helps.extend(commands_of(&["runs"]).iter().map(|below| help(&["runs", below])));
        }
    }
    let lines = helps.iter().flat_map(|help| help.lines().skip_while(|line| *line != "Examples:"));
    lines.filter(|line| line.starts_with("  depthloom ")).map(|line| line.trim().to_owned()).collect()
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("made");
    for entry in fs::read_dir(from).expect("a folder") {
        let path = entry.expect("an entry").path();
        let target = to.join(path.file_name().expect("a name"));
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).expect("copied");
        }
    }
}

/// A folder with the files that examples name.
fn prepare(folder: &Path, first: &str) {
    let run = |arguments: &[&str]| succeed(depthloom().current_dir(folder).args(arguments));
    run(&["new", first]);
    let small = |out: &str, more: &[&str]| {
        let set = ["--set", "sources.street.with={frames: 0..2, width: 320, height: 96}"];
        run(&[&["run", first, "--quiet", "--no-page", "--fresh", "--out", out], &set[..], more].concat());
    };
    small(
        "runs/first/matrix",
        &[
            "--matrix",
            "compare.stereo.with.block=[5,9]",
            "--matrix",
            "compare.fused.with.size=[3,5]",
            "--set",
            "compare.score.zones={distance_m: [0, 20, 40]}",
        ],
    );
    small("runs/first/one", &[]);
    small("runs/first/two", &["--set", "compare.stereo.with.block=7"]);
    let submit = ["submit", first, "--to", "script", "--shards", "2"];
    succeed(depthloom().env_remove("DEPTHLOOM_FRESH").current_dir(folder).args(submit));
    run(&["synth", "data", "--frames", "2", "--width", "320", "--height", "96", "--quiet"]);
    fs::rename(folder.join("data"), folder.join("street")).expect("renamed");
    // Predictions: here the ground truth itself.
    for predictions in ["preds", "sgbm"] {
        copy(&folder.join("street/training/disp_noc_0"), &folder.join(predictions));
    }
    fs::create_dir(folder.join("archive")).expect("made");
    fs::copy(folder.join("runs/first/one/recording.mcap"), folder.join("copied.mcap")).expect("copied");
    // An interrupted run: its recording has no end.
    copy(&folder.join("runs/first/one"), &folder.join("look.partial"));
    let recording = folder.join("look.partial/recording.mcap");
    let bytes = fs::read(&recording).expect("a recording");
    fs::write(&recording, &bytes[..bytes.len() - bytes.len() / 8]).expect("written");
}

/// A command line, and the program that it is piped to last. A pipe in quotes is not one.
fn last_pipe(line: &str) -> Option<(&str, &str)> {
    let pipes = line.rmatch_indices(" | ").map(|(at, _)| (&line[..at], &line[at + 3..]));
    pipes.into_iter().find(|(before, _)| before.matches('\'').count() % 2 == 0)
}

/// The example as bash runs it here: of a pipeline only the programs that exist.
fn script(example: &str) -> String {
    let mut shown = example.to_owned();
    while let Some((rest, tail)) = last_pipe(&shown) {
        let program = tail.split(' ').next().expect("a program");
        let exists = Command::new("sh").args(["-c", &format!("command -v {program}")]).output();
        if exists.is_ok_and(|output| output.status.success()) {
            break;
        }
        println!("SKIPPED {program}: it is not on this machine: {example}");
        shown = rest.to_owned();
    }
    let of_a_matrix = OF_A_MATRIX.iter().any(|option| shown.contains(option));
    let shown = if of_a_matrix { shown.replace("@latest", "first/matrix") } else { shown };
    format!("set -o pipefail; {shown}")
}

/// Runs an example in a copy of the folder; what went wrong, if it failed.
fn failure(example: &str, prepared: &Path, first: &str) -> Option<String> {
    let folder = tempfile::tempdir().expect("a folder");
    copy(prepared, folder.path());
    // What an example itself creates.
    let created = if example.contains(" new ") {
        vec![first, "street-network.onnx"]
    } else if example.contains(" synth ") {
        vec!["street"]
    } else {
        vec![]
    };
    for name in created {
        let path: PathBuf = folder.path().join(name);
        let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
    }
    let binary = Path::new(env!("CARGO_BIN_EXE_depthloom")).parent().expect("a folder");
    let path = std::env::var_os("PATH").unwrap_or_default();
    let path = std::env::join_paths(std::iter::once(binary.to_owned()).chain(std::env::split_paths(&path)));
    let output = Command::new("bash")
        .args(["-c", &script(example)])
        .current_dir(folder.path())
        .env("PATH", path.expect("a path"))
        .env("HOME", folder.path())
        .env_remove("DEPTHLOOM_RUNS")
        .output()
        .expect("bash starts");
    let code = output.status.code();
    let is_right = code == Some(0) || code == Some(3) && example.contains(MAY_FAIL);
    (!is_right).then(|| format!("{example}\n  {code:?}: {}", String::from_utf8_lossy(&output.stderr)))
}

#[test]
fn every_example_of_every_help_text_runs() {
    let first = "first.yaml";
    let prepared = tempfile::tempdir().expect("a folder");
    prepare(prepared.path(), first);
    let examples = examples();
    assert!(examples.len() > 60, "{examples:#?}");
    let failures: Vec<String> =
        examples.iter().filter_map(|example| failure(example, prepared.path(), first)).collect();
    assert!(failures.is_empty(), "{} of {} examples fail:\n{}", failures.len(), examples.len(), failures.join("\n"));
}

#[test]
fn removed_names_give_an_error_with_the_corrected_command() {
    for (arguments, corrected) in [
        (&["data", "street"][..], "depthloom inspect street"),
        (&["onnx", "net.onnx"], "depthloom inspect net.onnx"),
        (&["info", "RUN", "--check"], "depthloom inspect RUN --verify-bytes"),
        (&["replay", "RUN", "--check"], "depthloom verify RUN"),
        (&["runs", "why", "A", "B"], "depthloom runs diff A B"),
        (&["timings", "RUN"], "depthloom runs timings RUN"),
        (&["recover", "RUN.partial"], "depthloom runs recover RUN.partial"),
        (&["samples", "RUN"], "depthloom analyse --samples-only RUN"),
        (&["table", "RUN", "--set", "valid"], "depthloom table RUN --pixels valid"),
        (&["compare", "A", "B", "--scores", "d1"], "depthloom compare A B --metrics d1"),
        (&["runs", "--in", "archive"], "depthloom runs --runs archive"),
        (&["schema", "--output", "run"], "depthloom schema --of run"),
    ] {
        let output = depthloom().args(arguments).output().expect("it runs");
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text.contains("renamed to `") && text.contains(&format!("tip: use `{corrected}`")), "{text}");
        assert!(output.stdout.is_empty(), "{arguments:?}");
    }
}

#[test]
fn the_folder_of_runs_is_an_option_or_a_variable() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = |arguments: &[&str]| {
        let mut command = depthloom();
        command.current_dir(folder.path()).args(arguments).env_remove("DEPTHLOOM_RUNS");
        command
    };
    succeed(&mut here(&["new", "first.yaml"]));
    let set = ["--set", "sources.street.with={frames: 0..1, width: 160, height: 64}"];
    let run = [&["run", "first.yaml", "--quiet", "--no-page"], &set[..]].concat();
    succeed(here(&run).args(["--runs", "archive"]));
    assert!(folder.path().join("archive/first").is_dir() && !folder.path().join("runs").exists());
    for command in [&["table", "@latest"][..], &["runs", "timings", "@latest"], &["inspect", "@latest"]] {
        succeed(here(command).args(["--runs", "archive"]));
        succeed(here(command).env("DEPTHLOOM_RUNS", "archive"));
        assert_eq!(here(command).output().expect("it runs").status.code(), Some(2), "{command:?}");
    }
    // The option takes precedence.
    succeed(here(&["table", "@latest", "--runs", "archive"]).env("DEPTHLOOM_RUNS", "nowhere"));
}
