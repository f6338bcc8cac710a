//! The difference between a recorded and a recomputed value.

use std::fmt;

use bytemuck::NoUninit;

use super::{Calibration, Curve, Image, Number, Pixels, Raster, Value, ValueType};

/// How two values differ.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ValueDifference {
    /// How many numbers were compared.
    pub numbers: u64,
    /// How many of them differ by more than the tolerance; 1 where the values differ as a whole.
    pub different: u64,
    /// The first difference.
    pub first: Option<Differs>,
    /// The largest difference; above all a number that is invalid in only one value.
    pub worst: Option<Differs>,
}

/// One difference.
#[derive(Clone, Debug, PartialEq)]
pub enum Differs {
    /// They have different sizes, or only one exists.
    Whole {
        /// The recorded value.
        recorded: String,
        /// The recomputed value.
        now: String,
    },
    /// In a number.
    Number {
        /// Its place.
        place: Place,
        /// As recorded; `None`: invalid.
        recorded: Option<f64>,
        /// As recomputed.
        now: Option<f64>,
    },
}

/// The place of a number in a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// Column and row.
    Pixel(u32, u32),
    /// Column, row, channel.
    Channel(u32, u32, u8),
    /// Offset in a file.
    Byte(u64),
    /// A metric, a coefficient of a calibration, a point of a curve.
    Named(String),
}

impl ValueDifference {
    /// Compares values of one port.
    pub fn between(recorded: &Value, now: &Value, tolerance: f64) -> Self {
        match (recorded, now) {
            (Value::Image(a), Value::Image(b)) => images(a, b, tolerance),
            (Value::Disparity(a), Value::Disparity(b)) if a.min_disparity_px != b.min_disparity_px => {
                let searched = |least: i32| format!("disparities searched from {least} px on");
                Self::whole(searched(a.min_disparity_px), searched(b.min_disparity_px))
            }
            (Value::Disparity(_) | Value::FloatDisparity(_), Value::Disparity(_) | Value::FloatDisparity(_)) => {
                match (recorded.disparity_px(), now.disparity_px()) {
                    (Some(a), Some(b)) => pixels(sized(&a), sized(&b), tolerance, float),
                    _ => Self::whole(recorded.value_type().to_string(), now.value_type().to_string()),
                }
            }
            (Value::TrueDisparity(a), Value::TrueDisparity(b)) => pixels(sized(&a.px), sized(&b.px), tolerance, float),
            (Value::Depth(_) | Value::RelativeDepth(_), Value::Depth(_) | Value::RelativeDepth(_)) => {
                depths(recorded, now, tolerance)
            }
            (Value::RelativeInverseDepth(a), Value::RelativeInverseDepth(b)) => {
                pixels(sized(&a.values), sized(&b.values), tolerance, float)
            }
            (Value::Weight(a), Value::Weight(b)) => pixels(sized(&a.share), sized(&b.share), tolerance, float),
            (Value::Mask(a), Value::Mask(b)) => {
                pixels(sized(&a.set), sized(&b.set), 0.0, |value| Some(f64::from(*value)))
            }
            (Value::Calibration(a), Value::Calibration(b)) => named(coefficients(a), coefficients(b), tolerance),
            (Value::Scores(_), Value::Scores(_)) => named(scores(recorded), scores(now), tolerance),
            (Value::Number(a), Value::Number(b)) => named(single(a), single(b), tolerance),
            (Value::Curve(a), Value::Curve(b)) => named(points(a), points(b), tolerance),
            (Value::Samples(a), Value::Samples(b))
            | (Value::Model(a), Value::Model(b))
            | (Value::Reliability(a), Value::Reliability(b)) => bytes(&a.bytes, &b.bytes),
            (a, b) => Self::whole(a.value_type().to_string(), b.value_type().to_string()),
        }
    }

    /// A difference of the whole value.
    pub fn whole(recorded: impl Into<String>, now: impl Into<String>) -> Self {
        let differs = Differs::Whole { recorded: recorded.into(), now: now.into() };
        Self { numbers: 1, different: 1, first: Some(differs.clone()), worst: Some(differs) }
    }

    fn take(&mut self, recorded: Option<f64>, now: Option<f64>, tolerance: f64, place: impl FnOnce() -> Place) {
        self.numbers += 1;
        let is_equal = match (recorded, now) {
            // Without a tolerance by their bits: 0 is not -0.
            (Some(a), Some(b)) => a.to_bits() == b.to_bits() || tolerance > 0.0 && (a - b).abs() <= tolerance,
            (None, None) => true,
            _ => false,
        };
        if is_equal {
            return;
        }
        self.different += 1;
        let is_worse = self.worst.as_ref().is_none_or(|worst| by(recorded, now) > worst.by());
        if is_worse || self.first.is_none() {
            let differs = Differs::Number { place: place(), recorded, now };
            if self.first.is_none() {
                self.first = Some(differs.clone());
            }
            if is_worse {
                self.worst = Some(differs);
            }
        }
    }
}

