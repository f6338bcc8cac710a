//! Latencies of a live stage, as histograms.

use hdrhistogram::Histogram;

use crate::timing::Phase;

/// Percentiles of a latency.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Latency {
    /// The number of frames.
    pub count: u64,
    /// The median, nanoseconds; like all percentiles within 0.1 %.
    pub p50_ns: u64,
    /// The 95th percentile, nanoseconds.
    pub p95_ns: u64,
    /// The 99th percentile, nanoseconds.
    pub p99_ns: u64,
    /// The maximum, nanoseconds.
    pub max_ns: u64,
    /// The mean absolute difference between the latencies of successive frames, nanoseconds.
    pub jitter_ns: u64,
}

/// The latency of a step: from the capture of the frame until its values were there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StepLatency {
    /// The node's name, or `source`, `encode`, `write`.
    pub label: String,
    /// The class.
    pub phase: Phase,
    /// The latency.
    pub latency: Latency,
    /// The median time that the step itself takes, nanoseconds.
    pub median_wall_ns: u64,
}

/// Collects the latencies of one kind.
pub(crate) struct Meter {
    histogram: Histogram<u64>,
    last_ns: Option<u64>,
    differences_ns: u64,
}

impl Meter {
    pub(crate) fn new() -> Self {
        let mut histogram = Histogram::new(3).expect("3 digits are allowed");
        histogram.auto(true);
        Self { histogram, last_ns: None, differences_ns: 0 }
    }

    pub(crate) fn add(&mut self, ns: u64) {
        // The smallest value of the histogram is 1. It grows as needed.
        self.histogram.record(ns.max(1)).expect("it grows");
        self.differences_ns = self.differences_ns.saturating_add(self.last_ns.map_or(0, |last| last.abs_diff(ns)));
        self.last_ns = Some(ns);
    }

    pub(crate) fn median_ns(&self) -> u64 {
        if self.histogram.is_empty() { 0 } else { self.histogram.value_at_quantile(0.5) }
    }

    pub(crate) fn latency(&self) -> Latency {
        let count = self.histogram.len();
        if count == 0 {
            return Latency::default();
        }
        let at = |quantile| self.histogram.value_at_quantile(quantile);
        Latency {
            count,
            p50_ns: at(0.5),
            p95_ns: at(0.95),
            p99_ns: at(0.99),
            max_ns: self.histogram.max(),
            jitter_ns: self.differences_ns / (count - 1).max(1),
        }
    }

    /// Forgets all latencies except the last, from which the next difference is taken.
    pub(crate) fn reset(&mut self) {
        self.histogram.reset();
        self.differences_ns = 0;
    }
}

/// The latencies of all steps: of the whole run, and lately.
pub(crate) struct Meters {
    pub(crate) frames: Pair,
    pub(crate) steps: Vec<StepMeters>,
}

/// A meter of the whole run, and one that is reset.
pub(crate) struct Pair {
    pub(crate) all: Meter,
    pub(crate) lately: Meter,
}

pub(crate) struct StepMeters {
    label: String,
    phase: Phase,
    latency: Pair,
    wall: Pair,
}

impl Pair {
    fn new() -> Self {
        Self { all: Meter::new(), lately: Meter::new() }
    }

    pub(crate) fn add(&mut self, ns: u64) {
        self.all.add(ns);
        self.lately.add(ns);
    }
}

impl Meters {
    pub(crate) fn new(steps: impl Iterator<Item = (String, Phase)>) -> Self {
        let step = |(label, phase)| StepMeters { label, phase, latency: Pair::new(), wall: Pair::new() };
        Self { frames: Pair::new(), steps: steps.map(step).collect() }
    }

    pub(crate) fn add_step(&mut self, step: usize, latency_ns: u64, wall_ns: u64) {
        let meters = &mut self.steps[step];
        meters.latency.add(latency_ns);
        meters.wall.add(wall_ns);
    }

    /// Of the whole run.
    pub(crate) fn steps(&self) -> Vec<StepLatency> {
        self.summary(|pair| &pair.all)
    }

    /// Since the last call. Resets what is returned.
    pub(crate) fn take_lately(&mut self) -> (Latency, Vec<StepLatency>) {
        let lately = (self.frames.lately.latency(), self.summary(|pair| &pair.lately));
        self.frames.lately.reset();
        for step in &mut self.steps {
            step.latency.lately.reset();
            step.wall.lately.reset();
        }
        lately
    }

    /// The step with the largest share of the time of all steps.
    pub(crate) fn bottleneck(&self) -> Option<(String, f64)> {
        let spent = |step: &StepMeters| step.wall.all.histogram.mean() * step.wall.all.histogram.len() as f64;
        let total: f64 = self.steps.iter().map(spent).sum();
        let most = self.steps.iter().max_by(|a, b| spent(a).total_cmp(&spent(b)))?;
        (total > 0.0).then(|| (most.label.clone(), spent(most) / total))
    }

    fn summary(&self, select: impl Fn(&Pair) -> &Meter) -> Vec<StepLatency> {
        let steps = self.steps.iter().filter(|step| !select(&step.latency).histogram.is_empty());
        let one = |step: &StepMeters| StepLatency {
            label: step.label.clone(),
            phase: step.phase,
            latency: select(&step.latency).latency(),
            median_wall_ns: select(&step.wall).median_ns(),
        };
        steps.map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{Meter, Meters};
    use crate::timing::Phase;

    #[test]
    fn percentiles_and_jitter_are_those_of_the_latencies() {
        let mut meter = Meter::new();
        (1..=1000_u64).for_each(|k| meter.add(k * 1_000_000));
        let latency = meter.latency();
        let within = |ns: u64, expected_ms: u64| ns.abs_diff(expected_ms * 1_000_000) <= expected_ms * 1000;
        assert!(within(latency.p50_ns, 500) && within(latency.p95_ns, 950), "{latency:?}");
        assert!(within(latency.p99_ns, 990) && within(latency.max_ns, 1000), "{latency:?}");
        assert_eq!((latency.count, latency.jitter_ns), (1000, 1_000_000));
    }

    #[test]
    fn lately_starts_anew_and_the_longest_step_is_the_bottleneck() {
        let steps = ["source", "stereo", "write"].map(|label| (label.to_owned(), Phase::Source));
        let mut meters = Meters::new(steps.into_iter());
        for (step, wall_ns) in [(0, 10), (1, 70), (2, 20)] {
            meters.add_step(step, 100, wall_ns);
        }
        meters.frames.add(100);
        assert_eq!(meters.bottleneck(), Some(("stereo".to_owned(), 0.7)));
        let (frames, steps) = meters.take_lately();
        assert_eq!((frames.count, steps.len()), (1, 3));
        assert_eq!(meters.take_lately().0.count, 0);
        assert_eq!(meters.steps().len(), 3);
    }
}
