//! The sum of all values, and their types.

use std::fmt;
use std::sync::Arc;

use depthloom_scores::ScoreRow;

use super::{
    Artifact, Calibration, Curve, Depth, Disparity, FloatDisparity, Image, Mask, Number, RelativeDepth,
    RelativeInverseDepth, TrueDisparity, Weight,
};

/// The type that a value or a port has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ValueType {
    /// 8-bit grey or RGB image.
    Image,
    /// Estimated disparity: 1/16 px fixed point, or floating point where that is finer.
    Disparity,
    /// Measured disparity, pixels, NaN = unknown.
    TrueDisparity,
    /// Depth, f32 metres, NaN = invalid.
    Depth,
    /// Inverse depth of unknown scale and shift, f32, NaN = invalid.
    RelativeInverseDepth,
    /// Weight, f32 in [0, 1].
    Weight,
    /// Binary mask.
    Mask,
    /// Calibration of a rectified pair.
    Calibration,
    /// Rows of scores.
    Scores,
    /// Collected training samples.
    Samples,
    /// A trained network.
    Model,
    /// How reliable stereo and a monocular estimate are.
    Reliability,
    /// A learning curve.
    Curve,
    /// A number.
    Number,
}

impl ValueType {
    /// All types.
    pub const ALL: [Self; 14] = [
        Self::Image,
        Self::Disparity,
        Self::TrueDisparity,
        Self::Depth,
        Self::RelativeInverseDepth,
        Self::Weight,
        Self::Mask,
        Self::Calibration,
        Self::Scores,
        Self::Samples,
        Self::Model,
        Self::Reliability,
        Self::Curve,
        Self::Number,
    ];

    /// Whether its values are [`Artifact`]s, which are identified by their content and can be read from a file.
    #[must_use]
    pub const fn is_artifact(self) -> bool {
        matches!(self, Self::Samples | Self::Model | Self::Reliability)
    }

    /// The type with that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|value_type| value_type.name() == name)
    }

    /// The name used in documentation, plans and diagnostics.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Image => "image",
            Self::Disparity => "disparity",
            Self::TrueDisparity => "ground-truth-disparity",
            Self::Depth => "depth",
            Self::RelativeInverseDepth => "relative-inverse-depth",
            Self::Weight => "weight",
            Self::Mask => "mask",
            Self::Calibration => "calibration",
            Self::Scores => "scores",
            Self::Samples => "samples",
            Self::Model => "model",
            Self::Reliability => "reliability",
            Self::Curve => "curve",
            Self::Number => "number",
        }
    }
}

impl fmt::Display for ValueType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A value on an edge; cloning shares it.
#[derive(Clone, Debug)]
pub enum Value {
    /// 8-bit grey or RGB image.
    Image(Arc<Image>),
    /// Fixed-point disparity.
    Disparity(Arc<Disparity>),
    /// Disparity that is not a multiple of 1/16 px.
    FloatDisparity(Arc<FloatDisparity>),
    /// Measured disparity.
    TrueDisparity(Arc<TrueDisparity>),
    /// Depth in metres.
    Depth(Arc<Depth>),
    /// Depth in metres with inverse depth that metres cannot represent.
    RelativeDepth(Arc<RelativeDepth>),
    /// Inverse depth of unknown scale and shift.
    RelativeInverseDepth(Arc<RelativeInverseDepth>),
    /// Weight in [0, 1].
    Weight(Arc<Weight>),
    /// Binary mask.
    Mask(Arc<Mask>),
    /// Calibration of a rectified pair.
    Calibration(Arc<Calibration>),
    /// Rows of scores, one per zone and pixel set.
    Scores(Arc<Vec<ScoreRow>>),
    /// Collected training samples.
    Samples(Arc<Artifact>),
    /// A trained network.
    Model(Arc<Artifact>),
    /// How reliable stereo and a monocular estimate are, JSON.
    Reliability(Arc<Artifact>),
    /// The learning curve of a training.
    Curve(Arc<Curve>),
    /// A number of a frame.
    Number(Arc<Number>),
}

impl Value {
    /// An artefact as a value of a type; `None` for types of other values.
    pub fn from_artifact(value_type: ValueType, artifact: Arc<Artifact>) -> Option<Self> {
        match value_type {
            ValueType::Samples => Some(Self::Samples(artifact)),
            ValueType::Model => Some(Self::Model(artifact)),
            ValueType::Reliability => Some(Self::Reliability(artifact)),
            _ => None,
        }
    }

    /// The artefact, if it is one.
    pub const fn artifact(&self) -> Option<&Arc<Artifact>> {
        match self {
            Self::Samples(artifact) | Self::Model(artifact) | Self::Reliability(artifact) => Some(artifact),
            _ => None,
        }
    }

