//! Plans and kinds as text: diagrams, summaries, the reference of kinds.

mod diagram;
mod dot;
mod mermaid;
mod reference;
mod summary;

pub use reference::{kind_reference, kinds_index};
