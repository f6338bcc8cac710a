//! Commands of recordings and their folders.

pub(crate) mod export;
pub(crate) mod info;
pub(crate) mod recover;
pub(crate) mod replay;
pub(crate) mod runs;
