//! Filling a depth map from its valid pixels, guided by the image: the guided filter with a mask.
//!
//! He, Sun, Tang, *Guided Image Filtering* (2010): in every window, inverse depth is a linear function of grey, `q = a
//! I + b`, by ridge regression over the pixels of the window; a pixel takes the mean of the functions of all windows
//! that contain it. Here the regression uses the valid pixels only, and windows without any have no function. On a map
//! without gaps this is the guided filter of the paper. Inverse depth, because it is linear on planes.

use crate::raster::{check, check_same};

/// The windows and their regression.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Half the side of a window, px, at least 1: windows are `2 radius + 1` wide, and end at the border.
    pub radius: usize,
    /// What is added to the variance of grey, which is in [0, 1].
    pub epsilon: f64,
    /// Whether valid pixels are filtered as well; otherwise they stay as they are.
    pub smooth: bool,
}

/// Fills the invalid (not finite, or not above 0) pixels of a depth map, metres, by the grey image `guide`.
///
/// Where no window with a valid pixel contains a pixel, the radius doubles until one does. Results stay between the
/// smallest and largest valid depth. A map without valid pixels becomes NaN.
///
/// # Panics
/// If the maps differ in size, or the radius is 0.
pub fn upsample(guide: &[u8], depth: &[f32], width: usize, height: usize, params: &Params, out: &mut [f32]) {
    check("guide", guide.len(), width, height, 1);
    check_same("depth", depth.len(), guide.len());
    check_same("filled depth", out.len(), guide.len());
    assert!(params.radius > 0, "a window has a radius of 1 or more");
    let valid = || depth.iter().copied().filter(|metres| is_valid(*metres));
    let (nearest, farthest) = (valid().fold(f32::INFINITY, f32::min), valid().fold(0.0, f32::max));
    for (out, &metres) in out.iter_mut().zip(depth) {
        *out = if is_valid(metres) && !params.smooth { metres } else { f32::NAN };
    }
    let mut sums = Sums { width, height, row: vec![0.0; width + 1], column: vec![0.0; width] };
    let grey: Vec<f64> = guide.iter().map(|grey| f64::from(*grey)).collect();
    let mut radius = params.radius;
    while farthest > 0.0 && out.iter().any(|metres| metres.is_nan()) {
        let filled = filtered(&mut sums, &grey, depth, radius, params.epsilon);
        for (out, inverse) in out.iter_mut().zip(filled).filter(|(out, inverse)| out.is_nan() && !inverse.is_nan()) {
            // At infinity or beyond it: the farthest.
            let metres = if inverse > 0.0 { (1.0 / inverse) as f32 } else { farthest };
            *out = metres.clamp(nearest, farthest);
        }
        radius *= 2;
    }
}

fn is_valid(metres: f32) -> bool {
    metres.is_finite() && metres > 0.0
}

/// Inverse depths, 1/m, NaN where no window with a valid pixel contains the pixel.
fn filtered(sums: &mut Sums, grey: &[f64], depth: &[f32], radius: usize, epsilon: f64) -> Vec<f64> {
    let of_valid = |of: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..depth.len()).map(|at| if is_valid(depth[at]) { of(at) } else { 0.0 }).collect()
    };
    let mut in_windows = |of: &dyn Fn(usize) -> f64| {
        let mut map = of_valid(of);
        sums.over_windows(&mut map, radius);
        map
    };
    let inverse = |at: usize| 1.0 / f64::from(depth[at]);
    // Sums of whole numbers are exact.
    let count = in_windows(&|_| 1.0);
    let (grey_sum, grey_squared) = (in_windows(&|at| grey[at]), in_windows(&|at| grey[at] * grey[at]));
    let (sum, product) = (in_windows(&inverse), in_windows(&|at| grey[at] * inverse(at)));
    let (mut slope, mut offset, mut windows) = (vec![0.0; depth.len()], vec![0.0; depth.len()], vec![0.0; depth.len()]);
    for at in 0..depth.len() {
        let n = count[at];
        if n > 0.0 {
            let (mean_grey, mean) = (grey_sum[at] / n, sum[at] / n);
            let variance = (grey_squared[at] / n - mean_grey * mean_grey).max(0.0);
            slope[at] = (product[at] / n - mean_grey * mean) / (variance + epsilon * 255.0 * 255.0);
            offset[at] = mean - slope[at] * mean_grey;
            windows[at] = 1.0;
        }
    }
    for map in [&mut slope, &mut offset, &mut windows] {
        sums.over_windows(map, radius);
    }
    (0..depth.len()).map(|at| (slope[at] * grey[at] + offset[at]) / windows[at]).collect()
}

