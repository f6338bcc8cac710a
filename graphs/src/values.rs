//! Immutable values on the edges of a graph, cheap to share.

mod artifact;
mod calibration;
mod curve;
mod depth;
mod difference;
mod disparity;
mod float_disparity;
mod image;
mod maps;
mod mask;
mod number;
mod relative_depth;
mod relative_inverse_depth;
mod true_disparity;
mod validate;
mod value;
mod weight;

pub use self::artifact::Artifact;
pub use self::calibration::Calibration;
pub use self::curve::{Curve, CurvePoint};
pub use self::depth::Depth;
pub use self::difference::{Differs, Place, ValueDifference, number};
pub use self::disparity::Disparity;
pub use self::float_disparity::FloatDisparity;
pub use self::image::{Encoded, Image, ImageFormat, Pixels};
pub use self::mask::Mask;
pub use self::number::Number;
pub use self::relative_depth::RelativeDepth;
pub use self::relative_inverse_depth::RelativeInverseDepth;
pub use self::true_disparity::TrueDisparity;
pub use self::value::{Value, ValueKind, ValueType};
pub use self::weight::Weight;

/// A single-channel raster, row-major, `width x height`.
pub type Raster<T> = ::image::ImageBuffer<::image::Luma<T>, Vec<T>>;
