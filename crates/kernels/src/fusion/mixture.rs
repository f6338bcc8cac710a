//! Fusion of stereo and monocular depth as a mixture of inliers and outliers.
//!
//! Everything is in `z = ln(depth)`, pixel by pixel. Stereo measures `z_s` with standard deviation `s_s = noise / d`
//! (`d` in px, `noise` the standard deviation of a disparity), the monocular estimate measures `z_m` with `s_m`. With
//! the prior probability `p` stereo is an inlier and measures the same surface; otherwise it is uniform over a range of
//! log disparities (the outlier). This is the measurement model of Vogiatzis and Hernandez (*Video-based, real-time
//! multi-view stereo*, 2011), for one measurement, with the monocular estimate as the other.
//!
//! ```text
//! q = p N(z_s - z_m; 0, s_s^2 + s_m^2) / (p N(...) + (1 - p) / range)      posterior probability of an inlier
//! m = (z_s / s_s^2 + z_m / s_m^2) / (1 / s_s^2 + 1 / s_m^2)                mean of an inlier
//! z = q m + (1 - q) z_m                                                    fused
//! V = q (1 / (1 / s_s^2 + 1 / s_m^2) + (m - z)^2) + (1 - q) (s_m^2 + (z_m - z)^2)     its variance
//! ```
//!
//! The standard deviation `s_m` of a pixel is [`Frame::mono_deviation`] over depth, or else that of the mixture. With
//! local alignment `z_m` and `s_m` follow from the inliers around each pixel ([`Local`]).
//!
//! # Arithmetic
//! With `P = 1 / s_s^2`, `M = s_m^2`, `t = 1 + P M`, `g = 1 - 1 / t` and `u = z_s - z_m` the same is
//! `q = 1 / (1 + k sqrt(t) exp(u^2 P / (2 t)))`, where `k` depends on prior and disparity alone;
//! `z = z_m + q g u`; `V = M (1 - q g) + q (1 - q) (g u)^2`. So a pixel needs one exponential for each posterior, and
//! no logarithm but that of stereo depth over monocular depth.

mod coarse;
mod passes;
mod prior;
pub mod reliability;
#[cfg(test)]
mod tests;

use crate::filter::median::median5_of_valid;
use crate::raster::check;
use crate::simd::{BLOCK, Level};
use crate::stereo::depth::Geometry;
use coarse::{Grid, MAPS, blur};
use passes::{Fields, Finish, Model, Observe, RowBuffers, Sums, Weigh};
use prior::SupportFactors;
pub use prior::{Disparities, Prior, Rules, StereoEvidence, Support};

/// Pixels that a loop computes together.
const LANES: usize = BLOCK;

/// How the monocular estimate is aligned with stereo.
#[derive(Clone, Debug, PartialEq)]
pub enum Alignment {
    /// Not at all: `z_m` is the logarithm of monocular depth, `s_m` is [`Mixture::mono_spread`].
    None,
    /// By the inliers around each pixel.
    Local(Local),
}

/// Local alignment: the monocular estimate is shifted in log depth by what stereo's inliers around a pixel say.
///
/// Each iteration computes, with `z_0` the logarithm of monocular depth and `G` a Gaussian blur,
///
/// ```text
/// w = q min(1 / s_s^2, 1 / least_spread^2) least_spread^2
/// D = G(w),  a = G(w (z_s - z_0)),  v = G(w (z_s - z_0)^2) / D - (a / D)^2,  c = D / (D + regulariser)
/// z_m = z_0 + a / (D + regulariser)
/// s_m = c max(sqrt(v), least_spread) + (1 - c) mono_spread, clipped to [least_spread, mono_spread]
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Local {
    /// Standard deviation of `G`, px.
    pub sigma: f64,
    /// The blurred weight at which half of the shift is applied.
    pub regulariser: f32,
    /// How often posterior and alignment follow each other; at least 1.
    pub iterations: u32,
    /// Smallest `s_m`.
    pub least_spread: f32,
}

