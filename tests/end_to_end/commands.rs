//! The commands as other programs use them: JSON, SARIF, completion, manual pages, and the binary without the checkout.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::{Value as Json, json};

use crate::support::{depthloom, skipped, succeed, workspace};

const LOOK: &str = "experiments/first-look.yaml";
const SMALL: [&str; 6] = [
    "--set",
    "sources.street.with.width=320",
    "--set",
    "sources.street.with.height=96",
    "--set",
    "sources.street.with.frames=0..2",
];

fn text(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("UTF-8")
}

/// Standard output is one JSON value and nothing else.
fn json(output: &Output) -> Json {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", text(output)))
}

/// Runs a command that must end with this exit code.
fn exits_with(command: &mut Command, code: i32) -> Output {
    let output = command.output().expect("the binary starts");
    assert_eq!(output.status.code(), Some(code), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// An experiment with an error after a multi-byte character, an error that refers to another place, and a warning.
fn broken(folder: &Path) -> PathBuf {
    let file = folder.join("broken.yaml");
    let broken = "experiment: broken
description: Größe
sources:
  street: { kind: synthetic/road, with: { frames: 0..4 } }
  unused: { kind: synthetic/road, with: { frames: 0..4 } }
stages:
  look:
    source: street
    nodes:
      größe: { kind: stereo/sgmb, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: größe/disparity, calibration: source/calibration } }
      depth: { kind: depth/from-disparity }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }
";
    std::fs::write(&file, broken).expect("written");
    file
}

#[test]
fn check_json_has_the_printed_diagnostics() {
    let folder = tempfile::tempdir().expect("a folder");
    let right = json(&exits_with(depthloom().args(["check", LOOK, "--json"]), 0));
    assert_eq!(right["diagnostics"], json!([]));
    assert_eq!((&right["variants"], &right["stage_runs"], &right["nodes"]), (&json!(1), &json!(1), &json!(3)));

    let file = folder.path().join("kind.yaml");
    let look = std::fs::read_to_string(workspace().join(LOOK)).expect("the experiment");
    std::fs::write(
        &file,
        look.replace("experiment: first-look", "experiment: größe").replace("stereo/sgbm", "stereo/sgmb"),
    )
    .expect("written");
    let output = exits_with(depthloom().args(["check", "--json"]).arg(&file), 2);
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    let wrong = json(&output);
    let [diagnostic] = &wrong["diagnostics"].as_array().expect("a list")[..] else { panic!("{wrong}") };
    assert_eq!(diagnostic["severity"], "error");
    assert_eq!(diagnostic["file"], file.to_str().expect("UTF-8"));
    let (line, column) = place_of(&file, "stereo/sgmb");
    assert_eq!((&diagnostic["line"], &diagnostic["column"]), (&json!(line), &json!(column)), "{diagnostic}");
    assert_eq!(diagnostic["end"], json!({ "line": line, "column": column + "stereo/sgmb".len() }));
    assert!(diagnostic["help"].as_str().is_some_and(|help| help.contains("stereo/sgbm")), "{diagnostic}");
    assert_eq!(wrong["error"]["exit_code"], 2);
    assert_eq!(wrong["error"]["diagnostics"], wrong["diagnostics"]);

    // For a second `depth`, the place of the first is a related location.
    let wrong = json(&exits_with(depthloom().args(["check", "--json"]).arg(broken(folder.path())), 2));
    let related: Vec<_> = wrong["diagnostics"].as_array().expect("a list").iter().map(|d| &d["related"]).collect();
    assert!(related.iter().any(|related| related[0]["line"] == 11 && related[0]["file"].is_string()), "{wrong}");
}

/// Line and column of the first occurrence of `words`, from 1, in characters.
fn place_of(file: &Path, words: &str) -> (usize, usize) {
    let text = std::fs::read_to_string(file).expect("a file");
    let mut lines = (1..).zip(text.lines());
    let (number, line) = lines.find(|(_, line)| line.contains(words)).expect("the words");
    (number, line.split(words).next().map_or(0, |before| before.chars().count()) + 1)
}

