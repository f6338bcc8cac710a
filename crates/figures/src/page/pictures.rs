//! The pictures of frames: read from the recording, made smaller, and kept in a temporary file until the page is
//! written.
//!
//! How small they are made follows from how many there are, so that a page of any run stays below 40 MB. Samples are
//! picked, not averaged, so that each is a value that the recording holds; where a truth is sparse, of each small
//! square the pixel that has one, in all maps alike, so that an error is that of one pixel.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, Read, Seek as _, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use depthloom_graphs::Value;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_graphs::values::{Image, Pixels};
use depthloom_recording::Recording;
use depthloom_scores::Settings;
use depthloom_threads::{Budget, caught, core_count, in_order};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use serde_json::{Value as Json, json};

use super::PageError;
use super::colour_range::{ColourRange, RangedMap, colour_ranges};
use super::maps::{COARSE, CodeRange, FINE, Samples, Scale, Steps, encode};
use crate::scored_map::as_scored;

/// The most bytes that the pictures take with the numbers of the page: with all else it has less than 40 MB.
const MOST: u64 = 38_500_000;
/// A page of few frames has this many bytes per frame, and no less than that: larger maps cost more to make, send and
/// open than they show.
const MOST_A_FRAME: u64 = 400_000;
const MOST_OF_FEW: u64 = 6_000_000;
/// What the pictures have in any case.
const LEAST: u64 = 4_000_000;
/// A size whose estimate is above this share of what there is room for is not tried.
const TRIED: f64 = 0.94;
/// If the bytes of the tried pictures are at least this share of what there is room for, no larger ones are tried.
const LARGE_ENOUGH: f64 = 0.5;
/// How many frames of each stage run are tried: the bytes of all frames, and in other sizes, are estimated from these.
const PROBES: usize = 3;
/// The usual bytes of a pixel: of an image, and of a map with coarse steps.
const USUAL_BYTES: (f64, f64) = (0.35, 0.5);
/// The height of usual pictures, as a share of their width.
const USUAL_HEIGHT: f64 = 0.3;
/// The powers of the width that bytes grow with: for wider pictures than the probed ones, and for narrower ones, where
/// neighbouring pixels differ more. Both give an estimate that is rather too large.
const GROWTH: (f64, f64) = (2.0, 1.6);
/// The bytes of a map with fine steps, as a multiple of those with coarse steps.
const FINE_BYTES: f64 = 1.4;
/// The quality of JPEG images, of 100.
const QUALITY: u8 = 78;
/// How many topics are read at once: what a thread holds in memory.
const TOPICS_AT_ONCE: usize = 6;

/// Where a temporary file goes, and whether to stop.
#[derive(Clone, Copy)]
struct Output<'a> {
    folder: &'a Path,
    stop: &'a (dyn Fn() -> bool + Sync),
}

/// How large the pictures are, and how fine their numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Size {
    /// The most columns of images; of estimates and truths; and of all other maps.
    image: u32,
    main: u32,
    other: u32,
    steps: Steps,
}

const fn size(image: u32, main: u32, other: u32, steps: Steps) -> Size {
    Size { image, main, other, steps }
}

/// From the largest to the smallest.
const SIZES: [Size; 15] = [
    size(640, 640, 640, FINE),
    size(640, 640, 320, FINE),
    size(640, 640, 320, COARSE),
    size(640, 560, 280, COARSE),
    size(576, 496, 248, COARSE),
    size(512, 432, 216, COARSE),
    size(512, 384, 192, COARSE),
    size(448, 336, 168, COARSE),
    size(448, 300, 150, COARSE),
    size(400, 272, 136, COARSE),
    size(400, 248, 124, COARSE),
    size(384, 224, 112, COARSE),
    size(352, 200, 100, COARSE),
    size(320, 176, 88, COARSE),
    size(320, 152, 76, COARSE),
];

/// What the width of a picture depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    Image,
    Main,
    Other,
}

impl Size {
    fn widest(&self, class: Class) -> u32 {
        match class {
            Class::Image => self.image,
            Class::Main => self.main,
            Class::Other => self.other,
        }
    }
}

/// What a map is on the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// An image.
    Image,
    /// Ground truth.
    Truth,
    /// An estimate that is scored.
    Estimate,
    /// Any other map.
    Other,
}

impl Role {
    /// Its name on the page.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Image => "image",
            Self::Truth => "truth",
            Self::Estimate => "estimate",
            Self::Other => "other",
        }
    }
}

/// A topic whose values the page shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// The topic.
    pub topic: String,
    /// Its name for people: the topic without its stage.
    pub name: String,
    /// What it is.
    pub role: Role,
    /// The name of what it carries.
    pub value_type: String,
    /// Of an estimate: its estimates.
    pub estimates: Vec<usize>,
    /// Of the first of these: the place of the ground truth among the layers.
    pub truth: Option<usize>,
    /// How the first of them is scored, if it is aligned before: it is shown as it is scored.
    pub aligned: Option<Settings>,
}

