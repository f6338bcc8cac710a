//! `fusion/mixture`: stereo as an inlier or an outlier, beside a monocular estimate that is aligned with it.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Artifact, Depth, Raster, Weight};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Key, Node, Outputs, Port, PureNode, ValueType};
use depthloom_kernels::mixture::{self, Fused, MixtureScratch, Prior, Rules};
use depthloom_threads::locked;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex};

use super::{evidence, reliability};
use crate::bounds::{above_zero, within};
use crate::shape::same_size;

/// How the monocular estimate is aligned with stereo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Alignment {
    /// Monocular depth is used as it is.
    None,
    /// It is shifted in log depth by what stereo's inliers around each pixel say.
    #[default]
    Local,
}

/// Factors of the prior probability that stereo is an inlier.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct PriorParams {
    /// Factor where both views differ by at most 1 px, and everywhere without `right`.
    #[schemars(range(min = 0, max = 1))]
    pub consistent: f64,
    /// Factor where they differ by more than 1 px and at most 3 px.
    #[schemars(range(min = 0, max = 1))]
    pub close: f64,
    /// Factor where they differ by more, or where the right view is invalid.
    #[schemars(range(min = 0, max = 1))]
    pub inconsistent: f64,
    /// Factor at every pixel.
    #[schemars(range(min = 0, max = 1))]
    pub keep: f64,
    /// Factor where the match is not unique: `unique` is invalid, or `ambiguity` is too high.
    #[schemars(range(min = 0, max = 1))]
    pub not_unique: f64,
    /// Monocular depth is near if it is below this many times the depth of the largest disparity. The true disparity
    /// is then probably out of range.
    #[schemars(range(min = 0, max = 100))]
    pub near_factor: f64,
    /// Factor where monocular depth is near; 1 disables the rule.
    #[schemars(range(min = 0, max = 1))]
    pub near: f64,
    /// A match counts as unique if its `ambiguity` is at most this. 0.9 is `uniqueness: 10` of the matcher.
    #[schemars(range(min = 0, max = 1))]
    pub unique_ambiguity: f64,
    /// A further factor, lower where the neighbourhood has few trusted pixels; `null` disables it.
    pub support: Option<SupportParams>,
    /// Factor where `confidence` is 0; it rises linearly to 1 at 1. With 1 the input has no effect.
    #[schemars(range(min = 0, max = 1))]
    pub unconfident: f64,
}

impl Default for PriorParams {
    fn default() -> Self {
        Self {
            consistent: 0.99,
            close: 0.8,
            inconsistent: 0.35,
            keep: 0.97,
            not_unique: 0.5,
            near_factor: 1.5,
            near: 0.02,
            unique_ambiguity: 0.9,
            support: Some(SupportParams::default()),
            unconfident: 1.0,
        }
    }
}

/// The factor of the prior that follows from the share of trusted pixels around a pixel: valid, consistent and unique.
///
/// Where the share is low, stereo guesses, and some guesses agree by chance.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SupportParams {
    /// The share is taken in a square window of `2 radius + 1` px.
    #[schemars(range(min = 1, max = 100))]
    pub radius: u32,
    /// Share up to which the factor is `floor`.
    #[schemars(range(min = 0, max = 1))]
    pub low: f64,
    /// Share from which the factor is 1, above `low`.
    #[schemars(range(min = 0, max = 1))]
    pub high: f64,
    /// The smallest factor. Between `low` and `high` it rises linearly to 1.
    #[schemars(range(min = 0, max = 1))]
    pub floor: f64,
}

impl Default for SupportParams {
    fn default() -> Self {
        Self { radius: 10, low: 0.3, high: 0.8, floor: 0.05 }
    }
}

/// Parameters of local alignment.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct LocalParams {
    /// Standard deviation of the Gaussian that averages inliers around a pixel, px.
    #[schemars(range(min = 1, max = 100))]
    pub sigma: f64,
    /// Averaged weight of stereo at which half of the shift is applied.
    #[schemars(range(max = 1), extend("exclusiveMinimum" = 0))]
    pub regulariser: f64,
    /// Number of iterations; each computes the inliers, then the shift.
    #[schemars(range(min = 1, max = 100))]
    pub iterations: u32,
    /// Smallest standard deviation of aligned monocular log depth, at most `mono_spread`. A stereo pixel more precise
    /// than this has full weight.
    #[schemars(range(max = 10), extend("exclusiveMinimum" = 0))]
    pub least_spread: f64,
}

