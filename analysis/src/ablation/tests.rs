//! Ablations of a recorded plan with two axes, and scores that are easy to compute by hand.

use depthloom_graphs::plan::FrameIndex;
use std::sync::Arc;

use depthloom_graphs::Remedied;
use serde::Deserialize as _;
use serde_json::{Value as Json, json};

use super::*;
use crate::estimates::estimates;
use crate::input::timings::Timing;
use crate::tables::RowKey;

/// An output that is recorded on every frame.
pub(super) fn output(port: &str, kind: &str, topic: &str) -> Json {
    json!({ "port": port, "type": kind, "once": false, "topic": topic, "aliases": [], "recorded": true })
}

/// A pure node of some variants.
pub(super) fn node(kind: &str, name: &str, inputs: &[(&str, &str)], output: &Json, variants: &Json) -> Json {
    let inputs: Vec<Json> = inputs.iter().map(|(port, from)| json!({ "port": port, "from": from })).collect();
    json!({
        "name": name, "kind": kind, "version": 1, "contract": "pure", "params": {}, "inputs": inputs, "outputs": [output],
        "node_hash": "0123456789abcdef0123456789abcdef", "variants": variants,
    })
}

/// Variants of `block` (3, 9) and `mode` (hh, sgbm) with one estimate each, and one estimate that all share. The depth
/// of the source is the ground truth.
fn plan() -> RecordedPlan {
    let params = json!({ "preset": "martins2018", "sets": ["valid", "all"], "max_m": null });
    let node = |name: &str, inputs: &[(&str, &str)], output: &Json, variants: &Json| {
        node("test/node", name, inputs, output, variants)
    };
    let all = json!([0, 1, 2, 3]);
    let mut nodes = vec![
        node("stereo", &[("left", "/s/source/left")], &output("depth", "depth", "/s/stereo"), &all),
        node(
            "score.stereo",
            &[("estimate", "/s/stereo"), ("ground_truth", "/s/source/depth")],
            &output("rows", "scores", "/s/score"),
            &all,
        ),
    ];
    let mut estimates = vec![estimate("stereo", &Json::Null, "/s/stereo", "/s/score", 1, &params)];
    let mut factors = Vec::new();
    let mut names = Vec::new();
    for (variant, (block, mode)) in [("3", "hh"), ("3", "sgbm"), ("9", "hh"), ("9", "sgbm")].into_iter().enumerate() {
        let (depth, scores) = (format!("/s/v{variant}/depth"), format!("/s/v{variant}/score"));
        let variants = json!([variant]);
        nodes.push(node("smooth", &[("depth", "/s/stereo")], &output("depth", "depth", &depth), &variants));
        let inputs = [("estimate", depth.as_str()), ("ground_truth", "/s/source/depth")];
        nodes.push(node("score.smooth", &inputs, &output("rows", "scores", &scores), &variants));
        let (name, score_node) = (format!("block={block}+mode={mode}"), nodes.len() - 1);
        estimates.push(estimate("smooth", &json!([variant, name]), &depth, &scores, score_node, &params));
        factors.push(json!([{ "axis": "block", "value": block }, { "axis": "mode", "value": mode }]));
        names.push(name);
    }
    let plan = json!({
        "experiment": "test", "description": "", "variants": names, "factors": factors, "every": 1, "view": false,
        "runs": [{
            "stage": "s", "prefix": "/s", "variants": [0, 1, 2, 3],
            "source": {
                "name": "street", "parts": [],
                "outputs": [output("left", "image", "/s/source/left"), output("depth", "depth", "/s/source/depth")],
            },
            "nodes": nodes, "estimates": estimates,
        }],
    });
    RecordedPlan::deserialize(plan).unwrap()
}

pub(super) fn estimate(name: &str, variant: &Json, depth: &str, scores: &str, node: usize, params: &Json) -> Json {
    let label = variant[1].as_str().map_or_else(|| name.to_owned(), |variant| format!("{variant}/{name}"));
    json!({
        "label": label, "name": name, "variant": variant[0], "estimate_topic": depth, "truth_topic": "/s/source/depth",
        "score_topic": scores, "score_node": node, "score_params": params,
    })
}

