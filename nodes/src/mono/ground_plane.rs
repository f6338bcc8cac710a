//! `mono/ground-plane`: a level road, the simplest monocular estimate.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Calibration, Depth, Image};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::depth::GroundPlane as Plane;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bounds::above_zero;
use crate::shape::filled;

/// Parameters of `mono/ground-plane`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct GroundPlane {
    /// Height of the camera above the road, metres. KITTI's is 1.65.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub height_m: f64,
    /// Row of the horizon, as a share of the image's rows.
    #[schemars(range(min = 0, max = 1))]
    pub horizon: f64,
    /// Smallest depth in the output, metres.
    #[schemars(range(min = 0))]
    pub nearest_m: f64,
    /// Largest depth in the output, metres; also used at and above the horizon.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: f64,
}

impl Default for GroundPlane {
    fn default() -> Self {
        Self { height_m: 1.65, horizon: 0.461, nearest_m: 1.0, cap: 80.0 }
    }
}

impl Node for GroundPlane {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "mono/ground-plane",
            version: 1,
            contract: Contract::Pure,
            summary: "Depth of a level road seen by a level camera: a monocular baseline without a network.",
            doc: "\
`Z = clip(f * height_m / max(row - horizon * rows, 1e-6), nearest_m, cap)` for every pixel of a row, in f32; `f` is \
the focal length in pixels.\n\n\
Objects on the road get the depth of the road. Use it as a prior that stereo corrects, and as the baseline that a \
network must beat.",
            inputs: vec![
                Port::frame("image", ValueType::Image, "The left image; only its size is used."),
                Port::frame("calibration", ValueType::Calibration, "Calibration; only the focal length is used."),
            ],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Depth, f32 metres, valid everywhere.")],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        let Self { height_m, nearest_m, cap, .. } = params;
        above_zero("height_m", Some(*height_m), "m")?;
        if cap < nearest_m {
            return Err(("cap", format!("cap is {cap} m, expected at least nearest_m ({nearest_m} m)")));
        }
        Ok(())
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for GroundPlane {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (width, height) = inputs.get::<Image>("image")?.dimensions();
        let plane = Plane {
            focal_px: inputs.get::<Calibration>("calibration")?.focal_px,
            camera_height_metres: self.height_m,
            horizon_share: self.horizon,
            nearest_metres: self.nearest_m as f32,
            farthest_metres: self.cap as f32,
        };
        let metres = filled((width, height), |out| plane.depth(width as usize, height as usize, out));
        Ok(Outputs::one("depth", Depth { metres }))
    }
}
