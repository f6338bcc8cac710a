//! Reads one variant's document into types, and checks its parameters against the schemas of their kinds.

pub(crate) mod following;
mod free_numbers;
pub(crate) mod params;
pub(crate) mod reference;
pub(crate) mod schema;
pub(crate) mod schema_check;
pub(crate) mod score;
pub(crate) mod spec;
pub(crate) mod sweeps;
pub(crate) mod variables;
pub(crate) mod with_schema;
