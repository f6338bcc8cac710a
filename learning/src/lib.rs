//! Self-supervised learning of still-mono networks: samples, networks, training, ONNX writing.
//!
//! A stage collects what stereo was confident of ([`samples`]: `learn/samples`); a once-node teaches a network with it ([`ssl`]: `learn/ssl`)
//! and gives an ONNX file ([`onnx`]) that `mono/onnx` runs. Networks are described once, for learning and for writing ([`networks`]). The
//! training library is burn; its convolutions on a CPU are ours ([`ops`]).

pub mod networks;
pub mod onnx;
pub mod ops;
pub mod samples;
pub mod ssl;

use depthloom_graphs::Registry;

/// Adds the kinds of this crate, one line each.
#[must_use]
pub fn register(registry: Registry) -> Registry {
    registry.node::<samples::CollectSamples>().node::<ssl::Ssl>()
}
