//! A network in ONNX Runtime: loaded, checked, and as many sessions as work at once.

use std::sync::{Arc, Mutex, PoisonError};

use depthloom_graphs::Fault;
use depthloom_graphs::values::Artifact;
use ort::session::Session;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use ort::value::{Outlet, TensorElementType, TensorRef, ValueType};

use super::network_input::InputSize;
use super::onnx::{Layout, OnnxParams};
use crate::onnx_runtime::{self, OnnxRuntime};

/// A network, ready to run.
pub struct Network {
    runtime: &'static OnnxRuntime,
    model: Arc<[u8]>,
    threads: usize,
    input_name: String,
    output_name: String,
    /// The shape of the input tensor.
    shape: [i64; 4],
    /// The size of the image it wants.
    pub size: InputSize,
    // ONNX Runtime's `run` is not safe to share: every worker in it has a session of its own, given back for the next.
    sessions: Mutex<Vec<Session>>,
}

impl Network {
    /// Loads a model and checks that it maps an image to a map.
    ///
    /// # Errors
    /// If it is no model, or of other inputs, rank or type than a network of depth has.
    pub fn load(model: &Artifact, params: &OnnxParams) -> Result<Self, Fault> {
        let runtime = onnx_runtime::find()?;
        let threads = params.threads as usize;
        let session = session(runtime, &model.bytes, threads)?;
        let input = outlet("input", session.inputs(), params.input_name.as_deref())?;
        let output = outlet("output", session.outputs(), params.output_name.as_deref())?;
        if let (None, [_, other, ..]) = (&params.input_name, session.inputs()) {
            return Err(Fault::new(format!(
                "the network has several inputs ({}, {}, ...)",
                input.name(),
                other.name()
            ))
            .remedy("only networks of one image can be run: export the model with that one input"));
        }
        let size = input_size(input, params)?;
        check_output(output)?;
        let (channels, width, height) = (size.channels as i64, size.width as i64, size.height as i64);
        let shape = match params.layout {
            Layout::Nchw => [1, channels, height, width],
            Layout::Nhwc => [1, height, width, channels],
        };
        let (input_name, output_name) = (input.name().to_owned(), output.name().to_owned());
        let model = Arc::clone(&model.bytes);
        Ok(Self { runtime, model, threads, input_name, output_name, shape, size, sessions: Mutex::new(vec![session]) })
    }

    /// Runs the network on a tensor of its shape: the map it gives, its columns and rows.
    ///
    /// # Errors
    /// If ONNX Runtime fails, or the output is no single map.
    pub fn run(&self, tensor: &[f32]) -> Result<(Vec<f32>, usize, usize), Fault> {
        let idle = self.sessions.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut session = match idle {
            Some(session) => session,
            None => session(self.runtime, &self.model, self.threads)?,
        };
        let result = self.run_in(&mut session, tensor);
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner).push(session);
        result
    }

    fn run_in(&self, session: &mut Session, tensor: &[f32]) -> Result<(Vec<f32>, usize, usize), Fault> {
        let failed = |error: ort::Error| Fault::new("ONNX Runtime failed to run the network").because(error);
        let input = TensorRef::from_array_view((self.shape, tensor)).map_err(failed)?;
        let outputs = session.run(ort::inputs![self.input_name.as_str() => input]).map_err(failed)?;
        let (shape, values) = outputs[self.output_name.as_str()].try_extract_tensor::<f32>().map_err(failed)?;
        let (width, height) = map_size(shape).ok_or_else(|| {
            Fault::new(format!(
                "output `{}` of the network has the shape {}, which is no single map",
                self.output_name,
                shown(shape)
            ))
            .remedy("name another output by `output_name`, or export the model with an output of 1x1xHxW")
        })?;
        Ok((values.to_vec(), width, height))
    }
}

fn session(runtime: &OnnxRuntime, model: &[u8], threads: usize) -> Result<Session, Fault> {
    let mut builder =
        builder(runtime, threads).map_err(|error| Fault::new("ONNX Runtime refused a session").because(error))?;
    builder.commit_from_memory(model).map_err(|error| {
        let (len, version) = (model.len(), &runtime.version);
        Fault::new(format!("the {len} bytes of the model are none that ONNX Runtime {version} can load"))
            .because(error)
            .remedy("`model` wants an ONNX file, or the output of a learning stage")
    })
}

fn builder(runtime: &OnnxRuntime, threads: usize) -> ort::Result<SessionBuilder> {
    let builder = Session::builder(runtime.environment())?
        .with_optimization_level(GraphOptimizationLevel::All)?
        .with_intra_threads(threads)?
        .with_inter_threads(1)?
        .with_intra_op_spinning(false)?
        .with_deterministic_compute(true)?;
    Ok(builder)
}

