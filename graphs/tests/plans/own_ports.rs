//! Nodes that declare their ports themselves.

use depthloom_graphs::contracts::{Contract, Rate};

use super::{Written, nodes};

/// An experiment with a node of one's own: what is in its `ports:`, and what is wired to it.
fn plan(with: &str, wired: &str) -> depthloom_graphs::plan::Plan {
    let text = format!(
        "experiment: own
sources: {{ test: {{ kind: synthetic/road }} }}
stages:
  compare:
    source: test
    nodes:
      stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }} }}
      metres: {{ kind: depth/from-disparity, inputs: {{ disparity: stereo/disparity, calibration: source/calibration }} }}
      own: {{ kind: toy/own, with: {{ {with} }}, inputs: {{ {wired} }} }}
    score:
      ground_truth: source/depth
      estimates: {{ stereo: metres/depth }}
"
    );
    Written::new(&[("main.yaml", &text)]).plan(&[])
}

#[test]
fn they_are_planned_like_those_of_a_kind() {
    let ports = "ports: { inputs: { depth: depth, hint: { type: weight, optional: true } }, outputs: { sure: weight, depth: depth } }";
    let plan = plan(ports, "depth: metres/depth");
    let own = nodes(&plan, 0, "own")[0];
    let inputs: Vec<_> = own.inputs.iter().map(|input| (input.port.name, input.from.is_some())).collect();
    assert_eq!(inputs, [("depth", true), ("hint", false)]);
    let outputs: Vec<_> = own.outputs.iter().map(|output| (output.topic.as_str(), output.recorded)).collect();
    assert_eq!(outputs, [("/compare/own/depth", true), ("/compare/own/sure", true)]);
    assert_eq!(own.contract, Contract::Pure);
}

#[test]
fn a_parameter_may_decide_the_contract() {
    let with = "contract: ordered, ports: { inputs: { depth: depth }, outputs: { mean: { type: depth, rate: once } } }";
    let plan = plan(with, "depth: metres/depth");
    let own = nodes(&plan, 0, "own")[0];
    assert_eq!((own.contract, own.outputs[0].port.rate), (Contract::Ordered, Rate::Once));
}

#[test]
fn the_way_they_are_written_enters_no_key_and_what_they_are_does() {
    let node_hash = |with: &str, wired: &str| nodes(&plan(with, wired), 0, "own")[0].node_hash;
    let wired = "a: metres/depth, b: source/depth";
    let base = node_hash("ports: { inputs: { a: depth, b: depth }, outputs: { c: depth } }", wired);
    let whole = "ports: { outputs: { c: { type: depth, rate: frame } }, inputs: { b: { type: depth, optional: false }, a: depth } }";
    assert_eq!(node_hash(whole, wired), base);
    let swapped = "b: metres/depth, a: source/depth";
    assert_ne!(node_hash(whole, swapped), base, "what is wired to which port decides");
    assert_ne!(node_hash("ports: { inputs: { a: depth, b: depth }, outputs: { d: depth } }", wired), base);
}
