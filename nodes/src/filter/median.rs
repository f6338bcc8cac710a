//! `filter/median`: the median filter that ends the fusion.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::median::{median3_of_valid, median5_of_valid};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::shape::filled;

/// Parameters of `filter/median`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Median {
    /// Side of the window, px: 3 or 5.
    #[schemars(extend("enum" = [3, 5]))]
    pub size: u32,
}

impl Default for Median {
    fn default() -> Self {
        Self { size: 5 }
    }
}

impl Node for Median {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "filter/median",
            version: 2,
            contract: Contract::Pure,
            summary: "Median over each pixel's neighbourhood.",
            doc: "\
OpenCV's `medianBlur` of f32 with a square window and replicated border. Martins et al. 2018 end their fusion with a \
5x5 median.\n\n\
Invalid pixels (NaN or infinity) are not samples. A valid pixel becomes the median of the valid pixels in its \
window; for an even number, the mean of the middle two. An invalid pixel becomes valid only if more than half of its \
window is valid.",
            inputs: vec![Port::frame("depth", ValueType::Depth, "Depth, metres, NaN = invalid.")],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Filtered depth, metres, NaN = invalid.")],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        match params.size {
            3 | 5 => Ok(()),
            size => Err(("size", format!("size is {size}, expected 3 or 5"))),
        }
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for Median {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let depth = &inputs.get::<Depth>("depth")?.metres;
        let (width, height) = depth.dimensions();
        let kernel = if self.size == 3 { median3_of_valid } else { median5_of_valid };
        let metres = filled((width, height), |out| kernel(depth, width as usize, height as usize, out));
        Ok(Outputs::one("depth", Depth { metres }))
    }
}
