//! `stereo/onnx`: any network that maps a rectified pair to disparity.

use std::sync::Arc;

use depthloom_graphs::contracts::{Contract, NodeDeclaration, Signature};
use depthloom_graphs::values::{Artifact, Calibration, Depth, Image};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Key, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_kernels::memory::TooMuch;

use super::onnx_network::{PairNetwork, View};
use super::onnx_params::{StereoOnnxParams, StereoOutput};
use crate::geometry::pair_calibration;
use crate::onnx::{self, Fitted, Preprocessing, count_non_finite};
use crate::shape::{filled, same_size};

pub(crate) struct StereoOnnx {
    params: StereoOnnxParams,
    network: onnx::CachedNetwork<PairNetwork>,
}

impl Node for StereoOnnx {
    type Params = StereoOnnxParams;

    const OWN_PORTS: bool = true;

    fn declaration() -> NodeDeclaration {
        let Signature { contract, inputs, outputs, .. } =
            signature(&StereoOnnxParams { right_view: true, ..Default::default() });
        NodeDeclaration {
            kind: "stereo/onnx",
            version: 3,
            contract,
            summary: "Disparity and depth by a network: any ONNX model that maps a rectified pair to one map.",
            doc: "\
**Input.** Both images are brought to the network's size, scaled to [0, `white`], and normalised by `mean` and \
`std`. The network has one input per image, or one input that takes both images as channels (six, or two for grey). \
With `fit: pad`, rows and columns are added up to the next `multiple` and removed from the output; no pixel of the \
image is changed. With `fit: resize`, images are resized, the output is resized back (bilinear, half-pixel centres), \
and disparities are scaled by the ratio of the widths.\n\n\
A map smaller than the network's input, for example by its stride, is first enlarged to it; its values stay \
unchanged. Use `output_scale: 4` if they are pixels of a quarter-size image.\n\n\
**Output.** `disparity` has the network's own numbers, and metrics use them unrounded; checks and filters round them \
to 1/16 px. `depth` is computed from the same numbers: `Z = min(f * B / (d + doffs), cap)`. A pixel is invalid where \
the network returns NaN or infinity, where the disparity is below `min_disparity`, or where `d + doffs <= 0`.\n\n\
With `right_view`, the network also sees the mirrored right image as left and the mirrored left image as right. Its \
output, mirrored back, is the right image's disparity, negative, as `disparity/left-right` expects it. Both views \
are one batch if the model's batch size is open or 2.\n\n\
**Model.** Inputs may be f32, f16 or u8, outputs f32, f16 or f64. The model is a file (`model: { file: net.onnx }`) \
with its weights inside. `depthloom inspect FILE` prints its inputs and outputs and the lines for an experiment. \
Engines, providers and cache keys are those of `mono/onnx`.",
            inputs,
            outputs,
        }
    }

    fn signature(params: &StereoOnnxParams) -> Option<Signature> {
        Some(signature(params))
    }

    fn check(params: &StereoOnnxParams) -> Result<(), (&'static str, String)> {
        onnx::check_preprocessing(params.std, params.resize, params.round)?;
        if params.output_scale == 0.0 {
            return Err(("output_scale", "output_scale is 0, expected another number".to_owned()));
        }
        Ok(())
    }

    fn fingerprint(params: &StereoOnnxParams) -> Result<Option<Key>, Fault> {
        onnx::engine_key(params.provider)
    }

    fn build(params: StereoOnnxParams) -> Result<Instance, Fault> {
        onnx::find()?.prepare(params.provider)?;
        Ok(Instance::Pure(Box::new(Self { params, network: onnx::CachedNetwork::default() })))
    }
}

fn signature(params: &StereoOnnxParams) -> Signature {
    let mut inputs = vec![
        Port::frame("left", ValueType::Image, "The left image of a rectified pair, grey or RGB."),
        Port::frame("right", ValueType::Image, "The right image; same size as `left`."),
        Port::once(
            "model",
            ValueType::Model,
            "The network: an ONNX model with two image inputs, or one input for both images.",
        ),
    ];
    if params.wants_calibration() {
        inputs.push(Port::frame(
            "calibration",
            ValueType::Calibration,
            "Focal length and baseline; required by `depth: true` and by networks that output depth.",
        ));
    }
    let mut outputs =
        vec![Port::frame("disparity", ValueType::Disparity, "Disparity of the left image, floating point.")];
    if params.depth {
        outputs.push(Port::frame("depth", ValueType::Depth, "Depth, f32 metres, NaN = invalid; with `depth: true`."));
    }
    if params.right_view {
        let doc = "Disparity of the right image, negative; with `right_view: true`.";
        outputs.push(Port::frame("disparity_right", ValueType::Disparity, doc));
    }
    Signature { contract: Contract::Pure, inputs, outputs, observes: None }
}

impl StereoOnnx {
    fn network(&self, model: &Artifact) -> Result<Arc<PairNetwork>, Fault> {
        self.network.get(model, || PairNetwork::load(model, &self.params))
    }

    fn preprocessing(&self) -> Preprocessing {
        let StereoOnnxParams { channels, mean, std, white, resize, round, pad_with, .. } = self.params;
        Preprocessing { channels, mean, std, white, resize, round, pad_with }
    }