/// A stage run whose maps the page shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The stage run.
    pub run: RunId,
    /// Its maps.
    pub layers: Vec<Layer>,
    /// How many maps were recorded, of which these are.
    pub recorded: usize,
    /// The positions of its frames.
    pub positions: Vec<FrameIndex>,
    /// Of these, the positions of the frames with intermediate maps and further images.
    pub detailed: BTreeSet<FrameIndex>,
}

impl Series {
    /// Whether the page shows a layer on a frame.
    fn shows(&self, place: usize, position: FrameIndex) -> bool {
        class_of(self, place) != Class::Other || self.detailed.contains(&position)
    }
}

/// Pictures, and how they were made.
pub struct Pictures {
    size: Size,
    /// By stage run, in the order of the [`Series`]: the positions of its frames, and the range of each text in the
    /// file.
    places: Vec<Vec<(FrameIndex, Range<u64>)>>,
    file: File,
    /// By series and layer, whether any frame has it.
    there: Vec<Vec<bool>>,
    /// By series, its colour scales.
    colour_ranges: Vec<Vec<ColourRange>>,
    /// The number of maps that could not be read because their bytes are damaged.
    damaged: u64,
}

impl Pictures {
    /// Makes the pictures of all frames; `numbers` bytes of the page are already used. The positions in the series are
    /// those that fit.
    ///
    /// # Errors
    /// If the recording cannot be read or the file in `folder` not be written; [`PageError::Stopped`] once `stop` says
    /// so.
    pub fn new(
        recording: &Recording,
        series: &mut [Series],
        numbers: u64,
        folder: &Path,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self, PageError> {
        let output = Output { folder, stop };
        let all: usize = series.iter().map(|series| series.positions.len()).sum();
        let most = MOST.min((MOST_A_FRAME * all as u64).max(MOST_OF_FEW));
        let budget = most.saturating_sub(numbers).max(LEAST);
        let room = TRIED * budget as f64;
        let mut level = SIZES.iter().position(|size| usual_bytes(series, size) <= room).unwrap_or(SIZES.len() - 1);
        let mut tried = None;
        if all > PROBES {
            let probes = tried.insert(Tried::new(recording, series, SIZES[level], output)?).probes(series);
            let needed = |size: &Size| probes.iter().map(|probe| probe.bytes_in(size)).sum::<f64>();
            if !(LARGE_ENOUGH * room..=room).contains(&needed(&SIZES[level])) {
                level = SIZES.iter().position(|size| needed(size) <= room).unwrap_or(SIZES.len() - 1);
            }
            let share = room / needed(&SIZES[level]);
            if share < 1.0 {
                thin(series, share);
            }
        } else {
            level = 0;
        }
        loop {
            if let Some(pictures) = Self::of_size(recording, series, SIZES[level], tried.as_ref(), budget, output)? {
                return Ok(pictures);
            }
            if level + 1 < SIZES.len() {
                level += 1;
            } else {
                thin(series, 0.8);
            }
        }
    }

    /// The pictures in a size; `None` if they are too many bytes.
    fn of_size(
        recording: &Recording,
        series: &[Series],
        size: Size,
        tried: Option<&Tried>,
        budget: u64,
        output: Output<'_>,
    ) -> Result<Option<Self>, PageError> {
        let tried = tried.filter(|tried| tried.size == size);
        let path = output.folder.join("a temporary file");
        let file = tempfile::tempfile_in(output.folder).map_err(PageError::write(&path))?;
        let mut pictures =
            Self { size, places: Vec::new(), file, there: Vec::new(), colour_ranges: Vec::new(), damaged: 0 };
        let threads = core_count();
        let mut end = 0;
        for (number, of) in series.iter().enumerate() {
            let known = |position: FrameIndex| {
                tried.and_then(|tried| tried.frames[number].iter().find(|made| made.position == position)).cloned()
            };
            let make = |position| known(position).map_or_else(|| frame(recording, of, position, size, output), Ok);
            let mut places = Vec::with_capacity(of.positions.len());
            let mut there = vec![false; of.layers.len()];
            let mut ranges: Vec<Vec<CodeRange>> = vec![Vec::new(); of.layers.len()];
            // In order, and no more in memory than there are threads.
            for positions in of.positions.chunks(2 * threads) {
                for made in all_at_once(positions, threads, &make)? {
                    let Made { position, text, ranges: of_frame, damaged, .. } = made;
                    ranges.iter_mut().zip(of_frame).for_each(|(ranges, range)| ranges.extend(range));
                    pictures.damaged += damaged;
                    there
                        .iter_mut()
                        .zip(text.split(|byte| *byte == b'\n'))
                        .for_each(|(there, line)| *there |= !line.is_empty());
                    pictures.file.write_all(&text).map_err(PageError::write(&path))?;
                    let start = end;
                    end += text.len() as u64;
                    places.push((position, start..end));
                }
                if end > budget && of.positions.len() > 1 {
                    return Ok(None);
                }
            }
            pictures.places.push(places);
            pictures.there.push(there);
            let maps = of.layers.iter().zip(&ranges).filter_map(|(layer, frames)| {
                let scale = Scale::for_type(&layer.value_type, size.steps)?;
                let is_truth = layer.role == Role::Truth;
                Some(RangedMap { value_type: &layer.value_type, is_truth, scale, frames })
            });
            pictures.colour_ranges.push(colour_ranges(&maps.collect::<Vec<_>>()));
        }
        Ok(Some(pictures))
    }

    /// How fine the numbers are.
    #[must_use]
    pub fn steps(&self) -> Steps {
        self.size.steps
    }

    /// How fine the numbers are and how wide maps are, as the page's scripts read it.
    #[must_use]
    pub fn steps_json(&self) -> Json {
        let Size { steps, main, .. } = self.size;
        json!({ "depth": steps.depth, "disparity_px": steps.disparity_px, "widest": main })
    }

    /// By series and layer, whether any frame has it.
    #[must_use]
    pub fn there(&self) -> &[Vec<bool>] {
        &self.there
    }

    /// By series, its colour scales.
    #[must_use]
    pub fn colour_ranges(&self) -> &[Vec<ColourRange>] {
        &self.colour_ranges
    }

    /// How many maps could not be read, because their bytes are damaged.
    #[must_use]
    pub fn damaged(&self) -> u64 {
        self.damaged
    }

    /// Writes the elements of all frames: `<script id="p0-17">` is that of the frame at position 17 of the first
    /// series.
    pub(super) fn write(&mut self, out: &mut impl Write) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(0))?;
        let mut file = io::BufReader::with_capacity(1 << 16, &self.file);
        for (series, places) in self.places.iter().enumerate() {
            for (position, place) in places {
                write!(out, "<script type=\"text/plain\" id=\"p{series}-{position}\">")?;
                let copied = io::copy(&mut (&mut file).take(place.end - place.start), out)?;
                if copied < place.end - place.start {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
                out.write_all(b"</script>\n")?;
            }
        }
        Ok(())
    }
}

