//! Checks samples of values that come from outside.

use super::{Calibration, Curve, Depth, Disparity, Number, Raster, RelativeInverseDepth, TrueDisparity, Value, Weight};

impl Value {
    /// Checks that the value is as its type documents. Called for all values that come from outside.
    ///
    /// # Errors
    /// A lower-case fragment; for a map, the first invalid pixel (row, column), its value, and what is allowed.
    pub fn validate(&self) -> Result<(), String> {
        match self {
            Self::Depth(depth) => depth.validate(),
            Self::RelativeDepth(map) => map.depth().validate(),
            Self::RelativeInverseDepth(map) => map.validate(),
            Self::Weight(weight) => weight.validate(),
            Self::Disparity(disparity) => disparity.validate(),
            // Made of finite numbers and NaN alone.
            Self::FloatDisparity(disparity) => disparity.fixed().validate(),
            Self::TrueDisparity(disparity) => disparity.validate(),
            Self::Calibration(calibration) => calibration.validate(),
            Self::Curve(curve) => curve.validate(),
            Self::Number(number) => number.validate(),
            // Every byte is a valid sample of an image or a mask. Nodes check the artifacts that they read.
            Self::Image(_)
            | Self::Mask(_)
            | Self::Scores(_)
            | Self::Samples(_)
            | Self::Model(_)
            | Self::Reliability(_) => Ok(()),
        }
    }
}

impl Depth {
    /// Depths are finite and greater than 0, or NaN.
    fn validate(&self) -> Result<(), String> {
        let is_invalid = |metres: f32| metres <= 0.0 || metres == f32::INFINITY;
        check_samples(
            &self.metres,
            " m",
            is_invalid,
            "a depth must be finite and greater than 0, or NaN where it is missing",
        )
    }
}

impl RelativeInverseDepth {
    /// Values are finite, or NaN.
    fn validate(&self) -> Result<(), String> {
        let allowed = "relative inverse depth must be finite, or NaN where it is missing";
        check_samples(&self.values, "", f32::is_infinite, allowed)
    }
}

impl Weight {
    /// Every weight is in [0, 1].
    fn validate(&self) -> Result<(), String> {
        let is_invalid = |share: f32| !(0.0..=1.0).contains(&share);
        check_samples(&self.share, "", is_invalid, "a weight must be in [0, 1]; 0 stands for no confidence")
    }
}

impl TrueDisparity {
    /// Measured disparities are finite, or NaN.
    ///
    /// # Errors
    /// The first pixel that is not.
    pub fn validate(&self) -> Result<(), String> {
        check_samples(&self.px, " px", f32::is_infinite, "a disparity must be finite, or NaN where it is unknown")
    }
}

impl Disparity {
    /// The invalid value fits 16 bits, and no value is between it and the smallest disparity.
    fn validate(&self) -> Result<(), String> {
        let missing = i16::try_from(self.invalid());
        let missing = missing
            .map_err(|_| format!("min_disparity is {} px, which must be in [-2047, 2047]", self.min_disparity_px))?;
        // `missing` is at most 32736: the sum fits.
        let is_invalid = |fixed: i16| fixed > missing && fixed < missing + 16;
        let allowed =
            "a disparity must be at least min_disparity; (min_disparity - 1) * 16 sixteenths stand for nothing found";
        check_samples(&self.sixteenths_px, "/16 px", is_invalid, allowed)
    }
}

impl Calibration {
    /// All numbers are finite, image size and focal length are greater than 0, and the baseline is not negative.
    fn validate(&self) -> Result<(), String> {
        if self.width == 0 || self.height == 0 {
            return Err(format!("its image size is {}x{}; both must be greater than 0", self.width, self.height));
        }
        let any = "finite";
        let numbers = [
            ("focal_px", self.focal_px, self.focal_px > 0.0, "finite and greater than 0"),
            ("cx_px", self.cx_px, true, any),
            ("cy_px", self.cy_px, true, any),
            (
                "baseline_m",
                self.baseline_m,
                self.baseline_m >= 0.0,
                "finite, and greater than 0 or, for a single camera, 0",
            ),
            ("doffs_px", self.doffs_px, true, any),
        ];
        for (name, number, is_allowed, allowed) in numbers {
            if !number.is_finite() || !is_allowed {
                return Err(format!("its `{name}` is {number:?}; it must be {allowed}"));
            }
        }
        Ok(())
    }
}

