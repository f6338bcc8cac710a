//! A part that reads frames, or is a node: the runner over its piece of the plan, whose source is what comes and whose tap is what goes.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use depthloom_graphs::contracts::{Commit, Contract, OnceNode, PureNode, Slot, Tap, TapError, Warned};
use depthloom_graphs::plan::{Origin, Plan, PlannedInput, PlannedNode, PlannedOutput, PlannedSource, Record, StageRun};
use depthloom_graphs::ready::{self, NotReady, Ready, ReadyRun};
use depthloom_graphs::{
    Context, Fault, Frame, Inputs, Instance, Key, Outputs, Port, Rate, Registry, Source, SourceOutputs, Value,
};
use depthloom_nodes::dora::KIND;
use depthloom_runner::{Interrupt, Observer, Options, RunError};

use super::bridge::Bridge;
use super::channel;
use super::foreign;
use super::layout::{Part, Role};
use super::mailbox::Gone;
use super::message::{of_text, of_value};
use super::report::{Readiness, Report, engines, frames, frames_text};
use crate::exit::{Exit, Stop, chain};
use crate::streams::say;

/// Runs a part until the run is over. What it fails of, the recorder is told, and tells.
pub fn run(
    part: &Part,
    plan: &Plan,
    registry: &Registry,
    bridge: &Arc<Bridge>,
    options: &Options,
    interrupt: &Interrupt,
) -> Result<Exit, Stop> {
    let gone = |fault: Fault| Stop::new(Exit::Engine, fault.chain());
    let made = match part.role {
        Role::Source { run } => source_piece(plan, run, registry),
        Role::Node { run, node } => node_piece(plan, (run, node), part, registry, bridge, interrupt),
        Role::Foreign { .. } | Role::Recorder => return Err(Stop::new(Exit::Before, "this is no part of the plan")),
    };
    let piece = match made {
        Ok(piece) => piece,
        Err(missing) => {
            let told = |error: &NotReady| (chain(error), error.fault().remedy_text().map(str::to_owned));
            let readiness = Readiness { missing: missing.iter().map(told).collect(), ..Readiness::default() };
            bridge.send(channel::READY, None, &of_text(&readiness.text())).map_err(gone)?;
            bridge.mailbox.wait_for_the_end();
            return Ok(Exit::Before);
        }
    };
    let whole = plan;
    let Piece { mut plan, source, nodes, files, readiness, remedies } = piece;
    bridge.send(channel::READY, None, &of_text(&readiness.text())).map_err(gone)?;
    let source: Box<dyn Source> = match source {
        Comes::Read(source) => {
            let told = frames_text(source.frames());
            bridge.send(channel::FRAMES, None, &of_text(&told)).map_err(gone)?;
            let (bridge, interrupt, remedies) = (Arc::clone(bridge), interrupt.clone(), Arc::clone(&remedies));
            Box::new(Admitted { source, bridge, so_far: Mutex::new(0), interrupt, remedies })
        }
        Comes::Sent(ports) => {
            let arrived = bridge.mailbox.take(channel::FRAMES, None, &|| interrupt.aborts());
            let frames = match arrived {
                Ok(arrived) => frames(&arrived).map_err(gone)?,
                // The run ended before it began.
                Err(_) => return Ok(Exit::Whole),
            };
            Box::new(Incoming { bridge: Arc::clone(bridge), frames, ports, interrupt: interrupt.clone() })
        }
        Comes::Nothing => {
            if let (Role::Node { run, node }, Some(own)) = (part.role, plan.runs[0].nodes.last_mut()) {
                let Ok(arrived) = bridge.mailbox.take(channel::ENGINES, None, &|| interrupt.aborts()) else {
                    return Ok(Exit::Whole);
                };
                let engines = engines(&arrived).map_err(gone)?;
                let whole = Ready::of(whole.clone(), Vec::new(), BTreeMap::new(), &engines).plan;
                // With it the key of what it gives is the one that a run of one process has: the artefacts it reads enter that by their content.
                own.recipe = whole.runs[run].nodes[node].recipe;
            }
            let (frames, ports) = Default::default();
            Box::new(Incoming { bridge: Arc::clone(bridge), frames, ports, interrupt: interrupt.clone() })
        }
    };
    let tap = Outgoing::new(bridge, &plan.runs[0], remedies);
    let ready = Ready { plan: plan.clone(), runs: vec![ReadyRun { source, nodes }], files, warnings: Vec::new() };
    let ran = depthloom_runner::run(ready, &tap, options, &Told { plan: &plan }, interrupt);
    tap.close(&ran).map_err(gone)?;
    bridge.mailbox.wait_for_the_end();
    Ok(match ran {
        Ok(_) | Err(RunError::Aborted) => Exit::Whole,
        Err(error) if error.is_of_a_frame() => Exit::Frames,
        Err(_) => Exit::Engine,
    })
}

