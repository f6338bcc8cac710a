//! Labels: how they are read, and that they change no node.

use depthloom_graphs::plan::{Label, Labels};

use super::{Written, loaded_with, plan_of, stereo, try_load};

const LABELS: &str = "variants: { small: { compare.stereo.with.block: 3 }, large: {} }
matrix: { compare.fused.with.size: [3, 5] }
labels:
  estimates: { fused: Fusion (ours), stereo: }
  variants: { large: Large blocks, small+size=3: Smallest }
  axes: { size: { label: Median, values: { 5: 5 px } } }
";

#[test]
fn labels_are_read_in_their_order_and_change_no_node() {
    let plan = plan_of(&stereo(LABELS));
    let label = |name: &str, label: &str| Label { name: name.to_owned(), label: label.to_owned() };
    assert_eq!(plan.labels.estimates, [label("fused", "Fusion (ours)"), label("stereo", "stereo")]);
    assert_eq!(plan.labels.variants, [label("large", "Large blocks"), label("small+size=3", "Smallest")]);
    let shown: Vec<String> = (plan.variants.iter().zip(&plan.factors))
        .map(|(name, factors)| plan.labels.variant(name, factors).into_owned())
        .collect();
    assert_eq!(shown, ["Smallest", "small, 5 px", "Large blocks, Median 3", "Large blocks, 5 px"]);
    let without = plan_of(&stereo(LABELS.split("labels:").next().expect("a beginning")));
    assert_eq!(without.labels, Labels::default());
    let hashes = |plan: &depthloom_graphs::plan::Plan| -> Vec<String> {
        plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.node_hash.to_string()).collect()
    };
    assert_eq!(hashes(&plan), hashes(&without));
}

#[test]
fn wrong_labels_are_errors_and_labels_of_nothing_are_warnings() {
    let printed = |labels: &str| {
        let written = Written::new(&[("main.yaml", &stereo(labels))]);
        match try_load(&written.path("main.yaml"), &[]) {
            Ok(loaded) => (true, loaded.warnings.to_string()),
            Err(diagnostics) => (false, diagnostics.to_string()),
        }
    };
    for (labels, expected) in [
        ("labels: [fused]", "`labels` must be a map"),
        ("labels: { estimate: { fused: a } }", "estimates"),
        ("labels: { estimates: { fused: a, stereo: a } }", "`fused` and `stereo` have the same label"),
        ("labels: { estimates: { fused: stereo } }", "`stereo` and `fused` would both be shown as `stereo`"),
        ("labels: { estimates: { fused: '' } }", "the label of `fused` is empty"),
        ("labels: { estimates: { fused: \"a\\u202Eb\" } }", "the label of `fused` contains U+202E"),
        ("labels: { variants: { base: \"\\u2067a\" } }", "the label of `base` contains U+2067"),
        ("labels: { estimates: { fused: [a] } }", "`fused` must be text"),
        ("labels: { axes: { size: { title: a } } }", "label"),
    ] {
        let (is_valid, text) = printed(labels);
        assert!(!is_valid && text.contains(expected), "{labels}: {text}");
    }
    for (labels, expected) in [
        ("labels: { estimates: { fusd: a } }", "did you mean `fused`?"),
        ("labels: { variants: { full: a } }", "`full` is labelled, but is not a variant"),
        ("labels: { axes: { block: a } }", "`block` is labelled, but is not an axis of `matrix`"),
    ] {
        let (is_valid, text) = printed(labels);
        assert!(is_valid && text.contains(expected), "{labels}: {text}");
    }
}

#[test]
fn labels_of_unselected_variants_are_not_reported() {
    let written = Written::new(&[("main.yaml", &stereo(LABELS))]);
    let warnings = loaded_with(&written.path("main.yaml"), &[("only", "[\"large+*\"]")]).warnings;
    assert!(warnings.is_empty(), "{warnings}");
}
