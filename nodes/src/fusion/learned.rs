//! `fusion/learned`: stereo and monocular depth, fused by a network of `learn/fusion`.

use std::sync::Arc;

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Artifact, Depth, Image, Raster, Weight};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Key, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_kernels::learned::{Cell, FrameMaps, MAPS, PLANES, apply, cells};
use depthloom_kernels::resize::area_rgb8;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bounds::above_zero;
use crate::geometry::pair_calibration;
use crate::onnx::{self, PoolInput, Pools, Provider, TensorLayout, shape_text};
use crate::shape::same_size;

/// Parameters of `fusion/learned`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct LearnedParams {
    /// Largest depth in the output, metres; `null` does not limit depth.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
    /// Hardware that runs the network: `cpu`, `cuda`, `tensorrt`, ... It is an error if this machine's ONNX Runtime
    /// lacks it.
    pub provider: Provider,
    /// Threads of ONNX Runtime per frame. tract always uses one.
    #[schemars(range(min = 1, max = 256), extend("operational" = true))]
    pub threads: u32,
}

impl Default for LearnedParams {
    fn default() -> Self {
        Self { cap: Some(80.0), provider: Provider::Cpu, threads: 1 }
    }
}

pub(crate) struct Learned {
    params: LearnedParams,
    network: onnx::CachedNetwork<Network>,
}

/// A network that maps [`PLANES`] planes to [`MAPS`] maps.
struct Network {
    /// Columns and rows, px.
    size: (usize, usize),
    pools: Pools,
}

impl Node for Learned {
    type Params = LearnedParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "fusion/learned",
            version: 1,
            contract: Contract::Pure,
            summary: "Stereo and monocular depth, fused by a network that `learn/fusion` trained.",
            doc: "\
All inputs are brought to the network's size by area, as in `learn/fusion-samples`. The network's maps are a gate `g`, \
a residual `r` and a spread `b`. The residual is averaged over blocks of 8x8 \
pixels. All are enlarged to the size of the image (bilinear). In log depth, the result is \
`g z_s + (1 - g)(z_m + r)`, or `z_m + r` where stereo is invalid: details come from the full-size inputs.\n\n\
Where monocular depth is invalid, the result is stereo. `deviation` is `sqrt(2) b Z`, the standard deviation of the \
Laplace distribution that training assumes, to first order.\n\n\
Give the inputs from the same kinds with the same parameters as in training. A median filter usually follows. \
Engines, providers and cache keys are those of `mono/onnx`.",
            inputs: vec![
                Port::frame("image", ValueType::Image, "The left image, grey or RGB, no smaller than the network's."),
                Port::frame("disparity", ValueType::Disparity, "Stereo."),
                Port::frame(
                    "consistent",
                    ValueType::Disparity,
                    "`disparity` where the right view agrees: `disparity/left-right`.",
                ),
                Port::frame("mono", ValueType::Depth, "Monocular depth, metres, NaN = invalid."),
                Port::frame("weight", ValueType::Weight, "Confidence in stereo, `W_c`, in [0, 1]."),
                Port::frame("calibration", ValueType::Calibration, "Focal length and baseline."),
                Port::once("model", ValueType::Model, "The network: `learn/fusion`, or its ONNX file."),
            ],
            outputs: vec![
                Port::frame("depth", ValueType::Depth, "Fused depth, metres, NaN = invalid."),
                Port::frame("deviation", ValueType::Depth, "Standard deviation of `depth`, metres, NaN = invalid."),
            ],
        }
    }

    fn check(params: &LearnedParams) -> Result<(), (&'static str, String)> {
        if params.threads == 0 {
            return Err(("threads", "threads is 0, expected at least 1".to_owned()));
        }
        above_zero("cap", params.cap, "m")
    }

    fn fingerprint(params: &LearnedParams) -> Result<Option<Key>, Fault> {
        onnx::engine_key(params.provider)
    }

    fn build(params: LearnedParams) -> Result<Instance, Fault> {
        onnx::find()?.prepare(params.provider)?;
        Ok(Instance::Pure(Box::new(Self { params, network: onnx::CachedNetwork::default() })))
    }
}

/// Metadata key by which a model names the meaning of its output, and the meaning that is expected.
const MEANING: (&str, &str) = ("depthloom.output", "fusion");

impl Network {
    fn load(model: &Artifact, params: &LearnedParams) -> Result<Self, Fault> {
        let declared = onnx::declared(model, params.provider)?;
        let trained = "use the output `model` of `learn/fusion`, or its file";
        if let Some(other) = declared.metadata(MEANING.0).filter(|meaning| *meaning != MEANING.1) {
            return Err(Fault::new(format!("the network computes `{other}`, expected `{}`", MEANING.1)).remedy(trained));
        }
        let (input, output) =
            (onnx::outlet("input", &declared.inputs, None)?, onnx::outlet("output", &declared.outputs, None)?);
        let axes = onnx::planes(input, TensorLayout::Nchw)?;
        let (Some(PLANES), Some(width), Some(height), None | Some(1)) =
            (axes.channels, axes.width, axes.height, axes.batch)
        else {
            let shape = input.tensor.as_ref().map_or_else(String::new, |(_, shape)| shape_text(shape));
            let what = format!("input `{}` of the network has the shape {shape}, expected 1x{PLANES}xHxW", input.name);
            return Err(Fault::new(what).remedy(trained));
        };
        let input = PoolInput { name: input.name.clone(), axes, images: 1, planes: PLANES };
        let pools = Pools::new(model, (params.provider, params.threads), vec![input], vec![output.name.clone()]);
        pools.get((width, height))?;
        Ok(Self { size: (width, height), pools })
    }

