//! `fusion/scale`: a monocular map brought to stereo's scale.

use depthloom_graphs::contracts::{Contract, NodeDeclaration, Signature};
use depthloom_graphs::values::{Depth, Raster, RelativeInverseDepth, Weight};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_kernels::align::{self, Domain, Estimator, Fit, Maps, Window};
use depthloom_kernels::scale;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::shape::{filled, same_size};

/// How the monocular map is brought to the scale of stereo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ScaleMethod {
    /// `min(Z_s) + r_s (Z_m - min(Z_m)) / r_m`. `r_s` is the range of stereo, `r_m` that of monocular depth, each
    /// over its own valid pixels.
    #[default]
    Minmax,
    /// `Z_m * mean(Z_s) / mean(Z_m)`, both means over the pixels that are valid in both.
    Average,
    /// Monocular depth, unchanged.
    None,
    /// Scale and shift of weighted least squares.
    LeastSquares,
    /// Scale and shift that outliers hardly change, up to almost half of the pixels.
    Robust,
    /// The ratio of the medians over the pixels that are valid in both, without a shift.
    Median,
    /// Scale and shift that differ smoothly over the image.
    Local,
}

impl ScaleMethod {
    const fn name(self) -> &'static str {
        match self {
            Self::Minmax => "minmax",
            Self::Average => "average",
            Self::None => "none",
            Self::LeastSquares => "least-squares",
            Self::Robust => "robust",
            Self::Median => "median",
            Self::Local => "local",
        }
    }

    /// How the line of the whole image is fitted; `None` for methods of the paper, which need metres.
    const fn estimator(self) -> Option<Estimator> {
        match self {
            Self::Minmax | Self::Average | Self::None => None,
            Self::LeastSquares | Self::Local => Some(Estimator::LeastSquares),
            Self::Robust => Some(Estimator::Robust),
            Self::Median => Some(Estimator::Median),
        }
    }
}

/// Type of the input `mono`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum MonoType {
    /// Depth, metres.
    #[default]
    Depth,
    /// Inverse depth of unknown scale and shift.
    RelativeInverseDepth,
}

/// Parameters of `fusion/scale`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Scale {
    /// How the monocular map is scaled: `minmax`, `average` or `none`, as in the paper; or `least-squares`, `robust`,
    /// `median` or `local`.
    pub method: ScaleMethod,
    /// Type of the input `mono`: `depth`, or `relative-inverse-depth` for networks such as MiDaS and Depth Anything,
    /// which needs one of the last four methods.
    pub mono: MonoType,
    /// Whether the last four methods fit scale and shift in `inverse-depth` or in `depth`.
    pub domain: Domain,
    /// Largest depth that the last four methods return, metres. Also the depth of pixels where the fit gives an inverse
    /// depth of zero or below.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: f64,
    /// Of `local`: standard deviation of the Gaussian windows, px.
    #[schemars(range(min = 1, max = 1000))]
    pub sigma: f64,
    /// Of `local`: weight of the line of the whole image, as a share of the pixels in a window.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub prior: f64,
}

impl Default for Scale {
    fn default() -> Self {
        Self {
            method: ScaleMethod::default(),
            mono: MonoType::default(),
            domain: Domain::default(),
            cap: 80.0,
            sigma: 30.0,
            prior: 0.05,
        }
    }
}

impl Node for Scale {
    type Params = Self;
    const OWN_PORTS: bool = true;

    fn declaration() -> NodeDeclaration {
        let Signature { inputs, outputs, .. } = signature(MonoType::Depth);
        NodeDeclaration {
            kind: "fusion/scale",
            version: 3,
            contract: Contract::Pure,
            summary: "A monocular map, brought to the scale of the stereo depth of the same frame.",
            doc: "\
**Methods of the paper.** `minmax`, `average` and `none` are step 4 of Martins et al. 2018, an ablation of its Table \
I. Ranges and means are computed per frame. Only valid pixels count; for means, only pixels that are valid in both. \
On a frame without any valid stereo pixel, monocular depth is unchanged.\n\n\
**Scale and shift.** The other methods fit `z = s x + b` per frame, over the pixels that are valid in both. In \
`domain: inverse-depth`, `x` and `z` are inverse depths, as in MiDaS (Ranftl et al. 2020). An error of stereo in \
pixels weighs the same at all distances there. Depth below 1 mm is raised to 1 mm.\n\n\
- `least-squares` minimises the sum of `w (z - s x - b)^2`, `w` being the input `weight` (1 without it).\n\
- `robust` starts from the line of least median of squares among 300 lines through two pixels (Rousseeuw 1984), drawn \
with a fixed seed. Least squares with Tukey's biweight, and with the scale of the start's residuals (MAD), refine it. \
Tests recover scale and shift with 40 % wrong pixels.\n\
- `median` multiplies by the ratio of the medians in `domain`, without a shift.\n\
- `local` adds a correction of `s` and `b` to `least-squares`, which differs smoothly between pixels. It is the \
weighted least squares of the residuals in a Gaussian window. `prior` draws it to zero, so that the line of the image \
remains where stereo is missing. Windows are solved on a grid of `sigma / 3` and interpolated.\n\n\
**Without a fit.** These frames are reported. If no pixel is valid in both, monocular depth is unchanged, and relative \
inverse depth becomes invalid everywhere. If the monocular values are all alike there, the map is \
multiplied by the ratio of the means (for `robust`, of the medians). If this ratio, or that of `median`, is not above \
0, every valid pixel gets the mean (the median) of stereo in `domain`. A negative scale is \
used as it is, and reported: on such a frame the network contradicts stereo.\n\n\
Invalid monocular pixels stay invalid.",
            inputs,
            outputs,
        }
    }

