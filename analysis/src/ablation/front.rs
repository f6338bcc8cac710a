//! The Pareto front: what nothing else beats in everything asked for.

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

/// The rows that no other row dominates, in their order. One dominates another if it is nowhere worse and somewhere better; equal rows
/// dominate neither. A row that lacks one of the values is not on the front and dominates none.
pub(crate) fn front(rows: &[Vec<Option<f64>>], better: &[Better]) -> Vec<usize> {
    let whole = |row: &[Option<f64>]| row.iter().copied().collect::<Option<Vec<f64>>>();
    let whole = |row: &Vec<Option<f64>>| whole(row).filter(|row| row.iter().all(|value| value.is_finite()));
    let values: Vec<Option<Vec<f64>>> = rows.iter().map(whole).collect();
    let dominates = |a: &[f64], b: &[f64]| {
        let pairs = || a.iter().zip(b).zip(better);
        !pairs().any(|((a, b), better)| better.is_better(*b, *a))
            && pairs().any(|((a, b), better)| better.is_better(*a, *b))
    };
    let on_front = |row: &Vec<f64>| !values.iter().flatten().any(|other| dominates(other, row));
    (0..rows.len()).filter(|&row| values[row].as_ref().is_some_and(on_front)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(values: &[(f64, f64)]) -> Vec<Vec<Option<f64>>> {
        values.iter().map(|&(a, b)| vec![Some(a), Some(b)]).collect()
    }

    #[test]
    fn what_is_beaten_in_everything_is_not_on_the_front() {
        // By hand, less of both: 2 is beaten by 1, 4 by 3, and 5 has the least error of all.
        let points = rows(&[(0.30, 1.0), (0.20, 4.0), (0.25, 4.0), (0.15, 9.0), (0.15, 9.5), (0.10, 90.0)]);
        assert_eq!(front(&points, &[Better::Less, Better::Less]), [0, 1, 3, 5]);
        // More of the first, less of the second: the cheapest has the most of it.
        assert_eq!(front(&points, &[Better::More, Better::Less]), [0]);
    }

    #[test]
    fn equals_are_both_on_the_front_and_what_lacks_a_value_is_not() {
        let mut points = rows(&[(1.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, f64::NAN)]);
        points.push(vec![Some(0.0), None]);
        assert_eq!(front(&points, &[Better::Less, Better::Less]), [0, 1]);
    }

    /// Against the definition written as a sort: by the first value, a point is on the front if its second is below all before it.
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
        assert_eq!(front(&rows(&points), &[Better::Less, Better::Less]), swept);
    }
}
