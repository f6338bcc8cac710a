//! A model in an engine: what it takes and gives, and one run of it.

use depthloom_graphs::Fault;
use ort::session::Session;
use ort::value::{TensorElementType, TensorRef};

use crate::onnx_engine::Engine;

/// An input or output, as the model declares it.
#[derive(Clone)]
pub(crate) struct Outlet {
    pub name: String,
    /// Element type and shape, open sides -1; `None`: no tensor.
    pub tensor: Option<(TensorElementType, Vec<i64>)>,
}

/// The one input that is fed and the one output that is read.
#[derive(Clone)]
pub(crate) struct Wiring {
    pub input: String,
    pub shape: [usize; 4],
    pub output: String,
}

/// A model, loaded: one run at a time.
pub(crate) enum EngineSession {
    OnnxRuntime(Box<Session>),
    #[cfg(feature = "tract")]
    Tract(crate::onnx_tract::TractSession),
}

impl EngineSession {
    /// Makes ready for runs of this wiring.
    #[cfg_attr(not(feature = "tract"), expect(unused_variables, reason = "only tract plans for a wiring"))]
    pub fn prepare(&mut self, wiring: &Wiring) -> Result<(), String> {
        match self {
            Self::OnnxRuntime(_) => Ok(()),
            #[cfg(feature = "tract")]
            Self::Tract(session) => session.prepare(&wiring.input, wiring.shape, &wiring.output),
        }
    }

    /// The shape and the values that a tensor of the wiring's shape becomes.
    pub fn run(&mut self, engine: &Engine, wiring: &Wiring, tensor: &[f32]) -> Result<(Vec<i64>, Vec<f32>), Fault> {
        let failed = || Fault::new(format!("{} failed to run the network", engine.title()));
        match self {
            Self::OnnxRuntime(session) => {
                let of_runtime = |error: ort::Error| failed().because(error);
                let input = TensorRef::from_array_view((wiring.shape, tensor)).map_err(of_runtime)?;
                let outputs = session.run(ort::inputs![wiring.input.as_str() => input]).map_err(of_runtime)?;
                let map = outputs[wiring.output.as_str()].try_extract_tensor::<f32>().map_err(of_runtime)?;
                Ok((map.0.to_vec(), map.1.to_vec()))
            }
            #[cfg(feature = "tract")]
            Self::Tract(session) => session.run(wiring.shape, tensor).map_err(|what| failed().because(what)),
        }
    }
}
