//! `stereo/sgbm`: OpenCV's semi-global block matching.

use depthloom_graphs::contracts::{Auto, Contract, NodeDeclaration, Signature};
use depthloom_graphs::values::{Disparity, Image, Raster, Weight};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::sgbm::{self, Maps, Mode, Params, Path, SgbmScratch, View};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::matcher::{disparity, matched, pair, refused, too_large};

/// OpenCV's parameters of `StereoSGBM`, with the paper's values as defaults.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SgbmParams {
    /// Number of disparities searched, px (`numDisparities`): a multiple of 16.
    #[schemars(range(min = 16, max = 2032), extend("multipleOf" = 16))]
    pub disparities: i32,
    /// Smallest disparity searched, px (`minDisparity`). It may be negative.
    #[schemars(range(min = -2047, max = 2031))]
    pub min_disparity: i32,
    /// Side of the matched block, px (`blockSize`): odd.
    #[schemars(range(min = 1, max = 255), extend("not" = { "multipleOf": 2 }))]
    pub block: i32,
    /// Penalty for a disparity step of one pixel between neighbours (`P1`). `auto` is `8 c block^2`, at most 8191, as
    /// in OpenCV's documentation; `c` is the number of channels matched, here 1 (grey). 0 means 2, as in OpenCV.
    #[schemars(extend("follows" = ["block"], "minimum" = 0, "maximum" = 32767))]
    pub p1: Auto<i32>,
    /// Penalty for any larger step (`P2`), greater than `p1`. `auto` is `32 c block^2`, at most 32767. 0 means 5, as
    /// in OpenCV.
    #[schemars(extend("follows" = ["block"], "minimum" = 0, "maximum" = 32767))]
    pub p2: Auto<i32>,
    /// Largest difference that the left-right check allows, px (`disp12MaxDiff`). OpenCV treats values of 0 and below
    /// as 1; only a very large value disables the check.
    pub disp12_max_diff: i32,
    /// Bound at which the horizontal Sobel prefilter is clipped (`preFilterCap`). OpenCV uses `max(cap, 15) | 1`.
    #[schemars(range(min = 0))]
    pub prefilter_cap: i32,
    /// Margin in per cent by which the best cost must beat all others (`uniquenessRatio`); 0 disables the check.
    #[schemars(range(min = 0, max = 99))]
    pub uniqueness: i32,
    /// Largest region that the speckle filter removes, px (`speckleWindowSize`); 0 disables the filter.
    #[schemars(range(min = 0))]
    pub speckle_window: i32,
    /// Largest disparity step inside a region of the speckle filter, px (`speckleRange`).
    #[schemars(range(min = 0))]
    pub speckle_range: i32,
    /// Directions along which costs are summed: `sgbm` (5), `hh` (8), `3way` (3) or `hh4` (4).
    pub mode: Mode,
    /// Match the left border by virtual columns. Both images are extended on the left by
    /// `max(min_disparity + disparities, 0)` copies of their first column (`cv::copyMakeBorder` with
    /// `BORDER_REPLICATE`), matched, and the extension is cut off.
    pub extend_left: bool,
    /// Output the disparity of the right image too.
    pub right: bool,
    /// Output the matching-cost ambiguity too.
    pub ambiguity: bool,
}

impl Default for SgbmParams {
    fn default() -> Self {
        let Params { min_disparity, disparities, block, disp12_max_diff, .. } = Params::default();
        let Params { prefilter_cap, uniqueness, speckle_window, speckle_range, .. } = Params::default();
        let Params { mode, extend_left, .. } = Params::default();
        Self {
            disparities,
            min_disparity,
            block,
            p1: Auto::Auto,
            p2: Auto::Auto,
            disp12_max_diff,
            prefilter_cap,
            uniqueness,
            speckle_window,
            speckle_range,
            mode,
            extend_left,
            right: false,
            ambiguity: false,
        }
    }
}

/// A quarter apart, as OpenCV advises, and within 16-bit costs.
const P1_MOST: i32 = P2_MOST / 4;
const P2_MOST: i32 = i16::MAX as i32;

impl SgbmParams {
    fn penalty(&self, each: i32, most: i32) -> i32 {
        each.saturating_mul(self.block.saturating_mul(self.block)).min(most)
    }

    fn for_kernel(&self) -> Params {
        Params {
            min_disparity: self.min_disparity,
            disparities: self.disparities,
            block: self.block,
            p1: self.p1.or_else(|| self.penalty(8, P1_MOST)),
            p2: self.p2.or_else(|| self.penalty(32, P2_MOST)),
            disp12_max_diff: self.disp12_max_diff,
            prefilter_cap: self.prefilter_cap,
            uniqueness: self.uniqueness,
            speckle_window: self.speckle_window,
            speckle_range: self.speckle_range,
            mode: self.mode,
            extend_left: self.extend_left,
        }
    }
}

pub(crate) struct Sgbm {
    params: Params,
    right: bool,
    ambiguity: bool,
}

