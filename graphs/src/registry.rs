//! The kinds of nodes and sources an engine knows.

use std::any::type_name;
use std::collections::BTreeMap;
use std::path::Path;

use schemars::generate::SchemaSettings;
use serde_json::Value as Json;
use serde_path_to_error::Segment;

use crate::contracts::{
    Contract, Fault, Instance, Node, NodeDeclaration, Port, Recognised, Signature, Source, SourceDeclaration,
    SourceKind, StreamingSource, Survey, SwitchedOff, Upstream,
};
use crate::key::Key;

/// Why parameters do not fit a kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParamError {
    /// Where in the parameters, as keys and indices; empty for the parameters as a whole.
    pub path: Vec<String>,
    /// What is wrong: a lower-case fragment.
    pub what: String,
}

/// A node kind with erased types.
pub struct NodeKind {
    /// Name, version, ports and docs.
    pub declaration: NodeDeclaration,
    /// The JSON schema of its parameters.
    pub schema: Json,
    /// See [`Node::OWN_PORTS`].
    pub own_ports: bool,
    /// See [`Node::OWN_INPUTS`].
    pub own_inputs: bool,
    resolve: fn(&Json) -> Result<Json, ParamError>,
    signature: fn(&Json) -> Result<Option<Signature>, Fault>,
    pub(crate) check_inputs: fn(&Json, &Upstream<'_>) -> Result<(), Fault>,
    pub(crate) fingerprint: fn(&Json) -> Result<Option<Key>, Fault>,
    pub(crate) build: fn(&Json) -> Result<Instance, Fault>,
}

/// What kinds of nodes and of sources have in common.
#[derive(Clone, Copy)]
pub(crate) struct KindInfo<'r> {
    pub(crate) kind: &'static str,
    /// `None` for a source.
    pub(crate) contract: Option<Contract>,
    pub(crate) version: u32,
    pub(crate) summary: &'static str,
    pub(crate) doc: &'static str,
    pub(crate) inputs: &'r [Port],
    pub(crate) outputs: &'r [Port],
    pub(crate) own_ports: bool,
    pub(crate) own_inputs: bool,
    pub(crate) schema: &'r Json,
    pub(crate) resolve: fn(&Json) -> Result<Json, ParamError>,
}

impl KindInfo<'_> {
    pub(crate) fn contract_name(&self) -> &'static str {
        self.contract.map_or("source", Contract::name)
    }
}

impl NodeKind {
    pub(crate) const fn info(&self) -> KindInfo<'_> {
        let NodeDeclaration { kind, version, contract, summary, doc, inputs, outputs } = &self.declaration;
        let (version, contract) = (*version, Some(*contract));
        let (own_ports, own_inputs) = (self.own_ports, self.own_inputs);
        let (inputs, outputs) = (inputs.as_slice(), outputs.as_slice());
        let (schema, resolve) = (&self.schema, self.resolve);
        KindInfo { kind, contract, version, summary, doc, inputs, outputs, own_ports, own_inputs, schema, resolve }
    }

    /// The parameters with every default filled in.
    ///
    /// # Errors
    /// The first parameter that does not fit.
    pub fn resolve(&self, params: &Json) -> Result<Json, ParamError> {
        (self.resolve)(params)
    }

    /// See [`Node::signature`].
    ///
    /// # Errors
    /// If the parameters do not belong to this kind.
    pub fn signature(&self, resolved: &Json) -> Result<Signature, Fault> {
        Ok((self.signature)(resolved)?.unwrap_or_else(|| Signature::from(&self.declaration)))
    }

    /// A node ready to run, from resolved parameters.
    ///
    /// # Errors
    /// As [`Node::build`].
    pub fn build(&self, resolved: &Json) -> Result<Instance, Fault> {
        (self.build)(resolved)
    }
}

type OpenStream = fn(&Json) -> Result<Option<Box<dyn StreamingSource>>, Fault>;

/// A source kind with erased types.
pub struct SourceEntry {
    /// Name, version, ports and docs.
    pub declaration: SourceDeclaration,
    /// The JSON schema of its parameters.
    pub schema: Json,
    resolve: fn(&Json) -> Result<Json, ParamError>,
    outputs: fn(&Json) -> Result<Vec<Port>, Fault>,
    switched_off: fn(&Json) -> Result<Vec<SwitchedOff>, Fault>,
    open: fn(&Json) -> Result<Box<dyn Source>, Fault>,
    stream: OpenStream,
    survey: fn(&Json) -> Survey,
    recognise: fn(&Path) -> Vec<Recognised>,
}

