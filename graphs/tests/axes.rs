//! Axes of `matrix`: linked, named, conditional; ranges and samples; several matrices; which variants are taken.

#[macro_use]
mod support;
mod toys;

use depthloom_graphs::language::{Loaded, Options, load};
use depthloom_graphs::plan::{Plan, PlannedNode, VariantId};

const BASE: &str = concat!(
    compare!(),
    "      left: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      right: { kind: stereo/sgbm, inputs: { left: source/right, right: source/left } }
      depth: { kind: depth/from-disparity, inputs: { disparity: left/disparity, calibration: source/calibration } }
      merged: { kind: depth/from-disparity, inputs: { disparity: right/disparity, calibration: source/calibration } }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth, other: merged/depth } }
"
);

fn try_load(more: &str, set: &[&str], only: &[&str]) -> Result<Loaded, String> {
    taken(&format!("{BASE}{more}"), set, only)
}

fn taken(text: &str, set: &[&str], only: &[&str]) -> Result<Loaded, String> {
    given(text, &Options { set: pairs(set), only: only.iter().map(|&name| name.to_owned()).collect(), ..bare() })
}

/// With these arguments of `--matrix`.
fn with_matrix(text: &str, matrix: &[&str]) -> Result<Loaded, String> {
    given(text, &Options { matrix: pairs(matrix), ..bare() })
}

fn given(text: &str, options: &Options<'_>) -> Result<Loaded, String> {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let path = folder.path().join("main.yaml");
    std::fs::write(&path, text).expect("a file can be written");
    load(&path, &toys::registry(), options).map_err(|found| found.to_string())
}

/// Nothing given, and an environment without variables.
fn bare() -> Options<'static> {
    Options { env: Box::new(|_| None), ..Options::default() }
}

fn pairs(arguments: &[&str]) -> Vec<(String, String)> {
    let pairs = arguments.iter().filter_map(|argument| argument.split_once('='));
    pairs.map(|(path, value)| (path.to_owned(), value.to_owned())).collect()
}

fn plan(more: &str) -> Plan {
    try_load(more, &[], &[]).unwrap_or_else(|message| panic!("{message}")).plan
}

fn refused(more: &str) -> String {
    try_load(more, &[], &[]).map(|loaded| loaded.plan.variants).expect_err("it is wrong")
}

fn node<'p>(plan: &'p Plan, variant: &str, name: &str) -> &'p PlannedNode {
    let index = plan.variants.iter().position(|own| own == variant).expect("there is such a variant");
    let mut nodes = plan.runs.iter().flat_map(|run| &run.nodes);
    nodes.find(|node| node.name == name && node.variants.contains(&VariantId(index))).expect("it has the node")
}

/// A parameter of `left` and of `right`.
fn both(plan: &Plan, variant: &str, parameter: &str) -> [i64; 2] {
    ["left", "right"].map(|name| node(plan, variant, name).params[parameter].as_i64().expect("a number"))
}

/// The factors of a variant, `axis=value`.
fn factors(plan: &Plan, variant: usize) -> Vec<String> {
    plan.factors[variant].iter().map(|factor| format!("{}={}", factor.axis, factor.value)).collect()
}

#[test]
fn linked_paths_take_one_value() {
    let plan = plan(
        "matrix:
  block: { paths: [compare.left.with.block, compare.right.with.block], values: [3, 9] }
  compare.left.with.disparities: [32, 64]
",
    );
    assert_eq!(
        plan.variants,
        ["block=3+disparities=32", "block=3+disparities=64", "block=9+disparities=32", "block=9+disparities=64"]
    );
    assert_eq!(both(&plan, "block=9+disparities=32", "block"), [9, 9]);
    assert_eq!(factors(&plan, 3), ["block=9", "disparities=64"]);
}

#[test]
fn named_values_are_maps_of_changes() {
    let plan = plan(
        "matrix:
  penalties:
    values:
      weak: { compare.left.with.p1: 100, compare.right.with.p1: 50 }
      strong: { compare.left.with.p1: 250 }
  where: { paths: compare.left.with.block, values: { narrow: 3, wide: 9 } }
  exclude: [ { penalties: weak, where: wide } ]
  include: [ { penalties: strong, compare.left.with.block: 7 } ]
",
    );
    assert_eq!(
        plan.variants,
        [
            "penalties=weak+where=narrow",
            "penalties=strong+where=narrow",
            "penalties=strong+where=wide",
            "penalties=strong+block=7"
        ]
    );
    assert_eq!(both(&plan, "penalties=weak+where=narrow", "p1"), [100, 50]);
    assert_eq!(both(&plan, "penalties=strong+block=7", "block"), [7, 5]);
}

