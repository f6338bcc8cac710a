//! What the page knows: one JSON object, from which its script makes tables and figures.

use depthloom_graphs::plan::{FrameIndex, NodeId, RunId};
use std::collections::{BTreeMap, BTreeSet, HashMap};

use depthloom_figures::colour_of;
use depthloom_figures::page::{Layer, Pictures, Scale, Series};
use depthloom_recording::{RecordedFrame, RecordedPlan, Recording};
use depthloom_scores::PixelSet;
use serde_json::{Map, Value as Json, json};

use super::choice;
use crate::ablation::{Ablation, ScoreTable, Selection, effects_table, paper_number, zones_table};
use crate::distance::{DistanceBin, Spread};
use crate::error::AnalysisError;
use crate::estimates::Estimate;
use crate::input::paper::paper_scores;
use crate::input::timings::Timing;
use crate::report::Found;
use crate::scores::FrameScore;
use crate::tables::{RowKeys, plan_key, variant_of};

/// So many failures are told one by one.
const MOST_FAILURES: usize = 200;
/// So many nodes of a plan stand in the list of keys.
const MOST_NODES: usize = 400;
/// The score that tables of effects and zones are of: the first of these that was taken.
const LEADING: [&str; 3] = ["abs_rel", "d1", "epe"];
/// Significant digits of what is drawn and of what stands in the table.
const DRAWN: usize = 5;
const TABLED: usize = 7;

/// A number with some significant digits; null where there is none.
fn number(number: Option<f64>, digits: usize) -> Json {
    let number = number.filter(|number| number.is_finite());
    number.map_or(Json::Null, |number| format!("{number:.*e}", digits - 1).parse::<f64>().unwrap_or(number).into())
}

fn numbers(all: impl IntoIterator<Item = Option<f64>>) -> Json {
    all.into_iter().map(|one| number(one, DRAWN)).collect()
}

/// The table: its scores, and a row an estimate and pixel set.
pub(super) fn table(table: &ScoreTable, estimates: &[Estimate]) -> Json {
    let by_label: HashMap<&str, &Estimate> = estimates.iter().map(|of| (of.label.as_str(), of)).collect();
    let names = names(estimates);
    let metrics = table.metrics.iter().map(|metric| {
        json!({
            "name": metric.name, "plain": metric.plain, "unit": metric.unit, "more": metric.more_is_better,
            "decimals": metric.decimals, "formula": metric.formula, "source": metric.source,
        })
    });
    let rows = table.rows.iter().map(|row| {
        let paper = by_label.get(row.label.as_str()).and_then(|of| paper_scores(of, row.set));
        let papers = || table.metrics.iter().map(|metric| number(paper_number(paper, metric), TABLED)).collect::<Vec<_>>();
        json!({
            "stage": row.key.stage,
            "variant": row.key.variant,
            "estimate": row.estimate,
            "colour": colour_of(&names, &row.estimate),
            "set": row.set.name(),
            "factors": row.key.factors.iter().map(|level| &level.value).collect::<Vec<_>>(),
            "frames": row.frames,
            "density": number(row.density, TABLED),
            "means": row.values.iter().map(|value| number(*value, TABLED)).collect::<Vec<_>>(),
            "intervals": row.intervals.iter().map(|of| of.map(|of| [number(Some(of.low), TABLED), number(Some(of.high), TABLED)])).collect::<Vec<_>>(),
            "best": (0..table.metrics.len()).filter(|&metric| row.best[metric]).collect::<Vec<_>>(),
            "paper": paper.map(|_| papers()),
        })
    });
    let axes = table.rows.first().map(|row| row.key.factors.iter().map(|level| &level.axis).collect::<Vec<_>>());
    json!({
        "about": table.about(),
        "best": table.marks(),
        "axes": axes,
        "metrics": metrics.collect::<Vec<_>>(),
        "rows": rows.collect::<Vec<_>>(),
    })
}

