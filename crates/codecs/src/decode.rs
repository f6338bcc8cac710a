//! Messages to values.

use std::sync::Arc;

use depthloom_graphs::values::{
    Calibration, Depth, Disparity, Encoded, Image, ImageFormat, Mask, Number, Pixels, Raster, RelativeInverseDepth,
    TrueDisparity, Weight,
};
use depthloom_graphs::{Value, ValueType};
use depthloom_scores::ScoreRow;
use foxglove::messages::CameraCalibration;
use image::{DynamicImage, GrayImage, ImageBuffer, Luma, RgbImage};
use prost::Message;

use crate::floats::unpacked;
use crate::messages::{NumberMessage, ScoreMessage};
use crate::schema::{BASELINE_M, DOFFS_PX, INVERSE, MIN_DISPARITY_PX, Schema};
use crate::wire_format::{Content, Fields};

/// Reads a raster, a calibration or a number.
pub fn value(schema: Schema, value_type: ValueType, message: &[u8]) -> Result<Value, String> {
    match (schema, value_type) {
        (Schema::CompressedImage, ValueType::Image) => compressed_image(message).map(Value::from),
        (Schema::CameraCalibration, ValueType::Calibration) => calibration(message).map(Value::from),
        (Schema::Number, ValueType::Number) => number(message).map(Value::from),
        (Schema::RawImage, _) => raw_image(message)?.value(value_type),
        (Schema::FloatMap, ValueType::Depth) => depth(message),
        (Schema::FloatMap, ValueType::Disparity) => Ok(Value::disparity_from_px(float_map(message)?)),
        (Schema::FloatMap, ValueType::RelativeInverseDepth) => {
            Ok(RelativeInverseDepth { values: float_map(message)? }.into())
        }
        (Schema::FloatMap, ValueType::Weight) => Ok(Weight { share: float_map(message)? }.into()),
        (Schema::FloatMap, ValueType::TrueDisparity) => Ok(TrueDisparity { px: float_map(message)? }.into()),
        _ => Err(format!("a {} message holds no {value_type}", schema.name())),
    }
}

/// Reads a row of scores.
pub fn score(message: &[u8]) -> Result<ScoreRow, String> {
    ScoreMessage::decode(message).map(|score| score.row)
}

fn number(message: &[u8]) -> Result<Number, String> {
    let decoded = NumberMessage::decode(message).map_err(|error| format!("a message is not a number: {error}"))?;
    decoded.value.map(|value| Number { value }).ok_or_else(|| "a message has no number".to_owned())
}

fn compressed_image(message: &[u8]) -> Result<Image, String> {
    let (mut data, mut format): (&[u8], &[u8]) = (&[], &[]);
    for field in Fields(message) {
        match field.map_err(|error| error.to_string())? {
            (2, content) => data = content.bytes(),
            (3, content) => format = content.bytes(),
            _ => {}
        }
    }
    let formats = [(ImageFormat::Png, image::ImageFormat::Png), (ImageFormat::Jpeg, image::ImageFormat::Jpeg)];
    let known = formats.into_iter().find(|(ours, _)| ours.name().as_bytes() == format);
    let Some((format, codec)) = known else {
        return Err(format!("an image is compressed as `{}`", String::from_utf8_lossy(format)));
    };
    let failed = |error: String| format!("an image cannot be decompressed: {error}");
    let as_jpeg = if format == ImageFormat::Jpeg { crate::jpeg::decode(data).map_err(failed)? } else { None };
    let pixels = match as_jpeg {
        Some(pixels) => pixels,
        None => match image::load_from_memory_with_format(data, codec).map_err(|error| failed(error.to_string()))? {
            DynamicImage::ImageLuma8(grey) => Pixels::Grey(grey),
            other => Pixels::Rgb(other.into_rgb8()),
        },
    };
    Ok(Image::with_encoded(pixels, Encoded { format, bytes: data.into() }))
}

