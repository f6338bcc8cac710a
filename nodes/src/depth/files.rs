//! `depth/files`: depth that another program predicted.

use std::sync::LazyLock;

use depthloom_graphs::contracts::{Contract, FramePaths, NodeDeclaration, Signature};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Frame, Inputs, Instance, Node, Outputs, Port, PureNode, Value, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bounds::above_zero;
use crate::geometry::depth_from_inverse;
use crate::predictions::{self, PredictedMap, PredictedMaps, PredictionReader, ResizeMap, missing_array};
use crate::shape::filled;

/// What the numbers of a file are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Quantity {
    /// Depth along the optical axis.
    #[default]
    Depth,
    /// 1 / depth.
    InverseDepth,
}

/// Unit of length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum LengthUnit {
    /// Metres.
    #[default]
    Metres,
    /// Millimetres.
    Millimetres,
}

/// Parameters of `depth/files`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct DepthFilesParams {
    /// Path with `{frame}` or `{index}`, a list of paths, or one array of all frames; relative to the folder of the
    /// YAML file.
    #[schemars(extend("mandatory" = true))]
    pub files: FramePaths,
    /// Ids of the frames, in the order of a list of files or of the maps of an array.
    pub frames: Vec<String>,
    /// Name of the array of an NPZ file, or of the channel of an EXR file; `null` uses the only one.
    pub array: Option<String>,
    /// What the numbers are: `depth` or `inverse-depth`.
    pub quantity: Quantity,
    /// Unit of depth: `metres` or `millimetres`; inverse depth is 1/m or 1/mm.
    pub unit: LengthUnit,
    /// Divisor of the numbers in the files: 256 for KITTI's 16-bit PNG.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub divide_by: f64,
    /// A number in the files, before the division, that means invalid, such as 65535 or -1.
    pub invalid: Option<f64>,
    /// How a map of another size than the image is resized: `none` (an error), `nearest` or `bilinear`.
    pub resize: ResizeMap,
    /// Largest depth in the output, metres; `null` does not limit depth.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
}

impl Default for DepthFilesParams {
    fn default() -> Self {
        Self {
            files: FramePaths::default(),
            frames: Vec::new(),
            array: None,
            quantity: Quantity::Depth,
            unit: LengthUnit::Metres,
            divide_by: 1.0,
            invalid: None,
            resize: ResizeMap::None,
            cap: None,
        }
    }
}

impl DepthFilesParams {
    fn maps(&self) -> PredictedMaps {
        let Self { files, frames, array, divide_by, invalid, resize, .. } = self.clone();
        PredictedMaps { files, frames, array, divide_by, invalid, resize }
    }
}

static DOC: LazyLock<String> = LazyLock::new(|| {
    format!(
        "\
Depth of another program becomes a node of the graph: it can be scored, compared and fused. Depth is metres along the \
optical axis, at the size of `image`. Depths that are not above 0 are invalid.\n\n\
With `quantity: inverse-depth`, depth is `1 / number`. An alignment by scale and shift (`align` of `score/depth`) uses \
the numbers themselves, including zero and negative ones; every other use sees the cap there, or 1e6 m.\n\n\
{}",
        predictions::DOC
    )
});

pub(crate) struct DepthFiles {
    params: DepthFilesParams,
    reader: PredictionReader,
}

impl Node for DepthFiles {
    type Params = DepthFilesParams;
    // The frame's files are observed.
    const OWN_PORTS: bool = true;
    const OWN_INPUTS: bool = false;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "depth/files",
            version: 1,
            contract: Contract::Pure,
            summary: "Depth maps that another program wrote, one file per frame or one array.",
            doc: &DOC,
            inputs: vec![Port::frame("image", ValueType::Image, "The left image; only its size is used.")],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Depth, f32 metres, NaN = invalid.")],
        }
    }

    fn signature(params: &DepthFilesParams) -> Option<Signature> {
        Some(Signature { observes: Some(params.maps().observation()), ..Signature::from(&Self::declaration()) })
    }

    fn check(params: &DepthFilesParams) -> Result<(), (&'static str, String)> {
        above_zero("cap", params.cap, "m")?;
        params.maps().check()
    }

    fn build(params: DepthFilesParams) -> Result<Instance, Fault> {
        let maps = params.maps();
        if let Some(path) = missing_array(&maps) {
            return Err(Fault::new(format!("{} does not exist", path.display())).remedy("correct `files`"));
        }
        Ok(Instance::Pure(Box::new(Self { params, reader: PredictionReader::new(maps) })))
    }
}

impl PureNode for DepthFiles {
    fn process(&self, _inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        Err(Fault::new("`depth/files` needs the frame"))
    }

    fn process_frame(&self, frame: &Frame, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let PredictedMap { numbers, .. } = self.reader.read(frame, inputs)?;
        let cap = self.params.cap.map_or(f32::INFINITY, |cap| cap as f32);
        let unit = match self.params.unit {
            LengthUnit::Metres => 1.0,
            LengthUnit::Millimetres => 1000.0,
        };
        let size = numbers.dimensions();
        Ok(match self.params.quantity {
            Quantity::Depth => {
                let metres = |number: f32| if number > 0.0 { (number / unit).min(cap) } else { f32::NAN };
                let metres = filled(size, |out: &mut [f32]| {
                    out.iter_mut().zip(numbers.iter()).for_each(|(out, number)| *out = metres(*number));
                });
                Outputs::one("depth", Depth { metres })
            }
            Quantity::InverseDepth => {
                let inverse: Vec<f32> = numbers.iter().map(|number| number * unit).collect();
                let metres = filled(size, |out| depth_from_inverse(&inverse, cap, out));
                Outputs::one("depth", Value::depth_from_inverse(Depth { metres }, &inverse))
            }
        })
    }
}
