//! What a node can know of its inputs before any frame.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde_json::Value as Json;

use super::Port;

/// What is wired to the input ports of a planned node.
pub struct Upstream<'a> {
    inputs: Vec<(&'static str, InputOrigin<'a>)>,
}

/// What computes or holds the value at an input port.
pub enum InputOrigin<'a> {
    /// The stage's source.
    Source,
    /// A node.
    Node(UpstreamNode<'a>),
    /// A file.
    File(&'a Path),
}

/// A node that another one reads.
pub struct UpstreamNode<'a> {
    /// Its name in the YAML file.
    pub name: &'a str,
    /// Its kind.
    pub kind: &'a str,
    /// Its parameters, resolved.
    pub params: &'a Json,
    /// Its input ports that are wired.
    pub wired: Vec<&'static str>,
}

impl<'a> Upstream<'a> {
    /// The wired ports and what gives their values.
    pub fn new(inputs: impl IntoIterator<Item = (&'a Port, InputOrigin<'a>)>) -> Self {
        Self { inputs: inputs.into_iter().map(|(port, origin)| (port.name, origin)).collect() }
    }

    /// What gives the value at a port; `None` where nothing is wired.
    pub fn at(&self, port: &str) -> Option<&InputOrigin<'a>> {
        self.inputs.iter().find(|(name, _)| *name == port).map(|(_, origin)| origin)
    }
}

impl UpstreamNode<'_> {
    /// Its parameters, if it is of this kind.
    pub fn params_of<P: DeserializeOwned>(&self, kind: &str) -> Option<P> {
        (self.kind == kind).then(|| P::deserialize(self.params).ok())?
    }

    /// Whether something is wired to its input port.
    pub fn is_wired(&self, port: &str) -> bool {
        self.wired.contains(&port)
    }
}
