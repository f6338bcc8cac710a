//! Filters of depth maps: `filter/*`.

mod median;

pub use median::{Median, MedianParams};
