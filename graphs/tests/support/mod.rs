//! Parts of experiments that several tests begin from: macros, so that constants can contain them.

#[macro_use]
mod lesson;

/// An experiment of one source and the stage `compare`, up to its nodes.
macro_rules! compare {
    () => {
        "experiment: base
sources: { test: { kind: synthetic/road } }
stages:
  compare:
    source: test
    nodes:
"
    };
}
