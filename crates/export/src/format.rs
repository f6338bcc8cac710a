//! The formats of files.

use clap::ValueEnum;

/// What values are exported as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// Images as they are; disparity and depth in 16 bits, 256ths of a pixel or metre, 0 = none, as KITTI has them;
    /// weights in 65535ths.
    Png,
    /// NumPy arrays: pixels of disparity, metres of depth as float32, NaN = none; images and masks as they are.
    Npy,
    /// Portable float maps, infinity = none, as Middlebury has them.
    Pfm,
    /// Point clouds of depths and disparities: metres, x to the right, y down, z forward, coloured by the source's
    /// first image.
    Ply,
    /// The same, as the Point Cloud Library has them.
    Pcd,
    /// Learnt networks.
    Onnx,
    /// Estimated reliabilities.
    Json,
    /// Rows: scores and calibrations by frame, learning curves by step; one file per topic.
    Parquet,
}

impl ExportFormat {
    /// As it is written on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Npy => "npy",
            Self::Pfm => "pfm",
            Self::Ply => "ply",
            Self::Pcd => "pcd",
            Self::Onnx => "onnx",
            Self::Json => "json",
            Self::Parquet => "parquet",
        }
    }
}
