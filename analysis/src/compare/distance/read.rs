//! The pixels of a pair, by distance and frame, out of samples.

use depthloom_scores::quantile::{median, quantile};
use polars::frame::DataFrame;

use super::Median;
use crate::error::AnalysisError;
use crate::query::{Bins, Edges, OUTSIDE, numbers};
use crate::samples::{DescribedEstimate, Part, SamplesFile};

/// The pixels valid in both.
pub(super) struct Pixels {
    /// How many frames have such a pixel.
    pub(super) frames: usize,
    /// The bins with pixels, near ones first.
    pub(super) bins: Vec<OfBin>,
    /// How many frames are of one of the two alone, and of how many the pixels with ground truth differ.
    alone: usize,
    other_truth: usize,
}

/// The pixels valid in both in a bin.
pub(super) struct OfBin {
    pub(super) from_m: f64,
    pub(super) to_m: f64,
    /// By frame with a pixel in it, in order.
    pub(super) frames: Vec<OfFrame>,
    /// By pixel: the errors of both, metres, and the frame.
    errors: Vec<([f32; 2], u32)>,
}

/// A frame's pixels in a bin.
pub(super) struct OfFrame {
    pub(super) frame: usize,
    pub(super) count: u64,
    /// Of the absolute errors of both.
    pub(super) sums: [f64; 2],
    pub(super) medians: [f64; 2],
}

impl OfBin {
    /// The errors of both, for medians of frames that count more or less often.
    pub(super) fn medians(&self, frames: usize) -> [Median; 2] {
        [0, 1]
            .map(|side| Median::new(self.errors.iter().map(|(errors, frame)| (errors[side], *frame)).collect(), frames))
    }
}

impl Pixels {
    /// What is to be said of them.
    pub(super) fn note(&self, baseline: &str, other: &str) -> Vec<String> {
        let mut notes = Vec::new();
        if self.alone > 0 {
            notes.push(format!("{} frames of {baseline} or {other} alone do not count", self.alone));
        }
        if self.other_truth > 0 {
            let frames = self.other_truth;
            notes.push(format!(
                "{frames} frames do not count: other pixels with ground truth of {baseline} and {other} were scored"
            ));
        }
        if self.bins.is_empty() {
            notes.push(format!("there is no pixel that is valid in both {baseline} and {other}"));
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
    let parts = sides.map(|(file, of)| {
        let is_of = |part: &&Part| *part.stage == *of.stage && *part.scoring == *of.scoring;
        file.parts.iter().filter(is_of).collect::<Vec<&Part>>()
    });
    let paired = paired(&parts);
    let alone = parts[0].len() + parts[1].len() - 2 * paired.len();
    let mut found = Pixels { frames: 0, bins: Vec::new(), alone, other_truth: 0 };
    // By frame: truth and estimates.
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
    let mut of_bins: Vec<OfBin> = (0..edges.len())
        .map(|bin| {
            let (from_m, to_m) = edges.of(bin);
            OfBin { from_m, to_m, frames: Vec::new(), errors: Vec::new() }
        })
        .collect();
    for (frame, pixels) in all.iter().enumerate() {
        let truths: Vec<f32> = pixels.iter().map(|pixel| pixel[0]).collect();
        for (bin, [truth, one, two]) in edges.bins(&truths).into_iter().zip(pixels) {
            if bin == OUTSIDE {
                continue;
            }
            let bin = &mut of_bins[bin as usize];
            if bin.frames.last().is_none_or(|last| last.frame != frame) {
                bin.frames.push(OfFrame { frame, count: 0, sums: [0.0; 2], medians: [0.0; 2] });
            }
            let errors = [one, two].map(|of| (f64::from(*of) - f64::from(*truth)).abs());
            if let Some(of) = bin.frames.last_mut() {
                of.count += 1;
                of.sums[0] += errors[0];
                of.sums[1] += errors[1];
            }
            bin.errors.push((errors.map(|error| error as f32), frame as u32));
        }
    }
    of_bins.retain(|bin| !bin.frames.is_empty());
    for bin in &mut of_bins {
        let mut rest = bin.errors.as_slice();
        for of in &mut bin.frames {
            let (own, others) = rest.split_at(of.count as usize);
            rest = others;
            of.medians = [0, 1].map(|side| {
                let mut errors: Vec<f32> = own.iter().map(|(errors, _)| errors[side]).collect();
                median(&mut errors, f32::total_cmp).unwrap_or(f64::NAN)
            });
        }
    }
    found.bins = of_bins;
    Ok(found)
}

/// Parts of one frame: its id, and where that repeats, in the order they come.
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

/// Truth and both estimates of a frame, where both are valid; `None` if they were not scored on the same pixels with
/// ground truth.
fn both(
    sides: [(&SamplesFile, &DescribedEstimate); 2],
    parts: [&Part; 2],
) -> Result<Option<Vec<[f32; 3]>>, AnalysisError> {
    let computed = || AnalysisError::compute("errors of samples");
    let read = |side: usize| -> Result<DataFrame, AnalysisError> {
        let (file, of) = sides[side];
        file.read(parts[side], &["x", "y", "truth_m", &of.column])
    };
    let tables = [read(0)?, read(1)?];
    let column = |side: usize, name: &str| numbers(&tables[side], name).map_err(computed());
    let place = |side: usize| -> Result<_, AnalysisError> {
        Ok((column(side, "x")?, column(side, "y")?, column(side, "truth_m")?))
    };
    let (one, two) = (place(0)?, place(1)?);
    if one != two {
        return Ok(None);
    }
    let (first, second) = (column(0, &sides[0].1.column)?, column(1, &sides[1].1.column)?);
    let pixels = one.2.into_iter().zip(first.into_iter().zip(second)).map(|(truth, (one, two))| [truth, one, two]);
    Ok(Some(pixels.filter(|pixel| pixel.iter().all(|of| of.is_finite())).collect()))
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
