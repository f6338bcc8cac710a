//! Wilcoxon's signed-rank test of paired differences.

use super::normal;

/// Up to so many differences the distribution is taken exactly where no two are alike and none is zero;
/// `scipy.stats.wilcoxon` has the same limits.
const EXACT: usize = 50;
/// And up to so many where some are: of all ways to give them signs.
const ALL_SIGNS: usize = 13;

/// What the test says: whether differences lie about zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SignedRank {
    /// The probability of ranks at least as far from balance, in either direction, were differences about zero.
    pub(crate) p: f64,
    /// How it was found.
    pub(crate) distribution: Distribution,
}

/// The distribution that a probability was taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Distribution {
    /// The exact one, of whole ranks.
    Exact,
    /// That of all ways to give these differences signs, exact where some are alike or zero.
    Signs,
    /// The normal one, its variance corrected for differences of equal size.
    Normal,
}

impl Distribution {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Signs => "signs",
            Self::Normal => "normal",
        }
    }
}

impl SignedRank {
    /// Of differences, zeros left out: as `scipy.stats.wilcoxon(differences)` of SciPy 1.17. `None` of none; where all
    /// are zero nothing speaks against it, and `p` is 1 (SciPy says so of up to 13).
    pub(crate) fn of(differences: &[f64]) -> Option<Self> {
        let mut by_size: Vec<f64> = differences.iter().copied().filter(|of| *of != 0.0).collect();
        if differences.is_empty() || by_size.iter().any(|of| of.is_nan()) {
            return None;
        }
        by_size.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
        // Twice the ranks, so that a mean of ranks is whole.
        let mut ranks = Vec::with_capacity(by_size.len());
        let mut ties = 0.0;
        for alike in by_size.chunk_by(|a, b| a.abs() == b.abs()) {
            let (before, size) = (ranks.len(), alike.len());
            ranks.resize(before + size, before + 1 + before + size);
            ties += (size as f64).powi(3) - size as f64;
        }
        let positive = by_size.iter().zip(&ranks).filter(|(of, _)| **of > 0.0).map(|(_, rank)| rank).sum();
        if ranks.is_empty() {
            return Some(Self { p: 1.0, distribution: Distribution::Signs });
        }
        let all = differences.len();
        let is_plain = ties == 0.0 && ranks.len() == all;
        let distribution = match all {
            ..=EXACT if is_plain => Distribution::Exact,
            ..=ALL_SIGNS => Distribution::Signs,
            _ => Distribution::Normal,
        };
        let p = if distribution == Distribution::Normal {
            let n = ranks.len() as f64;
            let mean = n * (n + 1.0) * 0.25;
            let variance = (n * (n + 1.0) * (2.0 * n + 1.0) - ties / 2.0) / 24.0;
            let z = (positive as f64 / 2.0 - mean) / variance.sqrt();
            2.0 * normal::cdf(-z.abs())
        } else {
            two_sided(&ranks, positive)
        };
        Some(Self { p: p.min(1.0), distribution })
    }
}

/// The share of all ways to give ranks signs whose positive ones sum to at most `sum`, or to at least that, whichever
/// is less, twice.
fn two_sided(ranks: &[usize], sum: usize) -> f64 {
    let all: usize = ranks.iter().sum();
    // How many ways lead to each sum: no more than 2^50, so each is whole.
    let mut ways = vec![0.0; all + 1];
    ways[0] = 1.0;
    let mut reached = 0;
    for &rank in ranks {
        for of in (0..=reached).rev() {
            ways[of + rank] += ways[of];
        }
        reached += rank;
    }
    let (below, above): (f64, f64) = (ways[..=sum].iter().sum(), ways[sum..].iter().sum());
    2.0 * below.min(above) / ways.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_all_point_one_way_one_of_all_signs_does() {
        let of = |differences: &[f64]| SignedRank::of(differences).unwrap();
        assert_eq!(of(&[1.0, 2.0, 3.0, 4.0]), SignedRank { p: 2.0 / 16.0, distribution: Distribution::Exact });
        assert_eq!(of(&[-1.0, -1.0, -2.0, 0.0]), SignedRank { p: 2.0 / 8.0, distribution: Distribution::Signs });
        assert_eq!(of(&[0.0, 0.0]).p, 1.0);
        assert_eq!(of(&[3.0]).p, 1.0);
        assert_eq!(SignedRank::of(&[]), None);
    }

    #[test]
    fn it_is_the_same_from_either_side() {
        let differences: Vec<f64> = (1..=60).map(|i| f64::from(i % 17) - 6.0).collect();
        let turned: Vec<f64> = differences.iter().map(|of| -of).collect();
        for n in [9, 13, 14, 50, 51, 60] {
            assert_eq!(SignedRank::of(&differences[..n]), SignedRank::of(&turned[..n]), "{n}");
        }
    }
}
