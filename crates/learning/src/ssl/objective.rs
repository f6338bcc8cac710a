//! The objective of `learn/ssl`: the error against stereo, and the photometric loss.

use burn::tensor::Tensor;

use super::batch::Batch;
use super::loss::MaskedError;
use super::params::SslParams;
use super::photometric::Photometric;
use crate::networks::{Size, forward};
use crate::samples::SamplesView;
use crate::training::{Input, Objective, Settings, Slopes};

pub(super) struct SelfSupervision<'a> {
    params: &'a SslParams,
    /// Size of the network's map.
    map: Size,
    samples: &'a SamplesView<'a>,
    validation: Option<&'a SamplesView<'a>>,
}

impl<'a> SelfSupervision<'a> {
    pub(super) const fn new(
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
        MaskedError { loss: self.params.loss, meaning: self.params.network.meaning(), cap_m: self.params.cap as f32 }
    }

    fn input(&self, batch: &Batch) -> Input {
        let Size { width, height } = self.size();
        Input { values: batch.images.clone(), shape: [batch.count, 3, height, width] }
    }

    /// Mean absolute error on samples as they are: how far the network is from stereo there.
    fn error_on(&self, samples: &SamplesView<'_>, maps: &dyn Fn(Input) -> Vec<f32>) -> f64 {
        let (error, size) = (self.masked_error(), self.size());
        let (mut sum, mut count) = (0.0, 0);
        for start in (0..samples.len()).step_by(self.params.batch as usize) {
            let batch = Batch::plain(samples, start..samples.len().min(start + self.params.batch as usize));
            let (map, shares) = (maps(self.input(&batch)), at_map(&batch.shares, size, self.map));
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

    fn forward(&self, input: &Tensor<4>, parameters: &[Tensor<1>]) -> Tensor<4> {
        forward(self.params.network, input, parameters)
    }

    /// The gradient of the loss by the map; sum and number of absolute errors.
    fn slopes(&self, map: &[f32], batch: &Batch) -> Slopes {
        let error = self.masked_error();
        let area = map.len() / batch.count;
        let full = self.size();
        let shares = at_map(&batch.shares, full, self.map);
        let mut slopes = vec![0.0; map.len()];
        let (mut sum, mut count) = (0.0, 0);
        for i in 0..batch.count {
            let range = i * area..(i + 1) * area;
            let (more, of_them) =
                error.add(&map[range.clone()], &shares[range.clone()], batch.depth_scales[i], &mut slopes[range]);
            sum += more;
            count += of_them;
        }
        let each = 1.0 / count.max(1) as f32;
        slopes.iter_mut().for_each(|slope| *slope *= each);
        if self.params.photometric > 0.0 {
            let weight = (self.params.photometric / batch.count as f64) as f32;
            Photometric { meaning: self.params.network.meaning(), map: self.map, image: full }.add(
                map,
                batch,
                weight,
                &mut slopes,
            );
        }
        Slopes { by_map: slopes, measured: (sum, count) }
    }

    fn validation(&self, maps: &dyn Fn(Input) -> Vec<f32>) -> Option<f64> {
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