#[test]
fn an_axis_with_a_condition_is_elsewhere_not_there() {
    let matrix = "matrix:
  mode: { paths: [compare.left.with.mode, compare.right.with.mode], values: [sgbm, hh] }
  compare.left.with.p1: { values: [100, 400], when: { mode: hh } }
  compare.left.with.p2: { values: [900, 1600], when: { compare.left.with.p1: [400, 500] } }
";
    let expected = ["mode=sgbm", "mode=hh+p1=100", "mode=hh+p1=400+p2=900", "mode=hh+p1=400+p2=1600"];
    let loaded = try_load(matrix, &[], &[]).unwrap_or_else(|message| panic!("{message}"));
    assert_eq!(loaded.plan.variants, expected);
    assert!(loaded.warnings.is_empty(), "no two are the same: {}", loaded.warnings);
    assert_eq!(factors(&loaded.plan, 0), ["mode=sgbm"]);
    // By what is written, by what a variant says, and by a default.
    let on_variants = "variants: { plain: {}, hh: { compare.left.with.mode: hh } }
matrix: { compare.left.with.p1: { values: [100, 400], when: { compare.left.with.mode: hh } } }
";
    let names = ["plain", "hh+p1=100", "hh+p1=400"];
    assert_eq!(plan(on_variants).variants, names);
    let on_kinds =
        "variants: { road: {}, kitti: { sources.test.kind: kitti/stereo2015, sources.test.with.root: data } }
matrix: { sources.test.with.seed: { values: [3, 4], when: { sources.test.kind: synthetic/road } } }
";
    assert_eq!(plan(on_kinds).variants, ["road+seed=3", "road+seed=4", "kitti"]);
}

#[test]
fn an_axis_that_is_nowhere_there_is_told_of() {
    let message = |more: &str, matrix: &[&str]| {
        let loaded = with_matrix(&format!("{BASE}{more}"), matrix).unwrap_or_else(|message| panic!("{message}"));
        (loaded.plan.variants.len(), loaded.warnings.to_string())
    };
    let of_path = "matrix: { compare.left.with.p1: { values: [100, 400], when: { compare.left.with.mode: hh } } }\n";
    let never = "warning: the axis `compare.left.with.p1` is in no combination: its `when` never holds";
    assert!(message(of_path, &[]).1.contains(never), "{}", message(of_path, &[]).1);
    let beside_others = format!("variants: {{ hh: {{ compare.left.with.mode: hh }}, plain: {{}} }}\n{of_path}");
    assert_eq!(message(&beside_others, &[]), (3, String::new()));
    // The command line may leave out the value that a condition speaks of; the file may not.
    let of_axis = "matrix:
  mode: { paths: compare.left.with.mode, values: [sgbm, hh] }
  compare.left.with.p1: { values: [100, 400], when: { mode: hh } }
";
    let (count, warnings) = message(of_axis, &["mode=[sgbm]"]);
    assert!(count == 1 && warnings.contains(never), "{count} {warnings}");
    // Of another kind the parameter is another one.
    let of_kind = "variants: { road: {}, kitti: { sources.test.kind: kitti/stereo2015, sources.test.with: { root: data, ground_truth: occ } } }
matrix: { compare.left.with.block: { values: [3, 7], when: { sources.test.with.ground_truth: occ } } }
";
    assert!(refused(of_kind).contains("nothing sets `sources.test.with.ground_truth`"), "{}", refused(of_kind));
}

#[test]
fn a_condition_looks_at_what_is_above_it_or_written() {
    let below = "matrix:
  compare.left.with.p1: { values: [100, 400], when: { mode: hh } }
  mode: { paths: compare.left.with.mode, values: [sgbm, hh] }
";
    assert!(refused(below).contains("move that axis above this one"), "{}", refused(below));
    let misspelt = "matrix:
  mode: { paths: compare.left.with.mode, values: [sgbm, hh] }
  compare.left.with.p1: { values: [100, 400], when: { mod: hh } }
";
    assert!(refused(misspelt).contains("did you mean `mode`?"), "{}", refused(misspelt));
    let nowhere = "matrix: { compare.left.with.p1: { values: [100, 400], when: { compare.left.with.colour: red } } }\n";
    assert!(refused(nowhere).contains("nothing sets `compare.left.with.colour`"), "{}", refused(nowhere));
}

