//! Nodes that learn: which parameters tell two of them apart.

use super::{Written, loaded_with, nodes, plan_of, try_load};
use depthloom_graphs::plan::VariantId;

/// An experiment that learns; `with` are the train's parameters, `more` is appended.
fn learning(with: &str, more: &str) -> String {
    format!(
        "experiment: learning
sources: {{ test: {{ kind: synthetic/road }} }}
stages:
  learn:
    source: test
    nodes:
      stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }} }}
      edges: {{ kind: confidence/edges, inputs: {{ image: source/left }} }}
      samples: {{ kind: learn/samples, inputs: {{ image: source/left, target: stereo/disparity, mask: edges/mask }} }}
      train: {{ kind: learn/ssl, inputs: {{ samples: samples/samples }}, with: {{ {with} }} }}
{more}"
    )
}

#[test]
fn fault_14_operational_parameters_enter_no_recipe_and_no_recording() {
    let train = |with: &str| nodes(&plan_of(&learning(with, "")), 0, "train")[0].clone();
    let (often, seldom, other) = (train("checkpoint_every: 1"), train(""), train("steps: 3"));
    assert_eq!(often.node_hash, seldom.node_hash);
    assert_eq!(often.portable, seldom.portable);
    assert!(often.portable.get("checkpoint_every").is_none() && often.portable.get("steps").is_some());
    assert_eq!(often.params["checkpoint_every"], 1, "it is built with its own parameters");
    assert_ne!(often.node_hash, other.node_hash);
}

#[test]
fn operational_parameters_come_from_the_command_line_and_change_no_recipe() {
    let written = Written::new(&[("main.yaml", &learning("checkpoint_every: 5", ""))]);
    let train = |set: &[(&str, &str)]| nodes(&written.plan(set), 0, "train")[0].clone();
    let (plain, set) = (train(&[]), train(&[("learn.train.with.checkpoint_every", "9")]));
    assert_eq!((&plain.params["checkpoint_every"], &set.params["checkpoint_every"]), (&5.into(), &9.into()));
    assert_eq!((plain.node_hash, plain.portable), (set.node_hash, set.portable));
}

#[test]
fn fault_05_trainings_that_differ_in_operational_parameters_alone_are_one_node() {
    let variants = "variants: { a: {}, b: { learn.train.with.checkpoint_every: 7 }, c: { learn.train.with.steps: 9 } }";
    let written = Written::new(&[("main.yaml", &learning("checkpoint_every: 5", variants))]);
    let loaded = loaded_with(&written.path("main.yaml"), &[]);
    let trainers = nodes(&loaded.plan, 0, "train");
    assert_eq!(trainers.len(), 2, "c learns otherwise");
    assert_eq!(
        (&trainers[0].variants, &trainers[0].params["checkpoint_every"]),
        (&[0, 1].map(VariantId).to_vec(), &5.into())
    );
    let message = loaded.warnings.to_string();
    assert!(
        message.contains("node `train` differs from `train` in parameters alone that decide no result"),
        "{message}"
    );
    assert!(message.contains("run with the parameters of `train` of variant `a`"), "{message}");
}

#[test]
fn fault_05_trainings_from_weights_of_equal_content_are_one_node() {
    let variants =
        "variants: { a: {}, b: { learn.train.with.weights: b.bin }, c: { learn.train.with.weights: c.bin } }";
    let text = learning("weights: a.bin", variants);
    let written = Written::new(&[("main.yaml", &text), ("a.bin", "equal"), ("b.bin", "equal"), ("c.bin", "other")]);
    let plan = written.plan(&[]);
    let trainers = nodes(&plan, 0, "train");
    assert_eq!(
        trainers.iter().map(|node| node.variants.clone()).collect::<Vec<_>>(),
        [vec![VariantId(0), VariantId(1)], vec![VariantId(2)]]
    );
}

#[test]
fn fault_17_what_a_node_cannot_do_with_its_inputs_is_said_with_the_plan() {
    let written =
        Written::new(&[("main.yaml", &learning("", "variants: { a: {}, b: { learn.train.with.network: deaf } }"))]);
    let message = try_load(&written.path("main.yaml"), &[]).unwrap_err().to_string();
    assert!(message.contains("node `train`: a deaf network cannot learn (in variant `b`)"), "{message}");
    assert!(message.contains("help: choose another"), "{message}");
}
