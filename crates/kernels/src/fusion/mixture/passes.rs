//! The loops over pixels.

use super::coarse::{Grid, MAPS, from_phases, samples, to_phases};
use super::prior::{Row, SupportFactors};
use super::reliability::spread_at;
use super::{Alignment, Frame, Fused, LANES, Local, Mixture};
use crate::fusion::functions::{exp, ln};
use crate::simd::Pass;

/// Standard deviation of stereo's log depth, at least.
const LEAST_STEREO_SPREAD: f32 = 1e-3;

/// Bounds of the standard deviation of monocular log depth of a pixel.
const MONO_SPREADS: (f32, f32) = (1e-3, 10.0);

/// Added to the blurred weights before they divide.
const LEAST_WEIGHT: f32 = 1e-6;

/// Observations of a pixel: `z_s - z_0`, `k`, `P`, and `s_m` before alignment.
pub(super) const OBSERVED: usize = 4;

/// Results of a pixel: `z - z_0`, `z_m - z_0`, `q` and `V`.
const RESULTS: usize = 4;

/// One number for each of the pixels that are computed together.
type Lanes = [f32; LANES];

/// A row, a multiple of [`LANES`] long.
#[derive(Debug, Default)]
pub(super) struct RowBuffers {
    disparity: Vec<i16>,
    mono: Vec<f32>,
    apart: Vec<i32>,
    against: Vec<f32>,
    observed: [Vec<f32>; OBSERVED],
    in_phases: [Vec<f32>; RESULTS],
    results: [Vec<f32>; RESULTS],
}

impl RowBuffers {
    /// Makes room for `len` samples; those beyond the image are invalid.
    pub(super) fn prepare(&mut self, len: usize) {
        self.disparity.clear();
        self.disparity.resize(len, i16::MIN);
        self.mono.clear();
        self.mono.resize(len, f32::NAN);
        self.apart.clear();
        self.apart.resize(len, 0);
        self.against.resize(len, 0.0);
        let rows = self.observed.iter_mut().chain(&mut self.in_phases).chain(&mut self.results);
        rows.for_each(|row| row.resize(len, 0.0));
    }

    #[inline(always)]
    fn load(&mut self, frame: &Frame<'_>, y: usize) {
        let pixels = y * frame.width..(y + 1) * frame.width;
        self.disparity[..frame.width].copy_from_slice(&frame.disparity.sixteenths[pixels.clone()]);
        self.mono[..frame.width].copy_from_slice(&frame.mono[pixels]);
    }
}

/// Parameters and inputs as the loops take them.
pub(super) struct Model<'a> {
    mixture: &'a Mixture,
    frame: &'a Frame<'a>,
    support: &'a SupportFactors,
    metre_pixels: f32,
    doffs_px: f32,
    /// Disparities up to here are invalid, 1/16 px.
    least: i16,
    /// `sqrt(2 pi) / range`: odds against an inlier per prior odds, for a density of 1.
    outlier_scale: f32,
    per_noise: f32,
    /// Smallest `s_m`, and the largest `P` that adds to the weight.
    least_spread: f32,
    most_precision: f32,
}

impl<'a> Model<'a> {
    pub(super) fn new(mixture: &'a Mixture, frame: &'a Frame<'a>, support: &'a SupportFactors) -> Self {
        let least_spread = match &mixture.alignment {
            Alignment::None => mixture.mono_spread,
            Alignment::Local(local) => local.least_spread,
        };
        Self {
            mixture,
            frame,
            support,
            metre_pixels: frame.geometry.metre_pixels(),
            doffs_px: frame.geometry.doffs_px as f32,
            least: frame.geometry.least_sixteenths(),
            outlier_scale: (std::f64::consts::TAU.sqrt() / f64::from(mixture.outliers)) as f32,
            per_noise: 1.0 / mixture.stereo_noise,
            least_spread,
            most_precision: 1.0 / (least_spread * least_spread),
        }
    }

