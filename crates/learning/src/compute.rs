//! Networks computed: maps of a batch, and gradients of the parameters.
//!
//! On the CPU by operations of our own ([`cpu`]): each image goes through the whole network on one thread, in memory
//! that the steps share; a layer reads its input where the layer before has left it. On a GPU by burn ([`library`]),
//! which is the reference of the tests too.

#[cfg(any(test, not(feature = "gpu")))]
mod cpu;
#[cfg(any(test, feature = "gpu"))]
pub(crate) mod library;
#[cfg(any(test, not(feature = "gpu")))]
mod plan;
#[cfg(test)]
mod tests;

/// What computes networks.
#[cfg(not(feature = "gpu"))]
pub(crate) use cpu::Engine;
#[cfg(feature = "gpu")]
pub(crate) use library::Engine;

/// What computes, with its version, as keys contain it. On the CPU the version changes with any bit of the results.
#[cfg(not(feature = "gpu"))]
pub(crate) const ARITHMETIC: &str = "cpu 1";
#[cfg(feature = "gpu")]
pub(crate) const ARITHMETIC: &str = library::VERSION;

/// Planes of a batch, as a network sees them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Input {
    pub(crate) values: Vec<f32>,
    /// Batch, planes, rows, columns.
    pub(crate) shape: [usize; 4],
}