impl Differs {
    /// The size of the difference, in the value's unit; infinite if only one is a number.
    pub fn by(&self) -> f64 {
        match self {
            Self::Whole { .. } => f64::INFINITY,
            Self::Number { recorded, now, .. } => by(*recorded, *now),
        }
    }

    /// The difference in words, with units.
    pub fn text(&self, value_type: ValueType) -> String {
        match self {
            Self::Whole { recorded, now } => format!("recorded {recorded}, now {now}"),
            Self::Number { place, recorded, now } => {
                let unit = unit(value_type);
                let text = |value: Option<f64>| value.map_or_else(|| "no answer".to_owned(), number);
                let by = self.by();
                let by = if by.is_finite() { format!(" (by {}{unit})", number(by)) } else { String::new() };
                format!("{place}: recorded {}{unit}, now {}{unit}{by}", text(*recorded), text(*now))
            }
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pixel(x, y) => write!(f, "pixel ({x}, {y})"),
            Self::Channel(x, y, channel) => write!(f, "pixel ({x}, {y}), channel {channel}"),
            Self::Byte(at) => write!(f, "byte {at}"),
            Self::Named(name) => f.write_str(name),
        }
    }
}

/// A number with the fewest digits that identify it, as a single or a double.
pub fn number(value: f64) -> String {
    let single = value as f32;
    if f64::from(single).to_bits() == value.to_bits() { single.to_string() } else { value.to_string() }
}

const fn unit(value_type: ValueType) -> &'static str {
    match value_type {
        ValueType::Depth => " m",
        ValueType::Disparity | ValueType::TrueDisparity => " px",
        _ => "",
    }
}

fn by(recorded: Option<f64>, now: Option<f64>) -> f64 {
    match (recorded, now) {
        (Some(a), Some(b)) => (a - b).abs(),
        _ => f64::INFINITY,
    }
}

/// Samples, and columns and rows.
type Sized<'a, T> = (&'a [T], (u32, u32));

fn sized<T>(raster: &Raster<T>) -> Sized<'_, T>
where
    image::Luma<T>: image::Pixel<Subpixel = T>,
{
    (raster.as_raw(), raster.dimensions())
}

/// `None` for NaN.
fn float(value: &f32) -> Option<f64> {
    (!value.is_nan()).then(|| f64::from(*value))
}

fn pixels<T: NoUninit>(
    recorded: Sized<'_, T>,
    now: Sized<'_, T>,
    tolerance: f64,
    number: impl Fn(&T) -> Option<f64>,
) -> ValueDifference {
    let (width, _) = recorded.1;
    samples(recorded, now, tolerance, number, |at| {
        let (x, y) = (at % u64::from(width), at / u64::from(width));
        Place::Pixel(x as u32, y as u32)
    })
}

fn samples<T: NoUninit>(
    (recorded, was): Sized<'_, T>,
    (now, is): Sized<'_, T>,
    tolerance: f64,
    number: impl Fn(&T) -> Option<f64>,
    place: impl Fn(u64) -> Place,
) -> ValueDifference {
    if was != is || recorded.len() != now.len() {
        let size = |(width, height): (u32, u32)| format!("{width}x{height} pixels");
        return ValueDifference::whole(size(was), size(is));
    }
    numbers(recorded, now, tolerance, number, place)
}

/// Compares equally many samples.
fn numbers<T: NoUninit>(
    recorded: &[T],
    now: &[T],
    tolerance: f64,
    number: impl Fn(&T) -> Option<f64>,
    place: impl Fn(u64) -> Place,
) -> ValueDifference {
    const BLOCK: usize = 4096;
    let mut difference = ValueDifference::default();
    for (first, (recorded, now)) in (0..).step_by(BLOCK).zip(recorded.chunks(BLOCK).zip(now.chunks(BLOCK))) {
        // Nearly always all bytes are equal.
        if bytemuck::cast_slice::<T, u8>(recorded) == bytemuck::cast_slice::<T, u8>(now) {
            difference.numbers += recorded.len() as u64;
            continue;
        }
        for (at, (a, b)) in (first..).zip(recorded.iter().zip(now)) {
            difference.take(number(a), number(b), tolerance, || place(at));
        }
    }
    difference
}

