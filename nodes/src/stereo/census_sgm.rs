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
columns and 3 rows of the border: pixels that are valid there come along the paths.",
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
                    let what = format!("`left` is {width}x{height}: an image without pixels has no disparities");
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
