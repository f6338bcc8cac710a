//! `depthloom check --data`: what is wrong with the data of an experiment, all of it in one pass, before an hour is
//! computed on them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Mutex;

use depthloom_datasets::inspection::inspect;
use depthloom_graphs::contracts::{Fact, Slot, Survey};
use depthloom_graphs::plan::{FrameIndex, Origin, Plan, PlannedInput, SourcePart, StageRun};
use depthloom_graphs::registry::SourceEntry;
use depthloom_graphs::{Context, ErrorMessage, Fault, Frame, Port, Registry, Scratch, Source, Value, counted};
use depthloom_nodes::needs_baseline;
use depthloom_terminal::{CliError, ExitCode, Problem};
use depthloom_threads::{Budget, in_order, into_unlocked, locked};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value as Json;

use crate::output::frame_progress::FrameProgress;
use crate::output::warnings::WarningCollector;
use crate::truths;

pub(crate) struct Walked {
    /// Its name under `sources:`.
    pub name: String,
    pub kind: String,
    pub frames: usize,
    pub faults: Vec<FrameFault>,
    /// What there is to show of the data beside their frames.
    pub facts: Vec<Fact>,
    pub warnings: Vec<String>,
    counts: Counts,
}

/// The numbers of frames that were read.
#[derive(Default)]
struct Counts {
    /// All of them.
    read: usize,
    /// Those with a value of each output port.
    with: BTreeMap<&'static str, usize>,
    /// Those whose calibration has no baseline.
    single_camera: usize,
}

pub(crate) struct FrameFault {
    /// The frame's id; `None` for a fault of the whole source.
    frame: Option<String>,
    what: String,
    remedy: Option<String>,
    /// The check that found it, if values contradict each other. Two frames with the same fault may have different
    /// messages, which name different files.
    kind: Option<(&'static str, &'static str)>,
}

impl FrameFault {
    fn new(frame: Option<&Frame>, fault: &Fault) -> Self {
        Self {
            frame: frame.map(|frame| frame.id.to_string()),
            what: fault.chain(),
            remedy: fault.remedy_text().map(ToOwned::to_owned),
            kind: None,
        }
    }
}

/// Walks every source of a plan, each once, whichever stages take it.
pub(crate) fn walk(plan: &Plan, registry: &Registry, workers: usize, quiet: bool) -> Vec<Walked> {
    let mut known: Vec<&SourcePart> = Vec::new();
    let mut walked = Vec::new();
    for run in &plan.runs {
        for part in &run.source.parts {
            if known.iter().any(|other| is_same(other, part)) {
                continue;
            }
            if let Some(entry) = registry.source_kind(&part.kind) {
                known.push(part);
                walked.push(one(&run.source.name, entry, &part.params, workers, quiet));
            }
        }
    }
    for run in &plan.runs {
        let parts = run.source.parts.iter().filter_map(|part| known.iter().position(|other| is_same(other, part)));
        let parts: Vec<usize> = parts.collect();
        lacks_truth(run, &parts, &mut walked);
        lacks_baseline(run, &parts, &mut walked);
    }
    walked
}

fn is_same(one: &SourcePart, other: &SourcePart) -> bool {
    one.kind == other.kind && one.params == other.params
}

/// Adds a fault to sources that have no ground truth for the metrics of a stage.
fn lacks_truth(run: &StageRun, parts: &[usize], walked: &mut [Walked]) {
    for port in truths::of_source(run) {
        let with = |source: &Walked| source.counts.with.get(port).copied().unwrap_or(0);
        let of_all: usize = parts.iter().map(|at| with(&walked[*at])).sum();
        for at in parts {
            let source = &mut walked[*at];
            let (there, read, stage) = (with(source), source.counts.read, &run.stage);
            // If the source could not be opened, the missing file may be the reason.
            let is_open = source
                .faults
                .iter()
                .all(|fault| fault.frame.is_some() || fault.remedy.as_deref() == Some(truths::REMEDY));
            if read > 0 && of_all == 0 && is_open {
                let what = format!("no frame has a `{port}`, against which stage `{stage}` scores");
                if !source.faults.iter().any(|fault| fault.what == what) {
                    source.faults.push(FrameFault {
                        frame: None,
                        what,
                        remedy: Some(truths::REMEDY.to_owned()),
                        kind: None,
                    });
                }
            } else if there < read && is_open {
                let (without, read) = (read - there, counted(read, "frame"));
                let what = format!(
                    "{without} of {read} have no `{port}`, against which stage `{stage}` scores: they are in no mean"
                );
                if !source.warnings.contains(&what) {
                    source.warnings.push(what);
                }
            }
        }
    }
}