/// Parameters of the fusion.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixture {
    /// How the monocular estimate is aligned.
    pub alignment: Alignment,
    /// Standard deviation of the disparity of an inlier, px.
    pub stereo_noise: f32,
    /// Standard deviation of the logarithm of monocular depth; not used with [`Prior::Learned`], which has its own, nor
    /// where [`Frame::mono_deviation`] is valid.
    pub mono_spread: f32,
    /// Range of log disparities over which outliers are uniform.
    pub outliers: f32,
    /// Largest depth, metres; infinity caps nothing.
    pub cap: f32,
    /// How the prior is computed.
    pub prior: Prior,
}

/// The inputs of one frame. Maps are row-major and have `width` x `height` pixels.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Disparity of the left image's pixels.
    pub disparity: Disparities<'a>,
    /// The end of the range of disparities that stereo searched, px.
    pub range_end: f32,
    /// What makes depth of disparity.
    pub geometry: Geometry,
    /// Monocular depth, metres; valid where it is finite and above 0.
    pub mono: &'a [f32],
    /// Standard deviation of monocular depth, metres; where it and depth are valid, it replaces the spread of the
    /// mixture.
    pub mono_deviation: Option<&'a [f32]>,
    /// What else is known about stereo.
    pub evidence: StereoEvidence<'a>,
}

impl Frame<'_> {
    fn check_sizes(&self) {
        let Self { width, height, disparity, mono, mono_deviation, evidence, .. } = self;
        let sized = |what: &str, len: usize| check(what, len, *width, *height, 1);
        sized("disparity", disparity.sixteenths.len());
        sized("mono", mono.len());
        for (what, map) in [("right disparity", evidence.right), ("unique disparity", evidence.unique)] {
            map.inspect(|map| sized(what, map.sixteenths.len()));
        }
        for (what, map) in [
            ("ambiguity", evidence.ambiguity),
            ("confidence", evidence.confidence),
            ("monocular deviation", *mono_deviation),
        ] {
            map.inspect(|map| sized(what, map.len()));
        }
    }

    /// The depth at the end of stereo's range, metres: nothing nearer was searched. Infinity without such a depth.
    fn nearest_metres(&self) -> f32 {
        let range_end = self.range_end + self.geometry.doffs_px as f32;
        if range_end > 0.0 { self.geometry.metre_pixels() / range_end } else { f32::INFINITY }
    }
}

/// The outputs of one frame.
#[derive(Debug)]
pub struct Fused<'a> {
    /// Fused depth after the 5x5 median, metres; NaN where both estimates are invalid.
    ///
    /// Where stereo is invalid it is the aligned monocular depth, where monocular depth is invalid that of stereo.
    pub depth: &'a mut [f32],
    /// Standard deviation of `depth`, metres: `depth sqrt(V)`.
    pub deviation: &'a mut [f32],
    /// Posterior probability that stereo is an inlier: 0 where it is invalid, the prior where monocular depth is.
    pub inlier: &'a mut [f32],
    /// Aligned monocular depth, capped, metres; NaN where monocular depth is invalid.
    pub aligned: &'a mut [f32],
}

/// Memory that calls share.
#[derive(Debug, Default)]
pub struct MixtureScratch {
    grid: Grid,
    sigma: f64,
    row: RowBuffers,
    /// What is observed of each row, in phases.
    observed: Vec<f32>,
    phases: Vec<f32>,
    node_row: Vec<f32>,
    nodes: Vec<f32>,
    down: Vec<f32>,
    blurred: Vec<f32>,
    lines: Vec<f32>,
    merged: Vec<f32>,
    support: SupportFactors,
}

/// Fuses one frame.
///
/// # Panics
/// If a map has another size than the frame.
pub fn fuse(mixture: &Mixture, frame: &Frame<'_>, scratch: &mut MixtureScratch, out: &mut Fused<'_>) {
    fuse_at(Level::best(), mixture, frame, scratch, out);
}

