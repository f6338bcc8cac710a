//! The levels of an axis by row, and the orthogonality of several axes.

/// An axis as rows have it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Factor {
    /// The number of levels.
    pub(crate) levels: usize,
    /// The level of each row, below `levels`; `None` if the row does not have the axis.
    pub(crate) of_row: Vec<Option<usize>>,
}

/// Whether, in the rows that have both axes, each level of one is combined with the levels of the other in equal
/// proportions. If some rows lack one of the axes, one axis must also have the same proportions of levels in these rows
/// as in all rows.
pub(super) fn are_orthogonal(a: &Factor, b: &Factor) -> bool {
    let (mut of_a, mut of_b) = (vec![0; a.levels], vec![0; b.levels]);
    let (mut all_a, mut all_b) = (vec![0; a.levels], vec![0; b.levels]);
    let mut both = vec![0; a.levels * b.levels];
    for (&a_level, &b_level) in a.of_row.iter().zip(&b.of_row) {
        if let Some(level) = a_level {
            all_a[level] += 1;
        }
        if let Some(level) = b_level {
            all_b[level] += 1;
        }
        if let (Some(a_level), Some(b_level)) = (a_level, b_level) {
            of_a[a_level] += 1;
            of_b[b_level] += 1;
            both[a_level * b.levels + b_level] += 1;
        }
    }
    let rows: usize = both.iter().sum();
    let in_proportion = |here: &[usize], all: &[usize]| {
        let everywhere: usize = all.iter().sum();
        here.iter().zip(all).all(|(here, all)| here * everywhere == all * rows)
    };
    (0..both.len()).all(|cell| both[cell] * rows == of_a[cell / b.levels] * of_b[cell % b.levels])
        && (in_proportion(&of_a, &all_a) || in_proportion(&of_b, &all_b))
}

/// Whether all combinations of levels occur equally often.
pub(super) fn is_full(factors: &[Factor], rows: usize) -> bool {
    let combinations = factors.iter().try_fold(1_usize, |all, factor| all.checked_mul(factor.levels));
    let Some(combinations) = combinations.filter(|&all| all > 0 && all <= rows && rows.is_multiple_of(all)) else {
        return false;
    };
    let mut times = vec![0; combinations];
    for row in 0..rows {
        let cell = factors.iter().try_fold(0, |cell, factor| Some(cell * factor.levels + factor.of_row[row]?));
        let Some(cell) = cell else { return false };
        times[cell] += 1;
    }
    times.iter().all(|&times| times == rows / combinations)
}