/// The tables of `table --effects` and `table --best-per-zone`, each where the run has an answer.
pub(super) fn answers(ablation: &Ablation<'_>, table: &ScoreTable) -> Result<Vec<Json>, AnalysisError> {
    let named = |wanted: &&str| table.metrics.iter().any(|metric| metric.name == *wanted);
    let Some(metric) = LEADING.into_iter().find(named).or_else(|| table.metrics.first().map(|metric| metric.name))
    else {
        return Ok(Vec::new());
    };
    let all = Selection::default();
    let asked = [
        ("Effect of each axis", effects_table(ablation, &all, metric)),
        ("Best in each zone", zones_table(ablation, &all, metric)),
    ];
    let mut found = Vec::new();
    for (title, grid) in asked {
        match grid {
            Ok(grid) => found.push(json!({ "title": title, "table": grid.page() })),
            // A run without axes has no effects, and one without zones no best of them.
            Err(AnalysisError::Request { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(found)
}

/// Names as they first come: they choose the colours.
fn names(estimates: &[Estimate]) -> Vec<&str> {
    let mut known = BTreeSet::new();
    estimates.iter().map(|of| of.name.as_str()).filter(|name| known.insert(*name)).collect()
}

/// The estimates with curves; all else names them by their place here.
pub(super) fn estimates(estimates: &[Estimate], shown: &[usize]) -> Json {
    let names = names(estimates);
    let one = |&index: &usize| {
        let of = &estimates[index];
        json!({
            "label": of.label, "name": of.name, "stage": of.lead.stage, "variant": of.lead.variant, "run": of.run,
            "colour": colour_of(&names, &of.name), "preset": of.preset,
            "sets": of.sets.iter().map(|set| set.name()).collect::<Vec<_>>(),
            "set": choice::set_of(of).map(PixelSet::name),
            "metrics": of.metrics.iter().map(|metric| metric.name).collect::<Vec<_>>(),
        })
    };
    shown.iter().map(one).collect()
}

/// Error against distance: of each estimate shown the metres, and the spread on its valid pixels and on those valid in
/// all.
pub(super) fn distances(found: &Found, shown: &[usize]) -> Json {
    let of_one = |(place, index): (usize, &usize)| {
        let bins: Vec<&DistanceBin> = found.bins.iter().filter(|bin| bin.estimate == *index).collect();
        let spread = |of: &dyn Fn(&DistanceBin) -> Option<Spread>| {
            let percentile = |i: usize| numbers(bins.iter().map(|bin| of(bin).map(|spread| spread.percentiles_m[i])));
            json!({
                "count": bins.iter().map(|bin| of(bin).map_or(0, |spread| spread.count)).collect::<Vec<_>>(),
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
    let truth: Vec<(u32, u64)> = found.truth.iter().map(|(metre, count)| (*metre, *count)).collect();
    json!({ "estimates": shown.iter().enumerate().filter_map(of_one).collect::<Vec<_>>(), "truth": truth })
}

/// Scores by frame, a part a stage run.
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
        let positions = choice::points(frames.len(), &pictured.collect());
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
            let of = &estimates[shown[*estimate]];
            let values = of.metrics.iter().map(|metric| {
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

/// The stage runs with pictures: maps, and frames.
pub(super) fn pictures(
    recording: &Recording,
    estimates: &[Estimate],
    shown: &[usize],
    series: &[Series],
    pictures: &Pictures,
) -> Json {
    let place = |index: &usize| shown.iter().position(|of| of == index);
    let one = |(of, there): (&Series, &Vec<bool>)| {
        let planned = &recording.plan().runs[of.run];
        let frames = recording.frames(of.run);
        let layers = of.layers.iter().zip(there).map(|(layer, there)| {
            json!({
                "name": layer.name,
                "role": layer.role.name(),
                "type": layer.value_type,
                "scale": Scale::of(&layer.value_type, pictures.steps()).map(Scale::json),
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
        let shown = of.positions.iter().map(|&position| {
            let frame = &frames[position];
            let mut told = json!({ "position": position, "id": &*frame.id });
            if !frame.failures.is_empty() {
                told["failures"] = failed(frame).into();
            }
            told
        });
        json!({
            "run": of.run,
            "name": planned.name(),
            "frames_in_all": frames.len(),
            "maps_in_all": of.recorded,
            "layers": layers.collect::<Vec<_>>(),
            "frames": shown.collect::<Vec<_>>(),
        })
    };
    series.iter().zip(pictures.there()).map(one).collect()
}

/// What an estimate is called, and that it is shown aligned.
fn label(estimate: &Estimate, layer: &Layer) -> String {
    match &layer.aligned {
        Some(settings) => format!("{} (aligned: {})", estimate.label, settings.align.name()),
        None => estimate.label.clone(),
    }
}

/// Learning curves.
pub(super) fn curves(found: &Found) -> Json {
    let one = |curve: &crate::curves::LearningCurve| {
        let points = &curve.curve.points;
        json!({
            "label": curve.label,
            "step": points.iter().map(|point| point.step).collect::<Vec<_>>(),
            "loss": numbers(points.iter().map(|point| Some(point.loss))),
            "validation": numbers(points.iter().map(|point| point.validation)),
        })
    };
    found.curves.iter().map(one).collect()
}

/// What failed, frame by frame.
pub(super) fn failures(recording: &Recording) -> Json {
    let plan = recording.plan();
    let mut in_all = 0;
    let mut told = Vec::new();
    for (run, planned) in RunId::enumerate(&plan.runs) {
        for (position, frame) in FrameIndex::enumerate(recording.frames(run)) {
            in_all += frame.failures.len();
            for failure in frame.failures.iter().take(MOST_FAILURES.saturating_sub(told.len())) {
                let node = failure.node.and_then(|node| planned.nodes.get(node.0));
                told.push(json!({
                    "stage": planned.name(), "position": position, "frame": &*frame.id,
                    "node": node.map_or("source", |node| &node.name), "what": failure.what,
                }));
            }
        }
    }
    json!({ "in_all": in_all, "told": told })
}

/// Where the time went.
pub(super) fn timings(timings: &[Timing]) -> Json {
    let ms = |ns: u64| number(Some(ns as f64 / 1e6), DRAWN);
    let one = |timing: &Timing| {
        json!({
            "stage": timing.lead.stage, "variant": timing.lead.variant, "node": timing.node, "phase": timing.phase,
            "frames": timing.frames, "cpu_ms": ms(timing.cpu_ns), "wall_ms": ms(timing.wall_ns), "median_ms": timing.median_cpu_ns.map(ms),
        })
    };
    timings.iter().map(one).collect()
}

/// What it takes to make the run again: keys, and what every node was given.
pub(super) fn keys(plan: &RecordedPlan) -> Json {
    let leads = RowKeys::new(plan);
    let sources = plan.runs.iter().flat_map(|run| {
        run.source.parts.iter().map(|part| json!({ "stage": run.name(), "name": run.source.name, "kind": part.kind, "version": part.version, "params": part.params }))
    });
    let nodes = plan.runs.iter().flat_map(|run| {
        let leads = &leads;
        run.nodes.iter().map(move |node| {
            json!({
                "stage": run.stage, "variant": leads.of_those(&run.stage, &node.variants).variant, "name": node.name, "kind": node.kind,
                "version": node.version, "recipe": node.recipe.to_string(), "params": node.params,
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
