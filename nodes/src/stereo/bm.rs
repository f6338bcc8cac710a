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
            summary: "Disparity of a rectified pair by OpenCV's block matching, bit for bit.",
            doc: "\
Sums of absolute differences of the prefiltered grey images over a square block, the smallest wins (Konolige, *Small Vision Systems*, 1997), as \
`cv::StereoBM` of OpenCV 5.0 computes them; every pixel is equal to OpenCV's. Excepted is what OpenCV computes from memory it never wrote: with \
`prefilter_cap` above 31 or `block` above 21 its left-right check misreads its own costs (here it reads them right), and some windows of \
`normalized-response` leave the image or a table (here borders repeat and responses are clipped).\n\n\
Disparity is fixed point, i16, 1/16 px of the left image, `(min_disparity - 1) * 16` where nothing was found. Without answer: pixels whose block does \
not lie inside the left image and, moved by the largest disparity, inside the right one.",
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