#[test]
fn a_range_is_numbers_that_fit_their_parameter() {
    let names = |axis: &str| plan(&format!("matrix: {{ {axis} }}\n")).variants;
    let log = "compare.left.with.p1: { from: 2, to: 64, steps: 6, log: true }";
    assert_eq!(names(log), ["p1=2", "p1=4", "p1=8", "p1=16", "p1=32", "p1=64"]);
    let rounded = "compare.left.with.p1: { from: 1, to: 3, steps: 9 }";
    assert_eq!(names(rounded), ["p1=1", "p1=2", "p1=3"], "whole, each once");
    let multiples = "compare.left.with.disparities: { from: 16, to: 100, steps: 4 }";
    assert_eq!(names(multiples), ["disparities=16", "disparities=48", "disparities=80", "disparities=96"]);
    let metres = "compare.depth.with.cap: { values: { from: 20, to: 80, steps: 4, log: true } }";
    assert_eq!(names(metres), ["cap=20", "cap=31.7", "cap=50.4", "cap=80"]);
    assert_eq!(
        names("compare.depth.with.cap: { from: 0.5, to: 1, steps: 4 }"),
        ["cap=0.5", "cap=0.667", "cap=0.833", "cap=1"]
    );
    assert_eq!(names("compare.score.cap: { from: 1e-300, to: 1e300, steps: 4, log: true }").len(), 4, "none is 0");
    assert_eq!(names("compare.score.cap: { from: 1e-8, to: 1e8, steps: 3, log: true }")[1], "cap=1");
    assert_eq!(names("compare.score.cap: { from: 1e-12, to: 1, steps: 3, log: true }")[1], "cap=1e-6");
    let error = |axis: &str| refused(&format!("matrix: {{ {axis} }}\n"));
    assert!(error("compare.left.with.p1: { from: 2, to: 64 }").contains("needs `steps`"));
    assert!(error("compare.left.with.p1: { from: 64, to: 2, steps: 3 }").contains("holds no numbers"));
    assert!(error("compare.left.with.p1: { from: 0, to: 2, steps: 3, log: true }").contains("begins above 0"));
    assert!(error("compare.left.with.p1: { from: 0, to: 2, step: 3 }").contains("did you mean `steps`?"));
}

#[test]
fn a_range_with_fewer_numbers_than_steps_says_which_it_takes() {
    let odd = BASE.replace(
        "      merged:",
        "      blurred: { kind: filter/median, inputs: { depth: depth/depth } }\n      merged:",
    );
    let odd = odd.replace("stereo: depth/depth", "stereo: blurred/depth");
    let load = |axis: &str| {
        taken(&format!("{odd}matrix: {{ {axis} }}\n"), &[], &[]).unwrap_or_else(|message| panic!("{message}"))
    };
    let all = load("compare.blurred.with.size: { from: 2, to: 8, steps: 9 }");
    assert_eq!(all.plan.variants, ["size=3", "size=5", "size=7"], "odd, as the parameter requires");
    let message = all.warnings.to_string();
    assert!(message.contains("the range of `compare.blurred.with.size` holds 3 odd numbers, not 9"), "{message}");
    assert!(message.contains("it takes `3`, `5`, `7`, each once"), "{message}");
    let enough = load("compare.blurred.with.size: { from: 1, to: 9, steps: 3 }");
    assert_eq!(enough.plan.variants, ["size=1", "size=5", "size=9"]);
    assert!(enough.warnings.is_empty(), "{}", enough.warnings);
    let drawn = load("compare.blurred.with.size: { from: 2, to: 8 }, sample: { method: random, count: 30 }");
    assert_eq!(drawn.plan.variants.len(), 3, "{:?}", drawn.plan.variants);
}

