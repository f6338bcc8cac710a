//! `mono/onnx`: any network that maps an image to depth.

use std::sync::Arc;

use depthloom_graphs::contracts::{Contract, NodeDeclaration, Signature};
use depthloom_graphs::values::{Artifact, Calibration, Depth, Image, Raster, RelativeInverseDepth};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Key, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_kernels::depth::depth_from_share;
use depthloom_kernels::memory::TooMuch;

use crate::geometry::{depth_from_inverse, geometry, of_pair};
use crate::onnx::{self, Fitted, Flip, Maps, Network, OnnxParams, Output, PadWith, Preprocessing, count_non_finite};
use crate::shape::filled;

/// Metres; the value that metrics clamp to.
const NEAREST_M: f32 = 1e-3;

pub(crate) struct Onnx {
    params: OnnxParams,
    network: onnx::CachedNetwork<Network>,
}

impl Node for Onnx {
    type Params = OnnxParams;
    const OWN_PORTS: bool = true;

    fn declaration() -> NodeDeclaration {
        let Signature { inputs, .. } = signature(None, false);
        NodeDeclaration {
            kind: "mono/onnx",
            version: 3,
            contract: Contract::Pure,
            summary: "Monocular depth by a network: any ONNX model that maps one image to one map.",
            doc: "\
**Input.** The image is resized to the network's size (with `fit: pad`, padded), scaled to [0, `white`], and \
normalised by `mean` and `std`.\n\n\
**Output.** The network's output is one map of any size. It is resized to the size of the image (bilinear, \
half-pixel centres) and converted to metres according to `output`. A disparity share `s` becomes `Z = min(f * B / \
max(s * width + doffs, floor_px), cap)`. `doffs` is 0 except for pairs whose cameras have different principal \
points.\n\n\
Depth is capped here, before any scaling. With `output: inverse-depth`, an alignment by scale and shift (`align` of \
`score/depth`) uses the network's own numbers, including zero, negative numbers and depths beyond the cap. Every \
other use sees the cap at these pixels, or 1e6 m without a cap.\n\n\
With `output: relative-inverse-depth` scale and shift are unknown, and there are no metres. The network's numbers, \
times `output_scale`, are the output `inverse`, which only `fusion/scale` accepts (`mono: relative-inverse-depth`). \
To score such a network without stereo, use `output: inverse-depth` with `align: scale-and-shift`.\n\n\
With `spread_name`, a second output of the network is the standard deviation of log depth, a map of any size. Times \
depth, it is the output `deviation`, in metres. It is invalid where the map is not above 0.\n\n\
**Invalid pixels.** A pixel is invalid where the network returns NaN or infinity, or where such a value contributes \
to a resized pixel. These pixels are counted and reported at the end of the run.\n\n\
**Model.** The model is a file (`model: { file: net.onnx }`) with its weights inside, or the output of a training \
stage. Its batch size is 1 or open. Each frame is one call; frames run in parallel in separate sessions. With \
`flip`, the network also sees the mirrored image, and both outputs are merged before the conversion to metres. This \
is one batch of two if the batch size of input and output is open or 2, otherwise two calls.\n\n\
**Engine.** depthloom looks for ONNX Runtime at `ORT_DYLIB_PATH`, in the system's library folders and in the active \
Python environment (`pip install onnxruntime`). If none is found, tract runs the network: it is built in, written in \
Rust, slower, and supports neither `threads` nor other providers than `cpu`. `DEPTHLOOM_ONNX_ENGINE=onnxruntime` or \
`tract` selects the engine. `depthloom doctor` prints the engine and its providers. Engine, version and provider are \
part of the cache keys, and `environment.json` next to a recording names them. A GPU provider runs operators that it \
lacks on the CPU, as ONNX Runtime does. A provider that is not available is an error.",
            inputs,
            outputs: vec![DEPTH, DEVIATION.optional(), INVERSE.optional()],
        }
    }

    fn signature(params: &OnnxParams) -> Option<Signature> {
        Some(signature(params.output, params.spread_name.is_some()))
    }

