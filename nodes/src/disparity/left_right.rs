//! `disparity/left-right`: the left-right check of two disparity maps.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Disparity;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::left_right;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::map::{invalid, pruned};
use crate::bounds::within;
use crate::shape::same_size;

/// Parameters of `disparity/left-right`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct LeftRight {
    /// Largest difference between the two disparities, px, in multiples of 1/16 px. Hirschmueller (2008) and MC-CNN
    /// use 1.
    #[schemars(range(min = 0, max = 4095))]
    pub max_difference: f64,
}

impl Default for LeftRight {
    fn default() -> Self {
        Self { max_difference: 1.0 }
    }
}

impl Node for LeftRight {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "disparity/left-right",
            version: 1,
            contract: Contract::Pure,
            summary: "Disparity of the left image where the right image's disparity agrees (left-right check).",
            doc: "\
The consistency check of Hirschmueller (*Stereo Processing by Semiglobal Matching and Mutual Information*, 2008). A \
left pixel keeps its disparity if the pixel it points to in the right image is valid and has the same disparity, up \
to `max_difference`. Pixels without such a partner are mostly occluded in the right image.\n\n\
If the partner is between two pixels, agreement with either of them is enough, as in `cv::validateDisparity`. A \
partner outside the image, or an invalid one, does not confirm.\n\n\
A second matcher computes the right image's disparity, as with `cv::ximgproc::createRightMatcher`. Give it the \
images exchanged: `inputs: { left: source/right, right: source/left }`. Set its `min_disparity` to `1 - \
(min_disparity + disparities)` of the first matcher: -63 for 64 disparities from 0. Its disparities are the \
negatives of the left image's.",
            inputs: vec![
                Port::frame("left", ValueType::Disparity, "Disparity of the left image's pixels, 1/16 px."),
                Port::frame("right", ValueType::Disparity, "Disparity of the right image's pixels, negative, 1/16 px."),
            ],
            outputs: vec![Port::frame(
                "disparity",
                ValueType::Disparity,
                "Disparity of the left image; invalid where the right image's does not agree.",
            )],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        within("max_difference", params.max_difference, " px", 0.0..=4095.0)
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for LeftRight {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = (inputs.get::<Disparity>("left")?, inputs.get::<Disparity>("right")?);
        let (width, height) = left.sixteenths_px.dimensions();
        same_size(("left", (width, height)), ("right", right.sixteenths_px.dimensions()))?;
        let invalid = (invalid(left)?, invalid(right)?);
        let max_difference = (self.max_difference * 16.0) as i32;
        let checked = pruned(inputs.value("left"), left, |pixels| {
            left_right::check(pixels, &right.sixteenths_px, width as usize, invalid, max_difference);
        });
        Ok(Outputs::one("disparity", checked))
    }
}
