//! `score/depth`: the eight scores of Table I.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_scores::{Crop, PixelSet, Preset, ScaleInvariant, Settings, SquaredRelative, score};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::shape::same_size;

/// Named settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ScorePreset {
    /// Table I of Martins et al. 2018: truth in 0.001 to 80 m, a missing answer counts as 0.0001 m, `silog` is half the variance.
    #[default]
    Paper,
    /// monodepth2 on the Eigen split: Garg crop, median scaling.
    Monodepth2,
    /// The KITTI depth development kit: no cap below 256 m, `sq_rel` over the squared truth, `silog` a deviation times 100.
    KittiDepth,
}

/// Which pixels are scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ScoreSet {
    /// Every true pixel; a missing answer counts as `missing_m`.
    All,
    /// The true pixels where the estimate answered.
    Answered,
}

/// The part of the image that is scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ScoreCrop {
    /// The whole image.
    None,
    /// Garg et al. 2016.
    Garg,
    /// Eigen et al. 2014.
    Eigen,
}

/// What `sq_rel` is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ScoreSqRel {
    /// `mean((y - t)^2 / t)`, metres.
    ByTruth,
    /// `mean((y - t)^2 / t^2)`.
    ByTruthSquared,
}

/// What `silog` is, with `e = ln y - ln t`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ScoreSilog {
    /// `1/2N sum (e - mean e)^2`.
    HalfVariance,
    /// `100 sqrt(1/N sum (e - mean e)^2)`.
    HundredDeviation,
}

/// Parameters of `score/depth`: a preset, and what differs from it.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ScoreDepthParams {
    /// Named settings: `paper`, `monodepth2` or `kitti-depth`.
    pub preset: ScorePreset,
    /// The pixel sets, a row each: `all` and `answered`.
    #[schemars(length(min = 1))]
    pub sets: Vec<ScoreSet>,
    /// Truth above this is scored, and answers below (not missing ones) are raised to it, metres; `null`: the preset's.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub min_m: Option<f64>,
    /// Truth below this is scored, and answers above are lowered to it, metres; `null`: the preset's.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub max_m: Option<f64>,
    /// What a missing answer counts as in the set `all`, metres, as it is: also where it is below `min_m`; `null`: the preset's.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub missing_m: Option<f64>,
    /// The part of the image that is scored: `none`, `garg` or `eigen`; `null`: the preset's.
    pub crop: Option<ScoreCrop>,
    /// Whether answers are multiplied by `median(truth) / median(estimate)` of the frame first; `null`: the preset's.
    pub median_scaling: Option<bool>,
    /// What `sq_rel` is: `by-truth` or `by-truth-squared`; `null`: the preset's.
    pub sq_rel: Option<ScoreSqRel>,
    /// What `silog` is: `half-variance` or `hundred-deviation`; `null`: the preset's.
    pub silog: Option<ScoreSilog>,
}

impl Default for ScoreDepthParams {
    fn default() -> Self {
        Self {
            preset: ScorePreset::Paper,
            sets: vec![ScoreSet::All],
            min_m: None,
            max_m: None,
            missing_m: None,
            crop: None,
            median_scaling: None,
            sq_rel: None,
            silog: None,
        }
    }
}

impl ScoreDepthParams {
    /// The preset's settings with what differs from it.
    #[must_use]
    pub fn settings(&self) -> Settings {
        let preset = match self.preset {
            ScorePreset::Paper => Preset::Paper.settings(),
            ScorePreset::Monodepth2 => Preset::Monodepth2.settings(),
            ScorePreset::KittiDepth => Preset::KittiDepth.settings(),
        };
        let crop = |crop| match crop {
            ScoreCrop::None => Crop::None,
            ScoreCrop::Garg => Crop::Garg,
            ScoreCrop::Eigen => Crop::Eigen,
        };
        let sq_rel = |formula| match formula {
            ScoreSqRel::ByTruth => SquaredRelative::ByTruth,
            ScoreSqRel::ByTruthSquared => SquaredRelative::ByTruthSquared,
        };
        let silog = |formula| match formula {
            ScoreSilog::HalfVariance => ScaleInvariant::HalfVariance,
            ScoreSilog::HundredDeviation => ScaleInvariant::HundredDeviation,
        };
        Settings {
            min_m: self.min_m.unwrap_or(preset.min_m),
            max_m: self.max_m.unwrap_or(preset.max_m),
            missing_m: self.missing_m.unwrap_or(preset.missing_m),
            crop: self.crop.map_or(preset.crop, crop),
            median_scaling: self.median_scaling.unwrap_or(preset.median_scaling),
            sq_rel: self.sq_rel.map_or(preset.sq_rel, sq_rel),
            silog: self.silog.map_or(preset.silog, silog),
        }
    }

