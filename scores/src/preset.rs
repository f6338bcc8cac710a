//! Named settings: what "the usual scores" are, for whom.

use crate::{Crop, ScaleInvariant, Settings, SquaredRelative};

/// A named set of [`Settings`].
///
/// | | `paper` | `monodepth2` | `kitti-depth` |
/// |---|---|---|---|
/// | truth scored | 1e-3 < t < 80 m | 1e-3 < t < 80 m | all a KITTI depth PNG can hold: 1e-3 < t < 256 m |
/// | crop | none | Garg | none |
/// | median scaling | no | yes, frame by frame | no |
/// | clamp of answers | [1e-3, 80] m | [1e-3, 80] m | [1e-3, 256] m |
/// | missing answer in `all` | 1e-4 m | 1e-4 m | 1e-4 m |
/// | `sq_rel` | `mean((y-t)^2/t)`, m | `mean((y-t)^2/t)`, m | `mean((y-t)^2/t^2)` |
/// | `silog` | `1/2N sum(e - mean e)^2` | as `paper` | `100 sqrt(1/N sum(e - mean e)^2)` |
///
/// The other six scores are the same formulas everywhere. A data set's value is the unweighted mean over frames of each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Preset {
    /// Martins, van Hecke, de Croon 2018, Table I. What the paper leaves open follows from its numbers: a missing answer counts
    /// as 1e-4 m, truth stops at 80 m, `silog` is half the variance of the log error.
    #[default]
    Paper,
    /// `evaluate_depth.py` of monodepth2 with the Eigen split: Garg crop, median scaling (its default for networks taught by
    /// video; a network taught by stereo switches it off: set `median_scaling: false`). It has dense estimates only and no
    /// `silog`: both are as in `paper`.
    Monodepth2,
    /// The depth development kit of KITTI (2017): no crop, no cap. Its `sq_rel` divides by the truth squared and its `silog` is
    /// a deviation times 100. The kit fills holes of an estimate before scoring; here they stay holes and count as 1e-4 m in
    /// `all`: put a filling node before the score to have its numbers.
    KittiDepth,
}

impl Preset {
    /// All presets, in the order of documentation.
    pub const ALL: [Self; 3] = [Self::Paper, Self::Monodepth2, Self::KittiDepth];

    /// The name used in YAML.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Monodepth2 => "monodepth2",
            Self::KittiDepth => "kitti-depth",
        }
    }

    /// The preset of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|preset| preset.name() == name)
    }

    /// The settings it stands for.
    #[must_use]
    pub const fn settings(self) -> Settings {
        let paper = Settings {
            min_m: 1e-3,
            max_m: 80.0,
            missing_m: 1e-4,
            crop: Crop::None,
            median_scaling: false,
            sq_rel: SquaredRelative::ByTruth,
            silog: ScaleInvariant::HalfVariance,
        };
        match self {
            Self::Paper => paper,
            Self::Monodepth2 => Settings { crop: Crop::Garg, median_scaling: true, ..paper },
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
        Preset::Paper.settings()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_can_be_found_by_name_and_scored_with() {
        for preset in Preset::ALL {
            assert_eq!(Preset::from_name(preset.name()), Some(preset));
            assert_eq!(preset.settings().check(), Ok(()));
        }
    }
}
