//! The folder of runs: listing, selection by name, comparison, and removal.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value as Json, json};

use crate::support::{depthloom, succeed, workspace};

/// A folder with an experiment on two small frames, as working folder of the program.
pub(crate) struct Here {
    folder: tempfile::TempDir,
}

impl Here {
    pub(crate) fn new() -> Self {
        let here = Self { folder: tempfile::tempdir().expect("a folder") };
        let look = workspace().join("experiments/first-look.yaml");
        let small = "sources: { street: { with: { frames: 0..2, width: 320, height: 96 } } }";
        let text = format!("extends: {}\nexperiment: look\n{small}\n", look.display());
        std::fs::write(here.path().join("look.yaml"), text).expect("written");
        here
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = depthloom();
        command.current_dir(self.path()).args(arguments);
        command
    }

    /// Runs the experiment into the folder `out`.
    pub(crate) fn run(&self, out: &str, more: &[&str]) -> PathBuf {
        succeed(self.command(&["run", "--no-page", "look.yaml", "--quiet", "--out", out]).args(more));
        self.path().join(out)
    }

    pub(crate) fn json(&self, arguments: &[&str]) -> Json {
        json_of(&succeed(self.command(arguments).arg("--json")))
    }

    /// Runs a command that must end with this exit code. Returns standard error.
    pub(crate) fn fails(&self, arguments: &[&str], code: i32) -> String {
        let output = self.command(arguments).output().expect("the binary starts");
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {stderr}");
        stderr
    }
}

pub(crate) fn json_of(output: &Output) -> Json {
    serde_json::from_slice(&output.stdout).expect("JSON")
}

pub(crate) fn text(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("UTF-8")
}

/// Sets the time at which a run finished.
fn set_finished(run: &Path, stamp: &str) {
    let file = run.join("environment.json");
    let mut environment: Json = serde_json::from_slice(&std::fs::read(&file).expect("a file")).expect("JSON");
    environment["finished_utc"] = json!(stamp);
    std::fs::write(&file, environment.to_string()).expect("written");
}

#[test]
fn runs_are_listed_newest_first_with_their_state() {
    let here = Here::new();
    assert!(here.fails(&["runs"], 2).contains("--runs"), "there is no folder of runs yet");
    set_finished(&here.run("runs/look/one", &[]), "2020-11-21T10-00-00Z");
    set_finished(&here.run("runs/look/two", &["--set", "look.stereo.with.block=9"]), "2020-11-22T10-00-00Z");
    // A run that was killed in the middle of its frames.
    let killed = here.path().join("runs/killed.partial");
    std::fs::create_dir(&killed).expect("made");
    std::fs::copy(here.path().join("runs/look/one/depthloom-run.json"), killed.join("depthloom-run.json"))
        .expect("copied");
    let recording = std::fs::read(here.path().join("runs/look/one/recording.mcap")).expect("a recording");
    std::fs::write(killed.join("recording.mcap"), &recording[..recording.len() * 2 / 3]).expect("written");

    let listed = here.json(&["runs"]);
    let runs = listed["runs"].as_array().expect("a list");
    let column = |key: &str| runs.iter().map(|run| run[key].clone()).collect::<Vec<_>>();
    assert_eq!(column("name"), ["killed.partial", "look/two", "look/one"]);
    assert_eq!(column("state"), ["unfinished", "complete", "complete"]);
    assert_eq!(column("frames"), [1, 2, 2]);
    assert_eq!(column("time_utc")[1..], ["2020-11-22T10:00:00Z", "2020-11-21T10:00:00Z"]);
    // The best value equals that of the table.
    let first = &here.json(&["table", "runs/look/two", "--sort", "abs_rel"])["rows"][0];
    assert_eq!(
        runs[1]["best"],
        json!({ "score": "abs_rel", "value": first["abs_rel"], "stage": "look", "variant": null, "estimate": "stereo" })
    );
    let size = |run: &Json| run["bytes"].as_u64().expect("a size");
    assert!(size(&runs[2]) > recording.len() as u64 && size(&runs[0]) < size(&runs[2]));

    let printed = text(&succeed(&mut here.command(&["runs"])));
    let lines: Vec<&str> = printed.lines().collect();
    assert_eq!(lines.len(), 4, "{printed}");
    assert!(
        lines[2].starts_with("look/two ") && lines[2].contains("2020-11-22 10:00") && lines[2].contains("complete")
    );
}

