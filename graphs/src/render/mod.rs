//! Plans and kinds as text and as JSON: diagrams, summaries, the reference of kinds.

mod diagram;
mod dot;
mod graph;
mod kinds;
mod mermaid;
mod reference;
mod summary;

pub use kinds::{kind_json, kinds_json};
pub use reference::{kind_reference, kinds_index};