#[test]
fn a_sample_draws_some_of_all_combinations_always_alike() {
    let matrix = |sample: &str| {
        format!(
            "matrix:
  compare.depth.with.cap: {{ from: 20, to: 80 }}
  compare.left.with.p1: {{ from: 10, to: 700 }}
  mode: {{ paths: compare.left.with.mode, values: [sgbm, hh] }}
  sample: {sample}
"
        )
    };
    let hypercube = plan(&matrix("{ method: latin-hypercube, count: 20, seed: 7 }"));
    assert_eq!(hypercube.variants.len(), 20);
    assert_eq!(hypercube.variants, plan(&matrix("{ count: 20, seed: 7 }")).variants);
    assert_ne!(hypercube.variants, plan(&matrix("{ count: 20, seed: 8 }")).variants);
    // One of each twentieth of the caps, half of the modes each.
    let mut parts: Vec<usize> = (0..20)
        .map(|variant| ((hypercube.factors[variant][0].value.parse::<f64>().unwrap() - 20.0) / 3.0) as usize)
        .collect();
    parts.sort_unstable();
    assert_eq!(parts, (0..20).collect::<Vec<_>>());
    assert_eq!(hypercube.factors.iter().filter(|factors| factors[2].value == "hh").count(), 10);
    assert!(hypercube.factors.iter().all(|factors| factors[1].value.parse::<i64>().is_ok()), "whole numbers");
    // Names depend on the file's text only, so they never change.
    assert_eq!(hypercube.variants[0], "cap=76.9+p1=81+mode=hh");
    let random = plan(&matrix("{ method: random, count: 20, seed: 7 }"));
    assert_eq!(random.variants.len(), 20);
    assert_ne!(random.variants, hypercube.variants);
}

#[test]
fn a_sample_larger_than_all_there_is_takes_all_and_says_so() {
    let text = "matrix: { compare.left.with.block: [3, 5, 7], compare.left.with.mode: [sgbm, hh], sample: { method: random, count: 40 } }\n";
    let loaded = try_load(text, &[], &[]).unwrap_or_else(|message| panic!("{message}"));
    assert_eq!(loaded.plan.variants.len(), 6);
    assert!(loaded.warnings.to_string().contains("the sample of 40 holds 6 different combinations"));
}

#[test]
fn several_matrices_follow_each_other() {
    let text = "matrix:
  - { compare.left.with.block: [3, 9] }
  - { compare.left.with.mode: [hh], compare.depth.with.cap: [50, 80] }
";
    let names = ["block=3", "block=9", "mode=hh+cap=50", "mode=hh+cap=80"];
    assert_eq!(plan(text).variants, names);
    let with_variants = plan(&format!("variants: {{ a: {{}}, b: {{ compare.right.with.block: 7 }} }}\n{text}"));
    assert_eq!(with_variants.variants.len(), 8);
    assert_eq!(with_variants.variants[4], "b+block=3");
    let set = |argument: &str| try_load(text, &[argument], &[]).map(|loaded| loaded.plan.variants);
    assert_eq!(set("matrix.compare.left.with.block=[7]").unwrap()[0], "block=7");
    assert_eq!(set("matrix.1.compare.right.with.block=[7]").unwrap()[2], "mode=hh+cap=50+right.block=7");
    assert!(set("matrix.compare.right.with.block=[7]").unwrap_err().contains("of 2 matrices none has"));
}

#[test]
fn the_command_line_adds_and_replaces_axes() {
    let set = |more: &str, set: &[&str]| try_load(more, set, &[]).map(|loaded| loaded.plan.variants);
    assert_eq!(set("", &["matrix.compare.left.with.block=[3, 9]"]).unwrap(), ["block=3", "block=9"]);
    let both = ["matrix.compare.left.with.block=[3]", "matrix.compare.depth.with.cap={ from: 50, to: 80, steps: 2 }"];
    assert_eq!(set("", &both).unwrap(), ["block=3+cap=50", "block=3+cap=80"]);
    let named = "matrix: { block: { paths: [compare.left.with.block, compare.right.with.block], values: [3, 9] } }\n";
    assert_eq!(set(named, &["matrix.block=[7]"]).unwrap(), ["block=7"], "it keeps what it sets");
    assert_eq!(set(named, &["matrix.block=null"]).unwrap(), [""]);
    assert!(set(named, &["matrix.blok=[7]"]).unwrap_err().contains("did you mean `block`?"));
    assert!(set("", &["matrix.compare.left.with.blok=[7]"]).unwrap_err().contains("did you mean `block`?"));
    let message = set(named, &["compare.right.with.block=7"]).unwrap_err();
    assert!(message.contains("`--matrix 'block=[7]'` sets the values"), "{message}");
    assert!(set("", &["record=[compare.depth/depth]"]).is_ok());
}

