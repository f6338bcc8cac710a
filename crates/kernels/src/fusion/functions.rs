//! Exponential and logarithm as polynomials: they vectorise, and give the same bits on every instruction set.
//!
//! The coefficients are those of Moshier's Cephes (`expf`, `logf`). Errors are below 2e-7 of the result.

/// Arguments are clamped to this range, where results are normal numbers.
const LARGEST: f32 = 87.0;

/// `e^x` for `x` in -87 to 87; beyond, the value at the bound. NaN gives no meaningful number.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    // Adding it moves the integer part into the lowest bits.
    const SHIFT: f32 = 12_582_912.0;
    // A comparison with NaN is false: NaN becomes the bound.
    let x = if x < LARGEST { x } else { LARGEST };
    let x = if x > -LARGEST { x } else { -LARGEST };
    let shifted = x * std::f32::consts::LOG2_E + SHIFT;
    let whole = shifted - SHIFT;
    let rest = x - whole * 0.693_359_4;
    let rest = rest - whole * -2.121_944_4e-4;
    let series = 1.987_569_1e-4;
    let series = series * rest + 1.398_199_9e-3;
    let series = series * rest + 8.333_452e-3;
    let series = series * rest + 4.166_579_6e-2;
    let series = series * rest + 1.666_666_5e-1;
    let series = series * rest + 0.5;
    let value = series * (rest * rest) + rest + 1.0;
    let power = f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0_f32.to_bits()));
    value * power
}

/// The natural logarithm of a positive normal number. Zero, subnormal numbers and infinity give finite numbers near
/// those of the smallest and largest normal number.
#[inline(always)]
pub(crate) fn ln(x: f32) -> f32 {
    // The exponent is chosen so that the mantissa is between the roots of 1/2 and 2.
    const ROOT_HALF: i32 = 0x3f35_04f3;
    let bits = x.to_bits() as i32;
    let exponent = bits.wrapping_sub(ROOT_HALF) >> 23;
    let rest = f32::from_bits(bits.wrapping_sub(exponent << 23) as u32) - 1.0;
    let exponent = exponent as f32;
    let square = rest * rest;
    let series = 7.037_684e-2;
    let series = series * rest - 1.151_461e-1;
    let series = series * rest + 1.167_699_9e-1;
    let series = series * rest - 1.242_014_1e-1;
    let series = series * rest + 1.424_932_3e-1;
    let series = series * rest - 1.666_805_8e-1;
    let series = series * rest + 2.000_071_5e-1;
    let series = series * rest - 2.499_999_4e-1;
    let series = series * rest + 3.333_333e-1;
    let tail = series * (rest * square) + exponent * -2.121_944_4e-4;
    rest + (tail - 0.5 * square) + exponent * 0.693_359_4
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_that_of_libm_in_all_but_the_last_digit() {
        for step in -87_000..=87_000 {
            let x = step as f32 / 1000.0;
            let expected = libm::exp(f64::from(x));
            assert!((f64::from(exp(x)) / expected - 1.0).abs() < 2e-7, "{x}: {} is not {expected}", exp(x));
        }
        assert_eq!(exp(0.0), 1.0);
        assert_eq!([exp(-1e30), exp(1e30)], [exp(-87.0), exp(87.0)]);
    }

    #[test]
    fn the_logarithm_is_that_of_libm_in_all_but_the_last_digit() {
        let mut x = 1.2e-38_f32;
        while x < 3e38 {
            let expected = libm::log(f64::from(x));
            let off = (f64::from(ln(x)) - expected).abs();
            assert!(off < 1e-7 * expected.abs().max(0.7), "{x}: {} is not {expected}", ln(x));
            x *= 1.000_31;
        }
        assert_eq!(ln(1.0), 0.0);
        assert!(ln(0.0).is_finite() && ln(f32::INFINITY).is_finite());
    }
}
