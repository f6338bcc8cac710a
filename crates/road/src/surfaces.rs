//! What is seen of things: colours and patterns.

pub(crate) mod car;
pub(crate) mod facade;
pub(crate) mod ground;
pub(crate) mod material;
pub(crate) mod spot;
pub(crate) mod texture;
