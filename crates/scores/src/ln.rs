//! A natural logarithm of plain arithmetic.
//!
//! The system's differs in the last bit between machines (it picks instructions by the CPU), and it cannot be
//! vectorised; scores are recorded, and recordings of equal runs are equal files.

use depthloom_simd::{Level, Pass};

/// [`ln`] of each number, in vectors.
#[must_use]
pub fn logarithms(numbers: &[f64]) -> Vec<f64> {
    let mut logarithms = vec![0.0; numbers.len()];
    Level::best().run(Logarithms { numbers, out: &mut logarithms });
    logarithms
}

struct Logarithms<'a> {
    numbers: &'a [f64],
    out: &'a mut [f64],
}

impl Pass for Logarithms<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (out, number) in self.out.iter_mut().zip(self.numbers) {
            *out = ln(*number);
        }
    }
}

/// `ln x` of a positive, finite, normal `x`, to 2 units in the last place of a result that is not close to zero, and to
/// 4e-17 absolutely close to it.
///
/// `x = 2^k m` with `m` in `[sqrt(1/2), sqrt 2)`, `ln x = k ln 2 + 2 artanh s` with `s = (m - 1) / (m + 1)`, `|s|
/// <= 0.1716`; the series of artanh is cut where its next term is below 3e-18 of the first.
#[inline(always)] // for passes that are compiled for several instruction sets
#[must_use]
pub fn ln(x: f64) -> f64 {
    /// The bits of `sqrt(1/2)`.
    const LOWEST: u64 = 0x3fe6_a09e_667f_3bcd;
    /// Added to the exponent so that it stays positive: a logical shift vectorises, an arithmetic one does not.
    const BIAS: u64 = 1023 << 52;
    /// `2^52`: an integer below it, put into its mantissa, is that integer as a float.
    const TWO_52: u64 = 0x4330_0000_0000_0000;

    let bits = x.to_bits();
    let above = bits.wrapping_sub(LOWEST);
    let k_biased = above.wrapping_add(BIAS) >> 52;
    let k = f64::from_bits(k_biased | TWO_52) - (f64::from_bits(TWO_52) + 1023.0);
    let m = f64::from_bits(bits.wrapping_sub(above & (0xfff << 52)));
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let mut series = 1.0 / 21.0;
    for odd in [19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0] {
        series = series * z + 1.0 / odd;
    }
    // ln 2 in two parts: k times the first is exact, the second mends it.
    const LN_2_HIGH: f64 = 0.693_147_180_369_123_8;
    const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    k * LN_2_HIGH + (2.0 * s + (2.0 * s * z * series + k * LN_2_LOW))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::{ProptestConfig, prop_assert, proptest};

    use super::{ln, logarithms};

    #[test]
    fn powers_of_two_and_one_are_exact_multiples() {
        assert_eq!(ln(1.0), 0.0);
        for k in -40_i32..40 {
            let x = 2.0_f64.powi(k);
            assert!((ln(x) - f64::from(k) * std::f64::consts::LN_2).abs() <= f64::EPSILON * f64::from(k.abs()));
        }
    }

    #[test]
    fn logarithms_of_many_numbers_are_those_of_each() {
        let numbers: Vec<f64> = (0..37).map(|i| 1e-3 * f64::from(i * i) + 1e-4).collect();
        assert!(logarithms(&numbers).iter().zip(&numbers).all(|(found, number)| *found == ln(*number)));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        #[test]
        fn agrees_with_the_systems_logarithm(exponent in -300.0..300.0_f64, mantissa in 1.0..10.0_f64) {
            let x = mantissa * 10.0_f64.powf(exponent);
            let (ours, theirs) = (ln(x), x.ln());
            prop_assert!((ours - theirs).abs() <= 4.0 * f64::EPSILON * theirs.abs() + 4e-17, "{x}: {ours} {theirs}");
        }

        #[test]
        fn agrees_with_the_systems_logarithm_close_to_one(offset in -0.3..0.4_f64) {
            let (ours, theirs) = (ln(1.0 + offset), (1.0 + offset).ln());
            prop_assert!((ours - theirs).abs() <= 4.0 * f64::EPSILON * theirs.abs() + 4e-17, "{offset}: {ours} {theirs}");
        }
    }
}