    fn signature(params: &Self) -> Option<Signature> {
        Some(signature(params.mono))
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        if params.mono == MonoType::RelativeInverseDepth {
            if params.method.estimator().is_none() {
                let what = format!(
                    "method is {}, which needs depth in metres; with `mono: relative-inverse-depth` use least-squares, robust, median or local",
                    params.method.name()
                );
                return Err(("method", what));
            }
            if params.domain == Domain::Depth {
                let what = "domain is depth, but `mono: relative-inverse-depth` is aligned in inverse-depth";
                return Err(("domain", what.to_owned()));
            }
        }
        Ok(())
    }

    fn build(params: Self) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(params)))
    }
}

fn signature(mono: MonoType) -> Signature {
    let mono = match mono {
        MonoType::Depth => Port::frame("mono", ValueType::Depth, "Monocular depth, metres, NaN = invalid."),
        MonoType::RelativeInverseDepth => Port::frame(
            "mono",
            ValueType::RelativeInverseDepth,
            "Monocular inverse depth of unknown scale and shift, NaN = invalid.",
        ),
    };
    let weight = Port::frame(
        "weight",
        ValueType::Weight,
        "Confidence in stereo, in [0, 1]; used by `least-squares`, `robust` and `local`. Pixels of weight 0 do not count.",
    );
    Signature {
        contract: Contract::Pure,
        inputs: vec![
            mono,
            Port::frame("stereo", ValueType::Depth, "Stereo depth, metres, NaN = invalid; same size as `mono`."),
            weight.optional(),
        ],
        outputs: vec![Port::frame("depth", ValueType::Depth, "Scaled monocular depth, metres, NaN = invalid.")],
        observes: None,
    }
}

impl PureNode for Scale {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let mono = inputs.value("mono").ok_or_else(|| Fault::new("no value at input `mono`"))?;
        let stereo = &inputs.get::<Depth>("stereo")?.metres;
        let size = mono.dimensions().ok_or_else(|| Fault::new("input `mono` is not a map"))?;
        same_size(("mono", size), ("stereo", stereo.dimensions()))?;
        let weight = inputs.optional::<Weight>("weight")?.map(|weight| &weight.share);
        if let Some(weight) = weight {
            same_size(("mono", size), ("weight", weight.dimensions()))?;
        }
        let of_paper = match self.method {
            ScaleMethod::None => return Ok(Outputs::one("depth", mono.clone())),
            ScaleMethod::Minmax => scale::minmax,
            ScaleMethod::Average => scale::average,
            _ => return Ok(Outputs::one("depth", self.aligned(mono, stereo, weight, size, ctx)?)),
        };
        let metres = &inputs.get::<Depth>("mono")?.metres;
        Ok(Outputs::one("depth", Depth { metres: filled(size, |out| of_paper(metres, stereo, out)) }))
    }
}

impl Scale {
    fn aligned(
        &self,
        mono: &Value,
        stereo: &Raster<f32>,
        weight: Option<&Raster<f32>>,
        size: (u32, u32),
        ctx: &Context<'_>,
    ) -> Result<Value, Fault> {
        let x = self.values(mono)?;
        let z = filled(size, |out| align::in_domain(stereo, self.domain, out));
        let maps = Maps { mono: &x, stereo: &z, weight: weight.map(|weight| weight.as_raw().as_slice()) };
        let estimator = self.method.estimator().unwrap_or(Estimator::LeastSquares);
        let Some(Fit { line, is_degenerate }) = align::fit(&align::points(&maps), estimator) else {
            ctx.host
                .warn_n(1, "frames have no pixel that is valid in both `mono` and `stereo`, so nothing was aligned");
            return Ok(match self.mono {
                MonoType::Depth => mono.clone(),
                MonoType::RelativeInverseDepth => {
                    Depth { metres: Raster::from_pixel(size.0, size.1, image::Luma([f32::NAN])) }.into()
                }
            });
        };
        if is_degenerate {
            ctx.host.warn_n(1, "frames have monocular values to which no scale and shift can be fitted");
        } else if line.scale < 0.0 {
            ctx.host.warn_n(1, "frames have a negative scale: the monocular map decreases where stereo increases");
        }
        let metres = filled(size, |out| match self.method {
            ScaleMethod::Local => {
                let window = Window { sigma_px: self.sigma, prior: self.prior };
                let (width, height) = (size.0 as usize, size.1 as usize);
                align::local(&maps, (width, height), line, window, (self.domain, self.cap), out);
            }
            _ => align::apply(&x, line, self.domain, self.cap, out),
        });
        Ok(Depth { metres }.into())
    }

    /// The monocular map in the domain of the fit. Of a depth with inverse depth that metres cannot represent, that is
    /// used in inverse depth, as `align: scale-and-shift` of `score/depth` does.
    fn values(&self, mono: &Value) -> Result<Vec<f32>, Fault> {
        if let Value::RelativeInverseDepth(map) = mono {
            let RelativeInverseDepth { values } = &**map;
            return Ok(values.to_vec());
        }
        let metres = mono.metres().ok_or_else(|| Fault::new("input `mono` is not a depth map"))?;
        let mut values = vec![0.0; metres.len()];
        align::in_domain(metres, self.domain, &mut values);
        if let (Value::RelativeDepth(map), Domain::InverseDepth) = (mono, self.domain) {
            for (value, &own) in values.iter_mut().zip(map.inverse().as_raw()) {
                if own.is_finite() {
                    *value = own;
                }
            }
        }
        Ok(values)
    }
}