    /// px of the image, in place; NaN where invalid.
    fn pixels(&self, map: &mut [f32], fitted: &Fitted, calibration: Option<&Calibration>) {
        let scale = self.params.output_scale;
        let of_lengths = match self.params.output {
            StereoOutput::DisparityPx => Some(scale * fitted.columns_back(1.0)),
            StereoOutput::DisparityShare => Some(scale * fitted.columns_back(fitted.to.0 as f64)),
            StereoOutput::InverseDepth | StereoOutput::Depth => None,
        };
        let least = self.params.min_disparity as f32;
        for value in map {
            let px = match (of_lengths, calibration) {
                (Some(factor), _) => *value * factor as f32,
                (None, Some(calibration)) => {
                    let given = f64::from(*value) * scale;
                    let metres = if self.params.output == StereoOutput::Depth { given } else { 1.0 / given };
                    // Depths that are not positive are invalid.
                    if metres > 0.0 { calibration.disparity_px(metres) as f32 } else { f32::NAN }
                }
                (None, None) => f32::NAN,
            };
            *value = if px.is_finite() && px >= least { px } else { f32::NAN };
        }
    }

    fn depth(&self, px: &[f32], calibration: &Calibration, size: (u32, u32)) -> Depth {
        let (metre_pixels, doffs) = (calibration.focal_baseline_px_m() as f32, calibration.doffs_px as f32);
        let cap = self.params.cap.map_or(f32::INFINITY, |cap| cap as f32);
        let metres = filled(size, |out: &mut [f32]| {
            for (metres, px) in out.iter_mut().zip(px) {
                let px = px + doffs;
                *metres = if px > 0.0 { (metre_pixels / px).min(cap) } else { f32::NAN };
            }
        });
        Depth { metres }
    }
}

/// More than nine tenths.
fn nearly_all_negative(map: &[f32], scale: f64) -> bool {
    let (mut all, mut negative) = (0_u64, 0_u64);
    for value in map.iter().filter(|value| !value.is_nan()) {
        (all, negative) = (all + 1, negative + u64::from(f64::from(*value) * scale < 0.0));
    }
    negative * 10 > all * 9
}

/// `sign` is -1 for the right image.
fn disparity(px: &[f32], sign: f32, size: (u32, u32)) -> Value {
    Value::disparity_from_px(filled(size, |out: &mut [f32]| {
        out.iter_mut().zip(px).for_each(|(out, px)| *out = px * sign);
    }))
}

impl PureNode for StereoOnnx {
    fn prepare(&self, files: &Inputs<'_>) -> Result<(), Fault> {
        files.optional::<Artifact>("model")?.map_or(Ok(()), |model| self.network(model).map(|_| ()))
    }

    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = (inputs.get::<Image>("left")?, inputs.get::<Image>("right")?);
        let size = left.dimensions();
        same_size(("left", size), ("right", right.dimensions()))?;
        let calibration = match self.params.wants_calibration() {
            true => Some(pair_calibration(inputs)?),
            false => None,
        };
        let network = self.network(inputs.get::<Artifact>("model")?)?;
        let fitted = network.fitted((size.0 as usize, size.1 as usize))?;
        let mut views = vec![View { first: left, second: right, mirrored: false }];
        if self.params.right_view {
            views.push(View { first: right, second: left, mirrored: true });
        }
        let too_large =
            |error: TooMuch| Fault::new(error.to_string()).remedy("use smaller images, or `fit: resize` with a `size`");
        let maps = network.run(&views, &fitted, &self.preprocessing())?;
        let mut outputs = Outputs::none();
        for (view, map) in views.iter().zip(maps) {
            let mut px = fitted.map_back(map.values, map.size).map_err(too_large)?;
            let seen = count_non_finite(&px);
            if seen > 0 {
                ctx.host.warn_n(seen as u64, "pixels of the network's output are NaN or infinite, and so invalid");
            }
            let is_disparity = matches!(self.params.output, StereoOutput::DisparityPx | StereoOutput::DisparityShare);
            if is_disparity && self.params.min_disparity >= 0 && nearly_all_negative(&px, self.params.output_scale) {
                ctx.host.warn("more than 90 % of the network's disparities are negative, and so invalid: set `output_scale: -1` if the network outputs negative disparities");
            }
            self.pixels(&mut px, &fitted, calibration);
            if view.mirrored {
                px.chunks_exact_mut(fitted.from.0).for_each(<[f32]>::reverse);
                outputs = outputs.with("disparity_right", disparity(&px, -1.0, size));
                continue;
            }
            outputs = outputs.with("disparity", disparity(&px, 1.0, size));
            if let (true, Some(calibration)) = (self.params.depth, calibration) {
                outputs = outputs.with("depth", self.depth(&px, calibration, size));
            }
        }
        Ok(outputs)
    }
}

#[cfg(test)]
mod tests {
    use super::nearly_all_negative;

    #[test]
    fn disparities_of_the_other_sign_are_noticed_and_a_few_that_are_off_are_not() {
        let disparities = |negative: usize, other: f32| -> Vec<f32> {
            (0..100).map(|k| if k < negative { -3.0 } else { other }).collect()
        };
        assert!(nearly_all_negative(&disparities(100, 0.0), 1.0) && nearly_all_negative(&disparities(91, 2.0), 0.5));
        assert!(nearly_all_negative(&disparities(1, f32::NAN), 1.0) && nearly_all_negative(&disparities(0, 2.0), -1.0));
        assert!(!nearly_all_negative(&disparities(90, 2.0), 1.0) && !nearly_all_negative(&disparities(100, 2.0), -1.0));
        assert!(!nearly_all_negative(&[f32::NAN; 4], 1.0) && !nearly_all_negative(&[], 1.0));
    }
}
