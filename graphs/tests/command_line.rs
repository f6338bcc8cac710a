//! `--set` beside variants and matrices that set the same, and variants that a file inherits.

#[macro_use]
mod support;
mod toys;

use depthloom_graphs::plan::VariantId;
use std::path::Path;

use depthloom_graphs::language::{Loaded, Options, load};

const BASE: &str = concat!(
    compare!(),
    "      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }
"
);

fn loaded(text: &str, set: &[&str]) -> Result<Loaded, String> {
    let folder = tempfile::tempdir().expect("a folder can be made");
    std::fs::write(folder.path().join("base.yaml"), format!("{BASE}{VARIANTS}")).expect("a file can be written");
    std::fs::write(folder.path().join("main.yaml"), text).expect("a file can be written");
    in_folder(folder.path(), set)
}

fn in_folder(folder: &Path, set: &[&str]) -> Result<Loaded, String> {
    let set = set.iter().filter_map(|argument| argument.split_once('='));
    let set = set.map(|(path, value)| (path.to_owned(), value.to_owned())).collect();
    let options = Options { set, env: Box::new(|_| None), ..Options::default() };
    load(&folder.join("main.yaml"), &toys::registry(), &options).map_err(|found| found.to_string())
}

const VARIANTS: &str =
    "variants: { plain: {}, small: { compare.stereo.with.block: 3 }, large: { compare.stereo.with: { block: 9 } } }\n";

/// The block of a variant's `stereo`.
fn block(loaded: &Loaded, variant: &str) -> u64 {
    let index = loaded.plan.variants.iter().position(|name| name == variant).expect("there is such a variant");
    let of_variant = |node: &&depthloom_graphs::plan::PlannedNode| {
        node.name == "stereo" && node.variants.contains(&VariantId(index))
    };
    let node = loaded.plan.runs.iter().flat_map(|run| &run.nodes).find(of_variant).expect("it has the node");
    node.params["block"].as_u64().expect("a number")
}

#[test]
fn variants_that_keep_their_own_value_are_named() {
    let loaded = loaded(&format!("{BASE}{VARIANTS}"), &["compare.stereo.with.block=7"]).unwrap();
    assert_eq!(["plain", "small", "large"].map(|variant| block(&loaded, variant)), [7, 3, 9]);
    let message = loaded.warnings.to_string();
    assert!(
        message.contains("warning: variants `small`, `large` keep their own value of `compare.stereo.with.block`"),
        "{message}"
    );
    assert!(message.contains("`--set 'variants.small.compare.stereo.with.block=7'` sets it in a variant"), "{message}");
}

#[test]
fn what_variants_leave_alone_or_set_alike_is_nothing_to_tell() {
    let text = format!("{BASE}{VARIANTS}");
    for set in
        ["compare.stereo.with.disparities=32", "compare.stereo.with={ disparities: 32 }", "sources.test.with.seed=5"]
    {
        let loaded = loaded(&text, &[set]).unwrap();
        assert!(loaded.warnings.is_empty(), "{set}: {}", loaded.warnings);
    }
}

#[test]
fn what_every_variant_sets_cannot_be_set_in_the_base() {
    let text = format!(
        "{BASE}variants: {{ small: {{ compare.stereo.with.block: 3 }}, large: {{ compare.stereo.with.block: 9 }} }}\n"
    );
    let message = loaded(&text, &["compare.stereo.with.block=7"]).unwrap_err();
    assert!(
        message.contains("error: `--set compare.stereo.with.block=7` has no effect: every variant sets it"),
        "{message}"
    );
    assert!(message.contains("`--set 'variants.small.compare.stereo.with.block=7'` sets it in a variant"), "{message}");
    // The remedy is one.
    let loaded = loaded(&text, &["variants.small.compare.stereo.with.block=7"]).unwrap();
    assert_eq!(["small", "large"].map(|variant| block(&loaded, variant)), [7, 9]);
    assert!(loaded.warnings.is_empty(), "{}", loaded.warnings);
}

#[test]
fn what_a_matrix_sets_is_set_in_the_matrix() {
    let text = format!("{BASE}matrix: {{ compare.stereo.with.block: [3, 9] }}\n");
    let message = loaded(&text, &["compare.stereo.with.block=7"]).unwrap_err();
    assert!(
        message.contains("error: `--set compare.stereo.with.block=7` has no effect: the matrix sets it"),
        "{message}"
    );
    assert!(message.contains("`--matrix 'compare.stereo.with.block=[7]'` sets the values"), "{message}");
    let loaded = loaded(&text, &["matrix.compare.stereo.with.block=[7]"]).unwrap();
    assert_eq!(loaded.plan.variants, ["block=7"]);
    assert_eq!(block(&loaded, "block=7"), 7);
}

#[test]
fn a_variant_of_another_kind_does_not_keep_what_was_set() {
    let text = format!(
        "{BASE}variants: {{ plain: {{}}, other: {{ compare.depth.kind: filter/median, compare.depth.inputs: {{ depth: source/depth }} }} }}\n"
    );
    let message = loaded(&text, &["compare.depth.with.cap=50"]).map(|loaded| loaded.warnings.to_string());
    let message = message.unwrap_or_else(|error| error);
    assert!(message.contains("variant `other` keeps its own value of `compare.depth.with.cap`"), "{message}");
}

#[test]
fn a_variant_that_is_none_is_named() {
    let message = loaded(&format!("{BASE}{VARIANTS}"), &["variants.smal.compare.stereo.with.block=7"]).unwrap_err();
    assert!(message.contains("`variants` has no `smal`") && message.contains("did you mean `small`?"), "{message}");
}

