//! Random graphs on 1, 2 and 8 workers give what a reference gives that runs one node after the other.

mod support;

use std::collections::BTreeMap;
use std::error::Error;

use depthloom_graphs::contracts::{Commit, Contract, Failure, InlineHost, Slot, SlotKey};
use depthloom_graphs::plan::{FrameIndex, NodeId, NodeRef, Origin, PartId, PlannedNode, PortId, RunId};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Key, Outputs, Port, Rate, Scratch, Value, value_keys};
use depthloom_runner::{Audit, Interrupt, Options, RunError, Unwatched, run};
use proptest::prelude::*;
use support::any_graph::{AnyGraph, any_graph, bench};
use support::{Bench, Notebook, aggregate_key, commit_text, part_of, part_text, told_value, without_place};

/// A run's end, in words without a panic's place.
fn told_error(error: &RunError) -> String {
    let beneath = error.source().map(ToString::to_string).unwrap_or_default();
    format!("{error}: {}", without_place(&beneath))
}

fn run_text(graph: &AnyGraph, workers: usize, window: Option<usize>) -> (Vec<String>, Option<String>) {
    let notebook = Notebook::with_parts(graph.parts);
    let options =
        Options { workers, window, keep_going: graph.keep_going, checkpoints: None, audit: Audit::None, share: None };
    let result = run(bench(graph).ready(), &notebook, &options, &Unwatched, &Interrupt::default());
    (notebook.lines(), result.err().as_ref().map(told_error))
}

// --- the reference -------------------------------------------------------------------------------------------------

type Keyed = Option<(Value, Key)>;
/// Aggregate values by node and port.
type Once = BTreeMap<(NodeRef, PortId), (Value, Key)>;

/// What a step results on a frame: its values by port, or why not.
enum Gave {
    Values(Key, Vec<Keyed>),
    Nothing,
    Failed(Fault),
    NotRun(String),
}

fn called<R>(f: impl FnOnce() -> Result<R, Fault>) -> Result<R, Fault> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(f))
        .unwrap_or_else(|payload| Err(Fault::new(payload.downcast_ref::<&str>().copied().unwrap_or("?"))))
}

fn ports(node: &PlannedNode, rate: Rate) -> Vec<Port> {
    node.outputs.iter().map(|o| &o.port).filter(|p| p.rate == rate).cloned().collect()
}

fn keyed(values: Vec<Option<Value>>, ports: &[Port], key: &Key) -> Vec<Keyed> {
    values.into_iter().zip(ports).map(|(v, p)| v.map(|v| (v, value_keys::port(key, p.name)))).collect()
}

