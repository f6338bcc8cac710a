//! The contracts between language, nodes, runner and recording.

/// Implements `JsonSchema` by a schema that is written out wherever the type is used.
macro_rules! inline_schema {
    ($name:ident, $($schema:tt)+) => {
        impl ::schemars::JsonSchema for $name {
            fn schema_name() -> ::std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn inline_schema() -> bool {
                true
            }

            fn json_schema(_: &mut ::schemars::SchemaGenerator) -> ::schemars::Schema {
                ::schemars::json_schema!($($schema)+)
            }
        }
    };
}

mod code;
mod context;
mod declared_ports;
mod fault;
mod frame;
mod frame_selection;
mod node;
mod observation;
mod params;
mod port;
mod signature;
mod sink;
mod source;
mod store;
mod stream;
mod upstream;

pub use crate::message::ErrorMessage;
pub use code::CodePath;
pub use context::{Context, Host, InlineHost, Scratch};
pub use declared_ports::{DeclaredPort, DeclaredPorts, check_name};
pub use fault::Fault;
pub use frame::Frame;
pub use frame_selection::FrameSelection;
pub use node::{AggregateNode, Inputs, Instance, Node, NodeDeclaration, OrderedNode, Outputs, PureNode};
pub use observation::{FramePaths, Observation};
pub use params::{Argument, Auto, DataPath};
pub use port::{Contract, Port, Rate};
pub use signature::Signature;
pub use sink::{Commit, Failure, NodeWarning, Sink, Slot, SlotKey, StoredValue, stored_values};
pub use source::{Fact, Recognised, Source, SourceDeclaration, SourceKind, SourceOutputs, Survey, SwitchedOff};
pub use store::{Store, StoredPort, StoredState};
pub use stream::{Drops, LiveCommit, NextFrame, StreamFrame, StreamingSource};
pub use upstream::{InputOrigin, Upstream, UpstreamNode};