    #[inline(always)]
    fn prior(&self, y: usize, row: &mut RowBuffers) {
        let RowBuffers { disparity, mono, apart, against, .. } = row;
        let support = self.support.row(y, self.frame.width);
        self.mixture.prior.odds_against(self.frame, Row { y, disparity, mono, apart, support }, against);
    }

    #[inline(always)]
    fn stereo_is_valid(&self, disparity: i16) -> bool {
        self.frame.disparity.is_valid(disparity, self.least)
    }

    #[inline(always)]
    fn capped(&self, depth: f32) -> f32 {
        if depth > self.mixture.cap { self.mixture.cap } else { depth }
    }

    /// Reads row `y` and computes what is observed of its pixels, pixel by pixel.
    #[inline(always)]
    fn observe(&self, y: usize, row: &mut RowBuffers) {
        row.load(self.frame, y);
        self.prior(y, row);
        let [apart, against, precision, spread] = &mut row.observed;
        let inputs = row.disparity.as_chunks::<LANES>().0.iter().zip(row.mono.as_chunks::<LANES>().0);
        let inputs = inputs.zip(row.against.as_chunks::<LANES>().0);
        let outputs = apart.as_chunks_mut::<LANES>().0.iter_mut().zip(against.as_chunks_mut::<LANES>().0);
        let outputs = outputs.zip(precision.as_chunks_mut::<LANES>().0);
        for (((disparity, mono), odds), ((apart, against), precision)) in inputs.zip(outputs) {
            for i in 0..LANES {
                let stereo_valid = self.stereo_is_valid(disparity[i]);
                let valid = stereo_valid & is_depth(mono[i]);
                let px = f32::from(disparity[i]) / 16.0 + self.doffs_px;
                let ratio = self.capped(self.metre_pixels / px) / mono[i];
                let ratio = if valid { ratio } else { 1.0 };
                let root = px * self.per_noise;
                let root = if root < 1.0 / LEAST_STEREO_SPREAD { root } else { 1.0 / LEAST_STEREO_SPREAD };
                let odds = odds[i] * self.outlier_scale / root;
                apart[i] = ln(ratio);
                against[i] = if stereo_valid { odds } else { f32::INFINITY };
                precision[i] = if valid { root * root } else { 0.0 };
            }
        }
        match self.mixture.prior.spread() {
            None => spread.fill(self.mixture.mono_spread),
            Some(knots) => {
                for (spread, mono) in spread.iter_mut().zip(&row.mono) {
                    *spread = spread_at(knots, *mono);
                }
            }
        }
        if let Some(deviation) = self.frame.mono_deviation {
            let pixels = spread.iter_mut().zip(&row.mono).zip(&deviation[y * self.frame.width..]);
            for ((spread, mono), deviation) in pixels.take(self.frame.width) {
                let relative = deviation / mono;
                if relative > 0.0 && relative.is_finite() {
                    *spread = relative.clamp(MONO_SPREADS.0, MONO_SPREADS.1);
                }
            }
        }
    }
}

/// Whether a monocular depth is valid.
#[inline(always)]
fn is_depth(metres: f32) -> bool {
    (metres > 0.0) & (metres < f32::INFINITY)
}

/// `q`, `g` and `u` of a pixel with shift `z_m - z_0` and variance `M`.
#[inline(always)]
fn posterior(apart: f32, against: f32, precision: f32, shift: f32, variance: f32) -> (f32, f32, f32) {
    let apart = apart - shift;
    let ratio = 1.0 + precision * variance;
    let inverse = 1.0 / ratio;
    let odds = against * ratio.sqrt() * exp(0.5 * (apart * apart) * (precision * inverse));
    (1.0 / (1.0 + odds), 1.0 - inverse, apart)
}

/// The aligned monocular estimate of a row: blurred maps, interpolated between rows of nodes; `None` before alignment.
#[derive(Clone, Copy)]
struct Estimate<'a>(Option<(&'a Grid, &'a [f32])>);