/// Compares the pixels only: the file of an image is not recomputed.
fn images(recorded: &Image, now: &Image, tolerance: f64) -> ValueDifference {
    let (was, is) = (recorded.dimensions(), now.dimensions());
    let number = |value: &u8| Some(f64::from(*value));
    match (recorded.pixels(), now.pixels()) {
        (Pixels::Grey(a), Pixels::Grey(b)) => pixels((a.as_raw(), was), (b.as_raw(), is), tolerance, number),
        (Pixels::Rgb(a), Pixels::Rgb(b)) => samples((a.as_raw(), was), (b.as_raw(), is), tolerance, number, |at| {
            let (pixel, width) = (at / 3, u64::from(was.0));
            Place::Channel((pixel % width) as u32, (pixel / width) as u32, (at % 3) as u8)
        }),
        (Pixels::Grey(_), Pixels::Rgb(_)) => ValueDifference::whole("a grey image", "a coloured one"),
        (Pixels::Rgb(_), Pixels::Grey(_)) => ValueDifference::whole("a coloured image", "a grey one"),
    }
}

type Named = Vec<(String, Option<f64>)>;

fn named(recorded: Named, now: Named, tolerance: f64) -> ValueDifference {
    let names = |numbers: &Named| numbers.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    let (was, is) = (names(&recorded), names(&now));
    if was != is {
        // Named by the first name that only one of them has.
        let text = |names: &[String], others: &[String]| match names.iter().find(|name| !others.contains(name)) {
            Some(name) => format!("{name} among {} numbers", names.len()),
            None => format!("{} numbers", names.len()),
        };
        return ValueDifference::whole(text(&was, &is), text(&is, &was));
    }
    let mut difference = ValueDifference::default();
    for ((name, a), (_, b)) in recorded.into_iter().zip(now) {
        difference.take(a, b, tolerance, || Place::Named(name));
    }
    difference
}

fn coefficients(calibration: &Calibration) -> Named {
    let Calibration { width, height, focal_px, cx_px, cy_px, baseline_m, doffs_px } = calibration;
    let numbers = [
        ("width", f64::from(*width)),
        ("height", f64::from(*height)),
        ("focal_px", *focal_px),
        ("cx_px", *cx_px),
        ("cy_px", *cy_px),
        ("baseline_m", *baseline_m),
        ("doffs_px", *doffs_px),
    ];
    numbers.map(|(name, number)| (name.to_owned(), Some(number))).into()
}

fn single(number: &Number) -> Named {
    vec![("the number".to_owned(), Some(number.value))]
}

fn scores(value: &Value) -> Named {
    let Value::Scores(rows) = value else { return Named::new() };
    let numbers = rows.iter().flat_map(|row| {
        let pixels = if row.zone.is_empty() { row.set.to_string() } else { format!("{} {}", row.zone, row.set) };
        let counts = [("pixels", row.pixels), ("truth", row.truth), ("valid", row.valid)];
        let counts = counts.map(|(name, count)| (name, Some(count as f64)));
        let scores = row.scores.iter().map(|(metric, score)| (metric.name, Some(*score)));
        let all = counts.into_iter().chain([("log_mean", row.log_mean)]).chain(scores);
        all.map(move |(name, number)| (format!("{name} ({pixels})"), number))
    });
    numbers.collect()
}

fn points(curve: &Curve) -> Named {
    let number = |number: f64| (!number.is_nan()).then_some(number);
    let numbers = curve.points.iter().flat_map(|point| {
        let numbers = [
            ("loss", number(point.loss)),
            ("validation", point.validation.and_then(number)),
            ("learning_rate", Some(point.learning_rate)),
        ];
        numbers.map(|(name, number)| (format!("{name} at step {}", point.step), number))
    });
    numbers.collect()
}

/// Compares metres, then inverse depth that metres cannot represent.
fn depths(recorded: &Value, now: &Value, tolerance: f64) -> ValueDifference {
    let difference = match (recorded.metres(), now.metres()) {
        (Some(a), Some(b)) => pixels(sized(a), sized(b), tolerance, float),
        _ => ValueDifference::default(),
    };
    match (recorded, now) {
        _ if difference.different > 0 => difference,
        (Value::RelativeDepth(a), Value::RelativeDepth(b)) => {
            pixels(sized(a.inverse()), sized(b.inverse()), tolerance, float)
        }
        (Value::RelativeDepth(_), _) => ValueDifference::whole("inverse depth that metres do not hold", "none"),
        (_, Value::RelativeDepth(_)) => ValueDifference::whole("no inverse depth that metres do not hold", "some"),
        _ => difference,
    }
}