fn calibration(message: &[u8]) -> Result<Calibration, String> {
    let no_calibration = |error: prost::DecodeError| format!("a message is not a calibration: {error}");
    let decoded = CameraCalibration::decode(message).map_err(no_calibration)?;
    let (mut baseline_m, mut doffs_px) = (None, 0.0);
    for field in Fields(message) {
        match field.map_err(|error| error.to_string())? {
            (BASELINE_M, Content::Fixed64(bits)) => baseline_m = Some(f64::from_bits(bits)),
            (DOFFS_PX, Content::Fixed64(bits)) => doffs_px = f64::from_bits(bits),
            _ => {}
        }
    }
    let [focal_px, _, cx_px, _, _, cy_px, ..] = decoded.k[..] else {
        return Err("K of a calibration is not a 3x3 matrix".to_owned());
    };
    let baseline_m = baseline_m.ok_or("a calibration has no baseline")?;
    Ok(Calibration { width: decoded.width, height: decoded.height, focal_px, cx_px, cy_px, baseline_m, doffs_px })
}

/// The invalid value of disparity maps with this smallest disparity, 1/16 px; `None` if it does not fit 16 bits.
#[must_use]
pub fn nothing_found(min_disparity_px: i32) -> Option<i16> {
    i16::try_from(min_disparity_px.checked_sub(1)?.checked_mul(16)?).ok()
}

/// Reads a `depthloom.FloatMap` of metres, with the inverse depth if it was recorded.
fn depth(message: &[u8]) -> Result<Value, String> {
    let metres = float_map(message)?;
    let inverse = inverse_bytes(message)?;
    if inverse.is_empty() {
        return Ok(Depth { metres }.into());
    }
    let samples = inverse.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    let is_whole = inverse.len() == 4 * metres.len();
    let inverse = is_whole.then(|| Raster::from_raw(metres.width(), metres.height(), samples)).flatten();
    let inverse = inverse.ok_or("a map of inverse depth is of another size than its depth")?;
    Ok(Value::depth_with_hidden_inverse(Depth { metres }, inverse))
}

/// The inverse depth of a `depthloom.FloatMap`, as little-endian bytes; empty if it was not recorded.
pub fn inverse_bytes(message: &[u8]) -> Result<&[u8], String> {
    let mut inverse: &[u8] = &[];
    for field in Fields(message) {
        if let (INVERSE, content) = field.map_err(|error| error.to_string())? {
            inverse = content.bytes();
        }
    }
    Ok(inverse)
}

/// Reads a `depthloom.FloatMap`.
pub fn float_map(message: &[u8]) -> Result<Raster<f32>, String> {
    let (mut width, mut height) = (0, 0);
    let [mut data, mut codes, mut lows]: [&[u8]; 3] = [&[]; 3];
    for field in Fields(message) {
        match field.map_err(|error| error.to_string())? {
            (2, content) => width = content.fixed32(),
            (3, content) => height = content.fixed32(),
            (6, content) => data = content.bytes(),
            (8, content) => codes = content.bytes(),
            (9, content) => lows = content.bytes(),
            _ => {}
        }
    }
    let count = usize::try_from(u64::from(width) * u64::from(height)).map_err(|error| error.to_string())?;
    let samples = if codes.is_empty() {
        data.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
    } else {
        unpacked(count, codes, lows)?
    };
    let is_whole = samples.len() == count && (!codes.is_empty() || data.len() == 4 * count);
    let raster = is_whole.then(|| Raster::from_raw(width, height, samples)).flatten();
    raster.ok_or_else(|| "the size of a map differs from its stated size".to_owned())
}

#[derive(Default)]
struct RawImage<'a> {
    width: u32,
    height: u32,
    encoding: &'a [u8],
    step: u32,
    min_disparity_px: i32,
    data: &'a [u8],
}

fn raw_image(message: &[u8]) -> Result<RawImage<'_>, String> {
    let mut image = RawImage::default();
    for field in Fields(message) {
        match field.map_err(|error| error.to_string())? {
            (2, content) => image.width = content.fixed32(),
            (3, content) => image.height = content.fixed32(),
            (4, content) => image.encoding = content.bytes(),
            (5, content) => image.step = content.fixed32(),
            (6, content) => image.data = content.bytes(),
            (MIN_DISPARITY_PX, content) => image.min_disparity_px = content.signed(),
            _ => {}
        }
    }
    Ok(image)
}

