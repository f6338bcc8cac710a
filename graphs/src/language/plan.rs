//! Links the specs of all variants to kinds, and shares equal nodes: specs to the stage runs of a
//! [`Plan`](crate::plan::Plan).

pub(crate) mod assemble;
pub(crate) mod link;
pub(crate) mod linked;
pub(crate) mod live;
pub(crate) mod node_hash;
pub(crate) mod order;
pub(crate) mod record;
pub(crate) mod share;
pub(crate) mod stage_names;
pub(crate) mod topics;
pub(crate) mod upstream;
pub(crate) mod wire;