#[test]
fn check_sarif_lists_every_diagnostic() {
    let folder = tempfile::tempdir().expect("a folder");
    broken(folder.path());
    let mut check = depthloom();
    check.current_dir(folder.path()).args(["check", "./broken.yaml", "--sarif", "--set", "look.nowhere.with.cap=1"]);
    let log = json(&exits_with(&mut check, 2));
    assert_eq!(log["version"], "2.1.0");
    let run = &log["runs"][0];
    let rules = run["tool"]["driver"]["rules"].as_array().expect("rules");
    assert_eq!(run["tool"]["driver"]["name"], "depthloom");
    assert_eq!(run["columnKind"], "unicodeCodePoints");
    let results = run["results"].as_array().expect("results");
    assert!(!results.is_empty());
    for result in results {
        let rule = &rules[usize::try_from(result["ruleIndex"].as_u64().expect("an index")).expect("small")];
        assert_eq!(result["ruleId"], rule["id"]);
        assert_eq!(result["level"], rule["defaultConfiguration"]["level"]);
        assert!(result["message"]["text"].as_str().is_some_and(|text| !text.is_empty()));
        let place = &result["locations"][0]["physicalLocation"];
        assert_eq!(place["artifactLocation"]["uri"], "broken.yaml");
        if let Some(region) = place.get("region") {
            let number = |key: &str| region[key].as_u64().expect("a number");
            assert!(number("startLine") >= 1 && number("startColumn") >= 1);
            assert!((number("startLine"), number("startColumn")) <= (number("endLine"), number("endColumn")));
        }
    }
    // A valid experiment yields a log without results.
    let log = json(&exits_with(depthloom().args(["check", LOOK, "--sarif"]), 0));
    assert_eq!(log["runs"][0]["results"], json!([]));
}

#[test]
fn errors_are_json_if_json_is_requested() {
    let folder = tempfile::tempdir().expect("a folder");
    let broken = broken(folder.path());
    let broken = broken.to_str().expect("UTF-8");
    let out = folder.path().join("out");
    let (empty, out) = (folder.path().to_str().expect("UTF-8"), out.to_str().expect("UTF-8"));
    let commands: [(&[&str], bool); 10] = [
        (&["run", broken, "--out", out], true),
        (&["check", broken], true),
        (&["plan", broken], true),
        (&["graph", broken], true),
        // Depends on the machine: there is no such data.
        (
            &[
                "run",
                "--no-page",
                LOOK,
                "--out",
                out,
                "--set",
                "sources.street={ kind: kitti/stereo2015, with: { root: none } }",
            ],
            false,
        ),
        (&["report", empty], false),
        (&["runs", "timings", empty], false),
        (&["nodes", "stereo/sgmb"], false),
        // Found in the arguments.
        (&["doctor", "--jsno"], false),
        (&["chekc"], false),
    ];
    for (arguments, has_diagnostics) in commands {
        let output = exits_with(depthloom().args(arguments).arg("--json"), 2);
        let printed = json(&output);
        let error = &printed["error"];
        assert!(error["message"].as_str().is_some_and(|message| !message.is_empty()), "{arguments:?}: {printed}");
        assert_eq!(error["exit_code"], 2, "{arguments:?}");
        assert!(error.get("help").is_some(), "{arguments:?}");
        let diagnostics = error["diagnostics"].as_array().expect("a list");
        assert_eq!(!diagnostics.is_empty(), has_diagnostics, "{arguments:?}: {printed}");
        // Without `--json`, errors are printed only to standard error.
        let output = exits_with(depthloom().args(arguments), 2);
        assert!(output.stdout.is_empty() && !output.stderr.is_empty(), "{arguments:?}");
    }
    let unknown = json(&exits_with(depthloom().args(["nodes", "stereo/sgmb", "--json"]), 2));
    assert!(unknown["error"]["help"].as_str().is_some_and(|help| help.contains("stereo/sgbm")), "{unknown}");
    // After `--`, `--json` is a file name.
    let output = exits_with(depthloom().args(["check", "--", "--json"]), 2);
    assert!(output.stdout.is_empty());
}