#[test]
fn a_recording_of_0_1_is_refused_and_does_not_disturb_a_run() {
    let here = Here::new();
    let old = here.path().join("runs/old");
    std::fs::create_dir_all(&old).expect("made");
    let fixture = workspace().join("tests/fixtures/runs-0.1/fresh");
    for file in std::fs::read_dir(fixture).expect("fixtures").flatten() {
        std::fs::copy(file.path(), old.join(file.file_name())).expect("copied");
    }
    let refused = here.command(&["table", "runs/old"]).output().expect("it runs");
    assert_eq!(refused.status.code(), Some(2));
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(message.contains("has recording format 4") && message.contains("depthloom 0.1"), "{message}");
    let listed = here.json(&["runs"]);
    assert_eq!(listed["runs"][0]["state"], "unreadable", "{listed}");
    let run = succeed(
        here.command(&["run", "--no-page", "look.yaml", "--quiet", "--out", "runs/now"]).env_remove("DEPTHLOOM_FRESH"),
    );
    assert_eq!(String::from_utf8_lossy(&run.stderr), "");
}

#[test]
fn an_earlier_run_that_cannot_be_read_is_reported() {
    let here = Here::new();
    let first = here.run("runs/first", &[]);
    let recording = first.join("recording.mcap");
    let bytes = std::fs::read(&recording).expect("a recording");
    let unfinished = here.path().join("runs/second.partial");
    std::fs::create_dir(&unfinished).expect("made");
    std::fs::copy(first.join("depthloom-run.json"), unfinished.join("depthloom-run.json")).expect("copied");
    // A finished run with only the head of its recording is damaged. An unfinished run may have just started.
    for (path, length) in [(&recording, 40), (&recording, 3), (&unfinished.join("recording.mcap"), 40)] {
        std::fs::write(path, &bytes[..length]).expect("written");
    }
    let mut run = here.command(&["run", "--no-page", "look.yaml", "--out", "runs/third"]);
    let output = succeed(run.env_remove("DEPTHLOOM_FRESH"));
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(stderr.contains("cannot reuse values of runs/first: "), "{stderr}");
    assert!(!stderr.contains("second"), "{stderr}");
}

#[test]
fn the_time_of_a_run_is_measured_after_its_page() {
    let here = Here::new();
    let run = here.path().join("run");
    succeed(&mut here.command(&["run", "look.yaml", "--quiet", "--out", "run"]));
    let environment: Json =
        serde_json::from_slice(&std::fs::read(run.join("environment.json")).expect("a file")).expect("JSON");
    assert!(environment["wall_s"].as_f64().is_some_and(|seconds| seconds > 0.0), "{environment}");
    let page = std::fs::read_to_string(run.join("report.html")).expect("a page");
    assert!(!page.contains("\"wall_s\":"), "the page cannot contain the time that it takes itself");
}

#[test]
fn every_command_accepts_a_run_by_name_or_prefix() {
    let here = Here::new();
    set_finished(&here.run("runs/look/2026-11-20", &[]), "2020-11-20T10-00-00Z");
    set_finished(&here.run("runs/look/2026-11-21", &["--set", "look.stereo.with.block=9"]), "2020-11-21T10-00-00Z");
    let by_path = |day: &str| {
        let run = format!("runs/look/2026-11-{day}");
        text(&succeed(&mut here.command(&["table", &run])))
    };
    for (name, day) in [("2026-11-20", "20"), ("look/2026-11-20", "20"), ("@latest", "21"), ("look/@latest", "21")] {
        assert_eq!(text(&succeed(&mut here.command(&["table", name]))), by_path(day), "{name}");
    }
    assert_ne!(by_path("20"), by_path("21"));
    succeed(&mut here.command(&["report", "2026-11-20"]));
    succeed(&mut here.command(&["runs", "timings", "2026-11-20"]));
    succeed(&mut here.command(&["explain", "@latest", "abs_rel", "stereo"]));
    let error = here.fails(&["table", "look"], 2);
    assert!(error.contains("`look` names 2 runs") && error.contains("look/2026-11-21, look/2026-11-20"), "{error}");
    assert!(here.fails(&["table", "other/@latest"], 2).contains("no run of `other`"));
    assert!(here.fails(&["table", "other"], 2).contains("depthloom runs"));
    // Shell completion of run names.
    let mut complete = here.command(&["--", "depthloom", "table", "loo"]);
    complete.env("DEPTHLOOM_COMPLETE", "bash").env("_CLAP_IFS", "\n").env("_CLAP_COMPLETE_INDEX", "2");
    let completions = text(&succeed(&mut complete));
    assert_eq!(completions.lines().collect::<Vec<_>>(), ["look/2026-11-21", "look/2026-11-20"]);
}

