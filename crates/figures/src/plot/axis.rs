//! An axis: from where to where it goes, and which numbers stand at it.

use crate::drawing::width;

use super::TICK_PT;

/// How values lie along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    Linear,
    /// By ratio; both ends are above zero.
    Log,
}

/// An axis of a panel.
#[derive(Clone, Debug)]
pub struct Axis {
    pub low: f64,
    pub high: f64,
    pub scale: Scale,
    /// What the numbers are, with their unit; empty: another panel says it.
    pub label: String,
    /// The numbers that stand at it, where they are not chosen by size.
    pub named: Option<Vec<(f64, String)>>,
    pub has_grid: bool,
}

impl Axis {
    pub fn new(low: f64, high: f64, label: impl Into<String>) -> Self {
        // An axis without length would have no place for anything.
        let high = if high > low { high } else { low + low.abs().max(1.0) * 1e-3 };
        Self { low, high, scale: Scale::Linear, label: label.into(), named: None, has_grid: true }
    }

    pub fn log(low: f64, high: f64, label: impl Into<String>) -> Self {
        Self { scale: Scale::Log, ..Self::new(low, high, label) }
    }

    /// An axis of names, each in the middle of its unit: the first from 0 to 1.
    pub fn names(names: &[String], label: impl Into<String>) -> Self {
        let named = names.iter().enumerate().map(|(place, name)| (place as f64 + 0.5, name.clone())).collect();
        Self { named: Some(named), has_grid: false, ..Self::new(0.0, names.len() as f64, label) }
    }

    /// Where a value lies: 0 at the lower end, 1 at the upper one.
    pub fn place(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log => {
                let value = value.max(self.low * 1e-3);
                libm::log(value / self.low) / libm::log(self.high / self.low)
            }
        }
    }

    /// The numbers that stand at so many points of it; along a row their width counts.
    pub fn ticks(&self, room: f64, is_row: bool) -> Vec<(f64, String)> {
        if let Some(named) = &self.named {
            return if is_row { thinned(named, room, |value| self.place(value)) } else { named.clone() };
        }
        let most = if is_row { room / 26.0 } else { room / 13.0 };
        let values = match self.scale {
            Scale::Linear => steps(self.low, self.high, most.clamp(2.0, 9.0)),
            Scale::Log => ratios(self.low, self.high, most.clamp(2.0, 9.0)),
        };
        values.into_iter().map(|value| (value, short(value))).collect()
    }
}

/// Numbers of those written at an axis, far enough apart to be read.
fn thinned(named: &[(f64, String)], room: f64, place: impl Fn(f64) -> f64) -> Vec<(f64, String)> {
    let mut kept: Vec<(f64, String)> = Vec::new();
    let mut end = f64::NEG_INFINITY;
    for (value, words) in named {
        let (middle, half) = (place(*value) * room, width(words, TICK_PT) / 2.0);
        if middle - half > end + 3.0 {
            end = middle + half;
            kept.push((*value, words.clone()));
        }
    }
    kept
}

/// Numbers for an axis with stated values.
pub fn ticks_at(values: impl IntoIterator<Item = f64>) -> Vec<(f64, String)> {
    values.into_iter().map(|value| (value, short(value))).collect()
}

/// Multiples of 1, 2 or 5 times a power of ten, no more than so many.
fn steps(low: f64, high: f64, most: f64) -> Vec<f64> {
    let least = (high - low) / most;
    let power = libm::pow(10.0, libm::floor(libm::log10(least)));
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|times| times * power).find(|step| *step >= least * 0.999);
    let step = step.unwrap_or(10.0 * power);
    let room = (high - low) * 1e-9;
    let (first, last) = (((low - room) / step).ceil() as i64, ((high + room) / step).floor() as i64);
    (first..=last).map(|times| times as f64 * step).collect()
}

/// Powers of ten, with 2 and 5 times them where there is room, or what a linear axis would have where there is no power.
fn ratios(low: f64, high: f64, most: f64) -> Vec<f64> {
    let powers = (libm::floor(libm::log10(low)) as i32)..=(libm::ceil(libm::log10(high)) as i32);
    let of = |times: &[f64]| -> Vec<f64> {
        let all =
            powers.clone().flat_map(|power| times.iter().map(move |times| times * libm::pow(10.0, f64::from(power))));
        all.filter(|value| *value >= low * 0.999 && *value <= high * 1.001).collect()
    };
    let (dense, sparse) = (of(&[1.0, 2.0, 5.0]), of(&[1.0]));
    match (dense.len(), sparse.len()) {
        (..=2, _) => steps(low, high, most),
        (count, _) if count as f64 <= most => dense,
        (_, ..=1) => dense,
        _ => sparse,
    }
}

/// A tick with the digits it needs: `20`, `0.0048`, `5e-7`.
pub fn short(tick: f64) -> String {
    // Ticks are sums and products: their last bits are not meant.
    let rounded: f64 = format!("{tick:.9e}").parse().unwrap_or(tick);
    if rounded == 0.0 || (1e-4..1e6).contains(&rounded.abs()) {
        // A true minus sign, as long as a plus.
        (rounded + 0.0).to_string().replace('-', "−")
    } else {
        format!("{rounded:e}").replace('-', "−")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_37_ticks_have_the_digits_they_need() {
        let ticks =
            [20.0, 1.0, 0.1 + 0.2, 0.000_6 * 8.0, 4.800_000_000_000_000_4e-3, 5e-7, 2e6, 0.0, -0.0, -1.5, 12_345.0];
        let short = ticks.map(short);
        assert_eq!(short, ["20", "1", "0.3", "0.0048", "0.0048", "5e−7", "2e6", "0", "0", "−1.5", "12345"]);
    }

    #[test]
    fn ticks_are_round_and_few() {
        assert_eq!(steps(0.0, 80.0, 9.0), [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0]);
        assert_eq!(steps(-0.3, 0.7, 5.0), [-0.2, 0.0, 0.2, 0.4, 0.6000000000000001]);
        assert_eq!(ratios(1.0, 80.0, 9.0), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0]);
        assert_eq!(ratios(0.001, 1000.0, 7.0).len(), 7);
        assert_eq!(ratios(3.1, 4.4, 5.0), [3.5, 4.0]);
    }

    #[test]
    fn values_lie_where_they_belong() {
        assert_eq!(Axis::new(0.0, 10.0, "").place(5.0), 0.5);
        assert!((Axis::log(1.0, 100.0, "").place(10.0) - 0.5).abs() < 1e-12);
        assert!(Axis::new(3.0, 3.0, "").high > 3.0, "an axis has a length");
    }
}
