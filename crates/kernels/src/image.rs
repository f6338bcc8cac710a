//! Images before anything is estimated: grey and size.

pub mod grey;
pub mod resize;