#[test]
fn differences_of_runs_are_listed_by_parameter_source_and_consumers() {
    let here = Here::new();
    let first = here.run("runs/first", &[]);
    here.run("runs/again", &[]);
    here.run("runs/block", &["--set", "look.stereo.with.block=9"]);
    here.run("runs/street", &["--set", "sources.street.with.frames=1..3", "--set", "sources.street.with.seed=7"]);

    let same = here.json(&["runs", "diff", "first", "again"]);
    assert_eq!((&same["experiment"], &same["made_by"]), (&json!([]), &json!([])));
    assert!(same["nodes"].as_array().expect("nodes").iter().all(|node| node["same"] == true), "{same}");
    let printed = text(&succeed(&mut here.command(&["runs", "diff", "first", "again"])));
    assert!(
        printed.ends_with("\nall nodes are the same, and so are their values on all frames in both\n"),
        "{printed}"
    );

    // The penalties differ as well, because their defaults depend on the block size.
    let block = here.json(&["runs", "diff", "first", "block"]);
    let set = json!([{ "what": "parameter", "path": "stages.look.nodes.stereo.with", "before": null, "after": { "block": 9 } }]);
    assert_eq!(block["experiment"], set);
    let node = |comparison: &Json, name: &str| -> Json {
        let nodes = comparison["nodes"].as_array().expect("nodes");
        nodes.iter().find(|node| node["node"] == name).unwrap_or_else(|| panic!("{name} in {comparison}")).clone()
    };
    let changed: Vec<String> = node(&block, "stereo")["differences"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|difference| format!("{} {} {}", difference["path"], difference["before"], difference["after"]))
        .collect();
    assert_eq!(changed, ["\"block\" 5 9", "\"p1\" 200 648", "\"p2\" 800 2592"]);
    assert_eq!(
        node(&block, "depth")["differences"],
        json!([{ "what": "upstream", "port": "disparity", "from": "stereo/disparity" }])
    );
    assert_eq!(
        block["frames"],
        json!([{ "stage": "look", "source": [], "both": 2, "same": 2, "only_before": 0, "only_after": 0 }])
    );

    let printed = text(&succeed(&mut here.command(&["runs", "diff", "first", "block"])));
    assert!(printed.contains("\nnodes\n  look.stereo  block: 5 -> 9; p1: 200 -> 648; p2: 800 -> 2592\n"), "{printed}");
    assert!(
        printed.contains("\nnodes that differ because they read those\n  look.depth, look.score.stereo\n"),
        "{printed}"
    );

    // Other frames: every node is the same, but its values differ.
    let street = here.json(&["runs", "diff", "first", "street"]);
    let frames = &street["frames"][0];
    assert_eq!((&frames["both"], &frames["same"], &frames["only_before"]), (&json!(1), &json!(0), &json!(1)));
    let stereo = node(&street, "stereo");
    assert_eq!((&stereo["differences"], &stereo["same"]), (&json!([]), &json!(false)));
    let printed = text(&succeed(&mut here.command(&["runs", "diff", "first", "street"])));
    assert!(printed.contains("source of look: seed: 1 -> 7"), "{printed}");
    assert!(
        printed.contains("read other values\n  look.stereo (0 of 1 equal), look.depth (0 of 1 equal)"),
        "{printed}"
    );

    // Recordings outside of the folder of runs can be compared as well.
    let copy = here.path().join("copy.mcap");
    std::fs::copy(first.join("recording.mcap"), copy).expect("copied");
    assert_eq!(here.json(&["runs", "diff", "copy.mcap", "block"])["nodes"], block["nodes"]);
    // Without a common frame, no values are compared.
    here.run("runs/later", &["--set", "sources.street.with.frames=7..9"]);
    let printed = text(&succeed(&mut here.command(&["runs", "diff", "first", "later"])));
    assert!(printed.contains("look: 0 in both, 2 only before, 2 only after"), "{printed}");
    let message = "all nodes are the same; no values were compared, because no frame with values is in both runs";
    assert!(printed.contains(message) && !printed.contains("so are their values"), "{printed}");
    assert!(here.fails(&["runs", "diff", "first", "none"], 2).contains("none"));
}

