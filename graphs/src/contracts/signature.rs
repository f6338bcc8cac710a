//! What goes in and out of one node, and how it is called.

use super::{Contract, Observation, Port};

/// How a node is called, and its ports: of all nodes of a kind those of its declaration, or of each node its own, where they follow from its
/// parameters ([`Node::signature`](super::Node::signature)).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signature {
    /// How it is called.
    pub contract: Contract,
    /// Input ports.
    pub inputs: Vec<Port>,
    /// Output ports. Of an ordered node, those with [`Rate::Once`](super::Rate) come from `finish`.
    pub outputs: Vec<Port>,
    /// What it observes of a frame besides its inputs. A pure node that has one is told which frame it is
    /// ([`PureNode::process_frame`](super::PureNode::process_frame)).
    pub observes: Option<Observation>,
}
