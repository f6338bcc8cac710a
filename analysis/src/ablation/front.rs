//! The Pareto front: what nothing else beats in everything asked for.

use std::collections::BTreeMap;

/// Whether less or more of a value is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Better {
    Less,
    More,
}

impl Better {
    /// Whether `a` is better than `b`.
    pub(crate) fn is_better(self, a: f64, b: f64) -> bool {
        match self {
            Self::Less => a < b,
            Self::More => a > b,
        }
    }
}

/// What a front is of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Goal {
    pub(crate) better: Better,
    /// Values that differ by no more than this share of the smaller one are equal: 0 of what is exact, more of what is
    /// measured.
    pub(crate) noise: f64,
}

impl Goal {
    /// Whether `a` is better than `b`, by more than noise.
    fn is_better(self, a: f64, b: f64) -> bool {
        self.better.is_better(a, b) && (a - b).abs() > self.noise * a.abs().min(b.abs())
    }
}

/// The rows that no row of the front dominates, in their order. One dominates another if it is nowhere worse and
/// somewhere better; equal rows dominate neither, of those that differ by noise alone the better one stays. A row that
/// lacks one of the values is not on the front and dominates none.
pub(crate) fn front(rows: &[Vec<Option<f64>>], goals: &[Goal]) -> Vec<usize> {
    let whole = |row: &[Option<f64>]| row.iter().copied().collect::<Option<Vec<f64>>>();
    let whole = |row: &Vec<Option<f64>>| whole(row).filter(|row| row.iter().all(|value| value.is_finite()));
    let values: Vec<Option<Vec<f64>>> = rows.iter().map(whole).collect();
    let dominates = |a: &[f64], b: &[f64]| {
        let pairs = || a.iter().zip(b).zip(goals);
        !pairs().any(|((a, b), goal)| goal.is_better(*b, *a))
            && pairs().any(|((a, b), goal)| goal.better.is_better(*a, *b))
    };
    // Exact values first, best first: what dominates a row comes before it, and stays itself unless it is dominated.
    // Otherwise a chain of rows, each as fast as the next but for noise, would remove all but the first.
    let order_of = |a: &[f64], b: &[f64]| {
        let pairs = |is_exact: bool| {
            let all = a.iter().zip(b).zip(goals).filter(move |(_, goal)| (goal.noise == 0.0) == is_exact);
            all.map(|((a, b), goal)| if goal.better == Better::Less { a.total_cmp(b) } else { b.total_cmp(a) })
        };
        pairs(true).chain(pairs(false)).find(|of| of.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
    };
    let mut order: Vec<(usize, &Vec<f64>)> =
        values.iter().enumerate().filter_map(|(row, of)| Some((row, of.as_ref()?))).collect();
    order.sort_by(|(_, a), (_, b)| order_of(a, b));
    let mut kept: Vec<(usize, &Vec<f64>)> = Vec::new();
    for (row, of) in order {
        if !kept.iter().any(|(_, other)| dominates(other, of)) {
            kept.push((row, of));
        }
    }
    let mut front: Vec<usize> = kept.into_iter().map(|(row, _)| row).collect();
    front.sort_unstable();
    front
}

/// The front of each kind of rows: rows of two kinds cannot be compared.
pub(super) fn fronts(
    rows: usize,
    kind: impl Fn(usize) -> Vec<Option<usize>>,
    values: impl Fn(usize) -> Vec<Option<f64>>,
    goals: &[Goal],
) -> Vec<usize> {
    let mut kinds: BTreeMap<Vec<Option<usize>>, Vec<usize>> = BTreeMap::new();
    (0..rows).for_each(|row| kinds.entry(kind(row)).or_default().push(row));
    let mut found = Vec::new();
    for members in kinds.into_values() {
        let values: Vec<Vec<Option<f64>>> = members.iter().map(|row| values(*row)).collect();
        found.extend(front(&values, goals).into_iter().map(|place| members[place]));
    }
    found.sort_unstable();
    found
}

/// Sorts rows by a value, best first; those without one come last, equals stay in their order.
pub(super) fn sort_best_first(order: &mut [usize], better: Better, value: impl Fn(usize) -> Option<f64>) {
    let value = |row: &usize| value(*row).filter(|value| !value.is_nan());
    order.sort_by(|a, b| match (value(a), value(b)) {
        (Some(a), Some(b)) if better == Better::More => b.total_cmp(&a),
        (Some(a), Some(b)) => a.total_cmp(&b),
        (a, b) => a.is_none().cmp(&b.is_none()),
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(values: &[(f64, f64)]) -> Vec<Vec<Option<f64>>> {
        values.iter().map(|&(a, b)| vec![Some(a), Some(b)]).collect()
    }

    const LESS: Goal = Goal { better: Better::Less, noise: 0.0 };
    const MORE: Goal = Goal { better: Better::More, noise: 0.0 };
    const MEASURED: Goal = Goal { better: Better::Less, noise: 0.05 };

    /// By hand: 0.10 in 100 ms; 0.11 in 99.6 ms is as fast and worse; 0.12 in 96 is as fast as the first; 0.13 in 90 is
    /// 11 % faster than it; 0.14 in 86.5 is as fast as that; 0.10 in 103 ms is as good and as fast as the first.
    #[test]
    fn what_is_faster_by_noise_alone_is_not_on_the_front_and_what_is_faster_by_more_is() {
        let points = rows(&[(0.10, 100.0), (0.11, 99.6), (0.12, 96.0), (0.13, 90.0), (0.14, 86.5), (0.10, 103.0)]);
        assert_eq!(front(&points, &[LESS, MEASURED]), [0, 3]);
        // Steps of 4 % each: those more than 5 % apart stay.
        let steps: Vec<(f64, f64)> = (0..8).map(|at| (0.1 + 0.01 * f64::from(at), 100.0 * 0.96_f64.powi(at))).collect();
        assert_eq!(front(&rows(&steps), &[LESS, MEASURED]), [0, 2, 4, 6]);
    }

    #[test]
    fn what_is_beaten_in_everything_is_not_on_the_front() {
        // By hand, less of both: 2 is beaten by 1, 4 by 3, and 5 has the least error of all.
        let points = rows(&[(0.30, 1.0), (0.20, 4.0), (0.25, 4.0), (0.15, 9.0), (0.15, 9.5), (0.10, 90.0)]);
        assert_eq!(front(&points, &[LESS, LESS]), [0, 1, 3, 5]);
        // More of the first, less of the second: the cheapest has the most of it.
        assert_eq!(front(&points, &[MORE, LESS]), [0]);
    }

    #[test]
    fn equals_are_both_on_the_front_and_what_lacks_a_value_is_not() {
        let mut points = rows(&[(1.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, f64::NAN)]);
        points.push(vec![Some(0.0), None]);
        assert_eq!(front(&points, &[LESS, LESS]), [0, 1]);
    }

    /// Against the definition written as a sort: by the first value, a point is on the front if its second is below all
    /// before it.
    #[test]
    fn a_thousand_points_are_as_a_sweep_finds_them() {
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64
        };
        let points: Vec<(f64, f64)> = (0..1000).map(|_| (next(), next())).collect();
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|&a, &b| points[a].partial_cmp(&points[b]).unwrap());
        let mut least = f64::INFINITY;
        let mut swept: Vec<usize> = Vec::new();
        for point in order {
            if points[point].1 < least {
                least = points[point].1;
                swept.push(point);
            }
        }
        swept.sort_unstable();
        assert_eq!(front(&rows(&points), &[LESS, LESS]), swept);
    }
}
