//! Where stereo can be trusted: `confidence/*`.

mod edges;
mod sobel;

pub(crate) use edges::Edges;
pub(crate) use sobel::Sobel;
