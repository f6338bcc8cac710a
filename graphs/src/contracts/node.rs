//! Nodes: pure, ordered, aggregate.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{Context, Contract, Fault, Frame, Port, Signature, Upstream};
use crate::values::ValueKind;
use crate::{Key, Value};

/// The values at a node's input ports, in the order its declaration lists them; `None` where unwired or absent.
#[derive(Clone, Debug)]
pub struct Inputs<'a> {
    ports: &'a [Port],
    values: &'a [Option<Value>],
}

impl<'a> Inputs<'a> {
    /// Pairs ports with their values.
    ///
    /// # Panics
    /// If the two differ in length.
    pub fn new(ports: &'a [Port], values: &'a [Option<Value>]) -> Self {
        assert_eq!(ports.len(), values.len(), "one value slot a port");
        Self { ports, values }
    }

    /// The value at a port; `None` if there is no value or no such port.
    pub fn value(&self, port: &str) -> Option<&'a Value> {
        self.values[self.ports.iter().position(|p| p.name == port)?].as_ref()
    }

    /// The value at a required port.
    ///
    /// # Errors
    /// If it has no value of that type: an error in the node's declaration, since the plan was checked.
    pub fn get<T: ValueKind>(&self, port: &str) -> Result<&'a Arc<T>, Fault> {
        self.optional(port)?.ok_or_else(|| Fault::new(format!("no value at input `{port}`")))
    }

    /// The value at an optional port.
    ///
    /// # Errors
    /// If the node declares no such port or the value is of another type.
    pub fn optional<T: ValueKind>(&self, port: &str) -> Result<Option<&'a Arc<T>>, Fault> {
        let slot = self.ports.iter().position(|p| p.name == port);
        let slot = slot.ok_or_else(|| Fault::new(format!("the node declares no input `{port}`")))?;
        let Some(value) = &self.values[slot] else { return Ok(None) };
        let typed = T::from_value(value);
        typed.map(Some).ok_or_else(|| Fault::new(format!("input `{port}` holds {}", value.value_type())))
    }
}

