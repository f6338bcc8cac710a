//! `stereo/census-sgm`: semi-global matching on census costs.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, PureNode};
use depthloom_kernels::census::{self, CensusScratch, Pair, Params};

use super::matcher::{disparity, matched, pair, refused, too_large};

pub(crate) struct CensusSgm {
    params: Params,
}

impl Node for CensusSgm {
    type Params = Params;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "stereo/census-sgm",
            version: 1,
            contract: Contract::Pure,
            summary: "Disparity of a rectified pair by semi-global matching on census features, as in libSGM.",
            doc: "\
The census feature of a pixel states which samples of a 9x7 window are darker than others (Zabih and Woodfill, \
*Non-parametric Local Transforms for Computing Visual Correspondence*, 1994). With `census: symmetric`, opposite \
samples are compared in pairs (Spangenberg, Langner and Rojas, *Weighted Semi-Global Matching and Center-Symmetric \
Census Transform for Robust Driver Assistance*, 2013). The feature does not depend on brightness, so the cameras may \
have different exposure.\n\n\
The number of differing bits is the matching cost. Costs are summed along 4 or 8 paths (Hirschmueller, *Stereo \
Processing by Semiglobal Matching and Mutual Information*, 2008). Then follow the uniqueness check, a sub-pixel \
parabola, 3x3 medians of both maps and the left-right check. The defaults are those of libSGM \
(github.com/fixstars/libSGM), except for `subpixel`.\n\n\
Differences from libSGM: a pixel whose partner is outside the right image is invalid, medians replicate the border, \
and black pixels are not masked.\n\n\
Disparity is fixed point, i16, in 1/16 px of the left image. Invalid pixels hold `(min_disparity - 1) * 16`. No \
features are computed within 4 columns and 3 rows of the border; pixels there get their disparities from the paths.",
            inputs: pair(),
            outputs: disparity(),
        }
    }

    fn check(params: &Params) -> Result<(), (&'static str, String)> {
        params.check().map_err(refused)
    }

    fn build(params: Params) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(Self { params })))
    }
}

impl PureNode for CensusSgm {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let Self { params } = self;
        matched(
            inputs,
            ctx,
            params.min_disparity,
            |[left, right], (width, height), scratch: &mut CensusScratch, tiles, out| {
                if out.is_empty() {
                    let what = format!("`left` is {width}x{height}, expected at least 1x1 px");
                    return Err(Fault::new(what));
                }
                let pair = Pair { left, right, width, height };
                census::compute(&pair, params, scratch, tiles, out).map_err(|error| match error {
                    census::Error::Memory(error) => too_large(error, (width, height)),
                    census::Error::Param(error) => Fault::new(error.to_string()),
                })
            },
        )
    }
}