fn outputs(params: &SgbmParams) -> Vec<Port> {
    let mut outputs = disparity();
    if params.right {
        let doc = "Disparity of the right image, negative, 1/16 px fixed point; invalid pixels hold \
                   `-(min_disparity + disparities) * 16`. With `right: true`.";
        outputs.push(Port::frame("right", ValueType::Disparity, doc));
    }
    if params.ambiguity {
        let doc = "Matching-cost ambiguity of the left image, f32 in [0, 1]; 1 where the disparity is invalid. With \
                   `ambiguity: true`.";
        outputs.push(Port::frame("ambiguity", ValueType::Weight, doc));
    }
    outputs
}

impl Node for Sgbm {
    type Params = SgbmParams;

    const OWN_PORTS: bool = true;

    const OWN_INPUTS: bool = false;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "stereo/sgbm",
            version: 1,
            contract: Contract::Pure,
            summary: "Disparity of a rectified pair by OpenCV's semi-global block matching (`StereoSGBM`), bit for bit.",
            doc: "\
Birchfield-Tomasi costs on x-Sobel and grey values, summed over a block and along 3 to 8 directions (Hirschmueller, \
*Stereo Processing by Semiglobal Matching and Mutual Information*, 2008). Every pixel equals the result of \
`cv::StereoSGBM` of OpenCV 5.0 on the grey images.\n\n\
Disparity is fixed point, i16, in 1/16 px of the left image. Invalid pixels hold `(min_disparity - 1) * 16`. The \
first `max(min_disparity + disparities, 0)` columns and the last `max(-min_disparity, 0)` columns are not searched \
and are invalid.\n\n\
With `extend_left`, the first columns are searched too, among disparities that point to virtual columns. Every pixel \
equals OpenCV's on the extended images, speckle filter included. A disparity `d` at a column `x < d` is a guess of \
the neighbourhood: the right image does not show the pixel.\n\n\
With `right: true`, the disparity of the right image follows from the same costs, without a second matcher. A right \
pixel takes the cheapest of the left pixels that it could be, the smallest disparity among equals, with the sub-pixel \
step of the left image. It has the median, but no uniqueness check, left-right check or speckle filter, as with \
`cv::ximgproc::createRightMatcher`. Without `extend_left`, its first columns see only large disparities; its last \
columns always see only small ones. `disparity/left-right` takes it as `right`.\n\n\
With `ambiguity: true`, each pixel has the smallest cost divided by the smallest cost farther than 1 px from the best \
disparity. It is 1 where both are 0, and where the disparity is invalid. Of the pixels before the median, those with \
at most `1 - r / 100` pass `uniqueness: r` (in `3way`, those below it).\n\n\
In mode `sgbm`, a frame of 1242x375 pixels with 64 disparities takes about 19 ms on one core (Zen 4). Of the \
instructions, `extend_left` adds about 9 %, `right` 27 % and `ambiguity` 9 %.",
            inputs: pair(),
            outputs: outputs(&SgbmParams { right: true, ambiguity: true, ..SgbmParams::default() }),
        }
    }

    fn signature(params: &SgbmParams) -> Option<Signature> {
        Some(Signature { contract: Contract::Pure, inputs: pair(), outputs: outputs(params), observes: None })
    }

    fn resolve(params: &mut SgbmParams) {
        let Params { p1, p2, .. } = params.for_kernel();
        (params.p1, params.p2) = (Auto::Value(p1), Auto::Value(p2));
    }

    fn check(params: &SgbmParams) -> Result<(), (&'static str, String)> {
        params.for_kernel().check().map_err(refused)
    }

    fn build(params: SgbmParams) -> Result<Instance, Fault> {
        let SgbmParams { right, ambiguity, .. } = params;
        Ok(Instance::Pure(Box::new(Self { params: params.for_kernel(), right, ambiguity })))
    }
}

impl PureNode for Sgbm {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let Self { params, .. } = self;
        let (width, height) = inputs.get::<Image>("left")?.dimensions();
        let mut right = self.right.then(|| Raster::<i16>::new(width, height));
        let mut ambiguity = self.ambiguity.then(|| Raster::<f32>::new(width, height));
        let mut outputs = matched(
            inputs,
            ctx,
            params.min_disparity,
            |images, (width, height), scratch: &mut SgbmScratch, tiles, out| {
                let [left, right_image] = images.map(|data| View { data, width, height, channels: 1 });
                let maps = Maps { disparity: out, right: right.as_deref_mut(), ambiguity: ambiguity.as_deref_mut() };
                let result = sgbm::compute_maps(Path::best(), &left, &right_image, params, scratch, tiles, maps);
                result.map_err(|error| match error {
                    sgbm::Error::Memory(error) => too_large(error, (width, height)),
                    error => Fault::new(error.to_string()),
                })
            },
        )?;
        if let Some(sixteenths_px) = right {
            let min_disparity_px = 1 - (params.min_disparity + params.disparities);
            outputs = outputs.with("right", Disparity { sixteenths_px, min_disparity_px });
        }
        if let Some(share) = ambiguity {
            outputs = outputs.with("ambiguity", Weight { share });
        }
        Ok(outputs)
    }
}
