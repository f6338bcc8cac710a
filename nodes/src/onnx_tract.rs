//! tract: ONNX networks in pure Rust, for machines without ONNX Runtime.
//!
//! Called directly, not through ONNX Runtime's interface (the crate `ort-tract`): on some broken models tract panics, and a panic cannot
//! pass that interface of C, but ends the process. Here it is an error as any other.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use ort::value::TensorElementType;
use tract_onnx::pb::{ModelProto, ValueInfoProto, tensor_shape_proto, type_proto};
use tract_onnx::prelude::{
    Datum, Framework, InferenceFact, InferenceModelExt, IntoRunnable, Tensor, TractError, TractResult,
    TypedRunnableModel, tvec,
};

use crate::onnx_session::Outlet;

/// The version that is compiled in; `Cargo.toml` pins it.
pub const VERSION: &str = "0.23.9";

/// A model in tract.
pub struct TractSession {
    model: Box<ModelProto>,
    pub inputs: Vec<Outlet>,
    pub outputs: Vec<Outlet>,
    plan: Option<Arc<TypedRunnableModel>>,
}

impl TractSession {
    /// Reads a model; what it computes is looked at by [`TractSession::prepare`].
    pub fn read(mut model: &[u8]) -> Result<Self, String> {
        caught(|| {
            let model = Box::new(tract_onnx::onnx().proto_model_for_read(&mut model)?);
            let Some(graph) = &model.graph else {
                return Err(TractError::msg("it holds no graph"));
            };
            // Old models list their weights among the inputs.
            let is_weight = |input: &&ValueInfoProto| graph.initializer.iter().any(|weight| weight.name == input.name);
            let inputs = graph.input.iter().filter(|input| !is_weight(input)).map(outlet).collect();
            let outputs = graph.output.iter().map(outlet).collect();
            Ok(Self { model, inputs, outputs, plan: None })
        })
    }

    /// What the model says of itself under a name.
    pub fn metadata(&self, name: &str) -> Option<String> {
        self.model.metadata_props.iter().find(|said| said.key == name).map(|said| said.value.clone())
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
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(result) => result.map_err(|error| format!("{error:#}")),
        Err(panic) => {
            let text = panic.downcast_ref::<&str>().copied();
            let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
            Err(format!("tract failed within: {}", text.unwrap_or("it says not why")))
        }
    }
}

fn outlet(declared: &ValueInfoProto) -> Outlet {
    let value = declared.r#type.as_ref().and_then(|ty| ty.value.as_ref());
    let tensor = value.map(|type_proto::Value::TensorType(tensor)| {
        let side = |dimension: &tensor_shape_proto::Dimension| match dimension.value {
            Some(tensor_shape_proto::dimension::Value::DimValue(side)) => side,
            _ => -1,
        };
        let shape = tensor.shape.as_ref().map(|shape| shape.dim.iter().map(side).collect());
        (element(tensor.elem_type), shape.unwrap_or_default())
    });
    Outlet { name: declared.name.clone(), tensor }
}

/// The element type by its number in the ONNX schema.
const fn element(number: i32) -> TensorElementType {
    match number {
        1 => TensorElementType::Float32,
        2 => TensorElementType::Uint8,
        3 => TensorElementType::Int8,
        4 => TensorElementType::Uint16,
        5 => TensorElementType::Int16,
        6 => TensorElementType::Int32,
        7 => TensorElementType::Int64,
        8 => TensorElementType::String,
        9 => TensorElementType::Bool,
        10 => TensorElementType::Float16,
        11 => TensorElementType::Float64,
        12 => TensorElementType::Uint32,
        13 => TensorElementType::Uint64,
        14 => TensorElementType::Complex64,
        15 => TensorElementType::Complex128,
        16 => TensorElementType::Bfloat16,
        _ => TensorElementType::Undefined,
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_version_is_the_one_compiled_in() {
        let lock = include_str!("../../Cargo.lock");
        let entry = format!("name = \"tract-onnx\"\nversion = \"{}\"\n", super::VERSION);
        assert!(lock.replace('\r', "").contains(&entry), "Cargo.lock has another tract-onnx than {}", super::VERSION);
    }
}
