//! Node hashes: `H(kind, version, parameters, node hashes of inputs)`.
//!
//! A node hash does not depend on a node's name, its variants, the order of keys, the location of files, or the source
//! (whose frames have their own keys, see [`value_keys`](crate::value_keys)). A path counts by the content of its
//! file; a folder or a missing file by its last name, and by the kind's fingerprint once the plan is
//! [`ready`](crate::ready). An unwired optional input does not count, so that a kind can gain one without a new
//! version.

use crate::key::Key;

pub(crate) enum InputHash<'a> {
    Source(&'static str),
    Node(&'a Key, &'static str),
    File(&'a Key),
}

pub(crate) fn node_hash(kind: &str, version: u32, portable: &str, inputs: &[(&'static str, InputHash<'_>)]) -> Key {
    // 0: without an engine.
    let mut builder = Key::build("recipe").text(kind).number(u64::from(version)).text(portable).number(0);
    let mut inputs: Vec<_> = inputs.iter().collect();
    inputs.sort_by_key(|(port, _)| *port);
    for (port, input) in inputs {
        builder = builder.text(port);
        builder = match input {
            InputHash::Source(output) => builder.text("source").text(output),
            InputHash::Node(node_hash, output) => builder.text("node").key(node_hash).text(output),
            InputHash::File(content) => builder.text("file").key(content),
        };
    }
    builder.finish()
}