/// Where a piece's frames come from.
enum Comes {
    /// From data.
    Read(Box<dyn Source>),
    /// From other parts, at these inputs.
    Sent(Vec<Port>),
    /// It has none.
    Nothing,
}

/// A piece of the plan, ready to run.
struct Piece {
    plan: Plan,
    source: Comes,
    nodes: Vec<Instance>,
    files: BTreeMap<std::path::PathBuf, Value>,
    readiness: Readiness,
    remedies: Arc<Remedies>,
}

/// What can be done about the failures of frames, which tombstones do not say.
type Remedies = Mutex<BTreeMap<usize, String>>;

fn keep_remedy(remedies: &Remedies, position: Option<usize>, fault: &Fault) {
    if let (Some(position), Some(remedy)) = (position, fault.remedy_text()) {
        remedies.lock().unwrap_or_else(PoisonError::into_inner).insert(position, remedy.to_owned());
    }
}

fn piece_of(plan: &Plan, run: usize, source: PlannedSource, nodes: Vec<PlannedNode>) -> Plan {
    let StageRun { stage, prefix, variants, .. } = &plan.runs[run];
    let (stage, prefix, variants) = (stage.clone(), prefix.clone(), variants.clone());
    Plan {
        runs: vec![StageRun { stage, prefix, source, nodes, estimates: Vec::new(), variants }],
        record: Record { every: 1, view: false, points: Vec::new() },
        ..plan.clone()
    }
}

fn source_piece(plan: &Plan, run: usize, registry: &Registry) -> Result<Piece, Vec<NotReady>> {
    let planned = &plan.runs[run].source;
    let source = ready::open(planned, registry).map_err(|error| vec![*error])?;
    let readiness = Readiness { warnings: source.warnings().to_vec(), ..Readiness::default() };
    Ok(Piece {
        plan: piece_of(plan, run, planned.clone(), Vec::new()),
        source: Comes::Read(source),
        nodes: Vec::new(),
        files: BTreeMap::new(),
        readiness,
        remedies: Arc::default(),
    })
}

fn node_piece(
    plan: &Plan,
    (run, node): (usize, usize),
    part: &Part,
    registry: &Registry,
    bridge: &Arc<Bridge>,
    interrupt: &Interrupt,
) -> Result<Piece, Vec<NotReady>> {
    let mut files = BTreeMap::new();
    let planned = &plan.runs[run].nodes[node];
    let (instance, fingerprint) = if planned.kind == KIND {
        foreign::build(plan, (run, node), registry, bridge)?
    } else {
        ready::build(plan, (run, node), registry, &mut files)?
    };
    let mut own = planned.clone();
    let (mut ports, mut nodes, mut instances) = (Vec::new(), Vec::new(), Vec::new());
    let place = nodes_before(planned);
    for input in &mut own.inputs {
        let is_once = match &input.from {
            None | Some(Origin::File(_)) => continue,
            Some(Origin::Here(_)) => false,
            Some(Origin::Once { .. }) => true,
        };
        let port = Port { optional: true, ..input.port.clone() };
        if is_once {
            input.from = Some(Origin::Once { run: 0, node: nodes.len(), port: 0 });
            nodes.push(once_giver(planned, input, &port));
            instances.push(Instance::Once(Box::new(Received {
                bridge: Arc::clone(bridge),
                port,
                interrupt: interrupt.clone(),
            })));
        } else {
            input.from = Some(Origin::Here(Slot::Source { port: ports.len() }));
            ports.push(port);
        }
    }
    debug_assert_eq!(place, nodes.len(), "once-values come first");
    for output in &mut own.outputs {
        output.recorded = true;
    }
    let remedies = Arc::new(Remedies::default());
    nodes.push(own);
    instances.push(guarded(instance, &remedies));
    let source = PlannedSource {
        name: part.id.clone(),
        parts: Vec::new(),
        outputs: ports.iter().cloned().map(|port| output_of(port, false)).collect(),
    };
    let comes = if planned.contract == Contract::Once { Comes::Nothing } else { Comes::Sent(ports) };
    Ok(Piece {
        plan: piece_of(plan, run, source, nodes),
        source: comes,
        nodes: instances,
        files,
        readiness: Readiness { fingerprint, ..Readiness::default() },
        remedies,
    })
}