#[test]
fn the_command_line_changes_what_an_axis_and_a_sample_say() {
    let set = |more: &str, set: &[&str]| try_load(more, set, &[]).map(|loaded| loaded.plan.variants);
    let linked = "matrix: { block: { paths: [compare.left.with.block, compare.right.with.block], values: [3, 9] } }\n";
    assert_eq!(set(linked, &["matrix.block.values=[5,7]"]).unwrap(), ["block=5", "block=7"]);
    let of_paths = "matrix: { compare.left.with.block: { values: [3, 9] }, compare.left.with.mode: [sgbm, hh] }\n";
    let both = ["matrix.compare.left.with.block.values=[7]", "matrix.compare.left.with.mode.values=[hh]"];
    assert_eq!(set(of_paths, &both).unwrap(), ["block=7+mode=hh"]);
    let range = "matrix: { compare.left.with.block: { from: 1, to: 9, steps: 2 } }\n";
    assert_eq!(set(range, &["matrix.compare.left.with.block.to=5"]).unwrap(), ["block=1", "block=5"]);
    let sampled = "matrix: { compare.left.with.block: [3, 5, 7, 9], sample: { method: random, count: 2 } }\n";
    assert_eq!(set(sampled, &["matrix.sample.count=3", "matrix.sample.seed=5"]).unwrap().len(), 3);
    let several = "matrix: [{ compare.left.with.block: [3, 5, 7, 9], sample: { method: random, count: 2 } }, { compare.right.with.block: [3] }]\n";
    for path in ["matrix.sample.count=3", "matrix.0.sample.count=3"] {
        assert_eq!(set(several, &[path]).unwrap().len(), 4, "{path}");
    }
    let unsampled = "matrix: { compare.left.with.block: [3, 5, 7, 9] }\n";
    assert_eq!(set(unsampled, &["matrix.sample.count=2"]).unwrap().len(), 2);
    for (argument, near) in
        [("matrix.block.valeus=[3]", "`values`"), ("matrix.blok.values=[3]", "`block`"), ("matrix.blok=[3]", "`block`")]
    {
        let message = set(linked, &[argument]).unwrap_err();
        assert!(message.contains(&format!("did you mean {near}?")), "{message}");
    }
    assert!(set(sampled, &["matrix.sample.cuont=3"]).unwrap_err().contains("did you mean `count`?"));
}

/// A node, a source and a pattern of `record` that only the variant `lr` has a use for.
const LR: &str = "experiment: base
sources: { test: { kind: synthetic/road }, other: { kind: synthetic/road, with: { seed: 9 } } }
stages:
  compare:
    source: test
    nodes:
      left: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      right: { kind: stereo/sgbm, inputs: { left: source/right, right: source/left } }
      depth: { kind: depth/from-disparity, inputs: { disparity: left/disparity, calibration: source/calibration } }
      marked: { kind: confidence/edges, inputs: { image: source/left } }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }
record: [compare.marked, \"*/weight\"]
variants:
  lr: { compare.depth.inputs.disparity: right/disparity, compare.source: other, compare.marked.kind: confidence/sobel }
  nolr: {}
  both: { compare.left.with.block: 3 }
";

#[test]
fn what_only_variants_use_that_are_left_out_is_not_run_and_nothing_to_tell() {
    let names = |loaded: &Loaded| -> Vec<String> {
        loaded.plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.name.clone()).collect()
    };
    let in_file = format!("{LR}only: [\"nolr\"]\n");
    for loaded in [taken(LR, &[], &["nolr"]), taken(&in_file, &[], &[]), taken(LR, &[], &["nolr", "both"])] {
        let loaded = loaded.unwrap_or_else(|message| panic!("{message}"));
        assert!(loaded.warnings.is_empty(), "{}", loaded.warnings);
        assert!(!names(&loaded).contains(&"right".to_owned()), "{:?}", names(&loaded));
    }
    // What no variant uses is wrong whichever are taken.
    for only in [&[][..], &["nolr"]] {
        let message = taken(LR, &["variants.lr=null"], only).map(|_| ()).unwrap_err();
        assert!(message.contains("node `right` is unused"), "{message}");
        assert!(message.contains("no stage uses the source `other`"), "{message}");
        assert!(message.contains("`*/weight` matches nothing that could be recorded"), "{message}");
    }
}