impl Default for LocalParams {
    fn default() -> Self {
        Self { sigma: 18.0, regulariser: 0.02, iterations: 4, least_spread: 0.05 }
    }
}

/// Parameters of `fusion/mixture`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct MixtureParams {
    /// How monocular depth is aligned with stereo: `none` or `local`.
    pub alignment: Alignment,
    /// Number of disparities that stereo searched, px: `disparities` of the matcher. It decides which depths are near.
    /// A disparity beyond is an error.
    #[schemars(range(min = 1, max = 4096))]
    pub disparities: u32,
    /// Standard deviation of the disparity of an inlier, px.
    #[schemars(range(max = 100), extend("exclusiveMinimum" = 0))]
    pub stereo_noise: f64,
    /// Standard deviation of monocular log depth, before alignment.
    #[schemars(range(max = 10), extend("exclusiveMinimum" = 0))]
    pub mono_spread: f64,
    /// Range of log disparities over which outliers are uniform. The default is that of 0.5 to 64 px.
    #[schemars(range(max = 100), extend("exclusiveMinimum" = 0))]
    pub outliers: f64,
    /// Largest depth in the outputs, metres; `null` does not limit depth.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
    /// Factors of the prior probability that stereo is an inlier.
    pub prior: PriorParams,
    /// Parameters of `alignment: local`.
    pub local: LocalParams,
}

impl Default for MixtureParams {
    fn default() -> Self {
        Self {
            alignment: Alignment::Local,
            disparities: 64,
            stereo_noise: 1.0,
            mono_spread: 0.4,
            // ln 128.
            outliers: 4.852_030_263_919_617,
            cap: Some(80.0),
            prior: PriorParams::default(),
            local: LocalParams::default(),
        }
    }
}

impl MixtureParams {
    fn for_kernel(&self) -> mixture::Mixture {
        let Self { local, prior, .. } = self;
        mixture::Mixture {
            alignment: match self.alignment {
                Alignment::None => mixture::Alignment::None,
                Alignment::Local => mixture::Alignment::Local(mixture::Local {
                    sigma: local.sigma,
                    regulariser: local.regulariser as f32,
                    iterations: local.iterations,
                    least_spread: local.least_spread as f32,
                }),
            },
            stereo_noise: self.stereo_noise as f32,
            mono_spread: self.mono_spread as f32,
            outliers: self.outliers as f32,
            cap: self.cap.map_or(f32::INFINITY, |cap| cap as f32),
            prior: Prior::Rules(Rules {
                consistent: prior.consistent as f32,
                close: prior.close as f32,
                inconsistent: prior.inconsistent as f32,
                keep: prior.keep as f32,
                not_unique: prior.not_unique as f32,
                near_factor: prior.near_factor as f32,
                near: prior.near as f32,
                unique_most: prior.unique_ambiguity as f32,
                support: prior.support.as_ref().map(|support| mixture::Support {
                    radius: support.radius as usize,
                    low: support.low as f32,
                    high: support.high as f32,
                    floor: support.floor as f32,
                }),
                unconfident: prior.unconfident as f32,
            }),
        }
    }
}

/// A number above 0 and at most `most`.
fn positive(name: &'static str, value: f64, most: f64) -> Result<(), (&'static str, String)> {
    above_zero(name, Some(value), "")?;
    within(name, value, "", 0.0..=most)
}

pub(crate) struct Mixture {
    mixture: Arc<mixture::Mixture>,
    disparities: u32,
    /// With the last reliability that was read, by the hash of its content.
    learned: Mutex<Option<(Key, Arc<mixture::Mixture>)>>,
}