#[test]
fn runs_show_prints_how_a_run_was_made_and_its_files() {
    let here = Here::new();
    let run = here.run("runs/first", &["-j", "1"]);
    let shown = here.json(&["runs", "show", "first"]);
    assert_eq!(
        (&shown["name"], &shown["state"], &shown["experiment"]),
        (&json!("first"), &json!("complete"), &json!("look"))
    );
    let stage = json!({ "stage": "look", "variant": null, "frames": 2, "source": "street", "source_kinds": ["synthetic/road"], "nodes": 3, "models": [] });
    assert_eq!(shown["stages"], json!([stage]));
    assert_eq!(shown["environment"]["workers"], 1);
    let files = shown["files"].as_array().expect("files");
    let size = std::fs::metadata(run.join("recording.mcap")).expect("a recording").len();
    assert!(files.contains(&json!({ "name": "recording.mcap", "bytes": size })), "{files:?}");
    assert_eq!(files.len(), std::fs::read_dir(&run).expect("a folder").count());
    let printed = text(&succeed(&mut here.command(&["runs", "show", "@latest"])));
    assert!(
        printed.contains("-j 1") && printed.contains("look: 2 frames of street (synthetic/road), 3 nodes"),
        "{printed}"
    );
    let error = here.fails(&["runs", "show", "look.yaml"], 2);
    assert!(error.contains("look.yaml is not a run: it is a file"), "{error}");
}

#[test]
fn info_reports_topics_sizes_keys_and_damage() {
    let here = Here::new();
    let run = here.run("runs/first", &[]);
    let recording = run.join("recording.mcap");
    let info = here.json(&["inspect", "first", "--keys", "--verify-bytes"]);
    assert_eq!((&info["condition"], &info["checked"], &info["damage"]), (&json!("complete"), &json!(true), &json!([])));
    let topics = info["topics"].as_array().expect("topics");
    let topic = |name: &str| topics.iter().find(|topic| topic["topic"] == name).unwrap_or_else(|| panic!("{name}"));
    let depth = topic("/look/depth/depth");
    assert_eq!((&depth["type"], &depth["messages"], &depth["keys"]), (&json!("depth"), &json!(2), &json!(2)));
    let raw = topic("/look/stereo/disparity")["raw_bytes"].as_u64().expect("a size");
    assert!((2 * 320 * 96 * 2..2 * 320 * 96 * 2 + 400).contains(&raw), "{raw}");
    // The node hash equals that of the plan, and keys are listed by frame and node.
    let plan = here.json(&["plan", "look.yaml"]);
    let planned = plan["runs"][0]["nodes"].as_array().expect("nodes").iter().find(|node| node["name"] == "depth");
    assert_eq!(depth["node_hash"], planned.expect("depth")["node_hash"]);
    let keys = info["keys"].as_array().expect("keys");
    assert_eq!(keys.len(), 2 * 4, "a source and three nodes on two frames");
    // The topics take a part of the file's size; attachments and the rest take the remainder.
    let stored: u64 = topics.iter().map(|topic| topic["stored_bytes"].as_u64().expect("a size")).sum();
    let size = std::fs::metadata(&recording).expect("a recording").len();
    assert!(info["bytes"] == size && stored < size && stored > size / 2, "{stored} of {size}");
    let text = text(&succeed(&mut here.command(&["inspect", "first"])));
    assert!(
        text.contains("recording.mcap: complete according to its summary; --verify-bytes reads every byte\n"),
        "{text}"
    );

    // A flipped bit within a chunk is found only with `--check`, which reads every byte.
    let mut bytes = std::fs::read(&recording).expect("a recording");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&recording, &bytes).expect("written");
    succeed(&mut here.command(&["inspect", "first"]));
    let output = here.command(&["inspect", "first", "--verify-bytes"]).output().expect("the binary starts");
    let printed = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(
        printed.lines().next().is_some_and(|line| line.ends_with("recording.mcap: damaged in 1 place")),
        "{printed}"
    );
    let output = here.command(&["inspect", "first", "--verify-bytes", "--json"]).output().expect("the binary starts");
    assert_eq!(output.status.code(), Some(3));
    let info = json_of(&output);
    assert_eq!((&info["condition"], &info["error"]["exit_code"]), (&json!("damaged"), &json!(3)));
    let damage = &info["damage"][0];
    let from = damage["offset"].as_u64().expect("a place") as usize;
    assert!((from..from + damage["bytes"].as_u64().expect("a size") as usize).contains(&middle), "{damage}");
}

