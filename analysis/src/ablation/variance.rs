//! The effect of each axis on a metric: marginal means and shares of the variance.
//!
//! The rows of an ablation are an unreplicated factorial design: one value per combination of levels. The *marginal
//! mean* of a level is the mean of all rows that have it, [adjusted](super::adjusted) if combinations are missing. An
//! axis' *share* is eta squared of its main effect, `sum over levels of n (mean of the level - mean)^2 / sum over rows
//! of (value - mean)^2` (Fisher 1925; Cohen 1973): the part of the variance between rows that this axis alone explains.
//! If all pairs of axes are orthogonal, shares add up and the rest belongs to interactions. Otherwise shares overlap.
//!
//! An axis that only some rows have is nested in others. Its effect is computed among those rows, relative to their own
//! mean, so that it does not include the effect of the outer axis. Its share is a share of the variance between all
//! rows, like every other share.

use super::adjusted::{LevelMeans, level_means};
use super::factor::{Factor, are_orthogonal, is_full};

/// The main effects on a value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Effects {
    /// The mean over all rows.
    pub(crate) mean: f64,
    /// The rows' standard deviation (of a population: over their number).
    pub(crate) deviation: f64,
    /// One effect per factor, in their order.
    pub(crate) factors: Vec<MainEffect>,
    /// Whether all pairs of axes are orthogonal: their levels are combined in equal proportions.
    pub(crate) is_orthogonal: bool,
    /// The share that no main effect explains: that of the interactions. `None` if shares overlap or rows do not
    /// differ.
    pub(crate) residual: Option<f64>,
    /// For each pair of factors, the share of their interaction, largest first. Empty unless all combinations of levels
    /// occur equally often.
    pub(crate) pairs: Vec<(usize, usize, f64)>,
}

/// What one axis explains.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MainEffect {
    /// For each level, the number of rows and their mean, adjusted if levels do not have the same settings of other
    /// axes. The mean is `None` without rows.
    pub(crate) levels: Vec<(usize, Option<f64>)>,
    /// How the means were computed.
    pub(crate) means: MeansOf,
    /// The mean over the rows that have the axis.
    pub(crate) mean: f64,
    /// Eta squared. `None` if rows do not differ, or if each row has its own level, which would explain anything.
    pub(crate) share: Option<f64>,
}

/// How the means of levels were computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MeansOf {
    /// Plain means: levels are compared over the same settings of the other axes.
    Rows,
    /// Least-squares means, because levels have different settings of the other axes.
    LeastSquares,
    /// Plain means that cannot be compared: the axis cannot be separated from the others.
    Confounded,
}

/// The effects of factors on the values of rows. `values` must be finite and not empty, and each factor must have a
/// level in at least one row.
pub(crate) fn effects(values: &[f64], factors: &[Factor]) -> Effects {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let spread = values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>();
    // Differences that are only rounding errors do not count.
    let largest = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let differ = spread > count * (1e-12 * largest) * (1e-12 * largest);
    let share = |levels: &[Option<usize>], of: usize| {
        let groups = group(values, levels, of);
        let mean = mean_of(&groups);
        let between = groups.into_iter().map(|(rows, sum)| {
            let apart = if rows == 0 { 0.0 } else { sum / rows as f64 - mean };
            rows as f64 * apart * apart
        });
        (between.sum::<f64>() / spread).clamp(0.0, 1.0)
    };
    let main = factors.iter().map(|factor| {
        let groups = group(values, &factor.of_row, factor.levels);
        let single = groups.iter().all(|(rows, _)| *rows <= 1);
        let mean = mean_of(&groups);
        let plain = groups.into_iter().map(|(rows, sum)| (rows, (rows > 0).then(|| sum / rows as f64)));
        let mut levels: Vec<(usize, Option<f64>)> = plain.collect();
        let others: Vec<&Factor> = factors.iter().filter(|other| !std::ptr::eq(*other, factor)).collect();
        let means = match level_means(values, factor, &others) {
            LevelMeans::Plain => MeansOf::Rows,
            LevelMeans::Confounded => MeansOf::Confounded,
            LevelMeans::Adjusted(means) => {
                levels.iter_mut().zip(means).for_each(|(level, mean)| level.1 = mean);
                MeansOf::LeastSquares
            }
        };
        let share = (differ && !single).then(|| share(&factor.of_row, factor.levels));
        MainEffect { levels, means, mean, share }
    });
    let main: Vec<MainEffect> = main.collect();
    let is_orthogonal = (0..factors.len()).all(|a| (0..a).all(|b| are_orthogonal(&factors[a], &factors[b])));
    let shares: Option<f64> = main.iter().map(|effect| effect.share).sum();
    let residual = shares.filter(|_| is_orthogonal).map(|shares| (1.0 - shares).max(0.0));
    let mut pairs = Vec::new();
    if differ && is_full(factors, values.len()) {
        for (a, first) in factors.iter().enumerate() {
            for (b, second) in factors.iter().enumerate().skip(a + 1) {
                let cell = |(a, b): (&Option<usize>, &Option<usize>)| Some((*a)? * second.levels + (*b)?);
                let cells: Vec<Option<usize>> = first.of_row.iter().zip(&second.of_row).map(cell).collect();
                let both = share(&cells, first.levels * second.levels);
                let alone = main[a].share.unwrap_or(0.0) + main[b].share.unwrap_or(0.0);
                pairs.push((a, b, (both - alone).max(0.0)));
            }
        }
    }
    pairs.sort_by(|a, b| b.2.total_cmp(&a.2));
    Effects { mean, deviation: (spread / count).sqrt(), factors: main, is_orthogonal, residual, pairs }
}