impl Node for Mixture {
    type Params = MixtureParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "fusion/mixture",
            version: 2,
            contract: Contract::Pure,
            summary: "Stereo and monocular depth, fused by the probability that stereo is an inlier; with uncertainty.",
            doc: "\
Each pixel of stereo is either an inlier or an outlier. An inlier measures the same surface as the monocular estimate; \
an outlier is uniform over a range of disparities. This is the measurement model of Vogiatzis and Hernandez \
(*Video-based, real-time multi-view stereo*, 2011).\n\n\
All is in log depth. Stereo measures `z_s` with standard deviation `s_s = stereo_noise / (d + doffs)`. The monocular \
estimate measures `z_m` with `s_m`. `N` is the normal density of `z_s - z_m` with variance `s_s^2 + s_m^2`, `p` the \
prior. The probability of an inlier is `q = p N / (p N + (1 - p) / outliers)`. The fused depth is `exp(q m + (1 - \
q) z_m)`, where `m` is the inverse-variance mean of `z_s` and `z_m`. A 5x5 median ends the fusion, as in \
`filter/median`.\n\n\
The prior `p` is the product of the factors in `prior`. The right view, `unique` or `ambiguity`, and the share of \
trusted pixels around a pixel are evidence of the matcher. A near monocular depth is evidence, too: its disparity was \
probably not searched.\n\n\
With `alignment: none`, `z_m` is the logarithm of `mono`, and `s_m` is `mono_spread`. With `alignment: local`, a \
Gaussian of `local.sigma` px averages `z_s - z_m` over the inliers around each pixel, and `z_m` moves by this average. \
`s_m` is the standard deviation around it, where there are enough inliers. Probabilities and alignment are repeated \
`local.iterations` times.\n\n\
`deviation` is `Z sqrt(V)`: `Z` is the output `depth`, and `V` is the variance of log depth under the mixture of both \
cases. Where stereo is invalid, `depth` is `aligned` and `V` is `s_m^2`. Where `mono` is invalid, `depth` is that of \
stereo, `inlier` is `p`, and `V` is `s_s^2`. Where both are invalid, so are the outputs.\n\n\
`right` and `ambiguity` are outputs of `stereo/sgbm` with `right: true` and `ambiguity: true`, or `right` comes from a \
second matcher with exchanged images, as for `disparity/left-right`. `unique` comes from a matcher with a uniqueness \
check, such as `stereo/sgbm` with `uniqueness: 10`. Without `right`, every pixel counts as consistent. Without `unique` \
and `ambiguity`, every match counts as unique.\n\n\
With `mono_deviation`, such as the output `deviation` of `mono/onnx`, `s_m` before alignment is its ratio to `mono` \
where both are valid.\n\n\
With `reliability`, the prior and `s_m` before alignment are those that `learn/reliability` learned. Then `prior`, \
`mono_spread` and `confidence` have no effect.",
            inputs: evidence::ports()
                .into_iter()
                .chain([
                    Port::frame(
                        "mono_deviation",
                        ValueType::Depth,
                        "Standard deviation of `mono`, metres; replaces `mono_spread` where it is valid.",
                    )
                    .optional(),
                    Port::frame("confidence", ValueType::Weight, "Confidence in stereo, `W_c`, in [0, 1].").optional(),
                    Port::once(
                        "reliability",
                        ValueType::Reliability,
                        "Priors and standard deviations: the output of `learn/reliability`.",
                    )
                    .optional(),
                ])
                .collect(),
            outputs: vec![
                Port::frame("depth", ValueType::Depth, "Fused depth, metres, NaN = invalid."),
                Port::frame("deviation", ValueType::Depth, "Standard deviation of `depth`, metres, NaN = invalid."),
                Port::frame(
                    "inlier",
                    ValueType::Weight,
                    "Probability that stereo is an inlier; 0 where it is invalid.",
                ),
                Port::frame("aligned", ValueType::Depth, "Aligned monocular depth, metres, NaN = invalid."),
            ],
        }
    }

    fn check(params: &MixtureParams) -> Result<(), (&'static str, String)> {
        let MixtureParams { prior, local, .. } = params;
        within("disparities", f64::from(params.disparities), " px", 1.0..=4096.0)?;
        positive("stereo_noise", params.stereo_noise, 100.0)?;
        positive("mono_spread", params.mono_spread, 10.0)?;
        positive("outliers", params.outliers, 100.0)?;
        above_zero("cap", params.cap, "m")?;
        for (name, factor) in [
            ("prior.consistent", prior.consistent),
            ("prior.close", prior.close),
            ("prior.inconsistent", prior.inconsistent),
            ("prior.keep", prior.keep),
            ("prior.not_unique", prior.not_unique),
            ("prior.near", prior.near),
            ("prior.unique_ambiguity", prior.unique_ambiguity),
            ("prior.unconfident", prior.unconfident),
        ] {
            within(name, factor, "", 0.0..=1.0)?;
        }
        if let Some(SupportParams { radius, low, high, floor }) = &prior.support {
            within("prior.support.radius", f64::from(*radius), " px", 1.0..=100.0)?;
            within("prior.support.low", *low, "", 0.0..=1.0)?;
            within("prior.support.high", *high, "", 0.0..=1.0)?;
            within("prior.support.floor", *floor, "", 0.0..=1.0)?;
            if low >= high {
                return Err(("prior.support.low", format!("prior.support.low is {low}, expected below high ({high})")));
            }
        }
        within("prior.near_factor", prior.near_factor, "", 0.0..=100.0)?;
        within("local.sigma", local.sigma, " px", 1.0..=100.0)?;
        positive("local.regulariser", local.regulariser, 1.0)?;
        within("local.iterations", f64::from(local.iterations), "", 1.0..=100.0)?;
        positive("local.least_spread", local.least_spread, 10.0)?;
        if params.alignment == Alignment::Local && local.least_spread > params.mono_spread {
            let (least, most) = (local.least_spread, params.mono_spread);
            return Err((
                "local.least_spread",
                format!("local.least_spread is {least}, expected at most mono_spread ({most})"),
            ));
        }
        Ok(())
    }

    fn build(params: MixtureParams) -> Result<Instance, Fault> {
        let (mixture, disparities) = (Arc::new(params.for_kernel()), params.disparities);
        Ok(Instance::Pure(Box::new(Self { mixture, disparities, learned: Mutex::default() })))
    }
}

