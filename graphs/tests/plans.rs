//! Whole experiments to plans: what is shared, what it is called, what it is keyed by.

mod toys;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::Slot;
use depthloom_graphs::language::{Diagnostics, Loaded, Options, load};
use depthloom_graphs::plan::{Factor, Origin, Plan, PlannedNode};

fn environment(name: &str) -> Option<String> {
    match name {
        "KITTI" => Some("/data/kitti".to_owned()),
        "CAP" => Some("50".to_owned()),
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
            std::fs::create_dir_all(path.parent().expect("it lies in the folder")).expect("a folder can be made");
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
      truth: source/depth
      estimates: {{ stereo: depth/depth, fused: fused/depth }}
{more}"
    )
}

fn nodes<'p>(plan: &'p Plan, run: usize, name: &str) -> Vec<&'p PlannedNode> {
    plan.runs[run].nodes.iter().filter(|node| node.name == name).collect()
}

/// By variant, `axis: value`.
fn factors(plan: &Plan) -> Vec<Vec<String>> {
    let of =
        |factors: &Vec<Factor>| factors.iter().map(|factor| format!("{}: {}", factor.axis, factor.value)).collect();
    plan.factors.iter().map(of).collect()
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
    assert_eq!(nodes(&plan, 1, "stereo")[0].variants, [0, 1, 2, 3]);
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
    for (r, run) in plan.runs.iter().enumerate() {
        for (n, node) in run.nodes.iter().enumerate() {
            for from in node.inputs.iter().filter_map(|input| input.from.as_ref()) {
                match from {
                    Origin::Here(Slot::Node { node, .. }) => assert!(*node < n),
                    Origin::Once { run, node, .. } => assert!((*run, *node) < (r, n)),
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
    assert_eq!(nodes(&plan, 0, "stereo")[0].recipe, nodes(&plan, 1, "stereo")[0].recipe);
}

#[test]
fn extending_swaps_sources_and_keeps_the_rest() {
    let base = loaded_with(&experiment("table1.yaml"), &[]).plan;
    let kitti = loaded_with(&experiment("table1-kitti.yaml"), &[]).plan;
    assert_eq!(kitti.experiment, "table1-kitti");
    assert_eq!(kitti.about, base.about);
    let part = &kitti.runs[1].source.parts[0];
    assert_eq!(part.kind, "kitti/stereo2015");
    // The old source's seed is gone: a source whose kind changes starts afresh.
    assert_eq!(
        part.params,
        serde_json::json!({ "root": "/data/kitti/training", "frames": "150..156", "truth": "noc" })
    );
    let recipes = |plan: &Plan| plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.recipe).collect::<Vec<_>>();
    assert_eq!(recipes(&base), recipes(&kitti), "what is computed does not depend on where frames come from");
    assert_eq!(
        kitti.written.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(),
        ["table1-kitti.yaml", "table1.yaml"]
    );
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
fn variants_that_change_a_source_make_runs_of_their_own() {
    let text = "experiment: seeds
sources:
  train: { kind: synthetic/road, with: { seed: 1 } }
  test: { kind: synthetic/road, with: { seed: 2 } }
stages:
  learn:
    source: train
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples: { kind: learn/samples, inputs: { image: source/left, target: stereo/disparity, mask: edges/mask } }
      teacher: { kind: learn/ssl, inputs: { samples: samples/samples } }
  compare:
    source: test
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      mono: { kind: mono/onnx, inputs: { image: source/left, calibration: source/calibration, model: learn.teacher/model } }
    score: { truth: source/depth, estimates: { mono: mono/depth } }
variants:
  full: {}
  other_lesson: { sources.train.with.seed: 7 }
  other_test: { sources.test.with.seed: 7 }
  smaller_cap: { compare.mono.with.cap: 20 }
";
    let plan = plan_of(text);
    let runs: Vec<(&str, &str, &[usize])> =
        plan.runs.iter().map(|run| (run.stage.as_str(), run.prefix.as_str(), run.variants.as_slice())).collect();
    assert_eq!(
        runs,
        [
            ("learn", "/learn/full", &[0, 2, 3][..]),
            ("learn", "/learn/other_lesson", &[1]),
            ("compare", "/compare/full", &[0, 1, 3]),
            ("compare", "/compare/other_test", &[2]),
        ]
    );
    // Two models; stereo of the stage compared is shared by the variants on the same source, though the models differ.
    assert_eq!(nodes(&plan, 2, "stereo")[0].variants, [0, 1, 3]);
    let mono = nodes(&plan, 2, "mono");
    assert_eq!(mono.iter().map(|node| node.variants.clone()).collect::<Vec<_>>(), [vec![0], vec![1], vec![3]]);
    let model = |node: &PlannedNode| node.inputs[2].from.clone();
    assert_ne!(model(mono[0]), model(mono[1]), "equal recipes, but another source: never one node");
    assert_eq!(mono[0].recipe, mono[1].recipe);
    assert_eq!(plan.runs[2].source.outputs[0].topic, "/compare/full/source/left");
    assert_eq!(
        plan.runs[2].source.outputs[0].aliases,
        ["/compare/other_lesson/source/left", "/compare/smaller_cap/source/left"]
    );
    assert_eq!(labels(&plan), ["full/mono", "other_lesson/mono", "smaller_cap/mono", "other_test/mono"]);
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
    let recipe = |text: &str| {
        let plan = plan_of(text);
        let recipes: BTreeMap<String, String> =
            plan.runs[0].nodes.iter().map(|node| (node.name.clone(), node.recipe.to_string())).collect();
        recipes
    };
    let base = recipe(&stereo(""));
    let same = [
        // Comments, quotes, order of keys, defaults written out, another experiment's name, source and variants.
        format!("# a comment\n{}", stereo("").replace("kind: filter/median", "kind: \"filter/median\"")),
        stereo("").replace("left: source/left, right: source/right", "right: source/right, left: source/left"),
        stereo("").replace("{ block: 5 }", "{ p2: 800, disparities: 64 }"),
        stereo("").replace("{ kind: synthetic/road }", "{ kind: synthetic/road, with: { seed: 9, frames: 0..3 } }"),
        stereo("variants: { full: {}, other: { compare.fused.with.size: 5 } }"),
    ];
    for text in same {
        assert_eq!(recipe(&text), base, "{text}");
    }
    let other = recipe(&stereo("").replace("block: 5", "block: 7"));
    for node in ["stereo", "depth", "fused", "score.fused"] {
        assert_ne!(other[node], base[node], "{node} lies downstream of the change");
    }
    let other = recipe(
        &stereo("").replace("inputs: { depth: depth/depth } }", "inputs: { depth: depth/depth }, with: { size: 3 } }"),
    );
    assert_eq!(other["depth"], base["depth"], "what lies upstream of a change stays");
    assert_ne!(other["fused"], base["fused"]);
    // Which output of the source is read.
    let other = recipe(&stereo("").replace("{ left: source/left", "{ left: source/right"));
    assert_ne!(other["stereo"], base["stereo"]);
}

#[test]
fn files_enter_recipes_by_content_and_not_by_place() {
    let text = "experiment: weights
sources: { test: { kind: synthetic/road } }
stages:
  compare:
    source: test
    nodes:
      mono: { kind: mono/onnx, inputs: { image: source/left, calibration: source/calibration, model: { file: NET } } }
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples: { kind: learn/samples, inputs: { image: source/left, target: stereo/disparity, mask: edges/mask } }
      teacher: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { weights: WEIGHTS } }
";
    let recipes = |net: &str, weights: &str, content: &str| {
        let text = text.replace("NET", net).replace("WEIGHTS", weights);
        let written = Written::new(&[("main.yaml", &text), (net, content), (weights, content)]);
        let plan = written.plan(&[]);
        let path = plan.runs[0].nodes[0].inputs[2].from.clone();
        assert_eq!(path, Some(Origin::File(written.path(net))), "paths start at the folder of the YAML file");
        (nodes(&plan, 0, "mono")[0].recipe, nodes(&plan, 0, "teacher")[0].recipe)
    };
    let base = recipes("a.onnx", "w.bin", "content");
    assert_eq!(recipes("deep/b.onnx", "deep/v.bin", "content"), base);
    let other = recipes("a.onnx", "w.bin", "other content");
    assert!(other.0 != base.0 && other.1 != base.1);
}

#[test]
fn relative_paths_start_at_the_file_they_are_written_in() {
    let files = [
        (
            "main.yaml",
            "extends: lib/base.yaml
experiment: main
sources: { test: { with: { frames: ids.txt } } }
variants: { full: {}, elsewhere: { sources.test.with.root: here } }",
        ),
        (
            "lib/base.yaml",
            "experiment: base
sources: { test: { kind: kitti/stereo2015, with: { root: ../data, frames: 0..4 } } }
stages:
  compare:
    source: test
    nodes: { graph: graphs/stereo.yaml }
    score: { truth: source/depth, estimates: { stereo: depth/depth } }
",
        ),
        (
            "lib/graphs/stereo.yaml",
            "about: Stereo.
nodes:
  stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
  depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
",
        ),
    ];
    let written = Written::new(&files);
    let plan = written.plan(&[]);
    let params = |run: usize| plan.runs[run].source.parts[0].params.clone();
    let text = |path: PathBuf| path.to_str().unwrap().to_owned();
    assert_eq!(params(0)["root"], text(written.path("data")));
    assert_eq!(params(0)["frames"], text(written.path("ids.txt")));
    assert_eq!(params(1)["root"], text(written.path("here")));
    assert_eq!(plan.runs[0].nodes.len(), 3);
    let names: Vec<&str> = plan.written.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["main.yaml", "lib/base.yaml", "lib/graphs/stereo.yaml"]);
    // What was typed, and what the environment gives, starts at the working directory.
    let plan = written.plan(&[("sources.test.with.root", "typed")]);
    assert_eq!(plan.runs[0].source.parts[0].params["root"], "typed");
    let plan = written.plan(&[("sources.test.with.root", "${HERE}")]);
    assert_eq!(plan.runs[0].source.parts[0].params["root"], "there/it/is");
    let plan = written.plan(&[("sources.test.with.root", "${NOT_SET:-by/default}")]);
    assert_eq!(plan.runs[0].source.parts[0].params["root"], "by/default");
}

#[test]
fn variables_become_what_they_look_like() {
    let depth = |with: &str| {
        let text = stereo("").replace(
            "calibration: source/calibration } }",
            &format!("calibration: source/calibration }}, with: {with} }}"),
        );
        nodes(&plan_of(&text), 0, "depth")[0].params["cap"].clone()
    };
    assert_eq!(depth("{ cap: \"${CAP}\" }"), 50.0);
    assert_eq!(depth("{ cap: \"${NOT_SET:-60.5}\" }"), 60.5);
    // Where text is wanted, a number out of the environment is text.
    let text = stereo("").replace("truth: source/depth", "truth: source/depth\n      preset: ${CAP}");
    assert_eq!(nodes(&plan_of(&text), 0, "score.fused")[0].params["preset"], "50");
}

#[test]
fn a_kind_whose_engine_this_machine_lacks_can_be_planned_all_the_same() {
    let loaded = loaded_with(&experiment("kind-without-engine.yaml"), &[]);
    assert_eq!(nodes(&loaded.plan, 0, "far").len(), 1);
    assert!(loaded.warnings.0.is_empty(), "what a machine has is no matter of the plan: {}", loaded.warnings);
}

#[test]
fn a_variable_that_nothing_needs_may_be_unset() {
    let files = [
        ("main.yaml", "extends: base.yaml\nsources: { test: { kind: synthetic/road } }".to_owned()),
        (
            "base.yaml",
            stereo("")
                .replace("{ kind: synthetic/road }", "{ kind: kitti/stereo2015, with: { root: \"${NOT_SET}\" } }"),
        ),
    ];
    let files: Vec<(&str, &str)> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let written = Written::new(&files);
    assert_eq!(written.plan(&[]).runs[0].source.parts[0].kind, "synthetic/road");
    let base = try_load(&written.path("base.yaml"), &[("sources.test.with.root", "/data")]).unwrap();
    assert_eq!(base.plan.runs[0].source.parts[0].params["root"], "/data");
    assert!(try_load(&written.path("base.yaml"), &[]).is_err());
}

#[test]
fn a_new_kind_in_a_variant_drops_the_old_parameters_and_keeps_the_inputs() {
    let text = stereo(
        "variants: { full: {}, edges: { compare.fused.kind: toy/offset, compare.fused.inputs.offset: average/depth } }",
    );
    let text = text
        .replace("      fused:", "      average: { kind: toy/average, inputs: { depth: depth/depth } }\n      fused:");
    // toy/offset needs a once-value of an earlier stage; here it is its own stage's.
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
        let node = nodes(&plan, 0, "fused").into_iter().find(|node| node.variants.contains(&variant)).unwrap();
        (node.params["size"].clone(), node.params["sizes"].clone())
    };
    // The same kind again is no new kind.
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
    let said: Vec<&str> = loaded.warnings.iter().map(|warning| warning.message.as_str()).collect();
    assert_eq!(said, ["variant `same` is the same experiment as `full`"]);
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
fn scores_take_their_parameters_from_score_and_from_the_estimate() {
    let plan = plan_of(&stereo("").replace(
        "estimates: { stereo: depth/depth,",
        "cap: 50\n      sets: [all, answered]\n      estimates: { stereo: { from: depth/depth, sets: [answered], cap: 30 },",
    ));
    let params = |name: &str| nodes(&plan, 0, name)[0].params.clone();
    assert_eq!(params("score.stereo"), serde_json::json!({ "preset": null, "sets": ["answered"], "cap": 30.0 }));
    assert_eq!(params("score.fused"), serde_json::json!({ "preset": null, "sets": ["all", "answered"], "cap": 50.0 }));
    assert_eq!(nodes(&plan_of(&stereo("")), 0, "score.fused")[0].params["sets"], serde_json::json!(["all"]));
    let estimate = &plan.runs[0].estimates[1];
    assert_eq!(plan.runs[0].nodes[estimate.score_node].name, "score.fused");
    assert_eq!(estimate.truth, Slot::Source { port: 3 });
}

#[test]
fn an_estimate_may_have_a_truth_of_its_own_and_then_no_other_is_wanted() {
    let own = "estimates: { stereo: { from: depth/depth, truth: fused/depth },";
    let text = stereo("").replace("estimates: { stereo: depth/depth,", own);
    let truths = |text: &str| plan_of(text).runs[0].estimates.iter().map(|of| of.truth).collect::<Vec<_>>();
    assert!(matches!(truths(&text)[..], [Slot::Node { .. }, Slot::Source { port: 3 }]), "{:?}", truths(&text));
    let alone = stereo("").replace("estimates: { stereo: depth/depth,", &format!("{own} fused_too: null,"));
    let alone = alone.replace("      truth: source/depth\n", "").replace("fused: fused/depth }", "fused: null }");
    assert!(matches!(truths(&alone)[..], [Slot::Node { .. }]), "{alone}");
}

#[test]
fn variants_and_the_command_line_change_scores_and_sources_too() {
    let plan = plan_of(&stereo(
        "variants: { full: {}, capped: { compare.score.cap: 20, compare.score.estimates.fused.sets: [answered] } }",
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
fn joined_sources_follow_each_other() {
    let plan = plan_of(&stereo("").replace(
        "{ kind: synthetic/road }",
        "{ join: [ { kind: synthetic/road, with: { seed: 1 } }, { kind: kitti/stereo2015, with: { root: /data } } ] }",
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
    assert_eq!(nodes(&plan, 0, "other")[0].variants, [1]);
    assert_eq!(nodes(&plan, 0, "depth")[0].variants, [0, 1]);
}

#[test]
fn graph_files_give_nodes_that_the_stage_may_change() {
    let graph = "nodes:
  stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { block: 3 } }
  depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
";
    let main = "experiment: main
sources: { test: { kind: synthetic/road } }
stages:
  compare:
    source: test
    nodes:
      graph: graph.yaml
      stereo: { with: { p1: 100 } }
      fused: { kind: filter/median, inputs: { depth: depth/depth } }
";
    let plan = Written::new(&[("main.yaml", main), ("graph.yaml", graph)]).plan(&[]);
    let stereo = nodes(&plan, 0, "stereo")[0];
    assert_eq!((&stereo.params["block"], &stereo.params["p1"]), (&3.into(), &100.into()));
    assert_eq!(nodes(&plan, 0, "fused").len(), 1);
}

#[test]
fn anchors_and_merges_are_ordinary_yaml() {
    let text = stereo("").replace("with: { block: 5 }", "with: &settings { block: 9, p1: 10 }").replace(
        "      fused:",
        "      other: { kind: stereo/sgbm, inputs: { left: source/right, right: source/left }, with: { <<: *settings, p1: 20 } }\n      fused:",
    );
    let plan = plan_of(&text);
    let other = nodes(&plan, 0, "other")[0];
    assert_eq!((&other.params["block"], &other.params["p1"]), (&9.into(), &20.into()));
}

/// An experiment that learns; `with` are the teacher's parameters, `more` is appended.
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
      teacher: {{ kind: learn/ssl, inputs: {{ samples: samples/samples }}, with: {{ {with} }} }}
{more}"
    )
}

#[test]
fn fault_14_operational_parameters_enter_no_recipe_and_no_recording() {
    let teacher = |with: &str| nodes(&plan_of(&learning(with, "")), 0, "teacher")[0].clone();
    let (often, seldom, other) = (teacher("checkpoint_every: 1"), teacher(""), teacher("steps: 3"));
    assert_eq!(often.recipe, seldom.recipe);
    assert_eq!(often.portable, seldom.portable);
    assert!(often.portable.get("checkpoint_every").is_none() && often.portable.get("steps").is_some());
    assert_eq!(often.params["checkpoint_every"], 1, "it is built with what was asked for");
    assert_ne!(often.recipe, other.recipe);
}

#[test]
fn operational_parameters_come_from_the_command_line_and_change_no_recipe() {
    let written = Written::new(&[("main.yaml", &learning("checkpoint_every: 5", ""))]);
    let teacher = |set: &[(&str, &str)]| nodes(&written.plan(set), 0, "teacher")[0].clone();
    let (plain, set) = (teacher(&[]), teacher(&[("learn.teacher.with.checkpoint_every", "9")]));
    assert_eq!((&plain.params["checkpoint_every"], &set.params["checkpoint_every"]), (&5.into(), &9.into()));
    assert_eq!((plain.recipe, plain.portable), (set.recipe, set.portable));
}

#[test]
fn fault_05_trainings_that_differ_in_operational_parameters_alone_are_one_node() {
    let variants =
        "variants: { a: {}, b: { learn.teacher.with.checkpoint_every: 7 }, c: { learn.teacher.with.steps: 9 } }";
    let written = Written::new(&[("main.yaml", &learning("checkpoint_every: 5", variants))]);
    let loaded = loaded_with(&written.path("main.yaml"), &[]);
    let teachers = nodes(&loaded.plan, 0, "teacher");
    assert_eq!(teachers.len(), 2, "c learns otherwise");
    assert_eq!((&teachers[0].variants, &teachers[0].params["checkpoint_every"]), (&vec![0, 1], &5.into()));
    let told = loaded.warnings.to_string();
    assert!(told.contains("node `teacher` differs from `teacher` in parameters alone that decide no result"), "{told}");
    assert!(told.contains("run with the parameters of `teacher` of variant `a`"), "{told}");
}

#[test]
fn fault_05_trainings_from_weights_of_equal_content_are_one_node() {
    let variants =
        "variants: { a: {}, b: { learn.teacher.with.weights: b.bin }, c: { learn.teacher.with.weights: c.bin } }";
    let text = learning("weights: a.bin", variants);
    let written = Written::new(&[("main.yaml", &text), ("a.bin", "equal"), ("b.bin", "equal"), ("c.bin", "other")]);
    let plan = written.plan(&[]);
    let teachers = nodes(&plan, 0, "teacher");
    assert_eq!(teachers.iter().map(|node| node.variants.clone()).collect::<Vec<_>>(), [vec![0, 1], vec![2]]);
}

#[test]
fn fault_17_what_a_node_cannot_do_with_its_inputs_is_said_with_the_plan() {
    let written =
        Written::new(&[("main.yaml", &learning("", "variants: { a: {}, b: { learn.teacher.with.network: deaf } }"))]);
    let told = try_load(&written.path("main.yaml"), &[]).unwrap_err().to_string();
    assert!(told.contains("node `teacher`: a deaf network cannot learn (in variant `b`)"), "{told}");
    assert!(told.contains("help: choose another"), "{told}");
}
