//! `fusion/inverse-variance`: stereo and monocular depth, weighted by constant noise models.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::inverse_variance::{Deviations, fuse};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bounds::within;
use crate::geometry::pair_calibration;
use crate::shape::{filled, same_size};

/// Parameters of `fusion/inverse-variance`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct InverseVariance {
    /// Standard deviation of disparity, px.
    #[schemars(range(min = 0.001, max = 1000))]
    pub disparity_deviation: f64,
    /// Standard deviation of monocular depth, as a share of the depth.
    #[schemars(range(min = 0.001, max = 10))]
    pub mono_deviation: f64,
}

impl Default for InverseVariance {
    fn default() -> Self {
        Self { disparity_deviation: 1.0, mono_deviation: 0.15 }
    }
}

impl Node for InverseVariance {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "fusion/inverse-variance",
            version: 1,
            contract: Contract::Pure,
            summary: "Average of stereo and monocular depth, weighted by their inverse variances.",
            doc: "\
The best average of two independent Gaussian estimates, as a baseline. The standard deviation of stereo depth `Z` is \
`Z^2 / (f B) * disparity_deviation`, that of monocular depth is `Z * mono_deviation`. Stereo therefore dominates near \
the camera. The noise models are constant: mismatches and occlusions of stereo are not recognized.\n\n\
The output `deviation` is `1 / sqrt(1/s_s^2 + 1/s_m^2)`. Where one of the two is invalid, the other is used, with its \
own deviation. Where both are invalid, so are the results.",
            inputs: vec![
                Port::frame("mono", ValueType::Depth, "Monocular depth, metres, NaN = invalid."),
                Port::frame("stereo", ValueType::Depth, "Stereo depth, metres, NaN = invalid; same size as `mono`."),
                Port::frame("calibration", ValueType::Calibration, "Focal length and baseline of the pair."),
            ],
            outputs: vec![
                Port::frame("depth", ValueType::Depth, "Average depth, metres, NaN = invalid."),
                Port::frame("deviation", ValueType::Depth, "Its standard deviation, metres, NaN = invalid."),
            ],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        within("disparity_deviation", params.disparity_deviation, " px", 0.001..=1000.0)?;
        within("mono_deviation", params.mono_deviation, "", 0.001..=10.0)
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for InverseVariance {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let mono = &inputs.get::<Depth>("mono")?.metres;
        let stereo = &inputs.get::<Depth>("stereo")?.metres;
        let focal_baseline_px_m = pair_calibration(inputs)?.focal_baseline_px_m();
        let size = mono.dimensions();
        same_size(("mono", size), ("stereo", stereo.dimensions()))?;
        let deviations = Deviations {
            stereo_at_1m: (self.disparity_deviation / focal_baseline_px_m) as f32,
            mono_share: self.mono_deviation as f32,
        };
        let mut deviation = filled(size, |_| {});
        let metres = filled(size, |depth| fuse(stereo, mono, deviations, depth, &mut deviation));
        Ok(Outputs::one("depth", Depth { metres }).with("deviation", Depth { metres: deviation }))
    }
}
