//! `confidence/sobel`: the stereo confidence `W_c`, the edge map blurred.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Image, Weight};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::confidence::confidence_from_edges;
use depthloom_kernels::edges::edges;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::grey::grey;
use crate::shape::filled;

/// Parameters of `confidence/sobel`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Sobel {
    /// A pixel is an edge if the absolute 3x3 Sobel derivative along the row exceeds this value. The image is 8-bit
    /// grey.
    #[schemars(range(min = 0, max = 1020))]
    pub threshold: f64,
    /// Standard deviation of the Gaussian that spreads the edges, px. The kernel reaches four sigma.
    #[schemars(range(max = 1000), extend("exclusiveMinimum" = 0))]
    pub sigma: f64,
}

impl Default for Sobel {
    fn default() -> Self {
        Self { threshold: 100.0, sigma: 10.0 }
    }
}

#[derive(Default)]
struct EdgeBuffer(Vec<u8>);

impl Node for Sobel {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "confidence/sobel",
            version: 1,
            contract: Contract::Pure,
            summary: "Confidence in stereo depth, high near vertical edges (`W_c` of Martins et al. 2018).",
            doc: "\
Step 2 of Martins et al. 2018: the edge map of `confidence/edges`, blurred by a Gaussian and divided by its maximum. \
The blur is OpenCV's `GaussianBlur` on f32: border reflect-101, kernel up to four sigma. If the image has no edge, \
the confidence is 0 everywhere.",
            inputs: vec![Port::frame("image", ValueType::Image, "The left image, grey or RGB.")],
            outputs: vec![Port::frame("weight", ValueType::Weight, "Confidence in [0, 1]; same size as the image.")],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        if params.sigma > 0.0 && params.sigma <= 1000.0 {
            return Ok(());
        }
        Err(("sigma", format!("sigma is {} px, expected above 0 and at most 1000", params.sigma)))
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for Sobel {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let grey = grey(inputs.get::<Image>("image")?);
        let (columns, rows) = grey.dimensions();
        let (width, height) = (columns as usize, rows as usize);
        let mut mask = ctx.scratch.take::<EdgeBuffer>();
        mask.0.resize(width * height, 0);
        edges(grey, width, height, self.threshold as f32, &mut mask.0);
        let share = filled((columns, rows), |out| confidence_from_edges(&mask.0, width, height, self.sigma, out));
        ctx.scratch.put(mask);
        Ok(Outputs::one("weight", Weight { share }))
    }
}
