//! `fusion/scale`: mono depth brought to stereo's scale.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::scale;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::shape::{filled, same_size};

/// How mono is brought to stereo's scale.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ScaleMethod {
    /// `min(Z_s) + r_s (Z_m - min(Z_m)) / r_m`, with the ranges `r`: stereo's over valid pixels, mono's over all.
    #[default]
    Minmax,
    /// `Z_m * mean(Z_s) / mean(Z_m)`, both means over the pixels that are valid in both.
    Average,
    /// Mono as it is.
    None,
}

/// Parameters of `fusion/scale`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Scale {
    /// How mono is scaled: `minmax`, `average` or `none`.
    pub method: ScaleMethod,
}

impl Node for Scale {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "fusion/scale",
            version: 2,
            contract: Contract::Pure,
            summary: "Mono depth at the scale of this frame's stereo.",
            doc: "\
Step 4 of the paper, an ablation of Table I. Extents and means are taken frame by frame; stereo counts where it valid, mono too (means: where \
both did). A pixel without mono stays without. On a frame where stereo is valid nowhere, mono stays as it is.",
            inputs: vec![
                Port::frame("mono", ValueType::Depth, "Mono depth, metres, NaN = no answer."),
                Port::frame("stereo", ValueType::Depth, "Stereo depth, metres, NaN = no answer; of the same size."),
            ],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Mono depth, scaled, metres.")],
        }
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for Scale {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let mono = inputs.get::<Depth>("mono")?;
        let stereo = &inputs.get::<Depth>("stereo")?.metres;
        let size = mono.metres.dimensions();
        same_size(("mono", size), ("stereo", stereo.dimensions()))?;
        let kernel = match self.method {
            ScaleMethod::Minmax => scale::minmax,
            ScaleMethod::Average => scale::average,
            ScaleMethod::None => {
                let unchanged = inputs.value("mono").ok_or_else(|| Fault::new("no value at input `mono`"))?;
                return Ok(Outputs::one("depth", unchanged.clone()));
            }
        };
        let metres = filled(size, |out| kernel(&mono.metres, stereo, out));
        Ok(Outputs::one("depth", Depth { metres }))
    }
}