impl SourceEntry {
    pub(crate) const fn info(&self) -> KindInfo<'_> {
        let SourceDeclaration { kind, version, summary, doc, outputs } = &self.declaration;
        let (version, contract, inputs, outputs) = (*version, None, &[], outputs.as_slice());
        let (own_ports, own_inputs) = (false, false);
        let (schema, resolve) = (&self.schema, self.resolve);
        KindInfo { kind, contract, version, summary, doc, inputs, outputs, own_ports, own_inputs, schema, resolve }
    }

    /// The parameters with every default filled in.
    ///
    /// # Errors
    /// The first parameter that does not fit.
    pub fn resolve(&self, params: &Json) -> Result<Json, ParamError> {
        (self.resolve)(params)
    }

    /// See [`SourceKind::outputs`].
    ///
    /// # Errors
    /// What is missing.
    pub fn outputs(&self, resolved: &Json) -> Result<Vec<Port>, Fault> {
        (self.outputs)(resolved)
    }

    /// See [`SourceKind::switched_off`].
    ///
    /// # Errors
    /// If the parameters do not belong to this kind.
    pub fn switched_off(&self, resolved: &Json) -> Result<Vec<SwitchedOff>, Fault> {
        (self.switched_off)(resolved)
    }

    /// The source, opened, from resolved parameters.
    ///
    /// # Errors
    /// As [`SourceKind::open`].
    pub fn open(&self, resolved: &Json) -> Result<Box<dyn Source>, Fault> {
        (self.open)(resolved)
    }

    /// See [`SourceKind::stream`]; from resolved parameters.
    ///
    /// # Errors
    /// As [`SourceKind::open`].
    pub fn stream(&self, resolved: &Json) -> Result<Option<Box<dyn StreamingSource>>, Fault> {
        (self.stream)(resolved)
    }

    /// See [`SourceKind::survey`]; from resolved parameters.
    pub fn survey(&self, resolved: &Json) -> Survey {
        (self.survey)(resolved)
    }

    /// See [`SourceKind::recognise`].
    pub fn recognise(&self, root: &Path) -> Vec<Recognised> {
        (self.recognise)(root)
    }
}

/// The kinds an engine knows, by name.
#[derive(Default)]
pub struct Registry {
    nodes: BTreeMap<&'static str, NodeKind>,
    sources: BTreeMap<&'static str, SourceEntry>,
    /// By kind, the type that declares it.
    types: BTreeMap<&'static str, &'static str>,
    clashes: Vec<RegisteredTwice>,
}

/// Two registrations declare the same kind.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("kind `{kind}` is registered twice: by `{first}` and by `{second}`")]
pub struct RegisteredTwice {
    /// The kind's name.
    pub kind: &'static str,
    /// The type that was registered first.
    pub first: &'static str,
    /// The type that was registered second; possibly the same.
    pub second: &'static str,
}

impl Registry {
    /// Adds a node kind.
    #[must_use]
    pub fn node<N: Node>(mut self) -> Self {
        let declaration = N::declaration();
        let entry = NodeKind {
            schema: schema_of::<N::Params>(),
            own_ports: N::OWN_PORTS,
            own_inputs: N::OWN_INPUTS,
            resolve: |json| resolve::<N::Params>(json, N::resolve, N::check),
            signature: |json| Ok(N::signature(&parse::<N::Params>(json)?)),
            check_inputs: |json, upstream| N::check_inputs(&parse::<N::Params>(json)?, upstream),
            fingerprint: |json| N::fingerprint(&parse::<N::Params>(json)?),
            build: |json| N::build(parse::<N::Params>(json)?),
            declaration,
        };
        if self.claim(entry.declaration.kind, type_name::<N>()) {
            self.nodes.insert(entry.declaration.kind, entry);
        }
        self
    }

    /// Adds a source kind.
    #[must_use]
    pub fn source<S: SourceKind>(mut self) -> Self {
        let entry = SourceEntry {
            declaration: S::declaration(),
            schema: schema_of::<S::Params>(),
            resolve: |json| resolve::<S::Params>(json, |_| {}, S::check),
            outputs: |json| S::outputs(&parse::<S::Params>(json)?),
            switched_off: |json| Ok(S::switched_off(&parse::<S::Params>(json)?)),
            open: |json| S::open(parse::<S::Params>(json)?),
            stream: |json| S::stream(parse::<S::Params>(json)?),
            survey: |json| match parse::<S::Params>(json) {
                Ok(params) => S::survey(params),
                Err(fault) => Survey::failed(fault),
            },
            recognise: S::recognise,
        };
        if self.claim(entry.declaration.kind, type_name::<S>()) {
            self.sources.insert(entry.declaration.kind, entry);
        }
        self
    }

    /// Adds all kinds of another registry.
    #[must_use]
    pub fn merge(mut self, other: Self) -> Self {
        let Self { mut nodes, mut sources, types, clashes } = other;
        for (kind, declared_by) in types {
            if self.claim(kind, declared_by) {
                self.nodes.extend(nodes.remove_entry(kind));
                self.sources.extend(sources.remove_entry(kind));
            }
        }
        self.clashes.extend(clashes);
        self
    }

