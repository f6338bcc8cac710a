//! Cache keys of values: computed from what a value was made of, never from where or when.
//!
//! A node has one key per frame, from which each output port derives its own. Inputs are in the order of the
//! declaration, `None` where unwired or absent. What a node observes of a frame is part of its key.

use crate::contracts::Frame;
use crate::key::{Key, KeyBuilder};

/// What a node observes of a frame besides its inputs.
#[derive(Clone, Copy, Debug)]
pub struct Observed<'a> {
    /// Id, index and time.
    pub frame: &'a Frame,
    /// The content of the files that it reads itself; see
    /// [`Observation::content`](crate::contracts::Observation::content).
    pub files: Option<Key>,
}

impl Observed<'_> {
    fn add_to(&self, builder: KeyBuilder) -> KeyBuilder {
        let Frame { id, index, time_ns } = self.frame;
        optional(builder.text(id).number(*index).number(*time_ns), self.files.as_ref())
    }
}

/// The key of one output port, from the key of the node or of the source's frame.
pub fn port(node: &Key, port: &str) -> Key {
    Key::build("port").key(node).text(port).finish()
}

/// The key of a pure node's values on one frame.
pub fn pure(node_hash: &Key, observed: Option<Observed<'_>>, inputs: &[Option<Key>]) -> Key {
    let builder = with_inputs(Key::build("pure").key(node_hash), inputs);
    match observed {
        Some(observed) => observed.add_to(builder.number(1)).finish(),
        None => builder.number(0).finish(),
    }
}

/// The key of an ordered node's values on one frame; `previous` is its key on the frame before.
pub fn ordered(node_hash: &Key, previous: Option<&Key>, observed: Observed<'_>, inputs: &[Option<Key>]) -> Key {
    let builder = with_inputs(optional(Key::build("ordered").key(node_hash), previous), inputs);
    observed.add_to(builder).finish()
}

/// The key of a node's values on one frame that something besides its inputs decided; see
/// [`Host::observe`](crate::Host::observe).
pub fn disturbed(key: &Key, observed: &Key) -> Key {
    Key::build("observed by a node").key(key).key(observed).finish()
}

/// The key of an ordered node's aggregate values; `last` is its key on the last frame.
pub fn finished(node_hash: &Key, last: Option<&Key>) -> Key {
    optional(Key::build("finished").key(node_hash), last).finish()
}

/// The key of an aggregate node's values; inputs by content hash where they are artifacts.
pub fn once(node_hash: &Key, inputs: &[Option<Key>]) -> Key {
    with_inputs(Key::build("once").key(node_hash), inputs).finish()
}

fn with_inputs(builder: KeyBuilder, inputs: &[Option<Key>]) -> KeyBuilder {
    inputs.iter().fold(builder.number(inputs.len() as u64), |builder, input| optional(builder, input.as_ref()))
}

fn optional(builder: KeyBuilder, key: Option<&Key>) -> KeyBuilder {
    match key {
        Some(key) => builder.number(1).key(key),
        None => builder.number(0),
    }
}

#[cfg(test)]
mod tests {
    use super::{Observed, finished, once, ordered, port, pure};
    use crate::{Frame, Key};

    #[test]
    fn a_key_changes_with_recipe_input_and_place_of_the_input() {
        let (node_hash, a, b) = (Key::of_content(b"recipe"), Key::of_content(b"a"), Key::of_content(b"b"));
        let key = pure(&node_hash, None, &[Some(a), Some(b)]);
        assert_eq!(key, pure(&node_hash, None, &[Some(a), Some(b)]));
        assert_ne!(key, pure(&node_hash, None, &[Some(b), Some(a)]));
        assert_ne!(key, pure(&node_hash, None, &[Some(a), None]));
        assert_ne!(key, pure(&a, None, &[Some(a), Some(b)]));
        assert_ne!(key, once(&node_hash, &[Some(a), Some(b)]));
    }

    #[test]
    fn ordered_keys_remember_every_frame_before() {
        let (node_hash, input) = (Key::of_content(b"recipe"), [Some(Key::of_content(b"input"))]);
        let frame = Frame::at_10_hz("a", 0);
        let observed = Observed { frame: &frame, files: None };
        let first = ordered(&node_hash, None, observed, &input);
        let second = ordered(&node_hash, Some(&first), observed, &input);
        assert_ne!(first, second);
        assert_ne!(finished(&node_hash, Some(&first)), finished(&node_hash, Some(&second)));
        assert_ne!(finished(&node_hash, None), finished(&node_hash, Some(&first)));
    }

    #[test]
    fn the_frame_and_the_files_that_a_node_observes_are_in_its_key() {
        let (node_hash, input) = (Key::of_content(b"recipe"), [Some(Key::of_content(b"input"))]);
        let frame = Frame::at_10_hz("a", 0);
        let others = [
            (Frame { id: "b".into(), ..frame.clone() }, None),
            (Frame { index: 1, ..frame.clone() }, None),
            (Frame { time_ns: 1, ..frame.clone() }, None),
            (frame.clone(), Some(Key::of_content(b"predictions"))),
        ];
        let observed = Observed { frame: &frame, files: None };
        for (frame, files) in &others {
            let other = Observed { frame, files: *files };
            assert_ne!(
                ordered(&node_hash, None, observed, &input),
                ordered(&node_hash, None, other, &input),
                "{other:?}"
            );
            assert_ne!(pure(&node_hash, Some(observed), &input), pure(&node_hash, Some(other), &input), "{other:?}");
        }
        assert_ne!(pure(&node_hash, Some(observed), &input), pure(&node_hash, None, &input));
    }

    #[test]
    fn ports_of_one_node_have_keys_of_their_own() {
        let node = Key::of_content(b"node");
        assert_ne!(port(&node, "mask"), port(&node, "weight"));
    }
}
