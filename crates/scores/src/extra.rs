//! The sums of the metrics beyond Table I, taken in a separate pass, only if one of them is requested.

use crate::Metric;
use crate::ln::ln;
use crate::quantile::median;

/// The sums over some pixels, added in their order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Extra {
    pixels: u64,
    log: f64,
    absolute: f64,
    inverse: f64,
    inverse_squared: f64,
    within: [u64; 2],
    /// The absolute errors, if their median is requested.
    errors: Option<Vec<f64>>,
}

impl Extra {
    pub(crate) fn new(metrics: &[&'static Metric]) -> Self {
        let needs_median = metrics.iter().any(|metric| metric.name == "median_error");
        Self { errors: needs_median.then(Vec::new), ..Self::default() }
    }

    /// Whether one of these metrics is requested.
    pub(crate) fn is_requested(metrics: &[&'static Metric]) -> bool {
        let own = ["log10", "mae", "median_error", "imae", "irmse", "delta_1.05", "delta_1.10"];
        metrics.iter().any(|metric| own.contains(&metric.name))
    }

    /// Adds a pixel: truth and estimate, metres, both positive.
    pub(crate) fn push(&mut self, t: f64, y: f64) {
        let (error, inverse_per_km, ratio) = ((y - t).abs(), (1000.0 / y - 1000.0 / t).abs(), y / t);
        self.pixels += 1;
        self.log += ln(ratio).abs();
        self.absolute += error;
        self.inverse += inverse_per_km;
        self.inverse_squared += inverse_per_km * inverse_per_km;
        for (count, limit) in self.within.iter_mut().zip([1.05, 1.10]) {
            *count += u64::from(ratio.max(t / y) < limit);
        }
        if let Some(errors) = &mut self.errors {
            errors.push(error);
        }
    }

    /// Adds the sums over other pixels.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.pixels += other.pixels;
        self.log += other.log;
        self.absolute += other.absolute;
        self.inverse += other.inverse;
        self.inverse_squared += other.inverse_squared;
        for (count, more) in self.within.iter_mut().zip(other.within) {
            *count += more;
        }
        if let (Some(errors), Some(more)) = (&mut self.errors, &other.errors) {
            errors.extend_from_slice(more);
        }
    }

    /// A metric, if it is one of these; NaN where no pixel counted.
    pub(crate) fn score(&mut self, metric: &Metric) -> Option<f64> {
        let count = if self.pixels == 0 { f64::NAN } else { self.pixels as f64 };
        Some(match metric.name {
            "log10" => self.log * std::f64::consts::LOG10_E / count,
            "mae" => self.absolute / count,
            "median_error" => median(self.errors.as_deref_mut()?, f64::total_cmp).unwrap_or(f64::NAN),
            "imae" => self.inverse / count,
            "irmse" => (self.inverse_squared / count).sqrt(),
            "delta_1.05" => self.within[0] as f64 / count,
            "delta_1.10" => self.within[1] as f64 / count,
            _ => return None,
        })
    }
}
