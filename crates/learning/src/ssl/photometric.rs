//! The left-right photometric loss: the right view, moved by the predicted disparity, should look like the left one.
//!
//! Godard, Mac Aodha, Brostow 2017, equation 2: `0.85 (1 - SSIM) / 2 + 0.15 |l - w|` with SSIM over 3x3 blocks, mean
//! over samples and colours. `w` is the right view sampled at `x - d` (bilinear along the row, the edge's sample beyond
//! it).

use super::batch::Batch;
use crate::networks::{Meaning, Size};

/// Share of the structural part.
const STRUCTURE: f32 = 0.85;
/// SSIM's constants for values in [0, 1]: (0.01)^2 and (0.03)^2.
const C1: f32 = 1e-4;
const C2: f32 = 9e-4;

pub(super) struct Photometric {
    pub(crate) meaning: Meaning,
    pub(crate) map: Size,
    pub(crate) image: Size,
}

impl Photometric {
    /// The mean loss of the batch; `weight` times each image's gradient by the map is added to `slopes`.
    pub(super) fn add(&self, map: &[f32], batch: &Batch, weight: f32, slopes: &mut [f32]) -> f64 {
        let (area, cells) = (self.image.width * self.image.height, self.map.width * self.map.height);
        let mut total = 0.0;
        for i in 0..batch.count {
            let left = &batch.images[i * 3 * area..][..3 * area];
            let right = &batch.rights[i * 3 * area..][..3 * area];
            let (map, slopes) = (&map[i * cells..][..cells], &mut slopes[i * cells..][..cells]);
            let k = batch.depth_scales[i];
            // In a mirrored sample, the right view is on the other side.
            let side = if batch.mirrored[i] { 1.0 } else { -1.0 };
            let (disparity, by_map) = self.disparities(map, k);
            let mut by_disparity = vec![0.0; area];
            for (left, right) in left.chunks_exact(area).zip(right.chunks_exact(area)) {
                total += f64::from(self.colour(left, right, &disparity, side, &mut by_disparity));
            }
            for (pixel, slope) in by_disparity.iter().enumerate() {
                let cell = self.cell(pixel);
                slopes[cell] += weight / 3.0 * slope * by_map[cell];
            }
        }
        total / (3 * batch.count) as f64
    }

    /// The map's cell that shows a pixel.
    fn cell(&self, pixel: usize) -> usize {
        let (row, column) = (pixel / self.image.width, pixel % self.image.width);
        row * self.map.height / self.image.height * self.map.width + column * self.map.width / self.image.width
    }

    /// Disparity of every pixel, px of the network's image, and its derivative by the map's sample, cell by cell.
    fn disparities(&self, map: &[f32], k: f32) -> (Vec<f32>, Vec<f32>) {
        let width = self.image.width as f32;
        let of_cell = |&sample: &f32| match self.meaning {
            Meaning::DisparityShare { scale } => (sample * scale * width, scale * width),
            Meaning::Depth { farthest_m } => {
                let depth = (sample * farthest_m).max(1e-3);
                (k / depth * width, -k / (depth * depth) * farthest_m * width)
            }
        };
        let (by_cell, slopes): (Vec<f32>, Vec<f32>) = map.iter().map(of_cell).unzip();
        ((0..self.image.width * self.image.height).map(|pixel| by_cell[self.cell(pixel)]).collect(), slopes)
    }

    /// The loss of one colour; its gradient by the disparity is added.
    fn colour(&self, left: &[f32], right: &[f32], disparity: &[f32], side: f32, slopes: &mut [f32]) -> f32 {
        let (width, height) = (self.image.width, self.image.height);
        let (mut moved, mut by_disparity) = (vec![0.0; left.len()], vec![0.0; left.len()]);
        for (pixel, (moved, by_disparity)) in moved.iter_mut().zip(&mut by_disparity).enumerate() {
            let (row, x) = (pixel / width * width, (pixel % width) as f32 + side * disparity[pixel]);
            let inside = x.clamp(0.0, (width - 1) as f32);
            let at = (inside as usize).min(width.saturating_sub(2));
            let (a, b) = (right[row + at], right[row + (at + 1).min(width - 1)]);
            *moved = a + (b - a) * (inside - at as f32);
            // Beyond the edge the sample stays the same.
            *by_disparity = if inside == x { side * (b - a) } else { 0.0 };
        }
        let mut by_moved = vec![0.0; left.len()];
        let mut loss = 0.0;
        let each = (1.0 - STRUCTURE) / left.len() as f32;
        for ((slope, &l), &w) in by_moved.iter_mut().zip(left).zip(&moved) {
            loss += each * (w - l).abs();
            *slope += if w == l { 0.0 } else { each * (w - l).signum() };
        }
        if width >= 3 && height >= 3 {
            let blocks = ((width - 2) * (height - 2)) as f32;
            for (row, column) in (0..height - 2).flat_map(|row| (0..width - 2).map(move |column| (row, column))) {
                let at = row * width + column;
                loss += block(left, &moved, at, width, STRUCTURE / blocks, &mut by_moved);
            }
        }
        for ((slope, by_moved), by_disparity) in slopes.iter_mut().zip(&by_moved).zip(&by_disparity) {
            *slope += by_moved * by_disparity;
        }
        loss
    }
}

