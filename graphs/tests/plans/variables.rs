//! What becomes of the values of environment variables: they decide, and are neither shown nor recorded.

use depthloom_graphs::language::{Options, load};
use depthloom_graphs::plan::Plan;

use super::{Written, nodes, stereo, toys};

/// A plan of an experiment in which variables have these values.
fn plan(text: &str, variables: &[(&str, &str)]) -> Plan {
    let written = Written::new(&[("main.yaml", text), ("shared/alices.yaml", "description: shared\n")]);
    let value = |name: &str| variables.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned());
    let options = Options { env: Box::new(value), ..Options::default() };
    load(&written.path("main.yaml"), &toys::registry(), &options).unwrap_or_else(|found| panic!("{found}")).plan
}

/// All that is shown or recorded of a plan.
fn shown(plan: &Plan) -> String {
    let nodes = plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.portable.to_string());
    let parts = plan.runs.iter().flat_map(|run| &run.source.parts).map(|part| part.portable.to_string());
    let recorded: Vec<String> = nodes.chain(parts).collect();
    let written: Vec<String> = plan.written.iter().map(|(name, text)| format!("{name}{text}")).collect();
    let texts = [
        serde_json::to_string(&plan.summary_json()).expect("texts and numbers have JSON"),
        plan.summary_text(),
        plan.mermaid(),
        plan.resolved.clone(),
    ];
    [texts.join("\n"), recorded.join("\n"), written.join("\n"), plan.description.clone()].join("\n")
}

#[test]
fn values_of_variables_are_neither_shown_nor_recorded() {
    let text = stereo("description: 'of ${TOKEN}'\nextends: 'shared/${BASE}.yaml'\n")
        .replace("{ kind: synthetic/road }", "{ kind: kitti/stereo2015, with: { root: '${ROOT}/training' } }")
        .replace("ground_truth: source/depth", "ground_truth: source/depth\n      preset: 'x-${TOKEN}'");
    let values = [("TOKEN", "wrench-17"), ("ROOT", "/home/alice/kitti"), ("BASE", "alices")];
    let first = plan(&text, &values);
    let shown = shown(&first);
    for value in ["wrench-17", "alice"] {
        assert!(!shown.contains(value), "{value} is in {shown}");
    }
    assert!(shown.contains(r#""preset":"x-${TOKEN}""#) && shown.contains(r#""root":"${ROOT}/training""#), "{shown}");
    assert_eq!(first.description, "of ${TOKEN}");
    assert_eq!(first.written[1].0, "shared/BASE.yaml");
    // The node itself gets the value, and a result of one value is never reused for another.
    let score = |plan: &Plan| nodes(plan, 0, "score.fused")[0].clone();
    assert_eq!(score(&first).params["preset"], "x-wrench-17");
    let other = plan(&text, &[("TOKEN", "hammer-18"), values[1], values[2]]);
    assert_ne!(score(&first).node_hash, score(&other).node_hash);
    assert_eq!(score(&first).portable, score(&other).portable);
    let source = |plan: &Plan| plan.runs[0].source.parts[0].portable.clone();
    let elsewhere = plan(&text, &[values[0], ("ROOT", "/mnt/other"), values[2]]);
    assert_eq!(source(&first)["root"], source(&elsewhere)["root"]);
    assert_eq!(source(&first), source(&elsewhere), "`training` is the name of both folders");
    let renamed = text.replace("${ROOT}/training", "${ROOT}");
    let source_in = |root| source(&plan(&renamed, &[values[0], ("ROOT", root), values[2]]));
    assert_ne!(source_in("/a/one"), source_in("/a/other"), "a run with one root does not resume with the other");
    let literal = plan(&text.replace("x-${TOKEN}", "x-wrench-17"), &values);
    assert_eq!(
        score(&first).node_hash,
        score(&literal).node_hash,
        "the node hash is of the value, however it is given"
    );
}

#[test]
fn numbers_of_variables_are_settings_and_are_recorded() {
    let text = stereo("")
        .replace("calibration: source/calibration } }", "calibration: source/calibration }, with: { cap: '${CAP}' } }");
    let plan = plan(&text, &[("CAP", "50")]);
    let depth = nodes(&plan, 0, "depth")[0];
    assert_eq!((&depth.shown["cap"], &depth.portable["cap"]), (&50.0.into(), &50.0.into()));
}
