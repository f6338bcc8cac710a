//! `fusion/confidence`: monocular and stereo depth, weighted pixel by pixel.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Depth, Weight};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::fuse::{Weighting, fuse};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::shape::{filled, same_size};

/// Parameters of `fusion/confidence`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Confidence {
    /// How the two depths are weighted: `full`, `confidence`, `mean` or `fill`.
    pub weighting: Weighting,
}

impl Node for Confidence {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "fusion/confidence",
            version: 2,
            contract: Contract::Pure,
            summary: "Monocular and stereo depth, fused by the confidence in stereo.",
            doc: "\
Step 5 of Martins et al. 2018, before the median filter. `Z_s` is stereo depth, `Z_m` monocular depth, `W_c` the \
confidence in stereo. Where both are valid, `weighting: full` computes `Z = W_c Z_s + (1 - W_c)(W_s Z_s + (1 - W_s) \
Z_m)`. Here `W_s = min(N_s, N_m) / max(N_s, N_m)`, `N_s = Z_s / max(Z_s)` over valid pixels, and `N_m = Z_m / \
max(Z_m)`.\n\n\
Where stereo is invalid (NaN or infinity), `Z = Z_m`. Where monocular depth is invalid, `Z = Z_s`, whatever the \
confidence. Where both are invalid, so is the result.",
            inputs: vec![
                Port::frame("mono", ValueType::Depth, "Monocular depth, metres, usually scaled."),
                Port::frame("stereo", ValueType::Depth, "Stereo depth, metres, NaN = invalid; same size as `mono`."),
                Port::frame(
                    "weight",
                    ValueType::Weight,
                    "Confidence in stereo, `W_c`, in [0, 1]; same size as `mono`.",
                ),
            ],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Fused depth, metres, NaN = invalid.")],
        }
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for Confidence {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let mono = &inputs.get::<Depth>("mono")?.metres;
        let stereo = &inputs.get::<Depth>("stereo")?.metres;
        let weight = &inputs.get::<Weight>("weight")?.share;
        let size = mono.dimensions();
        same_size(("mono", size), ("stereo", stereo.dimensions()))?;
        same_size(("mono", size), ("weight", weight.dimensions()))?;
        let metres = filled(size, |out| fuse(stereo, mono, weight, self.weighting, out));
        Ok(Outputs::one("depth", Depth { metres }))
    }
}