/// Adds a fault to sources without a baseline that a node of a stage needs.
fn lacks_baseline(run: &StageRun, parts: &[usize], walked: &mut [Walked]) {
    let is_of_source = |input: &PlannedInput| {
        input.port.name == "calibration" && matches!(input.from, Some(Origin::Here(Slot::Source { .. })))
    };
    let nodes = run.nodes.iter().filter(|node| needs_baseline(&node.kind) && node.inputs.iter().any(is_of_source));
    for node in nodes {
        for at in parts {
            let source = &mut walked[*at];
            let what = format!(
                "its `calibration` is that of a single camera, and node `{}.{}` ({}) needs a baseline",
                run.stage, node.name, node.kind
            );
            if source.counts.single_camera > 0 && !source.faults.iter().any(|fault| fault.what == what) {
                let remedy = Some("set `baseline_m` in the calibration of the source, or use depths".to_owned());
                source.faults.push(FrameFault { frame: None, what, remedy, kind: None });
            }
        }
    }
}

fn one(name: &str, entry: &SourceEntry, params: &Json, workers: usize, quiet: bool) -> Walked {
    let Survey { source, faults, facts } = entry.survey(params);
    let mut faults: Vec<FrameFault> = faults.iter().map(|fault| FrameFault::new(None, fault)).collect();
    let ports = entry.outputs(params).unwrap_or_else(|fault| {
        faults.push(FrameFault::new(None, &fault));
        Vec::new()
    });
    let (mut frames, mut warnings) = (0, Vec::new());
    let there = There::default();
    if let Some(source) = source {
        frames = source.frames().len();
        warnings = source.warnings().to_vec();
        let collected = WarningCollector::default();
        let of_frames = each_frame(
            &*source,
            &ports,
            workers,
            (&collected, &there),
            &FrameProgress::new(name, frames as u64, quiet),
        );
        faults.extend(of_frames);
        warnings.extend(collected.into_warnings());
    }
    Walked {
        name: name.to_owned(),
        kind: entry.declaration.kind.to_owned(),
        frames,
        faults,
        facts,
        warnings,
        counts: into_unlocked(there.0),
    }
}

/// The counts of frames, from several threads.
#[derive(Default)]
struct There(Mutex<Counts>);

impl There {
    fn count(&self, ports: &[Port], values: &[Option<Value>]) {
        let mut counts = locked(&self.0);
        counts.read += 1;
        let is_single =
            |value: &Value| matches!(value, Value::Calibration(calibration) if calibration.is_single_camera());
        counts.single_camera += usize::from(values.iter().flatten().any(is_single));
        for (port, _) in ports.iter().zip(values).filter(|(_, value)| value.is_some()) {
            *counts.with.entry(port.name).or_default() += 1;
        }
    }
}

/// What is wrong with the frames, in their order, whichever thread looked at which.
fn each_frame(
    source: &dyn Source,
    ports: &[Port],
    workers: usize,
    seen: (&WarningCollector, &There),
    progress: &FrameProgress,
) -> Vec<FrameFault> {
    let frames = source.frames();
    let budget = Budget::new(workers);
    let _own = budget.permit();
    let found = in_order(&budget, frames.len(), |tile| {
        let position = FrameIndex(tile);
        let frame = &frames[position];
        let mut scratch = Scratch::default();
        let looked = || frame_faults(source, ports, position, frame, &mut Context::new(seen.0, &mut scratch), seen.1);
        let faults = depthloom_threads::caught(looked).unwrap_or_else(|panic| {
            vec![FrameFault::new(Some(frame), &Fault::new(format!("the source panicked {}", panic.0)))]
        });
        progress.one_more(faults.len() as u64);
        faults
    });
    found.into_iter().flatten().collect()
}

fn frame_faults(
    source: &dyn Source,
    ports: &[Port],
    position: FrameIndex,
    frame: &Frame,
    ctx: &mut Context<'_>,
    there: &There,
) -> Vec<FrameFault> {
    let read =
        source.examine(position, ctx).and_then(|read| read.outputs.in_order_of(ports).map_err(|fault| vec![fault]));
    let values = match read {
        Ok(values) => values,
        Err(faults) => return faults.iter().map(|fault| FrameFault::new(Some(frame), fault)).collect(),
    };
    there.count(ports, &values);
    let files = source.files(position);
    let contradictions = inspect(ports, &values).into_iter().map(|found| {
        let named = file_of(found.port, &files)
            .map_or_else(|| found.what.clone(), |path| format!("{}: {}", path.display(), found.what));
        FrameFault {
            frame: Some(frame.id.to_string()),
            what: named,
            remedy: Some(found.remedy.to_owned()),
            kind: Some((found.port, found.remedy)),
        }
    });
    contradictions.collect()
}

