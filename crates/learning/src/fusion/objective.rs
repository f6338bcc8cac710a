//! The objective of `learn/fusion`.

use depthloom_kernels::learned::MAPS;
use rayon::prelude::*;

use super::batch;
use super::loss::{Seen, Sums, add};
use super::params::FusionParams;
use crate::compute::Input;
use crate::networks::{Architecture, FusionUnet, Size};
use crate::samples::SamplesView;
use crate::training::{Objective, Settings, Slopes};

pub(super) struct Fusion<'a> {
    pub(super) params: &'a FusionParams,
    pub(super) samples: &'a SamplesView<'a>,
    pub(super) validation: Option<&'a SamplesView<'a>>,
}

impl Fusion<'_> {
    const fn size(&self) -> Size {
        Size { width: self.samples.width(), height: self.samples.height() }
    }
}

/// The gradient of the sum of the losses, and the sums, of windows of size `size`.
fn sums(map: &[f32], seen: &[Seen], size: Size) -> (Vec<f32>, Sums) {
    let (area, mut slopes) = (size.width * size.height, vec![0.0; map.len()]);
    let windows = slopes.par_chunks_exact_mut(MAPS * area).zip(map.par_chunks_exact(MAPS * area));
    let of_windows: Vec<Sums> = windows
        .zip(seen.par_chunks_exact(area))
        .map(|((slopes, map), seen)| add(map, seen, size.width, slopes))
        .collect();
    let mut all = Sums::default();
    for Sums { weight, measured } in of_windows {
        all.weight += weight;
        all.measured.0 += measured.0;
        all.measured.1 += measured.1;
    }
    (slopes, all)
}

impl Objective for Fusion<'_> {
    type Batch = Vec<Seen>;

    fn settings(&self) -> Settings {
        self.params.settings()
    }

    fn batch(&self, step: u64) -> (Input, Vec<Seen>) {
        batch::augmented(self.params, self.samples, step)
    }

    fn network(&self) -> impl Architecture {
        FusionUnet
    }

    fn slopes(&self, map: &[f32], seen: &Vec<Seen>) -> Slopes {
        let (mut by_map, sums) = sums(map, seen, batch::window(self.params, self.size()));
        let each = if sums.weight > 0.0 { (1.0 / sums.weight) as f32 } else { 0.0 };
        by_map.iter_mut().for_each(|slope| *slope *= each);
        Slopes { by_map, measured: sums.measured }
    }

    /// The mean loss where stereo does not show the target.
    fn validation(&self, maps: &mut dyn FnMut(Input) -> Vec<f32>) -> Option<f64> {
        let samples = self.validation?;
        let (mut sum, mut count) = (0.0, 0);
        for index in 0..samples.len() {
            let (input, seen) = batch::hidden(self.params, samples, index..index + 1);
            let (_, Sums { measured, .. }) =
                sums(&maps(input), &seen, Size { width: samples.width(), height: samples.height() });
            sum += measured.0;
            count += measured.1;
        }
        Some(sum / count.max(1) as f64)
    }
}
