//! A network in the process's engine: loaded, checked, and as many sessions as work at once.

use depthloom_graphs::Fault;
use depthloom_graphs::values::Artifact;
use depthloom_kernels::memory::{TooMuch, bytes_of, zeros};
use ort::value::TensorElementType;

use super::input::InputSize;
use super::model::{Declared, Outlet, elements};
use super::params::{OnnxParams, Output, TensorLayout};
use super::pool::{self, Pool};
use super::session::{Binding, Element, Feed, Given};

/// What a network gave: a map for each image, one after the other, row by row.
pub struct NetworkMaps {
    /// The maps' values.
    pub values: Vec<f32>,
    /// Columns of a map.
    pub width: usize,
    /// Rows of a map.
    pub height: usize,
}

/// A network, ready to run.
pub struct Network {
    pool: Pool,
    /// How many images one run takes.
    batch: usize,
    /// The size of the image it wants.
    pub size: InputSize,
    /// What its map means.
    pub meaning: Output,
}

impl Network {
    /// Loads a model and checks that it maps an image to a map.
    ///
    /// # Errors
    /// If it is no model, or of other inputs, rank or type than a network of depth has.
    pub fn load(model: &Artifact, params: &OnnxParams) -> Result<Self, Fault> {
        let declared = pool::declared(model, params.provider)?;
        let Declared { inputs, outputs, .. } = &declared;
        let input = outlet("input", inputs, params.input_name.as_deref())?;
        let output = outlet("output", outputs, params.output_name.as_deref())?;
        if let (None, [_, other, ..]) = (&params.input_name, &inputs[..]) {
            return Err(Fault::new(format!("the network has several inputs ({}, {}, ...)", input.name, other.name))
                .remedy(
                    "`mono/onnx` runs networks of one image; `stereo/onnx` takes two, `onnx` whatever its ports say",
                ));
        }
        let size = input_size(input, params)?;
        check_output(output)?;
        let batch = batch(input, output, params);
        check_memory(&declared, size, params)?;
        let meaning = meaning(&declared, params)?;
        let shape = match params.layout {
            TensorLayout::Nchw => vec![batch, size.channels, size.height, size.width],
            TensorLayout::Nhwc => vec![batch, size.height, size.width, size.channels],
        };
        let feed = Feed { name: input.name.clone(), element: Element::F32, shape };
        let binding = Binding { inputs: vec![feed], outputs: vec![output.name.clone()] };
        let pool = Pool::load(model, params.provider, params.threads, binding)?;
        let network = Self { pool, batch, size, meaning };
        match output.tensor.as_ref().map(|(_, shape)| shape) {
            Some(shape) if !shape.is_empty() && shape.iter().all(|&side| side >= 0) => {
                map_size(shape, batch).ok_or_else(|| network.no_map(shape))?;
            }
            // What it leaves open, a black image shows.
            _ => {
                network.run(&zeros::<f32>(batch * size.samples()).map_err(too_large)?)?;
            }
        }
        Ok(network)
    }

    /// Runs the network on the tensors of as many images as its parameters ask for, one after the other.
    ///
    /// # Errors
    /// If the engine fails, or the output is no single map for each image.
    pub fn run(&self, tensors: &[f32]) -> Result<NetworkMaps, Fault> {
        let mut maps = NetworkMaps { values: Vec::new(), width: 0, height: 0 };
        for tensor in tensors.chunks_exact(self.batch * self.size.samples()) {
            for Given { shape, mut values } in self.pool.run(&[tensor])? {
                let (width, height) = map_size(&shape, self.batch).ok_or_else(|| self.no_map(&shape))?;
                maps.values.append(&mut values);
                (maps.width, maps.height) = (width, height);
            }
        }
        Ok(maps)
    }

    fn no_map(&self, shape: &[i64]) -> Fault {
        let each = if self.batch == 1 { String::new() } else { format!(" for each of {} images", self.batch) };
        let (name, shape) = (&self.pool.binding.outputs[0], shown(shape));
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

pub(crate) fn outlet<'a>(what: &str, outlets: &'a [Outlet], name: Option<&str>) -> Result<&'a Outlet, Fault> {
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

pub(super) fn too_large(error: TooMuch) -> Fault {
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

pub(super) fn shown(shape: &[i64]) -> String {
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