impl Estimate<'_> {
    /// Shifts and variances of [`LANES`] pixels of a phase, whose spread is `most` before alignment.
    #[inline(always)]
    fn at(self, model: &Model<'_>, pixel: usize, cell: usize, most: &Lanes) -> (Lanes, Lanes) {
        let Some((grid, lines)) = self.0 else {
            return ([0.0; LANES], most.map(|most| most * most));
        };
        let line = grid.line();
        let [mut share, mut shift, mut scatter] = [[0.0; LANES]; MAPS];
        grid.interpolate(pixel, cell, &lines[..line], &mut share);
        grid.interpolate(pixel, cell, &lines[line..2 * line], &mut shift);
        grid.interpolate(pixel, cell, &lines[2 * line..], &mut scatter);
        let least = model.least_spread;
        let mut variance = [0.0; LANES];
        for i in 0..LANES {
            let scatter = if scatter[i] > 0.0 { scatter[i] } else { 0.0 };
            let (spread, most) = (scatter.sqrt(), most[i]);
            let spread = if spread > least { spread } else { least };
            let spread = share[i] * spread + (1.0 - share[i]) * most;
            let spread = if spread > least { spread } else { least };
            let spread = if spread < most { spread } else { most };
            variance[i] = spread * spread;
        }
        (shift, variance)
    }
}

/// Adds the weights of a row, and their first two moments, to the nodes of a grid.
pub(super) struct Sums<'a, const CELL: usize> {
    pub grid: &'a Grid,
    pub model: &'a Model<'a>,
    /// A padded row of each map, in phases.
    pub phases: &'a mut [f32],
    /// A row of nodes of each map.
    pub node_row: &'a mut [f32],
    pub nodes: &'a mut [f32],
}

impl<const CELL: usize> Sums<'_, CELL> {
    #[inline(always)]
    fn add_row(&mut self, y: usize, observed: &[f32], estimate: Estimate<'_>) {
        let Self { grid, model, phases, node_row, nodes } = self;
        let (phase, stride, margin) = (grid.phase(), grid.padded_phase(), grid.margin());
        let map = CELL * stride;
        let (most, scale) = (model.most_precision, 1.0 / model.most_precision);
        for pixel in 0..CELL {
            for cell in (0..phase).step_by(LANES) {
                let at = pixel * phase + cell;
                let (apart, against) = (samples(observed, at), samples(observed, CELL * phase + at));
                let precision = samples(observed, 2 * CELL * phase + at);
                let most_spread = samples(observed, 3 * CELL * phase + at);
                let (shift, variance) = estimate.at(model, pixel, cell, most_spread);
                let mut moments = [[0.0; LANES]; MAPS];
                for i in 0..LANES {
                    let (inlier, ..) = posterior(apart[i], against[i], precision[i], shift[i], variance[i]);
                    let precision = if precision[i] < most { precision[i] } else { most };
                    let weight = inlier * (precision * scale);
                    let first = weight * apart[i];
                    moments[0][i] = weight;
                    moments[1][i] = first;
                    moments[2][i] = first * apart[i];
                }
                for (index, moment) in moments.iter().enumerate() {
                    phases[index * map + pixel * stride + margin + cell..][..LANES].copy_from_slice(moment);
                }
            }
        }
        let length = grid.node_row();
        for (phases, nodes) in phases.chunks_exact_mut(map).zip(node_row.chunks_exact_mut(length)) {
            grid.reflect(phases);
            grid.splat::<CELL>(phases, nodes);
        }
        grid.add_row(y, node_row, nodes);
    }
}

/// Observes every row, and the first iteration of alignment.
pub(super) struct Observe<'a, const CELL: usize> {
    pub sums: Sums<'a, CELL>,
    pub row: &'a mut RowBuffers,
    pub observed: &'a mut [f32],
}

impl<const CELL: usize> Pass for Observe<'_, CELL> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { mut sums, row, observed } = self;
        let map = CELL * sums.grid.phase();
        for (y, observed) in observed.chunks_exact_mut(OBSERVED * map).enumerate() {
            sums.model.observe(y, row);
            for (pixels, phases) in row.observed.iter().zip(observed.chunks_exact_mut(map)) {
                to_phases::<CELL>(pixels, phases);
            }
            sums.add_row(y, observed, Estimate(None));
        }
    }
}

