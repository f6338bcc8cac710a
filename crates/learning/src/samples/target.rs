//! Targets: confident disparities at the network's size.

use depthloom_graphs::values::{Disparity, Mask};
use depthloom_kernels::resize::shrink_f32;
use half::f16;

/// Which pixels are targets, and how much of a cell they must cover.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    /// Disparities above this are targets, px.
    pub(super) least_disparity_px: f64,
    /// Cells covered by less than this share are left out.
    pub(super) coverage: f64,
}

/// Maps of the image's size, kept between frames.
#[derive(Default)]
pub(super) struct Maps {
    disparity_px: Vec<f32>,
    valid: Vec<f32>,
}

impl Maps {
    /// The mean disparity over each cell as a share of the image's width; NaN where too little of the cell is known.
    ///
    /// Without a mask, all pixels are confident. Disparity and mask are of one size, no smaller than `columns x rows`.
    pub(super) fn target(
        &mut self,
        disparity: &Disparity,
        mask: Option<&Mask>,
        rule: Rule,
        columns: usize,
        rows: usize,
    ) -> Vec<f16> {
        let (width, height) = disparity.sixteenths_px.dimensions();
        let (width, height) = (width as usize, height as usize);
        self.disparity_px.clear();
        self.valid.clear();
        for (pixel, &sixteenths) in disparity.sixteenths_px.iter().enumerate() {
            let px = f32::from(sixteenths) / 16.0;
            let is_set = mask.is_none_or(|mask| mask.set.as_raw()[pixel] != 0);
            let valid = is_set && f64::from(px) > rule.least_disparity_px;
            self.disparity_px.push(if valid { px } else { 0.0 });
            self.valid.push(if valid { 1.0 } else { 0.0 });
        }
        let (mut sum, mut covered) = (vec![0.0; columns * rows], vec![0.0; columns * rows]);
        shrink_f32(&self.disparity_px, width, height, columns, rows, &mut sum);
        shrink_f32(&self.valid, width, height, columns, rows, &mut covered);
        let share = |(sum, covered): (f32, f32)| {
            let covered = f64::from(covered);
            // Nothing at all is too little, whatever the parameter.
            if covered < rule.coverage || covered <= 0.0 {
                return f16::NAN;
            }
            f16::from_f64(f64::from(sum) / covered / width as f64)
        };
        sum.into_iter().zip(covered).map(share).collect()
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::values::{Disparity, Mask, Raster};
    use proptest::prelude::*;

    use super::{Maps, Rule};

    const RULE: Rule = Rule { least_disparity_px: 0.5, coverage: 0.2 };

    fn target(width: u32, pixels: &[(i16, bool)], columns: usize, rows: usize, rule: Rule) -> Vec<f32> {
        let height = pixels.len() as u32 / width;
        let sixteenths = pixels.iter().map(|pixel| pixel.0).collect();
        let set = pixels.iter().map(|pixel| if pixel.1 { 255 } else { 0 }).collect();
        let disparity =
            Disparity { sixteenths_px: Raster::from_raw(width, height, sixteenths).unwrap(), min_disparity_px: 0 };
        let mask = Mask { set: Raster::from_raw(width, height, set).unwrap() };
        Maps::default().target(&disparity, Some(&mask), rule, columns, rows).into_iter().map(f32::from).collect()
    }

    #[test]
    fn a_cell_is_the_mean_of_its_confident_disparities() {
        let pixels = [(160, true), (320, true), (640, false), (-16, true), (8, true), (9, true)];
        let found = target(6, &pixels, 2, 1, RULE);
        assert_eq!(found[0], 15.0 / 6.0);
        // Half a pixel is not above half a pixel.
        assert!((found[1] - 9.0 / 16.0 / 6.0).abs() < 1e-4, "{found:?}");
    }

    #[test]
    fn a_cell_covered_too_little_has_no_target() {
        let mut pixels = [(0, true); 20];
        (pixels[0], pixels[10], pixels[11]) = ((16, true), (16, true), (16, true));
        let found = target(20, &pixels, 2, 1, RULE);
        assert!(found[0].is_nan() && (found[1] - 0.05).abs() < 1e-4, "{found:?}");
        let nothing = target(2, &[(-16, true), (16, false)], 1, 1, Rule { coverage: 0.0, ..RULE });
        assert!(nothing[0].is_nan());
    }

    /// The definition in f64: the overlap of every pixel with the cell.
    fn naive(width: usize, pixels: &[(i16, bool)], columns: usize, rows: usize, x: usize, y: usize) -> (f64, f64) {
        let height = pixels.len() / width;
        let overlap = |pixel: usize, cell: usize, side: usize, cells: usize| {
            let size = side as f64 / cells as f64;
            let (from, to) = (cell as f64 * size, (cell + 1) as f64 * size);
            (to.min((pixel + 1) as f64) - from.max(pixel as f64)).max(0.0) / size
        };
        let (mut sum, mut covered) = (0.0, 0.0);
        for (at, &(sixteenths, set)) in pixels.iter().enumerate() {
            let area = overlap(at % width, x, width, columns) * overlap(at / width, y, height, rows);
            if set && sixteenths > 8 {
                sum += area * f64::from(sixteenths) / 16.0;
                covered += area;
            }
        }
        (sum / covered / width as f64, covered)
    }

    proptest! {
        #[test]
        fn targets_follow_their_definition(
            (width, pixels) in (4usize..30, 3usize..12).prop_flat_map(|(width, height)| {
                let pixel = (prop_oneof![1 => -16i16..8, 4 => 9i16..1024], any::<bool>());
                (Just(width), proptest::collection::vec(pixel, width * height))
            }),
            columns in 1usize..5,
            rows in 1usize..4,
        ) {
            let found = target(width as u32, &pixels, columns, rows, RULE);
            for (at, &found) in found.iter().enumerate() {
                let (share, covered) = naive(width, &pixels, columns, rows, at % columns, at / columns);
                // Slivers of a pixel are left out, as in OpenCV: close to the limit either is right.
                if (covered - RULE.coverage).abs() < 5e-3 {
                    continue;
                }
                prop_assert_eq!(found.is_nan(), covered < RULE.coverage);
                let (found, tolerance) = (f64::from(found), 0.02 * share + 1e-6);
                prop_assert!(found.is_nan() || (found - share).abs() < tolerance, "{found} is not {share}");
            }
        }
    }
}
