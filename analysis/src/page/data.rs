//! The data of the page: one JSON object, from which its script builds tables and figures.

use depthloom_graphs::plan::{FrameIndex, NodeId, RunId};
use std::collections::{BTreeMap, BTreeSet, HashMap};

use depthloom_figures::page::{ColourRange, Layer, Pictures, Scale, Series};
use depthloom_figures::{EstimateKey, Look, looks};
use depthloom_recording::{RecordedFrame, RecordedPlan, Recording};
use depthloom_scores::PixelSet;
use serde_json::{Map, Value as Json, json};

use super::choice;
use super::leading::leading_metric;
use crate::ablation::{Ablation, ScoreTable, Selection, effects_table, paper_number, zones_table};
use crate::distance::{DistanceBin, Spread};
use crate::error::AnalysisError;
use crate::estimates::Estimate;
use crate::input::paper::paper_scores;
use crate::input::timings::Timing;
use crate::report::ReportData;
use crate::scores::FrameScore;
use crate::statistics::Interval;
use crate::tables::best::Mark;
use crate::tables::{Level, RowKeys, plan_key, variant_of};
use crate::titles::Titles;

/// The maximum number of listed failures.
const MOST_FAILURES: usize = 200;
/// The maximum number of nodes in the list of keys.
const MOST_NODES: usize = 400;
/// Significant digits of curves and of tables.
const DRAWN: usize = 5;
const TABLED: usize = 7;

/// A number rounded to significant digits; null if it is missing.
fn number(number: Option<f64>, digits: usize) -> Json {
    let number = number.filter(|number| number.is_finite());
    number.map_or(Json::Null, |number| format!("{number:.*e}", digits - 1).parse::<f64>().unwrap_or(number).into())
}

fn numbers(all: impl IntoIterator<Item = Option<f64>>) -> Json {
    all.into_iter().map(|one| number(one, DRAWN)).collect()
}

/// The table: its metrics, and one row per estimate and pixel set.
pub(super) fn table(table: &ScoreTable, estimates: &[Estimate], shown: &[usize], titles: &Titles) -> Json {
    let by_label: HashMap<&str, &Estimate> =
        estimates.iter().map(|estimate| (estimate.label.as_str(), estimate)).collect();
    let looks = looks_of(estimates, shown);
    let look_by_label: HashMap<&str, Look> =
        estimates.iter().map(|estimate| estimate.label.as_str()).zip(looks).collect();
    let metrics = table.metrics.iter().map(|metric| {
        json!({
            "name": metric.name, "plain": metric.plain, "unit": metric.unit, "more": metric.more_is_better,
            "decimals": metric.decimals, "formula": metric.formula, "source": metric.source,
        })
    });
    let ends = |interval: Interval| [interval.low, interval.high].map(|end| number(Some(end), TABLED));
    let shown_level = |level: &Level| level.value.as_deref().map(|value| titles.value(&level.axis, value).to_owned());
    let rows = table.rows.iter().map(|row| {
        let paper = by_label.get(row.label.as_str()).and_then(|estimate| paper_scores(estimate, row.set));
        let papers =
            || table.metrics.iter().map(|metric| number(paper_number(paper, metric), TABLED)).collect::<Vec<_>>();
        json!({
            "stage": row.key.stage,
            "variant": row.key.variant,
            "estimate": row.estimate,
            "colour": look_by_label.get(row.label.as_str()).map(|look| look.colour),
            "dash": look_by_label.get(row.label.as_str()).map(|look| look.dash),
            "set": row.set.name(),
            "factors": row.key.factors.iter().map(|level| &level.value).collect::<Vec<_>>(),
            "shown": {
                "variant": row.key.variant.as_deref().map(|variant| titles.variant(variant)),
                "estimate": titles.estimate(&row.estimate),
                "factors": row.key.factors.iter().map(shown_level).collect::<Vec<_>>(),
            },
            "frames": row.frames,
            "density": number(row.density, TABLED),
            "means": row.values.iter().map(|value| number(*value, TABLED)).collect::<Vec<_>>(),
            "intervals": row.intervals.iter().map(|interval| interval.map(ends)).collect::<Vec<_>>(),
            "best": (0..table.metrics.len()).filter(|&metric| row.marks[metric] == Mark::Best).collect::<Vec<_>>(),
            "paper": paper.map(|_| papers()),
        })
    });
    let axes = table.rows.first();
    let axes = axes.map(|row| row.key.factors.iter().map(|level| titles.axis(&level.axis)).collect::<Vec<_>>());
    json!({
        "about": table.about(),
        "best": table.marks(),
        "axes": axes,
        "metrics": metrics.collect::<Vec<_>>(),
        "rows": rows.collect::<Vec<_>>(),
    })
}

