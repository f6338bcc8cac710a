//! Checks a recorded plan as strictly as an experiment file: everything that it names must exist.

use std::collections::HashSet;

use depthloom_graphs::ValueType;
use depthloom_graphs::plan::{RunId, VariantId};

use super::{RecordedEstimate, RecordedOutput, RecordedPlan, RecordedRun};

impl RecordedPlan {
    pub(crate) fn from_json(text: &str) -> Result<Self, String> {
        let plan: Self = serde_json::from_str(text).map_err(|error| format!("its plan cannot be read: {error}"))?;
        plan.check().map_err(|what| format!("its plan is invalid: {what}"))?;
        Ok(plan)
    }

    fn check(&self) -> Result<(), String> {
        if self.every == 0 {
            return Err("`every` is 0".to_owned());
        }
        if !self.factors.is_empty() && self.factors.len() != self.variants.len() {
            return Err(format!("{} of {} variants have factors", self.factors.len(), self.variants.len()));
        }
        for (factors, variant) in self.factors.iter().zip(&self.variants) {
            let mut axes = HashSet::new();
            if let Some(twice) = factors.iter().find(|factor| !axes.insert(&factor.axis)) {
                return Err(format!("variant `{variant}` has two values on the axis `{}`", twice.axis));
            }
        }
        let outputs = RunId::all(self.runs.len()).flat_map(|run| self.outputs(run));
        let mut topics = HashSet::new();
        for (_, output) in outputs.filter(|(_, output)| output.recorded && !output.once) {
            if !topics.insert(&output.topic) {
                return Err(format!("two outputs have the topic {}", output.topic));
            }
        }
        self.runs
            .iter()
            .try_for_each(|run| self.check_run(run).map_err(|what| format!("stage `{}`: {what}", run.stage)))
    }

    fn check_run(&self, run: &RecordedRun) -> Result<(), String> {
        let of_nodes = run.nodes.iter().flat_map(|node| &node.variants);
        self.check_variants(run.variants.iter().chain(of_nodes))?;
        let of_nodes = run.nodes.iter().flat_map(|node| &node.outputs);
        for output in run.source.outputs.iter().chain(of_nodes) {
            if output.value_type().is_none() {
                return Err(format!("topic {} is of type `{}`", output.topic, output.value_type));
            }
        }
        for estimate in &run.estimates {
            self.check_variants(estimate.variant.iter())?;
            check_estimate(run, estimate).map_err(|what| format!("estimate `{}`: {what}", estimate.label))?;
        }
        Ok(())
    }

    fn check_variants<'a>(&self, mut variants: impl Iterator<Item = &'a VariantId>) -> Result<(), String> {
        match variants.find(|variant| variant.0 >= self.variants.len()) {
            None => Ok(()),
            Some(variant) => Err(format!("variant {variant} is one of {}", self.variants.len())),
        }
    }
}

fn check_estimate(run: &RecordedRun, estimate: &RecordedEstimate) -> Result<(), String> {
    let nodes = run.nodes.len();
    let score = run.nodes.get(estimate.score_node.0);
    let score = score.ok_or_else(|| format!("its score is node {} of {nodes}", estimate.score_node))?;
    if estimate.score_params != score.params {
        return Err("its scores have other parameters than their node".to_owned());
    }
    let anywhere = || run.source.outputs.iter().chain(run.nodes.iter().flat_map(|node| &node.outputs));
    let (estimate_type, truth_type) = match score.kind.as_str() {
        "score/disparity" => (ValueType::Disparity, ValueType::TrueDisparity),
        _ => (ValueType::Depth, ValueType::Depth),
    };
    check_topic("estimate", estimate.estimate_topic.as_ref(), estimate_type, anywhere())?;
    check_topic("truth", estimate.truth_topic.as_ref(), truth_type, anywhere())?;
    check_topic("scores", estimate.score_topic.as_ref(), ValueType::Scores, score.outputs.iter())
}

