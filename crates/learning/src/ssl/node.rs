//! The kind `learn/ssl`.

use std::sync::Arc;

use depthloom_graphs::contracts::{Contract, NodeDeclaration, Upstream};
use depthloom_graphs::values::Artifact;
use depthloom_graphs::{AggregateNode, Context, Fault, Inputs, Instance, Key, Node, Outputs, Port, Value, ValueType};

use super::fits::Form;
use super::objective::SelfSupervision;
use super::params::SslParams;
use super::weights;
use crate::compute::ARITHMETIC;
use crate::networks::{Network, ParameterLayout, export, layout};
use crate::onnx::weights::NamedTensor;
use crate::samples::SamplesView;
use crate::training::{self, check_curve, check_patience, on_threads};

/// Raised whenever equal samples and parameters give another network.
const VERSION: u32 = 2;

pub(crate) struct Ssl {
    params: SslParams,
    weights: Option<Vec<NamedTensor>>,
}

impl Node for Ssl {
    type Params = SslParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "learn/ssl",
            version: VERSION,
            contract: Contract::Once,
            summary: "Trains a monocular network with the robot's own stereo, without ground truth.",
            doc: "\
The loss is that of the paper, the masked mean absolute error `l = mean over C of |Z_m - Z_s|` (Martins et al. 2018), on inverse depth, depth or log depth. With \
`penalty: berhu`, errors above a fifth of the batch's largest count by their square (Laina et al. 2016). \
With `photometric`, the left-right photometric loss of Godard et al. 2017 is added. The optimiser is Adam. A step's samples and their augmentation depend \
only on `seed` and the step, and gradients are added in a fixed order. So the same samples give the same network, bit for bit, with any number of workers. This \
also holds after a kill and a resume.\n\n\
The network is an ONNX file (opset 13). Its input is `image`, Nx3xHxW, RGB in [0, 1], area resized to the samples' size. Its output is `disparity_share` \
(disparity as a share of the image's width) or `depth` (metres, `eigen-coarse`). Its metadata state input size, normalisation, meaning and the training's cache \
key. With `spread`, a second output, `spread`, is the standard deviation of log depth. The loss is then the negative log likelihood of a Laplace \
distribution, `|e| / b + ln b` (Kendall, Gal 2017), whose gradient is weighted by `sqrt(b)` (Seitzer et al. 2022).\n\n\
The networks are `unet-lite` (1.07 M parameters), `unet-tiny` (70 k parameters), `fcn-lite` (without skips), `fcn-vgg16` and `eigen-coarse`. \
`fcn-vgg16` is the network of the paper; its first 8 convolutions keep the weights of the file `weights` (with the names of torchvision: `features.0.weight`). \
`eigen-coarse` is the paper's on-board network.\n\n\
With `validation`, samples of another stage, the output is the network with the lowest error on them, and `patience` stops early. Every `checkpoint_every` \
steps, the state is stored beside the run; if a run was killed or interrupted, repeating the command resumes the training there.",
            inputs: vec![
                Port::once("samples", ValueType::Samples, "The training samples: `learn/samples`."),
                Port::once("validation", ValueType::Samples, "Samples of another stage, to select the best network.")
                    .optional(),
            ],
            outputs: vec![
                Port::once("model", ValueType::Model, "The network, ONNX."),
                Port::once("curve", ValueType::Curve, "Loss, validation error and learning rate against steps."),
            ],
        }
    }

    fn check(params: &SslParams) -> Result<(), (&'static str, String)> {
        check_curve(&params.settings())?;
        if params.network == Network::FcnVgg16 && params.weights.is_none() {
            return Err((
                "weights",
                "fcn-vgg16 does not train its first 8 convolutions: set `weights` to a file of pretrained weights"
                    .to_owned(),
            ));
        }
        params.check_spread()
    }

    fn check_inputs(params: &SslParams, upstream: &Upstream<'_>) -> Result<(), Fault> {
        params.check_upstream(upstream)
    }

    fn fingerprint(_params: &SslParams) -> Result<Option<Key>, Fault> {
        Ok(Some(Key::build("learning").text(ARITHMETIC).finish()))
    }

    fn build(params: SslParams) -> Result<Instance, Fault> {
        let weights = params.weights.as_ref().map(|file| weights::read(file.path())).transpose()?;
        if let (Some(tensors), Some(file), Some(size)) = (&weights, &params.weights, params.network.any_size()) {
            weights::matched(&layout(params.architecture(), size), tensors, file.path())?;
        }
        Ok(Instance::Once(Box::new(Self { params, weights })))
    }
}

impl AggregateNode for Ssl {
    fn run(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let samples = SamplesView::at_port("samples", inputs.get::<Artifact>("samples")?)?;
        let validation = inputs.optional::<Artifact>("validation")?;
        let validation = validation.map(|artifact| SamplesView::at_port("validation", artifact)).transpose()?;
        let form = Form::new(&samples);
        self.params.check_form(&form, validation.as_ref().map(Form::new).as_ref())?;
        check_patience(&self.params.settings(), validation.is_some())?;
        let layout = layout(self.params.architecture(), form.size);
        let objective = SelfSupervision::new(&self.params, layout.map, &samples, validation.as_ref());
        let learn = || training::learn(&objective, &layout, || self.start(&layout), ctx.host);
        let (values, curve) = on_threads(self.params.batch, ctx.host, learn)??;
        let key = ctx.host.key().map_or_else(String::new, |key| key.to_string());
        let file = export(self.params.architecture(), form.size, &values, &key);
        Ok(Outputs::one("model", Value::Model(Arc::new(Artifact::model(file)))).with("curve", curve))
    }
}

impl Ssl {
    /// The first values: random ones, and in their place what the file of weights has.
    fn start(&self, layout: &ParameterLayout) -> Result<Vec<Vec<f32>>, Fault> {
        let mut values = layout.start(self.params.seed);
        if let (Some(weights), Some(file)) = (&self.weights, &self.params.weights) {
            weights::fill(layout, weights, file.path(), &mut values)?;
        }
        Ok(values)
    }
}
