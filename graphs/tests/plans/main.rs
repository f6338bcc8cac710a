//! Whole experiments to plans: what is shared, what it is called, what it is keyed by.

#[macro_use]
#[path = "../support/lesson.rs"]
mod lesson;

mod files;
mod labelled;
mod learning;
mod own_ports;
#[path = "../toys/mod.rs"]
mod toys;
mod variables;
mod variants;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::Slot;
use depthloom_graphs::language::{Diagnostics, Loaded, Options, load};
use depthloom_graphs::plan::{NodeId, NodeRef, Origin, Plan, PlannedNode, PortId, RunId, VariantId};

fn environment(name: &str) -> Option<String> {
    match name {
        "KITTI" => Some("/data/kitti".to_owned()),
        "CAP" => Some("50".to_owned()),
        "EMPTY" => Some(String::new()),
        "HERE" => Some("there/it/is".to_owned()),
        _ => None,
    }
}

fn try_load(path: &Path, set: &[(&str, &str)]) -> Result<Loaded, Diagnostics> {
    let set = set.iter().map(|(path, value)| ((*path).to_owned(), (*value).to_owned())).collect();
    load(path, &toys::registry(), &Options { set, env: Box::new(environment), ..Options::default() })
}

fn loaded_with(path: &Path, set: &[(&str, &str)]) -> Loaded {
    try_load(path, set).unwrap_or_else(|diagnostics| panic!("{diagnostics}"))
}

fn experiment(name: &str) -> PathBuf {
    Path::new("tests/experiments").join(name)
}

/// An experiment in a folder of its own, with the files beside it.
struct Written {
    folder: tempfile::TempDir,
}

impl Written {
    fn new(files: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().expect("a folder can be made");
        for (name, text) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().expect("it is in the folder")).expect("a folder can be made");
            std::fs::write(path, text).expect("a file can be written");
        }
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn plan(&self, set: &[(&str, &str)]) -> Plan {
        loaded_with(&self.path("main.yaml"), set).plan
    }
}

fn plan_of(text: &str) -> Plan {
    Written::new(&[("main.yaml", text)]).plan(&[])
}

/// A stereo experiment; `more` is appended.
fn stereo(more: &str) -> String {
    format!(
        "experiment: stereo
sources:
  test: {{ kind: synthetic/road }}
stages:
  compare:
    source: test
    nodes:
      stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }}, with: {{ block: 5 }} }}
      depth: {{ kind: depth/from-disparity, inputs: {{ disparity: stereo/disparity, calibration: source/calibration }} }}
      fused: {{ kind: filter/median, inputs: {{ depth: depth/depth }} }}
    score:
      ground_truth: source/depth
      estimates: {{ stereo: depth/depth, fused: fused/depth }}
{more}"
    )
}

fn nodes<'p>(plan: &'p Plan, run: usize, name: &str) -> Vec<&'p PlannedNode> {
    plan.runs[run].nodes.iter().filter(|node| node.name == name).collect()
}

fn labels(plan: &Plan) -> Vec<&str> {
    plan.runs.iter().flat_map(|run| &run.estimates).map(|estimate| estimate.label.as_str()).collect()
}

#[test]
fn table_1_runs_stereo_once_for_all_variants() {
    let Loaded { plan, warnings, .. } = loaded_with(&experiment("table1.yaml"), &[]);
    assert!(warnings.is_empty(), "{warnings}");
    assert_eq!(plan.variants, ["full", "no_weighting", "no_scaling", "average_scaling"]);
    let count = |name: &str| nodes(&plan, 1, name).len();
    assert_eq!([count("stereo"), count("depth"), count("weight"), count("mono")], [1, 1, 1, 1]);
    assert_eq!([count("scaled"), count("merged"), count("fused")], [3, 4, 4]);
    assert_eq!(nodes(&plan, 1, "stereo")[0].variants, [0, 1, 2, 3].map(VariantId));
    assert_eq!(nodes(&plan, 1, "stereo")[0].outputs[0].topic, "/compare/stereo/disparity");
    assert_eq!(nodes(&plan, 1, "scaled")[0].outputs[0].topic, "/compare/full/scaled/depth");
    assert_eq!(nodes(&plan, 1, "scaled")[0].outputs[0].aliases, ["/compare/no_weighting/scaled/depth"]);
    assert_eq!(
        labels(&plan),
        [
            "stereo",
            "full/mono",
            "full/fused",
            "no_weighting/mono",
            "no_weighting/fused",
            "no_scaling/mono",
            "no_scaling/fused",
            "average_scaling/mono",
            "average_scaling/fused"
        ]
    );
}

