//! `fusion/scale`: mono depth brought to stereo's scale.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::scale;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::shape::{filled, same_size};

/// How monocular depth is brought to the scale of stereo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ScaleMethod {
    /// `min(Z_s) + r_s (Z_m - min(Z_m)) / r_m`. `r_s` is the range of stereo, `r_m` that of monocular depth, each
    /// over its own valid pixels.
    #[default]
    Minmax,
    /// `Z_m * mean(Z_s) / mean(Z_m)`, both means over the pixels that are valid in both.
    Average,
    /// Monocular depth, unchanged.
    None,
}

/// Parameters of `fusion/scale`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Scale {
    /// How monocular depth is scaled: `minmax`, `average` or `none`.
    pub method: ScaleMethod,
}

impl Node for Scale {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "fusion/scale",
            version: 2,
            contract: Contract::Pure,
            summary: "Monocular depth, rescaled to the stereo depth of the same frame.",
            doc: "\
Step 4 of Martins et al. 2018, an ablation of its Table I. Ranges and means are computed per frame. Only valid \
pixels count; for means, only pixels that are valid in both. Invalid monocular pixels stay invalid. On a frame \
without any valid stereo pixel, monocular depth is unchanged.",
            inputs: vec![
                Port::frame("mono", ValueType::Depth, "Monocular depth, metres, NaN = invalid."),
                Port::frame("stereo", ValueType::Depth, "Stereo depth, metres, NaN = invalid; same size as `mono`."),
            ],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Scaled monocular depth, metres, NaN = invalid.")],
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
