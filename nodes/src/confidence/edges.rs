//! `confidence/edges`: the binary edge map.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Image, Mask};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::edges::edges;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::grey::grey;
use crate::shape::filled;

/// Parameters of `confidence/edges`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Edges {
    /// A pixel is an edge if the absolute 3x3 Sobel derivative along the row exceeds this value. The image is 8-bit
    /// grey.
    #[schemars(range(min = 0, max = 1020))]
    pub threshold: f64,
}

impl Default for Edges {
    fn default() -> Self {
        Self { threshold: 100.0 }
    }
}

impl Node for Edges {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "confidence/edges",
            version: 1,
            contract: Contract::Pure,
            summary: "Mask of strong vertical edges, where stereo matching is reliable.",
            doc: "\
Step 2 of Martins et al. 2018: the absolute horizontal derivative of the grey image exceeds a threshold. The \
derivative is OpenCV's 3x3 Sobel with border reflect-101. The mask selects the stereo pixels from which a monocular \
network is trained.",
            inputs: vec![Port::frame("image", ValueType::Image, "The left image, grey or RGB.")],
            outputs: vec![Port::frame("mask", ValueType::Mask, "255 on edges, 0 elsewhere; same size as the image.")],
        }
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for Edges {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let grey = grey(inputs.get::<Image>("image")?);
        let (width, height) = grey.dimensions();
        let set =
            filled((width, height), |out| edges(grey, width as usize, height as usize, self.threshold as f32, out));
        Ok(Outputs::one("mask", Mask { set }))
    }
}