/// The values of a node by output port; a missing port is absent on this frame.
#[derive(Clone, Debug, Default)]
pub struct Outputs(Vec<(&'static str, Value)>);

impl Outputs {
    /// No values.
    pub const fn none() -> Self {
        Self(Vec::new())
    }

    /// One value.
    pub fn one(port: &'static str, value: impl Into<Value>) -> Self {
        Self(vec![(port, value.into())])
    }

    /// Adds a value.
    #[must_use]
    pub fn with(mut self, port: &'static str, value: impl Into<Value>) -> Self {
        self.0.push((port, value.into()));
        self
    }

    /// The values and their ports, in the order in which they were added.
    pub fn entries(&self) -> impl Iterator<Item = (&'static str, &Value)> {
        self.0.iter().map(|(port, value)| (*port, value))
    }

    /// The values in the order of the declared ports.
    ///
    /// # Errors
    /// If a value has an undeclared port or another type, or a required one is missing.
    pub fn in_order_of(self, ports: &[Port]) -> Result<Vec<Option<Value>>, Fault> {
        let mut ordered = vec![None; ports.len()];
        for (name, value) in self.0 {
            let Some(slot) = ports.iter().position(|p| p.name == name) else {
                return Err(Fault::new(format!("it sent a value at `{name}`, which it does not declare")));
            };
            if ports[slot].value_type != value.value_type() {
                let (declared, given) = (ports[slot].value_type, value.value_type());
                return Err(Fault::new(format!("it gave {given} at `{name}`, which is declared as {declared}")));
            }
            ordered[slot] = Some(value);
        }
        match ports.iter().zip(&ordered).find(|(port, value)| value.is_none() && !port.optional) {
            Some((port, _)) => Err(Fault::new(format!("it gave no value at `{}`", port.name))),
            None => Ok(ordered),
        }
    }
}

/// A node without memory between frames; several frames may be in it at once.
pub trait PureNode: Send + Sync {
    /// One frame's outputs from its inputs.
    ///
    /// # Errors
    /// What failed, for the person who runs the experiment.
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault>;

    /// One frame's outputs, of a node whose signature says that it observes the frame ([`Signature::observes`]).
    ///
    /// # Errors
    /// As [`PureNode::process`].
    fn process_frame(&self, _frame: &Frame, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.process(inputs, ctx)
    }

    /// Checks the aggregate values that come from files (all other inputs are absent) before the first frame.
    ///
    /// # Errors
    /// What is wrong with them.
    fn prepare(&self, _files: &Inputs<'_>) -> Result<(), Fault> {
        Ok(())
    }
}

/// A node that sees frames in order and may keep state.
pub trait OrderedNode: Send {
    /// The next frame's per-frame outputs.
    ///
    /// # Errors
    /// What failed; the node's stage ends.
    fn process(&mut self, frame: &Frame, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault>;

    /// After the last frame: the aggregate values (collected samples, running statistics).
    ///
    /// # Errors
    /// What failed.
    fn finish(self: Box<Self>, ctx: &mut Context<'_>) -> Result<Outputs, Fault>;
}

/// An aggregate node: it runs once, when its once-inputs are there.
pub trait OnceNode: Send + Sync {
    /// The once-outputs.
    ///
    /// # Errors
    /// What failed.
    fn run(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault>;
}

/// A node ready to run.
pub enum Instance {
    /// See [`PureNode`].
    Pure(Box<dyn PureNode>),
    /// See [`OrderedNode`].
    Ordered(Box<dyn OrderedNode>),
    /// See [`OnceNode`].
    Once(Box<dyn OnceNode>),
}

impl Instance {
    pub(crate) fn prepare(&self, files: &Inputs<'_>) -> Result<(), Fault> {
        match self {
            Self::Pure(node) => node.prepare(files),
            Self::Ordered(_) | Self::Once(_) => Ok(()),
        }
    }
}

/// The declaration of a node kind.
#[derive(Clone, Debug)]
pub struct NodeDeclaration {
    /// The kind's name in YAML, `family/name`.
    pub kind: &'static str,
    /// Raised whenever equal inputs give different outputs.
    pub version: u32,
    /// How it is called.
    pub contract: Contract,
    /// One sentence.
    pub summary: &'static str,
    /// Markdown: shapes, units, source (paper equation, OpenCV behaviour).
    pub doc: &'static str,
    /// Input ports.
    pub inputs: Vec<Port>,
    /// Output ports. Of an ordered node, those with [`Rate::Once`](super::Rate) come from `finish`.
    pub outputs: Vec<Port>,
}

impl From<&NodeDeclaration> for Signature {
    fn from(declaration: &NodeDeclaration) -> Self {
        let NodeDeclaration { contract, inputs, outputs, .. } = declaration;
        Self { contract: *contract, inputs: inputs.clone(), outputs: outputs.clone(), observes: None }
    }
}

/// A node kind: everything about it declared in one place.
pub trait Node: 'static {
    /// Its parameters. Their docs, defaults and ranges make the schema, the reference page and the checks. The
    /// language checks range attributes of schemars: `#[schemars(range(min = 1))]`, `extend("multipleOf" = 16)`, and
    /// `extend("not" = { "multipleOf": 2 })` for odd numbers.
    ///
    /// A parameter that affects how, not what, is computed (memory, threads, checkpoint interval) is declared
    /// `#[schemars(extend("operational" = true))]`. It is in no key and no recording. Nodes that differ only in such
    /// parameters are one node, with the parameters of the first.
    type Params: Serialize + DeserializeOwned + JsonSchema;

    /// Its name, version and ports.
    fn declaration() -> NodeDeclaration;

    /// Replaces [`Auto::Auto`](super::Auto) in parameters that follow others. Called first; it must not change
    /// parameters that are already resolved.
    fn resolve(_params: &mut Self::Params) {}

    /// Whether contract and ports follow from the parameters, see [`Node::signature`]. The declaration then lists the
    /// usual ports, for the reference.
    const OWN_PORTS: bool = false;

    /// Of a kind with [`Node::OWN_PORTS`], whether the inputs follow from the parameters too. If not, they are those of
    /// the declaration, and inputs are checked and completed whatever the parameters are.
    const OWN_INPUTS: bool = Self::OWN_PORTS;

    /// Contract and ports for parameters that passed [`Node::check`], if [`Node::OWN_PORTS`].
    /// `None`: those of the declaration.
    fn signature(_params: &Self::Params) -> Option<Signature> {
        None
    }

    /// Checks what no schema can express, e.g. that `p2` exceeds `p1`.
    ///
    /// # Errors
    /// The parameter's name and a lower-case fragment.
    fn check(_params: &Self::Params) -> Result<(), (&'static str, String)> {
        Ok(())
    }

    /// Checks the wiring as far as it is known before any frame.
    ///
    /// # Errors
    /// What does not fit, and the remedy.
    fn check_inputs(_params: &Self::Params, _upstream: &Upstream<'_>) -> Result<(), Fault> {
        Ok(())
    }

    /// What decides the outputs besides parameters and inputs, e.g. the version of an engine. It enters the recipe
    /// when the plan is made ready.
    ///
    /// # Errors
    /// What is missing on this machine, with its remedy.
    fn fingerprint(_params: &Self::Params) -> Result<Option<Key>, Fault> {
        Ok(None)
    }

    /// A node ready to run.
    ///
    /// # Errors
    /// What is missing (a file, a library), with its remedy; found before any frame is admitted.
    fn build(params: Self::Params) -> Result<Instance, Fault>;
}
