//! The kinds of nodes and sources an engine knows.

use std::collections::BTreeMap;

use schemars::generate::SchemaSettings;
use serde_json::Value as Json;

use crate::contracts::{Fault, Instance, Node, NodeDeclaration, Source, SourceDeclaration, SourceKind, Upstream};
use crate::key::Key;

/// Why parameters do not fit a kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParamError {
    /// Where in the parameters, as keys and indices; empty for the parameters as a whole.
    pub path: Vec<String>,
    /// What is wrong: a lower-case fragment.
    pub what: String,
}

/// A node kind, its types erased.
pub struct NodeKind {
    /// Name, version, ports and docs.
    pub declaration: NodeDeclaration,
    /// The JSON schema of its parameters.
    pub schema: Json,
    resolve: fn(&Json) -> Result<Json, ParamError>,
    check_inputs: fn(&Json, &Upstream<'_>) -> Result<(), Fault>,
    fingerprint: fn(&Json) -> Result<Option<Key>, Fault>,
    build: fn(&Json) -> Result<Instance, Fault>,
}

impl NodeKind {
    /// The parameters with every default filled in.
    ///
    /// # Errors
    /// The first parameter that does not fit.
    pub fn resolve(&self, params: &Json) -> Result<Json, ParamError> {
        (self.resolve)(params)
    }

    /// See [`Node::check_inputs`].
    ///
    /// # Errors
    /// As there.
    pub fn check_inputs(&self, resolved: &Json, upstream: &Upstream<'_>) -> Result<(), Fault> {
        (self.check_inputs)(resolved, upstream)
    }

    /// See [`Node::fingerprint`].
    ///
    /// # Errors
    /// As there.
    pub fn fingerprint(&self, resolved: &Json) -> Result<Option<Key>, Fault> {
        (self.fingerprint)(resolved)
    }

    /// A node ready to run, from resolved parameters.
    ///
    /// # Errors
    /// As [`Node::build`].
    pub fn build(&self, resolved: &Json) -> Result<Instance, Fault> {
        (self.build)(resolved)
    }
}

/// A source kind, its types erased.
pub struct SourceEntry {
    /// Name, version, ports and docs.
    pub declaration: SourceDeclaration,
    /// The JSON schema of its parameters.
    pub schema: Json,
    resolve: fn(&Json) -> Result<Json, ParamError>,
    open: fn(&Json) -> Result<Box<dyn Source>, Fault>,
}

impl SourceEntry {
    /// The parameters with every default filled in.
    ///
    /// # Errors
    /// The first parameter that does not fit.
    pub fn resolve(&self, params: &Json) -> Result<Json, ParamError> {
        (self.resolve)(params)
    }

    /// The source, opened, from resolved parameters.
    ///
    /// # Errors
    /// As [`SourceKind::open`].
    pub fn open(&self, resolved: &Json) -> Result<Box<dyn Source>, Fault> {
        (self.open)(resolved)
    }
}

/// The kinds an engine knows, by name.
#[derive(Default)]
pub struct Registry {
    nodes: BTreeMap<&'static str, NodeKind>,
    sources: BTreeMap<&'static str, SourceEntry>,
}

impl Registry {
    /// Adds a node kind.
    #[must_use]
    pub fn node<N: Node>(mut self) -> Self {
        let declaration = N::declaration();
        let entry = NodeKind {
            schema: schema_of::<N::Params>(),
            resolve: |json| resolve::<N::Params>(json, N::check),
            check_inputs: |json, upstream| N::check_inputs(&parse::<N::Params>(json)?, upstream),
            fingerprint: |json| N::fingerprint(&parse::<N::Params>(json)?),
            build: |json| N::build(parse::<N::Params>(json)?),
            declaration,
        };
        self.nodes.insert(entry.declaration.kind, entry);
        self
    }

    /// Adds a source kind.
    #[must_use]
    pub fn source<S: SourceKind>(mut self) -> Self {
        let entry = SourceEntry {
            declaration: S::declaration(),
            schema: schema_of::<S::Params>(),
            resolve: |json| resolve::<S::Params>(json, S::check),
            open: |json| S::open(parse::<S::Params>(json)?),
        };
        self.sources.insert(entry.declaration.kind, entry);
        self
    }

    /// The node kind of that name.
    #[must_use]
    pub fn node_kind(&self, kind: &str) -> Option<&NodeKind> {
        self.nodes.get(kind)
    }

    /// The source kind of that name.
    #[must_use]
    pub fn source_kind(&self, kind: &str) -> Option<&SourceEntry> {
        self.sources.get(kind)
    }

    /// All node kinds by name.
    pub fn nodes(&self) -> impl Iterator<Item = &NodeKind> {
        self.nodes.values()
    }

    /// All source kinds by name.
    pub fn sources(&self) -> impl Iterator<Item = &SourceEntry> {
        self.sources.values()
    }
}

fn schema_of<P: schemars::JsonSchema>() -> Json {
    let settings = SchemaSettings::draft2020_12().with(|s| s.inline_subschemas = true);
    settings.into_generator().into_root_schema_for::<P>().to_value()
}

fn parse<P: serde::de::DeserializeOwned>(resolved: &Json) -> Result<P, Fault> {
    serde_path_to_error::deserialize(resolved)
        .map_err(|error| Fault::new(format!("parameter `{}`: {}", error.path(), error.inner())))
}

fn resolve<P: serde::Serialize + serde::de::DeserializeOwned>(
    json: &Json,
    check: fn(&P) -> Result<(), (&'static str, String)>,
) -> Result<Json, ParamError> {
    let params: P = serde_path_to_error::deserialize(json).map_err(|error| ParamError {
        path: error.path().iter().map(ToString::to_string).filter(|segment| segment != "?").collect(),
        what: error.inner().to_string(),
    })?;
    check(&params).map_err(|(name, what)| ParamError { path: vec![name.to_owned()], what })?;
    serde_json::to_value(&params).map_err(|error| ParamError { path: Vec::new(), what: error.to_string() })
}
