//! Resolves names and checks types: one variant's spec against the kinds an engine knows.

use std::collections::HashMap;
use std::sync::Arc;

use super::linked::{Linked, LinkedEstimate, LinkedNode, LinkedSource, LinkedStage, Wire};
use super::order;
use super::stage_names::StageNames;
use super::wire::Reachable;
use crate::contracts::Port;
use crate::language::check::params::Resolver;
use crate::language::check::reference::Reference;
use crate::language::check::score;
use crate::language::check::spec::{InputSpec, NodeSpec, SourceSpec, Spec, StageSpec, Wired};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names;
use crate::plan::SourcePart;
use crate::registry::{NodeKind, Registry};
use crate::values::ValueType;

/// Links a variant. What is wrong is reported and left out of the result.
pub(crate) fn link<'r>(
    spec: &Spec,
    registry: &'r Registry,
    resolver: &mut Resolver,
    report: &mut Report,
) -> Linked<'r> {
    let sources: HashMap<&str, Option<Arc<LinkedSource>>> = spec
        .sources
        .iter()
        .map(|spec| (spec.name.text.as_str(), source(spec, registry, resolver, report).map(Arc::new)))
        .collect();
    let all: Vec<Vec<NodeSpecRef<'_>>> = spec.stages.iter().map(|stage| nodes_of(stage, &sources, registry)).collect();
    let stages: Vec<StageNames<'r, '_>> = spec
        .stages
        .iter()
        .zip(&all)
        .map(|(stage, nodes)| StageNames {
            name: &stage.name.text,
            source: stage_source(stage, spec, &sources, report),
            nodes: nodes
                .iter()
                .map(|node| (node.get().name.text.as_str(), kind(node.get(), registry, report)))
                .collect(),
            index: nodes.iter().enumerate().map(|(n, node)| (node.get().name.text.as_str(), n)).collect(),
        })
        .collect();
    let mut linked = Vec::with_capacity(stages.len());
    for (index, (stage, nodes)) in spec.stages.iter().zip(&all).enumerate() {
        let reachable = Reachable { stages: &stages, stage: index };
        let nodes: Vec<LinkedNode<'r>> = nodes
            .iter()
            .zip(&stages[index].nodes)
            .map(|(node, (_, kind))| link_node(node, *kind, &reachable, resolver, report))
            .collect();
        let order = order::of(index, &nodes, report);
        let estimates = stage.score.iter().flat_map(|score| &score.estimates);
        let estimates = estimates
            .filter_map(|estimate| {
                let node = stages[index].node(&score::node_name(&estimate.name.text))?;
                Some(LinkedEstimate { name: estimate.name.clone(), node })
            })
            .collect();
        let source = stages[index].source.clone();
        linked.push(LinkedStage { name: stage.name.clone(), source, nodes, order, estimates });
    }
    Linked { stages: linked }
}

/// A node as written, or one that `score:` stands for.
enum NodeSpecRef<'s> {
    Written(&'s NodeSpec),
    Score(NodeSpec),
}

impl NodeSpecRef<'_> {
    const fn get(&self) -> &NodeSpec {
        match self {
            Self::Written(spec) => spec,
            Self::Score(spec) => spec,
        }
    }
}

fn nodes_of<'s>(
    stage: &'s StageSpec,
    sources: &HashMap<&str, Option<Arc<LinkedSource>>>,
    registry: &Registry,
) -> Vec<NodeSpecRef<'s>> {
    let type_of = |reference: &Reference| type_of(reference, stage, sources, registry);
    let scores = stage.score.iter().flat_map(|score| score::expanded(score, registry, &type_of));
    let scores = scores.map(NodeSpecRef::Score);
    stage.nodes.iter().map(NodeSpecRef::Written).chain(scores).collect()
}

/// The type of what a reference names in its own stage, if it names something.
fn type_of(
    reference: &Reference,
    stage: &StageSpec,
    sources: &HashMap<&str, Option<Arc<LinkedSource>>>,
    registry: &Registry,
) -> Option<ValueType> {
    if reference.stage.as_ref().is_some_and(|named| named.text != stage.name.text) {
        return None;
    }
    let ports: &[Port] = if reference.node.text == "source" {
        &sources.get(stage.source.as_ref()?.text.as_str())?.as_ref()?.outputs
    } else {
        let node = stage.nodes.iter().find(|node| node.name.text == reference.node.text)?;
        &registry.node_kind(&node.instance.as_ref()?.kind.text)?.declaration.outputs
    };
    ports.iter().find(|port| port.name == reference.output.text).map(|port| port.value_type)
}

