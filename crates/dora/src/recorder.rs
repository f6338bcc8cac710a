//! The recorder: runs the whole plan, with remote sources and nodes that return what their parts sent.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use depthloom_graphs::contracts::{AggregateNode, Contract, Failure, OrderedNode, PureNode};
use depthloom_graphs::plan::{FrameIndex, NodeId, NodeRef, Plan, PlannedOutput, RunId};
use depthloom_graphs::ready::{Ready, ReadyRun, read_files};
use depthloom_graphs::values::{
    Artifact, Calibration, Curve, Depth, Disparity, Image, Mask, Number, Pixels, Raster, RelativeInverseDepth,
    TrueDisparity, Weight,
};
use depthloom_graphs::{
    Context, ErrorMessage, Fault, Frame, Inputs, Instance, Key, Outputs, Rate, Source, SourceOutputs, Value, ValueType,
};
use depthloom_runner::{Interrupt, Observer};
use depthloom_terminal::{CliError, ExitCode};
use image::GrayImage;

use crate::bridge::Bridge;
use crate::channel;
use crate::layout::{Layout, Role, admission};
use crate::message::of_text;
use crate::report::{self, Readiness, Report, engines_text, frames};

/// Waits until every part can start, and makes a plan of them for the runner.
///
/// # Errors
/// All that is missing on the machines of the parts.
pub fn prepare(
    plan: Plan,
    layout: &Layout,
    bridge: &Arc<Bridge>,
    interrupt: &Interrupt,
    limit: Duration,
) -> Result<(Ready, Remote), CliError> {
    let gone = |fault: Fault| match fault {
        Fault::Cancelled => CliError::new(ExitCode::Interrupted, "interrupted"),
        fault @ Fault::Failed(_) => CliError::from_error(ExitCode::Usage, &fault),
    };
    let cancelled = || interrupt.stops_admission();
    let receive = |id: &str, output: &str| {
        bridge.mailbox.take(&format!("{id}/{output}"), None, &cancelled).map_err(|why| gone(why.into()))
    };
    wait_for_start(layout, bridge, &cancelled, limit)?;
    let (mut missing, mut prints) = (Vec::new(), BTreeMap::new());
    let mut warnings = vec![Vec::new(); plan.runs.len()];
    for part in &layout.parts {
        if !matches!(part.role, Role::Source { .. } | Role::Node(_)) {
            continue;
        }
        let readiness: Readiness = report::read(&receive(&part.id, channel::READY)?).map_err(gone)?;
        missing.extend(readiness.missing);
        match part.role {
            Role::Source { run } => warnings[run] = readiness.warnings,
            Role::Node(node) => prints.extend(readiness.fingerprint.map(|print| (node, print))),
            Role::Foreign(_) | Role::Recorder => {}
        }
    }
    let mut files = BTreeMap::new();
    let mut unread = Vec::new();
    for run in &plan.runs {
        unread.extend(run.nodes.iter().flat_map(|node| read_files(&run.stage, node, &mut files)));
    }
    if !missing.is_empty() {
        let message = |(what, remedy)| ErrorMessage { what, remedy, source: None };
        return Err(CliError::missing(missing.into_iter().map(message).collect()));
    }
    if !unread.is_empty() {
        return Err(CliError::of_missing(&unread));
    }
    bridge.send(channel::ENGINES, None, &of_text(&engines_text(&prints))).map_err(gone)?;
    let mut runs = Vec::new();
    let mut inputs = vec![Vec::new(); plan.runs.len()];
    for ((run, planned), warnings) in RunId::enumerate(&plan.runs).zip(warnings) {
        let remote = |role, outputs: &[PlannedOutput]| RemoteNode {
            id: layout.id(role).to_owned(),
            outputs: outputs.to_vec(),
            bridge: Arc::clone(bridge),
        };
        let source = remote(Role::Source { run }, &planned.source.outputs);
        let frames = frames(&receive(&source.id, channel::FRAMES)?).map_err(gone)?;
        inputs[run].extend(source.inputs());
        let reports = frames.iter().map(|_| OnceLock::new()).collect();
        let mut nodes = Vec::new();
        for (node, planned) in NodeId::enumerate(&planned.nodes) {
            let remote = remote(Role::Node(NodeRef { run, node }), &planned.outputs);
            inputs[run].extend(remote.inputs());
            nodes.push(match planned.contract {
                Contract::Pure => Instance::Pure(Box::new(remote)),
                Contract::Ordered => Instance::Ordered(Box::new(remote)),
                Contract::Once => Instance::Once(Box::new(remote)),
            });
        }
        let interrupt = interrupt.clone();
        runs.push(ReadyRun {
            source: Box::new(RemoteSource { node: source, frames, warnings, reports, interrupt }),
            nodes,
        });
    }
    let remote = Remote {
        bridge: Arc::clone(bridge),
        inputs,
        retired: plan.runs.iter().map(|_| AtomicUsize::new(0)).collect(),
        window: 0,
    };
    Ok((Ready::from_parts(plan, runs, files, &prints), remote))
}

