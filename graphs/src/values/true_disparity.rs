//! Measured disparities.

use image::ImageBuffer;

use super::Raster;

/// Measured disparities of the left image: f32 pixels, NaN where unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct TrueDisparity {
    /// Pixels, row-major; NaN = unknown.
    pub px: Raster<f32>,
}

impl TrueDisparity {
    /// Disparities in the fixed point of KITTI's files: 1/256 px, 0 = unknown.
    ///
    /// # Panics
    /// Never: there are as many samples as before.
    pub fn from_px_256(px_256: &Raster<u16>) -> Self {
        let px = |&fixed: &u16| if fixed > 0 { f32::from(fixed) / 256.0 } else { f32::NAN };
        let (width, height) = px_256.dimensions();
        let px = ImageBuffer::from_raw(width, height, px_256.iter().map(px).collect());
        Self { px: px.expect("as many samples as before") }
    }

    /// Whether KITTI's fixed point (whole 256ths of a pixel, above 0, in 16 bits) represents all of them exactly.
    pub fn is_px_256(&self) -> bool {
        // Block by block, to stop early; without branches within a block (SIMD).
        self.px.chunks(BLOCK).all(|block| {
            let mut wrong = 0;
            for &px in block {
                let (exact, whole) = (px * 256.0, f32::from_bits(shifted(px)) - WHOLE);
                // NaN compares false.
                let is_between = u32::from(whole > exact) | u32::from(whole < exact);
                wrong |= is_between | u32::from(exact < 1.0) | u32::from(exact > f32::from(u16::MAX));
            }
            wrong == 0
        })
    }

    /// A disparity in KITTI's fixed point, 1/256 px, 0 = unknown.
    pub const fn to_px_256(px: f32) -> u16 {
        if px.is_nan() { 0 } else { shifted(px) as u16 }
    }

    /// All of them in KITTI's fixed point; `None` if that is not exact.
    ///
    /// # Panics
    /// Never: there are as many samples as before.
    pub fn px_256(&self) -> Option<Raster<u16>> {
        let (width, height) = self.px.dimensions();
        let fixed = || self.px.iter().map(|px| Self::to_px_256(*px)).collect();
        let px_256 = self.is_px_256().then(fixed);
        px_256.map(|fixed| ImageBuffer::from_raw(width, height, fixed).expect("as many samples as before"))
    }
}

const BLOCK: usize = 4096;
/// From here to twice this, neighbouring floats are 1 apart: a number added to it is in the low bits.
const WHOLE: f32 = (1 << 23) as f32;

/// The bits of `WHOLE` plus a disparity in 256ths of a pixel.
const fn shifted(px: f32) -> u32 {
    (px * 256.0 + WHOLE).to_bits()
}

#[cfg(test)]
mod tests {
    use super::{Raster, TrueDisparity};

    #[test]
    fn what_kittis_files_hold_comes_back_and_nothing_else_passes_for_it() {
        let all = Raster::from_raw(256, 256, (0..=u16::MAX).collect()).unwrap();
        let truth = TrueDisparity::from_px_256(&all);
        assert!(truth.px[(0, 0)].0[0].is_nan());
        assert_eq!(truth.px[(255, 255)].0, [65535.0 / 256.0]);
        assert_eq!(truth.px_256(), Some(all));
        for other in [0.0, -0.0, -1.0, 1.0 / 512.0, 10.000_001, 256.0, f32::INFINITY, f32::NEG_INFINITY, 1e-40] {
            let px = Raster::from_raw(3, 1, vec![1.0, f32::NAN, other]).unwrap();
            assert_eq!(TrueDisparity { px }.px_256(), None, "{other}");
        }
    }
}