/// Sums over square windows that end at the border.
struct Sums {
    width: usize,
    height: usize,
    /// Sums of a row up to each pixel.
    row: Vec<f64>,
    /// Sums of the rows of a window.
    column: Vec<f64>,
}

impl Sums {
    /// Replaces each pixel by the sum over the window around it.
    fn over_windows(&mut self, map: &mut [f64], radius: usize) {
        let Self { width, height, row, column } = self;
        let (width, height) = (*width, *height);
        for pixels in map.chunks_exact_mut(width) {
            for (x, pixel) in pixels.iter().enumerate() {
                row[x + 1] = row[x] + pixel;
            }
            for (x, pixel) in pixels.iter_mut().enumerate() {
                *pixel = row[(x + radius + 1).min(width)] - row[x.saturating_sub(radius)];
            }
        }
        let rows = map.to_vec();
        let row_at = |y: usize| &rows[y * width..(y + 1) * width];
        column.fill(0.0);
        for y in 0..radius.min(height) {
            column.iter_mut().zip(row_at(y)).for_each(|(sum, pixel)| *sum += pixel);
        }
        for (y, pixels) in map.chunks_exact_mut(width).enumerate() {
            if y + radius < height {
                column.iter_mut().zip(row_at(y + radius)).for_each(|(sum, pixel)| *sum += pixel);
            }
            if y > radius {
                column.iter_mut().zip(row_at(y - radius - 1)).for_each(|(sum, pixel)| *sum -= pixel);
            }
            pixels.copy_from_slice(column);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMS: Params = Params { radius: 2, epsilon: 1e-3, smooth: false };

    #[test]
    fn sums_end_at_the_border() {
        let mut sums = Sums { width: 3, height: 4, row: vec![0.0; 4], column: vec![0.0; 3] };
        let mut map: Vec<f64> = (0..12).map(f64::from).collect();
        sums.over_windows(&mut map, 1);
        assert_eq!(map, [8.0, 15.0, 12.0, 21.0, 36.0, 27.0, 39.0, 63.0, 45.0, 32.0, 51.0, 36.0]);
    }

    #[test]
    fn gaps_take_the_depth_of_their_grey_level() {
        // Two surfaces, bright at 5 m and dark at 20 m; every second pixel is invalid, as on a chessboard.
        let guide: Vec<u8> = (0..96).map(|at| if at % 12 < 6 { 220 } else { 30 }).collect();
        let has_depth = |at: usize| (at + at / 12).is_multiple_of(2);
        let exact: Vec<f32> = guide.iter().map(|&grey| if grey > 100 { 5.0 } else { 20.0 }).collect();
        let depth: Vec<f32> =
            exact.iter().enumerate().map(|(at, &m)| if has_depth(at) { m } else { f32::NAN }).collect();
        let mut out = vec![0.0; 96];
        upsample(&guide, &depth, 12, 8, &PARAMS, &mut out);
        for (at, (ours, exact)) in out.iter().zip(&exact).enumerate() {
            assert!((ours - exact).abs() < 0.05 * exact, "{at}: {ours}, not {exact}");
            assert!(!has_depth(at) || ours == exact, "valid pixels are unchanged");
        }
    }

    #[test]
    fn far_gaps_are_filled_and_maps_without_valid_pixels_are_not() {
        let mut depth = vec![f32::NAN; 300];
        let mut out = vec![0.0; 300];
        upsample(&[90; 300], &depth, 30, 10, &PARAMS, &mut out);
        assert!(out.iter().all(|metres| metres.is_nan()));
        (depth[0], depth[1]) = (4.0, 0.0);
        upsample(&[90; 300], &depth, 30, 10, &PARAMS, &mut out);
        assert!(out.iter().all(|metres| *metres == 4.0));
    }
}
