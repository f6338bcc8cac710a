//! `stereo/bm`: OpenCV's block matching.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, PureNode};
use depthloom_kernels::bm::{self, BmScratch, Params};

use super::matcher::{disparity, matched, pair, refused};

pub(crate) struct Bm {
    params: Params,
}

impl Node for Bm {
    type Params = Params;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "stereo/bm",
            version: 1,
            contract: Contract::Pure,
            summary: "Disparity of a rectified pair by OpenCV's block matching (`StereoBM`), bit for bit.",
            doc: "\
Sums of absolute differences of the prefiltered grey images over a square block; the disparity with the smallest sum \
wins (Konolige, *Small Vision Systems*, 1997). Every pixel equals the result of `cv::StereoBM` of OpenCV 5.0, except \
where OpenCV reads memory that it did not write. With `prefilter_cap` above 31 or `block` above 21, OpenCV's \
left-right check misreads its own costs; here it reads them correctly. Some windows of `normalized-response` reach \
outside the image or a table in OpenCV; here borders are replicated and responses are clipped.\n\n\
Disparity is fixed point, i16, in 1/16 px of the left image. Invalid pixels hold `(min_disparity - 1) * 16`. A pixel \
is also invalid if its block is not completely inside the left image, or, shifted by the largest disparity, not \
inside the right image.",
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

impl PureNode for Bm {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let Self { params } = self;
        matched(
            inputs,
            ctx,
            params.min_disparity,
            |[left, right], (width, height), scratch: &mut BmScratch, tiles, out| {
                bm::compute(left, right, width, height, params, scratch, tiles, out)
                    .map_err(|error| Fault::new(error.to_string()))
            },
        )
    }
}
