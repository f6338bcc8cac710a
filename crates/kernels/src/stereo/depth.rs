//! Depth in metres from disparity, from ground-truth files and from the road's geometry.
//!
//! NaN means invalid. All arithmetic is NumPy's on `float32`, operation by operation.

use crate::raster::{check, check_same};
use crate::simd::{Level, Pass};

/// What makes depth of a rectified pair's disparity: `f * B / (d + doffs)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Distance between the cameras' centres, metres.
    pub baseline_metres: f64,
    /// How much farther right the right camera's principal point lies, pixels; 0 of most pairs.
    pub doffs_px: f64,
}

impl Geometry {
    /// Focal length times baseline as `float32`, the way NumPy rounds `np.float32(focal * baseline)`.
    pub(crate) fn metre_pixels(self) -> f32 {
        (self.focal_px * self.baseline_metres) as f32
    }

    /// The largest whole number of 1/16 px, from 0 on, that is not a disparity of a point in front of the cameras.
    pub(crate) fn least_sixteenths(self) -> i16 {
        (-16.0 * f64::from(self.doffs_px as f32)).floor().max(0.0) as i16
    }
}

/// The smaller of a depth and the cap; invalid pixels stay invalid.
#[inline(always)]
fn capped(depth: f32, cap: f32) -> f32 {
    if depth > cap { cap } else { depth }
}

/// `f * B / (d + doffs)` of OpenCV's fixed-point disparity (1/16 px), capped at `cap_metres`; NaN where `d` or
/// `d + doffs` is not above 0.
///
/// `cap_metres` of `f32::INFINITY` caps nothing.
pub fn depth_from_disparity(disparity: &[i16], pair: Geometry, cap_metres: f32, out: &mut [f32]) {
    depth_from_disparity_at(Level::best(), disparity, pair, cap_metres, out);
}

pub(crate) fn depth_from_disparity_at(
    level: Level,
    disparity: &[i16],
    pair: Geometry,
    cap_metres: f32,
    out: &mut [f32],
) {
    check_same("depth", out.len(), disparity.len());
    let (metre_pixels, doffs_px, least) = (pair.metre_pixels(), pair.doffs_px as f32, pair.least_sixteenths());
    level.run(FromDisparity { disparity, metre_pixels, doffs_px, least, cap_metres, out });
}

struct FromDisparity<'a> {
    disparity: &'a [i16],
    metre_pixels: f32,
    doffs_px: f32,
    /// Disparities up to here are invalid, 1/16 px.
    least: i16,
    cap_metres: f32,
    out: &'a mut [f32],
}

impl Pass for FromDisparity<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (depth, &fixed) in self.out.iter_mut().zip(self.disparity) {
            let metres = capped(self.metre_pixels / (f32::from(fixed) / 16.0 + self.doffs_px), self.cap_metres);
            *depth = if fixed > self.least { metres } else { f32::NAN };
        }
    }
}

/// Depth from a network's disparity given as a share of the image's width:
/// `min(f * B / max(share * width + doffs, floor_px), cap_metres)`.
pub fn depth_from_share(share: &[f32], width: usize, pair: Geometry, floor_px: f32, cap_metres: f32, out: &mut [f32]) {
    check_same("depth", out.len(), share.len());
    let (width, metre_pixels, doffs_px) = (width as f32, pair.metre_pixels(), pair.doffs_px as f32);
    Level::best().run(FromShare { share, width, metre_pixels, doffs_px, floor_px, cap_metres, out });
}

struct FromShare<'a> {
    share: &'a [f32],
    width: f32,
    metre_pixels: f32,
    doffs_px: f32,
    floor_px: f32,
    cap_metres: f32,
    out: &'a mut [f32],
}

impl Pass for FromShare<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (depth, &share) in self.out.iter_mut().zip(self.share) {
            let disparity = share * self.width + self.doffs_px;
            let disparity = if disparity < self.floor_px { self.floor_px } else { disparity };
            *depth = capped(self.metre_pixels / disparity, self.cap_metres);
        }
    }
}

/// Ground-truth depth from ground-truth disparities, pixels: `f * B / (d + doffs)`; NaN where that sum is NaN or not
/// above 0.
pub fn truth_from_disparity(px: &[f32], pair: Geometry, out: &mut [f32]) {
    check_same("depth", out.len(), px.len());
    let (metre_pixels, doffs_px) = (pair.metre_pixels(), pair.doffs_px as f32);
    for (depth, &px) in out.iter_mut().zip(px) {
        let px = px + doffs_px;
        *depth = if px > 0.0 { metre_pixels / px } else { f32::NAN };
    }
}

/// Ground-truth depth from a KITTI depth PNG (16 bit, 1/256 m); NaN where the value is 0.
pub fn truth_from_depth_png(raw: &[u16], out: &mut [f32]) {
    check_same("depth", out.len(), raw.len());
    for (depth, &raw) in out.iter_mut().zip(raw) {
        *depth = if raw > 0 { f32::from(raw) / 256.0 } else { f32::NAN };
    }
}

/// A level road seen by a level camera: the simplest still-mono estimate there is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Height of the camera above the road, metres.
    pub camera_height_metres: f64,
    /// The row of the horizon as a share of the image's rows.
    pub horizon_share: f64,
    /// Nearest depth given, metres.
    pub nearest_metres: f32,
    /// Farthest depth given (also at and above the horizon), metres.
    pub farthest_metres: f32,
}

