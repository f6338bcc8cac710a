//! Named settings of metrics, as papers and benchmarks use them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Align, Crop, ScaleInvariant, Settings, SquaredRelative};

/// A named set of [`Settings`].
///
/// | | `martins2018` | `monodepth2` | `kitti-depth` |
/// |---|---|---|---|
/// | scored ground truth | 1e-3 < t < 80 m | 1e-3 < t < 80 m | the range of a KITTI depth PNG: 1e-3 < t < 256 m |
/// | crop | none | Garg | none |
/// | alignment | none | median, frame by frame | none |
/// | clamp of valid estimates | [1e-3, 80] m | [1e-3, 80] m | [1e-3, 256] m |
/// | invalid pixel in `all` | 1e-4 m | 1e-4 m | 1e-4 m |
/// | `sq_rel` | `mean((y-t)^2/t)`, m | `mean((y-t)^2/t)`, m | `mean((y-t)^2/t^2)` |
/// | `silog` | `1/2N sum(e - mean e)^2` | as `martins2018` | `100 sqrt(1/N sum(e - mean e)^2)` |
///
/// The other six metrics have the same formulas everywhere. A data set's value is the unweighted mean over frames of
/// each.
///
/// Details that Table I does not state follow from its numbers: an invalid pixel counts as 1e-4 m, ground truth ends at
/// 80 m, `silog` is half the variance of the log error. `monodepth2` is that project's `evaluate_depth.py`: median
/// scaling is its default for networks trained on video; for a network trained on stereo it is switched off (`align:
/// none`); it has dense estimates only and no `silog`: both are as in `martins2018`. The kit of `kitti-depth` (2017)
/// fills holes of an estimate before scoring; here they stay holes and count as 1e-4 m in `all`: put a filling node
/// before the score to have its numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(description = "Named settings.")]
pub enum Preset {
    /// Table I of Martins et al. 2018: ground truth from 0.001 to 80 m, an invalid pixel counts as 0.0001 m, `silog` is
    /// half the variance.
    #[default]
    Martins2018,
    /// monodepth2 on the Eigen split: Garg crop, median scaling.
    Monodepth2,
    /// The KITTI depth development kit: no cap below 256 m, `sq_rel` over the squared ground truth, `silog` a deviation
    /// times 100.
    KittiDepth,
}

impl Preset {
    /// All presets, in the order of documentation.
    pub const ALL: [Self; 3] = [Self::Martins2018, Self::Monodepth2, Self::KittiDepth];

    /// Its settings.
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
    /// The settings of the preset `martins2018`.
    fn default() -> Self {
        Preset::Martins2018.settings()
    }
}

#[cfg(test)]
mod tests {
    use serde::de::IntoDeserializer;
    use serde::de::value::StrDeserializer;

    use super::*;

    /// The columns of the guide's table are the presets, and no other names.
    #[test]
    fn the_guide_names_the_presets() {
        let page = include_str!("../../../docs/explanation/scores.md");
        let head = page.lines().find(|line| line.contains("(default)")).unwrap();
        let names: Vec<&str> = head.split('`').skip(1).step_by(2).collect();
        let presets = names.iter().map(|name| {
            let name: StrDeserializer<'_, serde::de::value::Error> = name.into_deserializer();
            Preset::deserialize(name).unwrap()
        });
        assert_eq!(presets.collect::<Vec<_>>(), Preset::ALL);
        assert_eq!(Preset::ALL[0], Preset::default());
    }

    #[test]
    fn every_preset_can_be_scored_with() {
        for preset in Preset::ALL {
            assert_eq!(preset.settings().check(), Ok(()));
        }
    }
}
