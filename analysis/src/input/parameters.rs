//! What was set otherwise: which parameter, version, input or file of which node.

use depthloom_graphs::plan::VariantId;
use depthloom_recording::{PlanDifference, RecordedPlan, RecordedRun, node_pairs, source_differences};
use serde::Serialize;

/// How many variants of a node are named.
const NAMED: usize = 3;

/// Where two sides differ by themselves, not for what they read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Changed {
    #[serde(flatten)]
    change: Change,
    /// `stage.node`, with its variants where it does not serve all; or the source of a stage.
    node: String,
}

/// How a node of one side compares with that of the baseline.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "what", rename_all = "lowercase")]
enum Change {
    /// The baseline lacks it.
    New,
    /// The side lacks it.
    Gone,
    #[serde(untagged)]
    Difference(PlanDifference),
}

impl Changed {
    /// In a line.
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

/// What differs between two plans, or a variant of each.
pub(crate) fn changed(
    before: (&RecordedPlan, Option<VariantId>),
    after: (&RecordedPlan, Option<VariantId>),
) -> Vec<Changed> {
    let of = |(plan, variant): (&RecordedPlan, Option<VariantId>)| match variant {
        Some(variant) => of_variant(plan, variant),
        None => plan.clone(),
    };
    let (before, after) = (of(before), of(after));
    let mut found: Vec<Changed> = Vec::new();
    let mut add = |changed: Changed| {
        if !found.contains(&changed) {
            found.push(changed);
        }
    };
    for run in &after.runs {
        let Some(was) = before.runs.iter().find(|of| of.name() == run.name()) else { continue };
        for difference in source_differences(&was.source, &run.source) {
            let node = format!("source of {}", run.stage);
            add(Changed { node, change: Change::Difference(difference) });
        }
    }
    for pair in node_pairs(&before, &after) {
        let node = pair.label(if pair.after.is_some() { &after } else { &before }, NAMED);
        // Of stages and variants that one side lacks, a reader knows.
        let has_stage = |plan: &RecordedPlan| plan.runs.iter().any(|run| run.stage == pair.stage);
        let has_variant = |plan: &RecordedPlan| {
            pair.variants.is_empty() || pair.variants.iter().any(|name| plan.variants.contains(name))
        };
        let is_of_both = [&before, &after].into_iter().all(|plan| has_stage(plan) && has_variant(plan));
        match (pair.before, pair.after) {
            (Some(_), Some(_)) => {
                for difference in pair.differences.into_iter().filter(|difference| !difference.is_upstream()) {
                    add(Changed { node: node.clone(), change: Change::Difference(difference) });
                }
            }
            (None, _) if is_of_both => add(Changed { node, change: Change::New }),
            (_, None) if is_of_both => add(Changed { node, change: Change::Gone }),
            _ => {}
        }
    }
    found
}

/// The plan as it were, had it this variant alone, without a name: so that it can be held against another variant.
fn of_variant(plan: &RecordedPlan, variant: VariantId) -> RecordedPlan {
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
