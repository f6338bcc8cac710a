//! Estimates as they are scored, for people to look at.

use depthloom_graphs::Value;
use depthloom_graphs::values::{Depth, Raster};
use depthloom_scores::{ScoredPixels, Settings};

/// A depth aligned with its truth and clamped, as it is scored; `None` where it cannot be.
pub fn as_scored(estimate: &Value, truth: &Value, settings: &Settings) -> Option<Value> {
    let (truth, size) = (truth.metres()?, estimate.metres()?.dimensions());
    if truth.dimensions() != size {
        return None;
    }
    let estimate = estimate.depth_estimate()?;
    let pixels = ScoredPixels::new(truth, size.0 as usize, size.1 as usize, settings);
    let metres = pixels.alignment(estimate, settings).applied(estimate, settings);
    Raster::from_raw(size.0, size.1, metres).map(|metres| Depth { metres }.into())
}

#[cfg(test)]
mod tests {
    use depthloom_scores::Align;

    use super::*;

    #[test]
    fn an_estimate_without_scale_is_brought_to_its_truth() {
        let map = |metres: &[f32]| Value::from(Depth { metres: Raster::from_raw(4, 1, metres.to_vec()).unwrap() });
        let (estimate, truth) = (map(&[1.0, 2.0, 3.0, f32::NAN]), map(&[10.0, 20.0, f32::NAN, 40.0]));
        let settings = Settings { align: Align::Median, ..Settings::default() };
        let scored = as_scored(&estimate, &truth, &settings).unwrap();
        let metres = scored.metres().unwrap().as_raw();
        assert_eq!((&metres[..3], metres[3].is_nan()), (&[10.0, 20.0, 30.0][..], true));
    }
}
