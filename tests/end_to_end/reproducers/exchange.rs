//! Names exchanged between runs: variants, nodes, estimates. Results belong to their parameters, not to a name.

use super::{Case, text};

const STREET: &str = "experiment: exchange
sources: { street: { kind: synthetic/road, with: { frames: 0..2, seed: 2, width: 160, height: 48 } } }
stages:
  compare:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 64 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
";

fn variants(case: &Case, name: &str, variants: &str) {
    let score = "    score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }\n";
    case.write(name, format!("{STREET}{score}variants: {{ {variants} }}\n"));
}

/// Two median filters with these window sizes, and estimates with these names.
fn filters(case: &Case, name: &str, sizes: [u32; 2], estimates: &str) {
    let [small, large] = sizes;
    let nodes = format!(
        "      small: {{ kind: filter/median, inputs: {{ depth: depth/depth }}, with: {{ size: {small} }} }}\n      \
         large: {{ kind: filter/median, inputs: {{ depth: depth/depth }}, with: {{ size: {large} }} }}\n    \
         score: {{ ground_truth: source/depth, estimates: {{ {estimates} }} }}\n"
    );
    case.write(name, format!("{STREET}{nodes}"));
}

#[test]
fn variants_with_exchanged_parameters_have_their_own_results() {
    let case = Case::new();
    variants(&case, "one.yaml", "a: { compare.stereo.with.block: 5 }, b: { compare.stereo.with.block: 9 }");
    variants(&case, "two.yaml", "a: { compare.stereo.with.block: 9 }, b: { compare.stereo.with.block: 5 }");
    case.run("one.yaml", "runs/one", &[]);
    case.run_as_fresh("two.yaml", "runs/two", &[]);
    let scores = |run: &str| text(&case.path(run).join("scores.csv"));
    assert_ne!(scores("runs/one"), scores("runs/two"), "block sizes change the scores");
    // A later run does not reuse a value by the name of its former variant.
    variants(&case, "three.yaml", "only: { compare.stereo.with.block: 9 }");
    case.run_as_fresh("three.yaml", "runs/three", &[]);
}

#[test]
fn rotated_variants_have_their_own_results() {
    let case = Case::new();
    let blocks = [3, 7, 11];
    for turn in 0..3 {
        let block = |variant: usize| blocks[(variant + turn) % 3];
        let changes: Vec<String> =
            (0..3).map(|variant| format!("v{variant}: {{ compare.stereo.with.block: {} }}", block(variant))).collect();
        variants(&case, "turn.yaml", &changes.join(", "));
        case.run_as_fresh("turn.yaml", &format!("runs/turn{turn}"), &[]);
    }
}

#[test]
fn a_base_parameter_that_becomes_a_variants_has_its_own_results() {
    let case = Case::new();
    variants(&case, "one.yaml", "base: {}, other: { compare.stereo.with.block: 9 }");
    variants(&case, "two.yaml", "base: { compare.stereo.with.block: 9 }, other: {}");
    case.run("one.yaml", "runs/one", &[]);
    case.run_as_fresh("two.yaml", "runs/two", &[]);
}

/// Found by `tests/fuzz_reuse`: messages name values after the run of a stage, and a variant with another source has a
/// separate run.
#[test]
fn a_variant_that_no_longer_changes_the_source_is_named_after_the_stage() {
    let case = Case::new();
    variants(&case, "one.yaml", "a: { compare.stereo.with.block: 9 }, b: { sources.street.with.frames: 0..1 }");
    variants(&case, "two.yaml", "a: { compare.stereo.with.block: 9 }, b: {}");
    case.run("one.yaml", "runs/one", &[]);
    case.run_as_fresh("two.yaml", "runs/two", &[]);
}

#[test]
fn nodes_with_exchanged_parameters_and_relabelled_estimates_have_their_own_results() {
    let case = Case::new();
    filters(&case, "one.yaml", [3, 5], "small: small/depth, large: large/depth");
    filters(&case, "two.yaml", [5, 3], "small: small/depth, large: large/depth");
    filters(&case, "three.yaml", [3, 5], "small: large/depth, large: small/depth");
    case.run("one.yaml", "runs/one", &[]);
    case.run_as_fresh("two.yaml", "runs/two", &[]);
    case.run_as_fresh("three.yaml", "runs/three", &[]);
}