/// Waits until every part has reported whether it can start.
///
/// # Errors
/// The parts that have not within `limit`.
fn wait_for_start(
    layout: &Layout,
    bridge: &Bridge,
    cancelled: &dyn Fn() -> bool,
    limit: Duration,
) -> Result<(), CliError> {
    let parts = layout.parts.iter().filter(|part| matches!(part.role, Role::Source { .. } | Role::Node(_)));
    let inputs: Vec<String> = parts.map(|part| format!("{}/{}", part.id, channel::READY)).collect();
    let missing = bridge.mailbox.without_message(&inputs, Instant::now() + limit, cancelled);
    if missing.is_empty() {
        return Ok(());
    }
    let suffix = format!("/{}", channel::READY);
    let names: Vec<String> = missing.iter().map(|input| format!("`{}`", input.trim_end_matches(&suffix))).collect();
    let what = format!("not started within {} s: {} of the dataflow", limit.as_secs(), names.join(", "));
    Err(CliError::new(ExitCode::Engine, what).remedy(
        "their logs may say why (`dora logs`); run the dataflow again, or allow its nodes more time: `depthloom dora --start-timeout SECONDS`",
    ))
}

/// A part, as the recorder sees it.
struct RemoteNode {
    id: String,
    outputs: Vec<PlannedOutput>,
    bridge: Arc<Bridge>,
}

impl RemoteNode {
    /// The recorder's inputs that have frames.
    fn inputs(&self) -> Vec<String> {
        let values = self.outputs.iter().map(|output| output.port.name);
        [channel::REPORT].into_iter().chain(values).map(|output| format!("{}/{output}", self.id)).collect()
    }

    fn report(&self, at: Option<FrameIndex>, cancelled: &dyn Fn() -> bool) -> Result<Report, Fault> {
        let arrived = self.bridge.mailbox.take(&format!("{}/{}", self.id, channel::REPORT), at, cancelled)?;
        report::read(&arrived)
    }

    /// Its values at outputs of this rate. A value that is not recorded is only a placeholder.
    fn outputs(
        &self,
        report: &Report,
        rate: Rate,
        at: Option<FrameIndex>,
        ctx: &Context<'_>,
    ) -> Result<Outputs, Fault> {
        for (what, count) in &report.warnings {
            ctx.host.warn_n(*count, what);
        }
        if let Some((what, remedy)) = &report.failed {
            return Err(failure(what, remedy.as_deref()));
        }
        let mut outputs = Outputs::none();
        for output in self.outputs.iter().filter(|output| output.port.rate == rate) {
            let port = &output.port;
            if report.absent.iter().any(|absent| absent == port.name) {
                continue;
            }
            if !output.recorded && rate == Rate::Frame {
                outputs = outputs.with(port.name, placeholder(port.value_type));
                continue;
            }
            let input = format!("{}/{}", self.id, port.name);
            let arrived = self.bridge.mailbox.take(&input, at, &|| ctx.host.cancelled())?;
            if let Some(value) = arrived.value(port.value_type)? {
                outputs = outputs.with(port.name, value);
            }
        }
        Ok(outputs)
    }

    fn of_frame(&self, ctx: &Context<'_>) -> Result<Outputs, Fault> {
        let position = ctx.host.position().ok_or_else(|| Fault::new("it runs without a frame"))?;
        let report = self.report(Some(position), &|| ctx.host.cancelled())?;
        self.outputs(&report, Rate::Frame, Some(position), ctx)
    }

    fn of_aggregate(&self, ctx: &Context<'_>) -> Result<Outputs, Fault> {
        if self.outputs.iter().all(|output| output.port.rate == Rate::Frame) {
            return Ok(Outputs::none());
        }
        let report = self.report(None, &|| ctx.host.cancelled())?;
        self.outputs(&report, Rate::Once, None, ctx)
    }
}

