//! Every kind of source and node that this program knows.

use depthloom_graphs::Registry;

/// Those of `nodes` and of `learning`.
pub fn registry() -> Registry {
    depthloom_learning::register(depthloom_nodes::registry())
}
