//! A monocular network in the process's engine: looked at, checked, and as many sessions as work at once.

use depthloom_graphs::Fault;
use depthloom_graphs::values::{Artifact, Image};
use depthloom_kernels::memory::{TooMuch, bytes_of, zeros};
use ort::value::TensorElementType;

use super::binding::Element;
use super::fit::{Fitted, PadAt, Sizes};
use super::flip::Flip;
use super::model::{Declared, Outlet, elements};
use super::params::{OnnxParams, Output};
use super::pool::{self, Pool, PoolInput, Pools};
use super::preprocessing::Preprocessing;
use super::shapes::{Axes, Maps, batch, check_map, map_of, map_output, outlet, planes, shape_text, sizes};

pub(crate) struct Network {
    params: OnnxParams,
    sizes: Sizes,
    pub meaning: Output,
    pools: Pools,
}

impl Network {
    /// Loads the model at once if the size of its image is known.
    pub(crate) fn load(model: &Artifact, params: &OnnxParams) -> Result<Self, Fault> {
        let declared = pool::declared(model, params.provider)?;
        let Declared { inputs, outputs, .. } = &declared;
        let input = outlet("input", inputs, params.input_name.as_deref())?;
        if let (None, [_, other, ..]) = (&params.input_name, &inputs[..]) {
            return Err(Fault::new(format!("the network has several inputs ({}, {}, ...)", input.name, other.name))
                .remedy(
                    "`mono/onnx` runs networks of one image; use `stereo/onnx` for two images, `onnx` for other inputs",
                ));
        }
        let axes = image_axes(input, params)?;
        let named = [(input.name.as_str(), axes)];
        let sizes = Sizes { side: params.side(), ..sizes(&named, params.size, params.multiple.unwrap_or(1))? };
        if sizes.side.is_some() && (sizes.width.is_some() || sizes.height.is_some()) {
            let shape = input.tensor.as_ref().map_or_else(String::new, |(_, shape)| shape_text(shape));
            let what =
                format!("the network fixes the size of its image: its input `{}` has the shape {shape}", input.name);
            return Err(Fault::new(what).remedy(
                "remove `short_side` and `long_side`: the image is resized to this size; or export the network with an open size",
            ));
        }
        let is_open = sizes.width.is_none() || sizes.height.is_none();
        if is_open && params.multiple.is_none() && sizes.side.is_none() {
            let shape = input.tensor.as_ref().map_or_else(String::new, |(_, shape)| shape_text(shape));
            let what = format!(
                "the network leaves the size of its image open: its input `{}` has the shape {shape}",
                input.name
            );
            return Err(Fault::new(what).remedy(
                "set `size: [width, height]`, `short_side` with `multiple`, or `multiple` alone (14 or 32, depending on the network), to which the size of the image is rounded up",
            ));
        }
        let output = map_output(outputs, params.output_name.as_deref(), (sizes.width, sizes.height))?;
        check_output(output)?;
        let spread = params.spread_name.as_deref().map(|name| outlet("output", outputs, Some(name))).transpose();
        let spread = spread.map_err(|fault| fault.remedy("correct `spread_name`, or leave it out"))?;
        spread.map_or(Ok(()), check_output)?;
        let images = batch(&named, output, params.flip.images())?;
        let input = PoolInput { name: input.name.clone(), axes, images, planes: axes.channels.unwrap_or(3) };
        let engine = (params.provider, params.threads);
        let network = Self {
            params: params.clone(),
            sizes,
            meaning: meaning(&declared, params)?,
            pools: Pools::new(
                model,
                engine,
                vec![input],
                std::iter::once(output).chain(spread).map(|output| output.name.clone()).collect(),
            ),
        };
        check_largest(&declared)?;
        let (Some(width), Some(height)) = (sizes.width, sizes.height) else { return Ok(network) };
        network.check_memory((width, height))?;
        let pool = network.pools.get((width, height))?;
        match output.tensor.as_ref().map(|(_, shape)| shape) {
            Some(shape) if !shape.is_empty() && shape.iter().all(|&side| side >= 0) => {
                check_map(shape, &output.name, (images, (width, height)), params.head, params.layout)?;
            }
            // What it leaves open, a black image shows.
            _ => {
                let samples = images * network.input().planes * width * height;
                network.maps(&pool, &zeros::<f32>(samples).map_err(too_large)?, (width, height))?;
            }
        }
        Ok(network)
    }

    pub(crate) fn fitted(&self, from: (usize, usize)) -> Result<Fitted, Fault> {
        Fitted::new(from, self.sizes, self.params.fit, PadAt::BottomRight)
    }

