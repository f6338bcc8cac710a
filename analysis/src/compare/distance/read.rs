//! Reads the pixels of a pair from samples, by distance and frame.

use depthloom_scores::quantile::{median, quantile};
use polars::frame::DataFrame;

use super::Median;
use crate::error::AnalysisError;
use crate::query::{Bins, Edges, OUTSIDE, numbers};
use crate::samples::{DescribedEstimate, Part, SamplesFile};

/// The pixels that are valid in both estimates.
pub(super) struct Pixels {
    /// The number of frames with such a pixel.
    pub(super) frames: usize,
    /// The bins with pixels, near bins first.
    pub(super) bins: Vec<BinPixels>,
    /// The number of frames that only one estimate has, and of frames on which the pixels with ground truth differ.
    unpaired: usize,
    other_truth: usize,
}

/// The pixels of a bin that are valid in both estimates.
pub(super) struct BinPixels {
    pub(super) from_m: f64,
    pub(super) to_m: f64,
    /// The frames with a pixel in the bin, in order.
    pub(super) frames: Vec<FramePixels>,
    /// For each pixel, the errors of both in metres, and the frame.
    errors: Vec<([f32; 2], u32)>,
}

/// The pixels of a frame in a bin.
pub(super) struct FramePixels {
    pub(super) frame: usize,
    pub(super) count: u64,
    /// The sums of the absolute errors of both.
    pub(super) sums: [f64; 2],
    pub(super) medians: [f64; 2],
}

impl BinPixels {
    /// The errors of both, prepared for medians with weighted frames.
    pub(super) fn medians(&self, frames: usize) -> [Median; 2] {
        [0, 1]
            .map(|side| Median::new(self.errors.iter().map(|(errors, frame)| (errors[side], *frame)).collect(), frames))
    }
}

impl Pixels {
    /// Notes on excluded pixels.
    pub(super) fn note(&self, baseline: &str, other: &str) -> Vec<String> {
        let mut notes = Vec::new();
        if self.unpaired > 0 {
            notes.push(format!("{} frames are excluded, because only {baseline} or {other} has them", self.unpaired));
        }
        if self.other_truth > 0 {
            let frames = self.other_truth;
            notes.push(format!(
                "{frames} frames are excluded, because {baseline} and {other} were scored on different pixels with ground truth"
            ));
        }
        if self.bins.is_empty() {
            notes.push(format!("no pixel is valid in both {baseline} and {other}"));
        }
        notes
    }
}