#[test]
fn every_node_comes_after_those_it_reads() {
    let plan = loaded_with(&experiment("table1.yaml"), &[]).plan;
    for (run_id, run) in RunId::enumerate(&plan.runs) {
        for (id, node) in NodeId::enumerate(&run.nodes) {
            for from in node.inputs.iter().filter_map(|input| input.from.as_ref()) {
                match from {
                    Origin::Here(Slot::Node { node, .. }) => assert!(*node < id),
                    &Origin::Once { run, node, .. } => {
                        assert!(NodeRef { run, node } < NodeRef { run: run_id, node: id });
                    }
                    Origin::Here(Slot::Source { .. }) | Origin::File(_) => {}
                }
            }
        }
    }
}

#[test]
fn the_whole_plan_of_table_1_reads_as_expected() {
    let plan = loaded_with(&experiment("table1.yaml"), &[]).plan;
    insta::assert_snapshot!("table1-summary", plan.summary_text());
    insta::assert_snapshot!("table1-mermaid", plan.mermaid());
    insta::assert_snapshot!("table1-dot", plan.dot());
    let json = plan_of(&stereo("variants: { full: {}, other: { compare.fused.with.size: 3 } }")).summary_json();
    insta::assert_snapshot!("stereo-json", serde_json::to_string_pretty(&json).unwrap());
}

#[test]
fn equal_nodes_on_equal_inputs_have_equal_recipes_in_every_stage() {
    let plan = loaded_with(&experiment("table1.yaml"), &[]).plan;
    // Written with and without the default, on two sources.
    assert_eq!(nodes(&plan, 0, "stereo")[0].node_hash, nodes(&plan, 1, "stereo")[0].node_hash);
}

#[test]
fn what_is_resolved_loads_again_as_the_same_plan() {
    let plan = loaded_with(&experiment("table1-kitti.yaml"), &[("sources.test.with.frames", "[3, 7]")]).plan;
    assert!(plan.resolved.contains("${KITTI}/training"), "machines do not enter: {}", plan.resolved);
    assert!(!plan.resolved.contains("/data/kitti"));
    let again = plan_of(&plan.resolved);
    assert_eq!(again.summary_json(), plan.summary_json());
}

#[test]
fn nodes_of_other_names_that_do_the_same_are_one_node() {
    let plan = plan_of(&stereo("").replace(
        "      fused:",
        "      again: { kind: stereo/sgbm, inputs: { right: source/right, left: source/left } }\n      fused:",
    ));
    let node = nodes(&plan, 0, "stereo")[0];
    assert!(nodes(&plan, 0, "again").is_empty());
    assert_eq!(node.outputs[0].topic, "/compare/stereo/disparity");
    assert_eq!(node.outputs[0].aliases, ["/compare/again/disparity"]);
}

#[test]
fn recipes_know_what_matters_and_nothing_else() {
    let node_hash = |text: &str| {
        let plan = plan_of(text);
        let node_hashes: BTreeMap<String, String> =
            plan.runs[0].nodes.iter().map(|node| (node.name.clone(), node.node_hash.to_string())).collect();
        node_hashes
    };
    let base = node_hash(&stereo(""));
    let same = [
        // Comments, quotes, order of keys, defaults written out, another experiment's name, source and variants.
        format!("# a comment\n{}", stereo("").replace("kind: filter/median", "kind: \"filter/median\"")),
        stereo("").replace("left: source/left, right: source/right", "right: source/right, left: source/left"),
        stereo("").replace("{ block: 5 }", "{ p2: 800, disparities: 64 }"),
        stereo("").replace("{ kind: synthetic/road }", "{ kind: synthetic/road, with: { seed: 9, frames: 0..3 } }"),
        stereo("variants: { full: {}, other: { compare.fused.with.size: 5 } }"),
    ];
    for text in same {
        assert_eq!(node_hash(&text), base, "{text}");
    }
    let other = node_hash(&stereo("").replace("block: 5", "block: 7"));
    for node in ["stereo", "depth", "fused", "score.fused"] {
        assert_ne!(other[node], base[node], "{node} lies downstream of the change");
    }
    let other = node_hash(
        &stereo("").replace("inputs: { depth: depth/depth } }", "inputs: { depth: depth/depth }, with: { size: 3 } }"),
    );
    assert_eq!(other["depth"], base["depth"], "what lies upstream of a change stays");
    assert_ne!(other["fused"], base["fused"]);
    // Which output of the source is read.
    let other = node_hash(&stereo("").replace("{ left: source/left", "{ left: source/right"));
    assert_ne!(other["stereo"], base["stereo"]);
}