#[test]
fn nodes_json_lists_every_kind() {
    let list = json(&succeed(depthloom().args(["nodes", "--json"])));
    let kinds = list["kinds"].as_array().expect("a list");
    let names: Vec<&str> = kinds.iter().map(|kind| kind["kind"].as_str().expect("a name")).collect();
    let printed = text(&succeed(depthloom().arg("nodes")));
    assert_eq!(names, printed.lines().filter_map(|line| line.split_whitespace().next()).collect::<Vec<_>>());
    for name in names {
        let kind = json(&succeed(depthloom().args(["nodes", name, "--json"])));
        assert_eq!(kind["kind"], name);
        // The outputs of `mcap` are declared by the recording, those of custom nodes and sources by the experiment.
        let is_open = ["mcap", "process/source"].contains(&name) || kind["own_ports"] == true;
        assert!(kind["outputs"].as_array().is_some_and(|outputs| is_open || !outputs.is_empty()), "{kind}");
        assert!(kind["parameters"].is_object(), "{kind}");
    }
    let kind = json(&succeed(depthloom().args(["nodes", "stereo/sgbm", "--json"])));
    let left = json!({ "port": "left", "type": "image", "rate": "frame", "optional": false });
    let port = &kind["inputs"][0];
    assert!(left.as_object().expect("a map").iter().all(|(key, value)| port[key] == *value), "{port}");
    assert!(kind["parameters"]["properties"]["block"].is_object(), "{kind}");
}

#[test]
fn graph_json_has_the_nodes_of_the_plan() {
    let graph = json(&succeed(depthloom().args(["graph", "experiments/table1.yaml", "--json"])));
    let nodes = graph["nodes"].as_array().expect("nodes");
    let node = |id: &Json| nodes.iter().find(|node| node["id"] == *id).unwrap_or_else(|| panic!("no node {id}"));
    let edges = graph["edges"].as_array().expect("edges");
    let described: Vec<String> = edges
        .iter()
        .map(|edge| {
            let end = |end: &Json| format!("{}/{}", node(&end["id"])["name"], end["port"]).replace('"', "");
            format!("{} -> {} ({})", end(&edge["from"]), end(&edge["to"]), edge["rate"].as_str().expect("a rate"))
        })
        .collect();
    for expected in ["stereo/disparity -> depth/disparity (frame)", "train/model -> mono/model (once)"] {
        assert!(described.iter().any(|edge| edge == expected), "{expected}: {described:#?}");
    }
    // The same plan as a list has the same nodes.
    let plan = json(&succeed(depthloom().args(["plan", "experiments/table1.yaml", "--json"])));
    let planned: usize =
        plan["runs"].as_array().expect("runs").iter().map(|run| run["nodes"].as_array().map_or(0, Vec::len)).sum();
    assert_eq!(nodes.iter().filter(|node| node["type"] == "node").count(), planned);
}

#[test]
fn run_and_timings_print_json() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("look");
    let run = json(&succeed(depthloom().args(["run", "--no-page", LOOK, "--json", "--out"]).arg(&out).args(SMALL)));
    assert!(run.get("error").is_none() && run["report"].is_object(), "{run}");
    let timings = json(&succeed(depthloom().args(["runs", "timings", "--json"]).arg(&out)));
    let rows = timings["timings"].as_array().expect("rows");
    let stereo = rows.iter().find(|row| row["node"] == "stereo").expect("stereo");
    assert_eq!((&stereo["stage"], &stereo["phase"], &stereo["frames"]), (&json!("look"), &json!("process"), &json!(2)));
    assert!(stereo["cpu_ns"].as_u64().is_some_and(|ns| ns > 0));
}

/// The completions that a shell offers for the last of these words.
fn completions(words: &[&str], here: &Path) -> Vec<String> {
    let mut complete = depthloom();
    complete.current_dir(here).env("DEPTHLOOM_COMPLETE", "bash").env("_CLAP_IFS", "\n");
    complete.env("_CLAP_COMPLETE_INDEX", words.len().to_string()).args(["--", "depthloom"]).args(words);
    text(&succeed(&mut complete)).lines().map(str::to_owned).collect()
}