#[test]
fn a_name_without_its_combinations_is_told_the_pattern() {
    let text = "variants: { lr: {}, nolr: { compare.left.with.p1: 50 } }
matrix: { compare.left.with.block: [3, 9] }
";
    let message = |more: &str, only: &[&str]| try_load(&format!("{text}{more}"), &[], only).map(|_| ()).unwrap_err();
    let alone = message("", &["nolr"]);
    assert!(alone.contains("help: `--variant 'nolr+*'` selects the 2 variants of that form"), "{alone}");
    assert!(message("", &["block=3"]).contains("help: `--variant '*+block=3'` selects the 2 variants"));
    assert!(message("only: nolr\n", &[]).contains("help: `\"nolr+*\"` selects the 2 variants"));
    assert!(message("", &["nolr+blok=3"]).contains("did you mean `nolr+block=3`?"));
}

#[test]
fn only_some_variants_are_taken_in_their_order() {
    let variants =
        "variants: { full: {}, no_hh: { compare.left.with.block: 3 }, no_p: { compare.left.with.block: 9 } }\n";
    let take = |only: &[&str]| try_load(variants, &[], only).map(|loaded| loaded.plan.variants);
    assert_eq!(take(&["no_*", "full"]).unwrap(), ["full", "no_hh", "no_p"]);
    assert_eq!(take(&["no_p"]).unwrap(), ["no_p"]);
    let message = take(&["ful"]).unwrap_err();
    assert!(message.contains("no variant is called `ful`") && message.contains("did you mean `full`?"), "{message}");
    assert!(try_load("", &[], &["full"]).unwrap_err().contains("no variants to choose from"));
    // The file can say the same, and so does the stored file.
    assert_eq!(plan(&format!("{variants}only: no_*\n")).variants, ["no_hh", "no_p"]);
    let loaded = try_load(variants, &[], &["no_p"]).unwrap();
    let resolved = &loaded.stored.last().expect("it is stored").1;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("resolved.yaml"), resolved).unwrap();
    let again = load(&folder.path().join("resolved.yaml"), &toys::registry(), &Options::default());
    assert_eq!(again.unwrap_or_else(|message| panic!("{message}")).plan.summary_json(), loaded.plan.summary_json());
    assert!(loaded.stored[0].1.starts_with("# As it was written, without what the run set: --variant 'no_p'."));
    assert!(loaded.plan.resolved.contains("only:"));
}

#[test]
fn one_that_is_taken_alone_is_named_as_among_all() {
    let loaded = try_load("matrix: { compare.left.with.block: [3, 9] }\n", &[], &["*=9"]).unwrap();
    assert_eq!((loaded.plan.variants.len(), loaded.plan.variants[0].as_str()), (1, "block=9"));
    assert_eq!(factors(&loaded.plan, 0), ["block=9"]);
}

/// The warnings about an experiment, messages and help.
fn warned(more: &str) -> Vec<(String, String)> {
    let loaded = try_load(more, &[], &[]).unwrap_or_else(|message| panic!("{message}"));
    loaded.warnings.iter().map(|warning| (warning.message.clone(), warning.help.clone().unwrap_or_default())).collect()
}

#[test]
fn a_parameter_that_follows_others_becomes_its_number_before_all_else() {
    let swept = plan("matrix: { compare.left.with.block: [3, 5, 9] }\n");
    for (variant, p1, p2) in [("block=3", 72, 288), ("block=5", 200, 800), ("block=9", 648, 2592)] {
        let node = node(&swept, variant, "left");
        assert_eq!((&node.params["p1"], &node.params["p2"]), (&p1.into(), &p2.into()));
        assert_eq!(node.auto, ["p1", "p2"]);
    }
    assert!(swept.summary_text().contains("  auto: p1 = 72, p2 = 288 of left\n"), "{}", swept.summary_text());
    let summary = serde_json::to_value(swept.summary_json()).unwrap();
    assert_eq!(summary["runs"][0]["nodes"][0]["auto"], serde_json::json!(["p1", "p2"]));
    // Equal numbers are equal nodes, whether they are written or computed.
    let alike = plan(
        "variants: { plain: {}, auto: { compare.left.with.p1: auto }, same: { compare.left.with: { p1: 200, p2: 800 } } }\n",
    );
    let lefts = alike.runs[0].nodes.iter().filter(|node| node.name == "left");
    assert_eq!(lefts.map(|node| node.variants.clone()).collect::<Vec<_>>(), [[0, 1, 2].map(VariantId)]);
    let message = refused("variants: { wrong: { compare.left.with.p1: atuo }, half: { compare.left.with.p1: 2.5 } }\n");
    assert!(
        message.contains("did you mean `auto`?") && message.contains("`p1` must be a whole number, not `2.5`"),
        "{message}"
    );
}