fn score(position: usize, estimate: usize, zone: &str, pixels: u64, abs_rel: f64) -> [FrameScore; 2] {
    [PixelSet::All, PixelSet::Valid].map(|set| {
        let valid = pixels / 2;
        let counted = if set == PixelSet::All { pixels } else { valid };
        let row = ScoreRow { pixels: counted, truth: pixels, valid, ..ScoreRow::new(set, zone) };
        let metric = |name: &str| Metric::named(name).unwrap();
        let row = row.with(metric("a1"), 1.0 - abs_rel).with(metric("a3"), 1.0).with(metric("abs_rel"), abs_rel);
        FrameScore { frame: Arc::from(format!("f{position}")), position: FrameIndex(position), estimate, row }
    })
}

/// Two frames, the second with three times as many pixels. The errors on the first frame are listed by estimate
/// (`stereo`, then the variants); those on the second are 0.1 higher. In zone `near` the order of variants is reversed.
fn scores() -> Vec<FrameScore> {
    let mut scores = Vec::new();
    for (position, (pixels, more)) in [(100, 0.0), (300, 0.1)].into_iter().enumerate() {
        for (estimate, error) in [0.5, 0.1, 0.2, 0.3, 0.6].into_iter().enumerate() {
            scores.extend(score(position, estimate, "", pixels, error + more));
            scores.extend(score(position, estimate, "near", pixels / 10, 1.0 - error - more));
        }
    }
    scores
}

fn costs() -> Costs {
    let timing = |variant: Option<&str>, node: &str, phase: &str, cpu_ns: u64| Timing {
        row_key: RowKey { stage: "s".to_owned(), variant: variant.map(str::to_owned), factors: Vec::new() },
        node: node.to_owned(),
        phase: phase.to_owned(),
        frames: 2,
        cpu_ns,
        wall_ns: 0,
        median_cpu_ns: None,
        latency: None,
    };
    Costs::new(&[
        timing(None, "street", "read", 900_000_000),
        timing(None, "stereo", "process", 20_000_000),
        timing(Some("block=3+mode=hh"), "smooth", "process", 2_000_000),
        timing(Some("block=3+mode=sgbm"), "smooth", "process", 4_000_000),
        timing(Some("block=9+mode=hh"), "smooth", "process", 6_000_000),
        timing(None, "score.stereo", "process", 70_000_000),
    ])
}