/// A further iteration of alignment.
pub(super) struct Weigh<'a, const CELL: usize> {
    pub sums: Sums<'a, CELL>,
    pub observed: &'a [f32],
    pub blurred: &'a [f32],
    pub lines: &'a mut [f32],
}

impl<const CELL: usize> Pass for Weigh<'_, CELL> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { mut sums, observed, blurred, lines } = self;
        let grid = sums.grid;
        for (y, observed) in observed.chunks_exact(OBSERVED * CELL * grid.phase()).enumerate() {
            grid.interpolate_row(y, blurred, lines);
            sums.add_row(y, observed, Estimate(Some((grid, lines))));
        }
    }
}

/// Makes of the blurred moments what pixels interpolate: `c`, the shift, and `v`.
pub(super) struct Fields<'a> {
    pub local: &'a Local,
    /// Samples of a row of one map.
    pub length: usize,
    pub blurred: &'a mut [f32],
}

impl Pass for Fields<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { local, length, blurred } = self;
        for row in blurred.chunks_exact_mut(MAPS * length) {
            let (weights, rest) = row.split_at_mut(length);
            let (firsts, seconds) = rest.split_at_mut(length);
            let blocks = weights.as_chunks_mut::<LANES>().0.iter_mut().zip(firsts.as_chunks_mut::<LANES>().0);
            for ((weight, first), second) in blocks.zip(seconds.as_chunks_mut::<LANES>().0) {
                for i in 0..LANES {
                    let (regular, exact) = (weight[i] + local.regulariser, 1.0 / (weight[i] + LEAST_WEIGHT));
                    let mean = first[i] * exact;
                    let scatter = second[i] * exact - mean * mean;
                    weight[i] /= regular;
                    first[i] /= regular;
                    second[i] = if scatter > 0.0 { scatter } else { 0.0 };
                }
            }
        }
    }
}

/// Computes the outputs, except the median. `deviation` is that of log depth.
pub(super) struct Finish<'a, 'b, const CELL: usize> {
    pub grid: &'a Grid,
    pub model: &'a Model<'a>,
    pub row: &'a mut RowBuffers,
    /// Empty without alignment: then each row is observed here.
    pub observed: &'a [f32],
    pub blurred: &'a [f32],
    pub lines: &'a mut [f32],
    /// Fused depth before the median.
    pub merged: &'a mut [f32],
    pub out: &'a mut Fused<'b>,
}

impl<const CELL: usize> Pass for Finish<'_, '_, CELL> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { grid, model, row, observed, blurred, lines, merged, out } = self;
        let (width, map) = (model.frame.width, CELL * grid.phase());
        let local = matches!(model.mixture.alignment, Alignment::Local(_));
        for y in 0..model.frame.height {
            if local {
                row.load(model.frame, y);
                grid.interpolate_row(y, blurred, lines);
                let (apart, rest) = observed[y * OBSERVED * map..][..OBSERVED * map].split_at(map);
                let (against, rest) = rest.split_at(map);
                let (precision, spread) = rest.split_at(map);
                let estimate = Estimate(Some((grid, lines)));
                results::<CELL>(model, grid, [apart, against, precision, spread], estimate, &mut row.in_phases);
                for (phases, results) in row.in_phases.iter().zip(&mut row.results) {
                    from_phases::<CELL>(phases, results);
                }
            } else {
                model.observe(y, row);
                let [apart, against, precision, spread] = &row.observed;
                let observed = [&apart[..], against, precision, spread];
                results::<CELL>(model, grid, observed, Estimate(None), &mut row.results);
            }
            let pixels = y * width..(y + 1) * width;
            let mut maps = Maps {
                merged: &mut merged[pixels.clone()],
                deviation: &mut out.deviation[pixels.clone()],
                inlier: &mut out.inlier[pixels.clone()],
                aligned: &mut out.aligned[pixels],
            };
            if !maps.write(model, row) {
                model.prior(y, row);
                maps.mend(model, row);
            }
        }
    }
}