#[test]
fn runs_rm_removes_all_named_runs_or_none() {
    let here = Here::new();
    let (first, second) = (here.run("runs/first", &[]), here.run("runs/second", &[]));
    let third = here.run("runs/third", &[]);
    std::fs::write(second.join("notes.txt"), "years").expect("written");
    let error = here.fails(&["runs", "rm", "first", "second"], 2);
    assert!(error.contains("it contains notes.txt, which no run wrote"), "{error}");
    assert!(first.exists() && second.exists(), "no run is removed if one of them must not be removed");
    let refused = here.fails(&["runs", "rm", "fir"], 2);
    assert!(
        refused.contains("no run in runs is named `fir`") && refused.contains("`first` begins with it"),
        "{refused}"
    );
    let removed = text(&succeed(&mut here.command(&["runs", "rm", "first", "runs/third", "runs/first"])));
    let lines: Vec<&str> = removed.lines().collect();
    assert!(
        lines.len() == 2
            && lines[0].starts_with("removed runs/first (")
            && lines[1].starts_with("removed runs/third (")
    );
    assert!(!first.exists() && !third.exists());
    assert_eq!(std::fs::read_to_string(second.join("notes.txt")).expect("a file"), "years");
    let wrong =
        [("first", "it does not exist"), ("look.yaml", "it is a file"), ("runs", "it is a folder, but not of a run")];
    for (wrong, why) in wrong {
        let error = here.fails(&["runs", "rm", wrong], 2);
        assert!(error.contains(&format!("{wrong} is not removed: {why}")), "{error}");
    }
    std::fs::remove_file(second.join("notes.txt")).expect("removed");
    let removed = here.json(&["runs", "rm", "@latest"]);
    assert!(removed["removed"][0]["path"] == "runs/second" && removed["bytes"].as_u64().is_some_and(|bytes| bytes > 0));
    assert_eq!(std::fs::read_dir(here.path().join("runs")).expect("a folder").count(), 0);
}

#[test]
fn prune_keeps_runs_by_its_rules_and_runs_that_others_read() {
    let here = Here::new();
    let runs: Vec<PathBuf> = (1..=4).map(|day| format!("runs/look/{day}")).map(|out| here.run(&out, &[])).collect();
    for (day, run) in (1..).zip(&runs) {
        set_finished(run, &format!("2020-11-0{day}T10-00-00Z"));
    }
    // Another experiment reads the oldest run.
    std::fs::write(here.path().join("other.yaml"), "extends: look.yaml\nexperiment: other\n").expect("written");
    succeed(&mut here.command(&["run", "--no-page", "other.yaml", "--quiet", "--out", "runs/other"]));
    let resolved = here.path().join("runs/other/experiment.resolved.yaml");
    let mut text_of = std::fs::read_to_string(&resolved).expect("a file");
    let oldest = runs[0].canonicalize().expect("a folder");
    text_of.push_str(&format!("# model: {}/models/learn.train.onnx\n", oldest.display()));
    std::fs::write(&resolved, text_of).expect("written");

    assert!(here.fails(&["runs", "prune"], 2).contains("--keep"), "a rule is required");
    let planned = here.json(&["runs", "prune", "--keep", "1", "--experiment", "look", "--dry-run"]);
    let paths = |prune: &Json| -> Vec<Json> {
        prune["removed"].as_array().expect("a list").iter().map(|run| run["path"].clone()).collect()
    };
    assert_eq!(paths(&planned), ["runs/look/2", "runs/look/3"]);
    assert_eq!(planned["kept"], json!([{ "path": "runs/look/1", "why": "other reads it" }]));
    assert!(runs.iter().all(|run| run.exists()), "a dry run removes nothing");

    let printed = text(&succeed(&mut here.command(&["runs", "prune", "--older-than", "3d", "--keep", "2"])));
    let lines: Vec<&str> = printed.lines().collect();
    assert!(
        lines[0].starts_with("removed runs/look/2 (") && lines[1] == "kept runs/look/1: other reads it",
        "{printed}"
    );
    assert!(lines[2].starts_with("removed 1 of 5 runs, "), "{printed}");
    assert_eq!(runs.iter().map(|run| run.exists()).collect::<Vec<_>>(), [true, false, true, true]);
    // An unknown experiment has no runs. All remaining runs can be removed, because no other run reads them.
    assert_eq!(paths(&here.json(&["runs", "prune", "--keep", "0", "--experiment", "none"])), [""; 0]);
    assert_eq!(paths(&here.json(&["runs", "prune", "--max-size", "0"])).len(), 4);
    assert_eq!(here.json(&["runs"])["runs"], json!([]));
}