/// The file that a port's value was most probably read from: that of the part with its name, of a truth that which is
/// no image and no calibration.
pub(crate) fn file_of<'f>(port: &str, files: &'f [(&'static str, PathBuf)]) -> Option<&'f PathBuf> {
    let part = |name: &str| files.iter().find(|(part, _)| *part == name).map(|(_, path)| path);
    part(port)
        .or_else(|| {
            files.iter().find(|(part, _)| truths::is_of_truth(part) && port != "calibration").map(|(_, path)| path)
        })
        // A calibration of no file is written in the experiment.
        .or_else(|| part("left").filter(|_| port != "calibration"))
}

pub(crate) fn text(walked: &[Walked]) -> String {
    let line = |of: &Walked| {
        let frames = counted(of.frames, "frame");
        let faults = match of.faults.len() as u64 {
            0 => "nothing wrong".to_owned(),
            count => counted(count, "fault"),
        };
        let facts = of.facts.iter().map(|fact| format!("  {:12} {}\n", fact.label, fact.text)).collect::<String>();
        format!("source `{}` ({}): {frames}, {faults}\n{facts}", of.name, of.kind)
    };
    walked.iter().map(line).collect()
}

/// A source, every frame of which was read.
#[derive(JsonSchema, Serialize)]
pub(crate) struct CheckedSource {
    source: String,
    kind: String,
    frames: u64,
    faults: Vec<DataFault>,
    facts: Vec<DataFact>,
    warnings: Vec<String>,
}

impl From<&Walked> for CheckedSource {
    fn from(of: &Walked) -> Self {
        Self {
            source: of.name.clone(),
            kind: of.kind.clone(),
            frames: of.frames as u64,
            faults: of.faults.iter().map(DataFault::from).collect(),
            facts: of.facts.iter().map(DataFact::from).collect(),
            warnings: of.warnings.clone(),
        }
    }
}

/// What was found out of a source.
#[derive(JsonSchema, Serialize)]
pub(crate) struct DataFact {
    about: String,
    what: String,
}

impl From<&Fact> for DataFact {
    fn from(fact: &Fact) -> Self {
        Self { about: fact.label.to_owned(), what: fact.text.clone() }
    }
}

/// What is wrong with a frame, or with the source.
#[derive(JsonSchema, Serialize)]
pub(crate) struct DataFault {
    frame: Option<String>,
    message: String,
    help: Option<String>,
}

impl From<&FrameFault> for DataFault {
    fn from(fault: &FrameFault) -> Self {
        Self { frame: fault.frame.clone(), message: fault.what.clone(), help: fault.remedy.clone() }
    }
}

/// The error that lists every fault. Each remedy is printed once, and so is a fault that all frames share.
pub(crate) fn stop(walked: &[Walked]) -> Option<CliError> {
    let count: usize = walked.iter().map(|source| source.faults.len()).sum();
    if count == 0 {
        return None;
    }
    let mut remedies: BTreeSet<&str> = BTreeSet::new();
    let mut problems = Vec::new();
    for source in walked {
        let name = &source.name;
        for (fault, frames) in once(&source.faults, source.frames) {
            let what = match (&fault.frame, frames) {
                (Some(_), 2..) => format!("source `{name}`, all {frames} frames, the first: {}", fault.what),
                (Some(frame), _) => format!("source `{name}`, frame {frame}: {}", fault.what),
                (None, _) => format!("source `{name}`: {}", fault.what),
            };
            let remedy = fault.remedy.as_deref().filter(|remedy| remedies.insert(*remedy)).map(ToOwned::to_owned);
            problems.push(Problem::Here(ErrorMessage { what, remedy, source: None }));
        }
    }
    let what = format!("the data have {}", counted(count, "fault"));
    Some(CliError::new(ExitCode::Usage, what).problems(problems))
}

/// The faults in their order, each with the number of frames that have it: more than one is all of them.
fn once(faults: &[FrameFault], frames: usize) -> Vec<(&FrameFault, usize)> {
    let same = |one: &FrameFault, other: &FrameFault| match (one.kind, other.kind) {
        (Some(one), Some(other)) => one == other,
        _ => one.what == other.what && one.kind == other.kind,
    };
    let mut listed: Vec<(&FrameFault, usize)> = Vec::new();
    // If all frames have a fault, the first one has it.
    let first = faults.iter().find_map(|fault| fault.frame.as_ref());
    let shared: Vec<&FrameFault> = faults
        .iter()
        .filter(|fault| frames > 1 && fault.frame.is_some() && fault.frame.as_ref() == first)
        .filter(|fault| {
            let with: BTreeSet<&String> =
                faults.iter().filter(|other| same(other, fault)).filter_map(|other| other.frame.as_ref()).collect();
            with.len() == frames
        })
        .collect();
    for fault in faults {
        let of_all = fault.frame.is_some() && shared.iter().any(|other| same(other, fault));
        match (of_all, shared.iter().any(|other| std::ptr::eq(*other, fault))) {
            (true, true) => listed.push((fault, frames)),
            (true, false) => {}
            (false, _) => listed.push((fault, 1)),
        }
    }
    listed
}
