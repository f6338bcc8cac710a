//! `disparity/files`: disparity that another program predicted.

use std::sync::LazyLock;

use depthloom_graphs::contracts::{Contract, FramePaths, NodeDeclaration, Signature};
use depthloom_graphs::{Context, Fault, Frame, Inputs, Instance, Node, Outputs, Port, PureNode, Value, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::predictions::{self, PredictedMap, PredictedMaps, PredictionReader, ResizeMap, missing_array};

/// Unit of disparity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum DisparityUnit {
    /// Pixels of the file's map.
    #[default]
    Pixels,
    /// Share of the image's width.
    Share,
}

/// Parameters of `disparity/files`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct DisparityFilesParams {
    /// Path with `{frame}` or `{index}`, a list of paths, or one array of all frames; relative to the folder of the
    /// YAML file.
    #[schemars(extend("mandatory" = true))]
    pub files: FramePaths,
    /// Ids of the frames, in the order of a list of files or of the maps of an array.
    pub frames: Vec<String>,
    /// Name of the array of an NPZ file, or of the channel of an EXR file; `null` uses the only one.
    pub array: Option<String>,
    /// Unit of the numbers, after the division: `pixels` (of the file's map) or `share` (of the image's width).
    pub unit: DisparityUnit,
    /// Divisor of the numbers in the files: 256 for KITTI's 16-bit PNG.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub divide_by: f64,
    /// A number in the files, before the division, that means invalid, such as 65535 or -1.
    pub invalid: Option<f64>,
    /// How a map of another size than the image is resized: `none` (an error), `nearest` or `bilinear`.
    pub resize: ResizeMap,
}

impl Default for DisparityFilesParams {
    fn default() -> Self {
        Self {
            files: FramePaths::default(),
            frames: Vec::new(),
            array: None,
            unit: DisparityUnit::Pixels,
            divide_by: 1.0,
            invalid: None,
            resize: ResizeMap::None,
        }
    }
}

impl DisparityFilesParams {
    fn maps(&self) -> PredictedMaps {
        let Self { files, frames, array, divide_by, invalid, resize, .. } = self.clone();
        PredictedMaps { files, frames, array, divide_by, invalid, resize }
    }
}

static DOC: LazyLock<String> = LazyLock::new(|| {
    format!(
        "\
Disparity of another program becomes a node of the graph: it can be scored, compared and fused. It is positive, in \
pixels of the left image. Numbers that are not above 0 are invalid. If the map is resized, disparities grow with its \
width.\n\n\
{}",
        predictions::DOC
    )
});

pub(crate) struct DisparityFiles {
    unit: DisparityUnit,
    reader: PredictionReader,
}

impl Node for DisparityFiles {
    type Params = DisparityFilesParams;
    // The frame's files are observed.
    const OWN_PORTS: bool = true;
    const OWN_INPUTS: bool = false;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "disparity/files",
            version: 1,
            contract: Contract::Pure,
            summary: "Disparity maps that another program wrote, one file per frame or one array.",
            doc: &DOC,
            inputs: vec![Port::frame("image", ValueType::Image, "The left image; only its size is used.")],
            outputs: vec![Port::frame("disparity", ValueType::Disparity, "Disparity, floating point, px.")],
        }
    }

    fn signature(params: &DisparityFilesParams) -> Option<Signature> {
        Some(Signature { observes: Some(params.maps().observation()), ..Signature::from(&Self::declaration()) })
    }

    fn check(params: &DisparityFilesParams) -> Result<(), (&'static str, String)> {
        params.maps().check()
    }

    fn build(params: DisparityFilesParams) -> Result<Instance, Fault> {
        let maps = params.maps();
        if let Some(path) = missing_array(&maps) {
            return Err(Fault::new(format!("{} does not exist", path.display())).remedy("correct `files`"));
        }
        Ok(Instance::Pure(Box::new(Self { unit: params.unit, reader: PredictionReader::new(maps) })))
    }
}

impl PureNode for DisparityFiles {
    fn process(&self, _inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        Err(Fault::new("`disparity/files` needs the frame"))
    }

    fn process_frame(&self, frame: &Frame, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let PredictedMap { mut numbers, enlarged } = self.reader.read(frame, inputs)?;
        let factor = match self.unit {
            DisparityUnit::Pixels => enlarged,
            DisparityUnit::Share => f64::from(numbers.width()),
        };
        for number in numbers.iter_mut() {
            let px = (f64::from(*number) * factor) as f32;
            *number = if px > 0.0 && px.is_finite() { px } else { f32::NAN };
        }
        Ok(Outputs::one("disparity", Value::disparity_from_px(numbers)))
    }
}