    fn check(params: &OnnxParams) -> Result<(), (&'static str, String)> {
        params.check()?;
        if params.size.is_some_and(|size| size.contains(&0)) {
            return Err(("size", "size is 0, expected at least 1 px".to_owned()));
        }
        if params.threads == 0 {
            return Err(("threads", "threads is 0, expected at least 1".to_owned()));
        }
        Ok(())
    }

    fn fingerprint(params: &OnnxParams) -> Result<Option<Key>, Fault> {
        onnx::engine_key(params.provider)
    }

    fn build(params: OnnxParams) -> Result<Instance, Fault> {
        onnx::find()?.prepare(params.provider)?;
        Ok(Instance::Pure(Box::new(Self { params, network: onnx::CachedNetwork::default() })))
    }
}

const DEPTH: Port = Port::frame(
    "depth",
    ValueType::Depth,
    "Depth, f32 metres, NaN = invalid; same size as the image. Absent with `output: relative-inverse-depth`.",
);
const DEVIATION: Port = Port::frame(
    "deviation",
    ValueType::Depth,
    "With `spread_name`: standard deviation of `depth`, f32 metres, NaN = invalid.",
);
const INVERSE: Port = Port::frame(
    "inverse",
    ValueType::RelativeInverseDepth,
    "With `output: relative-inverse-depth`, in place of `depth`: the network's numbers, larger = nearer, NaN = invalid; \
     same size as the image.",
);

fn signature(output: Option<Output>, has_spread: bool) -> Signature {
    let is_relative = output == Some(Output::RelativeInverseDepth);
    let calibration = Port::frame(
        "calibration",
        ValueType::Calibration,
        "Focal length and baseline; used if `output` is a disparity.",
    );
    let inputs = vec![
        Port::frame("image", ValueType::Image, "The image, grey or RGB."),
        if is_relative { calibration.optional() } else { calibration },
        Port::once(
            "model",
            ValueType::Model,
            "The network: an ONNX model with one input, 1x3xHxW or 1x1xHxW (or channels last), of f32, f16 or u8.",
        ),
    ];
    Signature {
        contract: Contract::Pure,
        inputs,
        outputs: match (is_relative, has_spread) {
            (true, _) => vec![INVERSE],
            (false, true) => vec![DEPTH, DEVIATION],
            (false, false) => vec![DEPTH],
        },
        observes: None,
    }
}

impl Onnx {
    fn network(&self, model: &Artifact) -> Result<Arc<Network>, Fault> {
        self.network.get(model, || Network::load(model, &self.params))
    }

    fn preprocessing(&self) -> Preprocessing {
        let OnnxParams { channels, white, resize, round, .. } = self.params;
        let (mean, std) = self.params.moments();
        Preprocessing { channels, mean, std, white, resize, round, pad_with: PadWith::Edge }
    }

    /// Factor on the output; disparities become shares of the image's width.
    fn scale(&self, meaning: Output, fitted: &Fitted) -> f32 {
        let (own, seen) = (fitted.from.0 as f64, fitted.to.0 as f64);
        let of_lengths = match (meaning, fitted.pads()) {
            (Output::DisparityPx, false) => return (self.params.output_scale / seen) as f32,
            (Output::DisparityPx, true) => 1.0 / own,
            (Output::DisparityShare, true) => seen / own,
            _ => 1.0,
        };
        (self.params.output_scale * of_lengths) as f32
    }

