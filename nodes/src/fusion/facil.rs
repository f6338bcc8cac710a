//! `fusion/facil`: monocular depth corrected by sparse trusted stereo.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Depth, Weight};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::facil::{self, Maps};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bounds::within;
use crate::shape::{filled, same_size};
use crate::tiles::HostTiles;

/// Parameters of `fusion/facil`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Facil {
    /// Side of the square cells, px, of which each gives at most one support pixel. Time grows with the number of
    /// support pixels: a quarter with twice the side.
    #[schemars(range(min = 1, max = 1000))]
    pub spacing: u32,
    /// Least confidence of a support pixel.
    #[schemars(range(min = 0, max = 1))]
    pub min_confidence: f64,
    /// The scale of `W1`, px.
    #[schemars(range(min = 0.1, max = 10000))]
    pub sigma_distance: f64,
    /// What is added to differences of gradients in `W2`, metres per pixel.
    #[schemars(range(min = 0.00001, max = 1000))]
    pub sigma_gradient: f64,
    /// What is added to `W3`, so that no support pixel is without weight.
    #[schemars(range(min = 0, max = 1))]
    pub sigma_plane: f64,
}

impl Default for Facil {
    fn default() -> Self {
        Self { spacing: 24, min_confidence: 0.0, sigma_distance: 15.0, sigma_gradient: 0.1, sigma_plane: 1e-3 }
    }
}

impl Node for Facil {
    type Params = Self;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "fusion/facil",
            version: 1,
            contract: Contract::Pure,
            summary: "Monocular depth, corrected by an interpolation of sparse trusted stereo (Facil et al.).",
            doc: "\
The fusion of Facil, Concha, Montesano and Civera (*Deep Single and Multi-View Depth Fusion*, 2016; *Single-View and \
Multi-View Depth Fusion*, 2017) as a baseline. Each pixel `p` of monocular depth `Z_m` is corrected by the mean \
difference to stereo `Z_s` at support pixels `q`: `Z(p) = Z_m(p) + sum(w (Z_s(q) - Z_m(q))) / sum(w)` with `w = W1 W2 \
W3`. The weights of a pixel are normalized over its support pixels.\n\n\
- `W1 = exp(-|p - q| / sigma_distance)` prefers support pixels nearby. Beyond 50 `sigma_distance` it stays constant.\n\
- `W2 = 1 / ((|gx(p) - gx(q)| + sigma_gradient) (|gy(p) - gy(q)| + sigma_gradient))` prefers those where monocular \
depth has the same gradient `(gx, gy)`, metres per pixel.\n\
- `W3 = exp(-|d|) + sigma_plane` prefers those in the plane through `p`. `d`, metres, is the monocular depth that this \
plane predicts for `q` minus that of `q`.\n\n\
The paper uses points of a multi-view method, and its text was not at hand: the form of the weights is from memory, and \
the constants are ours. Here a support pixel has valid depths and at least `min_confidence`. To \
limit the time, each cell of `spacing` by `spacing` pixels gives only its pixel with the highest confidence. Where \
monocular depth is invalid, the result is stereo. Without support pixels, monocular depth is unchanged. No result is \
smaller than the smallest valid depth.",
            inputs: vec![
                Port::frame("mono", ValueType::Depth, "Monocular depth, metres, NaN = invalid."),
                Port::frame("stereo", ValueType::Depth, "Stereo depth, metres, NaN = invalid; same size as `mono`."),
                Port::frame("weight", ValueType::Weight, "Confidence in stereo, in [0, 1]; same size as `mono`."),
            ],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Corrected monocular depth, metres, NaN = invalid.")],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        within("spacing", f64::from(params.spacing), " px", 1.0..=1000.0)?;
        within("min_confidence", params.min_confidence, "", 0.0..=1.0)?;
        within("sigma_distance", params.sigma_distance, " px", 0.1..=10_000.0)?;
        within("sigma_gradient", params.sigma_gradient, " m/px", 1e-5..=1000.0)?;
        within("sigma_plane", params.sigma_plane, "", 0.0..=1.0)
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

impl PureNode for Facil {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let mono = &inputs.get::<Depth>("mono")?.metres;
        let stereo = &inputs.get::<Depth>("stereo")?.metres;
        let confidence = &inputs.get::<Weight>("weight")?.share;
        let size = mono.dimensions();
        same_size(("mono", size), ("stereo", stereo.dimensions()))?;
        same_size(("mono", size), ("weight", confidence.dimensions()))?;
        let maps = Maps { width: size.0 as usize, height: size.1 as usize, mono, stereo, confidence };
        let params = facil::Params {
            spacing: self.spacing as usize,
            min_confidence: self.min_confidence as f32,
            distance_px: self.sigma_distance as f32,
            gradient: self.sigma_gradient as f32,
            plane: self.sigma_plane as f32,
        };
        let metres = filled(size, |out| {
            facil::fuse(&HostTiles(ctx.host), &maps, &params, out);
        });
        Ok(Outputs::one("depth", Depth { metres }))
    }
}
