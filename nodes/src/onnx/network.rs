//! A network in the process's engine: loaded, checked, and as many sessions as work at once.

use std::sync::{Arc, Mutex, PoisonError};

use depthloom_graphs::Fault;
use depthloom_graphs::values::Artifact;
use depthloom_kernels::memory::{TooMuch, bytes_of, zeros};
use ort::value::TensorElementType;

use super::choice;
use super::engine::Engine;
use super::input::InputSize;
use super::model::{Declared, Outlet, elements};
use super::params::{OnnxParams, Output, TensorLayout};
use super::provider::Provider;
use super::session::{Binding, EngineSession};

/// What a network gave: a map for each image, one after the other, row by row.
pub struct Maps {
    /// The maps' values.
    pub values: Vec<f32>,
    /// Columns of a map.
    pub width: usize,
    /// Rows of a map.
    pub height: usize,
}

/// A network, ready to run.
pub struct Network {
    engine: &'static Engine,
    model: Arc<[u8]>,
    provider: Provider,
    threads: usize,
    binding: Binding,
    /// How many images one run takes.
    batch: usize,
    /// The size of the image it wants.
    pub size: InputSize,
    /// What its map means.
    pub meaning: Output,
    // A session's `run` is not safe to share: every worker in it has a session of its own, given back for the next.
    sessions: Mutex<Vec<EngineSession>>,
}

impl Network {
    /// Loads a model and checks that it maps an image to a map.
    ///
    /// # Errors
    /// If it is no model, or of other inputs, rank or type than a network of depth has.
    pub fn load(model: &Artifact, params: &OnnxParams) -> Result<Self, Fault> {
        let engine = choice::find()?;
        engine.offers(params.provider)?;
        let (provider, threads) = (params.provider, params.threads as usize);
        let declared = Declared::read(&model.bytes).map_err(|what| engine.cannot_load(&model.bytes, what))?;
        if let Some(file) = &declared.external {
            return Err(Fault::new(format!(
                "the network keeps weights in another file (`{file}`), and is run from one alone"
            ))
            .remedy("save it whole: python -c \"import onnx; onnx.save(onnx.load('net.onnx'), 'whole.onnx')\""));
        }
        let Declared { inputs, outputs, .. } = &declared;
        let input = outlet("input", inputs, params.input_name.as_deref())?;
        let output = outlet("output", outputs, params.output_name.as_deref())?;
        if let (None, [_, other, ..]) = (&params.input_name, &inputs[..]) {
            return Err(Fault::new(format!("the network has several inputs ({}, {}, ...)", input.name, other.name))
                .remedy("only networks of one image can be run: export the model with that one input"));
        }
        let size = input_size(input, params)?;
        check_output(output)?;
        let batch = batch(input, output, params);
        check_memory(&declared, size, params)?;
        let meaning = meaning(&declared, params)?;
        let shape = match params.layout {
            TensorLayout::Nchw => [batch, size.channels, size.height, size.width],
            TensorLayout::Nhwc => [batch, size.height, size.width, size.channels],
        };
        let binding = Binding { input: input.name.clone(), shape, output: output.name.clone() };
        let (model, sessions) = (Arc::clone(&model.bytes), Mutex::default());
        let network = Self { engine, model, provider, threads, binding, batch, size, meaning, sessions };
        let mut session = network.prepared(engine.session(&network.model, provider, threads)?)?;
        match output.tensor.as_ref().map(|(_, shape)| shape) {
            Some(shape) if !shape.is_empty() && shape.iter().all(|&side| side >= 0) => {
                map_size(shape, batch).ok_or_else(|| network.no_map(shape))?;
            }
            // What it leaves open, a black image shows.
            _ => {
                network.run_in(&mut session, &zeros::<f32>(batch * size.samples()).map_err(too_large)?)?;
            }
        }
        network.give_back(session);
        Ok(network)
    }

    /// Runs the network on the tensors of as many images as its parameters ask for, one after the other.
    ///
    /// # Errors
    /// If the engine fails, or the output is no single map for each image.
    pub fn run(&self, tensors: &[f32]) -> Result<Maps, Fault> {
        let idle = self.sessions.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut session = match idle {
            Some(session) => session,
            None => self.prepared(self.engine.session(&self.model, self.provider, self.threads)?)?,
        };
        let result = self.run_in(&mut session, tensors);
        self.give_back(session);
        result
    }

