//! A map as a grey PNG that a browser decodes: 16-bit steps of its numbers in two planes of bytes, and a bit per
//! sample.
//!
//! Of a map with `w` columns and `h` rows the PNG has `w` columns: `h` rows of low bytes, below them `h` rows of high
//! bytes, and below these a bit per sample, row-major, the lowest bit first (set: the sample is valid), with zeros up
//! to the end of the row. An invalid sample repeats the one on its left, so that it costs little. The PNG has neither
//! an alpha channel nor a colour space: a canvas gives its bytes as they are.

use depthloom_graphs::Value;
use depthloom_scores::logarithms;
use libm::{exp, log};
use png::{DeflateCompression, Filter};
use serde_json::{Value as Json, json};

/// The smallest depth that has a step of its own, metres.
const NEAREST_M: f64 = 1e-3;
/// The smallest disparity that has one, pixels.
const LOWEST_PX: f64 = -512.0;

/// How fine the steps are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    /// Between two depths, as a share of them.
    pub depth: f64,
    /// Between two disparities, pixels.
    pub disparity_px: f64,
}

/// Fine steps where there is room for them, and coarse ones.
pub(super) const FINE: Steps = Steps { depth: 0.001, disparity_px: 1.0 / 16.0 };
pub(super) const COARSE: Steps = Steps { depth: 0.01, disparity_px: 1.0 / 8.0 };

/// The number that a step represents.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// `from * exp(step * code)`.
    Log {
        /// The number of step 0.
        from: f64,
        /// The logarithm of the ratio of two steps.
        step: f64,
    },
    /// `from + step * code`.
    Linear {
        /// The number of step 0.
        from: f64,
        /// Between two steps.
        step: f64,
    },
}

impl Scale {
    /// The scale of a value type, by its name; `None` if it is not a map.
    #[must_use]
    pub fn for_type(value_type: &str, steps: Steps) -> Option<Self> {
        match value_type {
            "depth" => Some(Self::Log { from: NEAREST_M, step: log(1.0 + steps.depth) }),
            "disparity" | "ground-truth-disparity" => Some(Self::Linear { from: LOWEST_PX, step: steps.disparity_px }),
            "weight" => Some(Self::Linear { from: 0.0, step: 1.0 / 256.0 }),
            "mask" => Some(Self::Linear { from: 0.0, step: 1.0 }),
            _ => None,
        }
    }

    /// As the page's scripts read it.
    #[must_use]
    pub fn json(self) -> Json {
        match self {
            Self::Log { from, step } => json!({ "log": true, "from": from, "step": step }),
            Self::Linear { from, step } => json!({ "log": false, "from": from, "step": step }),
        }
    }

    /// The number that a code represents.
    #[must_use]
    pub fn number(self, code: u16) -> f64 {
        match self {
            Self::Log { from, step } => from * exp(step * f64::from(code)),
            Self::Linear { from, step } => from + step * f64::from(code),
        }
    }

    /// The step nearest to a number.
    #[cfg(test)]
    pub(super) fn code(self, number: f64) -> u16 {
        Coder::new(self).codes(&[number])[0].expect("a number")
    }
}

/// The codes of the numbers of a scale.
#[derive(Clone, Copy)]
struct Coder {
    is_log: bool,
    factor: f64,
    offset: f64,
}

impl Coder {
    fn new(scale: Scale) -> Self {
        match scale {
            Scale::Log { from, step } => Self { is_log: true, factor: 1.0 / step, offset: 0.5 - log(from) / step },
            Scale::Linear { from, step } => Self { is_log: false, factor: 1.0 / step, offset: 0.5 - from / step },
        }
    }

    /// The nearest steps; `None` for NaN. Numbers beyond the steps get the first or the last code, because conversion
    /// saturates.
    fn codes(self, numbers: &[f64]) -> Vec<Option<u16>> {
        let logarithms = if self.is_log { logarithms(numbers) } else { Vec::new() };
        let steps = if self.is_log { &logarithms } else { numbers };
        let code =
            |(number, step): (&f64, &f64)| (!number.is_nan()).then_some((step * self.factor + self.offset) as u16);
        numbers.iter().zip(steps).map(code).collect()
    }
}

