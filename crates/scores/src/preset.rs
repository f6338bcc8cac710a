//! Named settings: what "the usual scores" are, for whom.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Align, Crop, ScaleInvariant, Settings, SquaredRelative};

/// A named set of [`Settings`].
///
/// | | `paper` | `monodepth2` | `kitti-depth` |
/// |---|---|---|---|
/// | truth scored | 1e-3 < t < 80 m | 1e-3 < t < 80 m | all a KITTI depth PNG can hold: 1e-3 < t < 256 m |
/// | crop | none | Garg | none |
/// | alignment | none | median, frame by frame | none |
/// | clamp of answers | [1e-3, 80] m | [1e-3, 80] m | [1e-3, 256] m |
/// | missing answer in `all` | 1e-4 m | 1e-4 m | 1e-4 m |
/// | `sq_rel` | `mean((y-t)^2/t)`, m | `mean((y-t)^2/t)`, m | `mean((y-t)^2/t^2)` |
/// | `silog` | `1/2N sum(e - mean e)^2` | as `paper` | `100 sqrt(1/N sum(e - mean e)^2)` |
///
/// The other six scores are the same formulas everywhere. A data set's value is the unweighted mean over frames of
/// each.
///
/// What Table I leaves open follows from its numbers: a missing answer counts as 1e-4 m, truth stops at 80 m, `silog`
/// is half the variance of the log error. `monodepth2` is that project's `evaluate_depth.py`: median scaling is its
/// default for networks taught by video; a network taught by stereo switches it off (`align: none`); it has dense
/// estimates only and no `silog`: both are as in `paper`. The kit of `kitti-depth` (2017) fills holes of an estimate
/// before scoring; here they stay holes and count as 1e-4 m in `all`: put a filling node before the score to have its
/// numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(description = "Named settings.")]
pub enum Preset {
    /// Table I of Martins et al. 2018: truth in 0.001 to 80 m, a missing answer counts as 0.0001 m, `silog` is half the
    /// variance.
    #[default]
    Martins2018,
    /// monodepth2 on the Eigen split: Garg crop, median scaling.
    Monodepth2,
    /// The KITTI depth development kit: no cap below 256 m, `sq_rel` over the squared truth, `silog` a deviation
    /// times 100.
    KittiDepth,
}

impl Preset {
    /// All presets, in the order of documentation.
    pub const ALL: [Self; 3] = [Self::Martins2018, Self::Monodepth2, Self::KittiDepth];

    /// The settings it stands for.
    #[must_use]
    pub const fn settings(self) -> Settings {
        let paper = Settings {
            min_m: 1e-3,
            max_m: 80.0,
            missing_m: 1e-4,
            crop: Crop::None,
            align: Align::None,
            sq_rel: SquaredRelative::ByTruth,
            silog: ScaleInvariant::HalfVariance,
        };
        match self {
            Self::Martins2018 => paper,
            Self::Monodepth2 => Settings { crop: Crop::Garg, align: Align::Median, ..paper },
            Self::KittiDepth => Settings {
                max_m: 256.0,
                sq_rel: SquaredRelative::ByTruthSquared,
                silog: ScaleInvariant::HundredDeviation,
                ..paper
            },
        }
    }
}

impl Default for Settings {
    /// The settings of the preset `paper`.
    fn default() -> Self {
        Preset::Martins2018.settings()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_can_be_scored_with() {
        for preset in Preset::ALL {
            assert_eq!(preset.settings().check(), Ok(()));
        }
    }
}