impl Mixture {
    /// With what was learned, if it is wired.
    fn with(&self, reliability: Option<&Arc<Artifact>>) -> Result<Arc<mixture::Mixture>, Fault> {
        let Some(artifact) = reliability else { return Ok(Arc::clone(&self.mixture)) };
        let mut learned = locked(&self.learned);
        if let Some((hash, mixture)) = &*learned
            && *hash == artifact.hash
        {
            return Ok(Arc::clone(mixture));
        }
        let prior = Prior::Learned(Box::new(reliability::read(artifact, self.disparities)?));
        let mixture = Arc::new(mixture::Mixture { prior, ..(*self.mixture).clone() });
        *learned = Some((artifact.hash, Arc::clone(&mixture)));
        Ok(mixture)
    }
}

impl PureNode for Mixture {
    fn prepare(&self, files: &Inputs<'_>) -> Result<(), Fault> {
        self.with(files.optional("reliability")?).map(|_| ())
    }

    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let mixture = self.with(inputs.optional("reliability")?)?;
        let mut frame = evidence::frame(inputs, self.disparities)?;
        let size = (frame.width as u32, frame.height as u32);
        frame.evidence.confidence = evidence::weight(inputs, "confidence", size)?;
        if let Some(deviation) = inputs.optional::<Depth>("mono_deviation")? {
            same_size(("disparity", size), ("mono_deviation", deviation.metres.dimensions()))?;
            frame.mono_deviation = Some(&deviation.metres);
        }
        let mut scratch = ctx.scratch.take::<MixtureScratch>();
        let [mut depth, mut deviation, mut inlier, mut aligned] = [(); 4].map(|()| Raster::<f32>::new(size.0, size.1));
        let mut fused =
            Fused { depth: &mut depth, deviation: &mut deviation, inlier: &mut inlier, aligned: &mut aligned };
        mixture::fuse(&mixture, &frame, &mut scratch, &mut fused);
        ctx.scratch.put(scratch);
        Ok(Outputs::one("depth", Depth { metres: depth })
            .with("deviation", Depth { metres: deviation })
            .with("inlier", Weight { share: inlier })
            .with("aligned", Depth { metres: aligned }))
    }
}
