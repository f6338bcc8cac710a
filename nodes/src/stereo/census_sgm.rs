//! `stereo/census-sgm`: semi-global matching on census costs.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Disparity, Image};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::census::{self, Census, CensusScratch, Pair, Params, Paths};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::refused;
use crate::grey::grey;
use crate::shape::{filled, same_size, too_large};
use crate::tiles::HostTiles;

/// Which comparisons in the 9x7 window around a pixel make its feature.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CensusKind {
    /// Samples opposite each other: 31 bits (Spangenberg et al. 2013; libSGM's default).
    #[default]
    Symmetric,
    /// The centre and each sample around it: 62 bits (Zabih and Woodfill 1994).
    Full,
    /// As `full`, without the centre's row and column: 48 bits (libSGM's `CENSUS_9x7`).
    OffAxis,
}

/// libSGM's parameters, with its values as defaults, but for sub-pixel answers.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CensusSgmParams {
    /// How many disparities are searched, px: a multiple of 16.
    #[schemars(range(min = 16, max = 256), extend("multipleOf" = 16))]
    pub disparities: i32,
    /// Smallest disparity searched, px; may be negative.
    #[schemars(range(min = -2047, max = 2031))]
    pub min_disparity: i32,
    /// Penalty for a disparity change of one pixel between neighbours, bits (`P1`): at most `p2`.
    #[schemars(range(min = 0, max = 224))]
    pub p1: i32,
    /// Penalty for any larger change, bits (`P2`): at most 224 for `symmetric`, 193 for `full` and 207 for `off-axis` features.
    #[schemars(range(min = 0, max = 224))]
    pub p2: i32,
    /// Per cent by which the best cost must be below all others but its neighbours'; 5 is libSGM's `uniqueness` of 0.95, 0 switches the check off.
    #[schemars(range(min = 0, max = 99))]
    pub uniqueness: i32,
    /// Whether a parabola through the costs refines answers to 1/16 px; without it they are whole pixels.
    pub subpixel: bool,
    /// Largest difference allowed by the left-right check, px (`LR_max_diff`); below 0 the check is off.
    pub lr_max_diff: i32,
    /// Which comparisons make a pixel's feature: `symmetric`, `full` or `off-axis`.
    pub census: CensusKind,
    /// Along how many paths costs are summed: 4 (horizontal, vertical) or 8 (diagonal as well).
    #[schemars(extend("enum" = [4, 8]))]
    pub paths: i32,
}

impl Default for CensusSgmParams {
    fn default() -> Self {
        let Params { min_disparity, disparities, p1, p2, uniqueness, subpixel, lr_max_diff, .. } = Params::default();
        let (census, paths) = (CensusKind::Symmetric, 8);
        Self { disparities, min_disparity, p1, p2, uniqueness, subpixel, lr_max_diff, census, paths }
    }
}

impl CensusSgmParams {
    fn for_kernel(&self) -> Params {
        Params {
            min_disparity: self.min_disparity,
            disparities: self.disparities,
            p1: self.p1,
            p2: self.p2,
            uniqueness: self.uniqueness,
            subpixel: self.subpixel,
            lr_max_diff: self.lr_max_diff,
            census: match self.census {
                CensusKind::Symmetric => Census::Symmetric,
                CensusKind::Full => Census::Full,
                CensusKind::OffAxis => Census::OffAxis,
            },
            paths: if self.paths == 4 { Paths::Four } else { Paths::Eight },
        }
    }
}

/// The kind `stereo/census-sgm`.
pub struct CensusSgm {
    params: Params,
}

impl Node for CensusSgm {
    type Params = CensusSgmParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "stereo/census-sgm",
            version: 1,
            contract: Contract::Pure,
            summary: "Disparity of a rectified pair by semi-global matching on census features, as libSGM does it.",
            doc: "\
A pixel's census feature says which samples of a 9x7 window are darker than others (Zabih and Woodfill, *Non-parametric Local Transforms for \
Computing Visual Correspondence*, 1994; in pairs opposite each other: Spangenberg, Langner and Rojas, *Weighted Semi-Global Matching and \
Center-Symmetric Census Transform for Robust Driver Assistance*, 2013), whatever their brightness: cameras need not be exposed alike. The number of \
bits that differ is summed along 4 or 8 paths (Hirschmueller, *Stereo Processing by Semiglobal Matching and Mutual Information*, 2008); then come \
uniqueness, a sub-pixel parabola, 3x3 medians of both maps and the left-right check, with the values of libSGM (github.com/fixstars/libSGM). \
Unlike libSGM, a pixel whose partner lies outside of the right image has no answer, medians replicate the border, and black pixels \
are not masked.\n\n\
Disparity is fixed point, i16, 1/16 px of the left image, `(min_disparity - 1) * 16` where nothing was found. No features are computed within 4 \
columns and 3 rows of the border: what is answered there comes along the paths.",
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

    fn check(params: &CensusSgmParams) -> Result<(), (&'static str, String)> {
        if params.paths != 4 && params.paths != 8 {
            return Err(("paths", format!("paths is {}, which is neither 4 nor 8", params.paths)));
        }
        params.for_kernel().check().map_err(refused)
    }

    fn build(params: CensusSgmParams) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(Self { params: params.for_kernel() })))
    }
}

impl PureNode for CensusSgm {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = (inputs.get::<Image>("left")?, inputs.get::<Image>("right")?);
        same_size(("left", left.dimensions()), ("right", right.dimensions()))?;
        let (width, height) = left.dimensions();
        if width == 0 || height == 0 {
            return Err(Fault::new(format!("`left` is {width}x{height}: an image without pixels has no disparities")));
        }
        let (left, right) = (grey(left).as_raw(), grey(right).as_raw());
        let pair = Pair { left, right, width: width as usize, height: height as usize };
        let mut scratch = ctx.scratch.take::<CensusScratch>();
        let mut result = Ok(());
        let sixteenths_px = filled((width, height), |out| {
            result = census::compute(&pair, &self.params, &mut scratch, &HostTiles(ctx.host), out);
        });
        ctx.scratch.put(scratch);
        result.map_err(|error| match error {
            census::Error::Memory(error) => too_large(error, (width, height)),
            census::Error::Param(error) => Fault::new(error.to_string()),
        })?;
        let min_disparity_px = self.params.min_disparity;
        Ok(Outputs::one("disparity", Disparity { sixteenths_px, min_disparity_px }))
    }
}
