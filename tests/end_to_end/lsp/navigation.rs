//! Hover, definitions, uses and renaming.

use std::fs;

use serde_json::{Value as Json, json};

use super::EXPERIMENT;
use super::client::{Client, edited, find, uri, words};
use crate::support::{depthloom, succeed};

fn hover(client: &mut Client, address: &str, place: (usize, usize)) -> String {
    client.at("hover", address, place)["contents"]["value"].as_str().unwrap_or_default().to_owned()
}

#[test]
fn hover_shows_documentation_and_resolved_values() {
    let folder = tempfile::tempdir().expect("a folder");
    let address = uri(&folder.path().join("look.yaml"));
    let mut client = Client::initialized(folder.path());
    assert_eq!(client.open(&address, EXPERIMENT), [] as [Json; 0]);
    for (words, within, expected) in [
        ("kind: filter/median", 8, "# filter/median"),
        ("cap: 80", 1, "**cap**: number"),
        ("cap: 80", 1, "- `120`: far+block=5, far+block=9"),
        ("size: 3", 1, "- `5`: direct+block=5"),
        ("network: unet-tiny", 12, "unet-tiny"),
        ("steps: 1", 1, "Resolved value: `1`"),
        ("disparity: stereo/disparity, calibration", 2, "input of `depth`"),
        ("depth: depth/depth }, with", 8, "node of the kind `depth/from-disparity`"),
        ("depth: depth/depth }, with", 14, "output, depth"),
        ("preset: martins2018", 2, "Named settings"),
        ("preset: martins2018", 9, "Table I"),
        ("second.depth.with.cap: 120", 20, "**cap**: number"),
        ("second.depth.with.cap: 120", 9, "node of the kind"),
        ("source: street", 2, "Which of `sources`"),
        ("source: street", 9, "source of the kind `synthetic/road`"),
        ("second:", 1, "stage on the source `street`"),
        ("direct: {", 1, "variant that changes"),
        ("raw: depth/depth", 1, "scored from `depth/depth`"),
        ("variants:", 1, "The same experiment with something changed"),
    ] {
        let text = hover(&mut client, &address, find(EXPERIMENT, words, within));
        assert!(text.contains(expected), "{words}: {text}");
    }
    // A default that is not written.
    let text = EXPERIMENT.replacen("with: { cap: 80 }", "with: {}", 1);
    client.replace(&address, 2, &text);
    let values = hover(&mut client, &address, find(&text, "second.depth.with.cap: 120", 20));
    assert!(values.contains("- `120`: far+"), "{values}");
    assert_eq!(client.at("hover", &address, (999, 0)), Json::Null);
    assert_eq!(client.finish(), 0);
}

#[test]
fn hover_over_a_node_shows_what_would_be_reused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("small.yaml");
    let text = "experiment: small
sources: { street: { kind: synthetic/road, with: { frames: 0..2, width: 320, height: 96 } } }
stages:
  look:
    source: street
    nodes:
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
";
    fs::write(&path, text).expect("written");
    let run = ["run", "small.yaml", "--quiet", "--no-page"];
    succeed(depthloom().current_dir(folder.path()).args(run));
    let address = uri(&path);
    let mut client = Client::initialized(folder.path());
    let changed = text.replacen("confidence/edges, inputs", "confidence/edges, with: { threshold: 9 }, inputs", 1);
    let diagnostics = client.open(&address, text);
    assert_eq!(diagnostics, [] as [Json; 0]);
    let reuse = |client: &mut Client, text: &str, node: &str| {
        let mut shown = String::new();
        for _ in 0..400 {
            shown = hover(client, &address, find(text, node, 1));
            if !shown.contains("being determined") {
                break;
            }
        }
        shown
    };
    let shown = reuse(&mut client, text, "stereo: {");
    assert!(shown.contains("Reuse: all 2 results would be reused"), "{shown}");
    if client.replace(&uri(&path), 2, &changed).is_empty() {
        let shown = reuse(&mut client, &changed, "edges: {");
        assert!(shown.contains("would run 2 times"), "{shown}");
    }
    assert_eq!(client.finish(), 0);
}

#[test]
fn programs_are_never_started_for_a_hover() {
    let folder = tempfile::tempdir().expect("a folder");
    let marker = folder.path().join("started");
    let text = format!(
        "experiment: own
sources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..1 }} }} }}
stages:
  look:
    source: street
    nodes:
      own:
        kind: process
        inputs: {{ image: source/left }}
        with: {{ command: [touch, {}], ports: {{ inputs: {{ image: image }}, outputs: {{ depth: depth }} }} }}