#[test]
fn completion_offers_kinds_and_files_by_extension() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = folder.path();
    for file in ["a.yaml", "b.yml", "c.txt", "d.mcap"] {
        std::fs::write(here.join(file), "").expect("written");
    }
    std::fs::create_dir(here.join("runs")).expect("made");
    assert_eq!(completions(&["nodes", "stereo/s"], here), ["stereo/sgbm"]);
    assert!(completions(&["nodes", ""], here).contains(&"synthetic/road".to_owned()));
    for command in ["run", "check", "plan", "graph"] {
        let completions = completions(&[command, ""], here);
        let values: Vec<_> = completions.iter().filter(|value| !value.starts_with('-')).collect();
        assert_eq!(values, ["a.yaml", "b.yml", "runs/"], "{command}");
    }
    let recordings = completions(&["report", ""], here);
    assert!(recordings.contains(&"d.mcap".to_owned()) && recordings.contains(&"runs/".to_owned()), "{recordings:?}");
    assert!(!recordings.contains(&"a.yaml".to_owned()));
    assert_eq!(completions(&["run", "a.yaml", "--out", "r"], here), ["runs/"]);
    assert_eq!(completions(&["chec"], here), ["check"]);
    assert_eq!(completions(&["man", "ver"], here), ["verify"]);
}

#[test]
fn completion_offers_names_from_the_experiment_and_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = folder.path();
    let look = workspace().join(LOOK);
    let variants = "variants: { plain: {}, small: { look.stereo.with.block: 3 } }";
    std::fs::write(here.join("look.yaml"), format!("extends: {}\nexperiment: look\n{variants}\n", look.display()))
        .expect("written");
    assert_eq!(completions(&["run", "look.yaml", "--set", "look.stereo.with.b"], here), ["look.stereo.with.block="]);
    let sources = completions(&["check", "look.yaml", "--matrix", "sources.street.with.w"], here);
    assert_eq!(sources, ["sources.street.with.width="]);
    assert_eq!(completions(&["plan", "look.yaml", "--variant", ""], here), ["plain", "small"]);
    let run = ["run", "--no-page", "look.yaml", "--quiet", "--out", "out", "--set", "sources.street.with.frames=0..1"];
    let small = ["--set", "sources.street.with.width=160", "--set", "sources.street.with.height=64"];
    succeed(depthloom().current_dir(here).args(run).args(small));
    let topics = completions(&["export", "out", "stereo"], here);
    assert!(topics.is_empty(), "each of two variants has its own: {topics:?}");
    assert_eq!(completions(&["export", "out", "small/stereo"], here), ["small/stereo/disparity"]);
    assert!(completions(&["export", "out", "/look/so"], here).contains(&"/look/source/left".to_owned()));
    assert_eq!(completions(&["figure", "out", "cdf", "--variant", "s"], here), ["small"]);
    // A broken file yields no completions and no error.
    std::fs::write(here.join("look.yaml"), "stages: [").expect("written");
    assert_eq!(completions(&["run", "look.yaml", "--variant", "s"], here), [""; 0]);
}

#[test]
fn a_port_of_a_wrong_type_is_reported_once() {
    let folder = tempfile::tempdir().expect("a folder");
    for (port, wrong) in [("dpeth", "dpeth"), ("{ type: dpeth }", "dpeth"), ("{ type: depth, rtae: once }", "rtae")] {
        let experiment = format!(
            "experiment: ports
sources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..1 }} }} }}
stages:
  look:
    source: street
    nodes:
      own:
        kind: process
        inputs: {{ depth: source/depth }}
        with: {{ command: [own], ports: {{ inputs: {{ depth: {port} }}, outputs: {{ depth: depth }} }} }}
    score: {{ ground_truth: source/depth, estimates: {{ own: own/depth }} }}
"
        );
        let file = folder.path().join("ports.yaml");
        std::fs::write(&file, experiment).expect("written");
        let printed = json(&exits_with(depthloom().args(["check", "--json"]).arg(&file), 2));
        let diagnostics = printed["diagnostics"].as_array().expect("a list");
        assert_eq!(diagnostics.len(), 1, "{printed}");
        assert!(diagnostics[0]["message"].as_str().is_some_and(|message| message.contains(wrong)), "{printed}");
    }
}