    /// The maps of one frame's planes.
    fn maps(&self, planes: &[f32]) -> Result<Vec<f32>, Fault> {
        let output = self.pools.get(self.size)?.run(&[planes])?.pop();
        let output = output.ok_or_else(|| Fault::new("the network returned no output"))?;
        let (width, height) = self.size;
        if output.shape != [1, MAPS as i64, height as i64, width as i64] {
            let (name, shape) = (&self.pools.outputs[0], shape_text(&output.shape));
            return Err(Fault::new(format!(
                "output `{name}` of the network has the shape {shape}, expected 1x{MAPS}x{height}x{width}"
            ))
            .remedy("use a network of `learn/fusion`"));
        }
        let seen = onnx::count_non_finite(&output.values);
        if seen > 0 {
            return Err(Fault::new(format!("the network returned {seen} numbers that are NaN or infinite"))
                .remedy("train it again, with a lower `learning_rate`"));
        }
        Ok(output.values)
    }
}

/// The disparity at a port, px, NaN = invalid.
fn disparity(inputs: &Inputs<'_>, port: &str) -> Result<Raster<f32>, Fault> {
    let map = inputs.value(port).and_then(Value::disparity_px);
    map.ok_or_else(|| Fault::new(format!("no disparity at input `{port}`")))
}

impl Learned {
    fn network(&self, model: &Artifact) -> Result<Arc<Network>, Fault> {
        self.network.get(model, || Network::load(model, &self.params))
    }
}

impl PureNode for Learned {
    fn prepare(&self, files: &Inputs<'_>) -> Result<(), Fault> {
        files.optional::<Artifact>("model")?.map_or(Ok(()), |model| self.network(model).map(|_| ()))
    }

    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let network = self.network(inputs.get::<Artifact>("model")?)?;
        let (image, calibration) = (inputs.get::<Image>("image")?, pair_calibration(inputs)?);
        let (stereo, consistent) = (disparity(inputs, "disparity")?, disparity(inputs, "consistent")?);
        let (mono, weight) = (&inputs.get::<Depth>("mono")?.metres, &inputs.get::<Weight>("weight")?.share);
        let (columns, rows) = image.dimensions();
        for (port, map) in [("disparity", &stereo), ("consistent", &consistent), ("mono", mono), ("weight", weight)] {
            same_size(("image", (columns, rows)), (port, map.dimensions()))?;
        }
        let (width, height) = (columns as usize, rows as usize);
        if width < network.size.0 || height < network.size.1 {
            let (wide, high) = network.size;
            return Err(Fault::new(format!(
                "the network takes images of {wide}x{high}, and these are {columns}x{rows}"
            ))
            .remedy("train with a smaller `size` at `learn/fusion-samples`"));
        }
        // Depth is this over the share of the width.
        let scale = (calibration.focal_baseline_px_m() / f64::from(columns)) as f32;
        let doffs_px = calibration.doffs_px as f32;
        let share = |px: &f32| {
            let shifted = *px + doffs_px;
            if *px > 0.0 && shifted > 0.0 { shifted / columns as f32 } else { f32::NAN }
        };
        let stereo: Vec<f32> = stereo.iter().map(share).collect();
        let consistent: Vec<f32> = consistent.iter().map(share).collect();
        let mono_share: Vec<f32> = mono.iter().map(|metres| scale / metres).collect();
        let maps = FrameMaps { stereo: &stereo, consistent: &consistent, mono: &mono_share, weight };
        let cells = cells(&maps, (width, height), network.size);
        let maps = network.maps(&planes(image, network.size, &cells))?;
        let stereo: Vec<f32> = stereo.iter().map(|share| scale / share).collect();
        let cap = self.params.cap.map_or(f32::INFINITY, |cap| cap as f32);
        let [mut depth, mut deviation] = [(); 2].map(|()| Raster::<f32>::new(columns, rows));
        let maps = (maps.as_slice(), network.size.0, network.size.1);
        apply((&stereo, mono), (width, height), maps, cap, (&mut depth, &mut deviation));
        Ok(Outputs::one("depth", Depth { metres: depth }).with("deviation", Depth { metres: deviation }))
    }
}

/// The network's planes: the colours of the image by area, rounded to 8 bits as in training, and those of the cells.
fn planes(image: &Image, (columns, rows): (usize, usize), cells: &[Cell]) -> Vec<f32> {
    let (width, height) = image.dimensions();
    let mut small = vec![0; 3 * columns * rows];
    area_rgb8(&onnx::colour(image), width as usize, height as usize, columns, rows, &mut small);
    let mut planes = Vec::with_capacity(PLANES * cells.len());
    for channel in 0..3 {
        planes.extend(small.iter().skip(channel).step_by(3).map(|&value| f32::from(value) / 255.0));
    }
    let of_cells: Vec<[f32; PLANES - 3]> = cells.iter().map(Cell::planes).collect();
    for plane in 0..PLANES - 3 {
        planes.extend(of_cells.iter().map(|cell| cell[plane]));
    }
    planes
}
