//! `depth/guided-upsampling`: fills gaps of a depth map, guided by the image.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Depth, Image};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::guided;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bounds::within;
use crate::grey::grey;
use crate::shape::{filled, same_size};

/// Parameters of `depth/guided-upsampling`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct GuidedUpsampling {
    /// Half the side of a window, px: windows are `2 radius + 1` wide. It doubles where no valid pixel is in reach.
    #[schemars(range(min = 1, max = 1000))]
    pub radius: u32,
    /// What is added to the variance of grey, which is in [0, 1]. Larger values follow the image less.
    #[schemars(range(min = 0.00000001, max = 1000))]
    pub epsilon: f64,
    /// Whether valid pixels are filtered as well; otherwise they stay as they are.
    pub smooth: bool,
}

impl Default for GuidedUpsampling {
    fn default() -> Self {
        Self { radius: 8, epsilon: 1e-3, smooth: false }
    }
}

impl Node for GuidedUpsampling {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "depth/guided-upsampling",
            version: 1,
            contract: Contract::Pure,
            summary: "Fills invalid depth from valid pixels with similar grey (masked guided filter).",
            doc: "\
The guided filter of He, Sun and Tang (*Guided Image Filtering*, 2010) with a mask. In every window, inverse depth is \
fitted as a linear function of grey, over the valid pixels of the window. A pixel takes the mean of the functions of \
all windows that contain it. On a map without gaps and with `smooth: true`, this is the guided filter of the paper. \
Inverse depth is filtered, because it is linear on planes.\n\n\
Where no window with a valid pixel contains a pixel, the filter runs again with twice the radius, until every pixel \
has a depth. Results stay between the smallest and the largest valid depth of the frame. A frame without valid pixels \
stays invalid.",
            inputs: vec![
                Port::frame("image", ValueType::Image, "The image that guides; same size as `depth`."),
                Port::frame("depth", ValueType::Depth, "Depth, metres, NaN = invalid."),
            ],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Depth without gaps, metres.")],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        within("radius", f64::from(params.radius), " px", 1.0..=1000.0)?;
        within("epsilon", params.epsilon, "", 1e-8..=1000.0)
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for GuidedUpsampling {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let guide = grey(inputs.get::<Image>("image")?);
        let depth = &inputs.get::<Depth>("depth")?.metres;
        let (width, height) = depth.dimensions();
        same_size(("image", guide.dimensions()), ("depth", (width, height)))?;
        let params = guided::Params { radius: self.radius as usize, epsilon: self.epsilon, smooth: self.smooth };
        let metres = filled((width, height), |out| {
            guided::upsample(guide.as_raw(), depth, width as usize, height as usize, &params, out);
        });
        Ok(Outputs::one("depth", Depth { metres }))
    }
}