/// Reads the pixels that are valid in both of a pair.
pub(super) fn pixels(
    sides: [(&SamplesFile, &DescribedEstimate); 2],
    bins: &Bins,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Pixels, AnalysisError> {
    let parts = sides.map(|(file, estimate)| {
        let is_own = |part: &&Part| *part.stage == *estimate.stage && *part.scoring == *estimate.scoring;
        file.parts.iter().filter(is_own).collect::<Vec<&Part>>()
    });
    let paired = paired(&parts);
    let unpaired = parts[0].len() + parts[1].len() - 2 * paired.len();
    let mut found = Pixels { frames: 0, bins: Vec::new(), unpaired, other_truth: 0 };
    // Ground truth and estimates, frame by frame.
    let mut all: Vec<Vec<[f32; 3]>> = Vec::new();
    for parts in paired {
        if stop() {
            return Err(AnalysisError::Stopped);
        }
        match both(sides, parts)? {
            None => found.other_truth += 1,
            Some(pixels) if pixels.is_empty() => {}
            Some(pixels) => all.push(pixels),
        }
    }
    found.frames = all.len();
    let truths = || all.iter().flatten().map(|pixel| pixel[0]);
    if truths().next().is_none() {
        return Ok(found);
    }
    let edges = edges(bins, truths())?;
    let mut bin_pixels: Vec<BinPixels> = (0..edges.len())
        .map(|bin| {
            let (from_m, to_m) = edges.range(bin);
            BinPixels { from_m, to_m, frames: Vec::new(), errors: Vec::new() }
        })
        .collect();
    for (frame, pixels) in all.iter().enumerate() {
        let truths: Vec<f32> = pixels.iter().map(|pixel| pixel[0]).collect();
        for (bin, [truth, one, two]) in edges.bins(&truths).into_iter().zip(pixels) {
            if bin == OUTSIDE {
                continue;
            }
            let bin = &mut bin_pixels[bin as usize];
            if bin.frames.last().is_none_or(|last| last.frame != frame) {
                bin.frames.push(FramePixels { frame, count: 0, sums: [0.0; 2], medians: [0.0; 2] });
            }
            let errors = [one, two].map(|metres| (f64::from(*metres) - f64::from(*truth)).abs());
            if let Some(own) = bin.frames.last_mut() {
                own.count += 1;
                own.sums[0] += errors[0];
                own.sums[1] += errors[1];
            }
            bin.errors.push((errors.map(|error| error as f32), frame as u32));
        }
    }
    bin_pixels.retain(|bin| !bin.frames.is_empty());
    for bin in &mut bin_pixels {
        let mut rest = bin.errors.as_slice();
        for frame in &mut bin.frames {
            let (own, others) = rest.split_at(frame.count as usize);
            rest = others;
            frame.medians = [0, 1].map(|side| {
                let mut errors: Vec<f32> = own.iter().map(|(errors, _)| errors[side]).collect();
                median(&mut errors, f32::total_cmp).unwrap_or(f64::NAN)
            });
        }
    }
    found.bins = bin_pixels;
    Ok(found)
}

/// Pairs the parts of each frame by id; repeated ids are paired in their order.
fn paired<'a>(parts: &[Vec<&'a Part>; 2]) -> Vec<[&'a Part; 2]> {
    let mut taken = vec![false; parts[1].len()];
    let mut paired = Vec::new();
    for one in &parts[0] {
        let is_it = |at: &usize| !taken[*at] && parts[1][*at].frame == one.frame;
        if let Some(at) = (0..parts[1].len()).find(is_it) {
            taken[at] = true;
            paired.push([*one, parts[1][at]]);
        }
    }
    paired
}

/// Ground truth and both estimates of a frame on the pixels that are valid in both. `None` if the estimates were not
/// scored on the same pixels with ground truth.
fn both(
    sides: [(&SamplesFile, &DescribedEstimate); 2],
    parts: [&Part; 2],
) -> Result<Option<Vec<[f32; 3]>>, AnalysisError> {
    let computed = || AnalysisError::compute("errors of samples");
    let read = |side: usize| -> Result<DataFrame, AnalysisError> {
        let (file, estimate) = sides[side];
        file.read(parts[side], &["x", "y", "ground_truth_m", &estimate.column])
    };
    let tables = [read(0)?, read(1)?];
    let column = |side: usize, name: &str| numbers(&tables[side], name).map_err(computed());
    let place = |side: usize| -> Result<_, AnalysisError> {
        Ok((column(side, "x")?, column(side, "y")?, column(side, "ground_truth_m")?))
    };
    let (one, two) = (place(0)?, place(1)?);
    if one != two {
        return Ok(None);
    }
    let (first, second) = (column(0, &sides[0].1.column)?, column(1, &sides[1].1.column)?);
    let pixels = one.2.into_iter().zip(first.into_iter().zip(second)).map(|(truth, (one, two))| [truth, one, two]);
    Ok(Some(pixels.filter(|pixel| pixel.iter().all(|metres| metres.is_finite())).collect()))
}

/// The edges of bins over distances.
fn edges(bins: &Bins, truths: impl Iterator<Item = f32>) -> Result<Edges, AnalysisError> {
    let mut sorted: Vec<f32> = truths.collect();
    sorted.sort_by(f32::total_cmp);
    let (least, most) = (f64::from(sorted[0]), f64::from(sorted[sorted.len() - 1]));
    if let Some(edges) = bins.edges(least, most)? {
        return Ok(edges);
    }
    let count = match bins {
        Bins::Quantile(count) => *count,
        _ => 1,
    };
    let at = |edge: u32| quantile(&sorted, f64::from(edge) / f64::from(count));
    Ok(Edges::new((0..=count).map(at).collect(), true))
}