#[test]
fn who_holds_what_could_follow_a_sweep_is_told() {
    let base = |p1: &str| format!("variants: {{ all: {{ compare.left.with.p1: {p1} }} }}\n");
    let swept = "matrix: { compare.left.with.block: [3, 5, 9] }\n";
    assert_eq!(
        warned(&format!("{}{swept}", base("200"))),
        [(
            "`p1` of node `left` stays 200 while `block`, which it would follow, is 3, 5, 9".to_owned(),
            "`p1: auto`, its default, would be 72, 200, 648".to_owned()
        )]
    );
    for fine in [
        format!("{}{swept}", base("auto")),
        swept.to_owned(),
        // Both swept: it is meant so.
        format!("{}{swept}", base("200").replace("} }\n", "}, more: { compare.left.with.p1: 250 } }\n")),
        // Another node's block.
        format!("{}matrix: {{ compare.right.with.block: [3, 5, 9] }}\n", base("200")),
    ] {
        assert_eq!(warned(&fine), [], "{fine}");
    }
    // Against those that follow.
    let beside_auto = "matrix: { compare.left.with.p1: [auto, 200], compare.left.with.block: [3, 5, 9] }\n";
    let loaded = try_load(beside_auto, &[], &[]).unwrap_or_else(|message| panic!("{message}"));
    assert!(loaded.warnings.to_string().contains("the same in all variants that set it"), "{}", loaded.warnings);
    let in_variants = "variants: { small: { compare.left.with: { block: 3, p2: 900 } }, large: { compare.left.with: { block: 9, p2: 900 } } }\n";
    assert!(warned(in_variants)[0].0.starts_with("`p2` of node `left` stays 900"), "{:?}", warned(in_variants));
}

#[test]
fn a_stage_whose_training_is_not_used_gives_a_warning() {
    let learn = concat!(
        "  learn:
    source: test
",
        lesson!()
    );
    let folder = tempfile::tempdir().unwrap();
    let warned = |text: &str| {
        let path = folder.path().join("main.yaml");
        std::fs::write(&path, text).unwrap();
        let loaded = load(&path, &toys::registry(), &Options::default()).unwrap_or_else(|message| panic!("{message}"));
        loaded.warnings.iter().map(|warning| warning.message.clone()).collect::<Vec<_>>()
    };
    let first = BASE.replace("stages:\n", &format!("stages:\n{learn}"));
    assert_eq!(warned(&first), ["nothing uses what stage `learn` learns"]);
    let wired = first.replace(
        "    score: {",
        "      mono: { kind: mono/onnx, inputs: { image: source/left, calibration: source/calibration, model: learn.train/model } }\n    score: {",
    );
    assert_eq!(warned(&wired), [""; 0]);
    assert_eq!(warned(&format!("{first}record: [learn.train/model, '*/depth']\n")), [""; 0], "it is recorded");
    assert_eq!(warned(&format!("{BASE}{learn}")), [""; 0], "what is learned last is what it is for");
}

#[test]
fn a_thousand_variants_share_what_they_leave_alone() {
    let plan = plan(
        "matrix:
  compare.depth.with.cap: { from: 20, to: 120, steps: 100 }
  compare.score.cap: { from: 30, to: 80, steps: 10 }
",
    );
    assert_eq!((plan.variants.len(), plan.factors.len()), (1000, 1000));
    let count = |name: &str| plan.runs[0].nodes.iter().filter(|node| node.name == name).count();
    assert_eq!((count("left"), count("depth"), count("score.stereo")), (1, 100, 1000));
}