    /// Checks that every kind was registered once. The first of two is used.
    ///
    /// # Errors
    /// The first kind that was registered twice.
    pub fn check(&self) -> Result<(), RegisteredTwice> {
        self.clashes.first().map_or(Ok(()), |clash| Err(clash.clone()))
    }

    /// `false` if the name is taken.
    fn claim(&mut self, kind: &'static str, declared_by: &'static str) -> bool {
        let first = *self.types.entry(kind).or_insert(declared_by);
        let is_free = !self.nodes.contains_key(kind) && !self.sources.contains_key(kind);
        if !is_free {
            self.clashes.push(RegisteredTwice { kind, first, second: declared_by });
        }
        is_free
    }

    /// The node kind of that name.
    pub fn node_kind(&self, kind: &str) -> Option<&NodeKind> {
        self.nodes.get(kind)
    }

    /// The source kind of that name.
    pub fn source_kind(&self, kind: &str) -> Option<&SourceEntry> {
        self.sources.get(kind)
    }

    pub(crate) fn kind(&self, kind: &str) -> Option<KindInfo<'_>> {
        self.node_kind(kind).map(NodeKind::info).or_else(|| self.source_kind(kind).map(SourceEntry::info))
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
    follow: fn(&mut P),
    check: fn(&P) -> Result<(), (&'static str, String)>,
) -> Result<Json, ParamError> {
    let step = |segment: &Segment| match segment {
        Segment::Seq { index } => index.to_string(),
        other => other.to_string(),
    };
    let mut params: P = serde_path_to_error::deserialize(json).map_err(|error| ParamError {
        path: error.path().iter().map(step).filter(|segment| segment != "?").collect(),
        what: error.inner().to_string(),
    })?;
    follow(&mut params);
    check(&params).map_err(|(name, what)| ParamError { path: vec![name.to_owned()], what })?;
    serde_json::to_value(&params).map_err(|error| ParamError { path: Vec::new(), what: error.to_string() })
}

#[cfg(test)]
mod tests {
    use super::Registry;
    use crate::contracts::{Contract, NodeDeclaration, SourceDeclaration};
    use crate::{Fault, Instance, Node, Source, SourceKind};

    macro_rules! node {
        ($name:ident, $kind:literal) => {
            struct $name;
            impl Node for $name {
                type Params = std::collections::BTreeMap<String, u8>;
                fn declaration() -> NodeDeclaration {
                    let (inputs, outputs) = (Vec::new(), Vec::new());
                    let (version, contract, summary, doc) = (1, Contract::Pure, stringify!($name), "");
                    NodeDeclaration { kind: $kind, version, contract, summary, doc, inputs, outputs }
                }
                fn build(_: Self::Params) -> Result<Instance, Fault> {
                    Err(Fault::new("only registered"))
                }
            }
        };
    }
    node!(Blur, "filter/blur");
    node!(Sharpen, "filter/sharpen");
    node!(OtherBlur, "filter/blur");

    struct BlurredRoad;
    impl SourceKind for BlurredRoad {
        type Params = std::collections::BTreeMap<String, u8>;
        fn declaration() -> SourceDeclaration {
            SourceDeclaration { kind: "filter/blur", version: 1, summary: "A source.", doc: "", outputs: Vec::new() }
        }
        fn open(_: Self::Params) -> Result<Box<dyn Source>, Fault> {
            Err(Fault::new("only registered"))
        }
    }

    #[test]
    fn a_kind_registered_twice_is_refused_by_name_and_the_first_is_known() {
        let checked = |registry: &Registry| registry.check().map_err(|clash| clash.to_string());
        let registry = Registry::default().node::<Blur>().node::<Sharpen>().node::<OtherBlur>();
        let here = module_path!();
        let clash = format!("kind `filter/blur` is registered twice: by `{here}::Blur` and by `{here}::OtherBlur`");
        assert_eq!(checked(&registry), Err(clash));
        assert_eq!(registry.node_kind("filter/blur").expect("the first stays").declaration.summary, "Blur");
        // A source of a node's name, either way round.
        assert!(Registry::default().node::<Blur>().source::<BlurredRoad>().check().is_err());
        assert!(Registry::default().source::<BlurredRoad>().node::<Blur>().check().is_err());
    }

    #[test]
    fn registries_compose_and_what_clashes_in_one_or_between_them_is_refused() {
        let blur = || Registry::default().node::<Blur>();
        let both = blur().merge(Registry::default().node::<Sharpen>());
        assert!(both.check().is_ok() && both.nodes().count() == 2);
        assert!(blur().merge(blur()).check().is_err());
        assert!(Registry::default().merge(blur().node::<Blur>()).check().is_err());
        assert!(blur().merge(Registry::default().source::<BlurredRoad>()).check().is_err());
    }
}
