//! tract: ONNX networks in pure Rust, for machines without ONNX Runtime.
//!
//! Called directly, not through ONNX Runtime's interface (the crate `ort-tract`): on some broken models tract panics, and a panic cannot
//! pass that interface of C, but ends the process. Here it is an error as any other.

use std::sync::Arc;

use depthloom_kernels::memory::{TooMuch, bytes_of};
use depthloom_threads::Caught;
use tract_onnx::pb::ModelProto;
use tract_onnx::prelude::{
    Datum, Framework, InferenceFact, InferenceModelExt, IntoRunnable, Tensor, TractError, TractResult,
    TypedRunnableModel, tvec,
};

/// The version that is compiled in; `Cargo.toml` pins it.
pub const VERSION: &str = "0.23.9";

/// A model in tract.
pub struct TractSession {
    model: Box<ModelProto>,
    plan: Option<Arc<TypedRunnableModel>>,
}

impl TractSession {
    /// Reads a model; what it computes is looked at by [`TractSession::prepare`].
    pub fn read(mut model: &[u8]) -> Result<Self, String> {
        caught(|| {
            let model = Box::new(tract_onnx::onnx().proto_model_for_read(&mut model)?);
            Ok(Self { model, plan: None })
        })
    }

    /// Plans the way from an input of a shape to an output.
    pub fn prepare(&mut self, input: &str, shape: [usize; 4], output: &str) -> Result<(), String> {
        let plan = caught(|| {
            // Sizes that the model leaves open are known here; what it says of them within is left to follow from the input's.
            let parsed = tract_onnx::onnx().with_ignore_value_info(true).parse(&self.model, None)?;
            let mut graph = parsed.model;
            let found = |name: &str| {
                let outlet = parsed.outlets_by_name.get(name).copied();
                outlet.ok_or_else(|| TractError::msg(format!("nothing gives `{name}`")))
            };
            if let Some(name) = parsed.unresolved_inputs.first() {
                return Err(TractError::msg(format!("nothing gives `{name}`")));
            }
            graph.set_input_outlets(&[found(input)?])?;
            graph.set_input_fact(0, InferenceFact::dt_shape(f32::datum_type(), shape))?;
            graph.select_output_outlets(&[found(output)?])?;
            let graph = graph.into_typed()?;
            // Sizes that follow from others are known now, and none of it is there yet.
            for fact in graph.nodes.iter().flat_map(|node| &node.outputs).map(|outlet| &outlet.fact) {
                let sides = fact.shape.as_concrete().unwrap_or_default();
                TooMuch::check(bytes_of(sides, fact.datum_type.size_of())).map_err(TractError::new)?;
            }
            graph.into_optimized()?.into_runnable()
        })?;
        self.plan = Some(plan);
        Ok(())
    }

    /// The output's shape and values, for a tensor of the shape that was prepared.
    pub fn run(&self, shape: [usize; 4], tensor: &[f32]) -> Result<(Vec<i64>, Vec<f32>), String> {
        let plan = self.plan.as_ref().ok_or("the network was not prepared")?;
        caught(|| {
            let outputs = plan.run(tvec!(Tensor::from_shape(&shape, tensor)?.into()))?;
            let map = outputs[0].to_plain_array_view::<f32>()?;
            Ok((map.shape().iter().map(|&side| side as i64).collect(), map.iter().copied().collect()))
        })
    }
}

/// What tract said, its panics included.
fn caught<T>(work: impl FnOnce() -> TractResult<T>) -> Result<T, String> {
    // What a panic may leave half-done is a plan or a run of its own, and dropped.
    match depthloom_threads::caught(work) {
        Ok(result) => result.map_err(|error| format!("{error:#}")),
        Err(Caught(told)) => Err(format!("tract failed within, {told}")),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_version_is_the_one_compiled_in() {
        let lock = include_str!("../../../Cargo.lock");
        let entry = format!("name = \"tract-onnx\"\nversion = \"{}\"\n", super::VERSION);
        assert!(lock.replace('\r', "").contains(&entry), "Cargo.lock has another tract-onnx than {}", super::VERSION);
    }
}