/// How many nodes that give once-values stand before a node in its piece.
fn nodes_before(planned: &PlannedNode) -> usize {
    planned.inputs.iter().filter(|input| matches!(input.from, Some(Origin::Once { .. }))).count()
}

fn output_of(port: Port, recorded: bool) -> PlannedOutput {
    PlannedOutput { topic: format!("/{}", port.name), port, aliases: Vec::new(), recorded }
}

/// A node that gives what comes for a once-input.
fn once_giver(planned: &PlannedNode, input: &PlannedInput, port: &Port) -> PlannedNode {
    PlannedNode {
        name: input.port.name.to_owned(),
        contract: Contract::Once,
        inputs: Vec::new(),
        outputs: vec![output_of(port.clone(), false)],
        recipe: Key::build("dora").text(input.port.name).finish(),
        ..planned.clone()
    }
}

/// The node that [`once_giver`] plans.
struct Received {
    bridge: Arc<Bridge>,
    port: Port,
    interrupt: Interrupt,
}

impl OnceNode for Received {
    fn run(&self, _: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let arrived = self.bridge.mailbox.take(self.port.name, None, &|| ctx.host.cancelled());
        let value = arrived.map_err(|gone| given_up(&gone, &self.interrupt))?.value(self.port.value_type)?;
        Ok(value.map_or_else(Outputs::none, |value| Outputs::one(self.port.name, value)))
    }
}

/// Frames whose values come from other parts.
struct Incoming {
    bridge: Arc<Bridge>,
    frames: Vec<Frame>,
    ports: Vec<Port>,
    interrupt: Interrupt,
}

/// What a part does whose input ends: nothing more. Why it ended, the recorder hears and tells.
fn given_up(gone: &Gone, interrupt: &Interrupt) -> Fault {
    if matches!(gone, Gone::Ended(_)) {
        while interrupt.raise() < 2 {}
    }
    Fault::Cancelled
}

impl Source for Incoming {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn key(&self, position: usize) -> Result<Key, Fault> {
        Ok(Key::build("dora").number(position as u64).finish())
    }

    fn read(&self, position: usize, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let mut outputs = Outputs::none();
        for port in &self.ports {
            let arrived = self.bridge.mailbox.take(port.name, Some(position), &|| ctx.host.cancelled());
            let arrived = arrived.map_err(|gone| given_up(&gone, &self.interrupt))?;
            if let Some(value) = arrived.value(port.value_type)? {
                outputs = outputs.with(port.name, value);
            }
        }
        Ok(SourceOutputs { outputs, key: self.key(position)? })
    }
}

/// A source that reads a frame when the recorder has let it in.
struct Admitted {
    source: Box<dyn Source>,
    bridge: Arc<Bridge>,
    so_far: Mutex<usize>,
    interrupt: Interrupt,
    remedies: Arc<Remedies>,
}

