//! The training itself: steps of an optimiser over a network's parameters.

use burn::optim::{Adam, AdamConfig, AdamState, AdaptiveMomentumState, Optimizer};
use burn::tensor::{Device, Tensor, TensorData};
use depthloom_graphs::values::CurvePoint;

use super::batch::Batch;
use super::loss::MaskedError;
use super::params::{Schedule, SslParams};
use super::photometric::Photometric;
use crate::networks::{ParameterLayout, Size, forward};
use crate::samples::SamplesView;

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct State {
    pub(crate) step: u64,
    /// By parameter, flat.
    pub(crate) values: Vec<Vec<f32>>,
    /// Adam's moments of the learned parameters, first and second; empty before the first step and for frozen
    /// parameters.
    pub(crate) moments: Vec<[Vec<f32>; 2]>,
    /// Sum and number of errors since the last point of the curve.
    pub(crate) since_point: (f64, u64),
    pub(crate) points: Vec<CurvePoint>,
    /// With validation: the best parameters, their error, and points since.
    pub(crate) best: Option<Best>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Best {
    pub(crate) step: u64,
    pub(crate) error: f64,
    pub(crate) values: Vec<Vec<f32>>,
}

pub(super) struct Training<'a> {
    params: &'a SslParams,
    layout: &'a ParameterLayout,
    samples: &'a SamplesView<'a>,
    validation: Option<&'a SamplesView<'a>>,
    device: Device,
    adam: Adam,
    values: Vec<Tensor<1>>,
    moments: Vec<Option<AdamState<1>>>,
    /// Without the tensors, which are above.
    state: State,
    has_diverged: bool,
}

impl<'a> Training<'a> {
    pub(super) fn resume(
        params: &'a SslParams,
        layout: &'a ParameterLayout,
        samples: &'a SamplesView<'a>,
        validation: Option<&'a SamplesView<'a>>,
        mut state: State,
    ) -> Self {
        let device = device();
        let flat = |values: Vec<f32>| {
            let count = values.len();
            Tensor::<1>::from_data(TensorData::new(values, [count]), &device)
        };
        let values = std::mem::take(&mut state.values).into_iter().map(flat).collect();
        let time = state.step as usize;
        let momentum = |[first, second]: [Vec<f32>; 2]| {
            (time > 0 && !first.is_empty())
                .then(|| AdamState::new(AdaptiveMomentumState::new(time, flat(first), flat(second))))
        };
        let mut moments: Vec<_> = std::mem::take(&mut state.moments).into_iter().map(momentum).collect();
        moments.resize_with(layout.parameters.len(), || None);
        // Adam's own constants (Kingma, Ba 2015); burn's epsilon is a thousand times theirs.
        let adam = AdamConfig::new().with_epsilon(1e-8).build();
        Self { params, layout, samples, validation, device, adam, values, moments, state, has_diverged: false }
    }

    pub(super) const fn step(&self) -> u64 {
        self.state.step
    }

    pub(super) fn points(&self) -> &[CurvePoint] {
        &self.state.points
    }

    /// Mean error since the last point, or of the last point that has one; `None` before the first target.
    pub(super) fn loss(&self) -> Option<f64> {
        let (sum, count) = self.state.since_point;
        let of_points = || self.state.points.iter().rev().map(|point| point.loss).find(|loss| !loss.is_nan());
        if count > 0 { Some(sum / count as f64) } else { of_points() }
    }

    pub(super) const fn has_diverged(&self) -> bool {
        self.has_diverged
    }

    pub(super) fn is_finished(&self) -> bool {
        self.state.step >= self.params.steps || self.is_out_of_patience()
    }

    fn is_out_of_patience(&self) -> bool {
        let (Some(patience), Some(best)) = (self.params.patience, &self.state.best) else { return false };
        let since = self.state.points.iter().filter(|point| point.validation.is_some() && point.step > best.step);
        since.count() >= patience as usize
    }