    /// Columns and rows of an image or a map; `None` for other values.
    pub fn dimensions(&self) -> Option<(u32, u32)> {
        Some(match self {
            Self::Image(image) => image.dimensions(),
            Self::Disparity(disparity) => disparity.sixteenths_px.dimensions(),
            Self::FloatDisparity(disparity) => disparity.px().dimensions(),
            Self::TrueDisparity(disparity) => disparity.px.dimensions(),
            Self::Depth(depth) => depth.metres.dimensions(),
            Self::RelativeDepth(map) => map.depth().metres.dimensions(),
            Self::RelativeInverseDepth(map) => map.values.dimensions(),
            Self::Weight(weight) => weight.share.dimensions(),
            Self::Mask(mask) => mask.set.dimensions(),
            Self::Calibration(_)
            | Self::Scores(_)
            | Self::Samples(_)
            | Self::Model(_)
            | Self::Reliability(_)
            | Self::Curve(_)
            | Self::Number(_) => return None,
        })
    }

    /// The value's type.
    pub const fn value_type(&self) -> ValueType {
        match self {
            Self::Image(_) => ValueType::Image,
            Self::Disparity(_) | Self::FloatDisparity(_) => ValueType::Disparity,
            Self::TrueDisparity(_) => ValueType::TrueDisparity,
            Self::Depth(_) | Self::RelativeDepth(_) => ValueType::Depth,
            Self::RelativeInverseDepth(_) => ValueType::RelativeInverseDepth,
            Self::Weight(_) => ValueType::Weight,
            Self::Mask(_) => ValueType::Mask,
            Self::Calibration(_) => ValueType::Calibration,
            Self::Scores(_) => ValueType::Scores,
            Self::Samples(_) => ValueType::Samples,
            Self::Model(_) => ValueType::Model,
            Self::Reliability(_) => ValueType::Reliability,
            Self::Curve(_) => ValueType::Curve,
            Self::Number(_) => ValueType::Number,
        }
    }
}

/// A Rust type that a [`Value`] can hold; nodes use it to read their inputs.
pub trait ValueKind: Sized + Send + Sync + 'static {
    /// The port types that use it.
    const TYPES: &'static [ValueType];

    /// The value inside, if it has this type.
    fn from_value(value: &Value) -> Option<&Arc<Self>>;
}

macro_rules! value_kind {
    ($ty:ty, $($variant:ident)|+) => {
        impl ValueKind for $ty {
            const TYPES: &'static [ValueType] = &[$(ValueType::$variant),+];

            fn from_value(value: &Value) -> Option<&Arc<Self>> {
                match value {
                    $(Value::$variant(inner) => Some(inner),)+
                    _ => None,
                }
            }
        }
    };
}

value_kind!(Image, Image);
value_kind!(TrueDisparity, TrueDisparity);
value_kind!(RelativeInverseDepth, RelativeInverseDepth);
value_kind!(Weight, Weight);
value_kind!(Mask, Mask);
value_kind!(Calibration, Calibration);
value_kind!(Vec<ScoreRow>, Scores);
value_kind!(Artifact, Samples | Model | Reliability);
value_kind!(Curve, Curve);
value_kind!(Number, Number);

impl ValueKind for Disparity {
    const TYPES: &'static [ValueType] = &[ValueType::Disparity];

    /// For floating point, the nearest fixed point.
    fn from_value(value: &Value) -> Option<&Arc<Self>> {
        match value {
            Value::Disparity(inner) => Some(inner),
            Value::FloatDisparity(map) => Some(map.fixed()),
            _ => None,
        }
    }
}

impl ValueKind for Depth {
    const TYPES: &'static [ValueType] = &[ValueType::Depth];

    fn from_value(value: &Value) -> Option<&Arc<Self>> {
        match value {
            Value::Depth(inner) => Some(inner),
            Value::RelativeDepth(map) => Some(map.depth()),
            _ => None,
        }
    }
}

macro_rules! into_value {
    ($ty:ty, $variant:ident) => {
        impl From<$ty> for Value {
            fn from(inner: $ty) -> Self {
                Self::$variant(Arc::new(inner))
            }
        }
    };
}

into_value!(Image, Image);
into_value!(Disparity, Disparity);
into_value!(TrueDisparity, TrueDisparity);
into_value!(Depth, Depth);
into_value!(RelativeInverseDepth, RelativeInverseDepth);
into_value!(Weight, Weight);
into_value!(Mask, Mask);
into_value!(Calibration, Calibration);
into_value!(Vec<ScoreRow>, Scores);
into_value!(Curve, Curve);
into_value!(Number, Number);
