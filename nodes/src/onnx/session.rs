//! A model in an engine: its inputs and outputs, and one run.

use std::borrow::Cow;
use std::error::Error;

use half::f16;
use ort::session::{Session, SessionInputValue};
use ort::value::{DynValue, Tensor, TensorRef};

use super::binding::{Binding, Element, Feed, OutputTensor, bytes};

pub(crate) enum EngineSession {
    OnnxRuntime(Box<Session>),
    #[cfg(feature = "tract")]
    Tract(super::tract::TractSession),
}

type Failed = Box<dyn Error + Send + Sync>;

impl EngineSession {
    #[cfg_attr(not(feature = "tract"), expect(unused_variables, reason = "only tract plans for a binding"))]
    pub(crate) fn prepare(&mut self, binding: &Binding) -> Result<(), String> {
        match self {
            Self::OnnxRuntime(_) => Ok(()),
            #[cfg(feature = "tract")]
            Self::Tract(session) => session.prepare(binding),
        }
    }

    pub(crate) fn run(&mut self, binding: &Binding, tensors: &[&[f32]]) -> Result<Vec<OutputTensor>, Failed> {
        match self {
            Self::OnnxRuntime(session) => {
                let fed = binding.inputs.iter().zip(tensors);
                let fed = fed.map(|(feed, tensor)| Ok((Cow::Borrowed(feed.name.as_str()), feed.value(tensor)?)));
                let fed: Vec<(Cow<'_, str>, SessionInputValue<'_>)> = fed.collect::<ort::Result<_>>()?;
                let outputs = session.run(fed)?;
                binding.outputs.iter().map(|name| given(&outputs[name.as_str()])).collect()
            }
            #[cfg(feature = "tract")]
            Self::Tract(session) => session.run(binding, tensors).map_err(Into::into),
        }
    }
}

impl Feed {
    fn value<'t>(&self, tensor: &'t [f32]) -> ort::Result<SessionInputValue<'t>> {
        let shape = self.shape.clone();
        Ok(match self.element {
            Element::F32 => TensorRef::from_array_view((shape, tensor))?.into(),
            Element::F16 => {
                let halves: Vec<f16> = tensor.iter().map(|&value| f16::from_f32(value)).collect();
                Tensor::from_array((shape, halves))?.into()
            }
            Element::U8 => Tensor::from_array((shape, bytes(tensor)))?.into(),
        })
    }
}

fn given(value: &DynValue) -> Result<OutputTensor, Failed> {
    if let Ok((shape, values)) = value.try_extract_tensor::<f32>() {
        return Ok(OutputTensor { shape: shape.to_vec(), values: values.to_vec() });
    }
    if let Ok((shape, values)) = value.try_extract_tensor::<f16>() {
        return Ok(OutputTensor { shape: shape.to_vec(), values: values.iter().map(|value| value.to_f32()).collect() });
    }
    let (shape, values) = value.try_extract_tensor::<f64>()?;
    Ok(OutputTensor { shape: shape.to_vec(), values: values.iter().map(|&value| value as f32).collect() })
}