fn outlet<'a>(what: &str, outlets: &'a [Outlet], name: Option<&str>) -> Result<&'a Outlet, Fault> {
    let named = |wanted: &str| outlets.iter().find(|outlet| outlet.name() == wanted);
    let found = name.map_or(outlets.first(), named);
    found.ok_or_else(|| {
        let names: Vec<&str> = outlets.iter().map(Outlet::name).collect();
        let wanted = name.map_or_else(|| format!("no {what}"), |name| format!("no {what} `{name}`"));
        Fault::new(format!("the network has {wanted}; it has {}", names.join(", ")))
            .remedy(format!("correct `{what}_name`, or leave it out to take the first"))
    })
}

fn input_size(input: &Outlet, params: &OnnxParams) -> Result<InputSize, Fault> {
    let name = input.name();
    let ValueType::Tensor { ty, shape, .. } = input.dtype() else {
        return Err(Fault::new(format!("input `{name}` of the network is no tensor")));
    };
    if *ty != TensorElementType::Float32 {
        return Err(Fault::new(format!("input `{name}` of the network holds {ty:?}, where f32 is wanted"))
            .remedy("export the model with an input of f32 values"));
    }
    let order = match params.layout {
        Layout::Nchw => "batch x channels x rows x columns (layout: nchw)",
        Layout::Nhwc => "batch x rows x columns x channels (layout: nhwc)",
    };
    let wrong = || {
        Fault::new(format!("input `{name}` of the network has the shape {}, which is not {order}", shown(shape)))
            .remedy("`layout` is nchw or nhwc; channels must be 1 or 3, the batch 1 or open")
    };
    let &[batch, a, b, c] = &shape[..] else { return Err(wrong()) };
    let (channels, height, width) = match params.layout {
        Layout::Nchw => (a, b, c),
        Layout::Nhwc => (c, a, b),
    };
    // An open number of channels is taken to be three.
    let channels = if channels == -1 { 3 } else { channels };
    if !(batch == 1 || batch == -1) || !(channels == 1 || channels == 3) {
        return Err(wrong());
    }
    let side = |of_model: i64, of_params: Option<u32>| match (usize::try_from(of_model), of_params) {
        (Ok(0), _) => Err(wrong()),
        (Ok(fixed), None) => Ok(fixed),
        (Ok(fixed), Some(asked)) if fixed == asked as usize => Ok(fixed),
        (Ok(_), Some(_)) => Err(Fault::new(format!(
            "`size` asks for another image than the network takes: its input `{name}` has the shape {}",
            shown(shape)
        ))
        .remedy("leave `size` out: the network says it itself")),
        (Err(_), Some(asked)) => Ok(asked as usize),
        (Err(_), None) => Err(Fault::new(format!(
            "the network leaves the size of its image open: its input `{name}` has the shape {}",
            shown(shape)
        ))
        .remedy("say which by `size: [width, height]`")),
    };
    let width = side(width, params.size.map(|size| size[0]))?;
    let height = side(height, params.size.map(|size| size[1]))?;
    Ok(InputSize { channels: channels as usize, width, height })
}

fn check_output(output: &Outlet) -> Result<(), Fault> {
    match output.dtype() {
        ValueType::Tensor { ty: TensorElementType::Float32, .. } => Ok(()),
        other => {
            Err(Fault::new(format!("output `{}` of the network holds {other}, where f32 is wanted", output.name()))
                .remedy("name another output by `output_name`, or export the model with an output of f32 values"))
        }
    }
}

/// Columns and rows of an output that is one map: two axes, and beside them only a batch and a channel of one.
fn map_size(shape: &[i64]) -> Option<(usize, usize)> {
    let shape: Vec<usize> = shape.iter().map(|&side| usize::try_from(side).ok()).collect::<Option<_>>()?;
    let ([height, width] | [1, height, width] | [1, 1, height, width] | [1, height, width, 1]) = *shape.as_slice()
    else {
        return None;
    };
    (width > 0 && height > 0).then_some((width, height))
}

fn shown(shape: &[i64]) -> String {
    let side = |&side: &i64| if side < 0 { "?".to_owned() } else { side.to_string() };
    shape.iter().map(side).collect::<Vec<_>>().join("x")
}

#[cfg(test)]
mod tests {
    use super::{map_size, shown};

    #[test]
    fn a_single_map_is_recognised_in_any_usual_shape() {
        for shape in [&[96, 320][..], &[1, 96, 320], &[1, 1, 96, 320], &[1, 96, 320, 1]] {
            assert_eq!(map_size(shape), Some((320, 96)), "{shape:?}");
        }
        for shape in [&[320][..], &[2, 96, 320], &[1, 3, 96, 320], &[1, 1, 0, 320], &[]] {
            assert_eq!(map_size(shape), None, "{shape:?}");
        }
        assert_eq!(shown(&[1, 3, -1, 320]), "1x3x?x320");
    }
}