fn stage_source(
    stage: &StageSpec,
    spec: &Spec,
    sources: &HashMap<&str, Option<Arc<LinkedSource>>>,
    report: &mut Report,
) -> Option<Arc<LinkedSource>> {
    let name = stage.source.as_ref()?;
    if let Some(source) = sources.get(name.text.as_str()) {
        return source.clone();
    }
    let known: Vec<&str> = spec.sources.iter().map(|source| source.name.text.as_str()).collect();
    if known.is_empty() {
        // That there are none has been said.
        return None;
    }
    let error = Diagnostic::error(&name.place, format!("there is no source `{}`", name.text)).label("names nothing");
    report.push(error.maybe_help(names::suggestion(&name.text, "sources", &known)));
    None
}

fn kind<'r>(node: &NodeSpec, registry: &'r Registry, report: &mut Report) -> Option<&'r NodeKind> {
    let word = &node.instance.as_ref()?.kind;
    let found = registry.node_kind(&word.text);
    if found.is_none() && !report.is_full() {
        let known: Vec<&str> = registry.nodes().map(|kind| kind.declaration.kind).collect();
        let help = if registry.source_kind(&word.text).is_some() {
            Some(format!("`{}` is a source: it belongs under `sources:`", word.text))
        } else {
            names::suggestion(&word.text, "node kinds", &known)
        };
        let error = Diagnostic::error(&word.place, format!("there is no node kind `{}`", word.text));
        report.push(error.label("unknown kind").maybe_help(help));
    }
    found
}

fn source(
    spec: &SourceSpec,
    registry: &Registry,
    resolver: &mut Resolver,
    report: &mut Report,
) -> Option<LinkedSource> {
    let mut parts = Vec::with_capacity(spec.parts.len());
    let mut outputs: Option<Vec<Port>> = None;
    let mut sound = !spec.parts.is_empty();
    for part in &spec.parts {
        let Some(kind) = registry.source_kind(&part.kind.text) else {
            let known: Vec<&str> = registry.sources().map(|kind| kind.declaration.kind).collect();
            let help = if registry.node_kind(&part.kind.text).is_some() {
                Some(format!("`{}` is a node: it belongs under `nodes:` of a stage", part.kind.text))
            } else {
                names::suggestion(&part.kind.text, "source kinds", &known)
            };
            let error = Diagnostic::error(&part.kind.place, format!("there is no source kind `{}`", part.kind.text));
            report.push(error.label("unknown kind").maybe_help(help));
            sound = false;
            continue;
        };
        let parameters = resolver.source(kind, part, report);
        // With wrong parameters the outputs are known all the same, unless they follow from these: references to them can be judged.
        let declared = (!kind.declaration.outputs.is_empty()).then(|| kind.declaration.outputs.clone());
        let given = match &parameters {
            Some(parameters) => resolver.outputs(kind, parameters, part, report),
            None => declared,
        };
        match (&mut outputs, given) {
            (None, given) => outputs = given,
            (Some(outputs), Some(given)) => sound &= joins(outputs, &given, part, report),
            (Some(_), None) => sound = false,
        }
        match parameters {
            Some(parameters) => parts.push(SourcePart {
                kind: part.kind.text.clone(),
                version: kind.declaration.version,
                params: parameters.resolved.clone(),
                portable: parameters.portable.clone(),
            }),
            None => sound = false,
        }
    }
    let outputs = outputs?;
    Some(LinkedSource { name: spec.name.text.clone(), parts: if sound { parts } else { Vec::new() }, outputs })
}

/// Joined sources have equal outputs; one that only some frames have is optional.
fn joins(
    outputs: &mut [Port],
    others: &[Port],
    part: &crate::language::check::spec::Instance,
    report: &mut Report,
) -> bool {
    let equal = outputs.len() == others.len()
        && outputs
            .iter()
            .zip(others)
            .all(|(a, b)| a.name == b.name && a.value_type == b.value_type && a.rate == b.rate);
    if !equal {
        let list = |ports: &[Port]| {
            ports.iter().map(|p| format!("{} ({})", p.name, p.value_type)).collect::<Vec<_>>().join(", ")
        };
        let what = format!("`{}` cannot be joined: it gives other outputs than the sources before it", part.kind.text);
        let help = format!("before it: {}; here: {}", list(outputs), list(others));
        report.push(Diagnostic::error(&part.kind.place, what).help(help));
        return false;
    }
    for (output, other) in outputs.iter_mut().zip(others) {
        output.optional |= other.optional;
    }
    true
}

