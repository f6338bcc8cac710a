//! Means by the level of an axis as they would be if every level stood beside the other axes' levels as all rows do.
//!
//! Where an ablation leaves combinations out, a level's plain mean is over other settings than that of its neighbour,
//! and compares these. Rows are therefore described by least squares as a sum of one number a level of every axis (main
//! effects, no interactions); the *adjusted mean* of a level is the mean of what this description gives of all rows,
//! were they of that level (least-squares means weighted by the rows there are: Searle, Speed and Milliken 1980,
//! `weights = "proportional"` of R's `emmeans`). In a full design it is the plain mean.

use super::factor::{Factor, are_orthogonal};

/// What is left of a column, in parts of its length, when those before it explain it.
const NOTHING: f64 = 1e-9;

/// By level of an axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum LevelMeans {
    /// The plain means: levels are compared over the same settings of the other axes.
    Plain,
    /// The adjusted means; `None` of a level without rows.
    Adjusted(Vec<Option<f64>>),
    /// The rows do not tell the axis from the others.
    Confounded,
}

/// The means of rows by level of an axis, adjusted for the other axes that all these rows have.
pub(crate) fn level_means(values: &[f64], focus: &Factor, others: &[&Factor]) -> LevelMeans {
    let rows: Vec<usize> = (0..values.len()).filter(|&row| focus.of_row[row].is_some()).collect();
    let among = |factor: &Factor| Factor {
        levels: factor.levels,
        of_row: rows.iter().map(|&row| factor.of_row[row]).collect(),
    };
    let focus = among(focus);
    let varies = |factor: &Factor| {
        let levels = present(factor).len();
        // An axis that not all of these rows have hangs on another one; and one with a level of its own for every row
        // explains anything.
        factor.of_row.iter().all(Option::is_some) && levels > 1 && levels < rows.len()
    };
    let others: Vec<Factor> = others.iter().map(|factor| among(factor)).filter(varies).collect();
    if others.iter().all(|other| are_orthogonal(&focus, other)) {
        return LevelMeans::Plain;
    }
    let values: Vec<f64> = rows.iter().map(|&row| values[row]).collect();
    let levels = present(&focus);
    let Some(effects) = effects_of(&values, &focus, &levels, &others) else { return LevelMeans::Confounded };
    let count = values.len() as f64;
    let of_levels = focus.of_row.iter().flatten().map(|level| effects[*level].unwrap_or(0.0));
    let base = (values.iter().sum::<f64>() - of_levels.sum::<f64>()) / count;
    LevelMeans::Adjusted(effects.into_iter().map(|effect| effect.map(|effect| base + effect)).collect())
}

/// The levels that rows have, ascending.
fn present(factor: &Factor) -> Vec<usize> {
    let mut levels: Vec<usize> = factor.of_row.iter().copied().flatten().collect();
    levels.sort_unstable();
    levels.dedup();
    levels
}

