//! How a value is compressed. This depends on its type, and for images on a sample of their bytes: equal values have
//! equal chunks.

use depthloom_codecs::compression;
use depthloom_codecs::encode::{
    Floats, Stamp, encoded, put_compressed_image, put_float_map, put_inverse, put_true_disparity, put_value,
};
use depthloom_codecs::floats::PackedFloats;
use depthloom_codecs::messages::ScoreMessage;
use depthloom_graphs::values::{Pixels, Raster};
use depthloom_graphs::{Frame, Value};

use crate::write::layout::PortLayout;
use crate::write::part::{Messages, Packing, Unkept};

/// An image is compressed if a sample of it shrinks to less than this share: otherwise compression takes more time than
/// it saves in writing.
const WORTH_COMPRESSING: f64 = 0.5;
/// Messages with fewer bytes are stored uncompressed.
const SMALL: usize = 1024;
/// The sample: this many windows of this many bytes, evenly spaced.
const WINDOWS: usize = 8;
const WINDOW: usize = 4096;

/// Adds a value of a port to a part: rasters in separate chunks, packed or compressed.
pub(crate) fn put_port_value(
    part: &mut impl Messages,
    frame: &Frame,
    port: &PortLayout,
    value: &Value,
) -> Result<(), Unkept> {
    let stamp = Stamp { time_ns: frame.time_ns, frame_id: &port.frame_id };
    if let (Some(encoded), Some(channel)) = (encoded(value), port.other_channel) {
        let put = |out: &mut Vec<u8>| put_compressed_image(out, stamp, encoded);
        return part.alone(channel, Packing::Plain, encoded.bytes.len(), put);
    }
    let (packing, size) = match value {
        Value::Disparity(disparity) => (Packing::Compressed, 2 * disparity.sixteenths_px.len()),
        Value::FloatDisparity(map) => {
            let channel = port.other_channel.expect("disparities have two channels");
            return put_floats(part, channel, stamp, map.px());
        }
        Value::RelativeDepth(map) => {
            let packed = PackedFloats::pack(&map.depth().metres).map_err(Unkept::Compression)?;
            let put = |out: &mut Vec<u8>| {
                put_float_map(out, stamp, map.inverse().dimensions(), &Floats::Packed(&packed));
                put_inverse(out, map.inverse());
            };
            return part.alone(port.channel, Packing::Compressed, 8 * map.inverse().len(), put);
        }
        Value::Mask(mask) => (Packing::Compressed, mask.set.len()),
        Value::TrueDisparity(truth) if !truth.is_px_256() => {
            let channel = port.other_channel.expect("true disparities have two channels");
            return put_floats(part, channel, stamp, &truth.px);
        }
        Value::TrueDisparity(truth) => {
            let put = |out: &mut Vec<u8>| put_true_disparity(out, stamp, truth);
            return part.alone(port.channel, Packing::Compressed, 2 * truth.px.len(), put);
        }
        Value::Depth(depth) => return put_floats(part, port.channel, stamp, &depth.metres),
        Value::RelativeInverseDepth(map) => return put_floats(part, port.channel, stamp, &map.values),
        Value::Weight(weight) => return put_floats(part, port.channel, stamp, &weight.share),
        Value::Image(image) => {
            let samples: &[u8] = match image.pixels() {
                Pixels::Grey(grey) => grey,
                Pixels::Rgb(rgb) => rgb,
            };
            let is_worth_it = measured(samples)? < WORTH_COMPRESSING;
            (if is_worth_it { Packing::Compressed } else { Packing::Plain }, samples.len())
        }
        Value::Scores(rows) => {
            return rows.iter().try_for_each(|row| part.small(port.channel, &ScoreMessage::encoded(&frame.id, row)));
        }
        Value::Calibration(_)
        | Value::Samples(_)
        | Value::Model(_)
        | Value::Reliability(_)
        | Value::Curve(_)
        | Value::Number(_) => {
            let mut message = Vec::with_capacity(512);
            put_value(&mut message, stamp, value);
            return part.small(port.channel, &message);
        }
    };
    part.alone(port.channel, packing, size, |out| {
        put_value(out, stamp, value);
    })
}

/// Adds a map of floats to a part, packed.
fn put_floats(part: &mut impl Messages, channel: u16, stamp: Stamp<'_>, map: &Raster<f32>) -> Result<(), Unkept> {
    let packed = PackedFloats::pack(map).map_err(Unkept::Compression)?;
    let size = packed.codes.len() + packed.lows.len();
    part.alone(channel, Packing::Plain, size, |out| {
        put_float_map(out, stamp, map.dimensions(), &Floats::Packed(&packed));
    })
}

/// The share to which zstd shrinks the samples of an image, measured on a few of them. 1 for images that are too small.
pub(crate) fn measured(samples: &[u8]) -> Result<f64, Unkept> {
    let mut sample = Vec::with_capacity(WINDOWS * WINDOW);
    if samples.len() <= WINDOWS * WINDOW {
        sample.extend_from_slice(samples);
    } else {
        let step = (samples.len() - WINDOW) / (WINDOWS - 1);
        for at in (0..WINDOWS).map(|number| number * step) {
            sample.extend_from_slice(&samples[at..at + WINDOW]);
        }
    }
    let mut packed = Vec::with_capacity(compression::bound(sample.len()));
    let packed = compression::compress(&sample, &mut packed).map_err(Unkept::Compression)?;
    Ok(if sample.len() < SMALL { 1.0 } else { packed as f64 / sample.len() as f64 })
}

#[cfg(test)]
mod tests {
    use super::measured;

    #[test]
    fn noise_does_not_shrink_and_repetition_does() {
        let mut state = 1_u64;
        let noise: Vec<u8> = (0..200_000)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 56) as u8
            })
            .collect();
        let share = |samples: &[u8]| measured(samples).unwrap();
        assert!(share(&noise) > 0.99);
        assert!(share(&noise.iter().map(|byte| byte % 2).collect::<Vec<u8>>()) < 0.3);
        assert_eq!(share(&[0; 100]), 1.0, "too small to matter");
    }
}