    /// One step; afterwards, where one is due, a point of the curve.
    pub(super) fn advance(&mut self) {
        let rate = self.learning_rate();
        let batch = Batch::augmented(self.params, self.samples, self.state.step);
        let tracked: Vec<Tensor<1>> = self
            .values
            .iter()
            .zip(&self.layout.parameters)
            .map(|(value, parameter)| {
                let value = value.clone().autodiff();
                if parameter.frozen { value } else { value.require_grad() }
            })
            .collect();
        let images = images(self.size(), &batch.images, batch.count, &self.device.clone().autodiff());
        let map = forward(self.params.network, &images, &tracked);
        let (slopes, (sum, count)) = self.slopes(&host(&map), &batch);
        self.has_diverged |= !sum.is_finite();
        self.state.since_point.0 += sum;
        self.state.since_point.1 += count;
        // The gradient of `map . slopes` by the map is `slopes`: so any loss computed beside the library goes back
        // through it.
        let slopes = Tensor::<4>::from_data(TensorData::new(slopes, map.dims()), &map.device());
        let gradients = (map * slopes).sum().backward();
        for (index, tracked) in tracked.iter().enumerate() {
            let Some(gradient) = tracked.grad(&gradients) else { continue };
            let (value, moments) =
                self.adam.step(rate, self.values[index].clone(), gradient, self.moments[index].take());
            self.values[index] = value;
            self.moments[index] = moments;
        }
        self.state.step += 1;
        if self.state.step.is_multiple_of(self.params.curve_every) || self.state.step == self.params.steps {
            self.point(rate);
        }
    }

    fn point(&mut self, learning_rate: f64) {
        let (sum, count) = std::mem::take(&mut self.state.since_point);
        let validation = self.validation.map(|samples| self.error_on(samples));
        // A window may have shown no target since the last point: then nothing was measured, and zero would be a lie.
        let (step, loss) = (self.state.step, if count > 0 { sum / count as f64 } else { f64::NAN });
        self.state.points.push(CurvePoint { step, loss, validation, learning_rate });
        if let Some(error) = validation
            && self.state.best.as_ref().is_none_or(|best| error < best.error)
        {
            self.state.best = Some(Best { step, error, values: self.host_values() });
        }
    }

    fn learning_rate(&self) -> f64 {
        let done = self.state.step as f64 / self.params.steps as f64;
        match self.params.schedule {
            Schedule::Cosine => self.params.learning_rate * 0.5 * (1.0 + libm::cos(std::f64::consts::PI * done)),
            Schedule::Constant => self.params.learning_rate,
        }
    }

    const fn size(&self) -> Size {
        Size { width: self.samples.width(), height: self.samples.height() }
    }

    fn masked_error(&self) -> MaskedError {
        MaskedError { loss: self.params.loss, meaning: self.params.network.meaning(), cap_m: self.params.cap as f32 }
    }

    /// The gradient of the loss by the map; sum and number of absolute errors.
    fn slopes(&self, map: &[f32], batch: &Batch) -> (Vec<f32>, (f64, u64)) {
        let error = self.masked_error();
        let area = map.len() / batch.count;
        let full = self.size();
        let shares = at_map(&batch.shares, full, self.layout.map);
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
            Photometric { meaning: self.params.network.meaning(), map: self.layout.map, image: full }.add(
                map,
                batch,
                weight,
                &mut slopes,
            );
        }
        (slopes, (sum, count))
    }

    /// Mean absolute error on samples as they are: how far the network is from stereo there.
    fn error_on(&self, samples: &SamplesView<'_>) -> f64 {
        let (error, size) = (self.masked_error(), self.size());
        let (mut sum, mut count) = (0.0, 0);
        for start in (0..samples.len()).step_by(self.params.batch as usize) {
            let batch = Batch::plain(samples, start..samples.len().min(start + self.params.batch as usize));
            let map =
                forward(self.params.network, &images(size, &batch.images, batch.count, &self.device), &self.values);
            let (map, shares) = (host(&map), at_map(&batch.shares, size, self.layout.map));
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

    fn host_values(&self) -> Vec<Vec<f32>> {
        self.values.iter().map(host).collect()
    }

    pub(super) fn state(&self) -> State {
        let moments = self.moments.iter().map(|state| {
            state
                .as_ref()
                .map_or_else(Default::default, |state| [host(&state.momentum.moment_1), host(&state.momentum.moment_2)])
        });
        State { values: self.host_values(), moments: moments.collect(), ..self.state.clone() }
    }

    /// The learned parameters: the best ones where there was validation, else the last.
    pub(super) fn learned(&self) -> Vec<Vec<f32>> {
        self.state.best.as_ref().map_or_else(|| self.host_values(), |best| best.values.clone())
    }
}

fn device() -> Device {
    #[cfg(feature = "gpu")]
    return Device::wgpu(burn::tensor::DeviceKind::default());
    #[cfg(not(feature = "gpu"))]
    Device::flex()
}

fn images(size: Size, values: &[f32], count: usize, device: &Device) -> Tensor<4> {
    let shape = [count, 3, size.height, size.width];
    Tensor::from_data(TensorData::new(values.to_vec(), shape), device)
}

fn host<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.to_data().try_into_vec().expect("networks learn in f32")
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