impl Curve {
    /// Steps ascend.
    fn validate(&self) -> Result<(), String> {
        match self.points.windows(2).find(|pair| pair[0].step >= pair[1].step) {
            Some(pair) => Err(format!("step {} comes after step {}; steps must ascend", pair[1].step, pair[0].step)),
            None => Ok(()),
        }
    }
}

impl Number {
    /// It is finite.
    fn validate(&self) -> Result<(), String> {
        if self.value.is_finite() { Ok(()) } else { Err(format!("it is {:?}; a number must be finite", self.value)) }
    }
}

/// Counts invalid samples in one pass without branches (SIMD), and locates the first only if there is one.
fn check_samples<T: image::Primitive + std::fmt::Debug>(
    raster: &Raster<T>,
    unit: &str,
    is_invalid: impl Fn(T) -> bool,
    allowed: &str,
) -> Result<(), String> {
    let samples = raster.as_raw();
    let count: u64 = samples
        .chunks(BLOCK)
        .map(|block| u64::from(block.iter().map(|sample| u32::from(is_invalid(*sample))).sum::<u32>()))
        .sum();
    if count == 0 {
        return Ok(());
    }
    let width = raster.width().max(1) as usize;
    let first = samples.iter().position(|sample| is_invalid(*sample)).unwrap_or_default();
    let (row, column, value) = (first / width, first % width, samples[first]);
    let others = if count > 1 { format!(" ({count} of {} pixels are invalid)", samples.len()) } else { String::new() };
    Err(format!("{value:?}{unit} at row {row}, column {column}{others}: {allowed}"))
}

/// A block's count fits into 32 bits, and a block into the first-level cache.
const BLOCK: usize = 4096;

#[cfg(test)]
mod tests {
    use super::super::{
        Calibration, Curve, CurvePoint, Depth, Disparity, Mask, Number, Raster, TrueDisparity, Value, Weight,
    };

    fn floats(samples: [f32; 6]) -> Raster<f32> {
        Raster::from_raw(3, 2, samples.to_vec()).expect("3x2")
    }

    fn error(value: impl Into<Value>) -> String {
        value.into().validate().expect_err("it is invalid")
    }

    #[test]
    fn depths_are_finite_and_positive_or_nan() {
        let valid = Value::from(Depth { metres: floats([1e-40, f32::NAN, -f32::NAN, f32::MAX, 1.0, 80.0]) });
        assert_eq!(valid.validate(), Ok(()));
        for invalid in [-5.0, 0.0, -0.0, f32::INFINITY, f32::NEG_INFINITY] {
            let what = error(Depth { metres: floats([1.0, f32::NAN, 2.0, 3.0, invalid, 4.0]) });
            assert!(
                what.starts_with(&format!(
                    "{invalid:?} m at row 1, column 1: a depth must be finite and greater than 0"
                )),
                "{what}"
            );
        }
        let what = error(Depth { metres: floats([1.0, -1.0, 1.0, -2.0, 1.0, 1.0]) });
        assert!(what.contains("-1.0 m at row 0, column 1 (2 of 6 pixels are invalid)"), "{what}");
    }

    #[test]
    fn weights_are_in_0_to_1() {
        assert_eq!(Value::from(Weight { share: floats([0.0, -0.0, 1.0, 0.5, 1e-40, 0.25]) }).validate(), Ok(()));
        for invalid in [7.5, 1.000_001, -1e-9, f32::NAN, f32::INFINITY] {
            let what = error(Weight { share: floats([0.0, 0.0, invalid, 0.0, 0.0, 0.0]) });
            assert!(what.starts_with(&format!("{invalid:?} at row 0, column 2: a weight must be in [0, 1]")), "{what}");
        }
    }

