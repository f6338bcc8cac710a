//! Contract and ports of one node.

use super::{Contract, Observation, Port};

/// Contract and ports of a node: those of its kind's declaration, or its own
/// ([`Node::signature`](super::Node::signature)).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signature {
    /// How it is called.
    pub contract: Contract,
    /// Input ports.
    pub inputs: Vec<Port>,
    /// Output ports. Of an ordered node, those with [`Rate::Once`](super::Rate) come from `finish`.
    pub outputs: Vec<Port>,
    /// What it observes of a frame besides its inputs; see
    /// [`PureNode::process_frame`](super::PureNode::process_frame).
    pub observes: Option<Observation>,
}
