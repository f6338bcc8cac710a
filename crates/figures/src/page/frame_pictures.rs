//! The pictures of a frame: its maps and images, read from the recording and made smaller.
//!
//! Samples are picked, not averaged, so that each is a value that the recording holds; where a truth is sparse, of each
//! small square the pixel that has one, in all maps alike, so that an error is that of one pixel.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use depthloom_graphs::Value;
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::values::{Image, Pixels};
use depthloom_recording::Recording;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use super::PageError;
use super::maps::{CodeRange, Samples, Scale, Steps, encode};
use super::series::{Layer, Role, Series, class_of};
use super::sizes::Size;
use crate::scored_map::as_scored;

/// The quality of JPEG images, of 100.
const QUALITY: u8 = 78;
/// How many topics are read at once: what a thread holds in memory.
const TOPICS_AT_ONCE: usize = 6;

/// Where a temporary file goes, and whether to stop.
#[derive(Clone, Copy)]
pub(super) struct Output<'a> {
    pub(super) folder: &'a Path,
    pub(super) stop: &'a (dyn Fn() -> bool + Sync),
}

/// A frame's text: one line per layer, empty where there is no value.
#[derive(Clone)]
pub(super) struct Made {
    pub(super) position: FrameIndex,
    pub(super) text: Vec<u8>,
    /// By layer, the range of its samples.
    pub(super) ranges: Vec<Option<CodeRange>>,
    /// By layer, the width of what was recorded.
    pub(super) widths: Vec<u32>,
    pub(super) damaged: u64,
}