",
        marker.display()
    );
    let address = uri(&folder.path().join("own.yaml"));
    let mut client = Client::initialized(folder.path());
    assert_eq!(client.open(&address, &text), [] as [Json; 0]);
    let mut shown = String::new();
    for _ in 0..400 {
        shown = hover(&mut client, &address, find(&text, "own:\n        kind", 1));
        if !shown.contains("being determined") {
            break;
        }
    }
    assert!(shown.contains("Reuse: not known:"), "{shown}");
    assert_eq!(client.finish(), 0);
    assert!(!marker.exists());
}

#[test]
fn definitions_are_found_through_extends_and_graph_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let nodes = "nodes:\n  edges: { kind: confidence/edges, inputs: { image: source/left } }\n";
    let main = "experiment: main
extends: base.yaml
stages:
  second:
    nodes:
      smooth: { with: { size: 5 } }
  third:
    source: street
    nodes:
      graph: nodes.yaml
      merged: { kind: fusion/confidence, inputs: { mono: second.mono/depth, stereo: depth/depth, weight: edges/mask } }
variants:
  narrow: { second.depth.with.cap: 40, third.edges.with: {} }
";
    fs::write(at("base.yaml"), EXPERIMENT).expect("written");
    fs::write(at("nodes.yaml"), nodes).expect("written");
    let address = uri(&at("main.yaml"));
    let mut client = Client::initialized(folder.path());
    client.open(&address, main);
    for (words_at, within, file, text, key) in [
        ("second.mono/depth", 8, "base.yaml", EXPERIMENT, "mono:\n        kind"),
        ("second.mono/depth", 1, "base.yaml", EXPERIMENT, "second:"),
        ("weight: edges/mask", 9, "nodes.yaml", nodes, "edges:"),
        ("second.depth.with.cap", 9, "base.yaml", EXPERIMENT, "depth:\n        kind"),
        ("third.edges.with", 7, "nodes.yaml", nodes, "edges:"),
        ("source: street", 9, "base.yaml", EXPERIMENT, "street:"),
        ("smooth: {", 1, "base.yaml", EXPERIMENT, "smooth: { kind"),
        ("third.edges", 1, "main.yaml", main, "third:"),
    ] {
        let found = client.at("definition", &address, find(main, words_at, within));
        assert_eq!(found["uri"], uri(&at(file)), "{words_at}");
        let (line, character) = find(text, key, 0);
        assert_eq!(found["range"]["start"], json!({ "line": line, "character": character }), "{words_at}");
    }
    // Names that other files define are not renamed here.
    let place = find(main, "second.mono/depth", 8);
    let params = json!({ "textDocument": { "uri": address }, "position": { "line": place.0, "character": place.1 }, "newName": "x" });
    let refused = client.request("textDocument/rename", &params);
    assert!(refused["error"]["message"].as_str().expect("text").contains("base.yaml:"), "{refused}");
    assert_eq!(client.finish(), 0);
}

#[test]
fn renaming_reaches_open_files_that_extend_the_document() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let graph = "nodes:\n  edges: { kind: confidence/edges, inputs: { image: source/left } }\n";
    let main = "experiment: main
extends: base.yaml
stages:
  third: { source: street, nodes: { graph: nodes.yaml } }
variants:
  near: { second.depth.with.cap: 40, third.edges.with: {} }
only: [\"near+*\"]
record: [third.edges/mask, second.depth/depth]
";
    fs::write(at("base.yaml"), EXPERIMENT).expect("written");
    fs::write(at("nodes.yaml"), graph).expect("written");
    let [main_uri, base_uri, graph_uri] = ["main.yaml", "base.yaml", "nodes.yaml"].map(|name| uri(&at(name)));
    let mut client = Client::initialized(folder.path());
    assert_eq!(client.open(&main_uri, main), [] as [Json; 0]);
    client.open(&base_uri, EXPERIMENT);
    client.open(&graph_uri, graph);
    let mut rename = |address: &str, place: (usize, usize), new_name: &str| {
        let position = json!({ "line": place.0, "character": place.1 });
        let params = json!({ "textDocument": { "uri": address }, "position": position, "newName": new_name });
        client.request("textDocument/rename", &params)["result"]["changes"].clone()
    };
    let changes = rename(&base_uri, find(EXPERIMENT, "depth:\n        kind", 1), "metres");
    assert_eq!(edited(main, &changes[&main_uri]), main.replace("second.depth", "second.metres"));
    let expected = by_hand(&[
        ("      depth:\n", "      metres:\n"),
        ("depth/depth", "metres/depth"),
        ("second.depth", "second.metres"),
    ]);
    assert_eq!(edited(EXPERIMENT, &changes[&base_uri]), expected);
    let changes = rename(&graph_uri, find(graph, "edges:", 1), "lines");
    assert_eq!(edited(graph, &changes[&graph_uri]), graph.replace("edges:", "lines:"));
    assert_eq!(edited(main, &changes[&main_uri]), main.replace("third.edges", "third.lines"));
    assert_eq!(changes.as_object().expect("files").len(), 2, "{changes}");
    assert_eq!(client.finish(), 0);
}

