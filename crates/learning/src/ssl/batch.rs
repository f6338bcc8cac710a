//! Selects the samples of a training step, and augments them.

use crate::samples::SamplesView;
use depthloom_random::SplitMix64;

use super::params::SslParams;

#[derive(Debug, Default)]
pub(crate) struct Batch {
    pub(crate) count: usize,
    /// Batch x 3 x height x width, in [0, 1].
    pub(crate) images: Vec<f32>,
    /// The right views, likewise; empty where they are not used.
    pub(crate) rights: Vec<f32>,
    /// Batch x height x width: disparity as a share of the width, NaN without a target.
    pub(crate) shares: Vec<f32>,
    /// Per sample: depth x share, metres.
    pub(crate) depth_scales: Vec<f32>,
    /// Per sample: whether it is mirrored, so that the right view lies to the left.
    pub(crate) mirrored: Vec<bool>,
}

/// The sequence of random numbers that a step begins; other purposes have other parts of the seed.
fn of_step(seed: u64, step: u64) -> SplitMix64 {
    SplitMix64::part(seed ^ 0x0062_6174_6368, step)
}

/// The samples of step `step`, by index: a function of seed and step alone, so that a resumed training continues with
/// the same.
pub(super) fn drawn(params: &SslParams, samples: usize, step: u64) -> Vec<usize> {
    let batch = params.batch as usize;
    let mut random = of_step(params.seed, step);
    let Some(loaded) = params.loaded else { return (0..batch).map(|_| random.below(samples)).collect() };
    // As in the paper: `loaded` images are loaded, and for a while batches are drawn only from them.
    let epoch = step / u64::from(params.draws);
    let mut loader = SplitMix64::part(params.seed ^ 0x6c6f_6164, epoch);
    let loaded: Vec<usize> = distinct(&mut loader, samples, loaded as usize);
    (0..batch).map(|_| loaded[random.below(loaded.len())]).collect()
}

/// `count` different numbers below `end`, or all of them.
fn distinct(random: &mut SplitMix64, end: usize, count: usize) -> Vec<usize> {
    let mut all: Vec<usize> = (0..end).collect();
    for i in 0..count.min(end) {
        let j = i + random.below(end - i);
        all.swap(i, j);
    }
    all.truncate(count);
    all
}

impl Batch {
    pub(super) fn augmented(params: &SslParams, samples: &SamplesView<'_>, step: u64) -> Self {
        let indices = drawn(params, samples.len(), step);
        // Apart from the draw, so that switching one augmentation off leaves the others and the draw as they are.
        let mut random = SplitMix64::part(params.seed ^ 0x0061_7567_6d65_6e74, step);
        let mut batch = Self::default();
        for index in indices {
            let change = Change::draw(params, &mut random);
            batch.push(samples, index, &change, params.photometric > 0.0);
        }
        batch
    }

    pub(super) fn plain(samples: &SamplesView<'_>, indices: std::ops::Range<usize>) -> Self {
        let mut batch = Self::default();
        indices.for_each(|index| batch.push(samples, index, &Change::NONE, false));
        batch
    }

    fn push(&mut self, samples: &SamplesView<'_>, index: usize, change: &Change, with_right: bool) {
        let (width, height) = (samples.width(), samples.height());
        let (sample, window) = (&samples.items[index], change.window(width, height));
        let image = |image: &[u8], to: &mut Vec<f32>| {
            for (plane, gain) in image.chunks_exact(width * height).zip(change.gains) {
                if change.kept == 1.0 {
                    // Nothing cut off: every sample is one of the image's, in order or mirrored.
                    let value = |&sample: &u8| (f32::from(sample) / 255.0 * gain).min(1.0);
                    let rows = plane.chunks_exact(width);
                    if change.mirrored {
                        rows.for_each(|row| to.extend(row.iter().rev().map(value)));
                    } else {
                        to.extend(plane.iter().map(value));
                    }
                    continue;
                }
                let value = |y: f32, x: f32| bilinear(plane, width, height, y, x) / 255.0 * gain;
                window.visit(|y, x, _| to.push(value(y, x).min(1.0)));
            }
        };
        image(sample.image, &mut self.images);
        if let (true, Some(right)) = (with_right, sample.right) {
            image(right, &mut self.rights);
        }
        // Seen through a window of part of the width, a disparity is a larger share of it.
        window.visit(|_, _, nearest| self.shares.push(sample.share(nearest).to_f32() / change.kept));
        // Depth is what it is: depth = k / share, and the share grew.
        self.depth_scales.push(sample.depth_scale.unwrap_or(f64::NAN) as f32 / change.kept);
        self.mirrored.push(change.mirrored);
        self.count += 1;
    }
}

struct Change {
    mirrored: bool,
    /// Share of the image's sides that the window shows.
    kept: f32,
    /// Where the window lies within what is left, in [0, 1].
    place: [f32; 2],
    gains: [f32; 3],
}

impl Change {
    const NONE: Self = Self { mirrored: false, kept: 1.0, place: [0.0; 2], gains: [1.0; 3] };

    fn draw(params: &SslParams, random: &mut SplitMix64) -> Self {
        // Every number is drawn whether it is used or not: the sequence never shifts.
        let (mirror, kept, place) = (random.unit(), random.unit(), [random.unit(), random.unit()]);
        let brightness = 1.0 + random.sign_unit() * params.brightness as f32;
        let gains = [0; 3].map(|_| brightness * (1.0 + random.sign_unit() * params.colour as f32));
        Self { mirrored: params.flip && mirror < 0.5, kept: 1.0 - kept * params.crop as f32, place, gains }
    }

