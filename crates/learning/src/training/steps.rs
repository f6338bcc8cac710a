//! The training itself: steps of an optimiser over a network's parameters.

use burn::optim::{Adam, AdamConfig, AdamState, AdaptiveMomentumState, Optimizer};
use burn::tensor::{Device, Tensor, TensorData};
use depthloom_graphs::values::CurvePoint;

use super::{Input, Objective, Schedule, Settings, Slopes};
use crate::networks::ParameterLayout;

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

pub(super) struct Training<'a, O> {
    objective: &'a O,
    settings: Settings,
    layout: &'a ParameterLayout,
    device: Device,
    adam: Adam,
    values: Vec<Tensor<1>>,
    moments: Vec<Option<AdamState<1>>>,
    /// Without the tensors, which are above.
    state: State,
    has_diverged: bool,
}

impl<'a, O: Objective> Training<'a, O> {
    pub(super) fn resume(objective: &'a O, layout: &'a ParameterLayout, mut state: State) -> Self {
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
        let settings = objective.settings();
        Self { objective, settings, layout, device, adam, values, moments, state, has_diverged: false }
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
        self.state.step >= self.settings.steps || self.is_out_of_patience()
    }

    fn is_out_of_patience(&self) -> bool {
        let (Some(patience), Some(best)) = (self.settings.patience, &self.state.best) else { return false };
        let since = self.state.points.iter().filter(|point| point.validation.is_some() && point.step > best.step);
        since.count() >= patience as usize
    }

    /// One step; afterwards, where one is due, a point of the curve.
    pub(super) fn advance(&mut self) {
        let rate = self.learning_rate();
        let (input, batch) = self.objective.batch(self.state.step);
        let tracked: Vec<Tensor<1>> = self
            .values
            .iter()
            .zip(&self.layout.parameters)
            .map(|(value, parameter)| {
                let value = value.clone().autodiff();
                if parameter.frozen { value } else { value.require_grad() }
            })
            .collect();
        let map = self.objective.forward(&tensor(input, &self.device.clone().autodiff()), &tracked);
        let Slopes { by_map: slopes, measured: (sum, count) } = self.objective.slopes(&host(&map), &batch);
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
        if self.state.step.is_multiple_of(self.settings.curve_every) || self.state.step == self.settings.steps {
            self.point(rate);
        }
    }

    fn point(&mut self, learning_rate: f64) {
        let (sum, count) = std::mem::take(&mut self.state.since_point);
        let maps = |input| host(&self.objective.forward(&tensor(input, &self.device), &self.values));
        let validation = self.objective.validation(&maps);
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
        let done = self.state.step as f64 / self.settings.steps as f64;
        match self.settings.schedule {
            Schedule::Cosine => self.settings.learning_rate * 0.5 * (1.0 + libm::cos(std::f64::consts::PI * done)),
            Schedule::Constant => self.settings.learning_rate,
        }
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

fn tensor(Input { values, shape }: Input, device: &Device) -> Tensor<4> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

fn host<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.to_data().try_into_vec().expect("networks learn in f32")
}
