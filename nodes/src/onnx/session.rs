//! A model in an engine: what it takes and gives, and one run of it.

use std::error::Error;

use ort::session::Session;
use ort::value::TensorRef;

/// The one input that is fed and the one output that is read.
#[derive(Clone)]
pub(crate) struct Binding {
    pub input: String,
    pub shape: [usize; 4],
    pub output: String,
}

/// A model, loaded: one run at a time.
pub(crate) enum EngineSession {
    OnnxRuntime(Box<Session>),
    #[cfg(feature = "tract")]
    Tract(super::tract::TractSession),
}

impl EngineSession {
    /// Makes ready for runs of this binding.
    #[cfg_attr(not(feature = "tract"), expect(unused_variables, reason = "only tract plans for a binding"))]
    pub fn prepare(&mut self, binding: &Binding) -> Result<(), String> {
        match self {
            Self::OnnxRuntime(_) => Ok(()),
            #[cfg(feature = "tract")]
            Self::Tract(session) => session.prepare(&binding.input, binding.shape, &binding.output),
        }
    }

    /// The shape and the values that a tensor of the binding's shape becomes.
    pub fn run(
        &mut self,
        binding: &Binding,
        tensor: &[f32],
    ) -> Result<(Vec<i64>, Vec<f32>), Box<dyn Error + Send + Sync>> {
        match self {
            Self::OnnxRuntime(session) => {
                let input = TensorRef::from_array_view((binding.shape, tensor))?;
                let outputs = session.run(ort::inputs![binding.input.as_str() => input])?;
                let map = outputs[binding.output.as_str()].try_extract_tensor::<f32>()?;
                Ok((map.0.to_vec(), map.1.to_vec()))
            }
            #[cfg(feature = "tract")]
            Self::Tract(session) => session.run(binding.shape, tensor).map_err(Into::into),
        }
    }
}
