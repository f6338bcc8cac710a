//! Variants and matrices: what they change, what they are called, which nodes they share.

use depthloom_graphs::plan::{Factor, Plan, PlannedNode, VariantId};

use super::{Written, labels, loaded_with, nodes, plan_of, stereo, try_load};

/// By variant, `axis: value`.
fn factors(plan: &Plan) -> Vec<Vec<String>> {
    let labels =
        |factors: &Vec<Factor>| factors.iter().map(|factor| format!("{}: {}", factor.axis, factor.value)).collect();
    plan.factors.iter().map(labels).collect()
}

#[test]
fn variants_that_change_a_source_make_runs_of_their_own() {
    let text = concat!("experiment: seeds
sources:
  train: { kind: synthetic/road, with: { seed: 1 } }
  test: { kind: synthetic/road, with: { seed: 2 } }
stages:
  learn:
    source: train
", lesson!(), "  compare:
    source: test
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      mono: { kind: mono/onnx, inputs: { image: source/left, calibration: source/calibration, model: learn.train/model } }
    score: { ground_truth: source/depth, estimates: { mono: mono/depth } }
variants:
  full: {}
  other_lesson: { sources.train.with.seed: 7 }
  other_test: { sources.test.with.seed: 7 }
  smaller_cap: { compare.mono.with.cap: 20 }
");
    let plan = plan_of(text);
    let runs: Vec<(&str, &str, Vec<usize>)> = plan
        .runs
        .iter()
        .map(|run| (run.stage.as_str(), run.prefix.as_str(), run.variants.iter().map(|variant| variant.0).collect()))
        .collect();
    assert_eq!(
        runs,
        [
            ("learn", "/learn/full", vec![0, 2, 3]),
            ("learn", "/learn/other_lesson", vec![1]),
            ("compare", "/compare/full", vec![0, 1, 3]),
            ("compare", "/compare/other_test", vec![2]),
        ]
    );
    // Two models; stereo of the stage compared is shared by the variants on the same source, though the models differ.
    assert_eq!(nodes(&plan, 2, "stereo")[0].variants, [0, 1, 3].map(VariantId));
    let mono = nodes(&plan, 2, "mono");
    assert_eq!(
        mono.iter().map(|node| node.variants.clone()).collect::<Vec<_>>(),
        [0, 1, 3].map(|variant| vec![VariantId(variant)])
    );
    let model = |node: &PlannedNode| node.inputs[2].from.clone();
    assert_ne!(model(mono[0]), model(mono[1]), "equal node hashes, but another source: never one node");
    assert_eq!(mono[0].node_hash, mono[1].node_hash);
    assert_eq!(plan.runs[2].source.outputs[0].topic, "/compare/full/source/left");
    assert_eq!(
        plan.runs[2].source.outputs[0].aliases,
        ["/compare/other_lesson/source/left", "/compare/smaller_cap/source/left"]
    );
    assert_eq!(labels(&plan), ["full/mono", "other_lesson/mono", "smaller_cap/mono", "other_test/mono"]);
}

#[test]
fn a_new_kind_in_a_variant_drops_the_old_parameters_and_keeps_the_inputs() {
    let text = stereo(
        "variants: { full: {}, edges: { compare.fused.kind: toy/offset, compare.fused.inputs.offset: average/depth } }",
    );
    let text = text
        .replace("      fused:", "      average: { kind: toy/average, inputs: { depth: depth/depth } }\n      fused:");
    // toy/offset needs an aggregate value of an earlier stage; here it is its own stage's.
    let wrong = Written::new(&[("main.yaml", &text)]);
    let error = try_load(&wrong.path("main.yaml"), &[]).unwrap_err();
    assert_eq!(error.iter().count(), 1, "{error}");
    assert!(error.to_string().contains("known only after the last frame"), "{error}");

    let text = stereo(
        "variants: { full: {}, cap: { compare.fused.kind: filter/median, compare.fused.with.size: 3 }, plain: { compare.stereo.kind: stereo/sgbm, compare.stereo.with.block: 7 } }",
    );
    let plan = plan_of(
        &text.replace("inputs: { depth: depth/depth } }", "inputs: { depth: depth/depth }, with: { sizes: [1] } }"),
    );
    let sizes = |variant: usize| {
        let node =
            nodes(&plan, 0, "fused").into_iter().find(|node| node.variants.contains(&VariantId(variant))).unwrap();
        (node.params["size"].clone(), node.params["sizes"].clone())
    };
    // Setting the same kind again keeps the parameters.
    assert_eq!(sizes(1), (3.into(), serde_json::json!([1])));
}

#[test]
fn a_matrix_is_every_combination() {
    let plan = plan_of(&stereo(
        "matrix:
  compare.stereo.with.block: [3, 5]
  compare.fused.with.size: [1, 5]
  exclude: [ { compare.stereo.with.block: 3, compare.fused.with.size: 1 } ]
  include: [ { compare.stereo.with.mode: hh } ]
",
    ));
    assert_eq!(plan.variants, ["block=3+size=5", "block=5+size=1", "block=5+size=5", "mode=hh"]);
    assert_eq!(nodes(&plan, 0, "stereo").len(), 3);
    assert_eq!(nodes(&plan, 0, "fused").len(), 4);
    assert_eq!(factors(&plan)[..2], [vec!["block: 3", "size: 5"], vec!["block: 5", "size: 1"]]);
    assert_eq!(factors(&plan)[3], ["mode: hh"]);
    assert!(plan_of(&stereo("variants: { full: {} }")).factors.is_empty(), "there is no axis");
}

#[test]
fn a_matrix_with_variants_is_their_product() {
    let plan = plan_of(&stereo(
        "variants: { full: {}, hh: { compare.stereo.with.mode: hh } }
matrix: { compare.fused.with.size: [3, 5], sources.test.with.frames: [0..4, 'ids/list.txt'] }
",
    ));
    assert_eq!(
        plan.variants,
        [
            "full+size=3+frames=0..4",
            "full+size=3+frames=ids-list.txt",
            "full+size=5+frames=0..4",
            "full+size=5+frames=ids-list.txt",
            "hh+size=3+frames=0..4",
            "hh+size=3+frames=ids-list.txt",
            "hh+size=5+frames=0..4",
            "hh+size=5+frames=ids-list.txt",
        ]
    );
    assert_eq!(factors(&plan)[1], ["variant: full", "size: 3", "frames: ids/list.txt"]);
    assert_eq!(plan.runs.len(), 2, "one for each source");
    assert!(labels(&plan).contains(&"hh+size=5+frames=0..4/fused"));
}

#[test]
fn equal_paths_of_a_matrix_are_told_apart_by_their_nodes() {
    let text = stereo("matrix: { compare.depth.with.cap: [50, 80], compare.score.cap: [50, 80] }");
    assert_eq!(plan_of(&text).variants[0], "depth.cap=50+score.cap=50");
}

#[test]
fn equal_variants_are_warned_of() {
    let written =
        Written::new(&[("main.yaml", &stereo("variants: { full: {}, same: { compare.stereo.with.block: 5 } }"))]);
    let loaded = loaded_with(&written.path("main.yaml"), &[]);
    let messages: Vec<&str> = loaded.warnings.iter().map(|warning| warning.message.as_str()).collect();
    assert_eq!(messages, ["variant `same` is the same experiment as `full`"]);
    assert_eq!(labels(&loaded.plan), ["stereo", "fused"]);
}

#[test]
fn without_variants_nothing_is_named_after_one() {
    let plan = plan_of(&stereo(""));
    assert_eq!(plan.variants, [""]);
    assert_eq!(labels(&plan), ["stereo", "fused"]);
    assert_eq!(nodes(&plan, 0, "fused")[0].outputs[0].topic, "/compare/fused/depth");
    assert_eq!(plan.runs[0].prefix, "/compare");
}

#[test]
fn variants_and_the_command_line_change_scores_and_sources_too() {
    let plan = plan_of(&stereo(
        "variants: { full: {}, capped: { compare.score.cap: 20, compare.score.estimates.fused.sets: [valid] } }",
    ));
    assert_eq!(labels(&plan), ["full/stereo", "full/fused", "capped/stereo", "capped/fused"]);
    assert_eq!(nodes(&plan, 0, "fused").len(), 1, "what is scored is the same");
    let two = stereo("").replace(
        "test: { kind: synthetic/road }",
        "test: { kind: synthetic/road }\n  other: { kind: synthetic/road, with: { seed: 4 } }",
    );
    let written = Written::new(&[("main.yaml", &two)]);
    let plan =
        written.plan(&[("compare.source", "other"), ("compare.fused.with", "{ size: 3 }"), ("record.view", "true")]);
    assert_eq!(plan.runs[0].source.name, "other");
    assert_eq!(nodes(&plan, 0, "fused")[0].params["size"], 3);
    assert!(plan.record.view);
    assert!(plan.resolved.contains("view: true"), "what was set is recorded: {}", plan.resolved);
}

#[test]
fn a_node_that_one_variant_does_not_need_is_not_run_for_it() {
    let text = stereo(
        "record: [fused]
variants: { full: {}, raw: { compare.fused.inputs.depth: other/depth } }",
    );
    let text = text.replace(
        "      fused:",
        "      other: { kind: filter/median, inputs: { depth: depth/depth }, with: { size: 9 } }\n      fused:",
    );
    let plan = plan_of(&text);
    assert_eq!(nodes(&plan, 0, "other")[0].variants, [VariantId(1)]);
    assert_eq!(nodes(&plan, 0, "depth")[0].variants, [0, 1].map(VariantId));
}

#[test]
fn the_lean_preset_records_inputs_disparities_and_metrics() {
    let recorded = |record: &str| -> Vec<String> {
        let run = &plan_of(&stereo(record)).runs[0];
        let outputs = run.source.outputs.iter().chain(run.nodes.iter().flat_map(|node| &node.outputs));
        outputs.filter(|output| output.recorded).map(|output| output.topic.replace("/compare/", "")).collect()
    };
    let without_scores = |mut topics: Vec<String>| {
        topics.retain(|topic| !topic.starts_with("score."));
        topics
    };
    let lean = recorded("record: { preset: lean }");
    assert!(lean.iter().any(|topic| topic.starts_with("score.")), "{lean:?}");
    let lean = without_scores(lean);
    assert!(lean.contains(&"source/left".to_owned()) && lean.contains(&"stereo/disparity".to_owned()), "{lean:?}");
    assert!(!lean.iter().any(|topic| topic.starts_with("depth/") || topic.starts_with("fused/")), "{lean:?}");
    let more = without_scores(recorded("record: { preset: lean, topics: [fused, '!source/left'] }"));
    assert!(more.contains(&"fused/depth".to_owned()) && !more.contains(&"source/left".to_owned()), "{more:?}");
    assert_eq!(without_scores(recorded("record: { topics: [fused] }")), ["fused/depth"]);
    let broken = Written::new(&[("main.yaml", &stereo("record: { preset: small }"))]);
    let error = try_load(&broken.path("main.yaml"), &[]).expect_err("refused").to_string();
    assert!(error.contains("`preset` must be `lean`"), "{error}");
}
