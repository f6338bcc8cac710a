//! The experiment language: a YAML file to a checked, shared [`Plan`](crate::plan::Plan).
//!
//! Each folder uses those before it: `text`, `change`, `check`, `plan`. Errors are collected and reported together.

mod blame;
mod change;
mod check;
mod document;
mod ids;
mod labels;
mod load;
mod plan;
mod text;
mod unused;

pub(crate) use check::params::changed_since;
pub use check::reference::Reference;
pub use check::schema::schema;
pub(crate) use check::schema_check::range_text;
pub(crate) use check::with_schema::{alternatives, has_type, is_operational};
pub use check::with_schema::{item, property};
pub use document::{Document, parameters};
pub use load::{Environment, Loaded, Options, load};
pub use text::diagnostics::{Diagnostic, Diagnostics, Related, Severity};
pub use text::glob::glob;
pub use text::names::check_name;
pub use text::names::nearest;
pub use text::source_file::{Place, SourceFile};
pub use text::tree::{Entry, Node, Tree};
pub use text::word::Word;
