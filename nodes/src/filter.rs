//! Filters of depth maps: `filter/*`.

mod median;

pub(crate) use median::Median;
