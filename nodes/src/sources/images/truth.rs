//! Your own ground truth: the meaning of the numbers in a file.

use depthloom_graphs::values::Raster;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Meaning of the numbers in a file, after division.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum TruthUnit {
    /// Depth along the optical axis, metres.
    #[default]
    Metres,
    /// Depth, millimetres.
    Millimetres,
    /// Disparity, pixels of these images.
    Pixels,
}

impl TruthUnit {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Metres => "m",
            Self::Millimetres => "mm",
            Self::Pixels => "px",
        }
    }
}

/// Image to which the ground truth belongs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum TruthOf {
    /// The left image in its file.
    #[default]
    Left,
    /// The left image after rectification.
    Rectified,
}

/// Ground truth.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct ImagesTruth {
    /// Pattern of the files, as in `left`. With a `list`, its column `ground_truth` names them.
    pub files: Option<String>,
    /// Unit of the numbers: depth in `metres` or `millimetres`, or disparity in `pixels`.
    pub unit: TruthUnit,
    /// Divisor of the numbers in the files: 256 if they are disparity * 256 (KITTI), 5000 if they are metres * 5000.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub divide_by: f64,
    /// Image to which the ground truth belongs: `left` in its file, or `rectified`. If pairs are rectified when they
    /// are read, it must be `rectified`.
    pub of: TruthOf,
}

impl Default for ImagesTruth {
    fn default() -> Self {
        Self { files: None, unit: TruthUnit::default(), divide_by: 1.0, of: TruthOf::default() }
    }
}

impl ImagesTruth {
    pub(crate) fn is_of_more_bits(&self) -> bool {
        self.divide_by >= 256.0 || self.unit == TruthUnit::Millimetres
    }

    /// The warning for files of 8 bits: they hold whole metres, unless their numbers have another meaning.
    pub(crate) fn warning_of_8_bits(&self) -> Option<&'static str> {
        (self.unit == TruthUnit::Metres && self.divide_by == 1.0).then_some(
            "the ground truth has 8 bits and is read as whole metres, at most 255 m: if its numbers are disparities, \
             millimetres or scaled, set `ground_truth.unit` and `ground_truth.divide_by`",
        )
    }

    /// Metres or pixels; NaN for values that are not positive and finite.
    pub(crate) fn numbers(&self, numbers: &Raster<f32>) -> Raster<f32> {
        let divisor = match self.unit {
            TruthUnit::Millimetres => 1000.0 * self.divide_by,
            TruthUnit::Metres | TruthUnit::Pixels => self.divide_by,
        } as f32;
        converted(numbers, |number| if number > 0.0 && number.is_finite() { number / divisor } else { f32::NAN })
    }
}

fn converted(numbers: &Raster<f32>, of: impl Fn(f32) -> f32) -> Raster<f32> {
    let (width, height) = numbers.dimensions();
    let converted = numbers.iter().map(|number| of(*number)).collect();
    Raster::from_raw(width, height, converted).expect("as many samples as before")
}