#[test]
fn check_notes_that_run_refuses_dora_nodes() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("near.yaml");
    let experiment = "experiment: near
sources: { street: { kind: synthetic/road, with: { frames: 0..1 } } }
stages:
  look:
    source: street
    nodes:
      near:
        kind: dora
        inputs: { depth: source/depth }
        with: { path: near.py, ports: { inputs: { depth: depth }, outputs: { depth: depth } }, version: 1 }
    score: { ground_truth: source/depth, estimates: { near: near/depth } }
";
    std::fs::write(&file, experiment).expect("written");
    let printed = text(&exits_with(depthloom().arg("check").arg(&file), 0));
    assert!(printed.contains("note: `depthloom run` refuses 1 node of the kind `dora` (`look.near`)"), "{printed}");
    let printed = json(&exits_with(depthloom().args(["check", "--json"]).arg(&file), 0));
    assert_eq!(printed["dora_nodes"], json!(["look.near"]));
}

#[test]
fn an_experiment_is_read_from_standard_input() {
    let with_stdin = |arguments: &[&str], text: &[u8]| {
        let mut child = depthloom();
        child.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = child.spawn().expect("the binary starts");
        child.stdin.take().expect("a pipe").write_all(text).expect("written");
        child.wait_with_output().expect("ended")
    };
    let look = std::fs::read(workspace().join(LOOK)).expect("an experiment");
    let output = with_stdin(&["check", "-"], &look);
    assert!(output.status.success() && text(&output).starts_with("-: right; "), "{output:?}");
    assert_eq!(
        json(&with_stdin(&["plan", "-", "--json"], &look))["experiment"],
        json(&exits_with(depthloom().args(["plan", LOOK, "--json"]), 0))["experiment"]
    );
    let broken = with_stdin(&["check", "-", "--json"], b"experiment: x\nstagse: {}\n");
    let printed = json(&broken);
    assert_eq!((broken.status.code(), &printed["diagnostics"][0]["file"]), (Some(2), &json!("-")), "{printed}");
    // `run` refuses it: the run reads the file again, and stores a copy.
    let output = with_stdin(&["run", "-"], &look);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && stderr.contains("write it to a file"), "{stderr}");
}

#[test]
fn bash_completes_with_the_generated_script() {
    const TEST: &str = "bash_completes_with_the_generated_script";
    if Command::new("bash").arg("--version").output().is_err() {
        return skipped(TEST, "there is no bash");
    }
    let script = text(&succeed(depthloom().args(["completions", "bash"])));
    let ask = "COMP_WORDS=(depthloom nodes stereo/c) COMP_CWORD=2 COMP_TYPE=9
_clap_complete_depthloom depthloom stereo/c nodes
printf '%s\\n' \"${COMPREPLY[@]}\"";
    let output = succeed(Command::new("bash").args(["--norc", "-c", &format!("{script}\n{ask}")]));
    assert_eq!(text(&output), "stereo/census-sgm\n");
    for shell in ["zsh", "fish", "elvish", "powershell"] {
        assert!(text(&succeed(depthloom().args(["completions", shell]))).contains("DEPTHLOOM_COMPLETE"), "{shell}");
    }
}

/// The commands that a help text lists: in front of the options, each with its summary.
fn commands_of(command: &[&str]) -> Vec<String> {
    let help = text(&succeed(depthloom().args(command).arg("-h")));
    let lines = help.lines().take_while(|line| *line != "Options:");
    let names = lines.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
    // Arguments are written in brackets.
    names.filter(|name| name.starts_with(|c: char| c.is_ascii_lowercase())).map(str::to_owned).collect()
}

