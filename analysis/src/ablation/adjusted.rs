//! Means of the levels of an axis, adjusted to the same mix of levels of the other axes.
//!
//! If an ablation omits combinations, the plain means of two levels average over different settings, so their
//! difference also contains the effect of those settings. A least-squares model therefore describes each row as a sum
//! of one number per level of every axis (main effects, no interactions). The *adjusted mean* of a level is the mean of
//! the model's values for all rows, with that level in place of their own. These are least-squares means weighted by
//! the existing rows: Searle, Speed and Milliken 1980, `weights = "proportional"` of R's `emmeans`. In a full design
//! the adjusted mean equals the plain mean.

use super::factor::{Factor, are_orthogonal};

/// A column counts as explained by earlier columns if its residual is below this share of its length.
const NEGLIGIBLE: f64 = 1e-9;

/// The means of the levels of an axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum LevelMeans {
    /// The plain means: levels are compared over the same settings of the other axes.
    Plain,
    /// The adjusted means; `None` for a level without rows.
    Adjusted(Vec<Option<f64>>),
    /// The effect of the axis cannot be separated from the other axes.
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
        // An axis that only some of these rows have depends on another axis. An axis with a different level in every
        // row explains anything.
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
    let row_effects = focus.of_row.iter().flatten().map(|level| effects[*level].unwrap_or(0.0));
    let base = (values.iter().sum::<f64>() - row_effects.sum::<f64>()) / count;
    LevelMeans::Adjusted(effects.into_iter().map(|effect| effect.map(|effect| base + effect)).collect())
}

/// The levels that rows have, ascending.
fn present(factor: &Factor) -> Vec<usize> {
    let mut levels: Vec<usize> = factor.of_row.iter().copied().flatten().collect();
    levels.sort_unstable();
    levels.dedup();
    levels
}

/// The effect of each level in the least-squares model, relative to the first level. `None` if the other axes explain a
/// level.
fn effects_of(values: &[f64], focus: &Factor, levels: &[usize], others: &[Factor]) -> Option<Vec<Option<f64>>> {
    let column = |factor: &Factor, level: usize| -> Vec<f64> {
        factor.of_row.iter().map(|own| f64::from(u8::from(*own == Some(level)))).collect()
    };
    // Gram-Schmidt: the axis comes last, so that its residual is what the other axes do not explain.
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let mut add = |mut column: Vec<f64>| -> Option<Vec<f64>> {
        let length = dot(&column, &column).sqrt();
        let mut shares = vec![0.0; basis.len()];
        // The second pass removes rounding errors of the first.
        for _ in 0..2 {
            for (share, direction) in shares.iter_mut().zip(&basis) {
                let part = dot(&column, direction);
                column.iter_mut().zip(direction).for_each(|(value, unit)| *value -= part * unit);
                *share += part;
            }
        }
        let residual = dot(&column, &column).sqrt();
        if residual <= NEGLIGIBLE * length {
            return None;
        }
        column.iter_mut().for_each(|value| *value /= residual);
        basis.push(column);
        shares.push(residual);
        Some(shares)
    };
    add(vec![1.0; values.len()])?;
    for other in others {
        for level in present(other).into_iter().skip(1) {
            // A column that earlier columns explain adds nothing.
            let _ = add(column(other, level));
        }
    }
    let own: Vec<Vec<f64>> = levels.iter().skip(1).map(|&level| add(column(focus, level))).collect::<Option<_>>()?;
    // Back substitution, from the last column to the first.
    let first = basis.len() - own.len();
    let mut coefficients = vec![0.0; own.len()];
    for at in (0..own.len()).rev() {
        let later: f64 = (at + 1..own.len()).map(|later| coefficients[later] * own[later][first + at]).sum();
        coefficients[at] = (dot(values, &basis[first + at]) - later) / own[at][first + at];
    }
    let mut effects = vec![None; focus.levels];
    effects[levels[0]] = Some(0.0);
    levels.iter().skip(1).zip(coefficients).for_each(|(&level, effect)| effects[level] = Some(effect));
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
    fn means_of_an_incomplete_design_equal_numpy() {
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
    fn full_designs_keep_plain_means_and_inseparable_axes_are_confounded() {
        let (a, b) = (factor([0, 0, 1, 1]), factor([0, 1, 0, 1]));
        assert_eq!(level_means(&[1.0, 2.0, 3.0, 6.0], &a, &[&b]), LevelMeans::Plain);
        let other = factor([1, 1, 0, 0]);
        assert_eq!(level_means(&[1.0, 2.0, 3.0, 6.0], &a, &[&b, &other]), LevelMeans::Confounded);
    }

    #[test]
    fn nested_axes_do_not_adjust_the_axes_they_depend_on() {
        let a = factor([0, 0, 1, 1]);
        let nested = Factor { levels: 2, of_row: vec![None, None, Some(0), Some(1)] };
        assert_eq!(level_means(&[1.0, 2.0, 3.0, 6.0], &a, &[&nested]), LevelMeans::Plain);
        assert_eq!(level_means(&[1.0, 2.0, 3.0, 6.0], &nested, &[&a]), LevelMeans::Plain);
    }
}
