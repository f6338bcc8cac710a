//! Values to messages.

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Encoded, Image, Pixels, Raster, TrueDisparity};
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    CameraCalibration, FrameTransform, PackedElementField, PointCloud, Pose, Quaternion, Timestamp, Vector3,
};
use prost::Message;

use crate::decode::nothing_found;
use crate::files::Cloud;
use crate::floats::PackedFloats;
use crate::messages::NumberMessage;
use crate::schema::{BASELINE_M, DOFFS_PX, INVERSE, MIN_DISPARITY_PX, Schema};
use crate::wire_format::{put_bytes, put_fixed32, put_length, put_number, put_signed, put_varint};

const NS_PER_S: u64 = 1_000_000_000;

/// Camera frame and capture time of a message's pixels.
#[derive(Clone, Copy)]
pub struct Stamp<'a> {
    /// The frame's time, nanoseconds.
    pub time_ns: u64,
    /// The camera whose pixels they are, as viewers' `frame_id`.
    pub frame_id: &'a str,
}

/// The samples of a raster, row by row.
#[derive(Clone, Copy)]
enum Samples<'a> {
    U8(&'a [u8]),
    /// True disparities, as 256ths of a pixel.
    TrueDisparities(&'a [f32]),
    /// Fixed-point disparities, counted from the one that means that nothing was found: that is recorded as zero and
    /// all others above it, since no viewer knows 16 bits with a sign.
    Disparities(&'a [i16], i16),
}

struct RawImage<'a> {
    width: u32,
    height: u32,
    encoding: &'static str,
    bytes_per_pixel: u32,
    min_disparity_px: i32,
    samples: Samples<'a>,
}

/// Appends the message of a raster, a calibration or a number, and returns its schema. Images with their file's bytes
/// become a `foxglove.CompressedImage`. Depths, weights, disparities not in whole 1/16 px and ground truth not in whole
/// 1/256 px become a `depthloom.FloatMap`, other rasters a `foxglove.RawImage`, numbers a `depthloom.Number`.
/// [`decode::value`](crate::decode::value) reads it back.
///
/// # Errors
/// If the value is of another type (scores and curves are one message per row ([`messages`](crate::messages)), samples
/// and models none), or if 16 bits do not hold its disparities.
pub fn put(out: &mut Vec<u8>, stamp: Stamp<'_>, value: &Value) -> Result<Schema, String> {
    match value {
        Value::Scores(_) | Value::Samples(_) | Value::Model(_) | Value::Reliability(_) | Value::Curve(_) => {
            return Err(format!("a value of type {} is not one message", value.value_type()));
        }
        Value::Disparity(disparity) if nothing_found(disparity.min_disparity_px).is_none() => {
            return Err(format!("disparities from {} px on do not fit into 16 bits", disparity.min_disparity_px));
        }
        _ => {}
    }
    if let Some(encoded) = encoded(value) {
        put_compressed_image(out, stamp, encoded);
        return Ok(Schema::CompressedImage);
    }
    Ok(put_value(out, stamp, value))
}

/// Appends the message of a raster, a calibration or a number, and returns its schema; an image as its pixels.
///
/// # Panics
/// If the value is a table, a curve or an artefact: see [`put`].
pub fn put_value(out: &mut Vec<u8>, stamp: Stamp<'_>, value: &Value) -> Schema {
    let plain = |out: &mut Vec<u8>, map: &Raster<f32>| {
        put_float_map(out, stamp, map.dimensions(), &Floats::Plain(map));
        Schema::FloatMap
    };
    let raster = |(width, height), encoding, bytes_per_pixel, samples| RawImage {
        width,
        height,
        encoding,
        bytes_per_pixel,
        min_disparity_px: 0,
        samples,
    };
    let image = match value {
        Value::Image(image) => match image.pixels() {
            Pixels::Grey(grey) => raster(grey.dimensions(), "mono8", 1, Samples::U8(grey)),
            Pixels::Rgb(rgb) => raster(rgb.dimensions(), "rgb8", 3, Samples::U8(rgb)),
        },
        Value::Disparity(disparity) => RawImage {
            min_disparity_px: disparity.min_disparity_px,
            ..raster(
                disparity.sixteenths_px.dimensions(),
                "16UC1",
                2,
                Samples::Disparities(&disparity.sixteenths_px, disparity.invalid() as i16),
            )
        },
        Value::FloatDisparity(disparity) => return plain(out, disparity.px()),
        Value::TrueDisparity(truth) if truth.is_px_256() => {
            put_true_disparity(out, stamp, truth);
            return Schema::RawImage;
        }
        Value::TrueDisparity(truth) => return plain(out, &truth.px),
        Value::Depth(depth) => return plain(out, &depth.metres),
        Value::RelativeDepth(map) => {
            plain(out, &map.depth().metres);
            put_inverse(out, map.inverse());
            return Schema::FloatMap;
        }
        Value::RelativeInverseDepth(map) => return plain(out, &map.values),
        Value::Weight(weight) => return plain(out, &weight.share),
        Value::Mask(mask) => raster(mask.set.dimensions(), "mono8", 1, Samples::U8(&mask.set)),
        Value::Calibration(calibration) => {
            put_camera(out, stamp, calibration, false);
            return Schema::CameraCalibration;
        }
        Value::Number(number) => {
            out.extend_from_slice(&NumberMessage { value: Some(number.value) }.encode_to_vec());
            return Schema::Number;
        }
        Value::Scores(_) | Value::Samples(_) | Value::Model(_) | Value::Reliability(_) | Value::Curve(_) => {
            unreachable!("a value of type {} is not one message", value.value_type())
        }
    };
    put_raw_image(out, stamp, &image);
    Schema::RawImage
}

/// Appends true disparities as a `foxglove.RawImage`, in the fixed point of KITTI's files, which must hold them.
pub fn put_true_disparity(out: &mut Vec<u8>, stamp: Stamp<'_>, truth: &TrueDisparity) {
    let (width, height) = truth.px.dimensions();
    let samples = Samples::TrueDisparities(&truth.px);
    put_raw_image(
        out,
        stamp,
        &RawImage { width, height, encoding: "16UC1", bytes_per_pixel: 2, min_disparity_px: 0, samples },
    );
}

/// The file's own bytes, where the value is an image that came from one.
pub fn encoded(value: &Value) -> Option<&Encoded> {
    match value {
        Value::Image(image) => Image::encoded(image),
        _ => None,
    }
}

/// Appends a `foxglove.CompressedImage`.
pub fn put_compressed_image(out: &mut Vec<u8>, stamp: Stamp<'_>, encoded: &Encoded) {
    put_timestamp(out, 1, stamp.time_ns);
    put_bytes(out, 4, stamp.frame_id.as_bytes());
    put_bytes(out, 3, encoded.format.name().as_bytes());
    put_bytes(out, 2, &encoded.bytes);
}

fn put_timestamp(out: &mut Vec<u8>, field: u32, time_ns: u64) {
    let mut message = Vec::with_capacity(16);
    put_number(&mut message, 1, time_ns / NS_PER_S);
    put_number(&mut message, 2, time_ns % NS_PER_S);
    put_length(out, field, message.len());
    out.extend_from_slice(&message);
}

fn put_raw_image(out: &mut Vec<u8>, stamp: Stamp<'_>, image: &RawImage<'_>) {
    put_timestamp(out, 1, stamp.time_ns);
    put_bytes(out, 7, stamp.frame_id.as_bytes());
    put_fixed32(out, 2, image.width);
    put_fixed32(out, 3, image.height);
    put_bytes(out, 4, image.encoding.as_bytes());
    put_fixed32(out, 5, image.width * image.bytes_per_pixel);
    put_signed(out, MIN_DISPARITY_PX, image.min_disparity_px);
    match image.samples {
        Samples::U8(samples) => put_bytes(out, 6, samples),
        Samples::TrueDisparities(samples) => {
            put_length(out, 6, 2 * samples.len());
            put_samples(out, samples, |px| TrueDisparity::to_px_256(px).to_le_bytes());
        }
        Samples::Disparities(samples, nothing) => {
            put_length(out, 6, 2 * samples.len());
            // Wrapping, so that whatever a map holds comes back.
            put_samples(out, samples, |sample| sample.wrapping_sub(nothing).to_le_bytes());
        }
    }
}

/// The samples of a map of floats, as its message holds them.
#[derive(Clone, Copy, Debug)]
pub enum Floats<'a> {
    /// As they are.
    Plain(&'a [f32]),
    /// As their differences.
    Packed(&'a PackedFloats),
}

/// Appends a `depthloom.FloatMap`.
pub fn put_float_map(out: &mut Vec<u8>, stamp: Stamp<'_>, (width, height): (u32, u32), floats: &Floats<'_>) {
    put_timestamp(out, 1, stamp.time_ns);
    put_bytes(out, 7, stamp.frame_id.as_bytes());
    put_fixed32(out, 2, width);
    put_fixed32(out, 3, height);
    match floats {
        Floats::Plain(samples) => {
            put_length(out, 6, 4 * samples.len());
            put_floats(out, samples);
        }
        Floats::Packed(PackedFloats { codes, lows }) => {
            put_bytes(out, 8, codes);
            put_bytes(out, 9, lows);
        }
    }
}

/// Appends to a `depthloom.FloatMap` of metres the inverse depth that they do not hold.
pub fn put_inverse(out: &mut Vec<u8>, inverse: &[f32]) {
    put_length(out, INVERSE, 4 * inverse.len());
    put_floats(out, inverse);
}

/// Appends numbers as little-endian bytes.
pub fn put_floats(out: &mut Vec<u8>, samples: &[f32]) {
    put_samples(out, samples, f32::to_le_bytes);
}

/// Appends samples as little-endian bytes, through a block that stays in the nearest cache.
fn put_samples<T: Copy, const N: usize>(out: &mut Vec<u8>, samples: &[T], bytes: impl Fn(T) -> [u8; N]) {
    const BLOCK: usize = 4096;
    let mut block = [0; BLOCK];
    for samples in samples.chunks(BLOCK / N) {
        for (into, &sample) in block.chunks_exact_mut(N).zip(samples) {
            into.copy_from_slice(&bytes(sample));
        }
        out.extend_from_slice(&block[..samples.len() * N]);
    }
}

/// Appends the calibration of a pair's reference camera, or of its right one: the same, a baseline to the right, with
/// its own principal point.
pub fn put_camera(out: &mut Vec<u8>, stamp: Stamp<'_>, calibration: &Calibration, is_right: bool) {
    let p = if is_right { calibration.p_right() } else { calibration.p() };
    let mut k = calibration.k();
    k[2] = p[2];
    let message = CameraCalibration {
        timestamp: Some(timestamp(stamp.time_ns)),
        frame_id: stamp.frame_id.to_owned(),
        width: calibration.width,
        height: calibration.height,
        // Rectified images have no distortion left; viewers expect the name of a model.
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: k.to_vec(),
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: p.to_vec(),
    };
    out.extend_from_slice(&message.encode_to_vec());
    put_varint(out, u64::from(BASELINE_M) << 3 | 1);
    out.extend_from_slice(&calibration.baseline_m.to_le_bytes());
    if calibration.doffs_px != 0.0 {
        put_varint(out, u64::from(DOFFS_PX) << 3 | 1);
        out.extend_from_slice(&calibration.doffs_px.to_le_bytes());
    }
}

/// Appends a `foxglove.PointCloud`: x, y and z as floats, red, green, blue and alpha as bytes; white where there are no
/// colours.
pub fn put_points(out: &mut Vec<u8>, stamp: Stamp<'_>, cloud: &Cloud) {
    let field = |name: &str, offset, kind: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    let floats = ["x", "y", "z"].iter().zip([0, 4, 8]).map(|(name, at)| field(name, at, NumericType::Float32));
    let bytes = ["red", "green", "blue", "alpha"].iter().zip(12..);
    let bytes = bytes.map(|(name, at)| field(name, at, NumericType::Uint8));
    let mut data = Vec::with_capacity(16 * cloud.points.len());
    for (index, point) in cloud.points.iter().enumerate() {
        point.iter().for_each(|metres| data.extend_from_slice(&metres.to_le_bytes()));
        let [red, green, blue] = cloud.colours.as_ref().map_or([255; 3], |colours| colours[index]);
        data.extend_from_slice(&[red, green, blue, 255]);
    }
    let message = PointCloud {
        timestamp: Some(timestamp(stamp.time_ns)),
        frame_id: stamp.frame_id.to_owned(),
        pose: Some(Pose {
            position: Some(Vector3::default()),
            orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        }),
        point_stride: 16,
        fields: floats.chain(bytes).collect(),
        data: data.into(),
    };
    out.extend_from_slice(&message.encode_to_vec());
}

/// Appends the pose of the stamp's frame in another: its origin there, metres, and its rotation, a quaternion (x, y, z,
/// w).
pub fn put_transform(out: &mut Vec<u8>, stamp: Stamp<'_>, parent: &str, origin_m: [f64; 3], rotation: [f64; 4]) {
    let [x, y, z] = origin_m;
    let translation = Some(Vector3 { x, y, z });
    let [x, y, z, w] = rotation;
    let message = FrameTransform {
        timestamp: Some(timestamp(stamp.time_ns)),
        parent_frame_id: parent.to_owned(),
        child_frame_id: stamp.frame_id.to_owned(),
        translation,
        rotation: Some(Quaternion { x, y, z, w }),
    };
    out.extend_from_slice(&message.encode_to_vec());
}

fn timestamp(time_ns: u64) -> Timestamp {
    Timestamp::new((time_ns / NS_PER_S) as u32, (time_ns % NS_PER_S) as u32)
}
