//! Diagnostics while typing, and the conversation itself: order, broken messages, exit codes.

use std::fs;
use std::path::Path;

use serde_json::{Value as Json, json};

use super::EXPERIMENT;
use super::client::{Client, position, uri, words};
use crate::support::depthloom;

/// Messages and the words they underline.
fn shown(text: &str, diagnostics: &[Json]) -> Vec<(String, String)> {
    let one = |found: &Json| {
        let message = found["message"].as_str().expect("text").lines().next().expect("a line").to_owned();
        (message, words(text, &found["range"]).to_owned())
    };
    diagnostics.iter().map(one).collect()
}

/// What `depthloom check --json` reports, in the form of the protocol.
fn checked(path: &Path) -> Vec<Json> {
    let output = depthloom().arg("check").arg(path).arg("--json").output().expect("it runs");
    let found: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    let lines = |found: &Json| {
        let message = found["message"].as_str().expect("text");
        let help = found["help"].as_str().map(|help| format!("\nhelp: {help}")).unwrap_or_default();
        json!({ "message": format!("{message}{help}"), "line": found["line"].as_u64().expect("a line") - 1 })
    };
    found["diagnostics"].as_array().expect("a list").iter().map(lines).collect()
}

#[test]
fn twenty_edits_have_the_diagnostics_of_check() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("look.yaml");
    let address = uri(&path);
    fs::write(&path, "experiment: on-disk\n").expect("written");
    let mut client = Client::initialized(folder.path());
    assert_eq!(shown(EXPERIMENT, &client.open(&address, EXPERIMENT)), [], "the text of the editor, not of the disk");
    // What is replaced, by what, and the words that are then underlined.
    let edits = [
        (
            "stereo/sgbm, inputs: { left: source/left, right: source/right }, with",
            "stereo/sgmb, inputs: { left: source/left, right: source/right }, with",
            "stereo/sgmb",
        ),
        ("block: 5 }", "blok: 5 }", "blok"),
        ("cap: 80", "cap: eighty", "eighty"),
        ("cap: 80", "cap: -1", "-1"),
        ("depth: depth/depth }, with: { size: 3", "depth: dept/depth }, with: { size: 3", "dept"),
        ("disparity: stereo/disparity", "disparity: stereo/disparty", "disparty"),
        ("source: street", "source: stret", "stret"),
        ("preset: martins2018", "preset: martins", "martins"),
        ("raw: depth/depth", "raw: raw/depth", "raw"),
        ("far: { second.depth.with.cap", "far: { second.dept.with.cap", "dept"),
        ("far: { second.depth.with.cap", "far: { secnd.depth.with.cap", "secnd"),
        ("size: 3 }", "size: 4 }", "4"),
        ("size: 3 }", "size: }", "size"),
        ("frames: 0..2, seed: 1", "frames: zero, seed: 1", "zero"),
        ("only: [\"full+*\"", "only: [\"fill+*\"", "\"fill+*\""),
        ("record: [second.depth/depth", "record: [second.depth/dept", "second.depth/dept"),
        ("experiment: look", "experiment: \"ä𝄞 look/\"", "\"ä𝄞 look/\""),
        ("model: first.train/model", "model: second.train/model", "train"),
        ("smooth: { kind: filter/median", "smooth: { knd: filter/median", "knd"),
        ("nodes:\n      stereo", "nods:\n      stereo", "nods"),
    ];
    for (index, (from, to, underlined)) in edits.into_iter().enumerate() {
        assert!(EXPERIMENT.contains(from), "{from}");
        let text = EXPERIMENT.replacen(from, to, 1);
        let version = i32::try_from(index).expect("small") + 2;
        let found = client.replace(&address, version, &text);
        let all = shown(&text, &found);
        assert!(all.iter().any(|(_, words)| words == underlined), "{to}: {all:?}");
        fs::write(&path, &text).expect("written");
        let lines = |found: &Json| json!({ "message": found["message"], "line": found["range"]["start"]["line"] });
        assert_eq!(found.iter().map(lines).collect::<Vec<_>>(), checked(&path), "{to}");
        assert!(found.iter().all(|found| found["source"] == "depthloom"));
    }
    let broken = EXPERIMENT.replacen("{ cap: 80 }", "{ cap: 80", 1);
    assert_eq!(client.replace(&address, 40, &broken).len(), 1, "a bracket that is not closed");
    assert_eq!(client.replace(&address, 41, EXPERIMENT), [] as [Json; 0]);
    assert_eq!(client.finish(), 0);
}

#[test]
fn an_experiment_that_is_typed_from_its_first_character_has_no_failing_request() {
    let folder = tempfile::tempdir().expect("a folder");
    let address = uri(&folder.path().join("look.yaml"));
    let mut client = Client::initialized(folder.path());
    client.open(&address, "");
    for (version, (end, _)) in (2..).zip(EXPERIMENT.char_indices().step_by(5)) {
        let text = &EXPERIMENT[..end];
        let document = json!({ "uri": address, "version": version });
        let changes = json!([{ "text": text }]);
        client.notify("textDocument/didChange", &json!({ "textDocument": document, "contentChanges": changes }));
        for method in ["completion", "hover", "definition"] {
            client.at(method, &address, position(text, end));
        }
    }
    assert_eq!(client.finish(), 0);
}