/// `weight (1 - SSIM) / 2` of the 3x3 samples from `at` on, and its gradient by those of `y`.
fn block(x: &[f32], y: &[f32], at: usize, width: usize, weight: f32, slopes: &mut [f32]) -> f32 {
    const COUNT: f32 = 9.0;
    let places = |i: usize| at + i / 3 * width + i % 3;
    let mean = |f: &dyn Fn(usize) -> f32| (0..9).map(|i| f(places(i))).sum::<f32>() / COUNT;
    let (mx, my) = (mean(&|p| x[p]), mean(&|p| y[p]));
    let vx = mean(&|p| (x[p] - mx) * (x[p] - mx));
    let vy = mean(&|p| (y[p] - my) * (y[p] - my));
    let cov = mean(&|p| (x[p] - mx) * (y[p] - my));
    let (a, b) = (2.0 * mx * my + C1, 2.0 * cov + C2);
    let (c, d) = (mx * mx + my * my + C1, vx + vy + C2);
    let ssim = a * b / (c * d);
    // 1 - SSIM is within [0, 2]; the original clamps it to [0, 1] after halving, which it never exceeds.
    for i in 0..9 {
        let p = places(i);
        let (by_my, by_vy, by_cov) = (1.0 / COUNT, 2.0 / COUNT * (y[p] - my), (x[p] - mx) / COUNT);
        let numerator = 2.0 * mx * by_my * b + a * 2.0 * by_cov;
        let denominator = 2.0 * my * by_my * d + c * by_vy;
        slopes[p] -= weight / 2.0 * (numerator - ssim * denominator) / (c * d);
    }
    weight * (1.0 - ssim) / 2.0
}

#[cfg(test)]
mod tests {
    use super::Photometric;
    use crate::networks::{Meaning, Size};
    use crate::ssl::batch::Batch;
    use depthloom_random::SplitMix64;

    const SIZE: Size = Size { width: 24, height: 5 };

    /// A smooth texture and the same moved by `shift` px.
    fn pair(shift: f32, mirrored: bool) -> Batch {
        let value = |x: f32, row: usize, colour: usize| {
            0.5 + 0.2 * (x * 0.9 + row as f32).sin() + 0.1 * (x * 0.31 + colour as f32).cos()
        };
        let image = |moved: f32| {
            let mut image = Vec::new();
            for (colour, row) in (0..3).flat_map(|colour| (0..SIZE.height).map(move |row| (colour, row))) {
                image.extend((0..SIZE.width).map(|x| value(x as f32 + moved, row, colour)));
            }
            image
        };
        let side = if mirrored { -1.0 } else { 1.0 };
        Batch {
            count: 1,
            images: image(0.0),
            rights: image(side * shift),
            shares: vec![f32::NAN; 120],
            depth_scales: vec![0.5],
            mirrored: vec![mirrored],
        }
    }

    fn loss(meaning: Meaning) -> Photometric {
        Photometric { meaning, map: SIZE, image: SIZE }
    }

    #[test]
    fn the_correct_disparity_has_the_lowest_loss() {
        // Not nothing: beyond the edge the right view has no samples.
        for mirrored in [false, true] {
            let batch = pair(1.5, mirrored);
            let at = |px: f32| {
                let map = vec![px / 2.4; 120];
                loss(Meaning::DisparityShare { scale: 0.1 }).add(&map, &batch, 1.0, &mut [0.0; 120])
            };
            let costs: Vec<f64> = [0.0, 0.7, 1.5, 2.2].map(at).into();
            assert!(costs[2] < 0.03 && costs[1] > costs[2] && costs[0] > costs[1] && costs[3] > costs[2], "{costs:?}");
        }
    }

    #[test]
    fn the_slope_is_the_derivative() {
        let mut random = SplitMix64::new(4);
        for meaning in [Meaning::DisparityShare { scale: 0.1 }, Meaning::Depth { farthest_m: 10.0 }] {
            let batch = pair(1.3, false);
            let map: Vec<f32> = (0..120).map(|_| 0.35 + 0.2 * random.unit()).collect();
            let mut slopes = vec![0.0; 120];
            loss(meaning).add(&map, &batch, 1.0, &mut slopes);
            let (mut close, step) = (0, 2e-3);
            for pixel in 0..120 {
                let at = |change: f32| {
                    let mut map = map.clone();
                    map[pixel] += change;
                    loss(meaning).add(&map, &batch, 1.0, &mut [0.0; 120])
                };
                let expected = ((at(step) - at(-step)) / f64::from(2.0 * step)) as f32;
                close += usize::from((slopes[pixel] - expected).abs() < 0.05 * expected.abs() + 2e-4);
            }
            // Where a step crosses a sample's place or a zero of |l - w| the two may differ.
            assert!(close >= 105, "{meaning:?}: {close} of 120");
        }
    }
}