/// Runs everything one after the other, in plan order.
fn reference(graph: &AnyGraph) -> (Vec<String>, Option<String>) {
    let Bench { plan, runs } = bench(graph);
    let (mut lines, mut once) = (Vec::new(), Once::new());
    let mut scratch = Scratch::default();
    let mut ctx = Context::new(&InlineHost, &mut scratch);
    for (run, (planned, mut ready)) in RunId::enumerate(plan.runs.iter().zip(runs)) {
        let mut last_keys: Vec<Option<Key>> = vec![None; planned.nodes.len()];
        for (position, frame) in FrameIndex::enumerate(ready.source.frames()) {
            let source_ports: Vec<Port> = planned.source.outputs.iter().map(|o| o.port.clone()).collect();
            let read = ready.source.read(position, &mut ctx);
            let mut results = vec![match read.and_then(|r| Ok((r.outputs.in_order_of(&source_ports)?, r.key))) {
                Ok((values, key)) => Gave::Values(key, keyed(values, &source_ports, &key)),
                Err(fault) => Gave::Failed(fault),
            }];
            for (index, (node, instance)) in NodeId::enumerate(planned.nodes.iter().zip(&mut ready.nodes)) {
                let at = |from: &Origin| match from {
                    Origin::Here(Slot::Source { port }) => (0, *port),
                    Origin::Here(Slot::Node { node, port }) => (1 + node.0, *port),
                    _ => unreachable!("called for per-frame inputs only"),
                };
                let before = node.inputs.iter().filter_map(|i| i.from.as_ref());
                let before = before.filter(|from| matches!(from, Origin::Here(_)));
                let failed = before.map(|from| at(from).0).find_map(|step| match &results[step] {
                    Gave::Failed(_) if step == 0 => Some("not run: source `numbers` failed".to_owned()),
                    Gave::Failed(_) => Some(format!("not run: `{}` failed", planned.nodes[step - 1].name)),
                    Gave::NotRun(why) => Some(why.clone()),
                    Gave::Values(..) | Gave::Nothing => None,
                });
                let inputs: Vec<Keyed> = node
                    .inputs
                    .iter()
                    .map(|input| match input.from.as_ref()? {
                        Origin::Once { run, node, port } => {
                            once.get(&(NodeRef { run: *run, node: *node }, *port)).cloned()
                        }
                        here => match &results[at(here).0] {
                            Gave::Values(_, values) => values[at(here).1].clone(),
                            Gave::Nothing | Gave::Failed(_) | Gave::NotRun(_) => None,
                        },
                    })
                    .collect();
                let is_absent = inputs.iter().zip(&node.inputs).any(|(v, i)| v.is_none() && !i.port.optional);
                let (values, keys): (Vec<_>, Vec<_>) =
                    inputs.into_iter().map(|i| i.map_or((None, None), |(v, k)| (Some(v), Some(k)))).unzip();
                let in_ports: Vec<Port> = node.inputs.iter().map(|i| i.port.clone()).collect();
                let out_ports = ports(node, Rate::Frame);
                let in_order = |given: Outputs| given.in_order_of(&out_ports);
                let inputs = Inputs::new(&in_ports, &values);
                results.push(match (failed, instance) {
                    (_, Instance::Once(_)) => Gave::Nothing,
                    (Some(why), _) => Gave::NotRun(why),
                    (None, _) if is_absent => Gave::Nothing,
                    (None, Instance::Pure(pure)) => {
                        match called(|| pure.process(&inputs, &mut ctx)).and_then(in_order) {
                            Ok(values) => {
                                let key = value_keys::pure(&node.node_hash, None, &keys);
                                Gave::Values(key, keyed(values, &out_ports, &key))
                            }
                            Err(fault) => Gave::Failed(fault),
                        }
                    }
                    (None, Instance::Ordered(ordered)) => {
                        match called(|| ordered.process(frame, &inputs, &mut ctx)).and_then(in_order) {
                            Ok(values) => {
                                let observed = value_keys::Observed { frame, files: None };
                                let last = last_keys[index].as_ref();
                                let key = value_keys::ordered(&node.node_hash, last, observed, &keys);
                                last_keys[index] = Some(key);
                                Gave::Values(key, keyed(values, &out_ports, &key))
                            }
                            Err(fault) => Gave::Failed(fault),
                        }
                    }
                });
            }
            let is_fatal =
                |step: usize| !graph.keep_going || step > 0 && planned.nodes[step - 1].contract == Contract::Ordered;
            for (step, results) in results.iter().enumerate() {
                let Gave::Failed(fault) = results else { continue };
                if is_fatal(step) {
                    let who = match step {
                        0 => format!("source `numbers` of stage `{}`", planned.stage),
                        _ => format!("node `{}.{}`", planned.stage, planned.nodes[step - 1].name),
                    };
                    return (lines, Some(format!("{who} failed on frame {}: {fault}", frame.id)));
                }
            }
            lines.push(commit(run, graph.parts, frame, &results));
        }
        if let Some(error) = finish(run, planned, ready.nodes, &last_keys, &mut once, &mut lines) {
            return (lines, Some(error));
        }
    }
    (lines, None)
}

