//! `fusion/median`: the median of two or three depths.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::median_of::{OfTwo, fuse};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::shape::{filled, same_size};

/// Parameters of `fusion/median`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct MedianOf {
    /// The median where two depths are valid: their `geometric` or `arithmetic` mean.
    pub of_two: OfTwo,
}

impl Node for MedianOf {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "fusion/median",
            version: 1,
            contract: Contract::Pure,
            summary: "Median of monocular depth, stereo depth and, optionally, a third estimate.",
            doc: "\
A baseline, pixel by pixel over the valid depths. Of three, it is the middle one. The third can be \
any depth, for example a fusion or a second network. Of two, it is their geometric mean: the mean of the logarithms, \
because the error of depth grows with depth. `of_two: arithmetic` takes the arithmetic mean instead. Of one, it is \
that one. Without a valid depth, the result is invalid.",
            inputs: vec![
                Port::frame("mono", ValueType::Depth, "Monocular depth, metres, NaN = invalid."),
                Port::frame("stereo", ValueType::Depth, "Stereo depth, metres, NaN = invalid; same size as `mono`."),
                Port::frame("third", ValueType::Depth, "A third depth, metres, NaN = invalid; same size as `mono`.")
                    .optional(),
            ],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Median depth, metres, NaN = invalid.")],
        }
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for MedianOf {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let mono = &inputs.get::<Depth>("mono")?.metres;
        let stereo = &inputs.get::<Depth>("stereo")?.metres;
        let third = inputs.optional::<Depth>("third")?.map(|depth| &depth.metres);
        let size = mono.dimensions();
        same_size(("mono", size), ("stereo", stereo.dimensions()))?;
        if let Some(third) = third {
            same_size(("mono", size), ("third", third.dimensions()))?;
        }
        let third = third.map(|third| third.as_raw().as_slice());
        let metres = filled(size, |out| fuse(mono, stereo, third, self.of_two, out));
        Ok(Outputs::one("depth", Depth { metres }))
    }
}
