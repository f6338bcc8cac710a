//! tract: ONNX networks in pure Rust, for machines without ONNX Runtime.
//!
//! Called directly, not through ONNX Runtime's interface (the crate `ort-tract`): on some broken models tract panics,
//! and a panic cannot
//! pass that interface of C, but ends the process. Here it is an error as any other.

use std::sync::Arc;

use depthloom_kernels::memory::{TooMuch, bytes_of};
use depthloom_threads::Caught;
use half::f16;
use tract_onnx::pb::ModelProto;
use tract_onnx::prelude::{
    Datum, DatumType, Framework, InferenceFact, InferenceModelExt, IntoRunnable, Tensor, TractError, TractResult,
    TypedRunnableModel, tvec,
};

use tract_onnx::tract_core::ops::Cost;

use super::binding::{self, Binding, Element, OutputTensor};

/// Pinned in `Cargo.toml`.
pub(super) const VERSION: &str = "0.23.9";

pub(crate) struct TractSession {
    model: Box<ModelProto>,
    plan: Option<Arc<TypedRunnableModel>>,
}

impl TractSession {
    pub(crate) fn read(mut model: &[u8]) -> Result<Self, String> {
        caught(|| {
            let mut model = Box::new(tract_onnx::onnx().proto_model_for_read(&mut model)?);
            name_nodes(&mut model);
            check_domains(&model)?;
            Ok(Self { model, plan: None })
        })
    }

    pub(crate) fn prepare(&mut self, binding: &Binding) -> Result<(), String> {
        let plan = caught(|| {
            // The sizes that the model leaves open are known here; sizes stated for values within the model are ignored
            // and follow from those of the inputs.
            let parsed = tract_onnx::onnx().with_ignore_value_info(true).parse(&self.model, None)?;
            let mut graph = parsed.model;
            let found = |name: &String| {
                let outlet = parsed.outlets_by_name.get(name.as_str()).copied();
                outlet.ok_or_else(|| TractError::msg(format!("no node outputs `{name}`")))
            };
            if let Some(name) = parsed.unresolved_inputs.first() {
                return Err(TractError::msg(format!("no node outputs `{name}`")));
            }
            let inputs: Vec<_> = binding.inputs.iter().map(|feed| found(&feed.name)).collect::<TractResult<_>>()?;
            graph.set_input_outlets(&inputs)?;
            for (index, feed) in binding.inputs.iter().enumerate() {
                graph.set_input_fact(index, InferenceFact::dt_shape(datum_type(feed.element), &feed.shape))?;
            }
            let outputs: Vec<_> = binding.outputs.iter().map(found).collect::<TractResult<_>>()?;
            graph.select_output_outlets(&outputs)?;
            let graph = graph.into_typed()?;
            // Dependent sizes are known now, and nothing is allocated yet.
            for fact in graph.nodes.iter().flat_map(|node| &node.outputs).map(|outlet| &outlet.fact) {
                let sides = fact.shape.as_concrete().unwrap_or_default();
                TooMuch::check(bytes_of(sides, fact.datum_type.size_of())).map_err(TractError::new)?;
            }
            graph.into_optimized()?.into_runnable()
        })?;
        self.plan = Some(plan);
        Ok(())
    }

    pub(crate) fn run(&self, binding: &Binding, tensors: &[&[f32]]) -> Result<Vec<OutputTensor>, String> {
        let plan = self.plan.as_ref().ok_or("the network was not prepared")?;
        caught(|| {
            let mut fed = tvec!();
            for (feed, tensor) in binding.inputs.iter().zip(tensors) {
                let tensor = match feed.element {
                    Element::U8 => Tensor::from_shape(&feed.shape, &binding::bytes(tensor))?,
                    Element::F32 | Element::F16 => {
                        let tensor = Tensor::from_shape(&feed.shape, tensor)?;
                        tensor.cast_to_dt(datum_type(feed.element))?.into_owned()
                    }
                };
                fed.push(tensor.into());
            }
            let outputs = plan.run(fed)?;
            let mut given = Vec::with_capacity(outputs.len());
            for output in outputs {
                let output = output.cast_to::<f32>()?;
                let view = output.to_plain_array_view::<f32>()?;
                let shape = view.shape().iter().map(|&side| side as i64).collect();
                given.push(OutputTensor { shape, values: view.iter().copied().collect() });
            }
            Ok(given)
        })
    }
}

/// Names unnamed nodes, which ONNX allows: tract treats nodes with equal names as one.
fn name_nodes(model: &mut ModelProto) {
    for (index, node) in model.graph.iter_mut().flat_map(|graph| &mut graph.node).enumerate() {
        if node.name.is_empty() {
            node.name = format!("{}_{index}", node.op_type);
        }
    }
}

/// Rejects operators of domains that tract does not implement: it would take `Conv` of any domain for ONNX's.
fn check_domains(model: &ModelProto) -> TractResult<()> {
    const KNOWN: [&str; 4] = ["", "ai.onnx", "ai.onnx.ml", "com.microsoft"];
    let nodes = model.graph.iter().flat_map(|graph| &graph.node);
    match nodes.into_iter().find(|node| !KNOWN.contains(&node.domain.as_str())) {
        Some(node) => {
            Err(TractError::msg(format!("operator `{}` of domain `{}` is not known", node.op_type, node.domain)))
        }
        None => Ok(()),
    }
}

pub(super) fn multiply_adds(model: &[u8], shapes: &[Vec<usize>]) -> Result<u64, String> {
    let mut bytes = model;
    caught(|| {
        let mut model = tract_onnx::onnx().proto_model_for_read(&mut bytes)?;
        name_nodes(&mut model);
        let mut graph = tract_onnx::onnx().with_ignore_value_info(true).parse(&model, None)?.model;
        for (index, shape) in shapes.iter().enumerate() {
            let datum_type = graph.input_fact(index)?.datum_type;
            let shaped = InferenceFact::dt_shape(f32::datum_type(), shape);
            graph.set_input_fact(index, InferenceFact { datum_type, ..shaped })?;
        }
        let graph = graph.into_typed()?;
        let mut sum = 0_u64;
        for node in &graph.nodes {
            for (cost, count) in node.op.cost(&graph.node_input_facts(node.id)?)? {
                if let Cost::FMA(_) = cost {
                    sum = sum.saturating_add(u64::try_from(count.to_i64()?).unwrap_or(0));
                }
            }
        }
        Ok(sum)
    })
}

fn datum_type(element: Element) -> DatumType {
    match element {
        Element::F32 => f32::datum_type(),
        Element::F16 => f16::datum_type(),
        Element::U8 => u8::datum_type(),
    }
}

fn caught<T>(work: impl FnOnce() -> TractResult<T>) -> Result<T, String> {
    // A panic can only leave an incomplete plan or run, which is dropped.
    match depthloom_threads::caught(work) {
        Ok(result) => result.map_err(|error| format!("{error:#}")),
        Err(Caught(panic)) => Err(format!("tract failed with an internal error: {panic}")),
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

    #[test]
    fn operators_of_unknown_domains_are_refused() {
        let model = |domain: &str| {
            let node = tract_onnx::pb::NodeProto {
                op_type: "Conv".to_owned(),
                domain: domain.to_owned(),
                ..Default::default()
            };
            let graph = tract_onnx::pb::GraphProto { node: vec![node], ..Default::default() };
            super::ModelProto { graph: Some(graph), ..Default::default() }
        };
        assert!(super::check_domains(&model("")).is_ok());
        let error = super::check_domains(&model("my.custom")).unwrap_err().to_string();
        assert_eq!(error, "operator `Conv` of domain `my.custom` is not known");
    }
}