    const fn window(&self, width: usize, height: usize) -> Window {
        Window { width, height, kept: self.kept, place: self.place, mirrored: self.mirrored }
    }
}

struct Window {
    width: usize,
    height: usize,
    kept: f32,
    place: [f32; 2],
    mirrored: bool,
}

impl Window {
    /// `f(row, column, index of the nearest sample)` of every sample seen, in order.
    fn visit(&self, mut f: impl FnMut(f32, f32, usize)) {
        let (width, height) = (self.width as f32, self.height as f32);
        let [top, left] = [self.place[0] * (1.0 - self.kept) * height, self.place[1] * (1.0 - self.kept) * width];
        for y in 0..self.height {
            for x in 0..self.width {
                let seen = if self.mirrored { self.width - 1 - x } else { x };
                // Half-pixel centres, as in every resize here.
                let row = top + (y as f32 + 0.5) * self.kept - 0.5;
                let column = left + (seen as f32 + 0.5) * self.kept - 0.5;
                let nearest = |at: f32, end: usize| (at.round().max(0.0) as usize).min(end - 1);
                f(row, column, nearest(row, self.height) * self.width + nearest(column, self.width));
            }
        }
    }
}

fn bilinear(plane: &[u8], width: usize, height: usize, y: f32, x: f32) -> f32 {
    let (y, x) = (y.clamp(0.0, (height - 1) as f32), x.clamp(0.0, (width - 1) as f32));
    let (top, left) = (y as usize, x as usize);
    let (down, right) = (y - top as f32, x - left as f32);
    let (bottom, next) = ((top + 1).min(height - 1), (left + 1).min(width - 1));
    let at = |row: usize, column: usize| f32::from(plane[row * width + column]);
    let above = at(top, left) + (at(top, next) - at(top, left)) * right;
    let below = at(bottom, left) + (at(bottom, next) - at(bottom, left)) * right;
    above + (below - above) * down
}

#[cfg(test)]
mod tests {
    use half::f16;

    use super::{Batch, drawn};
    use crate::samples::{Sample, Samples, SamplesView};
    use crate::ssl::params::SslParams;

    fn samples(count: usize) -> Vec<u8> {
        let item = |i: usize| Sample {
            id: i.to_string(),
            image: (0..3 * 6).map(|p| (i * 40 + p * 3) as u8).collect(),
            right: None,
            share: (0..6).map(|p| if p == 4 { f16::NAN } else { f16::from_f32((p + 1) as f32 / 64.0) }).collect(),
            depth_scale: Some(0.5),
            cells: None,
        };
        Samples { width: 3, height: 2, has_right: false, items: (0..count).map(item).collect() }.encode()
    }

    #[test]
    fn a_plain_batch_holds_the_samples() {
        let bytes = samples(2);
        let samples = SamplesView::read(&bytes).unwrap();
        let batch = Batch::plain(&samples, 1..2);
        let expected: Vec<f32> = samples.items[1].image.iter().map(|&v| f32::from(v) / 255.0).collect();
        assert_eq!(batch.images, expected);
        assert!(batch.shares[4].is_nan());
        assert_eq!(batch.shares[5], 6.0 / 64.0);
        assert_eq!(batch.depth_scales, [0.5]);
    }

    #[test]
    fn a_mirrored_sample_is_mirrored_with_its_target() {
        let params = SslParams { flip: true, brightness: 0.0, colour: 0.0, batch: 64, ..SslParams::default() };
        let bytes = samples(1);
        let batch = Batch::augmented(&params, &SamplesView::read(&bytes).unwrap(), 3);
        assert!(batch.mirrored.contains(&true) && batch.mirrored.contains(&false));
        for (i, &mirrored) in batch.mirrored.iter().enumerate() {
            let expected = if mirrored { [2.0, 1.0, 0.0] } else { [0.0, 1.0, 2.0] };
            assert_eq!(batch.shares[i * 6..i * 6 + 3], expected.map(|p: f32| (p + 1.0) / 64.0));
            assert_eq!(batch.images[i * 18..i * 18 + 3], expected.map(|p: f32| p * 3.0 / 255.0));
        }
    }

    #[test]
    fn a_window_on_half_the_image_doubles_shares_and_keeps_depth() {
        let params = SslParams { crop: 0.5, batch: 32, ..SslParams::default() };
        let bytes = samples(1);
        let batch = Batch::augmented(&params, &SamplesView::read(&bytes).unwrap(), 0);
        let shown: Vec<f32> = batch.depth_scales.iter().map(|k| 0.5 / k).collect();
        assert!(shown.iter().all(|kept| (0.5..=1.0).contains(kept)) && shown.iter().any(|&kept| kept < 0.7));
    }

    #[test]
    fn the_papers_sampling_stays_with_what_it_loaded() {
        let params = SslParams { loaded: Some(4), draws: 10, batch: 8, ..SslParams::default() };
        let of_epoch = |epoch: u64| {
            let mut seen: Vec<usize> = (0..10).flat_map(|i| drawn(&params, 100, epoch * 10 + i)).collect();
            seen.sort_unstable();
            seen.dedup();
            seen
        };
        assert_eq!(of_epoch(0).len(), 4);
        assert_ne!(of_epoch(0), of_epoch(1));
    }
}