#[test]
fn columns_count_utf_16_units_and_changes_are_applied_one_by_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let address = uri(&folder.path().join("straße ä.yaml"));
    let address = address.replace(' ', "%20").replace('ß', "%C3%9F").replace('ä', "%C3%A4");
    let mut client = Client::initialized(folder.path());
    let text = EXPERIMENT.replacen("experiment: look", "experiment: look\ndescription: \"ä𝄞\"", 1);
    assert_eq!(client.open(&address, &text), [] as [Json; 0]);
    let range = |line: u32, from: u32, to: u32| json!({ "start": { "line": line, "character": from }, "end": { "line": line, "character": to } });
    // `"ä𝄞"` becomes `"ä"`, then a key follows on the same line.
    let changes = json!([
        { "range": range(1, 15, 17), "text": "" },
        { "range": range(1, 16, 16), "text": "\nsurces: { ä𝄞: 1 }" },
    ]);
    client.notify(
        "textDocument/didChange",
        &json!({ "textDocument": { "uri": address, "version": 2 }, "contentChanges": changes }),
    );
    let found = client.diagnostics(&address, 2);
    let now = text.replacen("\"ä𝄞\"", "\"ä\"\nsurces: { ä𝄞: 1 }", 1);
    assert_eq!(shown(&now, &found)[0].1, "surces", "{found:?}");
    // An error behind characters of two units.
    let text = EXPERIMENT.replacen("{ cap: 80 }", "{ \"𝄞𝄞\": 1, cap: x }", 1);
    let found = client.replace(&address, 3, &text);
    let underlined: Vec<String> = shown(&text, &found).into_iter().map(|(_, words)| words).collect();
    assert!(underlined.contains(&"x".to_owned()) && underlined.contains(&"\"𝄞𝄞\"".to_owned()), "{found:?}");
    assert_eq!(client.finish(), 0);
}

#[test]
fn open_texts_replace_the_files_that_an_experiment_extends() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    fs::write(at("base.yaml"), EXPERIMENT).expect("written");
    fs::write(at("nodes.yaml"), "nodes:\n  edges: { kind: confidence/edges, inputs: { image: source/left } }\n")
        .expect("written");
    let main = "experiment: main\nextends: base.yaml\nstages:\n  third:\n    source: street\n    nodes: { graph: nodes.yaml }\nrecord: [third.edges/mask]\n";
    let (main_uri, base_uri, nodes_uri) = (uri(&at("main.yaml")), uri(&at("base.yaml")), uri(&at("nodes.yaml")));
    let mut client = Client::initialized(folder.path());
    assert_eq!(client.open(&main_uri, main), [] as [Json; 0]);
    assert_eq!(client.open(&base_uri, EXPERIMENT), [] as [Json; 0]);
    // An unsaved error of the base: reported there, once, though two open documents lead to it.
    let wrong = EXPERIMENT.replacen("cap: 80", "cop: 80", 1);
    let found = client.replace(&base_uri, 2, &wrong);
    assert_eq!(shown(&wrong, &found).iter().map(|(_, words)| words.as_str()).collect::<Vec<_>>(), ["cop"]);
    assert_eq!(client.replace(&base_uri, 3, EXPERIMENT), [] as [Json; 0]);
    // An error of a graph file that is not open, then of the same file while it is.
    fs::write(at("nodes.yaml"), "nodes:\n  edges: { kind: confidence/edge, inputs: { image: source/left } }\n")
        .expect("written");
    client.notify("textDocument/didSave", &json!({ "textDocument": { "uri": nodes_uri } }));
    let is_of_nodes = |params: &Json| params["uri"] == nodes_uri && params["diagnostics"] != json!([]);
    let found = client.notification("textDocument/publishDiagnostics", is_of_nodes);
    assert!(found["diagnostics"][0]["message"].as_str().expect("text").contains("confidence/edge"), "{found}");
    let graph = "nodes:\n  edges: { kind: confidence/edges, inputs: { imag: source/left } }\n";
    let found = client.open(&nodes_uri, graph);
    assert!(shown(graph, &found).iter().any(|(_, words)| words == "imag"), "{found:?}");
    assert_eq!(client.finish(), 0);
}

#[test]
fn broken_messages_and_wrong_requests_do_not_end_the_server() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut client = Client::start(folder.path());
    let early = client.request("textDocument/hover", &json!({}));
    assert_eq!(early["error"]["code"], -32002, "{early}");
    client.request("initialize", &json!({ "capabilities": {} }));
    client.send_bytes(b"Content-Length: 9\r\n\r\n{not json");
    let logged = client.notification("window/logMessage", |_| true);
    assert!(logged["message"].as_str().expect("text").contains("not JSON-RPC"), "{logged}");
    client.send_bytes(b"nonsense\r\n\r\n");
    client.notification("window/logMessage", |_| true);
    client.send_bytes(b"Content-Length: 99999999999999999999\r\n\r\n");
    client.notification("window/logMessage", |_| true);
    assert_eq!(client.request("textDocument/format", &json!({}))["error"]["code"], -32601);
    assert_eq!(client.request("textDocument/hover", &json!([1]))["error"]["code"], -32602);
    let nowhere = json!({ "textDocument": { "uri": "file:///none.yaml" }, "position": { "line": 0, "character": 0 } });
    assert_eq!(client.request("textDocument/hover", &nowhere)["error"]["code"], -32602);
    client.notify("textDocument/didChange", &json!({ "textDocument": 3 }));
    client.notification("window/logMessage", |_| true);
    client.notify("$/cancelRequest", &json!({ "id": 1 }));
    assert_eq!(client.request("shutdown", &Json::Null)["result"], Json::Null);
    assert_eq!(client.request("textDocument/hover", &json!({}))["error"]["code"], -32600);
    client.notify("exit", &Json::Null);
    assert_eq!(client.exit_code(), 0);
}

#[test]
fn without_shutdown_the_exit_code_is_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut client = Client::initialized(folder.path());
    client.notify("exit", &Json::Null);
    assert_eq!(client.exit_code(), 1);
    assert_eq!(Client::initialized(folder.path()).exit_code(), 1, "the stream ends");
    assert_eq!(Client::start(folder.path()).exit_code(), 0, "the conversation never began");
}
