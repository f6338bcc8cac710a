//! The distance at which one of two estimates should hand over to the other.
//!
//! The difference of their errors by distance is taken as a line through the middles of bins. Where it crosses zero,
//! the other of the two becomes the better one. Of noisy errors there may be many crossings. The *handover* is the one
//! of them at which a single change costs least: with the one estimate nearer than there and the other farther, the sum
//! of errors over all pixels is smallest, and smaller than with either alone.

use crate::error::AnalysisError;
use crate::statistics::{Interval, Resampling};

/// Which of the two is better near.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Near {
    Baseline,
    Other,
}

/// Where one hands over to the other.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Handover {
    /// The one that is better nearer than there.
    pub(crate) near: Near,
    pub(crate) distance_m: f64,
    /// The percentiles of resamples that have a handover of this kind.
    pub(crate) interval: Option<Interval>,
    /// The share of resamples that have one.
    pub(crate) share: f64,
    /// All distances at which the difference is zero, from one that is not.
    pub(crate) crossings_m: Vec<f64>,
}

/// A curve's bins, near ones first: middle, difference (other less baseline), pixels.
type Curve = Vec<(f64, f64, f64)>;

/// The handover of a curve that frames make which count so often, with its interval.
pub(super) fn found(
    curve: &(dyn Fn(&[f64]) -> Curve + Sync),
    frames: usize,
    resampling: &Resampling,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Option<Handover>, AnalysisError> {
    let whole = curve(&vec![1.0; frames]);
    let candidates = [Near::Baseline, Near::Other].map(|near| (near, best(&whole, near)));
    let better = candidates.into_iter().filter_map(|(near, found)| Some((near, found?)));
    let Some((near, (distance_m, _))) = better.reduce(|one, two| if two.1.1 < one.1.1 { two } else { one }) else {
        return Ok(None);
    };
    let (mut interval, mut share) = (None, 1.0);
    if frames > 1 {
        let of = |times: &[f64]| best(&curve(times), near).map_or(f64::NAN, |(distance, _)| distance);
        let replicates = resampling.replicates(frames, &[&of], stop)?;
        let all = replicates.into_iter().next().unwrap_or_default();
        let count = all.len();
        let some: Vec<f64> = all.into_iter().filter(|of| of.is_finite()).collect();
        share = some.len() as f64 / count.max(1) as f64;
        interval = resampling.percentiles_of(some);
    }
    Ok(Some(Handover { near, distance_m, interval, share, crossings_m: crossings(&whole) }))
}

/// The distance of the best single change, and what it costs (the sum of errors over that of the baseline alone);
/// `None` if either alone is as good.
fn best(curve: &Curve, near: Near) -> Option<(f64, f64)> {
    let all: f64 = curve.iter().map(|(_, difference, pixels)| difference * pixels).sum();
    let alone = all.min(0.0);
    let mut found: Option<(usize, f64)> = None;
    let mut nearer = 0.0;
    for (at, (_, difference, pixels)) in curve.iter().enumerate().take(curve.len().saturating_sub(1)) {
        nearer += difference * pixels;
        let cost = match near {
            Near::Baseline => all - nearer,
            Near::Other => nearer,
        };
        if cost < alone && found.is_none_or(|(_, least)| cost < least) {
            found = Some((at, cost));
        }
    }
    let (at, cost) = found?;
    Some((zero(curve[at], curve[at + 1])?, cost))
}

/// Where the line between two bins is zero; `None` where it is on one side of it.
fn zero(one: (f64, f64, f64), two: (f64, f64, f64)) -> Option<f64> {
    if one.1 == two.1 {
        return (one.1 == 0.0).then_some(0.5 * (one.0 + two.0));
    }
    let share = one.1 / (one.1 - two.1);
    (0.0..=1.0).contains(&share).then_some(one.0 + share * (two.0 - one.0))
}

fn crossings(curve: &Curve) -> Vec<f64> {
    let pairs = curve.windows(2).filter(|pair| pair[0].1 != 0.0 && pair[0].1.signum() != pair[1].1.signum());
    pairs.filter_map(|pair| zero(pair[0], pair[1])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(differences: &[f64]) -> Curve {
        differences.iter().enumerate().map(|(at, of)| (10.0 * at as f64 + 5.0, *of, 100.0)).collect()
    }

    #[test]
    fn the_handover_is_the_crossing_that_costs_least() {
        // The baseline is better near, the other far; one bin is noise.
        let of = curve(&[2.0, 1.0, -0.1, 0.2, -1.0, -3.0]);
        let (distance, cost) = best(&of, Near::Baseline).unwrap();
        assert!((distance - (35.0 + 10.0 * 0.2 / 1.2)).abs() < 1e-9, "{distance}");
        assert!((cost - -400.0).abs() < 1e-9, "{cost}");
        assert_eq!(best(&of, Near::Other), None, "the other near and the baseline far is worse than either alone");
        assert_eq!(crossings(&of).len(), 3);
        // The other way round.
        let turned: Vec<f64> = of.iter().map(|(_, difference, _)| -difference).collect();
        assert!((best(&curve(&turned), Near::Other).unwrap().0 - distance).abs() < 1e-9);
    }

    #[test]
    fn where_one_is_better_everywhere_there_is_none() {
        for differences in [&[1.0, 2.0, 3.0][..], &[-1.0, -2.0], &[], &[1.0]] {
            assert_eq!(best(&curve(differences), Near::Baseline), None);
            assert_eq!(best(&curve(differences), Near::Other), None);
        }
    }

    #[test]
    fn its_interval_is_of_resamples_that_have_one() {
        // Each frame has its own crossing, from 10 to 19.
        let of = |times: &[f64]| -> Curve {
            let all: f64 = times.iter().sum();
            let at = times.iter().enumerate().map(|(frame, times)| times * (10.0 + frame as f64)).sum::<f64>() / all;
            vec![(0.0, at, 500.0), (30.0, at - 30.0, 500.0)]
        };
        let resampling = Resampling { resamples: 500, ..Resampling::default() };
        let handover = found(&of, 10, &resampling, &|| false).unwrap().unwrap();
        let Interval { low, high } = handover.interval.unwrap();
        assert_eq!((handover.near, handover.share), (Near::Baseline, 1.0));
        assert!((handover.distance_m - 14.5).abs() < 1e-9 && low < 14.5 && 14.5 < high && high - low < 5.0);
    }
}
