//! `depth/from-disparity`: metres from disparity and calibration.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Depth, Disparity};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_kernels::depth::{Geometry, depth_from_disparity, truth_from_disparity};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bounds::above_zero;
use crate::geometry::{geometry, pair_calibration};
use crate::shape::filled;

/// Parameters of `depth/from-disparity`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct FromDisparity {
    /// Largest depth in the output, metres; `null` does not limit depth. Martins et al. 2018 cap before fusion;
    /// KITTI's ground truth ends near 80 m.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
}

impl Default for FromDisparity {
    fn default() -> Self {
        Self { cap: Some(80.0) }
    }
}

impl Node for FromDisparity {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "depth/from-disparity",
            version: 1,
            contract: Contract::Pure,
            summary: "Depth in metres from disparity: `f * B / (d + doffs)`, capped.",
            doc: "\
`Z = f * B / (d + doffs)`, computed in f32 (Martins et al. 2018, step 1). The calibration gives the focal length `f` \
(px), the baseline `B` (m) and `doffs` (px). `doffs` is the column of the right camera's principal point minus the \
column of the left camera's. It is 0 except for pairs such as Middlebury's of 2014.\n\n\
A pixel is invalid (NaN) if `d <= 0` or `d + doffs <= 0`. Depths beyond `cap` become `cap`.",
            inputs: vec![
                Port::frame("disparity", ValueType::Disparity, "Disparity, fixed or floating point."),
                Port::frame(
                    "calibration",
                    ValueType::Calibration,
                    "Focal length, baseline and principal points of the pair.",
                ),
            ],
            outputs: vec![Port::frame(
                "depth",
                ValueType::Depth,
                "Depth, f32 metres, NaN = invalid; same size as the disparity.",
            )],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        above_zero("cap", params.cap, "m")
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl FromDisparity {
    fn cap_m(&self) -> f32 {
        self.cap.map_or(f32::INFINITY, |cap| cap as f32)
    }

    fn write_depths(&self, px: &[f32], geometry: Geometry, out: &mut [f32]) {
        truth_from_disparity(px, geometry, out);
        for (metres, px) in out.iter_mut().zip(px) {
            *metres = if *px > 0.0 && !metres.is_nan() { metres.min(self.cap_m()) } else { f32::NAN };
        }
    }
}

impl PureNode for FromDisparity {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let disparity = &inputs.get::<Disparity>("disparity")?.sixteenths_px;
        let geometry = geometry(pair_calibration(inputs)?);
        let metres = filled(disparity.dimensions(), |out| match inputs.value("disparity") {
            Some(Value::FloatDisparity(map)) => self.write_depths(map.px(), geometry, out),
            _ => depth_from_disparity(disparity, geometry, self.cap_m(), out),
        });
        Ok(Outputs::one("depth", Depth { metres }))
    }
}
