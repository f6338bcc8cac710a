//! Plans and kinds as text and as JSON: diagrams, summaries, the reference of kinds.

mod by_name;
mod details;
mod diagram;
mod dot;
mod graph;
mod kinds;
mod mermaid;
mod plan_json;
mod reference;
mod summary;

pub use by_name::ByName;
pub use details::{parameter_details, port_details};
pub use graph::Graph;
pub use kinds::{Nodes, NodesKind, kind_json, kinds_json};
pub use plan_json::Plan;
pub(crate) use reference::parameter_help;
pub use reference::{enumeration, kind_reference, kinds_index};
