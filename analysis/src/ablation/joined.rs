//! Joins the row of a depth with the row of the disparity it was computed from. Both are scored separately.

use std::collections::HashMap;

use depthloom_graphs::plan::RunId;
use depthloom_recording::RecordedPlan;
use depthloom_scores::{Family, Metric};

use super::{Ablation, Row};
use crate::estimates::Estimate;

/// The kind that converts a disparity to a depth pixel by pixel: both are one estimate.
const DEPTH_FROM_DISPARITY: &str = "depth/from-disparity";

/// For each estimate, the topic of its disparity: the estimate itself, or the disparity it was computed from.
pub(super) fn disparities<'a>(plan: &'a RecordedPlan, estimates: &'a [Estimate]) -> Vec<Option<&'a str>> {
    let by_depth: HashMap<(RunId, &str), &str> = RunId::enumerate(&plan.runs)
        .flat_map(|(run, planned)| planned.nodes.iter().map(move |node| (run, node)))
        .filter(|(_, node)| node.kind == DEPTH_FROM_DISPARITY)
        .filter_map(|(run, node)| {
            let disparity = node.inputs.iter().find(|input| input.port == "disparity")?.from.as_deref()?;
            Some(((run, node.outputs.first()?.topic.as_str()), disparity))
        })
        .collect();
    let disparity = |estimate: &'a Estimate| match (estimate.family, estimate.scored_output.as_deref()) {
        (Family::Disparity, topic) => topic,
        (Family::Depth, topic) => by_depth.get(&(estimate.run, topic?)).copied(),
    };
    estimates.iter().map(disparity).collect()
}

/// Joins the row of a depth with the row of its disparity if both have the same variant and stage. The joined row takes
/// the place of the depth. If there are several of either, the pairs are unknown and all rows stay separate.
pub(super) fn joined(ablation: &Ablation<'_>, rows: Vec<Row>) -> Vec<Row> {
    /// Rows of depths and of disparities.
    type Both = [Vec<usize>; 2];
    let mut by_disparity: HashMap<(RunId, Option<&str>, &str), Both> = HashMap::new();
    for (place, row) in rows.iter().enumerate() {
        if let Some(disparity) = ablation.disparities[row.estimate] {
            let estimate = ablation.estimate(row);
            let both = by_disparity.entry((estimate.run, estimate.row_key.variant.as_deref(), disparity)).or_default();
            both[usize::from(estimate.family == Family::Disparity)].push(place);
        }
    }
    let mut disparity_of: HashMap<usize, usize> = HashMap::new();
    for [depths, disparities] in by_disparity.into_values() {
        if let (&[depth], &[disparity]) = (&depths[..], &disparities[..]) {
            disparity_of.insert(depth, disparity);
        }
    }
    let mut rows: Vec<Option<Row>> = rows.into_iter().map(Some).collect();
    for (depth, disparity) in disparity_of {
        let disparity = rows[disparity].take();
        if let Some(row) = &mut rows[depth] {
            row.joined = disparity.map(Box::new);
        }
    }
    rows.into_iter().flatten().collect()
}