    fn prepared(&self, mut session: EngineSession) -> Result<EngineSession, Fault> {
        session.prepare(&self.binding).map_err(|what| self.engine.cannot_load(&self.model, what))?;
        Ok(session)
    }

    fn give_back(&self, session: EngineSession) {
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner).push(session);
    }

    fn run_in(&self, session: &mut EngineSession, tensors: &[f32]) -> Result<Maps, Fault> {
        let mut maps = Maps { values: Vec::new(), width: 0, height: 0 };
        for tensor in tensors.chunks_exact(self.batch * self.size.samples()) {
            let (shape, mut values) = session.run(&self.binding, tensor).map_err(|error| {
                Fault::new(format!("{} failed to run the network", self.engine.title())).because(error)
            })?;
            let (width, height) = map_size(&shape, self.batch).ok_or_else(|| self.no_map(&shape))?;
            maps.values.append(&mut values);
            (maps.width, maps.height) = (width, height);
        }
        Ok(maps)
    }

    fn no_map(&self, shape: &[i64]) -> Fault {
        let each = if self.batch == 1 { String::new() } else { format!(" for each of {} images", self.batch) };
        let (name, shape) = (&self.binding.output, shown(shape));
        Fault::new(format!("output `{name}` of the network has the shape {shape}, which is no single map{each}"))
            .remedy("name another output by `output_name`, or export the model with an output of 1x1xHxW")
    }
}

/// Under which name a model says what its output means, as the parameter `output` names it: `learn/ssl` writes it.
const MEANING: &str = "depthloom.output";

/// What the experiment says the output means, else what the model says, else the usual. The two must not contradict each other.
fn meaning(declared: &Declared, params: &OnnxParams) -> Result<Output, Fault> {
    let Some(said) = declared.metadata(MEANING) else { return Ok(params.output.unwrap_or_default()) };
    let of_model = serde_json::from_value(said.into()).map_err(|_| {
        Fault::new(format!("the network says that its output is `{said}`, which is nothing known here"))
            .remedy("a newer version of this program may have written it")
    })?;
    match params.output {
        Some(asked) if asked != of_model => {
            Err(Fault::new(format!("the network says that its output is `{said}`; `output` says otherwise"))
                .remedy("leave `output` out"))
        }
        _ => Ok(of_model),
    }
}

/// How many of a frame's images one run takes: all of them, if the model allows.
fn batch(input: &Outlet, output: &Outlet, params: &OnnxParams) -> usize {
    let first = |outlet: &Outlet| outlet.tensor.as_ref().and_then(|(_, shape)| shape.first().copied()).unwrap_or(1);
    match (first(input), first(output)) {
        // An output of a fixed batch says that the input's is open in name only.
        (-1, -1) => params.flip.images(),
        (-1, _) => 1,
        (fixed, _) => fixed as usize,
    }
}

fn outlet<'a>(what: &str, outlets: &'a [Outlet], name: Option<&str>) -> Result<&'a Outlet, Fault> {
    let named = |wanted: &str| outlets.iter().find(|outlet| outlet.name == wanted);
    let found = name.map_or(outlets.first(), named);
    found.ok_or_else(|| {
        let names: Vec<&str> = outlets.iter().map(|outlet| outlet.name.as_str()).collect();
        let wanted = name.map_or_else(|| format!("no {what}"), |name| format!("no {what} `{name}`"));
        Fault::new(format!("the network has {wanted}; it has {}", names.join(", ")))
            .remedy(format!("correct `{what}_name`, or leave it out to take the first"))
    })
}

