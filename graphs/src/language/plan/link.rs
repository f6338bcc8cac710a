//! Resolves names and checks types: one variant's spec against the kinds an engine knows.

use std::collections::HashMap;
use std::sync::Arc;

use super::linked::{Linked, LinkedEstimate, LinkedNode, LinkedSource, LinkedStage, NodeTypes, Wire};
use super::order;
use super::stage_names::StageNames;
use super::wire::Reachable;
use crate::contracts::{Port, SwitchedOff};
use crate::language::check::params::Resolver;
use crate::language::check::reference::Reference;
use crate::language::check::score;
use crate::language::check::spec::{InputSpec, NodeSpec, SourceSpec, Spec, StageSpec, Wired};
use crate::language::ids::{StageId, StageNodeId};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names;
use crate::language::text::word::Word;
use crate::plan::SourcePart;
use crate::registry::{NodeKind, Registry};
use crate::values::ValueType;

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
    let known: Vec<Vec<(&str, NodeTypes<'r>)>> = spec
        .stages
        .iter()
        .map(|stage| {
            stage.nodes.iter().map(|node| (node.name.text.as_str(), types(node, registry, resolver, report))).collect()
        })
        .collect();
    let scores: Vec<Vec<NodeSpec>> =
        spec.stages.iter().zip(&known).map(|(stage, known)| scores_of(stage, known, &sources, registry)).collect();
    let mut stages: Vec<StageNames<'r, '_>> = Vec::with_capacity(spec.stages.len());
    for ((stage, mut nodes), scores) in spec.stages.iter().zip(known).zip(&scores) {
        nodes.extend(scores.iter().map(|node| (node.name.text.as_str(), types(node, registry, resolver, report))));
        stages.push(StageNames {
            name: &stage.name.text,
            source: stage_source(stage, spec, &sources, report),
            index: StageNodeId::enumerate(&nodes).map(|(id, (name, _))| (*name, id)).collect(),
            nodes,
        });
    }
    let mut linked = Vec::with_capacity(stages.len());
    for (index, (stage, scores)) in StageId::enumerate(spec.stages.iter().zip(&scores)) {
        let reachable = Reachable { stages: &stages, stage: index };
        let mut nodes: Vec<LinkedNode<'r>> = stage
            .nodes
            .iter()
            .chain(scores)
            .zip(&stages[index].nodes)
            .map(|(node, (_, types))| link_node(node, types, &reachable, resolver, report))
            .collect();
        nodes[stage.nodes.len()..].iter_mut().for_each(|node| node.is_score = true);
        let order = order::sorted(index, &nodes, report);
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

fn scores_of(
    stage: &StageSpec,
    known: &[(&str, NodeTypes<'_>)],
    sources: &HashMap<&str, Option<Arc<LinkedSource>>>,
    registry: &Registry,
) -> Vec<NodeSpec> {
    let type_of = |reference: &Reference| type_of(reference, stage, known, sources);
    stage.score.iter().flat_map(|score| score::expanded(score, registry, &type_of)).collect()
}

fn type_of(
    reference: &Reference,
    stage: &StageSpec,
    known: &[(&str, NodeTypes<'_>)],
    sources: &HashMap<&str, Option<Arc<LinkedSource>>>,
) -> Option<ValueType> {
    if reference.stage.as_ref().is_some_and(|named| named.text != stage.name.text) {
        return None;
    }
    let ports: &[Port] = if reference.node.text == "source" {
        &sources.get(stage.source.as_ref()?.text.as_str())?.as_ref()?.outputs
    } else {
        known.iter().find(|(name, _)| *name == reference.node.text)?.1.outputs()
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
        // Reported elsewhere.
        return None;
    }
    let error = Diagnostic::error(&name.place, format!("there is no source `{}`", name.text)).label("unknown name");
    report.push(error.maybe_help(names::suggestion(&name.text, "sources", &known)));
    None
}

fn types<'r>(node: &NodeSpec, registry: &'r Registry, resolver: &mut Resolver, report: &mut Report) -> NodeTypes<'r> {
    let kind = node.instance.as_ref().and_then(|instance| {
        let found = registry.node_kind(&instance.kind.text);
        if found.is_none() && !report.is_full() {
            let known: Vec<&str> = registry.nodes().map(|kind| kind.declaration.kind).collect();
            let other = registry.source_kind(&instance.kind.text).map(|_| "is a source: it belongs under `sources:`");
            report.push(unknown_kind(&instance.kind, "node", &known, other));
        }
        found
    });
    let parameters =
        kind.zip(node.instance.as_ref()).and_then(|(kind, own)| resolver.parameters(&kind.info(), own, report));
    let signature = kind.and_then(|kind| resolver.signature(kind, parameters.as_deref()));
    NodeTypes { kind, parameters, signature }
}

fn unknown_kind(word: &Word, what: &str, known: &[&str], other: Option<&str>) -> Diagnostic {
    let help = match other {
        Some(other) => Some(format!("`{}` {other}", word.text)),
        None => names::suggestion(&word.text, &format!("{what} kinds"), known),
    };
    let error = Diagnostic::error(&word.place, format!("there is no {what} kind `{}`", word.text));
    error.label("unknown kind").maybe_help(help)
}

fn source(
    spec: &SourceSpec,
    registry: &Registry,
    resolver: &mut Resolver,
    report: &mut Report,
) -> Option<LinkedSource> {
    let mut parts = Vec::with_capacity(spec.parts.len());
    let mut outputs: Option<Vec<Port>> = None;
    let mut switched_off: Option<Vec<SwitchedOff>> = None;
    let mut sound = !spec.parts.is_empty();
    for part in &spec.parts {
        let Some(kind) = registry.source_kind(&part.kind.text) else {
            let known: Vec<&str> = registry.sources().map(|kind| kind.declaration.kind).collect();
            let is_node = registry.node_kind(&part.kind.text).is_some();
            let other = is_node.then_some("is a node: it belongs under `nodes:` of a stage");
            report.push(unknown_kind(&part.kind, "source", &known, other));
            sound = false;
            continue;
        };
        let parameters = resolver.parameters(&kind.info(), part, report);
        // Outputs that do not follow from the parameters are known even if these are wrong, so references can be
        // checked.
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
        // Another part may have values.
        let off = parameters.as_ref().and_then(|parameters| kind.switched_off(&parameters.resolved).ok());
        let off = off.unwrap_or_default();
        match &mut switched_off {
            None => switched_off = Some(off),
            Some(all) => all.retain(|one| off.iter().any(|other| other.output == one.output)),
        }
        match parameters {
            Some(parameters) => parts.push(SourcePart {
                kind: part.kind.text.clone(),
                version: kind.declaration.version,
                params: parameters.resolved.clone(),
                shown: parameters.shown.clone(),
                portable: parameters.recorded.clone(),
            }),
            None => sound = false,
        }
    }
    let outputs = outputs?;
    let switched_off = switched_off.filter(|_| sound).unwrap_or_default();
    let parts = if sound { parts } else { Vec::new() };
    Some(LinkedSource { name: spec.name.text.clone(), parts, outputs, switched_off })
}

/// Joined sources must have equal outputs. An output that only some have on a frame is optional.
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
    spec: &NodeSpec,
    types: &NodeTypes<'r>,
    reachable: &Reachable<'r, '_, '_>,
    resolver: &mut Resolver,
    report: &mut Report,
) -> LinkedNode<'r> {
    let known_ports = types.kind.zip(types.signature.as_deref());
    let mut wires: Vec<Option<Wire>> = vec![None; known_ports.map_or(0, |(_, signature)| signature.inputs.len())];
    let mut reads = Vec::new();
    for input in &spec.inputs {
        // Suggestions take time.
        if report.is_full() {
            break;
        }
        if let Some(Wired::Reference(reference)) = &input.from {
            reads.extend(reachable.read(reference).map(|node| (node, input.place.clone())));
        }
        let Some((kind, signature)) = known_ports else {
            // Without a signature the ports are unknown, but the reference can be checked.
            if let Some(Wired::Reference(reference)) = &input.from {
                reachable.find(reference, report);
            }
            continue;
        };
        let ports = &signature.inputs;
        match ports.iter().position(|port| port.name == input.port.text) {
            Some(port) => {
                let node = (spec.name.text.as_str(), kind);
                wires[port] = reachable.wire(node, signature, &ports[port], input, resolver, report);
                if let Some(found) = reachable.switched_off(kind, &ports[port], input, wires[port].as_ref()) {
                    report.push(found);
                }
            }
            None => unknown_input(kind, ports, input, report),
        }
    }
    if let Some((kind, signature)) = known_ports.filter(|_| !report.is_full()) {
        missing_inputs(kind, &signature.inputs, spec, reachable, report);
    }
    LinkedNode { name: spec.name.clone(), types: types.clone(), wires, reads, is_score: false }
}

fn unknown_input(kind: &NodeKind, ports: &[Port], input: &InputSpec, report: &mut Report) {
    let known: Vec<&str> = ports.iter().map(|port| port.name).collect();
    let what = format!("`{}` has no input `{}`", kind.declaration.kind, input.port.text);
    let error = Diagnostic::error(&input.port.place, what).label("no such input");
    report.push(error.maybe_help(names::suggestion(&input.port.text, "inputs", &known)));
}

fn missing_inputs(
    kind: &NodeKind,
    ports: &[Port],
    spec: &NodeSpec,
    reachable: &Reachable<'_, '_, '_>,
    report: &mut Report,
) {
    let unknown = spec.inputs.iter().map(|input| input.port.text.as_str());
    let unknown: Vec<&str> = unknown.filter(|name| !ports.iter().any(|port| port.name == *name)).collect();
    // A misspelt input was reported with a suggestion.
    let is_suggested = |port: &Port| unknown.iter().any(|written| names::nearest(written, [port.name]).is_some());
    let written = |input: &InputSpec| !matches!(input.from, Some(Wired::Nothing));
    let wired = |port: &Port| {
        spec.inputs.iter().any(|input| input.port.text == port.name && written(input)) || is_suggested(port)
    };
    let missing: Vec<&Port> = ports.iter().filter(|port| !port.optional && !wired(port)).collect();
    // A score without ground truth or estimate was reported where it is written.
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
