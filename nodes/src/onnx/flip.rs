//! Merges two outputs of a network: for the image and for its mirror image.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Whether the network also sees the mirrored image, and how both outputs are merged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Flip {
    /// The image alone.
    #[default]
    None,
    /// The mean of both.
    Mean,
    /// The mean of both, except near the edges: towards the left edge the mirrored output is used, towards the right
    /// edge the plain one. In the outermost 5 % of the columns only that output counts; in the next 5 % it is blended
    /// with the mean. This is the post-processing of Godard et al., "Unsupervised monocular depth estimation with
    /// left-right consistency", CVPR 2017. Networks trained on stereo pairs are worst at the edge that only one
    /// camera saw.
    Godard,
}

impl Flip {
    pub(crate) const fn images(self) -> usize {
        match self {
            Self::None => 1,
            Self::Mean | Self::Godard => 2,
        }
    }

    /// `of_mirrored` is the network's map of the mirrored image, not mirrored back.
    pub(crate) fn join(self, map: &mut [f32], of_mirrored: &[f32], width: usize) {
        let shares: Vec<f32> = (0..width).map(|column| self.share_of_plain(column, width)).collect();
        for (row, mirrored) in map.chunks_exact_mut(width).zip(of_mirrored.chunks_exact(width)) {
            for ((value, mirrored), share) in row.iter_mut().zip(mirrored.iter().rev()).zip(&shares) {
                // If only one of the two is a number, it is used.
                *value = match (value.is_finite(), mirrored.is_finite()) {
                    (true, true) => share * *value + (1.0 - share) * mirrored,
                    (true, false) => *value,
                    (false, true) => *mirrored,
                    (false, false) => f32::NAN,
                };
            }
        }
    }

    /// Weight of the plain image's map in a column; the mirrored one has the rest.
    fn share_of_plain(self, column: usize, width: usize) -> f32 {
        match self {
            Self::None => 1.0,
            Self::Mean => 0.5,
            Self::Godard => {
                let last = (width - 1).max(1) as f64;
                let ramp = |place: f64| 1.0 - (20.0 * (place - 0.05)).clamp(0.0, 1.0);
                // Godard's masks: `right * plain + left * mirrored + (1 - left - right) * mean`.
                let (left, right) = (ramp(column as f64 / last), ramp((width - 1 - column) as f64 / last));
                (0.5 * (1.0 - left + right)) as f32
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Flip;

    fn joined(flip: Flip, width: usize) -> Vec<f32> {
        let (mut plain, mirrored) = (vec![1.0; 2 * width], vec![0.0; 2 * width]);
        flip.join(&mut plain, &mirrored, width);
        assert_eq!(plain[..width], plain[width..], "rows are alike");
        plain.truncate(width);
        plain
    }

    #[test]
    fn the_mirrored_output_is_mirrored_back() {
        let mut plain = [1.0, 2.0, 3.0];
        Flip::Mean.join(&mut plain, &[7.0, 5.0, 3.0], 3);
        assert_eq!(plain, [2.0, 3.5, 5.0]);
    }

    #[test]
    fn godards_ramps_use_at_each_edge_the_output_that_saw_it() {
        // 41 columns: one is a fortieth of the width. 1 is the plain output, 0 the mirrored one.
        let shares = joined(Flip::Godard, 41);
        for (column, expected) in
            [(0, 0.0), (2, 0.0), (3, 0.25), (4, 0.5), (20, 0.5), (36, 0.5), (37, 0.75), (38, 1.0), (40, 1.0)]
        {
            assert!((shares[column] - expected).abs() < 1e-6, "column {column}: {} is not {expected}", shares[column]);
        }
    }

    #[test]
    fn fault_42_if_one_of_two_outputs_is_nan_the_other_is_used() {
        for flip in [Flip::Mean, Flip::Godard] {
            let mut plain = [f32::NAN, 2.0, f32::INFINITY];
            flip.join(&mut plain, &[f32::NAN, f32::NEG_INFINITY, 3.0], 3);
            assert_eq!(plain[..2], [3.0, 2.0], "{flip:?}");
            assert!(plain[2].is_nan());
        }
    }

    #[test]
    fn a_single_column_has_both_edges() {
        assert_eq!(joined(Flip::Godard, 1), [0.5]);
    }
}
