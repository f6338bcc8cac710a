//! `onnx`: any network, its ports declared by the experiment.

mod loaded;
mod maps;
mod params;

use std::sync::Arc;

use depthloom_graphs::contracts::{Contract, NodeDeclaration, Signature, check_name};
use depthloom_graphs::values::Artifact;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Key, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::memory::TooMuch;

use crate::onnx::{self, Preprocessing, count_non_finite};
use loaded::Loaded;
pub(crate) use params::NetworkParams;
use params::{InputType, NetworkInput};

pub(crate) struct OnnxNetwork {
    params: NetworkParams,
    network: onnx::CachedNetwork<Loaded>,
}

const MODEL: &str = "model";

impl Node for OnnxNetwork {
    type Params = NetworkParams;

    const OWN_PORTS: bool = true;

    fn declaration() -> NodeDeclaration {
        let Signature { contract, inputs, outputs, .. } = signature(&NetworkParams::default());
        NodeDeclaration {
            kind: "onnx",
            version: 2,
            contract,
            summary: "Any network: an ONNX model whose inputs and outputs the experiment declares as ports.",
            doc: "\
`ports` declares the inputs and outputs: for each port the value type, the tensor name, and the conversion \
between the two. Example: `ports: { inputs: { image: { type: image, name: input.1, mean: [0.485, 0.456, \
0.406], std: [0.229, 0.224, 0.225] }, depth: { type: depth, form: inverse, scale: 10 } }, outputs: { weight: { type: \
weight, name: sure } } }`. Connect the ports like those of any other kind. The port `model` is added automatically.\n\n\
All inputs of a frame must have one size. They are brought to the size of the network, and its maps back, as in \
`stereo/onnx`: padded (no pixel is changed) or resized. Disparities are scaled with the width, in both directions.\n\n\
**From values to tensors.** A map becomes `value * scale + offset`; with `form: inverse`, `scale / value + offset`. \
Invalid pixels become `missing`.\n\n\
**From tensors to values.** An output becomes `tensor * scale + offset`, then its inverse with `form: inverse`. \
Depths not above 0, disparities below 0, NaN and infinity are invalid. Confidences are clamped to [0, 1]; NaN \
becomes 0.\n\n\
Tensors have 2 to 4 axes: rows and columns, optionally batch and channels (see `layout`). Inputs may be f32, f16 or \
u8. `depthloom inspect FILE` prints them and the lines for an experiment. Engines, providers and cache keys are \
those of `mono/onnx`.",
            inputs,
            outputs,
        }
    }

    fn signature(params: &NetworkParams) -> Option<Signature> {
        Some(signature(params))
    }

    fn check(params: &NetworkParams) -> Result<(), (&'static str, String)> {
        let ports = |what: String| Err(("ports", what));
        if params.ports.inputs.is_empty() || params.ports.outputs.is_empty() {
            return ports("ports is incomplete: at least one input and one output are required".to_owned());
        }
        let names = params.ports.inputs.keys().chain(params.ports.outputs.keys());
        for name in names {
            if let Err(what) = check_name(name) {
                return ports(format!("port `{name}`: {what}"));
            }
        }
        if params.ports.inputs.contains_key(MODEL) {
            return ports("ports.inputs contains `model`, which is added automatically: it is the network".to_owned());
        }
        let is_flat = |input: &NetworkInput| input.std.contains(&0.0) || input.scale == 0.0;
        if let Some((name, _)) = params.ports.inputs.iter().find(|(_, input)| is_flat(input)) {
            return ports(format!("port `{name}`: std or scale is 0, expected another number"));
        }
        onnx::check_resize(params.resize, params.round)
    }

    fn fingerprint(params: &NetworkParams) -> Result<Option<Key>, Fault> {
        onnx::engine_key(params.provider)
    }

    fn build(params: NetworkParams) -> Result<Instance, Fault> {
        onnx::find()?.prepare(params.provider)?;
        Ok(Instance::Pure(Box::new(Self { params, network: onnx::CachedNetwork::default() })))
    }
}

fn signature(params: &NetworkParams) -> Signature {
    let port = |(name, value_type): (&String, ValueType)| Port::frame(Port::intern(name), value_type, "");
    let mut inputs: Vec<Port> =
        params.ports.inputs.iter().map(|(name, input)| port((name, input.value_type.value_type()))).collect();
    inputs.push(Port::once(
        MODEL,
        ValueType::Model,
        "The network: an ONNX model; the other ports are those of `ports`.",
    ));
    let outputs =
        params.ports.outputs.iter().map(|(name, output)| port((name, output.value_type.value_type()))).collect();
    Signature { contract: Contract::Pure, inputs, outputs, observes: None }
}

impl OnnxNetwork {
    fn network(&self, model: &Artifact) -> Result<Arc<Loaded>, Fault> {
        self.network.get(model, || Loaded::new(model, &self.params))
    }

    fn preprocessing(&self, input: &NetworkInput) -> Preprocessing {
        let NetworkParams { resize, round, pad_with, .. } = self.params;
        let NetworkInput { channels, white, mean, std, .. } = *input;
        Preprocessing { channels, mean, std, white, resize, round, pad_with }
    }
}

impl PureNode for OnnxNetwork {
    fn prepare(&self, files: &Inputs<'_>) -> Result<(), Fault> {
        files.optional::<Artifact>(MODEL)?.map_or(Ok(()), |model| self.network(model).map(|_| ()))
    }

    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let network = self.network(inputs.get::<Artifact>(MODEL)?)?;
        let size = maps::common_size(inputs, &self.params.ports)?;
        let fitted = network.fitted((size.0 as usize, size.1 as usize), &self.params)?;
        let too_large = |error: TooMuch| {
            Fault::new(error.to_string()).remedy("take smaller images, or `fit: resize` with a `size`")
        };
        let mut tensors = Vec::with_capacity(self.params.ports.inputs.len());
        for ((name, input), fed) in self.params.ports.inputs.iter().zip(&network.pools.inputs) {
            let planes = match input.value_type {
                InputType::Image => self.preprocessing(input).planes(inputs.get(name)?, fed.planes, &fitted, false),
                _ => maps::plane(inputs, name, input, &fitted, self.params.pad_with)?.map(|plane| vec![plane]),
            };
            let mut tensor = Vec::new();
            fed.axes.laid_out(&planes.map_err(too_large)?, &mut tensor);
            tensors.push(tensor);
        }
        let tensors: Vec<&[f32]> = tensors.iter().map(Vec::as_slice).collect();
        let given = network.pools.get(fitted.to)?.run(&tensors)?;
        let mut outputs = Outputs::none();
        for (((name, output), tensor), given) in self.params.ports.outputs.iter().zip(&network.pools.outputs).zip(given)
        {
            let map = onnx::map_of(given, tensor, (1, fitted.to), output.head, output.layout)?;
            let map = fitted.map_back(map.values, map.size).map_err(too_large)?;
            let seen = count_non_finite(&map);
            if seen > 0 {
                let what = format!("pixels of the network's output `{tensor}` are NaN or infinite, and so invalid");
                ctx.host.warn_n(seen as u64, &what);
            }
            outputs = outputs.with(Port::intern(name), maps::value(map, output, &fitted, self.params.cap, size));
        }
        Ok(outputs)
    }
}
