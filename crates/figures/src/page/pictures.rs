//! The pictures of all frames, kept in a temporary file until the page is written.
//!
//! How small they are made follows from how many there are, so that a page of any run stays below 40 MB.

use std::fs::File;
use std::io::{self, Read, Seek as _, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

use depthloom_graphs::plan::FrameIndex;
use depthloom_recording::Recording;
use depthloom_threads::{Budget, caught, core_count, in_order};
use serde_json::{Value as Json, json};

use super::PageError;
use super::colour_range::{ColourRange, RangedMap, colour_ranges};
use super::frame_pictures::{Made, Output, frame};
use super::maps::{CodeRange, Scale, Steps};
use super::series::{Role, Series, class_of, thin};
use super::sizes::{Probe, SIZES, Size, frames_with, usual_bytes};

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
