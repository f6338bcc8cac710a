//! `disparity/speckle`: removal of small regions.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Disparity;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::sgbm::{SpeckleScratch, filter_speckles};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::map::{invalid, pruned};
use crate::bounds::within;

/// Parameters of `disparity/speckle`; the defaults are in the middle of what OpenCV advises (50 to 200 px, 1 or 2 px).
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Speckle {
    /// Largest region that is removed, px (`maxSpeckleSize`); 0 removes none.
    pub window: u32,
    /// Largest disparity step between neighbours of one region, px (`maxDiff`), in multiples of 1/16 px.
    #[schemars(range(min = 0, max = 2047))]
    pub range: f64,
}

impl Default for Speckle {
    fn default() -> Self {
        Self { window: 100, range: 1.0 }
    }
}

impl Node for Speckle {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "disparity/speckle",
            version: 1,
            contract: Contract::Pure,
            summary: "Disparity without small isolated regions.",
            doc: "\
OpenCV's `filterSpeckles`. Two of the 4-connected neighbours belong to one region if both are valid and their \
disparities differ by at most `range`. Pixels of regions with at most `window` pixels become invalid.",
            inputs: vec![Port::frame("disparity", ValueType::Disparity, "Disparity, fixed or floating point.")],
            outputs: vec![Port::frame("disparity", ValueType::Disparity, "Disparity without speckles.")],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        within("range", params.range, " px", 0.0..=2047.0)
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for Speckle {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let map = inputs.get::<Disparity>("disparity")?;
        let (invalid, width) = (invalid(map)?, map.sixteenths_px.width() as usize);
        let mut scratch = ctx.scratch.take::<SpeckleScratch>();
        let (window, range) = (self.window as usize, (self.range * 16.0) as i32);
        let filtered = pruned(inputs.value("disparity"), map, |pixels| {
            filter_speckles(pixels, width, invalid, window, range, &mut scratch);
        });
        ctx.scratch.put(scratch);
        Ok(Outputs::one("disparity", filtered))
    }
}