/// Runs a query on the ablation of these scores.
fn ask<R>(query: impl FnOnce(&Ablation<'_>) -> R) -> R {
    ask_of(&estimates(&plan()).unwrap(), &scores(), query)
}

fn ask_of<R>(estimates: &[Estimate], scores: &[FrameScore], query: impl FnOnce(&Ablation<'_>) -> R) -> R {
    query(&Ablation::new(&plan(), estimates, scores, &|_, _| None, Some(&costs())))
}

fn ranking(ranking: &Ranking, selection: &Selection) -> Result<crate::tables::Table, AnalysisError> {
    ask(|ablation| ranking.table(ablation, selection, &|| false))
}

pub(super) fn csv(grid: &crate::tables::Table) -> String {
    String::from_utf8(grid.csv()).unwrap()
}

pub(super) fn owned(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

/// The labels of the rows of a table.
pub(super) fn labels(grid: &crate::tables::Table) -> Vec<String> {
    let csv = csv(grid);
    let label = |line: &str| match line.split(',').collect::<Vec<_>>()[1..3] {
        ["", estimate] => estimate.to_owned(),
        [variant, estimate] => format!("{variant}/{estimate}"),
        _ => line.to_owned(),
    };
    csv.lines().skip(1).map(label).collect()
}

/// The message and the remedy of an error.
pub(super) fn refused<R: std::fmt::Debug>(result: Result<R, AnalysisError>) -> String {
    let error = result.unwrap_err();
    format!("{error}; {}", error.remedy().unwrap())
}

#[test]
fn axes_are_columns_and_rows_are_sorted_best_first() {
    let columns = owned(&["abs_rel", "density", "ms"]);
    let grid = ranking(&Ranking { columns, ..Ranking::default() }, &Selection::default()).unwrap();
    let expected = "\
all pixels with ground truth, preset martins2018, mean over 2 frames; 5 rows by abs_rel; * best

estimate  block  mode  abs_rel ↓   density ↑   ms ↓
smooth    3      hh       0.1500*     50.0 %  11.00
smooth    3      sgbm     0.2500      50.0 %  12.00
smooth    9      hh       0.3500      50.0 %  13.00
stereo    -      -        0.5500      50.0 %  10.00
smooth    9      sgbm     0.6500      50.0 %      -
note: ms: CPU time of all nodes that an estimate is computed from, core-milliseconds per frame
";
    assert_eq!(grid.terminal(110), expected);
    let last = csv(&grid).lines().last().unwrap().to_owned();
    assert_eq!(last, "s,block=9+mode=sgbm,smooth,all,,9,sgbm,0.6499999999999999,0.5,");
}

#[test]
fn costs_include_all_upstream_nodes_and_shared_nodes_count_for_each_estimate() {
    let estimates = estimates(&plan()).unwrap();
    // `stereo` takes 10 ms per frame, `smooth` 1, 2 and 3 ms on top; the node of the last variant has no timing.
    let ms = costs().core_ms(&plan(), &estimates);
    assert_eq!(ms, [Some(10.0), Some(11.0), Some(12.0), Some(13.0), None]);
}

#[test]
fn rows_are_cut_filtered_and_on_the_front() {
    let labels = |of: &Ranking, selection: &Selection| -> Vec<String> { labels(&ranking(of, selection).unwrap()) };
    let top = Ranking { top: Some(2), sort: Some("ms".to_owned()), ..Ranking::default() };
    assert_eq!(labels(&top, &Selection::default()), ["stereo", "block=3+mode=hh/smooth"]);
    let of_block_9 = Selection { estimates: Some("block=9*".to_owned()), ..Selection::default() };
    let by_mode = Ranking { sort: Some("mode".to_owned()), ..Ranking::default() };
    assert_eq!(labels(&by_mode, &of_block_9), ["block=9+mode=hh/smooth", "block=9+mode=sgbm/smooth"]);
    // 11 ms for 0.15 beats 12 and 13 ms for more; a row without a time is not on the front.
    let front = Ranking { pareto: owned(&["abs_rel", "ms"]), ..Ranking::default() };
    assert_eq!(labels(&front, &Selection::default()), ["block=3+mode=hh/smooth", "stereo"]);
}

#[test]
fn the_best_value_is_marked_only_among_comparable_rows() {
    let selection = Selection { set: Some(PixelSet::Valid), ..Selection::default() };
    let grid = ranking(&Ranking::default(), &selection).unwrap();
    assert!(!grid.terminal(110).contains('*'), "each row covers its own pixels");
    assert!(grid.notes.iter().any(|note| note.contains("covers its own valid pixels")), "{:?}", grid.notes);
    // Three rows with one ground truth, two with another: each group has a best row.
    let mut estimates = estimates(&plan()).unwrap();
    for estimate in &mut estimates[3..] {
        estimate.truth_output = Some("/s/lidar/depth".to_owned());
    }
    let ranking = Ranking { columns: owned(&["abs_rel"]), ..Ranking::default() };
    let grid =
        ask_of(&estimates, &scores(), |ablation| ranking.table(ablation, &Selection::default(), &|| false)).unwrap();
    let marked = grid.terminal(110).lines().filter(|line| line.ends_with('*')).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(marked, ["smooth    3      hh       0.1500*", "smooth    9      hh       0.3500*"]);
    assert!(grid.notes[0].starts_with("the rows form 2 groups that cannot be compared"), "{:?}", grid.notes);
}

#[test]
fn means_over_pixels_weigh_all_pixels_equally() {
    // (100 * 0.1 + 300 * 0.2) / 400 = 0.175, not 0.15.
    let value = |mean| {
        let selection = Selection { mean, estimates: Some("block=3+mode=hh/*".to_owned()), ..Selection::default() };
        ask(|ablation| ablation.rows(&selection).unwrap()[0].values[2].unwrap())
    };
    assert!((value(None) - 0.15).abs() < 1e-12);
    assert!((value(Some(Mean::Pixels)) - 0.175).abs() < 1e-12);
}

/// By hand: the variants' means are 0.15, 0.25, 0.35 and 0.65, their mean is 0.35; squares (4 + 1 + 0 + 9) / 100.
/// `block` has means 0.2 and 0.5, its share is 4 * 0.15^2 / 0.14 = 9 / 14; `mode` has 0.25 and 0.45, 4 / 14; 1 / 14
/// remains for the interaction.
#[test]
fn effects_show_each_axis_and_the_interactions() {
    let grid = ask(|ablation| effects::table(ablation, &Selection::default(), "abs_rel")).unwrap();
    let expected = "\
effect of each axis on abs_rel over all pixels with ground truth, preset martins2018, mean over 2 frames; 4 rows, mean
0.3500, standard deviation 0.1871; share: share of the variance between rows (eta squared); * best

axis          level  rows  abs_rel ↓   difference   share
block         3         2     0.2000*     -0.1500  64.3 %
              9         2     0.5000       0.1500

mode          hh        2     0.2500*     -0.1000  28.6 %
              sgbm      2     0.4500       0.1000

interactions  -         -          -            -   7.1 %
block x mode  -         -          -            -   7.1 %
note: excluded, because no axis changes it: stereo
";
    assert_eq!(grid.terminal(118), expected);
    let more = ask(|ablation| effects::table(ablation, &Selection::default(), "a1")).unwrap();
    assert!(more.terminal(118).contains("3         2  0.8000*"), "higher is better: {}", more.terminal(118));
}

#[test]
fn effects_on_time_are_shown_and_axes_are_refused() {
    let effects = |of: &str| ask(|ablation| effects::table(ablation, &Selection::default(), of));
    let text = effects("ms").unwrap().terminal(118);
    // Block 3 has 11 and 12, block 9 has 13 and one missing value: `sgbm` costs 1 more, and a third of the rows have
    // it.
    assert!(
        text.contains("block  3         2  11.33*")
            && text.contains("9         1  13.33")
            && text.starts_with("effect of each axis on ms, core-milliseconds per frame; 3 rows"),
        "{text}"
    );
    assert!(text.contains("note: excluded: 1 row without a value"), "{text}");
    assert!(refused(effects("mode")).starts_with("`mode` is an axis: it has no better direction"));
    let best = |of: &str| refused(ask(|ablation| zones::table(ablation, &Selection::default(), of)));
    assert!(best("mode").starts_with("`mode` is not a metric: `--best-per-zone` needs a metric"), "{}", best("mode"));
    assert!(best("ms").starts_with("`ms` is not a metric: `--best-per-zone` needs a metric"), "{}", best("ms"));
}

/// The median over all pixels cannot be computed from the medians of frames. An empty zone is a different reason.
#[test]
fn a_median_over_pixels_is_refused_with_its_reason() {
    let median = Metric::named("median_error").unwrap();
    let mut estimates = estimates(&plan()).unwrap();
    estimates.iter_mut().for_each(|estimate| estimate.metrics.push(median));
    let mut scores = scores();
    for score in scores.iter_mut().filter(|score| score.row.zone.is_empty()) {
        score.row = score.row.clone().with(median, 1.0);
    }
    let ask = |of: &dyn Fn(&Ablation<'_>) -> Result<crate::tables::Table, AnalysisError>| {
        refused(ask_of(&estimates, &scores, of))
    };
    let pixels = Selection { mean: Some(Mean::Pixels), ..Selection::default() };
    let reason = "`median_error` over the pixels of all frames cannot be computed from the scores of frames; use `--mean frames`";
    assert_eq!(ask(&|of| effects::table(of, &pixels, "median_error")), reason);
    assert_eq!(ask(&|of| zones::table(of, &pixels, "median_error")), reason);
    let near = Selection { zone: Some("near".to_owned()), ..Selection::default() };
    let of_near = ask(&|of| effects::table(of, &near, "median_error"));
    assert!(of_near.starts_with("no row has a value of `median_error`; no frame has a pixel"), "{of_near}");
}

/// Only variants with mode sgbm have the axis `block`, whose levels come in the order 9, 3.
#[test]
fn nested_axes_are_compared_among_their_variants_and_numbers_sorted_by_size() {
    let mut plan = plan();
    let factor =
        |axis: &str, value: &str| depthloom_graphs::plan::Factor { axis: axis.to_owned(), value: value.to_owned() };
    plan.factors = vec![
        vec![factor("mode", "hh")],
        vec![factor("mode", "sgbm"), factor("block", "9")],
        vec![factor("mode", "hh")],
        vec![factor("mode", "sgbm"), factor("block", "3")],
    ];
    let estimates = estimates(&plan).unwrap();
    let scores = scores();
    let ablation = Ablation::new(&plan, &estimates, &scores, &|_, _| None, None);
    let text = effects::table(&ablation, &Selection::default(), "abs_rel").unwrap().terminal(118);
    // The mean of 0.25 and 0.65 is 0.45; the mean of all four is 0.35.
    for line in ["block  3         1     0.6500       0.2000", "       9         1     0.2500*     -0.2000"] {
        assert!(text.contains(line), "{text}");
    }
    assert!(
        text.contains("note: 2 of 4 rows have the axis block: its means and differences cover these rows"),
        "{text}"
    );
    assert!(!text.contains("(none)"), "{text}");
    let by_block = Ranking { sort: Some("block".to_owned()), ..Ranking::default() };
    let grid = by_block.table(&ablation, &Selection::default(), &|| false).unwrap();
    let json = serde_json::to_value(grid.json_rows()).unwrap();
    let blocks: Vec<&Json> = json.as_array().unwrap().iter().map(|row| &row["block"]).collect();
    assert_eq!(blocks, [&json!(3), &json!(9), &Json::Null, &Json::Null, &Json::Null]);
}

#[test]
fn rows_that_cannot_be_compared_do_not_dominate_each_other() {
    let mut estimates = estimates(&plan()).unwrap();
    for estimate in &mut estimates[3..] {
        estimate.truth_output = Some("/s/lidar/depth".to_owned());
    }
    let front = Ranking { pareto: owned(&["abs_rel", "ms"]), ..Ranking::default() };
    let grid =
        ask_of(&estimates, &scores(), |ablation| front.table(ablation, &Selection::default(), &|| false)).unwrap();
    let labels = labels(&grid);
    // 11 ms for 0.15 would dominate 13 ms for 0.35, but that row has other ground truth.
    assert_eq!(labels, ["block=3+mode=hh/smooth", "block=9+mode=hh/smooth", "stereo"]);
    assert!(grid.notes.iter().any(|note| note.starts_with("the rows form 2 groups")), "{:?}", grid.notes);
}

#[test]
fn a_note_reports_overlapping_shares_of_incomplete_designs() {
    let selection = Selection { estimates: Some("*/smooth".to_owned()), ..Selection::default() };
    let grid = ask_of(
        &estimates(&plan()).unwrap()[..4],
        &scores().into_iter().filter(|of| of.estimate < 4).collect::<Vec<_>>(),
        |ablation| effects::table(ablation, &selection, "abs_rel"),
    )
    .unwrap();
    assert!(grid.notes.iter().any(|note| note.contains("shares overlap")), "{:?}", grid.notes);
    assert!(!csv(&grid).contains("interactions"));
}

#[test]
fn each_zone_has_its_best_row_and_the_value_of_the_overall_best() {
    let grid = ask(|ablation| zones::table(ablation, &Selection::default(), "abs_rel")).unwrap();
    let expected = "\
zone,stage,variant,estimate,set,block,mode,abs_rel,best_overall,rows,pixels
whole image,s,block=3+mode=hh,smooth,all,3,hh,0.15000000000000002,0.15000000000000002,5,400
near,s,block=9+mode=sgbm,smooth,all,9,sgbm,0.35000000000000003,0.8500000000000001,5,40
";
    assert_eq!(csv(&grid), expected);
    let near = Selection { zone: Some("near".to_owned()), ..Selection::default() };
    let row = ranking(&Ranking { top: Some(1), ..Ranking::default() }, &near).unwrap();
    assert!(row.about.starts_with("all pixels with ground truth of zone near, "), "{}", row.about);
    assert!(csv(&row).starts_with("stage,variant,estimate,set,zone,block,mode,"), "{}", csv(&row));
    assert!(csv(&row).contains("\ns,block=9+mode=sgbm,smooth,all,near,9,sgbm,"), "{}", csv(&row));
}

#[test]
fn a_row_that_is_best_in_several_zones_shows_its_axes() {
    let everywhere = scores().into_iter().filter(|score| score.row.zone.is_empty()).flat_map(|score| {
        let near = ScoreRow { zone: "near".to_owned(), ..score.row.clone() };
        [FrameScore { row: near, ..score.clone() }, score]
    });
    let scores: Vec<FrameScore> = everywhere.collect();
    let query = |ablation: &Ablation<'_>| zones::table(ablation, &Selection::default(), "abs_rel");
    let text = ask_of(&estimates(&plan()).unwrap(), &scores, query).unwrap().terminal(110);
    assert!(text.contains("\nzone         estimate  block  mode  abs_rel"), "{text}");
}

#[test]
fn unknown_names_are_reported_with_the_available_ones() {
    let sorted = |by: &str| {
        refused(ranking(&Ranking { sort: Some(by.to_owned()), ..Ranking::default() }, &Selection::default()))
    };
    assert_eq!(sorted("absrel"), "there is no column `absrel`; did you mean `abs_rel`?");
    assert_eq!(sorted("blok"), "there is no column `blok`; did you mean `block`?");
    assert!(sorted("rmse").starts_with("`rmse` was not scored; add it to `metrics`"), "{}", sorted("rmse"));
    assert!(sorted("epe").contains("`score/disparity` computes"), "{}", sorted("epe"));
    let selected = |selection: Selection| refused(ask(|ablation| ablation.rows(&selection)));
    let zone = Selection { zone: Some("naer".to_owned()), ..Selection::default() };
    assert_eq!(selected(zone), "there is no zone `naer`; did you mean `near`?");
    let pattern = Selection { estimates: Some("smoth".to_owned()), ..Selection::default() };
    assert_eq!(selected(pattern), "there is no estimate `smoth`; did you mean `smooth`?");
    let set = Selection { set: Some(PixelSet::Filled), ..Selection::default() };
    assert!(selected(set).starts_with("nothing was scored on `filled`; scored pixel sets: `all` and `valid`"));
    assert!(sorted("nothing").contains("axes `block`, `mode`, metrics `a1`"), "{}", sorted("nothing"));
    let pattern = Selection { estimates: Some("qqqqqqqqq".to_owned()), ..Selection::default() };
    assert!(selected(pattern).contains("available: `stereo`, `smooth`, `block=3+mode=hh/smooth`, `block=3"));
    let front =
        |of: &[&str]| refused(ranking(&Ranking { pareto: owned(of), ..Ranking::default() }, &Selection::default()));
    assert!(front(&["abs_rel"]).contains("name two columns"));
    assert!(front(&["abs_rel", "block"]).starts_with("`block` is an axis"));
    let effects = refused(ask(|ablation| {
        effects::table(ablation, &Selection { estimates: Some("stereo".to_owned()), ..Selection::default() }, "abs_rel")
    }));
    assert!(effects.starts_with("no axis has an effect"), "{effects}");
    let estimates = estimates(&plan()).unwrap();
    let ranking = Ranking { sort: Some("ms".to_owned()), ..Ranking::default() };
    let (plan, scores) = (plan(), scores());
    let without = Ablation::new(&plan, &estimates, &scores, &|_, _| None, None);
    assert!(refused(ranking.table(&without, &Selection::default(), &|| false)).contains("timings.parquet"));
    let reused = Ablation::new(&plan, &estimates, &scores, &|_, _| None, Some(&Costs::new(&[])));
    assert!(refused(ranking.table(&reused, &Selection::default(), &|| false)).contains("run --fresh"));
}

#[test]
fn variants_without_a_matrix_are_an_axis() {
    let mut plan = plan();
    plan.factors = Vec::new();
    let estimates = estimates(&plan).unwrap();
    let scores = scores();
    let ablation = Ablation::new(&plan, &estimates, &scores, &|_, _| None, None);
    let axis = Axis { name: "variant".to_owned(), levels: plan.variants.clone(), is_numeric: false };
    assert_eq!(ablation.axes, [axis]);
    let grid = effects::table(&ablation, &Selection::default(), "abs_rel").unwrap();
    assert!(grid.notes.iter().any(|note| note.starts_with("no share for variant")), "{:?}", grid.notes);
    let grid = Ranking::default().table(&ablation, &Selection::default(), &|| false).unwrap();
    let text = grid.terminal(110);
    assert!(text.contains("\nvariant            estimate    a1"), "{text}");
    assert!(csv(&grid).starts_with("stage,variant,estimate,set,zone,a1,"), "{}", csv(&grid));
}

/// The scores with an additional end-point error, which excludes invalid pixels.
fn with_end_point_errors() -> Vec<FrameScore> {
    let mut scores = scores();
    for score in &mut scores {
        let value = score.row.get(Metric::named("abs_rel").unwrap()).unwrap();
        score.row = score.row.clone().with(Metric::named("epe").unwrap(), value);
    }
    scores
}

#[test]
fn metrics_over_valid_pixels_only_are_never_marked_as_best() {
    let ask = |ranking: &Ranking| {
        ask_of(&estimates(&plan()).unwrap(), &with_end_point_errors(), |of| {
            ranking.table(of, &Selection::default(), &|| false)
        })
        .unwrap()
    };
    let text = |metric: &str| ask(&Ranking { columns: owned(&[metric]), ..Ranking::default() }).terminal(200);
    assert!(text("abs_rel").contains('*'), "{}", text("abs_rel"));
    assert!(!text("epe").contains('*') && text("epe").contains("note: epe excludes invalid pixels"), "{}", text("epe"));
}

#[test]
fn requested_columns_keep_their_order_and_appear_once() {
    let grid =
        ranking(&Ranking { columns: owned(&["a1", "abs_rel", "a1"]), ..Ranking::default() }, &Selection::default());
    let grid = grid.unwrap();
    assert!(grid.about.ends_with(" rows by a1"), "{}", grid.about);
    assert_eq!(grid.columns.iter().filter(|column| column.name == "a1").count(), 1);
}

#[test]
fn a_recording_without_scored_pixels_is_an_error() {
    let none = |score: &FrameScore| {
        let row = ScoreRow { pixels: 0, valid: 0, truth: 0, ..ScoreRow::new(score.row.set, &score.row.zone) };
        FrameScore { row, ..score.clone() }
    };
    let scores: Vec<FrameScore> = scores().iter().map(none).collect();
    let refusal = ask_of(&estimates(&plan()).unwrap(), &scores, |of| {
        Ranking::default().table(of, &Selection::default(), &|| false)
    });
    assert!(refused(refusal).starts_with("not one pixel was scored"));
}

#[test]
fn estimates_that_share_no_frame_are_an_error() {
    let scores: Vec<FrameScore> =
        scores().into_iter().filter(|score| (score.estimate == 0) == (score.position == FrameIndex(0))).collect();
    let refusal = ask_of(&estimates(&plan()).unwrap(), &scores, |ablation| {
        Ranking::default().table(ablation, &Selection::default(), &|| false)
    });
    assert!(refused(refusal).starts_with("no frame has scores of all estimates of its stage"));
}

#[test]
fn an_estimate_without_any_score_does_not_exclude_the_others() {
    let scores: Vec<FrameScore> = scores().into_iter().filter(|score| score.estimate != 4).collect();
    let grid = ask_of(&estimates(&plan()).unwrap(), &scores, |ablation| {
        Ranking::default().table(ablation, &Selection::default(), &|| false)
    });
    let labels = labels(&grid.unwrap());
    assert_eq!(labels.len(), 4, "{labels:?}");
    assert!(!labels.iter().any(|label| label.starts_with("block=9+mode=sgbm")), "{labels:?}");
}
