//! The Pareto front: the rows that no other row dominates in all chosen columns.

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

/// A column of a front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Goal {
    pub(crate) better: Better,
    /// Values count as equal if they differ by at most this share of the smaller one: 0 for exact values, more for
    /// measured ones.
    pub(crate) noise: f64,
}

impl Goal {
    /// Whether `a` is better than `b`, by more than noise.
    fn is_better(self, a: f64, b: f64) -> bool {
        self.better.is_better(a, b) && (a - b).abs() > self.noise * a.abs().min(b.abs())
    }
}

/// The rows that no row of the front dominates, in their order. A row dominates another if it is worse in no column and
/// better in at least one. Equal rows do not dominate each other; of rows that differ only by noise, the better one
/// stays. A row that lacks a value is not on the front and dominates nothing.
pub(crate) fn front(rows: &[Vec<Option<f64>>], goals: &[Goal]) -> Vec<usize> {
    let complete = |row: &Vec<Option<f64>>| {
        let values: Option<Vec<f64>> = row.iter().copied().collect();
        values.filter(|values| values.iter().all(|value| value.is_finite()))
    };
    let values: Vec<Option<Vec<f64>>> = rows.iter().map(complete).collect();
    let dominates = |a: &[f64], b: &[f64]| {
        let pairs = || a.iter().zip(b).zip(goals);
        !pairs().any(|((a, b), goal)| goal.is_better(*b, *a))
            && pairs().any(|((a, b), goal)| goal.better.is_better(*a, *b))
    };
    // Sort by exact values first, best first: a row that dominates another comes before it, and only rows on the front
    // remove others. Otherwise a chain of rows, each as fast as the next within noise, would remove all except the
    // first.
    let compare = |a: &[f64], b: &[f64]| {
        let pairs = |is_exact: bool| {
            let all = a.iter().zip(b).zip(goals).filter(move |(_, goal)| (goal.noise == 0.0) == is_exact);
            all.map(|((a, b), goal)| if goal.better == Better::Less { a.total_cmp(b) } else { b.total_cmp(a) })
        };
        pairs(true).chain(pairs(false)).find(|ordering| ordering.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
    };
    let mut order: Vec<(usize, &Vec<f64>)> =
        values.iter().enumerate().filter_map(|(row, values)| Some((row, values.as_ref()?))).collect();
    order.sort_by(|(_, a), (_, b)| compare(a, b));
    let mut undominated: Vec<(usize, &Vec<f64>)> = Vec::new();
    for (row, values) in order {
        if !undominated.iter().any(|(_, other)| dominates(other, values)) {
            undominated.push((row, values));
        }
    }
    let mut front: Vec<usize> = undominated.into_iter().map(|(row, _)| row).collect();
    front.sort_unstable();
    front
}

/// The fronts of groups of rows. Rows of different groups cannot be compared.
pub(super) fn fronts(
    rows: usize,
    group: impl Fn(usize) -> Vec<Option<usize>>,
    values: impl Fn(usize) -> Vec<Option<f64>>,
    goals: &[Goal],
) -> Vec<usize> {
    let mut groups: BTreeMap<Vec<Option<usize>>, Vec<usize>> = BTreeMap::new();
    (0..rows).for_each(|row| groups.entry(group(row)).or_default().push(row));
    let mut found = Vec::new();
    for members in groups.into_values() {
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
    fn rows_that_are_faster_only_by_noise_are_not_on_the_front() {
        let points = rows(&[(0.10, 100.0), (0.11, 99.6), (0.12, 96.0), (0.13, 90.0), (0.14, 86.5), (0.10, 103.0)]);
        assert_eq!(front(&points, &[LESS, MEASURED]), [0, 3]);
        // Steps of 4 % each: those more than 5 % apart stay.
        let steps: Vec<(f64, f64)> = (0..8).map(|at| (0.1 + 0.01 * f64::from(at), 100.0 * 0.96_f64.powi(at))).collect();
        assert_eq!(front(&rows(&steps), &[LESS, MEASURED]), [0, 2, 4, 6]);
    }

    #[test]
    fn dominated_rows_are_not_on_the_front() {
        // By hand, less of both: 2 is beaten by 1, 4 by 3, and 5 has the least error of all.
        let points = rows(&[(0.30, 1.0), (0.20, 4.0), (0.25, 4.0), (0.15, 9.0), (0.15, 9.5), (0.10, 90.0)]);
        assert_eq!(front(&points, &[LESS, LESS]), [0, 1, 3, 5]);
        // More of the first, less of the second: the cheapest has the most of it.
        assert_eq!(front(&points, &[MORE, LESS]), [0]);
    }

    #[test]
    fn equal_rows_are_on_the_front_and_rows_without_a_value_are_not() {
        let mut points = rows(&[(1.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, f64::NAN)]);
        points.push(vec![Some(0.0), None]);
        assert_eq!(front(&points, &[LESS, LESS]), [0, 1]);
    }

    /// Against the definition written as a sort: by the first value, a point is on the front if its second is below all
    /// before it.
    #[test]
    fn a_thousand_points_match_a_sweep() {
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
