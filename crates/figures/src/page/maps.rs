//! A map as a grey PNG that a browser decodes: 16-bit steps of its numbers in two planes of bytes, and a bit per
//! sample.
//!
//! Of a map with `w` columns and `h` rows the PNG has `w` columns: `h` rows of low bytes, below them `h` rows of high
//! bytes, and below these a bit per sample, row-major, the lowest bit first (set: the sample is valid), with zeros up
//! to the end of the row. An invalid sample repeats the one on its left, so that it costs little. The PNG has neither
//! an alpha channel nor a colour space: a canvas gives its bytes as they are.

use depthloom_graphs::Value;
use libm::{log, round};
use miniz_oxide::deflate::compress_to_vec_zlib;
use serde_json::{Value as Json, json};

/// Better packing than this costs several times as long.
const LEVEL: u8 = 6;

/// The smallest depth that has a step of its own, metres.
const NEAREST_M: f64 = 1e-3;
/// The smallest disparity that has one, pixels.
const LOWEST_PX: f64 = -512.0;
/// The most steps there are.
const STEPS: f64 = 65_535.0;

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
            "disparity" | "true-disparity" => Some(Self::Linear { from: LOWEST_PX, step: steps.disparity_px }),
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

    /// The step nearest to a number.
    fn code(self, number: f64) -> u16 {
        let code = match self {
            Self::Log { from, step } => log(number / from) / step,
            Self::Linear { from, step } => (number - from) / step,
        };
        // NaN does not occur here; values beyond the steps get the first or the last code.
        round(code).clamp(0.0, STEPS) as u16
    }
}

/// A map's samples: width, height, and each by its place.
pub(super) struct Samples<'a> {
    pub(super) width: u32,
    pub(super) height: u32,
    value: &'a Value,
}

impl<'a> Samples<'a> {
    /// The samples of a map; `None` if the value is not a map, or has no pixels.
    pub(super) fn new(value: &'a Value) -> Option<Self> {
        let (width, height) = match value {
            Value::Depth(map) => map.metres.dimensions(),
            Value::RelativeDepth(map) => map.depth().metres.dimensions(),
            Value::FloatDisparity(map) => map.px().dimensions(),
            Value::Disparity(map) => map.sixteenths_px.dimensions(),
            Value::TrueDisparity(map) => map.px.dimensions(),
            Value::RelativeInverseDepth(map) => map.values.dimensions(),
            Value::Weight(map) => map.share.dimensions(),
            Value::Mask(map) => map.set.dimensions(),
            _ => return None,
        };
        (width > 0 && height > 0).then_some(Self { width, height, value })
    }

    /// The sample at a place, row-major: metres, pixels, or a share; `None` where it is invalid.
    pub(super) fn at(&self, place: usize) -> Option<f64> {
        let number = |number: f32| number.is_finite().then_some(f64::from(number));
        match self.value {
            // A depth of zero or less is invalid.
            Value::Depth(map) => number(map.metres.as_raw()[place]).filter(|metres| *metres > 0.0),
            Value::RelativeDepth(map) => number(map.depth().metres.as_raw()[place]).filter(|metres| *metres > 0.0),
            Value::FloatDisparity(map) => number(map.px().as_raw()[place]),
            Value::Disparity(map) => {
                let sixteenths = map.sixteenths_px.as_raw()[place];
                (i32::from(sixteenths) >= map.min_disparity_px * 16).then(|| f64::from(sixteenths) / 16.0)
            }
            Value::TrueDisparity(map) => number(map.px.as_raw()[place]),
            Value::RelativeInverseDepth(map) => number(map.values.as_raw()[place]),
            Value::Weight(map) => number(map.share.as_raw()[place]),
            Value::Mask(map) => Some(f64::from(u8::from(map.set.as_raw()[place] > 0))),
            _ => None,
        }
    }
}

/// The PNG of the samples at some places, which are a map of that width.
pub(super) fn png(samples: &Samples<'_>, places: &[usize], width: usize, scale: Scale) -> Vec<u8> {
    let codes = places.iter().map(|&place| samples.at(place).map(|number| scale.code(number)));
    encoded(&planes(codes, width), width)
}

/// The bytes of a map of codes, row by row.
fn planes(codes: impl ExactSizeIterator<Item = Option<u16>>, width: usize) -> Vec<u8> {
    let length = codes.len();
    let mut bytes = vec![0; 2 * length + length.div_ceil(8).next_multiple_of(width)];
    for (i, code) in codes.enumerate() {
        let left = if i % width == 0 { i.checked_sub(width) } else { Some(i - 1) };
        [bytes[i], bytes[length + i]] = match (code, left) {
            (Some(code), _) => code.to_le_bytes(),
            (None, Some(left)) => [bytes[left], bytes[length + left]],
            (None, None) => [0, 0],
        };
        bytes[2 * length + i / 8] |= u8::from(code.is_some()) << (i % 8);
    }
    bytes
}

/// Bytes as a grey PNG. Every row has the filter `Sub`, and deflate is that of `miniz_oxide`: the same bytes on any
/// machine.
fn encoded(bytes: &[u8], width: usize) -> Vec<u8> {
    const SUB: u8 = 1;
    let mut filtered = Vec::with_capacity(bytes.len() + bytes.len() / width);
    for row in bytes.chunks_exact(width) {
        filtered.extend([SUB, row[0]]);
        filtered.extend(row.windows(2).map(|pair| pair[1].wrapping_sub(pair[0])));
    }
    let packed = compress_to_vec_zlib(&filtered, LEVEL);
    let mut file = Vec::with_capacity(packed.len() + 64);
    let mut encoder = png::Encoder::new(&mut file, width as u32, (bytes.len() / width) as u32);
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().expect("memory takes a header");
    writer.write_chunk(png::chunk::IDAT, &packed).expect("memory takes a chunk");
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
            let file = encoded(&planes(codes.iter().copied(), width), width);
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
