//! `disparity/fill`: invalid pixels filled from the adjacent background.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Disparity;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_kernels::fill::fill_background;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::map::{changed, invalid};

/// Parameters of `disparity/fill`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Fill {
    /// Longest run of invalid pixels that is filled, px; `null` fills all, as KITTI's development kit does.
    pub longest: Option<u32>,
}

impl Node for Fill {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "disparity/fill",
            version: 1,
            contract: Contract::Pure,
            summary: "Disparity with invalid pixels filled from the adjacent background.",
            doc: "\
The algorithm is `interpolateBackground` of KITTI's development kit, which the benchmark applies to every submitted \
map.\n\n\
In each row, a run of invalid pixels takes the smaller disparity of its two ends. At the image border it takes the \
only neighbour. Then each column repeats its first valid disparity upwards and its last valid disparity downwards. \
Rows between others that have no valid pixel stay invalid.",
            inputs: vec![Port::frame("disparity", ValueType::Disparity, "Disparity, fixed or floating point.")],
            outputs: vec![Port::frame(
                "disparity",
                ValueType::Disparity,
                "Filled disparity, in the form of the input (fixed or floating point).",
            )],
        }
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for Fill {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let map = inputs.get::<Disparity>("disparity")?;
        let (invalid, width) = (invalid(map)?, map.sixteenths_px.width() as usize);
        let longest = self.longest.map_or(usize::MAX, |px| px as usize);
        if let Some(Value::FloatDisparity(floats)) = inputs.value("disparity") {
            let mut px = floats.px().clone();
            px.iter_mut().filter(|px| px.is_nan()).for_each(|px| *px = f32::NEG_INFINITY);
            fill_background(&mut px, width, f32::NEG_INFINITY, longest);
            return Ok(Outputs::one("disparity", Value::disparity_from_px(px)));
        }
        let filled = changed(map, |pixels| fill_background(pixels, width, invalid, longest));
        Ok(Outputs::one("disparity", filled))
    }
}