/// The number of values in each group, and their sum.
fn group(values: &[f64], of_row: &[Option<usize>], groups: usize) -> Vec<(usize, f64)> {
    let mut sums = vec![(0, 0.0); groups];
    for (value, group) in values.iter().zip(of_row) {
        if let Some(group) = *group {
            sums[group].0 += 1;
            sums[group].1 += value;
        }
    }
    sums
}

/// The mean of all values in groups.
fn mean_of(groups: &[(usize, f64)]) -> f64 {
    let (count, sum) = groups.iter().fold((0, 0.0), |(count, sum), (rows, of)| (count + rows, sum + of));
    sum / count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factor(of_row: &[usize]) -> Factor {
        nested(&of_row.iter().map(|level| Some(*level)).collect::<Vec<_>>())
    }

    /// A factor that only some rows have.
    fn nested(of_row: &[Option<usize>]) -> Factor {
        Factor { levels: of_row.iter().flatten().max().map_or(0, |last| last + 1), of_row: of_row.to_vec() }
    }

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-12, "{a} {b}");
    }

    fn share(effects: &Effects, factor: usize) -> f64 {
        effects.factors[factor].share.unwrap()
    }

    /// By hand: values 1, 2, 3, 6 have mean 3 and squares 4 + 1 + 0 + 9 = 14. The first axis' means are 1.5 and
    /// 4.5, its sum of squares 2 (1.5^2 + 1.5^2) = 9; the second's 2 and 4, 2 (1 + 1) = 4; the interaction has the
    /// rest, 1.
    #[test]
    fn effects_of_a_two_by_two_design_match_hand_computation() {
        let effects = effects(&[1.0, 2.0, 3.0, 6.0], &[factor(&[0, 0, 1, 1]), factor(&[0, 1, 0, 1])]);
        assert_eq!(effects.mean, 3.0);
        near(effects.deviation, 3.5_f64.sqrt());
        assert_eq!(effects.factors[0].levels, [(2, Some(1.5)), (2, Some(4.5))]);
        assert_eq!(effects.factors[1].levels, [(2, Some(2.0)), (2, Some(4.0))]);
        near(share(&effects, 0), 9.0 / 14.0);
        near(share(&effects, 1), 4.0 / 14.0);
        near(effects.residual.unwrap(), 1.0 / 14.0);
        let [(0, 1, interaction)] = effects.pairs[..] else { panic!("{:?}", effects.pairs) };
        near(interaction, 1.0 / 14.0);
    }

    /// NumPy 2.4:
    /// ```python
    /// v = np.array([.213, .198, .305, .251, .187, .190, .402, .333, .220, .214, .316, .299]).reshape(3, 2, 2)
    /// ss = lambda m: ((m - v.mean()) ** 2 * np.ones_like(v)).sum() / ((v - v.mean()) ** 2).sum()
    /// a, b, c = [v.mean(axis=tuple(set(range(3)) - {i}), keepdims=True) for i in range(3)]
    /// ab, ac, bc = [v.mean(axis=i, keepdims=True) for i in (2, 1, 0)]
    /// ss(a), ss(b), ss(c), ss(ab) - ss(a) - ss(b), ss(ac) - ss(a) - ss(c), ss(bc) - ss(b) - ss(c)
    /// ```
    #[test]
    fn effects_of_a_full_design_equal_numpy() {
        let values = [0.213, 0.198, 0.305, 0.251, 0.187, 0.190, 0.402, 0.333, 0.220, 0.214, 0.316, 0.299];
        let a = factor(&[0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2]);
        let b = factor(&[0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1]);
        let c = factor(&[0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1]);
        let effects = effects(&values, &[a, b, c]);
        near(effects.mean, 0.260_666_666_666_666_66);
        let shares = [0.050_588_212_777_359_615, 0.746_200_859_990_048_3, 0.039_816_008_064_001_84];
        for (factor, expected) in shares.into_iter().enumerate() {
            near(share(&effects, factor), expected);
        }
        near(effects.residual.unwrap(), 1.0 - shares.iter().sum::<f64>());
        assert_eq!(effects.pairs.len(), 3);
        let pairs =
            [(0, 1, 0.124_395_518_864_914_84), (1, 2, 0.023_739_042_782_590_238), (0, 2, 0.006_338_279_764_714_592_5)];
        for (&(a, b, share), (numpy_a, numpy_b, numpy)) in effects.pairs.iter().zip(pairs) {
            assert_eq!((a, b), (numpy_a, numpy_b));
            near(share, numpy);
        }
    }

    /// By hand: of rows (0, 0): 1, (0, 1): 2, (1, 1): 6 the mean is 3, and the squares are 4 + 1 + 9 = 14. The first
    /// axis' means are 1.5 and 6: 2 * 1.5^2 + 3^2 = 13.5; the second's 1 and 4: 2^2 + 2 * 1^2 = 6. They overlap: 19.5
    /// of 14.
    #[test]
    fn shares_of_an_incomplete_design_overlap_without_a_residual() {
        let effects = effects(&[1.0, 2.0, 6.0], &[factor(&[0, 0, 1]), factor(&[0, 1, 1])]);
        assert!(!effects.is_orthogonal);
        near(share(&effects, 0), 13.5 / 14.0);
        near(share(&effects, 1), 6.0 / 14.0);
        assert_eq!((effects.residual, effects.pairs.len()), (None, 0));
    }

    /// By hand: `a` has means 2 (of 1, 3) and 6 (of 5, 7), a sum of squares of 4 * 2^2 = 16 of 20. Only rows with level
    /// 1 of `a` have `b`: among 5 and 7 it explains 1 + 1 = 2 of 20, relative to their own mean 6. The residual, 2, is
    /// between the rows of the first level.
    #[test]
    fn nested_axes_are_compared_among_their_rows_only() {
        let effects = effects(&[1.0, 3.0, 5.0, 7.0], &[factor(&[0, 0, 1, 1]), nested(&[None, None, Some(0), Some(1)])]);
        assert!(effects.is_orthogonal);
        near(share(&effects, 0), 16.0 / 20.0);
        assert_eq!(
            (effects.factors[1].mean, effects.factors[1].levels.clone()),
            (6.0, vec![(1, Some(5.0)), (1, Some(7.0))])
        );
        assert_eq!(effects.factors[1].share, None, "every row that has it has a level of its own");
        let twice: Vec<f64> = [1.0, 3.0, 5.0, 7.0].repeat(2);
        let b = nested(&[None, None, Some(0), Some(1)].repeat(2));
        let effects = super::effects(&twice, &[factor(&[0, 0, 1, 1, 0, 0, 1, 1]), b]);
        near(share(&effects, 1), 2.0 / 20.0);
        near(effects.residual.unwrap(), 2.0 / 20.0);
        assert!(effects.pairs.is_empty());
    }

    /// Half of a 2^3 design, in which the third axis is the interaction of the other two: orthogonal, but without
    /// separable interactions.
    #[test]
    fn half_a_design_has_no_interactions() {
        let axes = [factor(&[0, 0, 1, 1]), factor(&[0, 1, 0, 1]), factor(&[0, 1, 1, 0])];
        let effects = effects(&[1.0, 2.0, 3.0, 6.0], &axes);
        assert!(effects.is_orthogonal);
        near(share(&effects, 2), 1.0 / 14.0);
        near(effects.residual.unwrap(), 0.0);
        assert!(effects.pairs.is_empty());
    }

    #[test]
    fn an_axis_with_one_level_per_row_has_no_share() {
        let effects = effects(&[1.0, 2.0, 6.0], &[factor(&[0, 1, 2]), factor(&[0, 0, 1])]);
        assert_eq!(effects.factors[0].share, None);
        assert_eq!(effects.factors[0].levels, [(1, Some(1.0)), (1, Some(2.0)), (1, Some(6.0))]);
        near(share(&effects, 1), 13.5 / 14.0);
        assert_eq!(effects.residual, None);
    }

    #[test]
    fn rows_that_do_not_differ_have_no_shares() {
        let effects = effects(&[0.1 + 0.2, 0.3, 0.3, 0.3], &[factor(&[0, 0, 1, 1]), factor(&[0, 1, 0, 1])]);
        assert!(effects.factors.iter().all(|effect| effect.share.is_none()));
        assert_eq!((effects.residual, effects.pairs.len()), (None, 0));
    }
}