#[test]
fn null_drops_a_variant_that_is_inherited() {
    let derived =
        "extends: base.yaml\nexperiment: derived\nvariants: { small: null, tiny: { compare.stereo.with.block: 1 } }\n";
    assert_eq!(loaded(derived, &[]).unwrap().plan.variants, ["plain", "large", "tiny"]);
    let own = format!("{BASE}variants: {{ plain: null, small: {{ compare.stereo.with.block: 3 }} }}\n");
    assert_eq!(
        loaded(&own, &[]).unwrap().plan.variants,
        ["plain", "small"],
        "of one's own it is one that changes nothing"
    );
    let set = loaded(&format!("{BASE}{VARIANTS}"), &["variants.small=null"]).unwrap();
    assert_eq!(set.plan.variants, ["plain", "large"]);
}

#[test]
fn a_new_stage_runs_before_the_next_one_that_is_inherited() {
    let stage = "{ source: test, nodes: { stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } } } }";
    let order = |text: &str| -> Vec<String> {
        let loaded = loaded(text, &[]).unwrap_or_else(|message| panic!("{message}"));
        loaded.plan.runs.iter().map(|run| run.stage.clone()).collect()
    };
    let base = order("extends: base.yaml\nexperiment: derived\n");
    let before = format!(
        "extends: base.yaml\nexperiment: derived\nstages: {{ first: {stage}, second: {stage}, compare: {{}}, last: {stage} }}\n"
    );
    assert_eq!(order(&before)[..2], ["first", "second"]);
    assert_eq!(order(&before)[2..], [&base[..], &["last".to_owned()]].concat());
}

#[test]
fn the_kept_experiment_says_what_it_does_not_have() {
    let folder = tempfile::tempdir().unwrap();
    let text = format!("{BASE}{VARIANTS}");
    std::fs::write(folder.path().join("main.yaml"), &text).unwrap();
    let stored = |set: &[&str]| in_folder(folder.path(), set).unwrap().stored;
    assert_eq!(stored(&[])[0], ("experiment.yaml".to_owned(), text.clone()), "as it was written");
    let (name, with) = stored(&["sources.test.with.seed=5", "variants.large=null"]).swap_remove(0);
    assert_eq!(name, "experiment.yaml");
    let (first, rest) = with.split_once('\n').unwrap();
    assert_eq!(
        first,
        "# As it was written, without what the run set: --set 'sources.test.with.seed=5' --set 'variants.large=null'. \
         experiment.resolved.yaml has it all, and repeats the run."
    );
    assert_eq!(rest, text);
    let matrix = vec![("compare.stereo.with.mode".to_owned(), "[sgbm, hh]".to_owned())];
    let options = Options { matrix, env: Box::new(|_| None), ..Options::default() };
    let swept = load(&folder.path().join("main.yaml"), &toys::registry(), &options).unwrap();
    assert_eq!(swept.plan.variants.len(), 6);
    assert!(swept.stored[0].1.contains(": --matrix 'compare.stereo.with.mode=[sgbm, hh]'. "), "{}", swept.stored[0].1);
    std::fs::write(folder.path().join("main.yaml"), with).unwrap();
    assert_eq!(in_folder(folder.path(), &[]).unwrap().plan.variants.len(), 3, "it can be run");
}

const TWO_STAGES: &str = concat!(
    "experiment: base
sources: { test: { kind: synthetic/road }, other: { kind: synthetic/road, with: { seed: 2 } } }
stages:
  learn:
    source: other
",
    lesson!(),
    "  compare:
    source: test
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      median: { kind: filter/median, inputs: { depth: depth/depth } }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }
matrix: { compare.stereo.with.block: [3, 9] }
"
);

#[test]
fn null_removes_inherited_entries_and_own_ones() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("base.yaml"), TWO_STAGES).unwrap();
    let load = |text: &str, set: &[&str]| {
        std::fs::write(folder.path().join("main.yaml"), text).unwrap();
        in_folder(folder.path(), set)
    };
    let counts = |loaded: Loaded| {
        let runs = loaded.plan.runs.iter().map(|run| format!("{}:{}", run.stage, run.nodes.len()));
        (runs.collect::<Vec<_>>(), loaded.plan.variants.len())
    };
    let all = "sources: { other: null }\nstages: { learn: null, compare: { nodes: { median: ~ } } }\nmatrix: { compare.stereo.with.block: null }\n";
    let in_the_file = load(&format!("extends: base.yaml\n{all}"), &[]).unwrap_or_else(|message| panic!("{message}"));
    assert!(in_the_file.warnings.is_empty(), "{}", in_the_file.warnings);
    let expected = (vec!["compare:3".to_owned()], 1);
    assert_eq!(counts(in_the_file), expected);
    let set = ["sources.other=null", "learn=null", "compare.median=null", "matrix.compare.stereo.with.block=null"];
    assert_eq!(counts(load(TWO_STAGES, &set).unwrap_or_else(|message| panic!("{message}"))), expected);
    let matrix = load("extends: base.yaml\nmatrix: null\n", &[]).unwrap_or_else(|message| panic!("{message}"));
    assert_eq!(matrix.plan.variants, [""]);
    // What others read cannot go, and what was never there neither.
    let message = load("extends: base.yaml\nstages: { compare: { nodes: { depth: null } } }\n", &[]).unwrap_err();
    assert!(message.contains("there is no node `depth`") || message.contains("no node `depth`"), "{message}");
    let message = load("extends: base.yaml\nstages: { lern: null }\n", &[]).unwrap_err();
    assert!(message.contains("`lern` is empty") && message.contains("nothing of that name is inherited"), "{message}");
    // A variant changes, and takes nothing away.
    let message = load("extends: base.yaml\nvariants: { plain: { compare.median: null } }\n", &[]).unwrap_err();
    assert!(message.contains("`median` is empty: a node must be a map"), "{message}");
}
