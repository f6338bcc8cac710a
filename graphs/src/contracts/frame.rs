//! One instant of a source.

use std::sync::Arc;

/// One instant of a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// The source's own name for it, e.g. `000150_10`.
    pub id: Arc<str>,
    /// Its index in the source, counted before any selection.
    pub index: u64,
    /// The data set's time, or index x 100 ms; nanoseconds.
    pub time_ns: u64,
}

impl Frame {
    /// A frame of a source without timestamps: index x 100 ms, saturating.
    pub fn at_10_hz(id: impl Into<Arc<str>>, index: u64) -> Self {
        Self { id: id.into(), index, time_ns: index.saturating_mul(100_000_000) }
    }
}

#[cfg(test)]
mod tests {
    use super::Frame;

    #[test]
    fn fault_15_a_frame_whose_number_is_a_time_stamp_has_the_last_time_there_is() {
        assert_eq!(Frame::at_10_hz("a", 3).time_ns, 300_000_000);
        assert_eq!(Frame::at_10_hz("a", 1_317_042_164_317_412_775).time_ns, u64::MAX);
    }
}
