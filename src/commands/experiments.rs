//! Commands of experiments: write, check, plan and run one.

pub(crate) mod check;
pub(crate) mod cost;
pub(crate) mod dora;
pub(crate) mod dora_node;
pub(crate) mod graph;
pub(crate) mod live;
pub(crate) mod lsp;
pub(crate) mod new;
pub(crate) mod plan;
pub(crate) mod run;
pub(crate) mod synth;