#[test]
fn every_command_has_a_valid_manual_page() {
    const TEST: &str = "every_command_has_a_valid_manual_page";
    let folder = tempfile::tempdir().expect("a folder");
    succeed(depthloom().args(["man", "--out"]).arg(folder.path()));
    let mut pages = vec![folder.path().join("depthloom.1")];
    let below = |parent: &str| -> Vec<String> {
        commands_of(&[parent]).into_iter().map(|command| format!("{parent} {command}")).collect()
    };
    for command in commands_of(&[]).into_iter().chain(below("runs")).chain(below("jobs")).filter(|name| *name != "help")
    {
        let page = folder.path().join(format!("depthloom-{}.1", command.replace(' ', "-")));
        let printed = text(&succeed(depthloom().args(["man", &command])));
        assert_eq!(std::fs::read_to_string(&page).expect("a page"), printed, "{command}");
        for section in ["SYNOPSIS", "OPTIONS", "\"EXIT STATUS\"", "EXAMPLES"] {
            assert!(printed.contains(&format!(".SH {section}\n")), "{command} lacks {section}: {printed}");
        }
        pages.push(page);
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), pages.len());
    // The date is that of the release in CHANGELOG.md, not of the build.
    let changes = std::fs::read_to_string(workspace().join("CHANGELOG.md")).expect("the changelog");
    let head = format!("## {} (", env!("CARGO_PKG_VERSION"));
    let released = changes.lines().find_map(|line| line.strip_prefix(&head)?.strip_suffix(')')).expect("a date");
    let page = std::fs::read_to_string(&pages[0]).expect("a page");
    assert!(page.lines().any(|line| line.starts_with(".TH ") && line.contains(released)), "{page}");
    if Command::new("mandoc").arg("-V").output().is_err() {
        return skipped(TEST, "there is no mandoc");
    }
    let lint = Command::new("mandoc").arg("-Tlint").args(&pages).output().expect("mandoc starts");
    assert!(lint.stdout.is_empty() && lint.status.success(), "{}", text(&lint));
}

#[test]
fn help_has_examples_and_links_and_errors_suggest_a_command() {
    let commands = commands_of(&[]);
    assert!(commands.len() > 20, "{commands:?}");
    let below = |parent: &str| -> Vec<Vec<String>> {
        commands_of(&[parent]).into_iter().map(|command| vec![parent.to_owned(), command]).collect()
    };
    for command in commands.into_iter().map(|command| vec![command]).chain(below("runs")).chain(below("jobs")) {
        let help = text(&succeed(depthloom().args(&command).arg("--help")));
        for part in ["\nExamples:\n  depthloom ", "\nGuide: https://", "\nExit codes: https://"] {
            assert!(help.contains(part), "{command:?}: {help}");
        }
    }
    for (typo, near) in [("runn", "run"), ("rnu", "run"), ("reprot", "report"), ("node", "nodes"), ("verfy", "verify")]
    {
        for before in [&[][..], &["help"]] {
            let output = exits_with(depthloom().args(before).arg(typo), 2);
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert!(stderr.contains(&format!("'{near}'")), "{stderr}");
        }
    }
    let printed = json(&exits_with(depthloom().args(["rnu", "--json"]), 2));
    assert_eq!(printed["error"]["help"], "a similar subcommand exists: 'run'");
    let output = exits_with(depthloom().args(["man", "reprot"]), 2);
    assert!(String::from_utf8_lossy(&output.stderr).contains("`report`"));
}

#[test]
fn the_binary_runs_without_the_checkout() {
    let folder = tempfile::tempdir().expect("a folder");
    let binary = folder.path().join("depthloom");
    std::fs::copy(env!("CARGO_BIN_EXE_depthloom"), &binary).expect("copied");
    let here = folder.path().join("empty");
    std::fs::create_dir(&here).expect("made");
    let alone = |arguments: &[&str]| {
        let mut command = Command::new(&binary);
        command.current_dir(&here).env_clear().args(arguments);
        succeed(&mut command)
    };
    alone(&["new", "x.yaml"]);
    alone(&[&["run", "--no-page", "x.yaml", "--quiet", "--out", "x"], &SMALL[..]].concat());
    assert!(here.join("x/table.csv").is_file());
}

#[test]
fn the_readme_quotes_first_look_yaml() {
    let read = |path: &str| std::fs::read_to_string(workspace().join(path)).expect("a file");
    let look = read(LOOK);
    assert!(read("README.md").contains(&format!("```yaml\n{look}```")), "README.md does not quote {LOOK} as it is");
    assert!(look.starts_with("# yaml-language-server: $schema=experiment.schema.json\n"));
}
