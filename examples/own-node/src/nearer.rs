//! `example/nearer`: a node.

use depthloom::graphs::contracts::{Contract, NodeDeclaration};
use depthloom::graphs::values::Depth;
use depthloom::graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Parameters of `example/nearer`; these words are its reference, and its ranges are checked.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct NearerParams {
    /// The farthest depth that is kept, metres.
    #[schemars(extend("exclusiveMinimum" = 0))]
    far_m: f32,
}

impl Default for NearerParams {
    fn default() -> Self {
        Self { far_m: 30.0 }
    }
}

/// The kind `example/nearer`.
pub(crate) struct Nearer {
    far_m: f32,
}

impl Node for Nearer {
    type Params = NearerParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "example/nearer",
            version: 1,
            contract: Contract::Pure,
            summary: "Keeps what is near.",
            doc: "Answers beyond `far_m` become no answer (NaN).",
            inputs: vec![Port::frame("depth", ValueType::Depth, "Depth, metres, NaN = invalid.")],
            outputs: vec![Port::frame("depth", ValueType::Depth, "The same, where it is near.")],
        }
    }

    fn build(NearerParams { far_m }: NearerParams) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(Self { far_m })))
    }
}

impl PureNode for Nearer {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let mut metres = inputs.get::<Depth>("depth")?.metres.clone();
        metres.iter_mut().filter(|depth| **depth > self.far_m).for_each(|depth| *depth = f32::NAN);
        Ok(Outputs::one("depth", Depth { metres }))
    }
}