/// The results of a row.
#[inline(always)]
fn results<const CELL: usize>(
    model: &Model<'_>,
    grid: &Grid,
    [apart, against, precision, spread]: [&[f32]; OBSERVED],
    estimate: Estimate<'_>,
    results: &mut [Vec<f32>; RESULTS],
) {
    let phase = grid.phase();
    for pixel in 0..CELL {
        for cell in (0..phase).step_by(LANES) {
            let at = pixel * phase + cell;
            let (apart, against) = (samples(apart, at), samples(against, at));
            let precision = samples(precision, at);
            let (shifts, variances) = estimate.at(model, pixel, cell, samples(spread, at));
            let mut values = [[0.0; LANES]; RESULTS];
            for i in 0..LANES {
                let (shift, variance) = (shifts[i], variances[i]);
                let (inlier, gain, apart) = posterior(apart[i], against[i], precision[i], shift, variance);
                let moved = gain * apart;
                values[0][i] = shift + inlier * moved;
                values[1][i] = shift;
                values[2][i] = inlier;
                values[3][i] = variance * (1.0 - inlier * gain) + inlier * (1.0 - inlier) * (moved * moved);
            }
            for (value, out) in values.iter().zip(&mut *results) {
                out[at..][..LANES].copy_from_slice(value);
            }
        }
    }
}

/// Writes as many pixels as the row has from `left` on.
#[inline(always)]
fn store(pixels: &Lanes, left: usize, row: &mut [f32]) {
    match row[left..].first_chunk_mut() {
        Some(row) => *row = *pixels,
        None => {
            for (out, pixel) in row[left..].iter_mut().zip(pixels) {
                *out = *pixel;
            }
        }
    }
}

/// One row of the outputs.
struct Maps<'a> {
    merged: &'a mut [f32],
    deviation: &'a mut [f32],
    inlier: &'a mut [f32],
    aligned: &'a mut [f32],
}

impl Maps<'_> {
    /// Writes the results; returns whether monocular depth is valid at every pixel.
    #[inline(always)]
    fn write(&mut self, model: &Model<'_>, row: &RowBuffers) -> bool {
        let mut all_valid = true;
        let width = self.merged.len();
        for left in (0..width).step_by(LANES) {
            let mono = samples(&row.mono, left);
            let [fused, shift, inlier, variance] = &row.results;
            let (fused, shift) = (samples(fused, left), samples(shift, left));
            let (inlier, variance) = (samples(inlier, left), samples(variance, left));
            let [mut merged, mut aligned, mut deviation] = [[0.0; LANES]; 3];
            for i in 0..LANES {
                let mono = if is_depth(mono[i]) { mono[i] } else { f32::NAN };
                let fused = model.capped(mono * exp(fused[i]));
                merged[i] = fused;
                aligned[i] = model.capped(mono * exp(shift[i]));
                deviation[i] = if fused.is_finite() { variance[i].sqrt() } else { f32::NAN };
            }
            let columns = LANES.min(width - left);
            all_valid &= merged[..columns].iter().fold(true, |all, depth| all & depth.is_finite());
            store(&merged, left, self.merged);
            store(&aligned, left, self.aligned);
            store(&deviation, left, self.deviation);
            store(inlier, left, self.inlier);
        }
        all_valid
    }

    /// Pixels without monocular depth are those of stereo.
    #[inline(always)]
    fn mend(&mut self, model: &Model<'_>, row: &RowBuffers) {
        for x in 0..self.merged.len() {
            if is_depth(row.mono[x]) {
                continue;
            }
            self.inlier[x] = 0.0;
            if model.stereo_is_valid(row.disparity[x]) {
                let px = f32::from(row.disparity[x]) / 16.0 + model.doffs_px;
                let spread = 1.0 / (px * model.per_noise);
                self.merged[x] = model.capped(model.metre_pixels / px);
                self.deviation[x] = if spread > LEAST_STEREO_SPREAD { spread } else { LEAST_STEREO_SPREAD };
                self.inlier[x] = 1.0 / (1.0 + row.against[x]);
            }
        }
    }
}
