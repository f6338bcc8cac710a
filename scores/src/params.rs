//! How scores are asked for.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Crop, PixelSet, Preset, ScaleInvariant, Settings, SquaredRelative};

/// How scores are asked for, in an experiment and in a recording's plan: a preset, and what differs from it. Parameters of `score/depth`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ScoreParams {
    /// Named settings: `paper`, `monodepth2` or `kitti-depth`.
    pub preset: Preset,
    /// The pixel sets, a row each: `all` and `answered`.
    #[schemars(length(min = 1))]
    pub sets: Vec<PixelSet>,
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
    pub crop: Option<Crop>,
    /// Whether answers are multiplied by `median(truth) / median(estimate)` of the frame first; `null`: the preset's.
    pub median_scaling: Option<bool>,
    /// What `sq_rel` is: `by-truth` or `by-truth-squared`; `null`: the preset's.
    pub sq_rel: Option<SquaredRelative>,
    /// What `silog` is: `half-variance` or `hundred-deviation`; `null`: the preset's.
    pub silog: Option<ScaleInvariant>,
}

impl Default for ScoreParams {
    fn default() -> Self {
        Self {
            preset: Preset::Paper,
            sets: vec![PixelSet::All],
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

impl ScoreParams {
    /// The preset's settings with what differs from it.
    #[must_use]
    pub fn settings(&self) -> Settings {
        let preset = self.preset.settings();
        Settings {
            min_m: self.min_m.unwrap_or(preset.min_m),
            max_m: self.max_m.unwrap_or(preset.max_m),
            missing_m: self.missing_m.unwrap_or(preset.missing_m),
            crop: self.crop.unwrap_or(preset.crop),
            median_scaling: self.median_scaling.unwrap_or(preset.median_scaling),
            sq_rel: self.sq_rel.unwrap_or(preset.sq_rel),
            silog: self.silog.unwrap_or(preset.silog),
        }
    }

    /// Whether these parameters can be scored with.
    ///
    /// # Errors
    /// The parameter at fault, by its name, and why.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        if self.sets.is_empty() {
            return Err(("sets", "sets is empty: name `all`, `answered` or both".to_owned()));
        }
        if self.sets.iter().enumerate().any(|(i, set)| self.sets[..i].contains(set)) {
            return Err(("sets", "sets names a pixel set twice".to_owned()));
        }
        if self.sets.contains(&PixelSet::Filled) {
            return Err((
                "sets",
                "sets names `filled`, which is for disparities: depths have `all` and `answered`".to_owned(),
            ));
        }
        self.settings().check().map_err(|(name, what)| (name, format!("{name} {what}")))
    }
}