fn commit(run: RunId, parts: usize, frame: &depthloom_graphs::Frame, results: &[Gave]) -> String {
    let (mut taken, mut keys, mut failures) = (vec![Vec::new(); parts], Vec::new(), Vec::new());
    for (step, results) in results.iter().enumerate() {
        let node = step.checked_sub(1).map(NodeId);
        match results {
            Gave::Values(key, values) => {
                keys.extend(node.map(|node| SlotKey { node, key: *key }));
                for (port, value) in PortId::enumerate(values) {
                    let slot = node.map_or(Slot::Source { port }, |node| Slot::Node { node, port });
                    if let (Some((value, _)), Some(part)) = (value, part_of(parts, slot)) {
                        taken[part].push((slot, value.clone()));
                    }
                }
            }
            Gave::Nothing => {}
            Gave::Failed(fault) => failures.push(Failure { node, what: fault.to_string() }),
            Gave::NotRun(why) => failures.push(Failure { node, what: why.clone() }),
        }
    }
    let source_key = if let Gave::Values(key, _) = &results[0] { Some(*key) } else { None };
    let text: Vec<_> = PartId::enumerate(&taken).map(|(part, values)| part_text(part, values)).collect();
    commit_text(
        &Commit { run, frame, source_key, keys: &keys, failures: &failures, absent: &[], warnings: &[], live: None },
        &text,
    )
}

fn finish(
    run: RunId,
    planned: &depthloom_graphs::plan::StageRun,
    nodes: Vec<Instance>,
    last_keys: &[Option<Key>],
    once: &mut Once,
    lines: &mut Vec<String>,
) -> Option<String> {
    let mut scratch = Scratch::default();
    let mut ctx = Context::new(&InlineHost, &mut scratch);
    for (index, (node, instance)) in NodeId::enumerate(planned.nodes.iter().zip(nodes)) {
        let ports = ports(node, Rate::Once);
        let (made, key) = match instance {
            Instance::Pure(_) => continue,
            Instance::Ordered(ordered) => {
                (ordered.finish(&mut ctx), value_keys::finished(&node.node_hash, last_keys[index].as_ref()))
            }
            Instance::Once(instance) => {
                let found = node.inputs.iter().map(|input| match input.from.as_ref()? {
                    Origin::Once { run, node, port } => once.get(&(NodeRef { run: *run, node: *node }, *port)).cloned(),
                    _ => None,
                });
                let (values, keys): (Vec<_>, Vec<_>) =
                    found.map(|i| i.map_or((None, None), |(v, k)| (Some(v), Some(k)))).unzip();
                let in_ports: Vec<Port> = node.inputs.iter().map(|i| i.port.clone()).collect();
                let made = called(|| instance.run(&Inputs::new(&in_ports, &values), &mut ctx));
                (made, value_keys::once(&node.node_hash, &keys))
            }
        };
        let values = made.and_then(|made| made.in_order_of(&ports)).expect("toys fail on frames only");
        for (port, value) in values.into_iter().enumerate() {
            let Some(value) = value else { continue };
            // An ordered toy's once-output follows its two per-frame ones.
            let port = if node.contract == Contract::Ordered { PortId(2 + port) } else { PortId(port) };
            let slot = Slot::Node { node: index, port };
            lines.push(format!("{run} {slot:?} {key} {}", told_value(&value)));
            let entering = aggregate_key(&value, &key, node.outputs[port].port.name);
            once.insert((NodeRef { run, node: index }, port), (value, entering));
        }
    }
    None
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_graph_gives_what_the_reference_gives(graph in any_graph()) {
        let expected = reference(&graph);
        for workers in [1, 2, 8] {
            let text = run_text(&graph, workers, Some(graph.window));
            prop_assert_eq!(&text, &expected, "workers {}", workers);
        }
        prop_assert_eq!(&run_text(&graph, 3, None), &expected, "default window");
    }
}
