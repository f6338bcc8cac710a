//! The least-squares line, shared by the alignment of scores and by that of nodes.

/// `z = scale * x + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// In the unit of `z` per unit of `x`.
    pub scale: f64,
    /// In the unit of `z`.
    pub shift: f64,
}

impl Line {
    /// The line nearest to points `(x, z, weight)` along `z`, by weighted squares. `None` if no line is nearest:
    /// without weight, or if all `x` are alike.
    ///
    /// The points are visited twice, in order: first their means, then the moments about these. Weights are finite and
    /// not negative; a weight of 1 changes no bit.
    pub fn least_squares(points: impl Iterator<Item = (f64, f64, f64)> + Clone) -> Option<Self> {
        let (mut total, mut x_sum, mut z_sum) = (0.0, 0.0, 0.0);
        for (x, z, weight) in points.clone() {
            total += weight;
            x_sum += weight * x;
            z_sum += weight * z;
        }
        let (x_mean, z_mean) = (x_sum / total, z_sum / total);
        let (mut xx, mut xz) = (0.0, 0.0);
        for (x, z, weight) in points {
            xx += weight * ((x - x_mean) * (x - x_mean));
            xz += weight * ((x - x_mean) * (z - z_mean));
        }
        let scale = xz / xx;
        scale.is_finite().then_some(Self { scale, shift: z_mean - scale * x_mean })
    }

    /// `scale * x + shift`.
    #[must_use]
    pub const fn at(self, x: f64) -> f64 {
        self.scale * x + self.shift
    }
}

#[cfg(test)]
mod tests {
    use super::Line;

    /// NumPy 2.4: `np.linalg.lstsq(np.c_[x, np.ones(4)] * np.sqrt(w)[:, None], z * np.sqrt(w), rcond=None)[0]`
    #[test]
    fn weighted_lines_are_numpys() {
        let (x, z) = ([0.5, 1.0, 2.0, 4.0], [1.0, 3.0, 2.0, 7.0]);
        let line = |w: [f64; 4]| Line::least_squares(x.into_iter().zip(z).zip(w).map(|((x, z), w)| (x, z, w))).unwrap();
        for (weights, scale, shift) in [
            ([1.0; 4], 1.547826086956522, 0.3478260869565224),
            ([0.25, 1.0, 0.5, 2.0], 1.5339805825242718, 0.7249190938511335),
        ] {
            let Line { scale: found, shift: at_0 } = line(weights);
            assert!((found - scale).abs() < 1e-12 && (at_0 - shift).abs() < 1e-12, "{found} {at_0}");
        }
        assert_eq!(line([0.0, 1.0, 0.0, 2.0]).at(4.0), 7.0);
    }

    #[test]
    fn points_without_weight_or_spread_have_no_line() {
        assert_eq!(Line::least_squares(std::iter::empty()), None);
        assert_eq!(Line::least_squares([(1.0, 2.0, 0.0), (2.0, 3.0, 0.0)].into_iter()), None);
        assert_eq!(Line::least_squares([(1.0, 2.0, 1.0), (1.0, 3.0, 1.0)].into_iter()), None);
    }
}
