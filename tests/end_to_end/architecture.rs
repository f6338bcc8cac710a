//! ARCHITECTURE.md against the manifests and the files: its table of crates, its arrows, the paths that it names, its
//! size; and the width of comments.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value as Json;

use crate::support::{succeed, workspace};

struct Crate {
    folder: String,
    /// The workspace's crates that it uses outside tests, build scripts and benches.
    uses: BTreeSet<String>,
}

/// Every crate of the workspace, as cargo knows them.
fn crates() -> BTreeMap<String, Crate> {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["metadata", "--no-deps", "--offline", "--format-version", "1"]).current_dir(workspace());
    let metadata: Json = serde_json::from_slice(&succeed(&mut cargo).stdout).expect("JSON");
    let packages = metadata["packages"].as_array().expect("a list");
    let text = |json: &Json| json.as_str().expect("text").to_owned();
    let names: BTreeSet<String> = packages.iter().map(|package| text(&package["name"])).collect();
    let root = text(&metadata["workspace_root"]);
    let member = |package: &Json| {
        let manifest = text(&package["manifest_path"]);
        let folder = manifest
            .strip_prefix(&root)
            .expect("a path below the root")
            .trim_matches('/')
            .trim_end_matches("Cargo.toml")
            .to_owned();
        let dependencies = package["dependencies"].as_array().expect("a list").iter();
        let normal = dependencies.filter(|dependency| dependency["kind"].is_null());
        let uses = normal.map(|dependency| text(&dependency["name"])).filter(|name| names.contains(name)).collect();
        // The root package's own folder is `src/`.
        let folder = if folder.is_empty() { "src/".to_owned() } else { folder };
        (text(&package["name"]), Crate { folder, uses })
    };
    packages.iter().map(member).collect()
}

fn architecture() -> String {
    std::fs::read_to_string(workspace().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md")
}

/// The rows of the table: folder and crate.
fn rows(text: &str) -> Vec<(String, String)> {
    let rows = text.lines().skip_while(|line| !line.starts_with("| folder | crate |")).skip(2);
    let cell = |cell: &str| cell.trim().trim_matches('`').to_owned();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split('|').collect();
        (cell(cells[1]), cell(cells[2]))
    };
    rows.take_while(|line| line.starts_with('|')).map(row).collect()
}

#[test]
fn the_crate_table_is_complete_and_dependencies_point_down() {
    let (text, crates) = (architecture(), crates());
    let rows = rows(&text);
    let listed: BTreeSet<(&str, &str)> = rows.iter().map(|(folder, name)| (&**folder, &**name)).collect();
    let actual: BTreeSet<(&str, &str)> = crates.iter().map(|(name, member)| (&*member.folder, &**name)).collect();
    assert_eq!(listed, actual);
    for (index, (_, name)) in rows.iter().enumerate() {
        for used in &crates[name].uses {
            let below = rows[index + 1..].iter().any(|(_, other)| other == used);
            assert!(below, "`{name}` uses `{used}`, which is not listed below it");
        }
    }
}

#[test]
fn the_dependency_graph_matches_the_manifests() {
    let full = |short: &str| match short {
        "depthloom" | "own-node" => short.to_owned(),
        short => format!("depthloom-{short}"),
    };
    let text = architecture();
    let arrows = text.lines().skip_while(|line| *line != "graph TD").skip(1).take_while(|line| *line != "```");
    let drawn: BTreeSet<(String, String)> = arrows
        .flat_map(|line| {
            let (from, to) = line.trim().split_once(" --> ").unwrap();
            to.split(" & ").map(|to| (full(from), full(to))).collect::<Vec<_>>()
        })
        .collect();
    let mut actual = BTreeSet::new();
    for (name, member) in crates() {
        actual.extend(member.uses.into_iter().map(|used| (name.clone(), used)));
    }
    assert_eq!(drawn, actual);
}

#[test]
fn every_path_in_architecture_exists_and_the_page_is_short() {
    let text = architecture();
    let is_path = |word: &&str| {
        word.split_once('/').is_some_and(|(folder, _)| !word.contains(['*', ' ']) && workspace().join(folder).is_dir())
    };
    let paths: Vec<&str> = text.split('`').skip(1).step_by(2).filter(is_path).collect();
    assert!(paths.len() > 40, "{paths:?}");
    let missing: Vec<&&str> = paths.iter().filter(|path| !workspace().join(path).exists()).collect();
    assert!(missing.is_empty(), "{missing:?}");
    assert!(text.len() <= 12_000, "{} bytes", text.len());
}

/// Files of Rust below `folder`, without build output and hidden folders.
fn rust_files(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder that can be read") {
        let path = entry.expect("an entry that can be read").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            rust_files(&path, files);
        } else if name.ends_with(".rs") {
            files.push(path);
        }
    }
}

#[test]
fn comments_of_rust_files_have_at_most_120_columns() {
    let mut files = Vec::new();
    rust_files(workspace(), &mut files);
    assert!(files.len() > 500, "{} files", files.len());
    let mut wide = Vec::new();
    for file in &files {
        let text = std::fs::read_to_string(file).expect("a file that can be read");
        for (line, line_text) in text.lines().enumerate() {
            // Rows of tables cannot be wrapped.
            let text = line_text.trim_start_matches([' ', '/', '!']);
            let is_comment = line_text.trim_start().starts_with("//");
            if is_comment && !text.starts_with('|') && line_text.chars().count() > 120 {
                wide.push(format!("{}:{}", file.display(), line + 1));
            }
        }
    }
    assert!(wide.is_empty(), "{} comments are wider:\n{}", wide.len(), wide.join("\n"));
}
