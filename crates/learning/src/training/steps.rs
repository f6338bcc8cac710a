//! The training itself: steps of an optimiser over a network's parameters.

use depthloom_graphs::values::CurvePoint;

use super::{Objective, Schedule, Settings, Slopes, adam};
use crate::compute::Engine;
use crate::networks::{Architecture, ParameterLayout};

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct State {
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
pub(crate) struct Best {
    pub(crate) step: u64,
    pub(crate) error: f64,
    pub(crate) values: Vec<Vec<f32>>,
}

pub(super) struct Training<'a, O, A> {
    objective: &'a O,
    settings: Settings,
    engine: Engine<A>,
    state: State,
    has_diverged: bool,
}

impl<'a, O: Objective, A: Architecture> Training<'a, O, A> {
    /// `network` is the objective's.
    pub(super) fn resume(objective: &'a O, network: A, layout: &ParameterLayout, mut state: State) -> Self {
        state.moments.resize_with(layout.parameters.len(), Default::default);
        let (engine, settings) = (Engine::new(network, layout), objective.settings());
        Self { objective, settings, engine, state, has_diverged: false }
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
        let slopes = |maps: &[f32]| {
            let Slopes { by_map, measured } = self.objective.slopes(maps, &batch);
            (by_map, measured)
        };
        let (gradients, (sum, count)) = self.engine.gradients(&input, &self.state.values, slopes);
        self.has_diverged |= !sum.is_finite();
        self.state.since_point.0 += sum;
        self.state.since_point.1 += count;
        let parameters = self.state.values.iter_mut().zip(&mut self.state.moments);
        for (gradient, (values, moments)) in gradients.iter().zip(parameters) {
            if let Some(gradient) = gradient {
                adam::step(rate, self.state.step + 1, values, gradient, moments);
            }
        }
        self.state.step += 1;
        if self.state.step.is_multiple_of(self.settings.curve_every) || self.state.step == self.settings.steps {
            self.point(rate);
        }
    }

    fn point(&mut self, learning_rate: f64) {
        let (sum, count) = std::mem::take(&mut self.state.since_point);
        let (engine, values) = (&mut self.engine, &self.state.values);
        let validation = self.objective.validation(&mut |input| engine.maps(&input, values));
        // A window may have shown no target since the last point: then nothing was measured, and zero would be a lie.
        let (step, loss) = (self.state.step, if count > 0 { sum / count as f64 } else { f64::NAN });
        self.state.points.push(CurvePoint { step, loss, validation, learning_rate });
        if let Some(error) = validation
            && self.state.best.as_ref().is_none_or(|best| error < best.error)
        {
            self.state.best = Some(Best { step, error, values: self.state.values.clone() });
        }
    }

    fn learning_rate(&self) -> f64 {
        let done = self.state.step as f64 / self.settings.steps as f64;
        match self.settings.schedule {
            Schedule::Cosine => self.settings.learning_rate * 0.5 * (1.0 + libm::cos(std::f64::consts::PI * done)),
            Schedule::Constant => self.settings.learning_rate,
        }
    }

    pub(super) const fn state(&self) -> &State {
        &self.state
    }

    pub(super) fn into_state(self) -> State {
        self.state
    }

    /// The learned parameters: the best ones where there was validation, else the last.
    pub(super) fn learned(&self) -> Vec<Vec<f32>> {
        self.state.best.as_ref().map_or(&self.state.values, |best| &best.values).clone()
    }
}