fn bytes(recorded: &[u8], now: &[u8]) -> ValueDifference {
    if recorded.len() != now.len() {
        return ValueDifference::whole(format!("{} bytes", recorded.len()), format!("{} bytes", now.len()));
    }
    numbers(recorded, now, 0.0, |byte| Some(f64::from(*byte)), Place::Byte)
}

#[cfg(test)]
mod tests {
    use super::{Differs, Place, ValueDifference};
    use crate::values::{Artifact, Depth, Disparity, Raster, Value};

    fn depth(metres: [f32; 4]) -> Value {
        Depth { metres: Raster::from_raw(2, 2, metres.to_vec()).unwrap() }.into()
    }

    #[test]
    fn a_lone_difference_far_down_a_map_is_found_at_its_pixel() {
        let metres: Vec<f32> =
            (0..100 * 130).map(|pixel| if pixel % 7 == 0 { f32::NAN } else { pixel as f32 }).collect();
        let map = |metres: &[f32]| Value::from(Depth { metres: Raster::from_raw(100, 130, metres.to_vec()).unwrap() });
        for pixel in [4095, 4096, 9051, 12_999] {
            let mut changed = metres.clone();
            changed[pixel] = -1.0;
            let found = ValueDifference::between(&map(&metres), &map(&changed), 0.0);
            assert_eq!((found.numbers, found.different), (13_000, 1));
            let place = Place::Pixel(pixel as u32 % 100, pixel as u32 / 100);
            let recorded = (pixel % 7 != 0).then_some(pixel as f64);
            assert_eq!(found.first, Some(Differs::Number { place, recorded, now: Some(-1.0) }));
        }
    }

    #[test]
    fn the_first_and_worst_pixels_are_found_and_a_missing_value_is_worse_than_any_number() {
        let recorded = depth([1.0, 2.0, f32::NAN, 4.5]);
        let difference = |now: [f32; 4], tolerance: f64| ValueDifference::between(&recorded, &depth(now), tolerance);
        assert_eq!(
            difference([1.0, 2.0, f32::NAN, 4.5], 0.0),
            ValueDifference { numbers: 4, ..ValueDifference::default() }
        );
        let found = difference([1.25, 2.0, f32::NAN, 5.5], 0.0);
        assert_eq!((found.numbers, found.different), (4, 2));
        let at = |x, y, recorded, now| Some(Differs::Number { place: Place::Pixel(x, y), recorded, now });
        assert_eq!(found.first, at(0, 0, Some(1.0), Some(1.25)));
        assert_eq!(found.worst, at(1, 1, Some(4.5), Some(5.5)));
        // Within a tolerance numbers are equal; a valid and a missing value never are.
        assert_eq!(difference([1.25, 2.0, f32::NAN, 5.5], 0.25).different, 1);
        assert_eq!(difference([1.0, f32::NAN, 9.0, 4.5], 100.0).different, 2);
        assert_eq!(difference([9.0, f32::NAN, f32::NAN, 4.5], 0.0).worst, at(1, 0, Some(2.0), None));
        // By their bits.
        let (zero, other) = (depth([0.0; 4]), depth([-0.0, 0.0, 0.0, 0.0]));
        assert_eq!(ValueDifference::between(&zero, &other, 0.0).different, 1);
        assert_eq!(ValueDifference::between(&zero, &other, 1e-9).different, 0);
    }

    #[test]
    fn values_of_other_sizes_and_ranges_differ_as_a_whole() {
        let wide = Depth { metres: Raster::from_raw(4, 1, vec![1.0; 4]).unwrap() }.into();
        let found = ValueDifference::between(&depth([1.0; 4]), &wide, 9.0);
        let whole = |recorded: &str, now: &str| ValueDifference::whole(recorded, now);
        assert_eq!(found, whole("2x2 pixels", "4x1 pixels"));
        let searched = |min_disparity_px| {
            Value::from(Disparity { sixteenths_px: Raster::from_raw(1, 1, vec![32]).unwrap(), min_disparity_px })
        };
        assert_eq!(ValueDifference::between(&searched(0), &searched(1), 9.0).different, 1);
        let model = |bytes: &[u8]| Value::Model(Artifact::model(bytes.to_vec()).into());
        assert_eq!(ValueDifference::between(&model(b"abc"), &model(b"abcd"), 9.0), whole("3 bytes", "4 bytes"));
        let first = ValueDifference::between(&model(b"abc"), &model(b"abd"), 0.0).first;
        assert_eq!(first, Some(Differs::Number { place: Place::Byte(2), recorded: Some(99.0), now: Some(100.0) }));
    }
}
