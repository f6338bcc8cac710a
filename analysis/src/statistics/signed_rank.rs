//! Wilcoxon's signed-rank test of paired differences.

use super::normal;

/// The maximum number of differences for the exact distribution, if no two sizes are equal and none is zero.
/// `scipy.stats.wilcoxon` has the same limits.
const EXACT: usize = 50;
/// The maximum number of differences with ties or zeros for which all assignments of signs are enumerated.
const ALL_SIGNS: usize = 13;

/// The result of the test whether differences are symmetric about zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SignedRank {
    /// The two-sided probability under the hypothesis that differences are symmetric about zero.
    pub(crate) p: f64,
    /// The distribution of the probability.
    pub(crate) distribution: Distribution,
}

/// The distribution from which a probability was computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Distribution {
    /// The exact distribution of ranks without ties.
    Exact,
    /// All assignments of signs to these differences: exact with ties or zeros.
    Signs,
    /// The normal distribution, its variance corrected for ties.
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
    /// Tests differences, without zeros, like `scipy.stats.wilcoxon(differences)` of SciPy 1.17. `None` without
    /// differences. If all are zero, `p` is 1 (as in SciPy for up to 13 differences).
    pub(crate) fn test(differences: &[f64]) -> Option<Self> {
        let mut by_size: Vec<f64> = differences.iter().copied().filter(|difference| *difference != 0.0).collect();
        if differences.is_empty() || by_size.iter().any(|difference| difference.is_nan()) {
            return None;
        }
        by_size.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
        // Doubled ranks, so that means of ranks are integers.
        let mut ranks = Vec::with_capacity(by_size.len());
        let mut ties = 0.0;
        for ties_of_size in by_size.chunk_by(|a, b| a.abs() == b.abs()) {
            let (before, size) = (ranks.len(), ties_of_size.len());
            ranks.resize(before + size, before + 1 + before + size);
            ties += (size as f64).powi(3) - size as f64;
        }
        let positive =
            by_size.iter().zip(&ranks).filter(|(difference, _)| **difference > 0.0).map(|(_, rank)| rank).sum();
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

/// The two-sided probability of a sum of positive ranks at least as extreme as `sum`, over all assignments of signs.
fn two_sided(ranks: &[usize], sum: usize) -> f64 {
    let all: usize = ranks.iter().sum();
    // The number of assignments for each sum: at most 2^50, so each is exact.
    let mut ways = vec![0.0; all + 1];
    ways[0] = 1.0;
    let mut reached = 0;
    for &rank in ranks {
        for sum in (0..=reached).rev() {
            ways[sum + rank] += ways[sum];
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
    fn differences_of_one_sign_have_the_smallest_probability() {
        let test = |differences: &[f64]| SignedRank::test(differences).unwrap();
        assert_eq!(test(&[1.0, 2.0, 3.0, 4.0]), SignedRank { p: 2.0 / 16.0, distribution: Distribution::Exact });
        assert_eq!(test(&[-1.0, -1.0, -2.0, 0.0]), SignedRank { p: 2.0 / 8.0, distribution: Distribution::Signs });
        assert_eq!(test(&[0.0, 0.0]).p, 1.0);
        assert_eq!(test(&[3.0]).p, 1.0);
        assert_eq!(SignedRank::test(&[]), None);
    }

    #[test]
    fn the_probability_is_symmetric() {
        let differences: Vec<f64> = (1..=60).map(|i| f64::from(i % 17) - 6.0).collect();
        let turned: Vec<f64> = differences.iter().map(|difference| -difference).collect();
        for n in [9, 13, 14, 50, 51, 60] {
            assert_eq!(SignedRank::test(&differences[..n]), SignedRank::test(&turned[..n]), "{n}");
        }
    }
}
