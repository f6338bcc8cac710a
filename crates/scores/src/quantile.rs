//! Quantiles and medians of numbers in memory, as NumPy computes them by default (`linear`).

use std::cmp::Ordering;

/// Where the quantile of a share (0 to 1) is among `count` sorted numbers, at least one: the rank below it, and how far
/// it is from there to the next.
#[must_use]
pub fn position(share: f64, count: u64) -> (u64, f64) {
    let exact = share * (count - 1) as f64;
    let below = exact.floor().min((count - 1) as f64);
    (below as u64, exact - below)
}

/// The quantile between its two neighbours.
#[must_use]
pub fn between(lower: f64, upper: f64, share: f64) -> f64 {
    lower + (upper - lower) * share
}

/// The quantile of a share (0 to 1) of sorted numbers; NaN of none.
#[must_use]
pub fn quantile<T: Copy + Into<f64>>(sorted: &[T], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let (below, share) = position(share, sorted.len() as u64);
    let below = below as usize;
    between(sorted[below].into(), sorted[(below + 1).min(last)].into(), share)
}

/// The median: the mean of the middle two of an even number; `None` of none. Changes the order of the numbers.
pub fn median<T: Copy + Into<f64>>(values: &mut [T], order: impl Fn(&T, &T) -> Ordering) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    let even = values.len().is_multiple_of(2);
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, &order);
    let lower = below.iter().copied().max_by(&order).filter(|_| even);
    Some(lower.map_or(upper.into(), |lower| f64::midpoint(lower.into(), upper.into())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn median_is_numpys() {
        let median = |values: &mut [f32]| median(values, f32::total_cmp);
        assert_eq!(median(&mut []), None);
        assert_eq!(median(&mut [3.0]), Some(3.0));
        assert_eq!(median(&mut [4.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 8.0]), Some(3.0));
    }

    #[test]
    fn quantiles_are_those_numpy_prints() {
        // np.percentile([0.5, 1, 2, 4, 8, 16], [5, 25, 50, 75, 95, 100])
        let sorted = [0.5_f32, 1.0, 2.0, 4.0, 8.0, 16.0];
        let found = [5.0, 25.0, 50.0, 75.0, 95.0, 100.0].map(|percentile| quantile(&sorted, percentile / 100.0));
        assert_eq!(found, [0.625, 1.25, 3.0, 7.0, 14.0, 16.0]);
        assert_eq!((quantile(&[3.0], 0.3), quantile::<f64>(&[], 0.5).is_nan()), (3.0, true));
    }
}
