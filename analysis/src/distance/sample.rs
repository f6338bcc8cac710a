//! A sample: the bits of an error, and whether its pixel is valid in all that are compared.

/// The lowest bit of a sample, which says: this pixel is not valid in all that are compared. The error's bits stand
/// above it, so that samples sort as their errors do; an error's own sign is never needed.
const ALONE: u32 = 1;

/// An error of zero or more as an integer that sorts as it does.
pub(super) const fn bits_from_error(error_m: f32) -> u32 {
    error_m.to_bits()
}

/// The error of [`bits_from_error`], metres.
pub(super) const fn error_from_bits(bits: u32) -> f32 {
    f32::from_bits(bits)
}

/// A sample: an error, and whether its pixel is valid in all that are compared.
pub(super) const fn sample(error_m: f32, is_shared: bool) -> u32 {
    bits_from_error(error_m) << 1 | if is_shared { 0 } else { ALONE }
}

/// The bits of a sample's error.
pub(super) const fn error_bits(sample: u32) -> u32 {
    sample >> 1
}

/// Which of an estimate's samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Which {
    /// Its valid pixels.
    Valid,
    /// Those that are also valid in all that it is compared with.
    Shared,
}

impl Which {
    /// Whether a sample is one of these.
    pub(super) const fn has(self, sample: u32) -> bool {
        matches!(self, Self::Valid) || sample & ALONE == 0
    }
}

#[cfg(test)]
mod tests {
    use super::{bits_from_error, error_from_bits};

    #[test]
    fn bits_sort_as_errors_do() {
        let errors = [0.0, 1e-9, 1e-6, 0.25, 0.250_001, 3.0, 79.9];
        let bits = errors.map(bits_from_error);
        assert!(bits.is_sorted());
        assert_eq!(bits.map(error_from_bits), errors);
    }
}