/// The bytes that pictures usually take in a size.
fn usual_bytes(series: &[Series], size: &Size) -> f64 {
    let of_layer = |of: &Series, place: usize| {
        let class = class_of(of, place);
        let width = f64::from(size.widest(class));
        let pixels = frames_with(of, class) as f64 * USUAL_HEIGHT * width * width;
        let fine = if size.steps == FINE { FINE_BYTES } else { 1.0 };
        pixels * if of.layers[place].role == Role::Image { USUAL_BYTES.0 } else { fine * USUAL_BYTES.1 }
    };
    series.iter().map(|of| (0..of.layers.len()).map(|place| of_layer(of, place)).sum::<f64>()).sum()
}

/// How many frames have pictures of a class.
fn frames_with(series: &Series, class: Class) -> usize {
    if class == Class::Other { series.detailed.len() } else { series.positions.len() }
}

/// Some frames of each stage run in a size, which are used if all frames get this size.
struct Tried {
    size: Size,
    frames: Vec<Vec<Made>>,
}

impl Tried {
    fn new(recording: &Recording, series: &[Series], size: Size, output: Output<'_>) -> Result<Self, PageError> {
        let some = |of: &Series| {
            // These have all maps.
            let detailed: Vec<FrameIndex> = of.detailed.iter().copied().collect();
            let count = detailed.len();
            let some = PROBES.min(count);
            let tried: Vec<FrameIndex> = (0..some).map(|i| detailed[(2 * i + 1) * count / (2 * some)]).collect();
            all_at_once(&tried, core_count(), &|position| frame(recording, of, position, size, output))
        };
        Ok(Self { size, frames: series.iter().map(some).collect::<Result<_, _>>()? })
    }

    /// The pictures of every topic.
    fn probes(&self, series: &[Series]) -> Vec<Probe> {
        let mut probes = Vec::new();
        for (of, tried) in series.iter().zip(&self.frames) {
            for (place, layer) in of.layers.iter().enumerate() {
                let line = |made: &Made| made.text.split(|byte| *byte == b'\n').nth(place).map_or(0, <[u8]>::len);
                let bytes: usize = tried.iter().map(line).sum();
                let width = tried.iter().map(|made| made.widths[place]).max().unwrap_or(0);
                let class = class_of(of, place);
                let bytes = bytes as f64 / tried.len().max(1) as f64 * frames_with(of, class) as f64;
                probes.push(Probe { class, is_map: layer.role != Role::Image, width, tried: self.size, bytes });
            }
        }
        probes
    }
}

