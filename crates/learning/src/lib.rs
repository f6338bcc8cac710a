//! Self-supervised training of monocular networks: samples, networks, training, ONNX export.
//!
//! A stage collects confident stereo (`samples`: the kind `learn/samples`); an aggregate node trains a network with it
//! (`ssl`: `learn/ssl`) and writes an ONNX file (`onnx`) that `mono/onnx` runs. `learn/online` (`online`) does both
//! in the background of the frames. Each network is described once, for
//! training and for export (`networks`).
//!
//! - Gradients are computed by operations of our own (`compute`), one image a thread. Their kernels read images as
//!   lines with zeros between rows, so that a convolution is a sum of shifted lines
//!   (`crates/kernels/src/filter/convolve`).
//! - The same bits with any number of workers and after any kill: randomness is a function of seed and step, gradients
//!   are added in the order of the images, and the pool of threads is no wider than the run's workers.
//! - A checkpoint is a file with a checksum. The runner names it by the key of the values that it leads to, and locks
//!   it: a second process trains without a checkpoint. The file is removed when the whole run is stored.
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

mod compute;
mod fusion;
mod networks;
mod online;
mod onnx;
mod samples;
mod ssl;
mod training;
#[cfg(test)]
mod written_networks;

use depthloom_graphs::Registry;

/// Adds the kinds of this crate, one line each.
#[must_use]
pub fn register(registry: Registry) -> Registry {
    registry
        .node::<samples::CollectSamples>()
        .node::<samples::CollectFusionSamples>()
        .node::<ssl::Ssl>()
        .node::<online::Online>()
        .node::<fusion::TrainFusion>()
}
