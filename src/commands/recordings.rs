//! Commands of recordings and their folders.

pub(crate) mod export;
pub(crate) mod runs;
pub(crate) mod verify;