impl GroundPlane {
    /// Depth of every pixel: `clip(f * height / max(row - horizon, 1e-6), nearest, farthest)`.
    pub fn depth(&self, width: usize, height: usize, out: &mut [f32]) {
        check("depth", out.len(), width, height, 1);
        if out.is_empty() {
            return;
        }
        let horizon = (self.horizon_share * height as f64) as f32;
        let scale = (self.focal_px * self.camera_height_metres) as f32;
        for (y, row) in out.chunks_exact_mut(width).enumerate() {
            let below = (y as f32 - horizon).max(1e-6);
            row.fill((scale / below).max(self.nearest_metres).min(self.farthest_metres));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;

    const NAN: u32 = f32::NAN.to_bits();
    const KITTI: Geometry = Geometry { focal_px: 721.5377, baseline_metres: 0.532725, doffs_px: 0.0 };

    fn bits(depth: &[f32]) -> Vec<u32> {
        depth.iter().map(|depth| depth.to_bits()).collect()
    }

    #[test]
    fn disparity_becomes_numpys_depth_with_cap_and_gaps() {
        // np.minimum(np.float32(721.5377 * 0.532725) / (d.astype(np.float32) / 16.0), np.float32(80))
        let disparity = [-16, 0, 1, 76, 77, 100, 1023, 333];
        let expected = [NAN, NAN, 0x42a0_0000, 0x42a0_0000, 0x429f_be2a, 0x4276_0103, 0x40c0_60e2, 0x4193_c008];
        let depth = every_level(|level| {
            let mut depth = [0.0; 8];
            depth_from_disparity_at(level, &disparity, KITTI, 80.0, &mut depth);
            bits(&depth)
        });
        assert_eq!(depth, expected);
    }

    #[test]
    fn principal_points_apart_move_every_disparity() {
        // f B = 100 px m.
        let geometry = |doffs_px| Geometry { focal_px: 200.0, baseline_metres: 0.5, doffs_px };
        let disparity = |doffs_px, fixed: [i16; 4]| {
            every_level(|level| {
                let mut depth = [0.0; 4];
                depth_from_disparity_at(level, &fixed, geometry(doffs_px), 80.0, &mut depth);
                bits(&depth)
            })
        };
        // 1, 40, 0 and -1 px, 10 px apart one way: 11 and 50 px; the other way: 30 px, and 9 px too little.
        let fixed = [16, 640, 0, -16];
        assert_eq!(disparity(10.0, fixed), [(100.0_f32 / 11.0).to_bits(), 2f32.to_bits(), NAN, NAN]);
        assert_eq!(disparity(-10.0, [16, 640, 160, 161]), [NAN, (100.0_f32 / 30.0).to_bits(), NAN, 80f32.to_bits()]);
        let mut depth = [0.0; 4];
        truth_from_disparity(&[10.0, f32::NAN, -15.0, 0.0], geometry(15.0), &mut depth);
        assert_eq!(bits(&depth), [4f32.to_bits(), NAN, NAN, (100.0_f32 / 15.0).to_bits()]);
        depth_from_share(&[0.1, 0.5, 0.0, 1.0], 50, geometry(-5.0), 2.0, 80.0, &mut depth);
        assert_eq!(depth, [50.0, 5.0, 50.0, 100.0 / 45.0]);
    }

    #[test]
    fn an_infinite_cap_caps_nothing() {
        let mut depth = [0.0];
        depth_from_disparity(&[1], KITTI, f32::INFINITY, &mut depth);
        assert_eq!(depth[0].to_bits(), 0x45c0_30ca);
    }

    #[test]
    fn ground_truth_is_read_at_the_scales_of_the_data_sets() {
        let mut depth = [0.0; 3];
        truth_from_disparity(&[f32::NAN, 1.0, 5000.0 / 256.0], KITTI, &mut depth);
        assert_eq!(bits(&depth), [NAN, 0x43c0_30ca, 0x419d_7149]);
        truth_from_depth_png(&[0, 256, 5000], &mut depth);
        assert_eq!(bits(&depth), [NAN, 1f32.to_bits(), 19.53125f32.to_bits()]);
    }

    #[test]
    fn a_share_of_the_width_becomes_depth_with_floor_and_cap() {
        let mut depth = [0.0; 3];
        depth_from_share(&[0.0, 0.05, 0.01], 1242, KITTI, 1e-3, 80.0, &mut depth);
        assert_eq!(bits(&depth), [0x42a0_0000, 0x40c6_1220, 0x41f7_96a9]);
    }

    #[test]
    fn the_road_is_farthest_above_the_horizon_and_near_at_the_bottom() {
        let plane = GroundPlane {
            focal_px: 721.5377,
            camera_height_metres: 1.65,
            horizon_share: 0.461,
            nearest_metres: 1.0,
            farthest_metres: 80.0,
        };
        let mut depth = vec![0.0; 2 * 375];
        plane.depth(2, 375, &mut depth);
        assert_eq!(bits(&depth[..2]), [80f32.to_bits(); 2]);
        assert_eq!(depth[2 * 374 + 1].to_bits(), 0x40bd_6ba4);
    }
}
