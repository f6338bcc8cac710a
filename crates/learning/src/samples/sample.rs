//! A training sample in memory.

use depthloom_kernels::learned::Cell;
use half::f16;

/// Bytes of a cell.
pub(super) const CELL_LEN: usize = 7;

/// A frame as a training sample.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sample {
    /// The frame's own name, e.g. `000150_10`; frames of joined sources may share one.
    pub(crate) id: String,
    /// The left image, 3 x height x width: the planes of red, green and blue, 0 to 255.
    pub(crate) image: Vec<u8>,
    /// The right image, likewise.
    pub(crate) right: Option<Vec<u8>>,
    /// The target, height x width: disparity as a share of the image's width, above 0; NaN = no target.
    pub(crate) share: Vec<f16>,
    /// `f * B / width`, metres: depth is this over the share. `None` without calibration.
    pub(crate) depth_scale: Option<f64>,
    /// What fusion sees beside the image, height x width.
    pub(crate) cells: Option<Vec<[u8; CELL_LEN]>>,
}

/// The cell, rounded: shares of the width to IEEE half, other shares to 1/255. A half that would be 0 or infinite is
/// the nearest that is not.
pub(crate) fn cell_bytes(cell: &Cell) -> [u8; CELL_LEN] {
    let half = |share: f32| match f16::from_f32(share) {
        half if share > 0.0 => half.clamp(f16::MIN_POSITIVE, f16::MAX).to_le_bytes(),
        _ => [0; 2],
    };
    let byte = |share: f32| (share * 255.0).round_ties_even() as u8;
    let ([s0, s1], [m0, m1]) = (half(cell.stereo), half(cell.mono));
    [s0, s1, m0, m1, byte(cell.covered), byte(cell.consistent), byte(cell.weight)]
}

pub(super) fn cell([s0, s1, m0, m1, covered, consistent, weight]: [u8; CELL_LEN]) -> Cell {
    let (half, share) = (|low, high| f16::from_le_bytes([low, high]).to_f32(), |byte| f32::from(byte) / 255.0);
    let (covered, consistent, weight) = (share(covered), share(consistent), share(weight));
    Cell { stereo: half(s0, s1), covered, consistent, mono: half(m0, m1), weight }
}
