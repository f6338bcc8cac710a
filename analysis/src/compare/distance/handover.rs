//! The handover distance of two estimates: use one estimate nearer than this distance, and the other beyond it.
//!
//! The difference of their errors by distance is a line through the middles of bins. At each zero crossing the better
//! estimate changes. Noisy errors may have many crossings. The *handover* is the crossing with the lowest cost: with
//! one estimate nearer and the other farther, the sum of errors over all pixels is the smallest, and smaller than with
//! either estimate alone.

use crate::error::AnalysisError;
use crate::statistics::{Interval, Resampling};

/// The estimate that is better at near distances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Near {
    Baseline,
    Other,
}

/// The handover distance of two estimates.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Handover {
    /// The estimate that is better nearer than the handover.
    pub(crate) near: Near,
    pub(crate) distance_m: f64,
    /// The percentile interval over the resamples that have such a handover.
    pub(crate) interval: Option<Interval>,
    /// The share of resamples that have a handover.
    pub(crate) share: f64,
    /// All distances at which the difference crosses zero.
    pub(crate) crossings_m: Vec<f64>,
}

/// The bins of a curve, near bins first: middle, difference (other minus baseline), pixels.
type Curve = Vec<(f64, f64, f64)>;

/// The handover of the curve, with its interval. `curve` computes the curve for given weights of frames.
pub(super) fn handover(
    curve: &(dyn Fn(&[f64]) -> Curve + Sync),
    frames: usize,
    resampling: &Resampling,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Option<Handover>, AnalysisError> {
    let all_frames = curve(&vec![1.0; frames]);
    let candidates = [Near::Baseline, Near::Other].map(|near| (near, best(&all_frames, near)));
    let better = candidates.into_iter().filter_map(|(near, found)| Some((near, found?)));
    let Some((near, (distance_m, _))) = better.reduce(|one, two| if two.1.1 < one.1.1 { two } else { one }) else {
        return Ok(None);
    };
    let (mut interval, mut share) = (None, 1.0);
    if frames > 1 {
        let distance = |times: &[f64]| best(&curve(times), near).map_or(f64::NAN, |(distance, _)| distance);
        let replicates = resampling.replicates(frames, &[&distance], stop)?;
        let all = replicates.into_iter().next().unwrap_or_default();
        let count = all.len();
        let some: Vec<f64> = all.into_iter().filter(|replicate| replicate.is_finite()).collect();
        share = some.len() as f64 / count.max(1) as f64;
        interval = resampling.percentiles_of(some);
    }
    Ok(Some(Handover { near, distance_m, interval, share, crossings_m: crossings(&all_frames) }))
}

/// The distance of the best single change, and its cost: the sum of errors minus that of the baseline alone. `None` if
/// one estimate alone is as good.
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

/// The zero of the line between two bins; `None` if the line does not cross zero.
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
        let bin = |(at, difference): (usize, &f64)| (10.0 * at as f64 + 5.0, *difference, 100.0);
        differences.iter().enumerate().map(bin).collect()
    }

    #[test]
    fn the_handover_is_the_crossing_with_the_lowest_cost() {
        // The baseline is better near, the other far; one bin is noise.
        let differences = curve(&[2.0, 1.0, -0.1, 0.2, -1.0, -3.0]);
        let (distance, cost) = best(&differences, Near::Baseline).unwrap();
        assert!((distance - (35.0 + 10.0 * 0.2 / 1.2)).abs() < 1e-9, "{distance}");
        assert!((cost - -400.0).abs() < 1e-9, "{cost}");
        assert_eq!(
            best(&differences, Near::Other),
            None,
            "the other near and the baseline far is worse than either alone"
        );
        assert_eq!(crossings(&differences).len(), 3);
        // Reversed.
        let turned: Vec<f64> = differences.iter().map(|(_, difference, _)| -difference).collect();
        assert!((best(&curve(&turned), Near::Other).unwrap().0 - distance).abs() < 1e-9);
    }

    #[test]
    fn an_estimate_that_is_better_everywhere_has_no_handover() {
        for differences in [&[1.0, 2.0, 3.0][..], &[-1.0, -2.0], &[], &[1.0]] {
            assert_eq!(best(&curve(differences), Near::Baseline), None);
            assert_eq!(best(&curve(differences), Near::Other), None);
        }
    }

    #[test]
    fn the_interval_covers_resamples_with_a_handover() {
        // Each frame has its own crossing, from 10 to 19.
        let weighted = |times: &[f64]| -> Curve {
            let all: f64 = times.iter().sum();
            let at = times.iter().enumerate().map(|(frame, times)| times * (10.0 + frame as f64)).sum::<f64>() / all;
            vec![(0.0, at, 500.0), (30.0, at - 30.0, 500.0)]
        };
        let resampling = Resampling { resamples: 500, ..Resampling::default() };
        let handover = handover(&weighted, 10, &resampling, &|| false).unwrap().unwrap();
        let Interval { low, high } = handover.interval.unwrap();
        assert_eq!((handover.near, handover.share), (Near::Baseline, 1.0));
        assert!((handover.distance_m - 14.5).abs() < 1e-9 && low < 14.5 && 14.5 < high && high - low < 5.0);
    }
}