/// By level of the axis, its number of the least-squares description, less that of the first; `None` where the others
/// explain a level.
fn effects_of(values: &[f64], focus: &Factor, levels: &[usize], others: &[Factor]) -> Option<Vec<Option<f64>>> {
    let column = |factor: &Factor, level: usize| -> Vec<f64> {
        factor.of_row.iter().map(|of| f64::from(u8::from(*of == Some(level)))).collect()
    };
    // Gram-Schmidt: the axis comes last, so that what is left of it is what the others do not explain.
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let mut add = |mut column: Vec<f64>| -> Option<Vec<f64>> {
        let whole = dot(&column, &column).sqrt();
        let mut shares = vec![0.0; basis.len()];
        // Twice, for what rounding left.
        for _ in 0..2 {
            for (share, of) in shares.iter_mut().zip(&basis) {
                let part = dot(&column, of);
                column.iter_mut().zip(of).for_each(|(value, of)| *value -= part * of);
                *share += part;
            }
        }
        let left = dot(&column, &column).sqrt();
        if left <= NOTHING * whole {
            return None;
        }
        column.iter_mut().for_each(|value| *value /= left);
        basis.push(column);
        shares.push(left);
        Some(shares)
    };
    add(vec![1.0; values.len()])?;
    for other in others {
        for level in present(other).into_iter().skip(1) {
            // A column that those before it explain adds nothing.
            let _ = add(column(other, level));
        }
    }
    let own: Vec<Vec<f64>> = levels.iter().skip(1).map(|&level| add(column(focus, level))).collect::<Option<_>>()?;
    // From the last column back: what its direction holds of the values, less what later columns put there.
    let first = basis.len() - own.len();
    let mut found = vec![0.0; own.len()];
    for at in (0..own.len()).rev() {
        let later: f64 = (at + 1..own.len()).map(|later| found[later] * own[later][first + at]).sum();
        found[at] = (dot(values, &basis[first + at]) - later) / own[at][first + at];
    }
    let mut effects = vec![None; focus.levels];
    effects[levels[0]] = Some(0.0);
    levels.iter().skip(1).zip(found).for_each(|(&level, effect)| effects[level] = Some(effect));
    Some(effects)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factor(of_row: impl IntoIterator<Item = usize>) -> Factor {
        let of_row: Vec<Option<usize>> = of_row.into_iter().map(Some).collect();
        Factor { levels: 1 + of_row.iter().flatten().max().unwrap(), of_row }
    }

    /// Thirteen of eighteen combinations of three axes. NumPy 2.4: with `X = np.c_[np.ones(13), dummies(focus),
    /// *map(dummies, others)]` and `beta = np.linalg.lstsq(X, v)[0]`, the mean of `X_level @ beta`, `X_level` being
    /// X with all rows of that level.
    #[test]
    fn means_of_a_design_with_holes_are_numpys() {
        let rows = [
            [0, 0, 0],
            [0, 0, 1],
            [0, 1, 0],
            [0, 1, 1],
            [1, 0, 0],
            [1, 0, 1],
            [1, 1, 0],
            [1, 1, 1],
            [1, 2, 0],
            [2, 1, 0],
            [2, 1, 1],
            [2, 2, 0],
            [2, 2, 1],
        ];
        let values =
            [0.3041, 0.3049, 0.3608, 0.3689, 0.2891, 0.2996, 0.346, 0.3595, 0.4083, 0.3466, 0.3505, 0.3993, 0.4094];
        let axis = |at: usize| factor(rows.iter().map(move |row| row[at]));
        let axes = [axis(0), axis(1), axis(2)];
        let numpy: [&[f64]; 3] = [
            &[0.359_037_483_702_737_9, 0.348_234_941_329_856_44, 0.342_418_839_634_941_5],
            &[0.295_265_645_371_577_73, 0.354_963_102_998_696_43, 0.412_052_933_507_171],
            &[0.346_260_756_192_959_76, 0.353_862_451_108_213_96],
        ];
        for (at, expected) in numpy.into_iter().enumerate() {
            let others: Vec<&Factor> = axes.iter().enumerate().filter(|(of, _)| *of != at).map(|(_, of)| of).collect();
            let LevelMeans::Adjusted(means) = level_means(&values, &axes[at], &others) else { panic!("adjusted") };
            for (mean, expected) in means.iter().zip(expected) {
                assert!((mean.unwrap() - expected).abs() < 1e-12, "{means:?}");
            }
        }
        // Their plain means say the opposite: 0.335, 0.341, 0.376.
    }

    #[test]
    fn a_full_design_keeps_its_plain_means_and_an_axis_that_goes_with_another_has_none() {
        let (a, b) = (factor([0, 0, 1, 1]), factor([0, 1, 0, 1]));
        assert_eq!(level_means(&[1.0, 2.0, 3.0, 6.0], &a, &[&b]), LevelMeans::Plain);
        let other = factor([1, 1, 0, 0]);
        assert_eq!(level_means(&[1.0, 2.0, 3.0, 6.0], &a, &[&b, &other]), LevelMeans::Confounded);
    }

    #[test]
    fn axes_that_only_some_rows_have_do_not_adjust_those_they_hang_on() {
        let a = factor([0, 0, 1, 1]);
        let nested = Factor { levels: 2, of_row: vec![None, None, Some(0), Some(1)] };
        assert_eq!(level_means(&[1.0, 2.0, 3.0, 6.0], &a, &[&nested]), LevelMeans::Plain);
        assert_eq!(level_means(&[1.0, 2.0, 3.0, 6.0], &nested, &[&a]), LevelMeans::Plain);
    }
}
