//! Self-supervised learning of still-mono networks: samples, networks, training, ONNX writing.
//!
//! A stage collects what stereo was confident of (`samples`: the kind `learn/samples`); a once-node teaches a network with it (`ssl`: `learn/ssl`)
//! and gives an ONNX file (`onnx`) that `mono/onnx` runs. Networks are described once, for learning and for writing (`networks`). The
//! training library is burn; its convolutions on a CPU are ours (`ops`).
//!
//! All of it is reached through the kinds that [`register()`] adds:
//!
//! ```
//! use depthloom_graphs::Registry;
//!
//! let registry = depthloom_learning::register(Registry::default());
//! let kind = registry.node_kind("learn/ssl").expect("it is registered");
//! let resolved = kind.resolve(&serde_json::json!({ "network": "fcn-lite" })).expect("it is one of the networks");
//! assert_eq!(resolved["network"], "fcn-lite");
//! ```

mod networks;
mod onnx;
mod ops;
mod samples;
mod ssl;
#[cfg(test)]
mod written_networks;

use depthloom_graphs::Registry;

/// Adds the kinds of this crate, one line each.
#[must_use]
pub fn register(registry: Registry) -> Registry {
    registry.node::<samples::CollectSamples>().node::<ssl::Ssl>()
}
