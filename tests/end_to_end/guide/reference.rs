//! The reference of the guide, generated from the program: kinds, commands, the language, JSON outputs, exit codes; and
//! from the pages: which of their commands are run.

use std::fmt::Write as _;

use depthloom_terminal::ExitCode;
use serde_json::Value as Json;

use super::page::{self, Use, blocks, pages};
use super::{book, writes};
use crate::support::{depthloom, succeed, workspace};

/// The comment after the title of every generated page.
const GENERATED: &str = "<!-- Generated: DEPTHLOOM_WRITE_GUIDE=1 cargo test --release -p depthloom -p depthloom-analysis --test end_to_end -- guide::reference -->";

/// Standard output of the program.
fn stdout_of(arguments: &[&str]) -> String {
    String::from_utf8(succeed(depthloom().args(arguments)).stdout).expect("UTF-8")
}

fn json(arguments: &[&str]) -> Json {
    serde_json::from_str(&stdout_of(arguments)).expect("JSON")
}

fn head(title: &str, about: &str) -> String {
    format!("# {title}\n\n{GENERATED}\n\n{about}\n")
}

/// Kinds of sources or of nodes, each as printed by `depthloom nodes KIND`.
fn kinds(title: &str, about: &str, is_source: bool) -> String {
    let all = json(&["nodes", "--json"]);
    let all = all["kinds"].as_array().expect("a list");
    let kinds = all.iter().filter(|kind| (kind["contract"] == "source") == is_source);
    let mut text = head(title, about);
    let mut explained = String::new();
    text.push_str("\n| kind | |\n|---|---|\n");
    for kind in kinds {
        let (name, summary) = (kind["kind"].as_str().expect("a name"), kind["summary"].as_str().expect("a sentence"));
        let _ = writeln!(text, "| [`{name}`](#{}) | {} |", name.replace('/', ""), summary.replace('|', "\\|"));
        for line in stdout_of(&["nodes", name]).lines() {
            let _ = match (line.strip_prefix("# "), line.strip_prefix("## ")) {
                (Some(title), _) => writeln!(explained, "\n## {title}"),
                (_, Some(part)) => writeln!(explained, "**{part}**"),
                _ => writeln!(explained, "{line}"),
            };
        }
    }
    text + &explained
}

fn sources() -> String {
    let about = "Sources of frames: `sources: { NAME: { kind: KIND, with: { PARAMETER: VALUE } } }`. `depthloom nodes KIND` prints the same in a terminal. \
                 A node's input accepts an output whose type, in the column \"carries\", equals its own.";
    kinds("Sources", about, true)
}

fn nodes() -> String {
    let about = "The nodes of a stage: `nodes: { NAME: { kind: KIND, inputs: { PORT: NODE/PORT }, with: { PARAMETER: VALUE } } }`. A *pure* node has no memory \
                 between frames, an *ordered* one gets them one by one in order, a *once* node runs after the last frame. `depthloom nodes KIND` prints the same in a \
                 terminal.";
    kinds("Nodes", about, false)
}

/// The commands that a help text lists: in front of the options, each with its summary.
fn commands_of(command: &[&str]) -> Vec<String> {
    let help = stdout_of(&[command, &["-h"]].concat());
    let lines = help.lines().take_while(|line| *line != "Options:");
    let names = lines.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
    // Arguments are written in brackets.
    names.filter(|name| name.starts_with(|c: char| c.is_ascii_lowercase())).map(str::to_owned).collect()
}

/// All commands and their subcommands, each with its help.
fn helps() -> Vec<(String, String)> {
    fn below(command: &[&str], found: &mut Vec<(String, String)>) {
        found.push((command.join(" "), stdout_of(&[command, &["--help"]].concat())));
        for name in commands_of(command) {
            below(&[command, &[&name]].concat(), found);
        }
    }
    let mut found = Vec::new();
    below(&[], &mut found);
    found
}

fn commands() -> String {
    let about = "The arguments of each command, as printed by `depthloom help COMMAND`. `depthloom man --out DIR` writes the same as manual pages.";
    let mut text = head("Commands", about);
    for (command, help) in helps() {
        let title = format!("depthloom {command}");
        let lines: Vec<&str> = help.trim().lines().map(str::trim_end).collect();
        let _ = write!(text, "\n## {}\n\n```text\n{}\n```\n", title.trim(), lines.join("\n"));
    }
    text
}