    /// The maps of depth and, with `spread_name`, of its standard deviation. With `flip`, the map of the mirrored image
    /// follows that of the image.
    pub(crate) fn run(
        &self,
        image: &Image,
        fitted: &Fitted,
        preprocessing: &Preprocessing,
    ) -> Result<Vec<Maps>, Fault> {
        self.check_memory(fitted.to)?;
        let pool = self.pools.get(fitted.to)?;
        let views: &[bool] = if self.params.flip == Flip::None { &[false] } else { &[false, true] };
        let empty = || Maps { values: Vec::new(), size: (0, 0) };
        let mut all: Vec<Maps> = self.pools.outputs.iter().map(|_| empty()).collect();
        for views in views.chunks(self.input().images) {
            let mut tensor = Vec::new();
            for &mirrored in views {
                let planes = preprocessing.planes(image, self.input().planes, fitted, mirrored).map_err(too_large)?;
                self.input().axes.laid_out(&planes, &mut tensor);
            }
            for (all, mut found) in all.iter_mut().zip(self.maps(&pool, &tensor, fitted.to)?) {
                all.values.append(&mut found.values);
                all.size = found.size;
            }
        }
        Ok(all)
    }

    fn maps(&self, pool: &Pool, tensor: &[f32], of_image: (usize, usize)) -> Result<Vec<Maps>, Fault> {
        let batch = (self.input().images, of_image);
        // Several maps of depth may share an output; the spread has its own.
        let heads = [self.params.head, None];
        let outputs = pool.run(&[tensor])?.into_iter().zip(&self.pools.outputs).zip(heads);
        outputs.map(|((given, name), head)| map_of(given, name, batch, head, self.params.layout)).collect()
    }

    fn input(&self) -> &PoolInput {
        &self.pools.inputs[0]
    }

    fn check_memory(&self, (width, height): (usize, usize)) -> Result<(), Fault> {
        // The image at the network's size, in bytes and in f32; its tensors, ours and the engine's; a map each.
        let (image, tensors) = (3 + 12, self.params.flip.images() * 4 * (2 * self.input().planes + 1));
        TooMuch::check(bytes_of(&[width, height], image + tensors)).map_err(too_large).map_err(|fault| {
            Fault::new(format!("the network's image is {width}x{height}"))
                .because(fault)
                .remedy("export the model for a smaller image, or set a smaller `size`")
        })
    }
}

/// Metadata key by which a model names the meaning of its output; written by `learn/ssl`.
const MEANING: &str = "depthloom.output";

/// The parameter wins over the model's metadata, unless they contradict each other.
fn meaning(declared: &Declared, params: &OnnxParams) -> Result<Output, Fault> {
    let Some(stated) = declared.metadata(MEANING) else { return Ok(params.output.unwrap_or_default()) };
    let of_model = serde_json::from_value(stated.into()).map_err(|_| {
        Fault::new(format!("the metadata of the network state the output `{stated}`, which is not supported"))
            .remedy("a newer version of this program may have written it")
    })?;
    match params.output {
        Some(requested) if requested != of_model => Err(Fault::new(format!(
            "the metadata of the network state the output `{stated}`, which contradicts `output`"
        ))
        .remedy("leave `output` out")),
        // The output port follows from the parameter, before any model is read.
        None if of_model == Output::RelativeInverseDepth => Err(Fault::new(format!(
            "the metadata of the network state the output `{stated}`, which needs the same `output`"
        ))
        .remedy("set `output: relative-inverse-depth` and use the output `inverse`")),
        _ => Ok(of_model),
    }
}

fn image_axes(input: &Outlet, params: &OnnxParams) -> Result<Axes, Fault> {
    let shape = input.tensor.as_ref().map_or(&[][..], |(_, shape)| shape.as_slice());
    let axes = planes(input, params.layout);
    let is_image = |axes: &Axes| {
        shape.len() == 4
            && matches!(axes.channels, None | Some(1 | 3))
            && axes.batch.is_none_or(|batch| batch == 1 || batch == params.flip.images())
    };
    match axes {
        Ok(axes) if is_image(&axes) => Ok(axes),
        Err(fault) if input.tensor.as_ref().is_none_or(|(element, _)| Element::from_ort(*element).is_none()) => {
            Err(fault)
        }
        _ => {
            let order = params.layout.axes();
            let (name, shape) = (&input.name, shape_text(shape));
            Err(Fault::new(format!("input `{name}` of the network has the shape {shape}, which is not {order}"))
                .remedy("`layout` is nchw or nhwc; channels must be 1 or 3, the batch 1 or open (or 2, with `flip`)"))
        }
    }
}

fn check_largest(declared: &Declared) -> Result<(), Fault> {
    let Some((name, sides)) = &declared.largest else { return Ok(()) };
    let bytes = elements(sides).saturating_mul(size_of::<f32>() as u64);
    TooMuch::check(bytes).map_err(|error| {
        Fault::new(format!("the network states a tensor `{name}` of {}", shape_text(sides)))
            .because(error)
            .remedy("export the model for a smaller image")
    })
}

pub(super) fn too_large(error: TooMuch) -> Fault {
    Fault::new(error.to_string())
}

fn check_output(output: &Outlet) -> Result<(), Fault> {
    let holds = match &output.tensor {
        Some((TensorElementType::Float32 | TensorElementType::Float16 | TensorElementType::Float64, _)) => {
            return Ok(());
        }
        Some((other, _)) => other.to_string(),
        None => "no tensor".to_owned(),
    };
    Err(Fault::new(format!("output `{}` of the network holds {holds}, expected f32, f16 or f64", output.name))
        .remedy("name another output by `output_name`, or export the model with an output of f32 values"))
}