impl Admitted {
    fn wait(&self, position: usize) -> Result<(), Fault> {
        let mut so_far = self.so_far.lock().unwrap_or_else(PoisonError::into_inner);
        while *so_far <= position {
            let arrived = self.bridge.mailbox.take(channel::ADMITTED, None, &|| self.interrupt.aborts())?;
            let count = arrived.json()?.as_u64().and_then(|count| usize::try_from(count).ok());
            *so_far = (*so_far).max(count.ok_or_else(|| Fault::new("what lets frames in is no number"))?);
        }
        Ok(())
    }
}

impl Source for Admitted {
    fn frames(&self) -> &[Frame] {
        self.source.frames()
    }

    fn key(&self, position: usize) -> Result<Key, Fault> {
        self.wait(position)?;
        self.source.key(position).inspect_err(|fault| keep_remedy(&self.remedies, Some(position), fault))
    }

    fn read(&self, position: usize, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        self.source.read(position, ctx).inspect_err(|fault| keep_remedy(&self.remedies, Some(position), fault))
    }
}

/// What goes: each value as soon as it is there, and of each frame a report.
struct Outgoing<'a> {
    bridge: &'a Bridge,
    /// The outputs with a value for every frame.
    slots: Vec<(Slot, &'static str)>,
    once: Vec<&'static str>,
    is_source: bool,
    written: AtomicUsize,
    sent_once: Mutex<(BTreeSet<&'static str>, Vec<Warned>)>,
    remedies: Arc<Remedies>,
}

impl<'a> Outgoing<'a> {
    fn new(bridge: &'a Bridge, run: &StageRun, remedies: Arc<Remedies>) -> Self {
        let (mut slots, mut once) = (Vec::new(), Vec::new());
        let is_source = run.nodes.is_empty();
        if let Some((node, planned)) = run.nodes.iter().enumerate().next_back() {
            for (port, output) in planned.outputs.iter().enumerate() {
                if planned.contract == Contract::Once || output.port.rate == Rate::Once {
                    once.push(output.port.name);
                } else {
                    slots.push((Slot::Node { node, port }, output.port.name));
                }
            }
        } else {
            let outputs = run.source.outputs.iter().enumerate();
            slots.extend(outputs.map(|(port, output)| (Slot::Source { port }, output.port.name)));
        }
        let (written, sent_once) = (AtomicUsize::new(0), Mutex::default());
        Self { bridge, slots, once, is_source, written, sent_once, remedies }
    }

    /// Tells how it ended, once there are no more frames.
    fn close(&self, ran: &Result<depthloom_runner::Report, RunError>) -> Result<(), Fault> {
        let report = |of: Option<usize>, report: &Report| {
            let frame = Frame::at_10_hz("", 0);
            self.bridge.send(channel::REPORT, of.map(|of| (of, &frame)), &of_text(&report.text()))
        };
        match ran {
            Ok(ran) if ran.interrupted => Ok(()),
            Ok(_) => {
                let (sent, warned) =
                    std::mem::take(&mut *self.sent_once.lock().unwrap_or_else(PoisonError::into_inner));
                let absent: Vec<&str> = self.once.iter().copied().filter(|port| !sent.contains(port)).collect();
                for port in &absent {
                    self.bridge.send(port, None, &[])?;
                }
                if self.once.is_empty() {
                    return Ok(());
                }
                let absent = absent.into_iter().map(str::to_owned).collect();
                let warnings = warned.into_iter().map(|warned| (warned.what, warned.count)).collect();
                report(None, &Report { absent, warnings, ..Report::default() })
            }
            Err(RunError::Aborted) => Ok(()),
            Err(RunError::NodeFailed { fault, .. } | RunError::SourceFailed { fault, .. }) => {
                report(Some(self.written.load(Ordering::SeqCst)), &Report::failed(fault))
            }
            Err(RunError::OnceFailed { fault, .. }) => report(None, &Report::failed(fault)),
            Err(error) => {
                let fault = Fault::new(chain(error));
                report(Some(self.written.load(Ordering::SeqCst)), &Report::failed(&fault))?;
                report(None, &Report::failed(&fault))
            }
        }
    }
}

fn tap_error(fault: &Fault) -> TapError {
    TapError::new(fault.chain())
}

impl Tap for Outgoing<'_> {
    type Part = ();

    fn parts(&self, _: usize) -> usize {
        self.slots.len()
    }

    fn part(&self, _: usize, slot: Slot) -> Option<usize> {
        self.slots.iter().position(|(of, _)| *of == slot)
    }

    fn encode(&self, _: usize, frame: (usize, &Frame), part: usize, values: &[(Slot, Value)]) -> Result<(), TapError> {
        let stream = values.first().map(|(_, value)| of_value(value)).unwrap_or_default();
        self.bridge.send(self.slots[part].1, Some(frame), &stream).map_err(|fault| tap_error(&fault))
    }

    fn write(&self, commit: &Commit<'_>, _: Vec<()>) -> Result<(), TapError> {
        let position = self.written.fetch_add(1, Ordering::SeqCst);
        let is_ours = |slot: &Slot| self.slots.iter().find(|(of, _)| of == slot);
        let absent = commit.absent.iter().filter_map(is_ours).map(|(_, port)| (*port).to_owned()).collect();
        // Of the source of a node's piece there is nothing to tell but that it was abandoned.
        let own = commit.failures.iter().find(|failure| failure.node.is_some() != self.is_source);
        let own = own.or_else(|| commit.failures.first());
        let remedy = self.remedies.lock().unwrap_or_else(PoisonError::into_inner).remove(&position);
        let report = Report {
            key: commit.source_key.filter(|_| self.is_source),
            absent,
            warnings: commit.warnings.iter().map(|warned| (warned.what.clone(), warned.count)).collect(),
            failed: own.map(|failure| (failure.what.clone(), remedy)),
        };
        let stream = of_text(&report.text());
        self.bridge.send(channel::REPORT, Some((position, commit.frame)), &stream).map_err(|fault| tap_error(&fault))
    }

    fn once(&self, run: usize, slot: Slot, _: &Key, value: &Value, warnings: &[Warned]) -> Result<(), TapError> {
        let _ = run;
        let Slot::Node { port, .. } = slot else { return Ok(()) };
        let Some(name) = self.once_name(port) else { return Ok(()) };
        self.bridge.send(name, None, &of_value(value)).map_err(|fault| tap_error(&fault))?;
        let mut sent = self.sent_once.lock().unwrap_or_else(PoisonError::into_inner);
        sent.0.insert(name);
        sent.1 = warnings.to_vec();
        Ok(())
    }
}

