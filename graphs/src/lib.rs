//! The graph language: values, ports, contracts, and YAML to a checked, shared plan.
//!
//! This crate knows no node kind, no file format but YAML, and no thread. Node kinds register themselves in a
//! [`Registry`]; the language turns an experiment file into a [`plan::Plan`] against that registry; the runner
//! executes the plan through the [`contracts`].

pub mod contracts;
mod counted;
mod fingerprints;
mod ids;
pub mod key;
mod labels;
pub mod language;
mod message;
mod natural_order;
pub mod plan;
pub mod ready;
pub mod registry;
pub mod regular_file;
pub mod render;
pub mod value_keys;
pub mod values;

pub use contracts::{
    AggregateNode, Context, Fault, Frame, Host, Inputs, Instance, Node, OrderedNode, Outputs, Port, PureNode, Rate,
    Scratch, Source, SourceKind, SourceOutputs, Store, StoredPort,
};
pub use counted::counted;
pub use key::Key;
pub use message::{ErrorMessage, Remedied, chain};
pub use natural_order::natural_order;
pub use registry::Registry;
pub use values::{Value, ValueType};
