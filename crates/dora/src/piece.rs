//! The piece of the plan that a part runs: its source, or one node with its inputs.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use depthloom_graphs::contracts::{Contract, Slot};
use depthloom_graphs::plan::{
    NodeId, NodeRef, Origin, Plan, PlannedInput, PlannedNode, PlannedOutput, PlannedSource, PortId, Record, RunId,
    StageRun,
};
use depthloom_graphs::ready::{self, NotReady};
use depthloom_graphs::{Instance, Key, Port, Registry, Source, Value};
use depthloom_nodes::dora::KIND;
use depthloom_runner::Interrupt;

use crate::bridge::Bridge;
use crate::foreign;
use crate::incoming::Received;
use crate::layout::Part;
use crate::remedies::{Remedies, guarded};
use crate::report::Readiness;

/// Where a piece's frames come from.
pub(crate) enum FrameInput {
    /// From data.
    Read(Box<dyn Source>),
    /// From other parts, at these inputs.
    Sent(Vec<Port>),
    /// It has no frames.
    None,
}

pub(crate) struct Piece {
    pub plan: Plan,
    pub source: FrameInput,
    pub nodes: Vec<Instance>,
    pub files: BTreeMap<PathBuf, Value>,
    pub readiness: Readiness,
    pub remedies: Arc<Remedies>,
}

fn piece_of(plan: &Plan, run: RunId, source: PlannedSource, nodes: Vec<PlannedNode>) -> Plan {
    let StageRun { stage, prefix, variants, .. } = &plan.runs[run];
    let (stage, prefix, variants) = (stage.clone(), prefix.clone(), variants.clone());
    Plan {
        runs: vec![StageRun { stage, prefix, source, nodes, estimates: Vec::new(), variants }],
        record: Record { every: 1, view: false, points: Vec::new() },
        ..plan.clone()
    }
}

pub(crate) fn source_piece(plan: &Plan, run: RunId, registry: &Registry) -> Result<Piece, Vec<NotReady>> {
    let planned = &plan.runs[run].source;
    let source = ready::open(planned, registry).map_err(|error| vec![*error])?;
    let readiness = Readiness { warnings: source.warnings().to_vec(), ..Readiness::default() };
    Ok(Piece {
        plan: piece_of(plan, run, planned.clone(), Vec::new()),
        source: FrameInput::Read(source),
        nodes: Vec::new(),
        files: BTreeMap::new(),
        readiness,
        remedies: Arc::default(),
    })
}

pub(crate) fn node_piece(
    plan: &Plan,
    node: NodeRef,
    part: &Part,
    registry: &Registry,
    bridge: &Arc<Bridge>,
    interrupt: &Interrupt,
) -> Result<Piece, Vec<NotReady>> {
    let mut files = BTreeMap::new();
    let planned = &plan.runs[node.run].nodes[node.node];
    let (instance, fingerprint) = if planned.kind == KIND {
        foreign::build(plan, node, registry, bridge)?
    } else {
        ready::build(plan, node, registry, &mut files)?
    };
    let mut own = planned.clone();
    let (mut ports, mut nodes, mut instances) = (Vec::new(), Vec::new(), Vec::new());
    for input in &mut own.inputs {
        let is_once = match &input.from {
            None | Some(Origin::File(_)) => continue,
            Some(Origin::Here(_)) => false,
            Some(Origin::Once { .. }) => true,
        };
        let port = Port { optional: true, ..input.port.clone() };
        if is_once {
            input.from = Some(Origin::Once { run: RunId(0), node: NodeId(nodes.len()), port: PortId(0) });
            nodes.push(aggregate_node(planned, input, &port));
            instances.push(Instance::Once(Box::new(Received {
                bridge: Arc::clone(bridge),
                port,
                interrupt: interrupt.clone(),
            })));
        } else {
            input.from = Some(Origin::Here(Slot::Source { port: PortId(ports.len()) }));
            ports.push(port);
        }
    }
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
    let frames = if planned.contract == Contract::Once { FrameInput::None } else { FrameInput::Sent(ports) };
    Ok(Piece {
        plan: piece_of(plan, node.run, source, nodes),
        source: frames,
        nodes: instances,
        files,
        readiness: Readiness { fingerprint, ..Readiness::default() },
        remedies,
    })
}

fn output_of(port: Port, recorded: bool) -> PlannedOutput {
    PlannedOutput { topic: format!("/{}", port.name), port, aliases: Vec::new(), recorded }
}

/// A node that outputs a received aggregate value.
fn aggregate_node(planned: &PlannedNode, input: &PlannedInput, port: &Port) -> PlannedNode {
    PlannedNode {
        name: input.port.name.to_owned(),
        contract: Contract::Once,
        inputs: Vec::new(),
        outputs: vec![output_of(port.clone(), false)],
        node_hash: Key::build("dora").text(input.port.name).finish(),
        ..planned.clone()
    }
}
