//! Values of environment variables that a program gets: they are neither shown nor recorded, and secrets do not affect
//! cache keys.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value as Json;

use super::{Peer, run};
use crate::support::{depthloom, succeed, system_python};

const TOKEN: &str = "wrench-17-hammer";
const FOLDER: &str = "SECRET_FOLDER";

/// The files below a folder that contain a text.
fn files_containing(folder: &Path, text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(files_containing(&path, text));
        } else if fs::read(&path).expect("read").windows(text.len()).any(|part| part == text.as_bytes()) {
            found.push(path.display().to_string());
        }
    }
    found
}

fn node_hash(experiment: &Path, token: &str) -> (String, String) {
    let mut command = depthloom();
    let output = succeed(command.args(["plan", "--json"]).arg(experiment).env("SECRET_TOKEN", token).env(FOLDER, "x"));
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let plan: Json = serde_json::from_str(&text).expect("JSON");
    let nodes = plan["runs"][0]["nodes"].as_array().expect("nodes").clone();
    let own = nodes.into_iter().find(|node| node["name"] == "own").expect("a node");
    (own["node_hash"].as_str().expect("a hash").to_owned(), text)
}

#[test]
fn fault_12_values_of_variables_are_neither_stored_nor_shown() {
    if !system_python("fault_12_values_of_variables_are_neither_stored_nor_shown") {
        return;
    }
    let peer = Peer::new();
    let command = format!("[python3, peer.py, works, '${{{FOLDER}}}']");
    let experiment = peer.experiment(
        "works",
        "0..1",
        &command,
        "version: 1, env: { A: 'a-${SECRET_TOKEN}' }, secrets: { B: '${SECRET_TOKEN}' }, params: { c: ['${SECRET_TOKEN}'] }",
    );
    let (out, folder) = (peer.path("out"), peer.path(""));
    let folder = folder.to_string_lossy();
    let with = |command: &mut Command| {
        command.args(["--json"]).env("SECRET_TOKEN", TOKEN).env(FOLDER, &*folder);
        succeed(command)
    };
    // Printed output, and all files of the run.
    let mut run_command = depthloom();
    run_command.args(["run", "--no-page"]).arg(&experiment).args(["--allow-exec", "--out"]).arg(&out);
    let printed = [with(&mut run_command), with(depthloom().arg("plan").arg(&experiment))];
    for output in printed {
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(!text.contains(TOKEN) && text.contains("a-${SECRET_TOKEN}"), "{text}");
    }
    assert_eq!(files_containing(&out, TOKEN), [""; 0]);
    assert!(!files_containing(&out, "a-${SECRET_TOKEN}").is_empty());
    // A failure is recorded with the name of the program, without its arguments.
    let command = format!("[python3, peer.py, exits, {folder:?}, '${{SECRET_TOKEN}}']");
    let failing = peer.experiment("exits", "0..1", &command, "version: 1");
    let out = peer.path("failed");
    let output = run(&failing, &out, "secrets").arg("--keep-going").env("SECRET_TOKEN", TOKEN).output();
    let output = output.expect("started");
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(files_containing(&out, TOKEN), [""; 0]);
}

#[test]
fn fault_12_secrets_do_not_change_the_node_hash_and_other_variables_do() {
    let peer = Peer::new();
    let hash =
        |more: &str, token: &str| node_hash(&peer.experiment("works", "0..1", "[python3, peer.py]", more), token);
    let secret = "version: 1, secrets: { TOKEN: '${SECRET_TOKEN}' }";
    let before = hash(secret, "one");
    assert_eq!(before, hash(secret, "two"), "the printed plan is the same");
    assert_eq!(before.0, hash("version: 1", "one").0);
    let env = "version: 1, env: { TOKEN: '${SECRET_TOKEN}' }";
    assert_ne!(hash(env, "one").0, hash(env, "two").0);
    assert_eq!(hash(env, "one").0, hash("version: 1, env: { TOKEN: one }", "").0);
}