#[test]
fn a_kind_whose_engine_this_machine_lacks_can_be_planned_all_the_same() {
    let loaded = loaded_with(&experiment("kind-without-engine.yaml"), &[]);
    assert_eq!(nodes(&loaded.plan, 0, "far").len(), 1);
    assert!(loaded.warnings.0.is_empty(), "the plan does not depend on the machine: {}", loaded.warnings);
}

#[test]
fn scores_take_their_parameters_from_score_and_from_the_estimate() {
    let plan = plan_of(&stereo("").replace(
        "estimates: { stereo: depth/depth,",
        "cap: 50\n      sets: [all, valid]\n      estimates: { stereo: { from: depth/depth, sets: [valid], cap: 30 },",
    ));
    let params = |name: &str| nodes(&plan, 0, name)[0].params.clone();
    assert_eq!(params("score.stereo"), serde_json::json!({ "preset": null, "sets": ["valid"], "cap": 30.0 }));
    assert_eq!(params("score.fused"), serde_json::json!({ "preset": null, "sets": ["all", "valid"], "cap": 50.0 }));
    assert_eq!(nodes(&plan_of(&stereo("")), 0, "score.fused")[0].params["sets"], serde_json::json!(["all"]));
    let estimate = &plan.runs[0].estimates[1];
    assert_eq!(plan.runs[0].nodes[estimate.score_node].name, "score.fused");
    assert_eq!(estimate.truth, Slot::Source { port: PortId(3) });
}

#[test]
fn an_estimate_may_have_a_truth_of_its_own_and_then_no_other_is_wanted() {
    let own = "estimates: { stereo: { from: depth/depth, ground_truth: fused/depth },";
    let text = stereo("").replace("estimates: { stereo: depth/depth,", own);
    let truths = |text: &str| plan_of(text).runs[0].estimates.iter().map(|of| of.truth).collect::<Vec<_>>();
    assert!(matches!(truths(&text)[..], [Slot::Node { .. }, Slot::Source { port: PortId(3) }]), "{:?}", truths(&text));
    let alone = stereo("").replace("estimates: { stereo: depth/depth,", &format!("{own} fused_too: null,"));
    let alone =
        alone.replace("      ground_truth: source/depth\n", "").replace("fused: fused/depth }", "fused: null }");
    assert!(matches!(truths(&alone)[..], [Slot::Node { .. }]), "{alone}");
}

#[test]
fn joined_sources_follow_each_other() {
    let plan = plan_of(&stereo("").replace(
        "{ kind: synthetic/road }",
        "{ concat: [ { kind: synthetic/road, with: { seed: 1 } }, { kind: kitti/stereo2015, with: { root: /data } } ] }",
    ));
    let source = &plan.runs[0].source;
    assert_eq!(
        source.parts.iter().map(|part| part.kind.as_str()).collect::<Vec<_>>(),
        ["synthetic/road", "kitti/stereo2015"]
    );
    // The road's truth may be absent, so the joined one's may.
    assert!(source.outputs[3].port.optional && !source.outputs[0].port.optional);
}

#[test]
fn record_keeps_what_its_patterns_take() {
    let recorded = |record: &str| {
        let plan = plan_of(&stereo(record));
        let run = &plan.runs[0];
        let outputs = run.source.outputs.iter().chain(run.nodes.iter().flat_map(|node| &node.outputs));
        let topics: Vec<String> =
            outputs.filter(|o| o.recorded).map(|o| o.topic.replacen("/compare/", "", 1)).collect();
        topics.join(" ")
    };
    let scores = "score.stereo/scores score.fused/scores";
    let all = "source/left source/right source/calibration source/depth stereo/disparity depth/depth fused/depth";
    assert_eq!(recorded(""), format!("{all} {scores}"));
    assert_eq!(recorded("record: { every: 2 }"), format!("{all} {scores}"));
    assert_eq!(recorded("record: []"), scores);
    assert_eq!(recorded("record: [fused]"), format!("fused/depth {scores}"));
    assert_eq!(recorded("record: { topics: [\"*/depth\"] }"), format!("source/depth depth/depth fused/depth {scores}"));
    assert_eq!(
        recorded("record: [\"*\", \"!source\", \"!compare.stereo\"]"),
        format!("depth/depth fused/depth {scores}")
    );
    assert_eq!(recorded("record: [/compare/source/left, /compare/d*]"), format!("source/left depth/depth {scores}"));
}

#[test]
fn record_keeps_points_of_depths_with_a_calibration() {
    let plan = plan_of(&stereo("record: { points: [fused, \"compare.d*/depth\"] }"));
    let wants = |node, port| plan.record.points.iter().any(|points| points.names("compare", node, port));
    assert!(wants("fused", "depth") && wants("depth", "depth") && !wants("stereo", "disparity"));
    assert!(plan.record.view, "pictures are kept by default");
}
