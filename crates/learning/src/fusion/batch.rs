//! The windows of a training step: what the network sees, and what is right there.

use depthloom_kernels::learned::{Cell, PLANES, ln};
use depthloom_random::SplitMix64;
use rayon::prelude::*;

use super::blocks;
use super::loss::Seen;
use super::params::FusionParams;
use crate::compute::Input;
use crate::networks::Size;
use crate::samples::{SampleView, SamplesView};

/// Columns and rows of the grid that distorts the monocular estimate.
const GRID: (usize, usize) = (5, 3);

/// A part of a sample.
struct Window {
    size: Size,
    /// Column and row of its first pixel in the sample.
    at: (usize, usize),
    mirrored: bool,
}

/// The windows of step `step`: a function of seed and step alone.
pub(super) fn augmented(params: &FusionParams, samples: &SamplesView<'_>, step: u64) -> (Input, Vec<Seen>) {
    let full = Size { width: samples.width(), height: samples.height() };
    let size = window(params, full);
    let windows = (0..u64::from(params.batch)).into_par_iter().map(|index| {
        let mut random = SplitMix64::part(params.seed ^ 0x6675_7369_6f6e, step * u64::from(params.batch) + index);
        let sample = &samples.items[random.below(samples.len())];
        let at = (random.below(full.width - size.width + 1), random.below(full.height - size.height + 1));
        let (mirror, brightness) = (random.unit(), 1.0 + random.sign_unit() * params.brightness as f32);
        let window = Window { size, at, mirrored: params.flip && mirror < 0.5 };
        let mut cells = window.cells(sample, full);
        distort(params.distortion as f32, size, &mut random, &mut cells);
        blocks::apply(params, size, &mut random, &mut cells);
        window.seen(sample, full, brightness, params.shown as f32, &cells)
    });
    joined(windows.collect(), size)
}

/// Whole samples, in which blocks are hidden that depend on the sample's index only.
pub(super) fn hidden(
    params: &FusionParams,
    samples: &SamplesView<'_>,
    indices: std::ops::Range<usize>,
) -> (Input, Vec<Seen>) {
    let size = Size { width: samples.width(), height: samples.height() };
    let windows = indices.into_par_iter().map(|index| {
        let (sample, window) = (&samples.items[index], Window { size, at: (0, 0), mirrored: false });
        let mut cells = window.cells(sample, size);
        blocks::apply(params, size, &mut SplitMix64::part(0x6869_6464_656e, index as u64), &mut cells);
        window.seen(sample, size, 1.0, params.shown as f32, &cells)
    });
    joined(windows.collect(), size)
}

fn joined(windows: Vec<(Vec<f32>, Vec<Seen>)>, size: Size) -> (Input, Vec<Seen>) {
    let shape = [windows.len(), PLANES, size.height, size.width];
    let (mut values, mut seen) = (Vec::new(), Vec::new());
    for (planes, pixels) in windows {
        values.extend(planes);
        seen.extend(pixels);
    }
    (Input { values, shape }, seen)
}

/// The size of the windows of samples of size `full`.
pub(super) fn window(params: &FusionParams, full: Size) -> Size {
    params.window.map_or(full, |[width, height]| Size { width: width as usize, height: height as usize })
}

impl Window {
    /// The sample's pixel of every pixel of the window, in order.
    fn pixels(&self, full: Size) -> impl Iterator<Item = usize> {
        let (Size { width, height }, (left, top), mirrored) = (self.size, self.at, self.mirrored);
        (0..height).flat_map(move |row| {
            (0..width).map(move |column| {
                let column = if mirrored { width - 1 - column } else { column };
                (top + row) * full.width + left + column
            })
        })
    }

    fn cells(&self, sample: &SampleView<'_>, full: Size) -> Vec<Cell> {
        self.pixels(full).map(|pixel| sample.cell(pixel)).collect()
    }

    /// The network's planes, and what is right.
    fn seen(
        &self,
        sample: &SampleView<'_>,
        full: Size,
        brightness: f32,
        shown: f32,
        cells: &[Cell],
    ) -> (Vec<f32>, Vec<Seen>) {
        let area = cells.len();
        let mut planes = vec![0.0; PLANES * area];
        let mut seen = Vec::with_capacity(area);
        for (at, (pixel, cell)) in self.pixels(full).zip(cells).enumerate() {
            for channel in 0..3 {
                let value = f32::from(sample.image[channel * full.width * full.height + pixel]) / 255.0;
                planes[channel * area + at] = (value * brightness).min(1.0);
            }
            for (plane, value) in cell.planes().into_iter().enumerate() {
                planes[(3 + plane) * area + at] = value;
            }
            seen.push(Seen::new(cell, sample.share(pixel).to_f32(), shown));
        }
        (planes, seen)
    }
}

/// Distorts the monocular estimate: by a random number at the points of a grid, bilinear between them, in log depth.
fn distort(most: f32, size: Size, random: &mut SplitMix64, cells: &mut [Cell]) {
    let overall = random.sign_unit();
    let grid: Vec<f32> = (0..GRID.0 * GRID.1).map(|_| most * (overall + random.sign_unit())).collect();
    let place = |at: usize, side: usize, points: usize| {
        let at = at as f32 / (side - 1).max(1) as f32 * (points - 1) as f32;
        let first = (at as usize).min(points - 2);
        (first, at - first as f32)
    };
    for (pixel, cell) in cells.iter_mut().enumerate() {
        let (column, right) = place(pixel % size.width, size.width, GRID.0);
        let (row, down) = place(pixel / size.width, size.height, GRID.1);
        let along = |row: usize| {
            let (a, b) = (grid[row * GRID.0 + column], grid[row * GRID.0 + column + 1]);
            a + (b - a) * right
        };
        let (above, below) = (along(row), along(row + 1));
        cell.mono *= libm::expf(above + (below - above) * down);
    }
}

impl Seen {
    /// `target` is a share of the width, NaN without one.
    fn new(cell: &Cell, target: f32, shown: f32) -> Self {
        let stereo = (cell.covered > 0.0).then(|| ln(cell.stereo));
        let target = if cell.mono > 0.0 { ln(target) } else { f32::NAN };
        // 5 % of depth.
        let is_shown = stereo.is_some_and(|stereo| (stereo - target).abs() < 0.05);
        Self { stereo, mono: ln(cell.mono), target, weight: if is_shown { shown } else { 1.0 }, is_shown }
    }
}