/// Makes the pictures of a frame.
pub(super) fn frame(
    recording: &Recording,
    series: &Series,
    position: FrameIndex,
    size: Size,
    output: Output<'_>,
) -> Result<Made, PageError> {
    if (output.stop)() {
        return Err(PageError::Stopped);
    }
    let layers = &series.layers;
    let mut lines: Vec<Vec<u8>> = vec![Vec::new(); layers.len()];
    let mut ranges = vec![None; layers.len()];
    let mut widths = vec![0; layers.len()];
    let mut grids = Grids::default();
    let mut damaged = 0;
    // A truth decides which pixels are picked.
    let (truths, others): (Vec<usize>, Vec<usize>) = (0..layers.len())
        .filter(|&place| series.shows(place, position))
        .partition(|&place| layers[place].role == Role::Truth);
    let mut truth_values: BTreeMap<usize, Value> = BTreeMap::new();
    for places in truths.chunks(TOPICS_AT_ONCE).chain(others.chunks(TOPICS_AT_ONCE)) {
        // Layers that show a map in several ways have one topic.
        let mut topics: Vec<&str> = Vec::with_capacity(places.len());
        for &place in places {
            if !topics.contains(&layers[place].topic.as_str()) {
                topics.push(&layers[place].topic);
            }
        }
        let values = match recording.reader(series.run, &topics).and_then(|mut reader| reader.read(position)) {
            Ok(values) => values,
            Err(error) if error.is_damage() => {
                damaged += places.len() as u64;
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        for &place in places {
            let layer = &layers[place];
            let topic = topics.iter().position(|topic| *topic == layer.topic);
            let Some(value) = topic.and_then(|topic| values[topic].clone()) else { continue };
            let value = match (&layer.aligned, layer.truth.and_then(|truth| truth_values.get(&truth))) {
                (Some(settings), Some(truth)) => as_scored(&value, truth, settings).unwrap_or(value),
                _ => value,
            };
            let widest = size.widest(class_of(series, place));
            (lines[place], widths[place]) = match &value {
                Value::Image(image) => (jpeg(image, widest)?, image.dimensions().0),
                value => match picture(value, layer, widest, size.steps, &mut grids) {
                    Some((line, width, range)) => {
                        ranges[place] = range;
                        (line, width)
                    }
                    None => continue,
                },
            };
            if layer.role == Role::Truth {
                truth_values.insert(place, value);
            }
        }
    }
    let text = lines.join(&b'\n');
    Ok(Made { position, text, ranges, widths, damaged })
}

/// An image as `j` and its JPEG.
fn jpeg(image: &Image, widest: u32) -> Result<Vec<u8>, PageError> {
    let from = image.dimensions();
    let (width, height) = smaller(from, widest);
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, QUALITY);
    let encoded = match image.pixels() {
        Pixels::Grey(grey) => {
            let means = means_of_cells::<1>(grey.as_raw(), from, (width, height));
            encoder.encode(&means, width, height, ExtendedColorType::L8)
        }
        Pixels::Rgb(rgb) => {
            let means = means_of_cells::<3>(rgb.as_raw(), from, (width, height));
            encoder.encode(&means, width, height, ExtendedColorType::Rgb8)
        }
    };
    encoded.map_err(|error| {
        PageError::Content(format!("an image of {width}x{height} cannot be encoded as JPEG: {error}"))
    })?;
    Ok([b"j".as_slice(), BASE64_STANDARD.encode(&bytes).as_bytes()].concat())
}

/// An image of fewer pixels of `N` bytes, each the mean of its cell.
fn means_of_cells<const N: usize>(raw: &[u8], from: (u32, u32), to: (u32, u32)) -> Vec<u8> {
    let (pixels, _) = raw.as_chunks::<N>();
    let columns: Vec<Range<usize>> = (0..to.0).map(|x| cell(x, from.0, to.0)).collect();
    let mut means = Vec::with_capacity(to.0 as usize * to.1 as usize * N);
    let mut sums = vec![[0_u32; N]; columns.len()];
    for y in 0..to.1 {
        let rows = cell(y, from.1, to.1);
        sums.fill([0; N]);
        for line in pixels.chunks(from.0 as usize).take(rows.end).skip(rows.start) {
            for (sum, column) in sums.iter_mut().zip(&columns) {
                for pixel in &line[column.clone()] {
                    sum.iter_mut().zip(pixel).for_each(|(sum, byte)| *sum += u32::from(*byte));
                }
            }
        }
        for (sum, column) in sums.iter().zip(&columns) {
            let count = (column.len() * rows.len()) as u32;
            means.extend(sum.iter().map(|sum| ((sum + count / 2) / count) as u8));
        }
    }
    means
}

/// A map as its width, its height, those of the recorded one, and its PNG, with spaces between; the recorded width; and
/// the range of the samples. `None` if it cannot be shown.
fn picture(
    value: &Value,
    layer: &Layer,
    widest: u32,
    steps: Steps,
    grids: &mut Grids,
) -> Option<(Vec<u8>, u32, Option<CodeRange>)> {
    let (samples, scale) = (Samples::new(value)?, Scale::for_type(&layer.value_type, steps)?);
    let from = (samples.width, samples.height);
    let (width, height) = smaller(from, widest);
    if layer.role == Role::Truth && grids.truth.is_none() {
        grids.truth = Some(value.clone());
    }
    let places = grids.places(from, (width, height));
    let encoded = encode(samples, places, width as usize, scale);
    let mut line = format!("{width} {height} {} {} ", from.0, from.1);
    BASE64_STANDARD.encode_string(encoded.png, &mut line);
    Some((line.into_bytes(), from.0, encoded.range))
}

/// A size no wider than that, of the same shape.
fn smaller((width, height): (u32, u32), widest: u32) -> (u32, u32) {
    if width <= widest {
        return (width, height);
    }
    let height = (u64::from(height) * u64::from(widest) + u64::from(width) / 2) / u64::from(width);
    (widest, u32::try_from(height).unwrap_or(u32::MAX).max(1))
}

/// Which pixels of a frame are picked.
#[derive(Default)]
struct Grids {
    /// The frame's first truth.
    truth: Option<Value>,
    /// By size and smaller size: the places of the pixels.
    grids: BTreeMap<[u32; 4], Vec<usize>>,
}

impl Grids {
    /// The places of the pixels that a smaller map has of one.
    fn places(&mut self, from: (u32, u32), to: (u32, u32)) -> &[usize] {
        let truth = self.truth.as_ref().and_then(Samples::new).filter(|truth| (truth.width, truth.height) == from);
        self.grids.entry([from.0, from.1, to.0, to.1]).or_insert_with(|| {
            let columns: Vec<Range<usize>> = (0..to.0).map(|x| cell(x, from.0, to.0)).collect();
            let mut places = Vec::with_capacity(to.0 as usize * to.1 as usize);
            for y in 0..to.1 {
                let row = cell(y, from.1, to.1);
                for column in &columns {
                    places.push(picked(column.clone(), row.clone(), from.0 as usize, truth));
                }
            }
            places
        })
    }
}

/// The samples of a line that one of a shorter line stands for.
fn cell(place: u32, from: u32, to: u32) -> Range<usize> {
    let start = |place: u32| (u64::from(place) * u64::from(from) / u64::from(to)) as usize;
    start(place)..start(place + 1).max(start(place) + 1)
}

/// The pixel of a cell nearest its centre, of those with a truth if any has one.
fn picked(columns: Range<usize>, rows: Range<usize>, width: usize, truth: Option<Samples<'_>>) -> usize {
    let (x, y) = ((columns.start + columns.end - 1) / 2, (rows.start + rows.end - 1) / 2);
    let centre = y * width + x;
    let Some(truth) = truth.filter(|truth| !truth.is_valid(centre)) else { return centre };
    let (mut nearest, mut least) = (centre, usize::MAX);
    for row in rows {
        for column in columns.clone() {
            let place = row * width + column;
            let far = column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2);
            if far < least && truth.is_valid(place) {
                (nearest, least) = (place, far);
            }
        }
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;
    use depthloom_graphs::values::{Depth, Raster};

    #[test]
    fn a_smaller_map_is_made_of_pixels_with_a_truth_where_there_are_any() {
        let mut metres = vec![f32::NAN; 9 * 6];
        metres[2 * 9 + 8] = 5.0;
        let truth = Depth { metres: Raster::from_raw(9, 6, metres).unwrap() };
        let mut grids = Grids { truth: Some(truth.into()), ..Grids::default() };
        assert_eq!(grids.places((9, 6), (3, 2)), [10, 13, 26, 37, 40, 43]);
        assert_eq!(grids.places((6, 4), (3, 2)), [0, 2, 4, 12, 14, 16], "of another size, the middle ones");
        assert_eq!(grids.places((2, 1), (2, 1)), [0, 1]);
    }

    #[test]
    fn a_pixel_of_a_smaller_image_is_the_mean_of_its_cell() {
        let raw: Vec<u8> = (0..5 * 2).flat_map(|i| [10 * i, 100, 255]).collect();
        let means = means_of_cells::<3>(&raw, (5, 2), (2, 1));
        // Columns 0 and 1, then 2 to 4, of both rows.
        assert_eq!(means, [30, 100, 255, 55, 100, 255]);
        assert_eq!(means_of_cells::<1>(&raw, (30, 1), (30, 1)), raw);
    }

    #[test]
    fn a_smaller_size_has_the_same_shape() {
        assert_eq!(
            [smaller((1242, 375), 414), smaller((320, 96), 640), smaller((5000, 1), 100)],
            [(414, 125), (320, 96), (100, 1)]
        );
    }
}
