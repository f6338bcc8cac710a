//! In which form a value is exported: which types have which, and a file's bytes.

use depthloom_codecs::files::{self, Cloud, Colours};
use depthloom_graphs::values::{Calibration, Image};
use depthloom_graphs::{Value, ValueType};

use crate::ExportFormat;

/// How a map becomes a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// An image as it is, a map in 16 bits.
    Png,
    /// In colours, from the first number of the range to the second.
    Coloured(Colours, (f64, f64)),
    /// As an array.
    Npy,
    /// As floats.
    Pfm,
    /// As points whose depth is in the range, PLY.
    Ply((f64, f64)),
    /// The same, PCD.
    Pcd((f64, f64)),
}

/// A file's content, and what its name ends in.
pub struct FileContent {
    /// The content.
    pub bytes: Vec<u8>,
    /// What the name ends in.
    pub ending: &'static str,
    /// Valid pixels whose number the format cannot store.
    pub clipped: u64,
}

/// The formats of a type, the default first; empty for types that are not exported.
pub(crate) const fn formats_of(value_type: ValueType) -> &'static [ExportFormat] {
    use ExportFormat::{Json, Npy, Onnx, Parquet, Pcd, Pfm, Ply, Png};
    match value_type {
        ValueType::Image | ValueType::Mask => &[Png, Npy],
        ValueType::Weight => &[Png, Npy, Pfm],
        ValueType::RelativeInverseDepth => &[Npy, Pfm],
        ValueType::Depth | ValueType::Disparity | ValueType::TrueDisparity => &[Png, Npy, Pfm, Ply, Pcd],
        ValueType::Model => &[Onnx],
        ValueType::Reliability => &[Json],
        ValueType::Scores | ValueType::Curve | ValueType::Calibration | ValueType::Number => &[Parquet],
        ValueType::Samples => &[],
    }
}

impl Form {
    /// The form of maps of a type in a format; `None` if it is not one of maps.
    pub fn for_maps(
        format: ExportFormat,
        value_type: ValueType,
        colours: Option<Colours>,
        range: Option<(f64, f64)>,
    ) -> Option<Self> {
        let points = range.map_or((0.0, f64::INFINITY), |(a, b)| (a.min(b), a.max(b)));
        Some(match (format, colours, usual_range(value_type)) {
            (ExportFormat::Png, Some(colours), Some(usual)) => Self::Coloured(colours, range.unwrap_or(usual)),
            (ExportFormat::Png, ..) => Self::Png,
            (ExportFormat::Npy, ..) => Self::Npy,
            (ExportFormat::Pfm, ..) => Self::Pfm,
            (ExportFormat::Ply, ..) => Self::Ply(points),
            (ExportFormat::Pcd, ..) => Self::Pcd(points),
            (ExportFormat::Onnx | ExportFormat::Json | ExportFormat::Parquet, ..) => return None,
        })
    }

    /// Whether it is made of points, for which there must be a calibration.
    pub const fn is_cloud(self) -> bool {
        matches!(self, Self::Ply(_) | Self::Pcd(_))
    }

    /// Suffix of the name of its folder: coloured maps are separate from those that hold numbers.
    pub const fn suffix(self) -> &'static str {
        match self {
            Self::Coloured(Colours::Turbo, _) => ".turbo",
            Self::Coloured(Colours::Viridis, _) => ".viridis",
            Self::Coloured(Colours::Magma, _) => ".magma",
            Self::Coloured(Colours::Grey, _) => ".grey",
            Self::Png | Self::Npy | Self::Pfm | Self::Ply(_) | Self::Pcd(_) => "",
        }
    }

    /// What names of its files end in; of an image that was a JPEG file they end in `jpg`.
    pub const fn ending(self) -> &'static str {
        match self {
            Self::Png | Self::Coloured(..) => "png",
            Self::Npy => "npy",
            Self::Pfm => "pfm",
            Self::Ply(_) => "ply",
            Self::Pcd(_) => "pcd",
        }
    }

    /// A value as a file; points with `calibration`, in the colours of `image`, without those at the depths `caps_m`.
    ///
    /// # Errors
    /// What is wrong with the value, as a lower-case fragment.
    pub fn file(
        self,
        value: &Value,
        calibration: Option<&Calibration>,
        image: Option<&Image>,
        caps_m: &[f32],
    ) -> Result<FileContent, String> {
        let cloud = |range| {
            let cloud = Cloud::new(value, calibration.ok_or("there is no calibration of it")?, image, range)?;
            Ok::<_, String>(cloud.without(caps_m))
        };
        let bytes = match self {
            Self::Png => {
                let png = files::png(value)?;
                return Ok(FileContent { bytes: png.bytes, ending: png.ending, clipped: png.clipped });
            }
            Self::Coloured(colours, range) => files::coloured_png(value, colours, range)?,
            Self::Npy => files::npy(value)?,
            Self::Pfm => files::pfm(value)?,
            Self::Ply(range) => files::ply(&cloud(range)?),
            Self::Pcd(range) => files::pcd(&cloud(range)?),
        };
        Ok(FileContent { bytes, ending: self.ending(), clipped: 0 })
    }
}

/// The default range of colours: equal in all frames and runs, so that pictures can be compared.
/// `None` for types without colours.
const fn usual_range(value_type: ValueType) -> Option<(f64, f64)> {
    match value_type {
        ValueType::Depth => Some((0.0, 80.0)),
        ValueType::Disparity | ValueType::TrueDisparity => Some((0.0, 128.0)),
        ValueType::Weight => Some((0.0, 1.0)),
        ValueType::Image
        | ValueType::Mask
        | ValueType::RelativeInverseDepth
        | ValueType::Calibration
        | ValueType::Scores
        | ValueType::Samples
        | ValueType::Model
        | ValueType::Reliability
        | ValueType::Curve
        | ValueType::Number => None,
    }
}
