//! `stereo/bm`: OpenCV's block matching.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Disparity, Image};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::bm::{self, BmScratch, Params, Prefilter};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::refused;
use crate::grey::grey;
use crate::shape::{filled, same_size};
use crate::tiles::HostTiles;

/// What is matched instead of brightness, under OpenCV's names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BmPrefilter {
    /// The horizontal Sobel derivative: `PREFILTER_XSOBEL`.
    #[default]
    Xsobel,
    /// The difference from the mean of a window: `PREFILTER_NORMALIZED_RESPONSE`.
    NormalizedResponse,
}

/// OpenCV's parameters of `StereoBM`, with OpenCV's defaults.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BmParams {
    /// How many disparities are searched, px (`numDisparities`): a multiple of 16.
    #[schemars(range(min = 16, max = 2032), extend("multipleOf" = 16))]
    pub disparities: i32,
    /// Smallest disparity searched, px (`minDisparity`); may be negative.
    #[schemars(range(min = -2047, max = 2031))]
    pub min_disparity: i32,
    /// Side of the matched block, px (`blockSize`): odd, less than the image's width and height.
    #[schemars(range(min = 5, max = 255), extend("not" = { "multipleOf": 2 }))]
    pub block: i32,
    /// What is matched (`preFilterType`): `xsobel` or `normalized-response`.
    pub prefilter: BmPrefilter,
    /// Side of the window of `normalized-response`, px (`preFilterSize`): odd.
    #[schemars(range(min = 5, max = 255), extend("not" = { "multipleOf": 2 }))]
    pub prefilter_size: i32,
    /// Clip of the prefilter (`preFilterCap`).
    #[schemars(range(min = 1, max = 63))]
    pub prefilter_cap: i32,
    /// Least sum of absolute prefiltered values in the block (`textureThreshold`); what has less is not answered.
    #[schemars(range(min = 0))]
    pub texture_threshold: i32,
    /// Per cent by which the best sum must beat all others (`uniquenessRatio`); 0 switches the check off.
    #[schemars(range(min = 0))]
    pub uniqueness: i32,
    /// Largest difference allowed by the left-right check, px (`disp12MaxDiff`); below 0 switches it off.
    pub disp12_max_diff: i32,
    /// Largest region, px, that the speckle filter removes (`speckleWindowSize`); 0 switches it off.
    #[schemars(range(min = 0))]
    pub speckle_window: i32,
    /// Largest disparity step inside a region of the speckle filter (`speckleRange`), in 1/16 px: `StereoBM` takes it so, `StereoSGBM` in px.
    #[schemars(range(min = 0))]
    pub speckle_range: i32,
}

impl Default for BmParams {
    fn default() -> Self {
        let Params { min_disparity, disparities, block, prefilter_size, prefilter_cap, .. } = Params::default();
        let Params { texture_threshold, uniqueness, disp12_max_diff, .. } = Params::default();
        let Params { speckle_window, speckle_range, .. } = Params::default();
        let prefilter = BmPrefilter::Xsobel;
        Self {
            disparities,
            min_disparity,
            block,
            prefilter,
            prefilter_size,
            prefilter_cap,
            texture_threshold,
            uniqueness,
            disp12_max_diff,
            speckle_window,
            speckle_range,
        }
    }
}

impl BmParams {
    fn for_kernel(&self) -> Params {
        Params {
            min_disparity: self.min_disparity,
            disparities: self.disparities,
            block: self.block,
            prefilter: match self.prefilter {
                BmPrefilter::Xsobel => Prefilter::XSobel,
                BmPrefilter::NormalizedResponse => Prefilter::NormalizedResponse,
            },
            prefilter_size: self.prefilter_size,
            prefilter_cap: self.prefilter_cap,
            texture_threshold: self.texture_threshold,
            uniqueness: self.uniqueness,
            disp12_max_diff: self.disp12_max_diff,
            speckle_window: self.speckle_window,
            speckle_range: self.speckle_range,
        }
    }
}

/// The kind `stereo/bm`.
pub struct Bm {
    params: Params,
}

impl Node for Bm {
    type Params = BmParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "stereo/bm",
            version: 1,
            contract: Contract::Pure,
            summary: "Disparity of a rectified pair by OpenCV's block matching, bit for bit.",
            doc: "\
Sums of absolute differences of the prefiltered grey images over a square block, the smallest wins (Konolige, *Small Vision Systems*, 1997), as \
`cv::StereoBM` of OpenCV 5.0 computes them; every pixel is equal to OpenCV's. Excepted is what OpenCV computes from memory it never wrote: with \
`prefilter_cap` above 31 or `block` above 21 its left-right check misreads its own costs (here it reads them right), and some windows of \
`normalized-response` leave the image or a table (here borders repeat and responses are clipped).\n\n\
Disparity is fixed point, i16, 1/16 px of the left image, `(min_disparity - 1) * 16` where nothing was found. Without answer: pixels whose block does \
not lie inside the left image and, moved by the largest disparity, inside the right one.",
            inputs: vec![
                Port::frame("left", ValueType::Image, "The left image of a rectified pair, grey or RGB."),
                Port::frame("right", ValueType::Image, "The right image, of the same size."),
            ],
            outputs: vec![Port::frame(
                "disparity",
                ValueType::Disparity,
                "Disparity of the left image's pixels, 1/16 px fixed point.",
            )],
        }
    }

    fn check(params: &BmParams) -> Result<(), (&'static str, String)> {
        params.for_kernel().check().map_err(refused)
    }

    fn build(params: BmParams) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(Self { params: params.for_kernel() })))
    }
}

impl PureNode for Bm {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = (inputs.get::<Image>("left")?, inputs.get::<Image>("right")?);
        same_size(("left", left.dimensions()), ("right", right.dimensions()))?;
        let (left, right) = (grey(left), grey(right));
        let (width, height) = left.dimensions();
        let (columns, rows) = (width as usize, height as usize);
        let mut scratch = ctx.scratch.take::<BmScratch>();
        let mut result = Ok(());
        let sixteenths_px = filled((width, height), |out| {
            let tiles = HostTiles(ctx.host);
            result = bm::compute(left, right, columns, rows, &self.params, &mut scratch, &tiles, out);
        });
        ctx.scratch.put(scratch);
        result.map_err(|error| Fault::new(error.to_string()))?;
        Ok(Outputs::one("disparity", Disparity { sixteenths_px, min_disparity_px: self.params.min_disparity }))
    }
}