    /// An output of the network at the size of the image, times `scale`; NaN where it is not finite.
    fn full_size(
        &self,
        Maps { mut values, mut size }: Maps,
        scale: f32,
        fitted: &Fitted,
        ctx: &mut Context<'_>,
    ) -> Result<Vec<f32>, Fault> {
        let of_network = count_non_finite(&values);
        let too_large = |error: TooMuch| Fault::new(error.to_string());
        if fitted.pads() {
            // The padding of the mirrored image is on the other side: it is removed before both are joined.
            let maps = values.chunks_exact(size.0 * size.1).map(|map| fitted.map_back(map.to_vec(), size));
            values = maps.collect::<Result<Vec<_>, _>>().map_err(too_large)?.concat();
            size = fitted.from;
        }
        let (map, of_mirrored) = values.split_at_mut(size.0 * size.1);
        if self.params.flip != Flip::None {
            self.params.flip.join(map, of_mirrored, size.0);
        }
        if scale != 1.0 {
            map.iter_mut().for_each(|value| *value *= scale);
        }
        // Multiplication may overflow; and with `flip` one of the two outputs may be finite.
        let seen = of_network.max(count_non_finite(map));
        if seen > 0 {
            ctx.host.warn_n(seen as u64, "pixels of the network's output are NaN or infinite, and so invalid");
        }
        // Infinity would become the cap: non-finite values are invalid, whether or not a map is resized.
        map.iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = f32::NAN);
        match fitted.pads() {
            true => Ok(map.to_vec()),
            false => fitted.map_back(map.to_vec(), size).map_err(too_large),
        }
    }

    fn metres(&self, meaning: Output, map: &[f32], calibration: &Calibration, width: usize, out: &mut [f32]) {
        let cap = self.params.cap.map_or(f32::INFINITY, |cap| cap as f32);
        match meaning {
            Output::DisparityShare | Output::DisparityPx => {
                depth_from_share(map, width, geometry(calibration), self.params.floor_px as f32, cap, out);
            }
            Output::InverseDepth | Output::RelativeInverseDepth => {
                depth_from_inverse(map, cap, out);
            }
            Output::Depth => {
                for (metres, &value) in out.iter_mut().zip(map) {
                    let raised = if value < NEAREST_M { NEAREST_M } else { value };
                    *metres = if raised > cap { cap } else { raised };
                }
            }
        }
    }
}

impl PureNode for Onnx {
    fn prepare(&self, files: &Inputs<'_>) -> Result<(), Fault> {
        files.optional::<Artifact>("model")?.map_or(Ok(()), |model| self.network(model).map(|_| ()))
    }

    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let image = inputs.get::<Image>("image")?;
        let network = self.network(inputs.get::<Artifact>("model")?)?;
        let (columns, rows) = image.dimensions();
        let width = columns as usize;
        let fitted = network.fitted((width, rows as usize))?;
        let mut maps = network.run(image, &fitted, &self.preprocessing())?.into_iter();
        let scale = self.scale(network.meaning, &fitted);
        let map = maps.next().ok_or_else(|| Fault::new("the network returned no output"))?;
        let full = self.full_size(map, scale, &fitted, ctx)?;
        let spread = maps.next().map(|spread| self.full_size(spread, 1.0, &fitted, ctx)).transpose()?;
        if network.meaning == Output::RelativeInverseDepth {
            let values = Raster::from_raw(columns, rows, full).ok_or_else(|| Fault::new("a map lost its size"))?;
            return Ok(Outputs::one("inverse", RelativeInverseDepth { values }));
        }
        let calibration = inputs.get::<Calibration>("calibration")?;
        if matches!(network.meaning, Output::DisparityShare | Output::DisparityPx) {
            of_pair(calibration)?;
        }
        let metres = filled((columns, rows), |out| self.metres(network.meaning, &full, calibration, width, out));
        let deviation = spread.map(|spread| {
            let mut deviation = metres.clone();
            for (deviation, spread) in deviation.iter_mut().zip(spread) {
                *deviation = if spread > 0.0 { *deviation * spread } else { f32::NAN };
            }
            Depth { metres: deviation }
        });
        let nowhere = full.iter().filter(|value| **value <= 0.0).count() as u64;
        let outputs = match network.meaning {
            Output::InverseDepth => {
                if nowhere > 0 {
                    ctx.host.warn_n(nowhere, "pixels of inverse depth are not above 0: `align: scale-and-shift` uses them unchanged, everything else treats them as the largest depth");
                }
                Outputs::one("depth", Value::depth_from_inverse(Depth { metres }, &full))
            }
            Output::Depth if nowhere > 0 => {
                ctx.host.warn_n(nowhere, "pixels of depth are not above 0; they were set to 0.001 m");
                Outputs::one("depth", Depth { metres })
            }
            _ => Outputs::one("depth", Depth { metres }),
        };
        Ok(match deviation {
            Some(deviation) => outputs.with("deviation", deviation),
            None => outputs,
        })
    }
}