/// The pictures of a topic in the size that was tried.
struct Probe {
    class: Class,
    is_map: bool,
    /// The width of the recorded images or maps.
    width: u32,
    tried: Size,
    /// The bytes of all frames, if they are like those that were tried.
    bytes: f64,
}

impl Probe {
    /// How many bytes the pictures are likely to take in a size.
    fn bytes_in(&self, size: &Size) -> f64 {
        let width = |size: &Size| f64::from(size.widest(self.class).min(self.width).max(1));
        let ratio = width(size) / width(&self.tried);
        let growth = if ratio > 1.0 { GROWTH.0 } else { GROWTH.1 };
        let steps = |size: &Size| if self.is_map && size.steps == FINE { FINE_BYTES } else { 1.0 };
        self.bytes * libm::pow(ratio, growth) * steps(size) / steps(&self.tried)
    }
}

/// What the width of a layer depends on: the first image is shown larger than others.
fn class_of(series: &Series, place: usize) -> Class {
    let first_image = series.layers.iter().position(|layer| layer.role == Role::Image);
    match series.layers[place].role {
        Role::Image if first_image == Some(place) => Class::Image,
        Role::Image | Role::Other => Class::Other,
        Role::Truth | Role::Estimate => Class::Main,
    }
}

/// Leaves a share of the frames of each series, at least one.
fn thin(series: &mut [Series], share: f64) {
    for series in series {
        let most = ((series.positions.len() as f64 * share) as usize).max(1);
        series.positions = evenly(&series.positions, &[], most);
    }
}

/// A frame's text: one line per layer, empty where there is no value.
#[derive(Clone)]
struct Made {
    position: FrameIndex,
    text: Vec<u8>,
    /// By layer, the range of its samples.
    ranges: Vec<Option<CodeRange>>,
    /// By layer, the width of what was recorded.
    widths: Vec<u32>,
    damaged: u64,
}

/// Makes all pictures on several threads, in order; of several errors, returns the first.
fn all_at_once(
    positions: &[FrameIndex],
    threads: usize,
    make: &(dyn Fn(FrameIndex) -> Result<Made, PageError> + Sync),
) -> Result<Vec<Made>, PageError> {
    let budget = Budget::new(threads.max(1));
    let _own = budget.permit();
    let made = in_order(&budget, positions.len(), |tile| {
        caught(|| make(positions[tile])).unwrap_or_else(|panic| Err(panic.into()))
    });
    made.into_iter().collect()
}

fn frame(
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

/// A selection of at most `most` positions: half of them the wanted ones, the first before others, and the rest at even
/// distances, including the first and the last.
#[must_use]
pub fn evenly(positions: &[FrameIndex], wanted: &[FrameIndex], most: usize) -> Vec<FrameIndex> {
    if positions.len() <= most {
        return positions.to_vec();
    }
    let mut found = BTreeSet::new();
    for position in wanted.iter().filter(|position| positions.binary_search(position).is_ok()) {
        if found.len() < most / 2 {
            found.insert(*position);
        }
    }
    let wanted = found;
    let with = |even: usize| -> BTreeSet<FrameIndex> {
        let at = |i: usize| positions[i * (positions.len() - 1) / (even - 1).max(1)];
        wanted.iter().copied().chain((0..even).map(at)).collect()
    };
    // Some of the even ones are wanted ones: then there is room for more.
    let mut chosen = with(most - wanted.len());
    for even in most - wanted.len()..=most {
        let more = with(even);
        if more.len() > most {
            break;
        }
        chosen = more;
    }
    chosen.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use depthloom_graphs::plan::FrameIndex;
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
    fn of_many_frames_the_wanted_are_there_and_the_others_are_even() {
        let positions: Vec<FrameIndex> = FrameIndex::all(1000).collect();
        let chosen = evenly(&positions, &[500, 17, 18, 19, 18].map(FrameIndex), 20);
        assert!((18..=20).contains(&chosen.len()), "{chosen:?}");
        assert!(
            [0, 17, 18, 19, 500, 999].map(FrameIndex).iter().all(|position| chosen.contains(position)),
            "{chosen:?}"
        );
        assert!(chosen.windows(2).all(|two| two[1].0 - two[0].0 <= 80), "{chosen:?}");
        assert_eq!(evenly(&positions[..5], &[], 20), [0, 1, 2, 3, 4].map(FrameIndex));
        assert_eq!(evenly(&positions, &[], 1), [FrameIndex(0)]);
        let some = evenly(&positions, &[900, 3, 400].map(FrameIndex), 4);
        assert!(some.contains(&FrameIndex(900)) && some.contains(&FrameIndex(3)) && !some.contains(&FrameIndex(400)));
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