impl RawImage<'_> {
    fn value(&self, value_type: ValueType) -> Result<Value, String> {
        match (value_type, self.encoding) {
            (ValueType::Image, b"mono8") => {
                let grey = GrayImage::from_raw(self.width, self.height, self.samples(1, |[sample]: [u8; 1]| sample)?);
                Ok(Image::new(Pixels::Grey(grey.ok_or("the size of an image differs from its stated size")?)).into())
            }
            (ValueType::Image, b"rgb8") => {
                let rgb = RgbImage::from_raw(self.width, self.height, self.samples(3, |[sample]: [u8; 1]| sample)?);
                Ok(Image::new(Pixels::Rgb(rgb.ok_or("the size of an image differs from its stated size")?)).into())
            }
            (ValueType::Disparity, b"16UC1") => {
                let min_disparity_px = self.min_disparity_px;
                let nothing = nothing_found(min_disparity_px)
                    .ok_or_else(|| format!("disparities from {min_disparity_px} px on do not fit into 16 bits"))?;
                let sixteenths_px = self.raster(|sample| i16::from_le_bytes(sample).wrapping_add(nothing))?;
                Ok(Disparity { sixteenths_px, min_disparity_px }.into())
            }
            (ValueType::TrueDisparity, b"16UC1") => {
                Ok(TrueDisparity::from_px_256(&self.raster(u16::from_le_bytes)?).into())
            }
            (ValueType::Depth, b"32FC1") => Ok(Depth { metres: self.raster(f32::from_le_bytes)? }.into()),
            (ValueType::Weight, b"32FC1") => Ok(Weight { share: self.raster(f32::from_le_bytes)? }.into()),
            (ValueType::Mask, b"mono8") => Ok(Mask { set: self.raster(|[sample]: [u8; 1]| sample)? }.into()),
            (_, encoding) => {
                Err(format!("an image of encoding `{}` holds no {value_type}", String::from_utf8_lossy(encoding)))
            }
        }
    }

    fn raster<T: Copy, const N: usize>(&self, sample: impl Fn([u8; N]) -> T) -> Result<Raster<T>, String>
    where
        Luma<T>: image::Pixel<Subpixel = T>,
    {
        let samples = self.samples(1, sample)?;
        ImageBuffer::from_raw(self.width, self.height, samples)
            .ok_or_else(|| "the size of an image differs from its stated size".to_owned())
    }

    fn samples<T, const N: usize>(&self, channels: u128, sample: impl Fn([u8; N]) -> T) -> Result<Vec<T>, String> {
        let row = u128::from(self.width) * channels * N as u128;
        if u128::from(self.step) != row || self.data.len() as u128 != row * u128::from(self.height) {
            let (width, height, bytes) = (self.width, self.height, self.data.len());
            return Err(format!("an image of {width}x{height} pixels has {bytes} bytes"));
        }
        let (chunks, _) = self.data.as_chunks::<N>();
        Ok(chunks.iter().map(|bytes| sample(*bytes)).collect())
    }
}

/// Collects the messages of one topic on one frame.
#[derive(Default)]
pub enum Gathered {
    /// No message yet.
    #[default]
    Nothing,
    /// The last message's.
    Value(Value),
    /// Rows of scores, one a message.
    Rows(Vec<ScoreRow>),
}

impl Gathered {
    /// Takes the next message of the topic.
    pub fn take(&mut self, schema: Schema, value_type: ValueType, message: &[u8]) -> Result<(), String> {
        if schema == Schema::Score {
            let row = score(message)?;
            match self {
                Self::Rows(rows) => rows.push(row),
                Self::Nothing | Self::Value(_) => *self = Self::Rows(vec![row]),
            }
        } else {
            *self = Self::Value(value(schema, value_type, message)?);
        }
        Ok(())
    }

