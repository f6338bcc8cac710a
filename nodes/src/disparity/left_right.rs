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
    /// Largest difference between the two disparities, px, in whole sixteenths; Hirschmueller (2008) and MC-CNN take 1.
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
            summary: "Disparity of the left image where the right image's disparity confirms it.",
            doc: "\
The consistency check of Hirschmueller (*Stereo Processing by Semiglobal Matching and Mutual Information*, 2008): a left pixel's disparity stays if the \
right image's pixel it points to is valid and answers the same, up to `max_difference`. What has no partner is mostly hidden in the right image. \
Where the partner lies between two pixels, agreeing with either is enough, as in `cv::validateDisparity`; a partner outside the image or without \
answer confirms nothing.\n\n\
The right image's disparity comes from a second matcher that is handed the images in exchange, as `cv::ximgproc::createRightMatcher` sets it up: \
`inputs: { left: source/right, right: source/left }` and `min_disparity: 1 - (min_disparity + disparities)` of the first; for 64 disparities from 0 \
that is -63. Its disparities are then the negative of the left image's.",
            inputs: vec![
                Port::frame("left", ValueType::Disparity, "Disparity of the left image's pixels, 1/16 px."),
                Port::frame("right", ValueType::Disparity, "Disparity of the right image's pixels, negative, 1/16 px."),
            ],
            outputs: vec![Port::frame(
                "disparity",
                ValueType::Disparity,
                "The left image's disparity, where confirmed.",
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
