//! Differences of parameters between two plans: parameters, versions, inputs and files of nodes.

use depthloom_graphs::plan::VariantId;
use depthloom_recording::{PlanDifference, RecordedPlan, RecordedRun, node_pairs, source_differences};
use serde::Serialize;

/// The number of variants of a node that are named.
const NAMED: usize = 3;

/// A difference between two sides in a node itself, not in its inputs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Changed {
    #[serde(flatten)]
    change: Change,
    /// `stage.node`, with its variants if it does not belong to all; or the source of a stage.
    node: String,
}

/// How a node of one side compares with that of the baseline.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "what", rename_all = "lowercase")]
enum Change {
    /// The node exists only in this side.
    New,
    /// The node exists only in the baseline.
    Gone,
    #[serde(untagged)]
    Difference(PlanDifference),
}

impl Changed {
    /// As one line of text.
    pub(crate) fn text(&self) -> String {
        match &self.change {
            Change::Difference(difference) => format!("{}  {difference}", self.node),
            Change::New => format!("{}  is new", self.node),
            Change::Gone => format!("{}  is gone", self.node),
        }
    }
}

/// The differences between two plans, or a variant of each, with the node of each difference.
pub(crate) fn parameter_changes(
    before: (&RecordedPlan, Option<VariantId>),
    after: (&RecordedPlan, Option<VariantId>),
) -> Vec<(String, PlanDifference)> {
    let all = changed(before, after).into_iter();
    let difference = |changed: Changed| match changed.change {
        Change::Difference(difference) => Some((changed.node, difference)),
        Change::New | Change::Gone => None,
    };
    all.filter_map(difference).collect()
}

/// All differences between two plans, or between one variant of each.
pub(crate) fn changed(
    before: (&RecordedPlan, Option<VariantId>),
    after: (&RecordedPlan, Option<VariantId>),
) -> Vec<Changed> {
    let restricted = |(plan, variant): (&RecordedPlan, Option<VariantId>)| match variant {
        Some(variant) => single_variant(plan, variant),
        None => plan.clone(),
    };
    let (before, after) = (restricted(before), restricted(after));
    let mut found: Vec<Changed> = Vec::new();
    let mut add = |changed: Changed| {
        if !found.contains(&changed) {
            found.push(changed);
        }
    };
    for run in &after.runs {
        let Some(was) = before.runs.iter().find(|old| old.name() == run.name()) else { continue };
        for difference in source_differences(&was.source, &run.source) {
            let node = format!("source of {}", run.stage);
            add(Changed { node, change: Change::Difference(difference) });
        }
    }
    for pair in node_pairs(&before, &after) {
        let node = pair.label(if pair.after.is_some() { &after } else { &before }, NAMED);
        // Stages and variants that exist on one side only are not listed node by node.
        let has_stage = |plan: &RecordedPlan| plan.runs.iter().any(|run| run.stage == pair.stage);
        let has_variant = |plan: &RecordedPlan| {
            pair.variants.is_empty() || pair.variants.iter().any(|name| plan.variants.contains(name))
        };
        let is_in_both = [&before, &after].into_iter().all(|plan| has_stage(plan) && has_variant(plan));
        match (pair.before, pair.after) {
            (Some(_), Some(_)) => {
                for difference in pair.differences.into_iter().filter(|difference| !difference.is_upstream()) {
                    add(Changed { node: node.clone(), change: Change::Difference(difference) });
                }
            }
            (None, _) if is_in_both => add(Changed { node, change: Change::New }),
            (_, None) if is_in_both => add(Changed { node, change: Change::Gone }),
            _ => {}
        }
    }
    found
}

/// The plan with only this variant, without a name, so that it can be compared with another variant.
fn single_variant(plan: &RecordedPlan, variant: VariantId) -> RecordedPlan {
    let run = |run: &RecordedRun| {
        let nodes = run.nodes.iter().filter(|node| node.variants.contains(&variant)).cloned();
        let nodes = nodes.map(|mut node| {
            node.variants = vec![VariantId(0)];
            node
        });
        RecordedRun { variants: vec![VariantId(0)], nodes: nodes.collect(), estimates: Vec::new(), ..run.clone() }
    };
    let runs = plan.runs.iter().filter(|run| run.variants.contains(&variant)).map(run).collect();
    RecordedPlan { variants: vec![String::new()], factors: Vec::new(), runs, ..plan.clone() }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn json_has_the_keys_of_the_difference_between_what_and_node() {
        let json = |change| serde_json::to_string(&Changed { change, node: "look.stereo".to_owned() }).unwrap();
        let difference = PlanDifference::Parameter { path: "block".to_owned(), before: Some(json!(3)), after: None };
        assert_eq!(
            json(Change::Difference(difference)),
            r#"{"what":"parameter","path":"block","before":3,"after":null,"node":"look.stereo"}"#
        );
        assert_eq!(json(Change::New), r#"{"what":"new","node":"look.stereo"}"#);
        assert_eq!(json(Change::Gone), r#"{"what":"gone","node":"look.stereo"}"#);
    }
}
