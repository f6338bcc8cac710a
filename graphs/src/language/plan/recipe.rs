//! Recipes: `H(kind, version, parameters, recipes of inputs)`.
//!
//! What does not change a node's outputs does not enter: its name, its variants, the order of keys, where files lie, which
//! source feeds it (a source's frame has a key of its own, see [`value_keys`](crate::value_keys)). A parameter that is a path enters by the
//! content of the file; if it is no file (a folder, or missing), by its last name only, and the kind's fingerprint says the rest,
//! which enters when the plan is made ready (see [`ready`](crate::ready)): a plan is made of what is written, not of what a machine has.
//! An unwired optional input does not enter, so that a kind can gain one without a new version.

use crate::key::Key;

pub(crate) enum InputRecipe<'a> {
    Source(&'static str),
    Node(&'a Key, &'static str),
    File(&'a Key),
}

pub(crate) fn of(kind: &str, version: u32, portable: &str, inputs: &[(&'static str, InputRecipe<'_>)]) -> Key {
    // The zero says that no engine has part in it.
    let mut builder = Key::build("recipe").text(kind).number(u64::from(version)).text(portable).number(0);
    let mut inputs: Vec<_> = inputs.iter().collect();
    inputs.sort_by_key(|(port, _)| *port);
    for (port, input) in inputs {
        builder = builder.text(port);
        builder = match input {
            InputRecipe::Source(output) => builder.text("source").text(output),
            InputRecipe::Node(recipe, output) => builder.text("node").key(recipe).text(output),
            InputRecipe::File(content) => builder.text("file").key(content),
        };
    }
    builder.finish()
}
