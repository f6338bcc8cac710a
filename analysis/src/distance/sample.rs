//! A sample: the bits of an error, and whether its pixel is valid in all compared estimates.

/// The lowest bit of a sample is set if its pixel is not valid in all compared estimates. The bits of the error are
/// above it, so that samples sort like their errors. The sign of an error is not needed.
const ALONE: u32 = 1;

/// A non-negative error as an integer with the same order.
pub(super) const fn bits_from_error(error_m: f32) -> u32 {
    error_m.to_bits()
}

/// The error of [`bits_from_error`], metres.
pub(super) const fn error_from_bits(bits: u32) -> f32 {
    f32::from_bits(bits)
}

/// A sample: an error, and whether its pixel is valid in all compared estimates.
pub(super) const fn sample(error_m: f32, is_shared: bool) -> u32 {
    bits_from_error(error_m) << 1 | if is_shared { 0 } else { ALONE }
}

/// Whether a sample is of a valid pixel, whose error is not NaN.
pub(super) const fn is_valid(sample: u32) -> bool {
    error_bits(sample) <= f32::INFINITY.to_bits()
}

/// The bits of a sample's error.
pub(super) const fn error_bits(sample: u32) -> u32 {
    sample >> 1
}

/// Selects samples of an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Which {
    /// Valid pixels.
    Valid,
    /// Pixels that are valid in all compared estimates.
    Shared,
}

impl Which {
    /// Whether a sample is selected.
    pub(super) const fn has(self, sample: u32) -> bool {
        matches!(self, Self::Valid) || sample & ALONE == 0
    }
}

#[cfg(test)]
mod tests {
    use super::{bits_from_error, error_from_bits, is_valid, sample};

    #[test]
    fn only_a_sample_of_nan_is_not_valid() {
        for is_shared in [true, false] {
            assert!([0.0, 3.0, f32::MAX, f32::INFINITY].map(|error| is_valid(sample(error, is_shared))) == [true; 4]);
            assert!(!is_valid(sample(f32::NAN, is_shared)) && !is_valid(sample(-f32::NAN, is_shared)));
        }
    }

    #[test]
    fn bits_sort_like_errors() {
        let errors = [0.0, 1e-9, 1e-6, 0.25, 0.250_001, 3.0, 79.9];
        let bits = errors.map(bits_from_error);
        assert!(bits.is_sorted());
        assert_eq!(bits.map(error_from_bits), errors);
    }
}