    #[test]
    fn measured_disparities_are_finite_or_nan() {
        let valid = Value::from(TrueDisparity { px: floats([0.0, -3.0, f32::NAN, 1.0, 2.0, 3.0]) });
        assert_eq!(valid.validate(), Ok(()));
        let what = error(TrueDisparity { px: floats([0.0, 0.0, 0.0, 0.0, 0.0, f32::NEG_INFINITY]) });
        assert!(what.starts_with("-inf px at row 1, column 2"), "{what}");
    }

    #[test]
    fn nothing_lies_between_a_missing_disparity_and_the_smallest_one() {
        let disparity = |min_disparity_px, samples: [i16; 6]| Disparity {
            sixteenths_px: Raster::from_raw(3, 2, samples.to_vec()).expect("3x2"),
            min_disparity_px,
        };
        assert_eq!(Value::from(disparity(0, [-16, 0, 1, i16::MAX, -17, i16::MIN])).validate(), Ok(()));
        assert_eq!(Value::from(disparity(-2, [-48, -32, 0, 1, 2, 3])).validate(), Ok(()));
        assert_eq!(Value::from(disparity(2047, [i16::MAX; 6])).validate(), Ok(()));
        let what = error(disparity(0, [0, 0, 0, -1, 0, 0]));
        assert!(what.starts_with("-1/16 px at row 1, column 0"), "{what}");
        assert!(error(disparity(2049, [0; 6])).contains("min_disparity is 2049 px"));
    }

    #[test]
    fn cameras_have_a_positive_size_and_focal_length_and_no_negative_baseline() {
        let (width, height) = (160, 48);
        let right =
            Calibration { width, height, focal_px: 90.0, cx_px: -1.0, cy_px: 0.0, baseline_m: 0.5, doffs_px: -3.0 };
        assert_eq!(Value::from(right.clone()).validate(), Ok(()));
        assert!(error(Calibration { focal_px: -90.0, ..right.clone() }).contains("`focal_px` is -90.0"));
        assert!(error(Calibration { baseline_m: -0.5, ..right.clone() }).contains("`baseline_m` is -0.5"));
        assert_eq!(Value::from(Calibration { baseline_m: 0.0, ..right.clone() }).validate(), Ok(()));
        assert!(error(Calibration { cx_px: f64::NAN, ..right.clone() }).contains("`cx_px` is NaN; it must be finite"));
        assert!(error(Calibration { doffs_px: f64::INFINITY, ..right.clone() }).contains("`doffs_px` is inf"));
        assert!(error(Calibration { width: 0, ..right }).contains("its image size is 0x48"));
    }

    #[test]
    fn steps_of_a_curve_ascend_and_any_byte_is_a_mask() {
        let point = |step| CurvePoint { step, loss: f64::NAN, validation: None, learning_rate: 0.1 };
        assert_eq!(Value::from(Curve { points: vec![point(1), point(20)] }).validate(), Ok(()));
        assert!(error(Curve { points: vec![point(20), point(20)] }).contains("step 20 comes after step 20"));
        let set = Raster::from_raw(3, 2, vec![0, 255, 0, 0, 0, 0]).expect("3x2");
        assert_eq!(Value::from(Mask { set }).validate(), Ok(()));
    }

    #[test]
    fn numbers_are_finite() {
        assert_eq!(Value::from(Number { value: -0.0 }).validate(), Ok(()));
        assert_eq!(error(Number { value: f64::NAN }), "it is NaN; a number must be finite");
    }

    #[test]
    fn pixels_of_the_last_block_are_checked() {
        let mut samples = vec![1.0; 3 * 4096 + 1];
        samples[3 * 4096] = -1.0;
        let what = error(Depth { metres: Raster::from_raw(1, 3 * 4096 + 1, samples).expect("one column") });
        assert!(what.starts_with("-1.0 m at row 12288, column 0:"), "{what}");
    }
}
