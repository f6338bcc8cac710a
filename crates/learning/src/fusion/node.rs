//! The kind `learn/fusion`.

use std::sync::Arc;

use depthloom_graphs::contracts::{Contract, InputOrigin, NodeDeclaration, Upstream};
use depthloom_graphs::values::Artifact;
use depthloom_graphs::{AggregateNode, Context, Fault, Inputs, Instance, Key, Node, Outputs, Port, Value, ValueType};

use super::batch::window;
use super::objective::Fusion;
use super::params::FusionParams;
use crate::compute::ARITHMETIC;
use crate::networks::{FusionUnet, Size, export, layout};
use crate::samples::{CollectFusionSamples, FusionSamplesParams, SamplesView};
use crate::training::{self, check_curve, check_patience, on_threads};

/// Raised whenever equal samples and parameters give another network.
const VERSION: u32 = 1;

pub(crate) struct TrainFusion(FusionParams);

impl Node for TrainFusion {
    type Params = FusionParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "learn/fusion",
            version: VERSION,
            contract: Contract::Once,
            summary: "Trains a network to fuse stereo with monocular depth, without ground truth.",
            doc: "\
The network is a U-Net of 144 k parameters. It sees image, stereo, monocular depth, left-right consistency and confidence. Its maps are a gate `g` in [0, 1], a \
residual `r` and a spread `b`; in log depth, the result is `g z_s + (1 - g)(z_m + r)`, or `z_m + r` where stereo is invalid. The residual is averaged over blocks of 8x8 pixels of the network's image: it \
cannot copy stereo. `fusion/learned` runs it.\n\n\
Training sees windows of the samples. In random blocks, stereo is hidden, replaced by wrong disparities, or not confirmed by the right view. The loss is the \
negative log likelihood of a Laplace distribution, `|e| / b + ln b`, where `e` is the error in log depth against trusted stereo. Pixels at which the input \
shows the target have the weight `shown`; the learning curve shows the mean loss of the others.\n\n\
Windows and blocks depend only on `seed` and the step. So the same samples give the same network, bit for bit, with any number of workers, and after a kill and \
a resume. With `validation`, the output is the network with the lowest loss on blocks of these samples, and `patience` stops early.\n\n\
The network is an ONNX file (opset 13): input `planes`, Nx8xHxW; output `fusion`, Nx3xHxW in [0, 1].",
            inputs: vec![
                Port::once("samples", ValueType::Samples, "The training samples: `learn/fusion-samples`."),
                Port::once("validation", ValueType::Samples, "Samples of another stage, to select the best network.")
                    .optional(),
            ],
            outputs: vec![
                Port::once("model", ValueType::Model, "The network, ONNX."),
                Port::once("curve", ValueType::Curve, "Loss, validation loss and learning rate against steps."),
            ],
        }
    }

    fn check(params: &FusionParams) -> Result<(), (&'static str, String)> {
        check_curve(&params.settings())?;
        if params.hidden + params.wrong > 1.0 {
            let sum = params.hidden + params.wrong;
            return Err(("wrong", format!("hidden and wrong are shares of all blocks and add up to {sum}")));
        }
        let multiple = FusionUnet::MULTIPLE as u32;
        if let Some(window) = params.window
            && window.iter().any(|side| *side == 0 || !side.is_multiple_of(multiple))
        {
            return Err(("window", format!("window is {window:?}, whose sides are not multiples of {multiple}")));
        }
        Ok(())
    }

    fn check_inputs(params: &FusionParams, upstream: &Upstream<'_>) -> Result<(), Fault> {
        check_patience(&params.settings(), upstream.at("validation").is_some())?;
        for port in ["samples", "validation"] {
            let Some(InputOrigin::Node(node)) = upstream.at(port) else { continue };
            if let Some(FusionSamplesParams { size: [width, height], .. }) = node.params_of(CollectFusionSamples::KIND)
            {
                check_size(params, port, Size { width: width as usize, height: height as usize })?;
            }
        }
        Ok(())
    }

    fn fingerprint(_params: &FusionParams) -> Result<Option<Key>, Fault> {
        Ok(Some(Key::build("learning").text(ARITHMETIC).finish()))
    }

    fn build(params: FusionParams) -> Result<Instance, Fault> {
        Ok(Instance::Once(Box::new(Self(params))))
    }
}

impl AggregateNode for TrainFusion {
    fn run(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let Self(params) = self;
        let samples = read(params, "samples", inputs.get::<Artifact>("samples")?)?;
        let validation = inputs.optional::<Artifact>("validation")?;
        let validation = validation.map(|artifact| read(params, "validation", artifact)).transpose()?;
        check_patience(&params.settings(), validation.is_some())?;
        let size = Size { width: samples.width(), height: samples.height() };
        let layout = layout(FusionUnet, window(params, size));
        let objective = Fusion { params, samples: &samples, validation: validation.as_ref() };
        let learn = || training::learn(&objective, &layout, || Ok(layout.start(params.seed)), ctx.host);
        let (values, curve) = on_threads(params.batch, ctx.host, learn)??;
        let key = ctx.host.key().map_or_else(String::new, |key| key.to_string());
        let file = export(FusionUnet, size, &values, &key);
        Ok(Outputs::one("model", Value::Model(Arc::new(Artifact::model(file)))).with("curve", curve))
    }
}

fn check_size(params: &FusionParams, port: &str, size: Size) -> Result<(), Fault> {
    let Size { width, height } = size;
    let multiple = FusionUnet::MULTIPLE;
    if !width.is_multiple_of(multiple) || !height.is_multiple_of(multiple) {
        let up = |side: usize| side.next_multiple_of(multiple);
        return Err(Fault::new(format!(
            "the network requires images whose sides are multiples of {multiple}; the samples at `{port}` are {width}x{height}"
        ))
        .remedy(format!("set `size: [{}, {}]` at `learn/fusion-samples`", up(width), up(height))));
    }
    let window = window(params, size);
    if window.width > width || window.height > height {
        return Err(Fault::new(format!(
            "`window` is {}x{}, larger than the samples at `{port}` ({width}x{height})",
            window.width, window.height
        ))
        .remedy("lower `window`, or set it to null"));
    }
    Ok(())
}

/// The samples at a port, with cells and of a size that the network takes.
fn read<'a>(params: &FusionParams, port: &str, artifact: &'a Artifact) -> Result<SamplesView<'a>, Fault> {
    let samples = SamplesView::at_port(port, artifact)?;
    if !samples.has_cells() {
        return Err(Fault::new(format!("the samples at `{port}` have no stereo and no monocular depth"))
            .remedy("collect them with `learn/fusion-samples`"));
    }
    check_size(params, port, Size { width: samples.width(), height: samples.height() })?;
    Ok(samples)
}