fn input_size(input: &Outlet, params: &OnnxParams) -> Result<InputSize, Fault> {
    let name = &input.name;
    let Some((ty, shape)) = &input.tensor else {
        return Err(Fault::new(format!("input `{name}` of the network is no tensor")));
    };
    if *ty != TensorElementType::Float32 {
        return Err(Fault::new(format!("input `{name}` of the network holds {ty}, where f32 is wanted"))
            .remedy("export the model with an input of f32 values"));
    }
    let order = match params.layout {
        TensorLayout::Nchw => "batch x channels x rows x columns (layout: nchw)",
        TensorLayout::Nhwc => "batch x rows x columns x channels (layout: nhwc)",
    };
    let wrong = || {
        Fault::new(format!("input `{name}` of the network has the shape {}, which is not {order}", shown(shape)))
            .remedy("`layout` is nchw or nhwc; channels must be 1 or 3, the batch 1 or open (or 2, with `flip`)")
    };
    let &[batch, a, b, c] = &shape[..] else { return Err(wrong()) };
    let (channels, height, width) = match params.layout {
        TensorLayout::Nchw => (a, b, c),
        TensorLayout::Nhwc => (c, a, b),
    };
    // An open number of channels is taken to be three.
    let channels = if channels == -1 { 3 } else { channels };
    if !(batch == 1 || batch == -1 || batch == params.flip.images() as i64) || !(channels == 1 || channels == 3) {
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

/// That neither what the model states nor what an image becomes takes more memory than there is for one call.
fn check_memory(declared: &Declared, size: InputSize, params: &OnnxParams) -> Result<(), Fault> {
    if let Some((name, sides)) = &declared.largest {
        let bytes = elements(sides).saturating_mul(size_of::<f32>() as u64);
        TooMuch::check(bytes).map_err(|error| {
            Fault::new(format!("the network states a tensor `{name}` of {}", shown(sides)))
                .because(error)
                .remedy("export the model for a smaller image")
        })?;
    }
    // The image at the network's size, in bytes and in f32; its tensors, ours and the engine's; a map each.
    let (image, tensors) = (3 + 12, params.flip.images() * 4 * (2 * size.channels + 1));
    TooMuch::check(bytes_of(&[size.width, size.height], image + tensors)).map_err(too_large).map_err(|fault| {
        Fault::new(format!("the network's image is {}x{}", size.width, size.height))
            .because(fault)
            .remedy("export the model for a smaller image, or say which by a smaller `size`")
    })
}

fn too_large(error: TooMuch) -> Fault {
    Fault::new(error.to_string())
}

fn check_output(output: &Outlet) -> Result<(), Fault> {
    let holds = match &output.tensor {
        Some((TensorElementType::Float32, _)) => return Ok(()),
        Some((other, _)) => other.to_string(),
        None => "no tensor".to_owned(),
    };
    Err(Fault::new(format!("output `{}` of the network holds {holds}, where f32 is wanted", output.name))
        .remedy("name another output by `output_name`, or export the model with an output of f32 values"))
}

/// Columns and rows of an output that is one map for each image: two axes, and beside them only the batch and a channel of one.
fn map_size(shape: &[i64], batch: usize) -> Option<(usize, usize)> {
    let shape: Vec<usize> = shape.iter().map(|&side| usize::try_from(side).ok()).collect::<Option<_>>()?;
    let (images, height, width) = match *shape.as_slice() {
        [height, width] => (1, height, width),
        [images, height, width] | [images, 1, height, width] | [images, height, width, 1] => (images, height, width),
        _ => return None,
    };
    (images == batch && width > 0 && height > 0).then_some((width, height))
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
            assert_eq!(map_size(shape, 1), Some((320, 96)), "{shape:?}");
        }
        for shape in [&[320][..], &[2, 96, 320], &[1, 3, 96, 320], &[1, 1, 0, 320], &[]] {
            assert_eq!(map_size(shape, 1), None, "{shape:?}");
        }
        for shape in [&[2, 96, 320][..], &[2, 1, 96, 320], &[2, 96, 320, 1]] {
            assert_eq!(map_size(shape, 2), Some((320, 96)), "{shape:?}");
        }
        for shape in [&[96, 320][..], &[1, 96, 320], &[1, 1, 96, 320], &[4, 96, 320]] {
            assert_eq!(map_size(shape, 2), None, "{shape:?}");
        }
        assert_eq!(shown(&[1, 3, -1, 320]), "1x3x?x320");
    }
}