#[test]
fn runs_are_tagged_noted_and_selected_by_conditions() {
    let here = Here::new();
    here.run("runs/five", &[]);
    here.run("runs/nine", &["--set", "look.stereo.with.block=9"]);
    let printed = |arguments: &[&str]| text(&succeed(&mut here.command(arguments)));
    let list = |conditions: &[&str]| {
        let conditions = conditions.iter().flat_map(|condition| ["--where", condition]);
        let arguments: Vec<&str> = ["runs", "list", "--names"].into_iter().chain(conditions).collect();
        printed(&arguments)
    };
    assert_eq!(list(&["look.stereo.with.block=9"]), "nine\n");
    // The default of the kind counts, although the experiment does not write it.
    assert_eq!(list(&["look.stereo.with.block<9"]), "five\n");
    assert_eq!(list(&["look.stereo.kind=stereo/sgbm", "sources.street.with.width=320", "frames=2"]), "nine\nfive\n");
    assert_eq!(list(&["state=complete", "best>1000"]), "");
    let sources = workspace().join("experiments");
    assert_eq!(list(&[&format!("look.stereo.with.block!={}", sources.display())]), "nine\nfive\n");
    let unknown = here.fails(&["runs", "list", "--where", "look.stereo.with.blok=9"], 2);
    assert!(unknown.contains("no run has `look.stereo.with.blok`"), "{unknown}");
    assert!(unknown.contains("look.stereo.with.block"), "{unknown}");
    assert!(here.fails(&["runs", "list", "--where", "block"], 2).contains("a condition is PATH=VALUE"));

    assert_eq!(printed(&["runs", "tag", "nine", "paper", "draft"]), "draft\npaper\n");
    assert_eq!(printed(&["runs", "tag", "nine", "draft", "--remove"]), "paper\n");
    assert!(here.fails(&["runs", "tag", "nine", "draft", "--remove"], 2).contains("has no tag `draft`"));
    assert!(here.fails(&["runs", "tag", "nine", "a b"], 2).contains("a tag has 1 to 64 letters"));
    printed(&["runs", "note", "five", "the default\nof OpenCV"]);
    assert_eq!(printed(&["runs", "note", "five"]), "the default\nof OpenCV\n");
    assert_eq!((list(&["tag=paper"]), list(&["tag!=paper"])), ("nine\n".to_owned(), "five\n".to_owned()));
    let table = printed(&["runs"]);
    assert!(table.contains("tags") && table.contains("paper") && table.contains("the default..."), "{table}");
    let shown = here.json(&["runs", "show", "five"]);
    assert_eq!((&shown["note"], &shown["tags"]), (&json!("the default\nof OpenCV"), &json!([])));
    let pruned = here.json(&["runs", "prune", "--max-size", "0"]);
    let why: Vec<&Json> = pruned["kept"].as_array().expect("a list").iter().map(|run| &run["why"]).collect();
    assert_eq!(
        (why, &pruned["removed"]),
        (vec![&json!("it has a note"), &json!("it has the tag `paper`")], &json!([]))
    );
    let refused = here.fails(&["run", "--no-page", "look.yaml", "--out", "runs/nine", "--overwrite"], 2);
    assert!(refused.contains("it has the tag `paper`"), "{refused}");
    // Parallel commands lose no tag.
    let tags: Vec<String> = (0..8).map(|number| format!("t{number}")).collect();
    let children = tags.iter().map(|tag| here.command(&["runs", "tag", "five", tag]).spawn().expect("it starts"));
    for mut child in children.collect::<Vec<_>>() {
        assert!(child.wait().expect("it ends").success());
    }
    assert_eq!(printed(&["runs", "tag", "five"]), tags.iter().map(|tag| format!("{tag}\n")).collect::<String>());
    // A run with notes that cannot be read is kept, too.
    let notes = here.path().join("runs/five/notes.json");
    std::fs::write(&notes, "{\"tags\": [").expect("written");
    let pruned = here.json(&["runs", "prune", "--max-size", "0"]);
    assert_eq!(pruned["kept"][0]["why"], "its notes.json cannot be read");
    assert!(here.fails(&["runs", "tag", "five", "x"], 2).contains("notes.json"));
    std::fs::write(&notes, "{\"note\": \"x\"}").expect("written");
    printed(&["runs", "note", "five", "--remove"]);
    assert!(!here.path().join("runs/five/notes.json").exists());
    // The files of notes are depthloom's own: a run with them can be removed by name.
    assert!(printed(&["runs", "rm", "five", "nine"]).contains("removed runs/nine"));
}
