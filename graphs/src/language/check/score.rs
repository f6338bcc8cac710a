//! `score:` is an abbreviation: each estimate becomes a pure node, `score/depth` or `score/disparity`.

use std::sync::Arc;

use super::reference::Reference;
use super::spec::{InputSpec, Instance, NodeSpec, ScoreSpec, UNCERTAINTIES, Wired};
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Node, Tree};
use crate::language::text::word::Word;
use crate::registry::{NodeKind, Registry};
use crate::values::ValueType;

pub(crate) const DEPTH: &str = "score/depth";
pub(crate) const DISPARITY: &str = "score/disparity";

/// No node of a file can have this name.
pub(crate) fn node_name(estimate: &str) -> String {
    format!("score.{estimate}")
}

/// The kinds of scores that are registered.
pub(crate) fn kinds(registry: &Registry) -> impl Iterator<Item = &NodeKind> {
    [DEPTH, DISPARITY].into_iter().filter_map(|kind| registry.node_kind(kind))
}

pub(crate) fn is_kind(kind: &str) -> bool {
    [DEPTH, DISPARITY].contains(&kind)
}

/// The nodes of a stage's `score:`, one per estimate.
///
/// Keys of `score:` other than `truth`, `estimates` and the [clues](super::spec::CLUES) are parameters of all of
/// them, unless the estimate overrides them. Where depths and disparities are scored, each kind takes the keys it
/// knows. By default all pixels with ground truth are scored.
pub(crate) fn expanded(
    score: &ScoreSpec,
    registry: &Registry,
    type_of: &dyn Fn(&Reference) -> Option<ValueType>,
) -> Vec<NodeSpec> {
    let kind_of = |from: &Option<InputSpec>| {
        let reference = from.as_ref().and_then(|from| match from.from.as_ref()? {
            Wired::Reference(reference) => Some(reference),
            Wired::File(_) | Wired::Nothing => None,
        });
        let is_disparity = reference.and_then(type_of) == Some(ValueType::Disparity);
        if is_disparity && registry.node_kind(DISPARITY).is_some() { DISPARITY } else { DEPTH }
    };
    let kinds: Vec<&str> = score.estimates.iter().map(|estimate| kind_of(&estimate.from)).collect();
    let scored = score.estimates.iter().zip(&kinds);
    let node = |(estimate, kind): (&super::spec::EstimateSpec, &&str)| {
        let other = kinds.iter().find(|other| *other != kind).and_then(|other| registry.node_kind(other));
        let own = registry.node_kind(kind);
        let is_others =
            |key: &str| other.is_some_and(|other| knows(other, key)) && !own.is_some_and(|own| knows(own, key));
        let mut parameters = score.parameters.clone();
        parameters.retain(|entry| !is_others(&entry.key));
        parameters.retain(|entry| !estimate.parameters.iter().any(|own| own.key == entry.key));
        parameters.extend(estimate.parameters.iter().cloned());
        if !parameters.iter().any(|entry| entry.key == "sets") {
            parameters.push(all_pixels(&estimate.name.place));
        }
        let wired = |port: &str, from: &Option<InputSpec>| {
            from.clone().map(|from| InputSpec { port: Word { text: port.to_owned(), ..from.port }, ..from })
        };
        let truth = estimate.truth.as_ref().or(score.truth.as_ref()).cloned();
        let mut inputs: Vec<InputSpec> =
            [wired("estimate", &estimate.from), wired("ground_truth", &truth)].into_iter().flatten().collect();
        inputs.extend(estimate.clues.iter().cloned());
        // Inputs of all estimates apply to those whose kind has them.
        let takes = |port: &str| own.is_some_and(|own| own.declaration.inputs.iter().any(|input| input.name == port));
        // Its own uncertainty, of either form, replaces that of all estimates.
        let is_same = |own: &str, port: &str| own == port || [own, port].iter().all(|key| UNCERTAINTIES.contains(key));
        let overridden = |port: &str| estimate.clues.iter().any(|own| is_same(&own.port.text, port));
        inputs
            .extend(score.clues.iter().filter(|clue| takes(&clue.port.text) && !overridden(&clue.port.text)).cloned());
        NodeSpec {
            name: Word { text: node_name(&estimate.name.text), place: estimate.name.place.clone() },
            instance: Some(Instance {
                kind: Word { text: (*kind).to_owned(), place: score.place.clone() },
                with: Some(Arc::new(Node::new(Tree::Map(parameters), score.place.clone()))),
            }),
            inputs,
        }
    };
    scored.map(node).collect()
}

fn knows(kind: &NodeKind, parameter: &str) -> bool {
    kind.schema.get("properties").is_some_and(|properties| properties.get(parameter).is_some())
}

fn all_pixels(place: &Place) -> Entry {
    let scalar = |value| Arc::new(Node::new(value, place.clone()));
    let list = Tree::List(vec![scalar(Tree::Text("all".to_owned()))]);
    Entry { key: "sets".to_owned(), key_place: place.clone(), value: scalar(list) }
}
