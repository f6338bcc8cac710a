//! Where stereo can be trusted: `confidence/*`.

mod edges;
mod sobel;

pub use edges::{Edges, EdgesParams};
pub use sobel::{Sobel, SobelParams};
