//! The rule for best and second best values, shared by tables in all formats, pages and figures.
//!
//! A value competes within its class: the same frames with the same number of pixels, ground truth and scoring. In a
//! class of two or more, the best value and all equal values are marked; in a class of three or more, the next value is
//! second best. An estimate without valid pixels, or without
//! pixels within a factor of 1.25^3 of the ground truth, is never best. Otherwise `silog` would prefer an estimate that
//! is invalid everywhere, because invalid pixels count as a constant.

use std::collections::HashMap;

/// A value that may be the best.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Candidate {
    /// Values of one class are comparable; `None`: not comparable.
    pub(crate) class: Option<usize>,
    /// More is better.
    pub(crate) value: Option<f64>,
    /// The share of pixels within a factor of 1.25^3, if it was scored.
    pub(crate) a3: Option<f64>,
    /// The share of valid pixels, if known.
    pub(crate) density: Option<f64>,
}

impl Candidate {
    fn competing(&self) -> Option<(usize, f64)> {
        let is_above_0 = |share: Option<f64>| share.is_none_or(|share| share > 0.0);
        let value = self.value.filter(|value| value.is_finite())?;
        self.class.filter(|_| is_above_0(self.a3) && is_above_0(self.density)).map(|class| (class, value))
    }
}

/// How a value compares with those of its class.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Mark {
    #[default]
    None,
    Best,
    Second,
}

impl From<bool> for Mark {
    fn from(is_best: bool) -> Self {
        if is_best { Self::Best } else { Self::None }
    }
}

/// For each candidate, whether its value is the largest, or the next, of its class.
pub(crate) fn marks(candidates: &[Candidate]) -> Vec<Mark> {
    // Of each class, the size and the values that compete.
    let mut classes: HashMap<usize, (usize, Vec<f64>)> = HashMap::new();
    for candidate in candidates {
        let Some(class) = candidate.class else { continue };
        let (size, values) = classes.entry(class).or_default();
        *size += 1;
        values.extend(candidate.competing().map(|(_, value)| value));
    }
    for (_, values) in classes.values_mut() {
        values.sort_by(|a, b| b.total_cmp(a));
        values.dedup();
    }
    let mark = |candidate: &Candidate| {
        let Some((class, value)) = candidate.competing() else { return Mark::None };
        match &classes[&class] {
            (2.., values) if values[0] == value => Mark::Best,
            (3.., values) if values.get(1) == Some(&value) => Mark::Second,
            _ => Mark::None,
        }
    };
    candidates.iter().map(mark).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(class: Option<usize>, value: f64) -> Candidate {
        Candidate { class, value: Some(value), a3: None, density: None }
    }

    fn best(candidates: &[Candidate]) -> Vec<bool> {
        marks(candidates).into_iter().map(|mark| mark == Mark::Best).collect()
    }

    #[test]
    fn the_next_value_of_three_or_more_is_second() {
        let values = |values: &[f64]| values.iter().map(|value| candidate(Some(0), *value)).collect::<Vec<_>>();
        assert_eq!(marks(&values(&[1.0, 3.0, 2.0, 2.0])), [Mark::None, Mark::Best, Mark::Second, Mark::Second]);
        assert_eq!(marks(&values(&[3.0, 3.0, 1.0])), [Mark::Best, Mark::Best, Mark::Second]);
        assert_eq!(marks(&values(&[3.0, 1.0])), [Mark::Best, Mark::None]);
        assert_eq!(marks(&values(&[0.0, -0.0, -1.0])), [Mark::Best, Mark::Best, Mark::Second]);
    }

    #[test]
    fn each_class_of_two_or_more_has_its_best_values() {
        let some = [
            (Some(0), 3.0),
            (Some(0), 2.0),
            (Some(0), 2.0),
            (Some(1), 1.0),
            (Some(1), 9.0),
            (Some(2), 0.5),
            (None, 0.1),
        ];
        let candidates = some.map(|(class, value)| candidate(class, value));
        assert_eq!(best(&candidates), [true, false, false, false, true, false, false]);
        let errors = some.map(|(class, value)| candidate(class, -value));
        assert_eq!(best(&errors), [false, true, true, true, false, false, false]);
    }

    #[test]
    fn estimates_without_valid_pixels_are_never_best() {
        let missing = Candidate { a3: Some(0.0), ..candidate(Some(0), 0.4) };
        let invalid = Candidate { density: Some(0.0), ..candidate(Some(0), 0.3) };
        let fine = Candidate { a3: Some(0.5), density: Some(0.9), ..candidate(Some(0), 0.2) };
        assert_eq!(best(&[missing, invalid, fine, candidate(Some(0), 0.1)]), [false, false, true, false]);
    }
}