    /// The pixel sets, in the order asked for.
    #[must_use]
    pub fn pixel_sets(&self) -> Vec<PixelSet> {
        let set = |set: &ScoreSet| match set {
            ScoreSet::All => PixelSet::All,
            ScoreSet::Answered => PixelSet::Answered,
        };
        self.sets.iter().map(set).collect()
    }
}

/// The kind `score/depth`.
pub struct ScoreDepth {
    settings: Settings,
    sets: Vec<PixelSet>,
}

impl Node for ScoreDepth {
    type Params = ScoreDepthParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "score/depth",
            version: 1,
            contract: Contract::Pure,
            summary: "The eight scores of Table I of an estimate against the truth, per frame.",
            doc: "\
`a1 a2 a3 abs_rel sq_rel rmse rmse_log silog` over the scored pixels, one row a pixel set, in f64. In this order: the truth is masked by \
`min_m < t < max_m` (both strict) and by the crop; answers are median scaled if asked for; answers are clamped to `[min_m, max_m]` last. In the set \
`all` a missing answer (NaN or infinity) counts as `missing_m`, exactly: it is neither scaled nor clamped, so that the paper's 0.0001 m stays below its \
`min_m` of 0.001 m and `rmse_log` and `silog` are taken of it. In `answered` it is left out.\n\n\
With `y` the answer, `t` the truth and `e = ln y - ln t` (natural logarithm), over N pixels: `a1`, `a2`, `a3` are the shares with \
`max(y/t, t/y)` below 1.25, 1.25^2, 1.25^3; `abs_rel = mean(|y - t| / t)`; `rmse = sqrt(mean((y - t)^2))`; `rmse_log = sqrt(mean(e^2))`; `sq_rel` and \
`silog` as the preset or the parameter says. A data set's value is the unweighted mean over its frames.\n\n\
`score:` in a stage is sugar for nodes of this kind.",
            inputs: vec![
                Port::frame("estimate", ValueType::Depth, "Estimated depth, metres, NaN = no answer."),
                Port::frame("truth", ValueType::Depth, "True depth, metres, NaN = unknown; of the same size."),
            ],
            outputs: vec![Port::frame("rows", ValueType::Scores, "One row a pixel set.")],
        }
    }

    fn check(params: &ScoreDepthParams) -> Result<(), (&'static str, String)> {
        let repeated = |(i, set): (usize, &ScoreSet)| params.sets[..i].contains(set);
        if params.sets.is_empty() {
            return Err(("sets", "sets is empty: name `all`, `answered` or both".to_owned()));
        }
        if params.sets.iter().enumerate().any(repeated) {
            return Err(("sets", "sets names a pixel set twice".to_owned()));
        }
        params.settings().check().map_err(|(name, what)| (name, format!("{name} {what}")))
    }

    fn build(params: ScoreDepthParams) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(Self { settings: params.settings(), sets: params.pixel_sets() })))
    }
}

impl PureNode for ScoreDepth {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let estimate = &inputs.get::<Depth>("estimate")?.metres;
        let truth = &inputs.get::<Depth>("truth")?.metres;
        let (width, height) = truth.dimensions();
        same_size(("estimate", estimate.dimensions()), ("truth", (width, height)))?;
        Ok(Outputs::one("rows", score(estimate, truth, width as usize, height as usize, &self.sets, &self.settings)))
    }
}