/// A map's samples: width, height, and each by its place.
#[derive(Clone, Copy)]
pub(super) struct Samples<'a> {
    pub(super) width: u32,
    pub(super) height: u32,
    numbers: Numbers<'a>,
}

/// The numbers of a map, row by row.
#[derive(Clone, Copy)]
enum Numbers<'a> {
    /// Valid where finite and above 0.
    Positive(&'a [f32]),
    /// Valid where finite.
    Finite(&'a [f32]),
    /// Valid where at least `lowest`.
    Sixteenths { values: &'a [i16], lowest: i32 },
    /// All valid: whether they are set.
    Set(&'a [u8]),
}

impl<'a> Samples<'a> {
    /// The samples of a map; `None` if the value is not a map, or has no pixels.
    pub(super) fn new(value: &'a Value) -> Option<Self> {
        let ((width, height), numbers) = match value {
            Value::Depth(map) => (map.metres.dimensions(), Numbers::Positive(map.metres.as_raw())),
            Value::RelativeDepth(map) => {
                let metres = &map.depth().metres;
                (metres.dimensions(), Numbers::Positive(metres.as_raw()))
            }
            Value::FloatDisparity(map) => (map.px().dimensions(), Numbers::Finite(map.px().as_raw())),
            Value::Disparity(map) => {
                let (values, lowest) = (map.sixteenths_px.as_raw(), map.min_disparity_px * 16);
                (map.sixteenths_px.dimensions(), Numbers::Sixteenths { values, lowest })
            }
            Value::TrueDisparity(map) => (map.px.dimensions(), Numbers::Finite(map.px.as_raw())),
            Value::RelativeInverseDepth(map) => (map.values.dimensions(), Numbers::Finite(map.values.as_raw())),
            Value::Weight(map) => (map.share.dimensions(), Numbers::Finite(map.share.as_raw())),
            Value::Mask(map) => (map.set.dimensions(), Numbers::Set(map.set.as_raw())),
            _ => return None,
        };
        (width > 0 && height > 0).then_some(Self { width, height, numbers })
    }

    /// Whether the sample at a place, row-major, is valid.
    #[inline]
    pub(super) fn is_valid(self, place: usize) -> bool {
        match self.numbers {
            Numbers::Positive(numbers) => is_positive(numbers[place]),
            Numbers::Finite(numbers) => numbers[place].is_finite(),
            Numbers::Sixteenths { values, lowest } => i32::from(values[place]) >= lowest,
            Numbers::Set(_) => true,
        }
    }

    /// The samples at some places: metres, pixels, or a share; NaN where they are invalid.
    fn gathered(self, places: &[usize]) -> Vec<f64> {
        fn each<T: Copy>(samples: &[T], places: &[usize], number: impl Fn(T) -> Option<f64>) -> Vec<f64> {
            places.iter().map(|&place| number(samples[place]).unwrap_or(f64::NAN)).collect()
        }
        match self.numbers {
            Numbers::Positive(numbers) => each(numbers, places, |number| is_positive(number).then_some(number.into())),
            Numbers::Finite(numbers) => each(numbers, places, |number| number.is_finite().then_some(number.into())),
            Numbers::Sixteenths { values, lowest } => each(values, places, |sixteenths| {
                (i32::from(sixteenths) >= lowest).then_some(f64::from(sixteenths) / 16.0)
            }),
            Numbers::Set(set) => each(set, places, |byte| Some(f64::from(u8::from(byte > 0)))),
        }
    }
}

#[inline]
fn is_positive(number: f32) -> bool {
    number > 0.0 && number < f32::INFINITY
}

/// Codes that most samples of a map are between.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CodeRange {
    pub(super) low: u16,
    pub(super) high: u16,
}

/// The PNG of a map.
pub(super) struct EncodedMap {
    pub(super) png: Vec<u8>,
    /// The 1st and 99th percentile of some valid samples; `None` if all are invalid.
    pub(super) range: Option<CodeRange>,
}

/// The PNG of the samples at some places, which are a map of that width.
pub(super) fn encode(samples: Samples<'_>, places: &[usize], width: usize, scale: Scale) -> EncodedMap {
    let codes = Coder::new(scale).codes(&samples.gathered(places));
    EncodedMap { png: encoded(&planes(&codes, width), width), range: range(&codes) }
}

fn range(codes: &[Option<u16>]) -> Option<CodeRange> {
    /// Of more samples some are enough.
    const ENOUGH: usize = 4_000;
    let step = (codes.len() / ENOUGH).max(1);
    let mut some: Vec<u16> = codes.iter().step_by(step).flatten().copied().collect();
    let last = some.len().checked_sub(1)?;
    let mut at = |place: usize| *some.select_nth_unstable(place).1;
    Some(CodeRange { low: at(last / 100), high: at(last - last / 100) })
}

/// The bytes of a map of codes, row by row.
fn planes(codes: &[Option<u16>], width: usize) -> Vec<u8> {
    let length = codes.len();
    let mut bytes = vec![0; 2 * length + length.div_ceil(8).next_multiple_of(width)];
    let (low, rest) = bytes.split_at_mut(length);
    let (high, valid) = rest.split_at_mut(length);
    let mut first_of_row = [0, 0];
    for (row, codes) in codes.chunks(width).enumerate() {
        let mut left = first_of_row;
        for (column, code) in codes.iter().enumerate() {
            let i = row * width + column;
            if let Some(code) = code {
                left = code.to_le_bytes();
                valid[i / 8] |= 1 << (i % 8);
            }
            [low[i], high[i]] = left;
            if column == 0 {
                first_of_row = left;
            }
        }
    }
    bytes
}

/// Bytes as a grey PNG. Every row has the filter `Sub`, and deflate is that of `fdeflate`: the same bytes on any
/// machine. It is many times as fast as zlib's, and its output is no larger for these planes.
fn encoded(bytes: &[u8], width: usize) -> Vec<u8> {
    let mut file = Vec::with_capacity(bytes.len() / 2);
    let mut encoder = png::Encoder::new(&mut file, width as u32, (bytes.len() / width) as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_deflate_compression(DeflateCompression::FdeflateUltraFast);
    encoder.set_filter(Filter::Sub);
    let mut writer = encoder.write_header().expect("memory takes a header");
    writer.write_image_data(bytes).expect("memory takes the rows");
    writer.finish().expect("memory takes an end");
    file
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use proptest::prelude::*;

    use super::*;

    /// As the page does it.
    fn decoded(file: &[u8], length: usize) -> Vec<Option<u16>> {
        let mut reader = png::Decoder::new(Cursor::new(file)).read_info().unwrap();
        assert!(reader.info().gama_chunk.is_none() && reader.info().srgb.is_none());
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        let code = |i: usize| u16::from_le_bytes([bytes[i], bytes[length + i]]);
        (0..length).map(|i| (bytes[2 * length + i / 8] >> (i % 8) & 1 == 1).then(|| code(i))).collect()
    }

    proptest! {
        #[test]
        fn any_map_comes_back(codes in proptest::collection::vec(proptest::option::of(any::<u16>()), 1..200), width in 1_usize..20) {
            let codes = &codes[..codes.len() / width * width];
            prop_assume!(!codes.is_empty());
            let file = encoded(&planes(codes, width), width);
            prop_assert_eq!(decoded(&file, codes.len()), codes);
        }

        #[test]
        fn a_number_is_at_most_half_a_step_off(metres in 0.01_f64..5000.0, px in -500.0_f64..3000.0) {
            for steps in [FINE, COARSE] {
                let Some(scale @ Scale::Log { from, step }) = Scale::for_type("depth", steps) else { unreachable!() };
                let back = from * (step * f64::from(scale.code(metres))).exp();
                prop_assert!((back / metres - 1.0).abs() <= 0.51 * steps.depth, "{} for {}", back, metres);
                let Some(scale @ Scale::Linear { from, step }) = Scale::for_type("disparity", steps) else { unreachable!() };
                let back = from + step * f64::from(scale.code(px));
                prop_assert!((back - px).abs() <= 0.501 * steps.disparity_px, "{} for {}", back, px);
            }
        }
    }
}