fn exit_codes() -> String {
    let about = "The meaning of a command's exit code. A script that only tests for `0` works with all commands. `3` is a result, not a fault of the command: \
                 frames failed, values differ, or a limit of `compare --fail-if` was exceeded.";
    let rows: Vec<String> =
        ExitCode::ALL.iter().map(|(code, meaning)| format!("| {} | {meaning}", *code as u8)).collect();
    let head = head("Exit codes", about);
    format!("{head}\n| code | meaning |\n|---|---|\n{} |\n", rows.join(" |\n"))
}

/// A short description of the values that a schema allows.
fn kind_of(schema: &Json) -> String {
    let code = |value: &Json| format!("`{}`", value.to_string().trim_matches('"'));
    if let Some(reference) = schema["$ref"].as_str() {
        return reference.rsplit('/').next().unwrap_or(reference).to_owned();
    }
    if let Some(constant) = schema.get("const") {
        return code(constant);
    }
    if let Some(values) = schema["enum"].as_array() {
        // Kinds are listed on other pages.
        let shown: Vec<String> = values.iter().map(code).collect();
        return if schema.get("markdownEnumDescriptions").is_some() { "a kind".to_owned() } else { shown.join(", ") };
    }
    for any in ["anyOf", "oneOf"] {
        // An environment variable may stand for a value of any type, so it is left out.
        let is_variable = |schema: &&Json| schema["pattern"].as_str().is_some_and(|pattern| pattern.starts_with("\\$"));
        if let Some(others) = schema[any].as_array() {
            let mut words: Vec<String> = Vec::new();
            for word in others.iter().filter(|other| !is_variable(other)).map(kind_of) {
                if !words.contains(&word) {
                    words.push(word);
                }
            }
            return words.join(" or ");
        }
    }
    let container = |word: &str, items: &Json| {
        if items.is_object() { format!("{word} of {}", kind_of(items)) } else { word.to_owned() }
    };
    let word = |name: &str| match name {
        "object" if schema["additionalProperties"]["$ref"].is_string() => {
            container("map", &schema["additionalProperties"])
        }
        "object" => "map".to_owned(),
        "integer" => "whole number".to_owned(),
        "string" => "text".to_owned(),
        "boolean" => "true or false".to_owned(),
        "array" => container("list", &schema["items"]),
        other => other.to_owned(),
    };
    match &schema["type"] {
        Json::String(name) => word(name),
        Json::Array(names) => names.iter().filter_map(Json::as_str).map(word).collect::<Vec<_>>().join(" or "),
        _ => "any".to_owned(),
    }
}

/// A table of an object's keys. Nested keys are written `outer.inner`; a key with any name is `NAME`. Keys that an
/// enclosing map has as well are listed only there.
fn keys(text: &mut String, schema: &Json) {
    let mut rows = String::new();
    push_keys(&mut rows, "", schema, &[]);
    if !rows.is_empty() {
        let _ = write!(text, "\n| key | is | meaning |\n|---|---|---|\n{rows}");
    }
}

fn push_keys(rows: &mut String, above: &str, schema: &Json, around: &[&Json]) {
    let required: Vec<&str> = schema["required"].as_array().into_iter().flatten().filter_map(Json::as_str).collect();
    let named = schema["properties"].as_object().into_iter().flatten().map(|(key, property)| (key.as_str(), property));
    let others = &schema["additionalProperties"];
    let others = (others["anyOf"].is_array() || others["properties"].is_object()).then_some(("NAME", others));
    let is_new = |(key, property): &(&str, &Json)| around.iter().all(|map| map["properties"][*key] != **property);
    for (key, property) in named.chain(others).filter(is_new) {
        let cell = |text: &str| text.replace('|', "\\|").replace('\n', " ");
        let required = if required.contains(&key) { "; required" } else { "" };
        let meaning = property["description"].as_str().unwrap_or_default();
        let _ = writeln!(rows, "| `{above}{key}` | {}{required} | {} |", cell(&kind_of(property)), cell(meaning));
        let prefix = format!("{above}{key}.");
        let ways = property["anyOf"].as_array().into_iter().flatten().chain([property]);
        let around = [around, &[schema]].concat();
        ways.filter(|way| way["type"] == "object").for_each(|way| push_keys(rows, &prefix, way, &around));
    }
}