fn link_node<'r>(
    node: &NodeSpecRef<'_>,
    kind: Option<&'r NodeKind>,
    reachable: &Reachable<'r, '_, '_>,
    resolver: &mut Resolver,
    report: &mut Report,
) -> LinkedNode<'r> {
    let spec = node.get();
    let parameters =
        kind.zip(spec.instance.as_ref()).and_then(|(kind, instance)| resolver.node(kind, instance, report));
    let mut wires: Vec<Option<Wire>> = vec![None; kind.map_or(0, |kind| kind.declaration.inputs.len())];
    let mut reads = Vec::new();
    for input in &spec.inputs {
        // Nobody reads so many errors, and looking for nearest names takes its time.
        if report.is_full() {
            break;
        }
        if let Some(Wired::Reference(reference)) = &input.from {
            reads.extend(reachable.read(reference).map(|(stage, node)| (stage, node, input.place.clone())));
        }
        let Some(kind) = kind else {
            // Without a kind there are no ports, but whether the reference names something can be said.
            if let Some(Wired::Reference(reference)) = &input.from {
                reachable.output(reference, report);
            }
            continue;
        };
        let ports = &kind.declaration.inputs;
        match ports.iter().position(|port| port.name == input.port.text) {
            Some(port) => wires[port] = reachable.wire(&spec.name.text, kind, &ports[port], input, resolver, report),
            None => unknown_input(kind, input, report),
        }
    }
    if let Some(kind) = kind.filter(|_| !report.is_full()) {
        missing_inputs(kind, spec, reachable, report);
    }
    let is_score = matches!(node, NodeSpecRef::Score(_));
    LinkedNode { name: spec.name.clone(), kind, parameters, wires, reads, is_score }
}

fn unknown_input(kind: &NodeKind, input: &InputSpec, report: &mut Report) {
    let known: Vec<&str> = kind.declaration.inputs.iter().map(|port| port.name).collect();
    let what = format!("`{}` has no input `{}`", kind.declaration.kind, input.port.text);
    let error = Diagnostic::error(&input.port.place, what).label("no such input");
    report.push(error.maybe_help(names::suggestion(&input.port.text, "inputs", &known)));
}

fn missing_inputs(kind: &NodeKind, spec: &NodeSpec, reachable: &Reachable<'_, '_, '_>, report: &mut Report) {
    let unknown = spec.inputs.iter().map(|input| input.port.text.as_str());
    let unknown: Vec<&str> =
        unknown.filter(|name| !kind.declaration.inputs.iter().any(|port| port.name == *name)).collect();
    // A misspelt input has been spoken of, with the name that was meant.
    let meant = |port: &Port| unknown.iter().any(|written| names::nearest(written, [port.name]).is_some());
    let written = |input: &InputSpec| !matches!(input.from, Some(Wired::Nothing));
    let wired =
        |port: &Port| spec.inputs.iter().any(|input| input.port.text == port.name && written(input)) || meant(port);
    let missing: Vec<&Port> = kind.declaration.inputs.iter().filter(|port| !port.optional && !wired(port)).collect();
    // A score without truth or estimate has been spoken of where it is written.
    if missing.is_empty() || score::is_kind(kind.declaration.kind) && spec.name.text.starts_with("score.") {
        return;
    }
    let list: Vec<String> = missing.iter().map(|port| format!("`{}` ({})", port.name, port.value_type)).collect();
    let (noun, verb) = if missing.len() == 1 { ("input", "is") } else { ("inputs", "are") };
    let what = format!("the {noun} {} of node `{}` {verb} not wired", list.join(" and "), spec.name.text);
    let fits: Vec<String> = missing
        .iter()
        .filter_map(|port| {
            let fitting = reachable.outputs_fitting(port, &spec.name.text).into_iter().next();
            let file = || port.takes_file().then(|| "{ file: PATH }".to_owned());
            Some(format!("{}: {}", port.name, fitting.or_else(file)?))
        })
        .collect();
    let help = (!fits.is_empty()).then(|| format!("e.g. `inputs: {{ {} }}`", fits.join(", ")));
    let nothing = |input: &&InputSpec| !written(input) && missing.iter().any(|port| port.name == input.port.text);
    let place = spec.inputs.iter().find(nothing).map_or(&spec.name.place, |input| &input.place);
    report.push(Diagnostic::error(place, what).label(format!("needs {}", list.join(" and "))).maybe_help(help));
}
