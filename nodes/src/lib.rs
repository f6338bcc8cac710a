//! All kinds that a graph can contain: sources, stereo, mono, confidence, fusion, filter, score.
//!
//! Each kind is one file, grouped by family as in its YAML name (`stereo/sgbm` is `stereo/sgbm.rs`), and one line in
//! [`registry()`]. A kind wraps pixel kernels (`depthloom-kernels`) or formulas (`depthloom-scores`): here are the
//! parameters, the ports, the checks and the errors, no pixel arithmetic.
//!
//! ```
//! let registry = depthloom_nodes::registry();
//! let kind = registry.node_kind("depth/from-disparity").expect("it is registered");
//! let resolved = kind.resolve(&serde_json::json!({ "cap": 60.0 })).expect("a cap is a number");
//! assert_eq!(resolved["cap"], 60.0);
//! ```

pub mod dora;
pub mod grey;
pub mod onnx;
pub mod predictions;
pub mod process;
pub mod sources;

mod bounds;
mod confidence;
mod content_key;
mod depth;
mod disparity;
mod filter;
mod fusion;
mod geometry;
mod mono;
mod network;
mod registry;
mod score;
mod shape;
mod stereo;
mod tiles;

pub use geometry::needs_baseline;
pub use registry::registry;
