//! The objective of `learn/ssl`: the error against stereo, and the photometric loss.

use std::borrow::Cow;
use std::ops::Range;

use super::batch::Batch;
use super::loss::{MaskedError, Penalty};
use super::params::SslParams;
use super::photometric::Photometric;
use crate::compute::Input;
use crate::networks::{Architecture, Size};
use crate::samples::SamplesView;
use crate::training::{Objective, Settings, Slopes};

pub(crate) struct SelfSupervision<'a> {
    params: &'a SslParams,
    /// Size of the network's map.
    map: Size,
    samples: &'a SamplesView<'a>,
    validation: Option<&'a SamplesView<'a>>,
}

impl<'a> SelfSupervision<'a> {
    pub(crate) const fn new(
        params: &'a SslParams,
        map: Size,
        samples: &'a SamplesView<'a>,
        validation: Option<&'a SamplesView<'a>>,
    ) -> Self {
        Self { params, map, samples, validation }
    }

    const fn size(&self) -> Size {
        Size { width: self.samples.width(), height: self.samples.height() }
    }

    const fn masked_error(&self) -> MaskedError {
        let (meaning, cap_m) = (self.params.network.meaning(), self.params.cap as f32);
        MaskedError { loss: self.params.loss, meaning, cap_m, knee: f32::INFINITY }
    }

    /// Splits the network's maps into disparities and, with `spread`, spreads.
    fn maps<'m>(&self, maps: &'m [f32]) -> (Cow<'m, [f32]>, Vec<f32>) {
        if !self.params.spread {
            return (Cow::Borrowed(maps), Vec::new());
        }
        let area = self.map.width * self.map.height;
        let every_second =
            |first: usize| -> Vec<f32> { maps.chunks_exact(area).skip(first).step_by(2).flatten().copied().collect() };
        (Cow::Owned(every_second(0)), every_second(1))
    }

    fn input(&self, batch: &Batch) -> Input {
        let Size { width, height } = self.size();
        Input { values: batch.images.clone(), shape: [batch.count, 3, height, width] }
    }

    /// Mean absolute error on samples as they are: how far the network is from stereo there.
    fn error_on(&self, samples: &SamplesView<'_>, maps: &mut dyn FnMut(Input) -> Vec<f32>) -> f64 {
        let (error, size) = (self.masked_error(), self.size());
        let (mut sum, mut count) = (0.0, 0);
        for start in (0..samples.len()).step_by(self.params.batch as usize) {
            let batch = Batch::plain(samples, start..samples.len().min(start + self.params.batch as usize));
            let (maps, shares) = (maps(self.input(&batch)), at_map(&batch.shares, size, self.map));
            let (map, _) = self.maps(&maps);
            let area = map.len() / batch.count;
            for (i, &k) in batch.depth_scales.iter().enumerate() {
                let range = i * area..(i + 1) * area;
                let (more, of_them) = error.add(&map[range.clone()], &shares[range], k, &mut vec![0.0; area]);
                sum += more;
                count += of_them;
            }
        }
        sum / count.max(1) as f64
    }
}

impl Objective for SelfSupervision<'_> {
    type Batch = Batch;

    fn settings(&self) -> Settings {
        self.params.settings()
    }

    fn batch(&self, step: u64) -> (Input, Batch) {
        let batch = Batch::augmented(self.params, self.samples, step);
        (self.input(&batch), batch)
    }

    fn network(&self) -> impl Architecture {
        self.params.architecture()
    }

    /// The gradient of the loss by the maps; sum and number of absolute errors.
    fn slopes(&self, maps: &[f32], batch: &Batch) -> Slopes {
        let mut error = self.masked_error();
        let (map, spreads) = self.maps(maps);
        let area = map.len() / batch.count;
        let full = self.size();
        let shares = at_map(&batch.shares, full, self.map);
        let (mut slopes, mut spread_slopes) = (vec![0.0; map.len()], vec![0.0; spreads.len()]);
        let samples = || (0..batch.count).map(|i| (i * area..(i + 1) * area, batch.depth_scales[i]));
        if self.params.penalty == Penalty::Berhu {
            let of_sample = |(range, k): (Range<usize>, f32)| error.largest(&map[range.clone()], &shares[range], k);
            error.knee = 0.2 * samples().map(of_sample).fold(0.0, f32::max);
        }
        let (mut sum, mut count) = (0.0, 0);
        for (range, k) in samples() {
            let (map, shares, slopes) = (&map[range.clone()], &shares[range.clone()], &mut slopes[range.clone()]);
            let (more, of_them) = if self.params.spread {
                error.add_likelihood([map, &spreads[range.clone()]], shares, k, [slopes, &mut spread_slopes[range]])
            } else {
                error.add(map, shares, k, slopes)
            };
            sum += more;
            count += of_them;
        }
        let each = 1.0 / count.max(1) as f32;
        slopes.iter_mut().chain(&mut spread_slopes).for_each(|slope| *slope *= each);
        if self.params.photometric > 0.0 {
            let weight = (self.params.photometric / batch.count as f64) as f32;
            Photometric { meaning: self.params.network.meaning(), map: self.map, image: full }.add(
                &map,
                batch,
                weight,
                &mut slopes,
            );
        }
        if self.params.spread {
            slopes = slopes
                .chunks_exact(area)
                .zip(spread_slopes.chunks_exact(area))
                .flat_map(|(a, b)| [a, b].concat())
                .collect();
        }
        Slopes { by_map: slopes, measured: (sum, count) }
    }

    fn validation(&self, maps: &mut dyn FnMut(Input) -> Vec<f32>) -> Option<f64> {
        self.validation.map(|samples| self.error_on(samples, maps))
    }
}

/// Targets at the size of a network's map: the mean of the targets there are in each cell.
fn at_map(shares: &[f32], image: Size, map: Size) -> Vec<f32> {
    if image == map {
        return shares.to_vec();
    }
    let (wide, high) = (image.width / map.width, image.height / map.height);
    let mut out = Vec::with_capacity(shares.len() / (wide * high));
    for of_image in shares.chunks_exact(image.width * image.height) {
        for (row, column) in (0..map.height).flat_map(|row| (0..map.width).map(move |column| (row, column))) {
            let cell = (0..high).flat_map(|y| {
                let from = (row * high + y) * image.width + column * wide;
                &of_image[from..from + wide]
            });
            let (sum, count) =
                cell.filter(|share| !share.is_nan()).fold((0.0, 0), |(sum, count), share| (sum + share, count + 1));
            out.push(if count > 0 { sum / count as f32 } else { f32::NAN });
        }
    }
    out
}