impl Outgoing<'_> {
    /// The once-output of a port, by its index among all of the node's.
    fn once_name(&self, port: usize) -> Option<&'static str> {
        let before = self.slots.iter().filter(|(slot, _)| matches!(slot, Slot::Node { port: of, .. } if *of < port));
        self.once.get(port - before.count()).copied()
    }
}

/// A node that keeps what can be done about its failures.
fn guarded(instance: Instance, remedies: &Arc<Remedies>) -> Instance {
    match instance {
        Instance::Pure(node) => Instance::Pure(Box::new(Guarded { node, remedies: Arc::clone(remedies) })),
        // The runner ends by its failure, and tells it whole.
        Instance::Ordered(_) | Instance::Once(_) => instance,
    }
}

struct Guarded {
    node: Box<dyn PureNode>,
    remedies: Arc<Remedies>,
}

impl PureNode for Guarded {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.node.process(inputs, ctx).inspect_err(|fault| keep_remedy(&self.remedies, ctx.host.position(), fault))
    }
}

/// Says how far long work is.
struct Told<'a> {
    plan: &'a Plan,
}

impl Told<'_> {
    fn name(&self, node: usize) -> &str {
        self.plan.runs[0].nodes.get(node).map_or("", |node| &node.name)
    }
}

impl Observer for Told<'_> {
    fn progress(&self, _: usize, node: usize, done: u64, total: u64, message: &str) {
        // Some twenty lines of the longest work.
        if done == total || done.is_multiple_of((total / 20).max(1)) {
            say(format_args!("{}: {done}/{total} {message}", self.name(node)));
        }
    }

    fn told(&self, _: usize, node: usize, what: &str) {
        say(format_args!("{}: {what}", self.name(node)));
    }
}