fn fuse_at(level: Level, mixture: &Mixture, frame: &Frame<'_>, scratch: &mut MixtureScratch, out: &mut Fused<'_>) {
    check_sizes(frame, out);
    if frame.mono.is_empty() {
        return;
    }
    match &mixture.alignment {
        Alignment::None => run::<1>(level, mixture, None, frame, scratch, out),
        Alignment::Local(local) => match Grid::cell_for(local.sigma) {
            1 => run::<1>(level, mixture, Some(local), frame, scratch, out),
            2 => run::<2>(level, mixture, Some(local), frame, scratch, out),
            _ => run::<4>(level, mixture, Some(local), frame, scratch, out),
        },
    }
}

fn check_sizes(frame: &Frame<'_>, out: &Fused<'_>) {
    frame.check_sizes();
    let sized = |what: &str, len: usize| check(what, len, frame.width, frame.height, 1);
    sized("fused depth", out.depth.len());
    sized("deviation", out.deviation.len());
    sized("inlier probability", out.inlier.len());
    sized("aligned depth", out.aligned.len());
}

fn run<const CELL: usize>(
    level: Level,
    mixture: &Mixture,
    local: Option<&Local>,
    frame: &Frame<'_>,
    scratch: &mut MixtureScratch,
    out: &mut Fused<'_>,
) {
    // Without alignment nothing is blurred.
    let sigma = local.map_or(0.25, |local| local.sigma);
    scratch.prepare(frame, sigma, CELL, local.is_some());
    scratch.support.prepare(level, &mixture.prior.evidence(), frame);
    let MixtureScratch { grid, row, observed, phases, node_row, nodes, down, blurred, lines, merged, .. } = scratch;
    let (grid, model) = (&*grid, &Model::new(mixture, frame, &scratch.support));
    if let Some(local) = local {
        for iteration in 0..local.iterations {
            nodes.fill(0.0);
            let sums = Sums::<'_, CELL> { grid, model, phases, node_row, nodes };
            if iteration == 0 {
                level.run(Observe { sums, row, observed });
            } else {
                level.run(Weigh { sums, observed, blurred, lines });
            }
            blur(level, grid, nodes, down, blurred);
            level.run(Fields { local, length: grid.blurred_row(), blurred });
        }
    }
    level.run(Finish::<'_, '_, CELL> { grid, model, row, observed, blurred, lines, merged, out });
    median5_of_valid(merged, frame.width, frame.height, out.depth);
    for (deviation, depth) in out.deviation.iter_mut().zip(&*out.depth) {
        *deviation *= depth;
    }
}

impl MixtureScratch {
    fn prepare(&mut self, frame: &Frame<'_>, sigma: f64, cell: usize, local: bool) {
        let Frame { width, height, .. } = *frame;
        if (self.grid.width, self.grid.height, self.grid.cell, self.sigma) != (width, height, cell, sigma) {
            self.grid = Grid::new(width, height, sigma, cell);
            self.sigma = sigma;
        }
        let grid = &self.grid;
        self.row.prepare(cell * grid.phase());
        self.merged.resize(width * height, 0.0);
        if local {
            self.observed.resize(passes::OBSERVED * cell * grid.phase() * height, 0.0);
            self.phases.resize(MAPS * cell * grid.padded_phase(), 0.0);
            self.node_row.resize(MAPS * grid.node_row(), 0.0);
            self.nodes.resize(MAPS * grid.node_row() * grid.rows.nodes, 0.0);
            self.down.resize(MAPS * grid.node_row() * grid.rows.blurred, 0.0);
            self.blurred.resize(MAPS * grid.blurred_row() * grid.rows.blurred, 0.0);
            self.lines.resize(MAPS * grid.line(), 0.0);
        }
    }
}
