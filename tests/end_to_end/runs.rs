//! The folder of runs: listed, named by the beginning of a name, compared, and rid of what nobody needs.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value as Json, json};

use crate::support::{depthloom, succeed, workspace};

/// A folder with an experiment on two small frames, to call the program in.
struct Here {
    folder: tempfile::TempDir,
}

impl Here {
    fn new() -> Self {
        let here = Self { folder: tempfile::tempdir().expect("a folder") };
        let look = workspace().join("experiments/first-look.yaml");
        let small = "sources: { street: { with: { frames: 0..2, width: 320, height: 96 } } }";
        let text = format!("extends: {}\nexperiment: look\n{small}\n", look.display());
        std::fs::write(here.path().join("look.yaml"), text).expect("written");
        here
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = depthloom();
        command.current_dir(self.path()).args(arguments);
        command
    }

    /// Runs the experiment into a folder below.
    fn run(&self, out: &str, more: &[&str]) -> PathBuf {
        succeed(self.command(&["run", "look.yaml", "--quiet", "--out", out]).args(more));
        self.path().join(out)
    }

    fn json(&self, arguments: &[&str]) -> Json {
        json_of(&succeed(self.command(arguments).arg("--json")))
    }

    /// Calls what must end with a code; what it said on standard error.
    fn fails(&self, arguments: &[&str], code: i32) -> String {
        let output = self.command(arguments).output().expect("the binary starts");
        let said = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
        said
    }
}

fn json_of(output: &Output) -> Json {
    serde_json::from_slice(&output.stdout).expect("JSON")
}

fn text(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("UTF-8")
}

/// Says of a run that it was done at another time.
fn done_at(run: &Path, stamp: &str) {
    let file = run.join("environment.json");
    let mut environment: Json = serde_json::from_slice(&std::fs::read(&file).expect("a file")).expect("JSON");
    environment["finished_utc"] = json!(stamp);
    std::fs::write(&file, environment.to_string()).expect("written");
}

#[test]
fn runs_are_listed_newest_first_with_what_became_of_each() {
    let here = Here::new();
    assert!(here.fails(&["runs"], 2).contains("--in"), "there is no folder yet");
    done_at(&here.run("runs/look/one", &[]), "2020-11-21T10-00-00Z");
    done_at(&here.run("runs/look/two", &["--set", "look.stereo.with.block=9"]), "2020-11-22T10-00-00Z");
    // One that was cut off in the middle of its frames.
    let killed = here.path().join("runs/killed.partial");
    std::fs::create_dir(&killed).expect("made");
    std::fs::copy(here.path().join("runs/look/one/depthloom-run.json"), killed.join("depthloom-run.json"))
        .expect("copied");
    let whole = std::fs::read(here.path().join("runs/look/one/recording.mcap")).expect("a recording");
    std::fs::write(killed.join("recording.mcap"), &whole[..whole.len() * 2 / 3]).expect("written");

    let listed = here.json(&["runs"]);
    let runs = listed["runs"].as_array().expect("a list");
    let of = |key: &str| runs.iter().map(|run| run[key].clone()).collect::<Vec<_>>();
    assert_eq!(of("name"), ["killed.partial", "look/two", "look/one"]);
    assert_eq!(of("state"), ["unfinished", "whole", "whole"]);
    assert_eq!(of("frames"), [1, 2, 2]);
    assert_eq!(of("time_utc")[1..], ["2020-11-22T10:00:00Z", "2020-11-21T10:00:00Z"]);
    // The best score is the table's own.
    let first = &here.json(&["table", "runs/look/two", "--sort", "abs_rel"])["rows"][0];
    assert_eq!(runs[1]["best"], json!({ "score": "abs_rel", "value": first["abs_rel"], "estimator": "stereo" }));
    let size = |run: &Json| run["bytes"].as_u64().expect("a size");
    assert!(size(&runs[2]) > whole.len() as u64 && size(&runs[0]) < size(&runs[2]));

    let told = text(&succeed(&mut here.command(&["runs"])));
    let lines: Vec<&str> = told.lines().collect();
    assert_eq!(lines.len(), 4, "{told}");
    assert!(lines[2].starts_with("look/two ") && lines[2].contains("2020-11-22 10:00") && lines[2].contains("whole"));
}

#[test]
fn a_run_is_named_by_the_beginning_of_its_name_wherever_one_is_wanted() {
    let here = Here::new();
    done_at(&here.run("runs/look/2026-11-20", &[]), "2020-11-20T10-00-00Z");
    done_at(&here.run("runs/look/2026-11-21", &["--set", "look.stereo.with.block=9"]), "2020-11-21T10-00-00Z");
    let by_path = |day: &str| {
        let run = format!("runs/look/2026-11-{day}");
        text(&succeed(&mut here.command(&["table", &run])))
    };
    for (name, day) in [("2026-11-20", "20"), ("look/2026-11-20", "20"), ("@latest", "21"), ("look/@latest", "21")] {
        assert_eq!(text(&succeed(&mut here.command(&["table", name]))), by_path(day), "{name}");
    }
    assert_ne!(by_path("20"), by_path("21"));
    for command in ["report", "timings"] {
        succeed(&mut here.command(&[command, "2026-11-20"]));
    }
    succeed(&mut here.command(&["explain", "@latest", "abs_rel", "stereo"]));
    let said = here.fails(&["table", "look"], 2);
    assert!(said.contains("`look` names 2 runs") && said.contains("look/2026-11-21, look/2026-11-20"), "{said}");
    assert!(here.fails(&["table", "other/@latest"], 2).contains("no run of `other`"));
    assert!(here.fails(&["table", "other"], 2).contains("depthloom runs"));
    // A shell completes them.
    let mut ask = here.command(&["--", "depthloom", "table", "loo"]);
    ask.env("DEPTHLOOM_COMPLETE", "bash").env("_CLAP_IFS", "\n").env("_CLAP_COMPLETE_INDEX", "2");
    let offered = text(&succeed(&mut ask));
    assert_eq!(offered.lines().collect::<Vec<_>>(), ["look/2026-11-21", "look/2026-11-20"]);
}