    /// What they amount to.
    #[must_use]
    pub fn into_value(self) -> Option<Value> {
        match self {
            Self::Nothing => None,
            Self::Value(value) => Some(value),
            Self::Rows(rows) => Some(Value::Scores(Arc::new(rows))),
        }
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::values::{Calibration, Number, Raster, TrueDisparity};
    use depthloom_graphs::{Value, ValueType};
    use depthloom_scores::{Metric, PixelSet, ScoreRow};

    use super::{score, value};
    use crate::encode::{Stamp, put};
    use crate::messages::ScoreMessage;
    use crate::schema::Schema;

    #[test]
    fn true_disparities_come_back_as_they_were() {
        let recorded = |truth: &TrueDisparity| {
            let mut message = Vec::new();
            let value = Value::from(truth.clone());
            let schema = put(&mut message, Stamp { time_ns: 0, frame_id: "left" }, &value).unwrap();
            (schema, message)
        };
        let px_256 = Raster::from_raw(3, 1, vec![0, 1, u16::MAX]).unwrap();
        let (schema, message) = recorded(&TrueDisparity::from_px_256(&px_256));
        assert_eq!((schema, &message[message.len() - 6..]), (Schema::RawImage, &[0, 0, 1, 0, 255, 255][..]));
        let Ok(Value::TrueDisparity(read)) = value(schema, ValueType::TrueDisparity, &message) else { panic!("read") };
        assert_eq!(read.px_256(), Some(px_256));
        assert!(value(schema, ValueType::Depth, &message).is_err());
        // What sixteen bits do not hold is kept as it is.
        let px = Raster::from_raw(4, 1, vec![0.0, f32::NAN, 10.000_1, 300.5]).unwrap();
        let (schema, message) = recorded(&TrueDisparity { px: px.clone() });
        assert_eq!(schema, Schema::FloatMap);
        let Ok(Value::TrueDisparity(read)) = value(schema, ValueType::TrueDisparity, &message) else { panic!("read") };
        let bits = |px: &Raster<f32>| px.iter().map(|px| px.to_bits()).collect::<Vec<u32>>();
        assert_eq!(bits(&read.px), bits(&px));
    }

    #[test]
    fn principal_points_apart_come_back_and_those_that_are_one_take_no_byte() {
        let (width, height) = (8, 4);
        let one = Calibration { width, height, focal_px: 9.0, cx_px: 4.0, cy_px: 2.0, baseline_m: 0.1, doffs_px: 0.0 };
        let apart = Calibration { doffs_px: 31.086, ..one.clone() };
        let recorded = |of: &Calibration| {
            let mut message = Vec::new();
            put(&mut message, Stamp { time_ns: 0, frame_id: "left" }, &of.clone().into()).unwrap();
            let read = value(Schema::CameraCalibration, ValueType::Calibration, &message);
            let Ok(Value::Calibration(read)) = read else { panic!("read") };
            assert_eq!(*read, *of);
            message.len()
        };
        assert_eq!(recorded(&apart), recorded(&one) + 10);
    }

    #[test]
    fn numbers_come_back_bit_for_bit() {
        for given in [0.0, -0.0, 3.0, 0.1 + 0.2, 1e-300] {
            let mut message = Vec::new();
            let schema = put(&mut message, Stamp { time_ns: 0, frame_id: "" }, &Number { value: given }.into());
            let Ok(Value::Number(read)) = value(schema.unwrap(), ValueType::Number, &message) else { panic!("read") };
            assert_eq!(read.value.to_bits(), given.to_bits());
        }
        assert!(value(Schema::Number, ValueType::Number, &[]).unwrap_err().contains("no number"));
        assert!(value(Schema::Number, ValueType::Depth, &[]).is_err());
    }

    /// The bytes of a row in older recordings, written by prost: frame, set, pixels, then doubles 4
    /// to 11.
    #[test]
    fn rows_of_before_are_read() {
        let mut message = b"\x0a\x01f\x12\x03all\x18\x07".to_vec();
        for (field, value) in [(4_u8, 0.5_f64), (9, 2.5)] {
            message.push(field << 3 | 1);
            message.extend(value.to_le_bytes());
        }
        let row = score(&message).unwrap();
        let named = |name: &str| Metric::named(name).unwrap();
        let expected = ScoreRow { pixels: 7, ..ScoreRow::new(PixelSet::All, "") };
        assert_eq!(row, expected.with(named("a1"), 0.5).with(named("rmse"), 2.5));
        assert_eq!(row.density(), None, "it does not say");
        assert_eq!(ScoreMessage::encoded("f", &row), message, "what is unknown takes no byte");
        assert!(score(b"\x12\x03odd").unwrap_err().contains("unknown pixel set `odd`"));
    }
}