/// The estimate with this metric, of the two that a label such as `full/depth+disparity` names.
pub(crate) fn estimate_by_label(estimates: &[Estimate], label: &str, metric: &str) -> Option<usize> {
    let is_of_disparities = Family::Disparity.metrics().iter().any(|known: &Metric| known.name == metric);
    estimates.iter().enumerate().filter(|(_, depth)| depth.family == Family::Depth).find_map(|(place, depth)| {
        let name = label.strip_prefix(depth.label.as_str())?.strip_prefix('+')?;
        let disparity = estimates.iter().position(|other| {
            let is_same_variant = (other.run, &other.row_key) == (depth.run, &depth.row_key);
            other.family == Family::Disparity && other.name == name && is_same_variant
        })?;
        Some(if is_of_disparities { disparity } else { place })
    })
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::plan::FrameIndex;
    use std::sync::Arc;

    use depthloom_scores::{PixelSet, ScoreRow};
    use serde::Deserialize as _;
    use serde_json::json;

    use super::super::tests::{csv, estimate, labels, node, output, owned, refused};
    use super::super::{Ranking, Selection};
    use super::*;
    use crate::error::AnalysisError;
    use crate::estimates::estimates;
    use crate::scores::FrameScore;
    use crate::tables::Table;

    /// Two variants with a disparity, the depth that it becomes, and that depth smoothed: all three scored.
    fn plan() -> RecordedPlan {
        let (mut nodes, mut estimates) = (Vec::new(), Vec::new());
        let depths = json!({ "preset": "martins2018", "sets": ["all"], "metrics": ["abs_rel"] });
        let disparities = json!({ "sets": ["all"], "metrics": ["d1"], "mean": "pixels" });
        for (variant, name) in ["block=3", "block=9"].into_iter().enumerate() {
            let variants = json!([variant]);
            let topic = |name: &str| format!("/s/v{variant}/{name}");
            let [disparity, depth, smooth] = ["disparity", "depth", "smooth"].map(topic);
            nodes.push(node("stereo/sgbm", "match", &[], &output("disparity", "disparity", &disparity), &variants));
            let inputs = [("disparity", disparity.as_str())];
            nodes.push(node("depth/from-disparity", "depth", &inputs, &output("depth", "depth", &depth), &variants));
            let inputs = [("depth", depth.as_str())];
            nodes.push(node("filter/median", "smooth", &inputs, &output("depth", "depth", &smooth), &variants));
            for (kind, params, scored, topic) in [
                ("score/depth", &depths, "depth", &depth),
                ("score/depth", &depths, "smooth", &smooth),
                ("score/disparity", &disparities, "disparity", &disparity),
            ] {
                let rows = format!("{topic}/rows");
                let inputs = [("estimate", topic.as_str()), ("ground_truth", "/s/source/truth")];
                nodes.push(node(
                    kind,
                    &format!("score.{scored}"),
                    &inputs,
                    &output("rows", "scores", &rows),
                    &variants,
                ));
                estimates.push(estimate(scored, &json!([variant, name]), topic, &rows, nodes.len() - 1, params));
            }
        }
        let factors = ["3", "9"].map(|block| json!([{ "axis": "block", "value": block }]));
        let plan = json!({
            "experiment": "test", "description": "", "variants": ["block=3", "block=9"], "factors": factors, "every": 1, "view": false,
            "runs": [{
                "stage": "s", "prefix": "/s", "variants": [0, 1], "nodes": nodes, "estimates": estimates,
                "source": { "name": "street", "parts": [], "outputs": [output("truth", "depth", "/s/source/truth")] },
            }],
        });
        RecordedPlan::deserialize(plan).unwrap()
    }

    /// `depth`, `smooth` and `disparity` of the first variant, then of the second; disparities have fewer pixels with
    /// ground truth.
    fn ask(ranking: &Ranking, selection: &Selection) -> Result<Table, AnalysisError> {
        let plan = plan();
        let estimates = estimates(&plan).unwrap();
        let values = [0.1, 0.2, 0.03, 0.4, 0.3, 0.01];
        let score = |(estimate, value): (usize, f64)| {
            let metric = Metric::named(if estimate % 3 == 2 { "d1" } else { "abs_rel" }).unwrap();
            let truth = if estimate % 3 == 2 { 50 } else { 80 };
            let row = ScoreRow { pixels: truth, truth, valid: 40, ..ScoreRow::new(PixelSet::All, "") };
            FrameScore { frame: Arc::from("0"), position: FrameIndex(0), estimate, row: row.with(metric, value) }
        };
        let scores: Vec<FrameScore> = values.into_iter().enumerate().map(score).collect();
        let ablation = Ablation::new(&plan, &estimates, &scores, &|_, _| None, None);
        ranking.table(&ablation, selection, &|| false)
    }

    #[test]
    fn a_depth_and_its_disparity_share_a_row() {
        let grid = ask(&Ranking::default(), &Selection::default()).unwrap();
        let expected = "\
stage,variant,estimate,set,zone,block,abs_rel,d1,density,disparity_density
s,block=3,depth+disparity,all,,3,0.1,0.03,0.5,0.8
s,block=3,smooth,all,,3,0.2,,0.5,
s,block=9,smooth,all,,9,0.3,,0.5,
s,block=9,depth+disparity,all,,9,0.4,0.01,0.5,0.8
";
        assert_eq!(csv(&grid), expected);
        let text = grid.terminal(110);
        assert!(text.contains("0.1000*  0.03000") && text.contains("0.4000   0.01000*"), "{text}");
        assert!(!text.contains("groups that cannot be compared"), "{text}");
        assert!(text.contains("density is that of the depth"), "{text}");
        assert!(grid.about.ends_with("over 1 frame, some averaged over frames, others over pixels; 4 rows by abs_rel"));
    }

    #[test]
    fn a_front_of_depth_and_disparity_metrics_has_rows_with_both() {
        let both = Ranking { pareto: owned(&["abs_rel", "d1"]), ..Ranking::default() };
        let on_it = labels(&ask(&both, &Selection::default()).unwrap());
        assert_eq!(on_it, ["block=3/depth+disparity", "block=9/depth+disparity"]);
        // A smoothed depth has no disparity, so no row has both.
        let apart = Selection { estimates: Some("smooth".to_owned()), ..Selection::default() };
        assert!(refused(ask(&both, &apart)).starts_with("`d1` was not scored for the selected estimates"));
    }

    #[test]
    fn metrics_of_one_family_select_the_rows_of_that_family() {
        let ranking = Ranking { columns: owned(&["d1", "density"]), ..Ranking::default() };
        let grid = ask(&ranking, &Selection::default()).unwrap();
        let expected = "stage,variant,estimate,set,zone,block,d1,density\n\
                        s,block=9,disparity,all,,9,0.01,0.8\ns,block=3,disparity,all,,3,0.03,0.8\n";
        assert_eq!(csv(&grid), expected);
        assert!(grid.notes.contains(&"excluded: 4 rows without any of these metrics".to_owned()));
    }

    #[test]
    fn a_note_reports_cut_rows_without_the_sorting_metric() {
        let ranking = Ranking { sort: Some("d1".to_owned()), top: Some(2), ..Ranking::default() };
        let grid = ask(&ranking, &Selection::default()).unwrap();
        assert!(grid.about.ends_with("the first 2 of 4 rows by d1"), "{}", grid.about);
        assert!(
            grid.notes.contains(&"2 of the rows that are not shown have no value of d1, so they come last".to_owned())
        );
    }

    #[test]
    fn a_joined_label_finds_the_estimate_with_the_metric() {
        let plan = plan();
        let estimates = estimates(&plan).unwrap();
        let named = |metric: &str| {
            estimate_by_label(&estimates, "block=9/depth+disparity", metric)
                .map(|place| estimates[place].label.as_str())
        };
        assert_eq!((named("abs_rel"), named("d1")), (Some("block=9/depth"), Some("block=9/disparity")));
        assert_eq!(estimate_by_label(&estimates, "block=9/smoth+disparity", "d1"), None);
    }
}