fn language() -> String {
    let schema = json(&["schema"]);
    let about = "The keys of an experiment file, from the schema that editors check it with (`depthloom schema`). A value may be an environment \
                 variable: `\"${NAME}\"`, or `\"${NAME:-default}\"`. Parameters of kinds are in [Sources](sources.md) and [Nodes](nodes.md); [Axes](../axes.md) \
                 describes paths and `matrix:`. Keys that an estimate shares with `score` are listed only under `score`.";
    let mut text = head("The experiment language", about);
    text.push_str("\n## The file\n");
    keys(&mut text, &schema);
    for (name, part) in schema["$defs"].as_object().expect("parts") {
        let _ = write!(text, "\n## {name}\n\n{}\n", capital(&kind_of(part)));
        if let Some(about) = part["description"].as_str() {
            let _ = write!(text, "\n{about}\n");
        }
        keys(&mut text, part);
        for any in ["anyOf", "oneOf"] {
            part[any].as_array().into_iter().flatten().for_each(|way| keys(&mut text, way));
        }
    }
    text
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect::<String>() + ".")
}

fn outputs() -> String {
    let about = "With `--json`, a command prints one object, which begins with `format: { name, version }`. The version increases if a key is removed or changes its \
                 meaning; additional keys do not change it. Each section links the JSON Schema, which `depthloom schema --of NAME` prints. If the exit code is not 0, \
                 the object contains `error`.";
    let mut text = head("JSON outputs", about);
    let files = std::fs::read_dir(workspace().join("docs/schemas")).expect("schemas");
    let mut names: Vec<String> =
        files.map(|file| file.expect("a file").path().file_stem().expect("its name").display().to_string()).collect();
    names.sort();
    for name in names {
        let schema = json(&["schema", "--of", &name]);
        let about = schema["description"].as_str().unwrap_or_default();
        let _ = write!(text, "\n## {name}\n\n{about} [Schema](../schemas/{name}.json).\n");
        keys(&mut text, &schema);
    }
    text
}

fn checked() -> String {
    let about = "The tests run the commands of this guide, each page in a folder of its own, and compare what a page shows of their output. \
                 Some commands are not run, for the reason given below. Those that need data or Python run where these are available.";
    let mut text = head("What of this guide is checked", about);
    let (mut rows, mut skipped) = (String::new(), String::new());
    let (mut all, mut none) = (0, 0);
    for name in pages() {
        let (mut run, mut not_run, mut needs) = (0, 0, Vec::new());
        for block in blocks(&page::read(&name)) {
            match block.declared_use(&name) {
                Use::Run { needs: needed, .. } => {
                    run += block.commands();
                    needs.extend(needed);
                }
                Use::NotRun(why) => {
                    not_run += block.commands();
                    for command in block.text.lines().filter(|line| !line.trim_start().starts_with('#')) {
                        let _ = writeln!(
                            skipped,
                            "| [{name}](../{name}) | `{}` | {why} |",
                            command.trim().replace('|', "\\|")
                        );
                    }
                }
                Use::File(_) | Use::Figure { .. } | Use::Screenshot(_) | Use::Shown => {}
            }
        }
        if run + not_run > 0 {
            needs.dedup();
            let _ = writeln!(rows, "| [{name}](../{name}) | {run} | {not_run} | {} |", needs.join(", "));
        }
        (all, none) = (all + run, none + not_run);
    }
    let _ = write!(
        text,
        "\n| page | commands run | not run | some need |\n|---|---|---|---|\n{rows}| all | {all} | {none} | |\n"
    );
    let _ = write!(text, "\n## Not run\n\n| page | command | why |\n|---|---|---|\n{skipped}");
    text
}

#[test]
fn the_reference_is_up_to_date() {
    let generated = [
        ("sources.md", sources()),
        ("nodes.md", nodes()),
        ("commands.md", commands()),
        ("exit-codes.md", exit_codes()),
        ("language.md", language()),
        ("json.md", outputs()),
        ("checked.md", checked()),
    ];
    let folder = book().join("reference");
    let mut stale = Vec::new();
    for (name, text) in generated {
        if writes() {
            std::fs::write(folder.join(name), &text).expect("written");
        }
        if std::fs::read_to_string(folder.join(name)).unwrap_or_default() != text {
            stale.push(name);
        }
    }
    assert_eq!(
        stale, [""; 0],
        "stale: DEPTHLOOM_WRITE_GUIDE=1 cargo test --release -p depthloom -p depthloom-analysis --test end_to_end -- guide::reference"
    );
}