/// Checks that a topic, if there is one, is that of a recorded output with per-frame values of that type.
fn check_topic<'a>(
    what: &str,
    topic: Option<&String>,
    value_type: ValueType,
    mut outputs: impl Iterator<Item = &'a RecordedOutput>,
) -> Result<(), String> {
    let Some(topic) = topic else { return Ok(()) };
    let is_of = |output: &RecordedOutput| output.recorded && !output.once && output.value_type() == Some(value_type);
    let found = outputs.any(|output| output.topic == *topic && is_of(output));
    if found { Ok(()) } else { Err(format!("topic {topic} of its {what} has no {value_type} per frame")) }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value as Json, json};

    use super::RecordedPlan;
    use depthloom_graphs::plan::{NodeId, VariantId};

    fn plan() -> Json {
        let output = |topic: &str, value_type: &str| {
            let (once, recorded) = (false, true);
            json!({ "port": "out", "type": value_type, "once": once, "topic": topic, "aliases": [], "recorded": recorded })
        };
        let params = json!({ "preset": "martins2018", "sets": ["all"] });
        let node = |name: &str, output: Json| {
            json!({
                "name": name, "kind": "test/node", "version": 1, "contract": "pure", "params": params, "inputs": [],
                "outputs": [output], "node_hash": "0123456789abcdef0123456789abcdef", "variants": [0, 1],
            })
        };
        json!({
            "experiment": "test", "description": "", "variants": ["a", "b"], "every": 1, "view": false,
            "runs": [{
                "stage": "compare", "prefix": "/compare", "variants": [0, 1],
                "source": { "name": "street", "parts": [], "outputs": [output("/truth", "depth")] },
                "nodes": [node("stereo", output("/estimate", "depth")), node("score", output("/scores", "scores"))],
                "estimates": [{
                    "label": "a/stereo", "name": "stereo", "variant": 0, "estimate_topic": "/estimate",
                    "truth_topic": "/truth", "score_topic": "/scores", "score_node": 1, "score_params": params,
                }],
            }],
        })
    }

    #[test]
    fn fault_11_a_recorded_plan_that_names_missing_things_is_refused() {
        let read = |plan: &Json| RecordedPlan::from_json(&plan.to_string());
        let factor = |value: &str| json!({ "axis": "block", "value": value });
        assert!(read(&plan()).is_ok());
        let mut with = plan();
        with["factors"] = json!([[factor("3")], []]);
        let with = read(&with).unwrap();
        assert_eq!(with.factors_of(VariantId(0))[0].value, "3");
        assert!(with.factors_of(VariantId(1)).is_empty() && with.factors_of(VariantId(2)).is_empty());
        let refused = [
            ("/runs/0/estimates/0/variant", json!(9), "variant 9 is one of 2"),
            ("/runs/0/variants/1", json!(2), "variant 2 is one of 2"),
            ("/runs/0/nodes/0/variants/0", json!(5), "variant 5 is one of 2"),
            ("/runs/0/estimates/0/score_node", json!(2), "its score is node 2 of 2"),
            ("/runs/0/estimates/0/score_topic", json!("/estimate"), "topic /estimate of its scores has no scores"),
            ("/runs/0/estimates/0/truth_topic", json!("/scores"), "topic /scores of its truth has no depth"),
            ("/runs/0/estimates/0/score_params/preset", json!("x"), "other parameters than their node"),
            ("/runs/0/nodes/0/outputs/0/type", json!("depht"), "topic /estimate is of type `depht`"),
            ("/runs/0/nodes/0/outputs/0/topic", json!("/truth"), "two outputs have the topic /truth"),
            ("/runs/0/nodes/0/node_hash", json!("0123"), "its plan cannot be read"),
            ("/runs/0/source/parts", json!([{}]), "its plan cannot be read"),
            ("/factors", json!([[]]), "1 of 2 variants have factors"),
            ("/factors", json!([[], [{ "axis": "block", "value": 3 }]]), "its plan cannot be read"),
            ("/factors", json!([[], [factor("3"), factor("5")]]), "variant `b` has two values on the axis `block`"),
            ("/every", json!(0), "`every` is 0"),
            ("/view", json!(1), "its plan cannot be read"),
        ];
        for (place, value, what) in refused {
            let mut changed = plan();
            match place.rsplit_once('/') {
                Some(("", key)) => changed[key] = value,
                _ => *changed.pointer_mut(place).unwrap() = value,
            }
            let error = read(&changed).unwrap_err();
            assert!(error.contains(what), "{place}: {error}");
        }
        let mut unknown = plan();
        unknown["runs"][0]["estimates"][0]["sets"] = json!([]);
        assert!(read(&unknown).is_err());
    }

    #[test]
    fn fault_11_a_plan_with_a_digit_set_to_nine_is_refused_or_valid() {
        let text = plan().to_string();
        for (place, _) in text.char_indices().filter(|(_, c)| c.is_ascii_digit()) {
            let mut changed = text.clone();
            changed.replace_range(place..=place, "9");
            let Ok(plan) = RecordedPlan::from_json(&changed) else { continue };
            for run in &plan.runs {
                for estimate in &run.estimates {
                    assert!(estimate.variant.is_none_or(|variant| variant < VariantId(plan.variants.len())));
                    assert!(estimate.score_node < NodeId(run.nodes.len()));
                }
            }
        }
    }
}
