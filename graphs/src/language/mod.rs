//! The experiment language: a YAML file to a checked, shared [`Plan`](crate::plan::Plan).
//!
//! What a person wrote and what the program decided are two types. On the way: text, tree with places, one document out of `extends`, graph
//! files, `--set` and the environment; for each variant a spec, linked against the registry; all variants shared into
//! one plan. Errors are collected on the way and handed over together.

mod change;
mod diagnostics;
mod environment;
mod files;
mod kept;
mod link;
mod linked;
mod live;
mod load;
mod matrix;
mod merge;
mod names;
mod order;
mod overrides;
mod params;
mod parse;
mod paths;
mod recipe;
mod record;
mod reference;
mod resolved;
mod schema;
mod schema_check;
mod score;
mod share;
mod source_file;
mod spec;
mod topics;
mod tree;
mod upstream;
mod variants;
mod wire;

pub use crate::render::kind_reference as reference;
pub use diagnostics::{Diagnostic, Diagnostics, Related, Severity};
pub use load::{Environment, Loaded, Options, load};
pub use names::nearest;
pub(crate) use paths::is_operational;
pub use schema::schema;
pub(crate) use schema_check::range_text;
pub use source_file::{Place, SourceFile};
