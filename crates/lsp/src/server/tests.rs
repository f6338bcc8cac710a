//! A conversation with kinds that panic.

use std::io::Cursor;

use depthloom_graphs::contracts::SourceDeclaration;
use depthloom_graphs::{Fault, Port, Registry, Source, SourceKind};
use serde_json::{Value as Json, json};

use super::serve;

struct Broken;
impl SourceKind for Broken {
    type Params = std::collections::BTreeMap<String, u8>;
    fn declaration() -> SourceDeclaration {
        SourceDeclaration { kind: "broken", version: 1, summary: "It panics.", doc: "", outputs: Vec::new() }
    }
    fn outputs(_: &Self::Params) -> Result<Vec<Port>, Fault> {
        panic!("this kind is broken")
    }
    fn open(_: Self::Params) -> Result<Box<dyn Source>, Fault> {
        Err(Fault::new("only declared"))
    }
}

/// All messages of the server in a conversation of which the client does not wait for responses.
fn conversation(messages: &[Json]) -> (bool, Vec<Json>) {
    let framed = messages.iter().map(|message| {
        let body = message.to_string();
        format!("Content-Length: {}\r\n\r\n{body}", body.len())
    });
    let input = Cursor::new(framed.collect::<String>().into_bytes());
    let mut output = Vec::new();
    let is_orderly = serve(&Registry::default().source::<Broken>(), input, &mut output, &|_| Ok(Vec::new()));
    let output = String::from_utf8(output).expect("UTF-8");
    let bodies = output.split("Content-Length: ").skip(1);
    let body = |framed: &str| serde_json::from_str(framed.split_once("\r\n\r\n").expect("a header").1).expect("JSON");
    (is_orderly, bodies.map(body).collect())
}

#[test]
fn a_panic_is_the_error_of_its_request_and_the_next_request_is_served() {
    let text = "experiment: a\nsources: { s: { kind: broken } }\nstages: { t: { source: s, nodes: { n: { kind: x, inputs: { a: } } } } }\n";
    let document = json!({ "uri": "file:///a.yaml", "languageId": "yaml", "version": 1, "text": text });
    let line = text.lines().nth(2).expect("a line");
    let at = json!({ "line": 2, "character": line.find("a: }").expect("an input") + 3 });
    let place = json!({ "textDocument": { "uri": "file:///a.yaml" }, "position": at });
    let (is_orderly, messages) = conversation(&[
        json!({ "jsonrpc": "2.0", "id": 1, "method": "initialize", "params": { "capabilities": {} } }),
        json!({ "jsonrpc": "2.0", "method": "textDocument/didOpen", "params": { "textDocument": document } }),
        json!({ "jsonrpc": "2.0", "id": 2, "method": "textDocument/completion", "params": place }),
        json!({ "jsonrpc": "2.0", "id": 3, "method": "textDocument/documentSymbol", "params": place }),
        json!({ "jsonrpc": "2.0", "id": 4, "method": "shutdown" }),
        json!({ "jsonrpc": "2.0", "method": "exit" }),
    ]);
    assert!(is_orderly);
    let response = |id: u64| messages.iter().find(|message| message["id"] == id).expect("a response");
    let error = &response(2)["error"];
    assert_eq!(error["code"], -32603, "{error}");
    assert!(error["message"].as_str().is_some_and(|text| text.contains("this kind is broken")), "{error}");
    assert_eq!(response(3)["result"][0]["name"], "experiment");
    let is_published = |message: &&Json| message["method"] == "textDocument/publishDiagnostics";
    let published = messages.iter().find(is_published).expect("diagnostics");
    let message = published["params"]["diagnostics"][0]["message"].as_str().expect("text");
    assert!(message.contains("an error of depthloom") && message.contains("this kind is broken"), "{message}");
}
