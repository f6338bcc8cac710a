//! Commands that describe the program, its kinds and this machine.

pub(crate) mod completions;
pub(crate) mod doctor;
pub(crate) mod man;
pub(crate) mod nodes;
pub(crate) mod schema;
