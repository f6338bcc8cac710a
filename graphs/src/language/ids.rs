//! Indices of what an experiment lists, in the order of the file.

use crate::index_type;

index_type! {
    /// Index of a stage: among the stages of a variant.
    pub(crate) struct StageId;
}

index_type! {
    /// Index of a node as written: among the nodes of a stage, then those of its `score:`.
    pub(crate) struct StageNodeId;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct StageNode {
    pub(crate) stage: StageId,
    pub(crate) node: StageNodeId,
}