/// The experiment with a name replaced by hand.
fn by_hand(replacements: &[(&str, &str)]) -> String {
    let mut text = EXPERIMENT.to_owned();
    for (from, to) in replacements {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    text
}

#[test]
fn renaming_changes_every_use_and_the_result_is_right() {
    let folder = tempfile::tempdir().expect("a folder");
    let address = uri(&folder.path().join("look.yaml"));
    let mut client = Client::initialized(folder.path());
    assert_eq!(client.open(&address, EXPERIMENT), [] as [Json; 0]);
    let cases: [(&str, usize, &str, String); 7] = [
        (
            "depth: depth/depth }, with",
            8,
            "metres",
            by_hand(&[
                ("      depth:\n", "      metres:\n"),
                ("depth/depth", "metres/depth"),
                ("second.depth", "second.metres"),
            ]),
        ),
        ("second:", 2, "zweite_ä", by_hand(&[("second", "zweite_ä")])),
        ("far: {", 1, "distant", by_hand(&[("far:", "distant:"), ("far+*", "distant+*")])),
        ("street:", 1, "road", by_hand(&[("street", "road")])),
        (
            "model: first.train/model",
            14,
            "learn",
            by_hand(&[("      train:", "      learn:"), ("first.train", "first.learn")]),
        ),
        (
            "smooth: { kind",
            1,
            "median",
            by_hand(&[
                ("smooth: { kind", "median: { kind"),
                ("smooth/depth", "median/depth"),
                ("second.smooth", "second.median"),
                ("/second/smooth", "/second/median"),
            ]),
        ),
        ("raw: depth/depth", 1, "plain", by_hand(&[("raw:", "plain:")])),
    ];
    for (version, (words_at, within, new_name, expected)) in (2..).step_by(2).zip(cases) {
        let place = find(EXPERIMENT, words_at, within);
        let prepared = client.at("prepareRename", &address, place);
        assert_eq!(words(EXPERIMENT, &prepared["range"]), prepared["placeholder"].as_str().expect("text"));
        let uses = client.request(
            "textDocument/references",
            &json!({
                "textDocument": { "uri": address }, "position": { "line": place.0, "character": place.1 },
                "context": { "includeDeclaration": true },
            }),
        );
        let params = json!({
            "textDocument": { "uri": address }, "position": { "line": place.0, "character": place.1 }, "newName": new_name,
        });
        let response = client.request("textDocument/rename", &params);
        let edits = &response["result"]["changes"][&address];
        assert!(uses["result"].as_array().expect("uses").len() >= edits.as_array().expect("edits").len());
        let renamed = edited(EXPERIMENT, edits);
        assert_eq!(renamed, expected, "{words_at}");
        assert_eq!(client.replace(&address, version, &renamed), [] as [Json; 0], "{words_at}");
        client.replace(&address, version + 1, EXPERIMENT);
    }
    for (words_at, within, new_name, why) in [
        ("far: {", 1, "full", "exists"),
        ("depth: depth/depth }, with", 8, "source", "the language uses that word"),
        ("depth: depth/depth }, with", 8, "a b", "cannot hold"),
        ("depth: depth/depth }, with", 8, "", "needs a name"),
        ("left: source/left", 8, "x", "stands for the stage's source"),
        ("cap: 80", 1, "x", "only stages, nodes, sources"),
    ] {
        let place = find(EXPERIMENT, words_at, within);
        let params = json!({
            "textDocument": { "uri": address }, "position": { "line": place.0, "character": place.1 }, "newName": new_name,
        });
        let refused = client.request("textDocument/rename", &params);
        assert!(refused["error"]["message"].as_str().is_some_and(|text| text.contains(why)), "{new_name}: {refused}");
    }
    let symbols = client.request("textDocument/documentSymbol", &json!({ "textDocument": { "uri": address } }));
    let names: Vec<&str> =
        symbols["result"].as_array().expect("a list").iter().filter_map(|symbol| symbol["name"].as_str()).collect();
    assert_eq!(names, ["experiment", "sources", "stages", "variants", "matrix"]);
    assert_eq!(client.finish(), 0);
}