/// The tables of `table --effects` and `table --best-per-zone`, if the run has axes or zones.
pub(super) fn query_tables(
    ablation: &Ablation<'_>,
    table: &ScoreTable,
    titles: &Titles,
) -> Result<Vec<Json>, AnalysisError> {
    let Some(metric) = leading_metric(&table.metrics).map(|place| table.metrics[place].name) else {
        return Ok(Vec::new());
    };
    let all = Selection::default();
    let queries = [
        ("Effect of each axis", effects_table(ablation, &all, metric)),
        ("Best in each zone", zones_table(ablation, &all, metric)),
    ];
    let mut tables = Vec::new();
    for (title, grid) in queries {
        match grid {
            Ok(mut grid) => {
                titles.apply(&mut grid);
                tables.push(json!({ "title": title, "table": grid.page() }));
            }
            // A run without axes has no effects, and one without zones has no best rows of zones.
            Err(AnalysisError::Request { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(tables)
}

/// The colour and the line style of each estimate.
fn looks_of(estimates: &[Estimate], shown: &[usize]) -> Vec<Look> {
    let shown: BTreeSet<usize> = shown.iter().copied().collect();
    let keys = estimates.iter().enumerate().map(|(place, estimate)| EstimateKey {
        stage: &estimate.row_key.stage,
        name: &estimate.name,
        variant: estimate.row_key.variant.as_deref(),
        is_shown: shown.contains(&place),
    });
    looks(&keys.collect::<Vec<_>>())
}

/// The estimates with curves; other data refers to them by index.
pub(super) fn estimates(estimates: &[Estimate], shown: &[usize]) -> Json {
    let looks = looks_of(estimates, shown);
    let one = |&index: &usize| {
        let estimate = &estimates[index];
        json!({
            "label": estimate.title, "name": estimate.name, "run": estimate.run,
            "stage": estimate.row_key.stage, "variant": estimate.row_key.variant,
            "colour": looks[index].colour, "dash": looks[index].dash, "preset": estimate.preset,
            "sets": estimate.sets.iter().map(|set| set.name()).collect::<Vec<_>>(),
            "set": choice::set_of(estimate).map(PixelSet::name),
            "metrics": estimate.metrics.iter().map(|metric| metric.name).collect::<Vec<_>>(),
        })
    };
    shown.iter().map(one).collect()
}

/// Error against distance: for each displayed estimate the metres, and the spread over its valid pixels and over those
/// valid in all estimates.
pub(super) fn distances(report: &ReportData, shown: &[usize]) -> Json {
    let curve = |(place, index): (usize, &usize)| {
        let bins: Vec<&DistanceBin> = report.bins.iter().filter(|bin| bin.estimate == *index).collect();
        let spread = |spread_of: &dyn Fn(&DistanceBin) -> Option<Spread>| {
            let percentile =
                |i: usize| numbers(bins.iter().map(|bin| spread_of(bin).map(|spread| spread.percentiles_m[i])));
            json!({
                "count": bins.iter().map(|bin| spread_of(bin).map_or(0, |spread| spread.count)).collect::<Vec<_>>(),
                "percentiles": (0..5).map(percentile).collect::<Vec<_>>(),
            })
        };
        (!bins.is_empty()).then(|| {
            json!({
                "estimate": place,
                "metres": bins.iter().map(|bin| bin.bin_m).collect::<Vec<_>>(),
                "valid": spread(&|bin| Some(bin.valid)),
                "common": spread(&|bin| bin.shared),
            })
        })
    };
    let truth: Vec<(u32, u64)> = report.truth.iter().map(|(metre, count)| (*metre, *count)).collect();
    json!({ "estimates": shown.iter().enumerate().filter_map(curve).collect::<Vec<_>>(), "truth": truth })
}

/// Scores by frame, one part per stage run.
pub(super) fn scores(
    recording: &Recording,
    estimates: &[Estimate],
    shown: &[usize],
    series: &[Series],
    scores: &[FrameScore],
) -> Json {
    let mut parts = Vec::new();
    for (run, planned) in RunId::enumerate(&recording.plan().runs) {
        let own: Vec<(usize, usize)> =
            shown.iter().copied().enumerate().filter(|(_, index)| estimates[*index].run == run).collect();
        if own.is_empty() {
            continue;
        }
        let frames = recording.frames(run);
        let pictured =
            series.iter().filter(|series| series.run == run).flat_map(|series| series.positions.iter().copied());
        let positions = choice::points(frames.len(), &pictured.collect::<Vec<_>>());
        let places: HashMap<FrameIndex, usize> =
            positions.iter().enumerate().map(|(place, position)| (*position, place)).collect();
        let mut rows: BTreeMap<(usize, &str), Vec<Option<&FrameScore>>> = BTreeMap::new();
        let shown_as: HashMap<usize, usize> = own.iter().map(|(place, index)| (*index, *place)).collect();
        for score in scores.iter().filter(|score| score.row.zone.is_empty()) {
            let (Some(estimate), Some(place)) = (shown_as.get(&score.estimate), places.get(&score.position)) else {
                continue;
            };
            let row = rows.entry((*estimate, score.row.set.name())).or_insert_with(|| vec![None; positions.len()]);
            row[*place] = Some(score);
        }
        let lines = rows.iter().map(|((estimate, set), row)| {
            let scored = &estimates[shown[*estimate]];
            let values = scored.metrics.iter().map(|metric| {
                (metric.name.to_owned(), numbers(row.iter().map(|score| score.as_ref()?.row.get(metric))))
            });
            let pixels: Vec<Option<u64>> =
                row.iter().map(|score| score.as_ref().map(|score| score.row.pixels)).collect();
            json!({ "estimate": estimate, "set": set, "pixels": pixels, "values": values.collect::<Map<_, _>>() })
        });
        parts.push(json!({
            "run": run,
            "name": planned.name(),
            "frames": frames.len(),
            "positions": positions,
            "ids": positions.iter().map(|&position| &*frames[position].id).collect::<Vec<_>>(),
            "lines": lines.collect::<Vec<_>>(),
        }));
    }
    parts.into()
}

/// The stage runs with pictures: their maps and frames.
pub(super) fn pictures(
    recording: &Recording,
    estimates: &[Estimate],
    shown: &[usize],
    series: &[Series],
    pictures: &Pictures,
) -> Json {
    let place = |index: &usize| shown.iter().position(|known| known == index);
    let one = |((own, there), colours): ((&Series, &Vec<bool>), &Vec<ColourRange>)| {
        let colours = colours.iter().map(|range| (range.value_type.to_owned(), numbers(range.ends.map(Some))));
        let planned = &recording.plan().runs[own.run];
        let frames = recording.frames(own.run);
        let layers = own.layers.iter().zip(there).map(|(layer, there)| {
            json!({
                "name": layer.name,
                "role": layer.role.name(),
                "type": layer.value_type,
                "scale": Scale::for_type(&layer.value_type, pictures.steps()).map(Scale::json),
                "labels": layer.estimates.iter().map(|&index| label(&estimates[index], layer)).collect::<Vec<_>>(),
                "estimates": layer.estimates.iter().filter_map(place).collect::<Vec<_>>(),
                "truth": layer.truth,
                "there": there,
            })
        });
        let failed = |frame: &RecordedFrame| -> Vec<String> {
            let node = |node: Option<NodeId>| {
                node.and_then(|node| planned.nodes.get(node.0)).map_or("source", |node| &node.name)
            };
            frame.failures.iter().map(|failure| format!("{}: {}", node(failure.node), failure.what)).collect()
        };
        let shown = own.positions.iter().map(|&position| {
            let frame = &frames[position];
            let mut entry = json!({ "position": position, "id": &*frame.id });
            if !frame.failures.is_empty() {
                entry["failures"] = failed(frame).into();
            }
            entry
        });
        json!({
            "run": own.run,
            "name": planned.name(),
            "frames_in_all": frames.len(),
            "maps_in_all": own.recorded,
            "detailed": own.positions.iter().filter(|position| own.detailed.contains(position)).count(),
            "layers": layers.collect::<Vec<_>>(),
            "colours": colours.collect::<Map<_, _>>(),
            "frames": shown.collect::<Vec<_>>(),
        })
    };
    series.iter().zip(pictures.there()).zip(pictures.colour_ranges()).map(one).collect()
}

/// The label of an estimate, with a remark if it is shown aligned.
fn label(estimate: &Estimate, layer: &Layer) -> String {
    match &layer.aligned {
        Some(settings) => format!("{} (aligned: {})", estimate.title, settings.align.name()),
        None => estimate.title.clone(),
    }
}

/// Learning curves.
pub(super) fn curves(report: &ReportData) -> Json {
    let one = |curve: &crate::curves::LearningCurve| {
        let points = &curve.curve.points;
        json!({
            "label": curve.label,
            "step": points.iter().map(|point| point.step).collect::<Vec<_>>(),
            "loss": numbers(points.iter().map(|point| Some(point.loss))),
            "validation": numbers(points.iter().map(|point| point.validation)),
        })
    };
    report.curves.iter().map(one).collect()
}

/// The failures, frame by frame.
pub(super) fn failures(recording: &Recording) -> Json {
    let plan = recording.plan();
    let mut in_all = 0;
    let mut listed = Vec::new();
    for (run, planned) in RunId::enumerate(&plan.runs) {
        for (position, frame) in FrameIndex::enumerate(recording.frames(run)) {
            in_all += frame.failures.len();
            for failure in frame.failures.iter().take(MOST_FAILURES.saturating_sub(listed.len())) {
                let node = failure.node.and_then(|node| planned.nodes.get(node.0));
                listed.push(json!({
                    "stage": planned.name(), "position": position, "frame": &*frame.id,
                    "node": node.map_or("source", |node| &node.name), "what": failure.what,
                }));
            }
        }
    }
    json!({ "in_all": in_all, "listed": listed })
}

/// The timings of the run.
pub(super) fn timings(timings: &[Timing]) -> Json {
    let ms = |ns: u64| number(Some(ns as f64 / 1e6), DRAWN);
    let one = |timing: &Timing| {
        json!({
            "stage": timing.row_key.stage, "variant": timing.row_key.variant, "node": timing.node, "phase": timing.phase,
            "frames": timing.frames, "cpu_ms": ms(timing.cpu_ns), "wall_ms": ms(timing.wall_ns), "median_ms": timing.median_cpu_ns.map(ms),
        })
    };
    timings.iter().map(one).collect()
}

/// The information for reproducing the run: keys, and the parameters of all nodes.
pub(super) fn keys(plan: &RecordedPlan) -> Json {
    let row_keys = RowKeys::new(plan);
    let sources = plan.runs.iter().flat_map(|run| {
        run.source.parts.iter().map(|part| json!({ "stage": run.name(), "name": run.source.name, "kind": part.kind, "version": part.version, "params": part.params }))
    });
    let nodes = plan.runs.iter().flat_map(|run| {
        let row_keys = &row_keys;
        run.nodes.iter().map(move |node| {
            json!({
                "stage": run.stage, "variant": row_keys.for_variants(&run.stage, &node.variants).variant, "name": node.name, "kind": node.kind,
                "version": node.version, "node_hash": node.node_hash.to_string(), "params": node.params,
            })
        })
    });
    json!({
        "plan": plan_key(plan).to_string(),
        "variants": plan.variants.len(),
        "sources": sources.take(MOST_NODES).collect::<Vec<_>>(),
        "nodes": nodes.take(MOST_NODES).collect::<Vec<_>>(),
        "nodes_in_all": plan.runs.iter().map(|run| run.nodes.len()).sum::<usize>(),
        "runs": plan.runs.iter().map(|run| json!({ "stage": run.stage, "variant": variant_of(plan, &run.variants) })).collect::<Vec<_>>(),
    })
}
