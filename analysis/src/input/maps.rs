//! Notes on maps that were not recorded, without which there is no error against distance.

use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::RunId;
use depthloom_recording::{RecordedPlan, Recording};

use crate::estimates::Estimate;

/// A note on the estimates without recorded maps or ground truth, if any, and the outputs to add to `record:`. `what`
/// is the result that is missing because of that.
pub(crate) fn not_recorded(plan: &RecordedPlan, estimates: &[&Estimate], what: &str) -> Option<String> {
    missing_maps(plan, estimates, what, ["was", "were"])
}

/// As [`not_recorded`], for a run that has not started.
pub(crate) fn not_to_be_recorded(plan: &RecordedPlan, estimates: &[&Estimate], what: &str) -> Option<String> {
    missing_maps(plan, estimates, what, ["is", "are"])
}

fn missing_maps(plan: &RecordedPlan, estimates: &[&Estimate], what: &str, verbs: [&str; 2]) -> Option<String> {
    let (mut truths, mut maps, mut labels) = (Vec::new(), Vec::new(), Vec::new());
    for estimate in estimates {
        let name = |from: &Option<String>| from.as_deref().map(|topic| reference(plan, estimate.run, topic));
        if estimate.truth_topic.is_none() {
            truths.push(name(&estimate.truth_output));
        }
        if estimate.estimate_topic.is_none() {
            maps.push(name(&estimate.scored_output));
        }
        if estimate.truth_topic.is_none() || estimate.estimate_topic.is_none() {
            labels.push(estimate.label.clone());
        }
    }
    let several = count(&mut truths) + count(&mut maps) > 1;
    let missing: Vec<String> =
        [named("ground truth", &truths), named("estimate", &maps)].into_iter().flatten().collect();
    if missing.is_empty() {
        return None;
    }
    let whose = if labels.len() == estimates.len() { String::new() } else { format!(" of {}", some(&labels)) };
    let (verb, them) = if several { (verbs[1], "them") } else { (verbs[0], "it") };
    let missing = missing.join(" and ");
    Some(format!("{what}{whose}: {missing} {verb} not recorded: add {them} to `record:`"))
}

/// An output as `record:` takes it: `stage.node/port`.
fn reference(plan: &RecordedPlan, run: RunId, topic: &str) -> String {
    let planned = &plan.runs[run];
    let (node, output) = match plan.find(run, topic) {
        Some((Slot::Source { .. }, output)) => ("source", output),
        Some((Slot::Node { node, .. }, output)) => (planned.nodes[node].name.as_str(), output),
        None => return topic.to_owned(),
    };
    format!("{}.{node}/{}", planned.stage, output.port)
}

/// Removes duplicates and returns the number of distinct names.
fn count(names: &mut Vec<Option<String>>) -> usize {
    names.sort();
    names.dedup();
    names.len()
}

/// `the ground truth`, ``the ground truth `a` ``, ``the estimates `a`, `b` ``.
fn named(what: &str, names: &[Option<String>]) -> Option<String> {
    let s = if names.len() > 1 && what == "estimate" { "s" } else { "" };
    let known: Vec<String> = names.iter().flatten().map(|name| format!("`{name}`")).collect();
    (!names.is_empty()).then(|| format!("the {what}{s} {}", some(&known)).trim_end().to_owned())
}

/// A list of names, shortened if it is long.
fn some(names: &[String]) -> String {
    const SHOWN: usize = 6;
    match names.len() {
        ..=SHOWN => names.join(", "),
        all => format!("{} and {} more", names[..SHOWN].join(", "), all - SHOWN),
    }
}

/// A note if maps were recorded only on some frames, or if no frame has a pixel to compare. No note if no maps were to
/// be recorded.
pub(crate) fn sparsely_kept(recording: &Recording, estimates: &[&Estimate], none: bool) -> Option<String> {
    let every = recording.plan().every;
    if !none {
        let note = |ordinal: String| {
            format!("error against distance covers only every {ordinal} frame, because only their maps were recorded")
        };
        return (every > 1).then(|| note(ordinal(every)));
    }
    let mut with_maps = estimates.iter().filter(|e| e.estimate_topic.is_some() && e.truth_topic.is_some());
    let frames = match every {
        0 | 1 => "no frame has".to_owned(),
        every => format!("only every {} frame has recorded maps, and none of these has", ordinal(every)),
    };
    let note = || format!("no error against distance: {frames} a valid pixel with ground truth");
    with_maps.any(|estimate| !recording.frames(estimate.run).is_empty()).then(note)
}

/// `2nd`, `3rd`, `11th`.
fn ordinal(number: u64) -> String {
    let ending = match (number % 100, number % 10) {
        (11..=13, _) => "th",
        (_, 1) => "st",
        (_, 2) => "nd",
        (_, 3) => "rd",
        _ => "th",
    };
    format!("{number}{ending}")
}
