//! `score:` is sugar: each estimate becomes a pure node `score/depth`.

use std::sync::Arc;

use super::spec::{InputSpec, Instance, NodeSpec, ScoreSpec};
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Node, Tree};
use crate::language::text::word::Word;

/// The kind that scores are computed by.
pub(crate) const KIND: &str = "score/depth";

/// The name of an estimate's node; no node of a file can have it.
pub(crate) fn node_name(estimate: &str) -> String {
    format!("score.{estimate}")
}

/// The nodes that compute a stage's scores, one an estimate.
///
/// Keys of `score:` other than `truth` and `estimates` are parameters of every one of them; keys of an estimate other than
/// `from` are its own. Without `sets`, all true pixels are scored.
pub(crate) fn expanded(score: &ScoreSpec) -> Vec<NodeSpec> {
    score
        .estimates
        .iter()
        .map(|estimate| {
            let mut parameters = score.parameters.clone();
            parameters.retain(|entry| !estimate.parameters.iter().any(|own| own.key == entry.key));
            parameters.extend(estimate.parameters.iter().cloned());
            if !parameters.iter().any(|entry| entry.key == "sets") {
                parameters.push(all_pixels(&estimate.name.place));
            }
            let wired = |port: &str, from: &Option<InputSpec>| {
                from.clone().map(|from| InputSpec { port: Word { text: port.to_owned(), ..from.port }, ..from })
            };
            let inputs = [wired("estimate", &estimate.from), wired("truth", &score.truth)];
            NodeSpec {
                name: Word { text: node_name(&estimate.name.text), place: estimate.name.place.clone() },
                instance: Some(Instance {
                    kind: Word { text: KIND.to_owned(), place: score.place.clone() },
                    with: Some(Arc::new(Node::new(Tree::Map(parameters), score.place.clone()))),
                }),
                inputs: inputs.into_iter().flatten().collect(),
            }
        })
        .collect()
}

fn all_pixels(place: &Place) -> Entry {
    let scalar = |value| Arc::new(Node::new(value, place.clone()));
    let list = Tree::List(vec![scalar(Tree::Text("all".to_owned()))]);
    Entry { key: "sets".to_owned(), key_place: place.clone(), value: scalar(list) }
}
