//! Memory that parameters and files ask for: bounded, and a refusal is an error.
//!
//! An allocation that fails ends the process. So where a size is made of more than the image at hand (a disparity
//! range, a network's word), it is compared with [`MOST_BYTES`] first, and then allocated by a call that can fail.

use std::fmt;

/// The most memory that one call is given at once, bytes: twice what semi-global matching of a 4K pair over 256
/// disparities takes.
pub const MOST_BYTES: u64 = 8 << 30;

/// More memory than there is for one call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooMuch {
    /// The requested bytes.
    pub bytes: u64,
}

impl TooMuch {
    /// Compares a number of bytes with [`MOST_BYTES`].
    ///
    /// # Errors
    /// If it is more.
    pub const fn check(bytes: u64) -> Result<(), Self> {
        if bytes > MOST_BYTES { Err(Self { bytes }) } else { Ok(()) }
    }
}

impl fmt::Display for TooMuch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
        if self.bytes > MOST_BYTES {
            write!(
                f,
                "{:.1} GiB of memory would be needed, and {:.0} GiB is the most",
                gib(self.bytes),
                gib(MOST_BYTES)
            )
        } else {
            write!(f, "{:.3} GiB of memory are needed, which this machine does not give", gib(self.bytes))
        }
    }
}

impl std::error::Error for TooMuch {}

/// The bytes of an array with these sides and `bytes_each`; at most [`u64::MAX`].
#[must_use]
pub fn bytes_of(sides: &[usize], bytes_each: usize) -> u64 {
    sides.iter().fold(bytes_each as u64, |bytes, &side| bytes.saturating_mul(side as u64))
}

/// Reserves room for `len` elements in total; the content stays.
///
/// # Errors
/// If that is too much for one call, or for the machine.
pub fn reserve<T>(buffer: &mut Vec<T>, len: usize) -> Result<(), TooMuch> {
    let bytes = bytes_of(&[len], size_of::<T>());
    TooMuch::check(bytes)?;
    buffer.try_reserve_exact(len.saturating_sub(buffer.len())).map_err(|_| TooMuch { bytes })
}

/// A vector of `len` zeros.
///
/// # Errors
/// As [`reserve`].
pub fn zeros<T: Clone + Default>(len: usize) -> Result<Vec<T>, TooMuch> {
    let mut buffer = Vec::new();
    reserve(&mut buffer, len)?;
    buffer.resize(len, T::default());
    Ok(buffer)
}

#[cfg(test)]
mod tests {
    use super::{MOST_BYTES, TooMuch, bytes_of, reserve, zeros};

    #[test]
    fn too_large_requests_are_refused_before_allocation() {
        let error = zeros::<f32>(3_000_000_000_000).unwrap_err().to_string();
        assert_eq!(error, "11175.9 GiB of memory would be needed, and 8 GiB is the most");
        let mut sums: Vec<u16> = vec![7; 3];
        let bytes = bytes_of(&[8192, 8192, 256], 2);
        assert_eq!(reserve(&mut sums, 8192 * 8192 * 256), Err(TooMuch { bytes }));
        assert_eq!((bytes, sums), (32 << 30, vec![7; 3]));
    }

    #[test]
    fn allocations_that_fit_succeed_and_overflows_fail() {
        assert_eq!(zeros::<u8>(3), Ok(vec![0; 3]));
        assert!(TooMuch::check(MOST_BYTES).is_ok());
        assert!(TooMuch::check(bytes_of(&[usize::MAX, usize::MAX], 4)).is_err());
    }
}
