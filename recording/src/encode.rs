//! Values to messages.

use depthloom_graphs::values::{Calibration, Depth, Encoded, Image, Pixels};
use depthloom_graphs::{Frame, Value};
use foxglove::messages::{CameraCalibration, Timestamp};
use prost::Message;

use crate::protobuf::{put_bytes, put_fixed32, put_length, put_number, put_signed, put_varint};
use crate::schema::{BASELINE_M, MIN_DISPARITY_PX};

const NS_PER_S: u64 = 1_000_000_000;

/// Where and when a message's pixels were taken.
#[derive(Clone, Copy)]
pub(crate) struct Stamp<'a> {
    pub(crate) frame: &'a Frame,
    pub(crate) frame_id: &'a str,
}

/// The samples of a raster, row by row.
#[derive(Clone, Copy)]
enum Samples<'a> {
    U8(&'a [u8]),
    U16(&'a [u16]),
    /// Fixed-point disparities, counted from the one that means that nothing was found: that is recorded as zero and all others
    /// above it, since no viewer knows 16 bits with a sign.
    Disparities(&'a [i16], i16),
    F32(&'a [f32]),
}

struct RawImage<'a> {
    width: u32,
    height: u32,
    encoding: &'static str,
    bytes_per_pixel: u32,
    min_disparity_px: i32,
    samples: Samples<'a>,
}

/// Appends the message of a raster or a calibration.
///
/// # Panics
/// If the value is a table, a curve or an artifact, which layouts keep elsewhere.
pub(crate) fn put_value(out: &mut Vec<u8>, stamp: Stamp<'_>, value: &Value) {
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
        Value::Depth(depth) => raster(depth.metres.dimensions(), "32FC1", 4, Samples::F32(&depth.metres)),
        Value::Weight(weight) => raster(weight.share.dimensions(), "32FC1", 4, Samples::F32(&weight.share)),
        Value::Mask(mask) => raster(mask.set.dimensions(), "mono8", 1, Samples::U8(&mask.set)),
        Value::Calibration(calibration) => return put_calibration(out, stamp, calibration),
        Value::Scores(_) | Value::Samples(_) | Value::Model(_) | Value::Curve(_) => {
            unreachable!("layouts give no image channel to values of type {}", value.value_type())
        }
    };
    put_raw_image(out, stamp, &image);
}

/// The file's own bytes, where the value is an image that came from one.
pub(crate) fn encoded(value: &Value) -> Option<&Encoded> {
    match value {
        Value::Image(image) => Image::encoded(image),
        _ => None,
    }
}

/// Appends a `foxglove.CompressedImage`.
pub(crate) fn put_compressed_image(out: &mut Vec<u8>, stamp: Stamp<'_>, encoded: &Encoded) {
    put_timestamp(out, 1, stamp.frame.time_ns);
    put_bytes(out, 4, stamp.frame_id.as_bytes());
    put_bytes(out, 3, encoded.format.name().as_bytes());
    put_bytes(out, 2, &encoded.bytes);
}

/// Appends a depth map as whole millimetres: 0 = no answer, 65535 = that far or farther.
pub(crate) fn put_view(out: &mut Vec<u8>, stamp: Stamp<'_>, depth: &Depth) {
    let millimetres = |metres: &f32| {
        let rounded = (f64::from(*metres) * 1000.0).round();
        if rounded >= 1.0 { rounded.min(65535.0) as u16 } else { 0 }
    };
    let millimetres: Vec<u16> = depth.metres.iter().map(millimetres).collect();
    let (width, height) = depth.metres.dimensions();
    let samples = Samples::U16(&millimetres);
    put_raw_image(
        out,
        stamp,
        &RawImage { width, height, encoding: "16UC1", bytes_per_pixel: 2, min_disparity_px: 0, samples },
    );
}

fn put_timestamp(out: &mut Vec<u8>, field: u32, time_ns: u64) {
    let mut message = Vec::with_capacity(16);
    put_number(&mut message, 1, time_ns / NS_PER_S);
    put_number(&mut message, 2, time_ns % NS_PER_S);
    put_length(out, field, message.len());
    out.extend_from_slice(&message);
}

fn put_raw_image(out: &mut Vec<u8>, stamp: Stamp<'_>, image: &RawImage<'_>) {
    put_timestamp(out, 1, stamp.frame.time_ns);
    put_bytes(out, 7, stamp.frame_id.as_bytes());
    put_fixed32(out, 2, image.width);
    put_fixed32(out, 3, image.height);
    put_bytes(out, 4, image.encoding.as_bytes());
    put_fixed32(out, 5, image.width * image.bytes_per_pixel);
    put_signed(out, MIN_DISPARITY_PX, image.min_disparity_px);
    match image.samples {
        Samples::U8(samples) => put_bytes(out, 6, samples),
        Samples::U16(samples) => {
            put_length(out, 6, 2 * samples.len());
            put_samples(out, samples, u16::to_le_bytes);
        }
        Samples::Disparities(samples, nothing) => {
            put_length(out, 6, 2 * samples.len());
            // Wrapping, so that whatever a map holds comes back.
            put_samples(out, samples, |sample| sample.wrapping_sub(nothing).to_le_bytes());
        }
        Samples::F32(samples) => {
            put_length(out, 6, 4 * samples.len());
            put_floats(out, samples);
        }
    }
}

/// Appends numbers as little-endian bytes.
pub(crate) fn put_floats(out: &mut Vec<u8>, samples: &[f32]) {
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

fn put_calibration(out: &mut Vec<u8>, stamp: Stamp<'_>, calibration: &Calibration) {
    let time_ns = stamp.frame.time_ns;
    let message = CameraCalibration {
        timestamp: Some(Timestamp::new((time_ns / NS_PER_S) as u32, (time_ns % NS_PER_S) as u32)),
        frame_id: stamp.frame_id.to_owned(),
        width: calibration.width,
        height: calibration.height,
        // Rectified images have no distortion left; viewers want a model named.
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: calibration.k().to_vec(),
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: calibration.p().to_vec(),
    };
    out.extend_from_slice(&message.encode_to_vec());
    put_varint(out, u64::from(BASELINE_M) << 3 | 1);
    out.extend_from_slice(&calibration.baseline_m.to_le_bytes());
}
