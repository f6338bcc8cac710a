//! `filter/median`: the median filter that ends the fusion.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::median::{median3_of_answers, median5_of_answers};
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
            summary: "Median of every pixel's neighbourhood.",
            doc: "\
OpenCV's `medianBlur` of f32: square window, border replicated. The paper ends its fusion with 5x5. A pixel without answer (NaN or infinity) is no \
sample: a pixel that valid gets the median of the answers around it (of an even number the mean of the middle two), one that did not gets it where \
more than half of its window is valid.",
            inputs: vec![Port::frame("depth", ValueType::Depth, "Depth, metres.")],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Depth, filtered, metres.")],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        match params.size {
            3 | 5 => Ok(()),
            size => Err(("size", format!("size is {size}, which is neither 3 nor 5"))),
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
        let kernel = if self.size == 3 { median3_of_answers } else { median5_of_answers };
        let metres = filled((width, height), |out| kernel(depth, width as usize, height as usize, out));
        Ok(Outputs::one("depth", Depth { metres }))
    }
}
