//! Correction for multiple tests.

/// Holm's correction (1979). If the corrected probabilities are compared with a level, the probability of any wrong
/// rejection is at most that level, for any dependence between the tests.
pub(crate) fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_by(|&a, &b| p[a].total_cmp(&p[b]));
    let mut corrected = vec![1.0; p.len()];
    let mut least = 0.0_f64;
    for (place, test) in order.into_iter().enumerate() {
        least = least.max((p.len() - place) as f64 * p[test]).min(1.0);
        corrected[test] = least;
    }
    corrected
}

#[cfg(test)]
mod tests {
    use super::holm;

    #[test]
    fn corrections_match_hand_computation() {
        // 0.01 * 4, 0.02 * 3, then no less than what went before, and never above 1.
        assert_eq!(holm(&[0.02, 0.01, 0.029, 0.7]), [0.06, 0.04, 0.06, 0.7]);
        assert_eq!(holm(&[0.9, 0.8]), [1.0, 1.0]);
        assert!(holm(&[]).is_empty());
    }
}
