//! An axis: its range, and the numbers at it.

use super::{LABEL_PT, TICK_PT};
use crate::drawing::width;

/// How values are placed along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// By difference.
    Linear,
    /// By ratio; both ends are above zero.
    Log,
}

/// An axis of a panel.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
    /// How values are placed.
    pub scale: Scale,
    /// What the numbers are, with their unit.
    pub label: String,
    pub(crate) ticks: Option<Vec<(f64, String)>>,
    pub(crate) has_grid: bool,
}

/// A range that is wider than this ratio has a logarithmic axis.
const FAR: f64 = 20.0;

impl Axis {
    /// A linear axis.
    pub fn new(low: f64, high: f64, label: impl Into<String>) -> Self {
        // An axis without length has no place for anything.
        let high = if high > low { high } else { low + low.abs().max(1.0) * 1e-3 };
        Self { low, high, scale: Scale::Linear, label: label.into(), ticks: None, has_grid: true }
    }

    /// An axis of ratios.
    pub fn log(low: f64, high: f64, label: impl Into<String>) -> Self {
        Self { scale: Scale::Log, ..Self::new(low, high, label) }
    }

    /// An axis of names, each in the middle of its unit: the first from 0 to 1.
    pub fn names(names: &[String], label: impl Into<String>) -> Self {
        let ticks = names.iter().enumerate().map(|(place, name)| (place as f64 + 0.5, name.clone())).collect();
        Self { ticks: Some(ticks), has_grid: false, ..Self::new(0.0, names.len() as f64, label) }
    }

    /// An axis without numbers.
    pub fn bare(label: impl Into<String>) -> Self {
        Self { ticks: Some(Vec::new()), has_grid: false, ..Self::new(0.0, 1.0, label) }
    }

    /// An axis around values with a share of room beyond them, if any: logarithmic where positive values differ much,
    /// from zero where the least is near it.
    pub fn around(values: impl Iterator<Item = f64> + Clone, share: f64, label: impl Into<String>) -> Self {
        let (low, high) = (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max));
        if low > 0.0 && high > FAR * low {
            let room = libm::pow(high / low, share);
            return Self::log(low / room, high * room, label);
        }
        let room = if high > low { share * (high - low) } else { share * high.abs().max(1e-9) };
        let near_zero = share > 0.0 && low >= 0.0 && (low < 0.3 * high || low < room);
        Self::new(if near_zero { 0.0 } else { low - room }, high + room, label)
    }

    /// The same with numbers at these values alone.
    #[must_use]
    pub fn with_ticks(self, values: impl IntoIterator<Item = f64>) -> Self {
        Self { ticks: Some(values.into_iter().map(|value| (value, short(value))).collect()), ..self }
    }

    pub(super) fn has_ticks(&self) -> bool {
        self.ticks.as_ref().is_none_or(|ticks| !ticks.is_empty())
    }

    pub(super) fn label_room(&self) -> f64 {
        if self.label.is_empty() { 0.0 } else { LABEL_PT + 4.0 }
    }

    /// Where a value is: 0 at the lower end, 1 at the upper one.
    pub(crate) fn place(&self, value: f64) -> f64 {
        if value.is_infinite() {
            return f64::from(u8::from(value > 0.0));
        }
        match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log => libm::log(value.max(self.low * 1e-3) / self.low) / libm::log(self.high / self.low),
        }
    }

    /// The numbers at an axis of a length in points; along a row their width counts.
    pub(super) fn ticks(&self, room: f64, is_row: bool) -> Vec<(f64, String)> {
        if let Some(ticks) = &self.ticks {
            // Far enough apart to be read.
            let mut end = f64::NEG_INFINITY;
            let mut has_room = |(value, words): &&(f64, String)| {
                let (middle, half) = (self.place(*value) * room, width(words, TICK_PT) / 2.0);
                let has_room = !is_row || middle - half > end + 3.0;
                end = if has_room { middle + half } else { end };
                has_room
            };
            return ticks.iter().filter(|tick| has_room(tick)).cloned().collect();
        }
        let most = (room / if is_row { 26.0 } else { 13.0 }).clamp(2.0, 9.0);
        let values = match self.scale {
            Scale::Linear => steps(self.low, self.high, most),
            Scale::Log => ratios(self.low, self.high, most),
        };
        values.into_iter().map(|value| (value, short(value))).collect()
    }
}

/// Multiples of 1, 2 or 5 times a power of ten, no more than `most`.
fn steps(low: f64, high: f64, most: f64) -> Vec<f64> {
    let least = (high - low) / most;
    let power = libm::pow(10.0, libm::floor(libm::log10(least)));
    let step = [1.0, 2.0, 5.0, 10.0].map(|times| times * power).into_iter().find(|step| *step >= least * 0.999);
    let (step, room) = (step.unwrap_or(10.0 * power), (high - low) * 1e-9);
    let (first, last) = (((low - room) / step).ceil() as i64, ((high + room) / step).floor() as i64);
    (first..=last).map(|times| times as f64 * step).collect()
}

/// Powers of ten, with 2 and 5 times them where there is room; the numbers of a linear axis where there is no power.
fn ratios(low: f64, high: f64, most: f64) -> Vec<f64> {
    let powers = (libm::floor(libm::log10(low)) as i32)..=(libm::ceil(libm::log10(high)) as i32);
    let within = |times: &[f64]| -> Vec<f64> {
        let all = powers.clone().map(|power| libm::pow(10.0, f64::from(power)));
        let all = all.flat_map(|power| times.iter().map(move |times| times * power));
        all.filter(|value| *value >= low * 0.999 && *value <= high * 1.001).collect()
    };
    let (dense, sparse) = (within(&[1.0, 2.0, 5.0]), within(&[1.0]));
    match (dense.len(), sparse.len()) {
        (..=2, _) => steps(low, high, most),
        (count, few) if count as f64 <= most || few <= 1 => dense,
        _ => sparse,
    }
}

/// A number with the digits it needs: `20`, `0.0048`, `5e−7`.
fn short(number: f64) -> String {
    // Numbers at an axis are sums and products: their last bits mean nothing.
    let rounded = format!("{number:.9e}").parse().unwrap_or(number) + 0.0;
    let plain = rounded == 0.0 || (1e-4..1e6).contains(&rounded.abs());
    // A true minus sign, as long as a plus.
    if plain { rounded.to_string() } else { format!("{rounded:e}") }.replace('-', "−")
}

#[cfg(test)]
mod tests;