fn failure(what: &str, remedy: Option<&str>) -> Fault {
    let fault = Fault::new(what);
    match remedy {
        Some(remedy) => fault.remedy(remedy),
        None => fault,
    }
}

impl PureNode for RemoteNode {
    fn process(&self, _: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.of_frame(ctx)
    }
}

impl OrderedNode for RemoteNode {
    fn process(&mut self, _: &Frame, _: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.of_frame(ctx)
    }

    fn finish(self: Box<Self>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.of_aggregate(ctx)
    }
}

impl AggregateNode for RemoteNode {
    fn run(&self, _: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.of_aggregate(ctx)
    }
}

struct RemoteSource {
    node: RemoteNode,
    frames: Vec<Frame>,
    warnings: Vec<String>,
    /// By frame, the report of the part.
    reports: Vec<OnceLock<Report>>,
    interrupt: Interrupt,
}

impl Source for RemoteSource {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        if self.reports[position].get().is_none() {
            let report = self.node.report(Some(position), &|| self.interrupt.aborts())?;
            let _ = self.reports[position].set(report);
        }
        // A frame that failed has no key, and is not read: the failure is reported here.
        let Some(Report { key, failed, .. }) = self.reports[position].get() else { return Err(Fault::Cancelled) };
        match (key, failed) {
            (_, Some((what, remedy))) => Err(failure(what, remedy.as_deref())),
            (Some(key), None) => Ok(*key),
            (None, None) => Err(Fault::new(format!("`{}` named no key", self.node.id))),
        }
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let report = self.reports[position].get().ok_or_else(|| Fault::new("it is read before its key is known"))?;
        let outputs = self.node.outputs(report, Rate::Frame, Some(position), ctx)?;
        let key = report.key.ok_or_else(|| Fault::new(format!("`{}` named no key", self.node.id)))?;
        Ok(SourceOutputs { outputs, key })
    }
}

/// Tells the parts how far the recording is.
pub struct Remote {
    bridge: Arc<Bridge>,
    /// The recorder's inputs of a stage run's frames.
    inputs: Vec<Vec<String>>,
    retired: Vec<AtomicUsize>,
    /// The most frames in flight.
    pub window: usize,
}

impl Remote {
    fn admit(&self, run: RunId, retired: usize) {
        // If the source has ended, its missing frames are reported.
        let _ = self.bridge.send(&admission(run), None, &of_text(&(retired + self.window).to_string()));
    }
}

impl Observer for Remote {
    fn stage_started(&self, run: RunId, _: u64) {
        self.admit(run, 0);
    }

    fn frame_retired(&self, run: RunId, _: &Frame, _: &[Failure]) {
        let retired = self.retired[run].fetch_add(1, Ordering::SeqCst) + 1;
        self.bridge.mailbox.forget(&self.inputs[run], FrameIndex(retired - 1));
        self.admit(run, retired);
    }
}

/// A value for an output that is not recorded.
fn placeholder(value_type: ValueType) -> Value {
    fn one<T>() -> Raster<T>
    where
        image::Luma<T>: image::Pixel<Subpixel = T>,
        T: image::Primitive,
    {
        Raster::new(1, 1)
    }
    match value_type {
        ValueType::Image => Image::new(Pixels::Grey(GrayImage::new(1, 1))).into(),
        ValueType::Disparity => Disparity { sixteenths_px: one(), min_disparity_px: 0 }.into(),
        ValueType::TrueDisparity => TrueDisparity { px: one() }.into(),
        ValueType::Depth => Depth { metres: one() }.into(),
        ValueType::RelativeInverseDepth => RelativeInverseDepth { values: one() }.into(),
        ValueType::Weight => Weight { share: one() }.into(),
        ValueType::Mask => Mask { set: one() }.into(),
        ValueType::Calibration => {
            let (width, height, focal_px, cx_px, cy_px, baseline_m, doffs_px) = (1, 1, 1.0, 0.0, 0.0, 1.0, 0.0);
            Calibration { width, height, focal_px, cx_px, cy_px, baseline_m, doffs_px }.into()
        }
        ValueType::Scores => Value::Scores(Arc::default()),
        ValueType::Samples => Value::Samples(Arc::new(Artifact::samples(Vec::new()))),
        ValueType::Model => Value::Model(Arc::new(Artifact::model(Vec::new()))),
        ValueType::Reliability => Value::Reliability(Arc::new(Artifact::reliability(String::new()))),
        ValueType::Curve => Curve::default().into(),
        ValueType::Number => Number { value: 0.0 }.into(),
    }
}
