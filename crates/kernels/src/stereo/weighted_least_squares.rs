//! Edge-aware smoothing of a disparity map, guided by the left image: weighted least squares.
//!
//! Min et al. (*Fast Global Image Smoothing Based on Weighted Least Squares*, IEEE TIP 2014) minimise
//! `sum (u - f)^2 + lambda sum w(p, q) (u_p - u_q)^2` over neighbours `p`, `q`, whose affinity `w` falls with their
//! difference in colour, by solving rows and columns in turn ([`passes`]), each a tridiagonal system, with a `lambda`
//! that shrinks from one iteration to the next. As OpenCV's `cv::ximgproc::DisparityWLSFilter` does, the disparities
//! times their confidence ([`confidence`]) and the confidences are smoothed alike, and the one divided by the other:
//! pixels without confidence have no influence, and take the disparities that reach them without crossing an edge.
//!
//! Floating-point operations are associated as OpenCV's, on x86-64 with one thread, are: at a `lambda` of 8000 the
//! systems are so stiff that the rounding of the last bit shows in sixteenths of a pixel. The same bits come out of
//! every instruction set and any number of threads.

mod confidence;
mod passes;

use std::sync::Mutex;

use crate::raster::{check, check_same};
use crate::simd::Level;
use crate::tiles::{Tiles, each};
use confidence::{Map, consistency, continuity};
use passes::{Affinities, Spare, TILE_ROWS, smooth};

/// What is smoothed how much; the defaults are those of `cv::ximgproc::createDisparityWLSFilterGeneric`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Weight of smoothness against the data, in 0 to [`Params::LARGEST_LAMBDA`].
    pub lambda: f32,
    /// Difference in 8-bit colour (Euclidean over the channels) at which the affinity has fallen to `1/e`; positive.
    pub sigma: f32,
    /// Factor by which `lambda` shrinks from one iteration to the next, in 0 to 1.
    pub attenuation: f32,
    /// How often rows and columns are solved, at least once.
    pub iterations: u32,
}

impl Params {
    /// Beyond it, the pivots of the tridiagonal systems are lost to `f32`'s rounding.
    pub const LARGEST_LAMBDA: f32 = 1e6;
}

impl Default for Params {
    fn default() -> Self {
        Self { lambda: 8000.0, sigma: 1.0, attenuation: 0.25, iterations: 3 }
    }
}

/// The image whose edges stop the smoothing: interleaved samples of 8 bits.
#[derive(Clone, Copy, Debug)]
pub struct Guide<'a> {
    /// Row-major samples.
    pub samples: &'a [u8],
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples a pixel: 1 or 3.
    pub channels: usize,
}

/// The right image's disparity, which says how far the left one's is to be trusted.
#[derive(Clone, Copy, Debug)]
pub struct Right<'a> {
    /// Its pixels, 1/16 px, the negatives of the left map's (as in [`crate::stereo::left_right`]).
    pub disparity: &'a [i16],
    /// The value of its invalid pixels.
    pub invalid: i16,
    /// Where the two views differ by this much or more, the confidence is 0 (`LRCthresh`), 1/16 px.
    pub max_difference: i32,
    /// Half the side, rounded down, of the window whose variance lowers the confidence (`depthDiscontinuityRadius`),
    /// px.
    pub radius: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Region {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

/// Buffers that are kept from frame to frame.
#[derive(Debug, Default)]
pub struct SmootherScratch {
    affinities: Affinities,
    weighted: Vec<f32>,
    confidence: Vec<f32>,
    spares: Mutex<Vec<Spare>>,
}

/// The filter: its parameters and the table of affinities that follows from them.
#[derive(Clone, Debug)]
pub struct Smoother {
    params: Params,
    /// The affinity at a squared difference in colour, negated.
    table: Vec<f32>,
}

impl Smoother {
    /// Prepares the table of affinities.
    ///
    /// # Panics
    /// If a parameter is outside its range.
    #[must_use]
    pub fn new(params: Params) -> Self {
        let Params { lambda, sigma, attenuation, iterations } = params;
        assert!((0.0..=Params::LARGEST_LAMBDA).contains(&lambda), "lambda is {lambda}");
        assert!(sigma > 0.0 && sigma.is_finite(), "sigma is {sigma}");
        assert!((0.0..=1.0).contains(&attenuation) && iterations > 0, "{params:?}");
        // Rounded once, from f64: so is glibc's and OpenCV's `expf`, except for a few last bits.
        let affinity = |squared: u32| -(libm::exp(f64::from(-(squared as f32).sqrt() / sigma)) as f32);
        Self { params, table: (0..=3 * 255 * 255).map(affinity).collect() }
    }

    /// Smooths a map in place.
    ///
    /// Disparities are 1/16 px, invalid pixels hold `invalid`. The smoothing spans the smallest rectangle that holds
    /// all valid pixels (OpenCV's region of interest, for a matcher without checks); outside, all pixels are invalid.
    /// Confidence is 0 where `map` is invalid, elsewhere 1, or that of [`Right`]. Inside the rectangle a pixel is
    /// valid through those it is connected to; it is invalid only if their confidence is next to zero. With
    /// `fill` off, invalid pixels stay invalid. Results are rounded to the nearest sixteenth, ties to even; one that
    /// would be `invalid` is a sixteenth more.
    ///
    /// # Panics
    /// If the sizes do not agree or `guide` has neither 1 nor 3 channels.
    #[expect(clippy::too_many_arguments, reason = "the map, what it holds, and five things that guide the filter")]
    pub fn filter(
        &self,
        map: &mut [i16],
        invalid: i16,
        guide: &Guide<'_>,
        right: Option<&Right<'_>>,
        fill: bool,
        scratch: &mut SmootherScratch,
        tiles: &dyn Tiles,
    ) {
        self.filter_at(Level::best(), map, invalid, guide, right, fill, scratch, tiles);
    }

    #[expect(clippy::too_many_arguments, reason = "as `filter`")]
    fn filter_at(
        &self,
        level: Level,
        map: &mut [i16],
        invalid: i16,
        guide: &Guide<'_>,
        right: Option<&Right<'_>>,
        fill: bool,
        scratch: &mut SmootherScratch,
        tiles: &dyn Tiles,
    ) {
        let Guide { samples, width, height, channels } = *guide;
        assert!(channels == 1 || channels == 3, "a guide of {channels} channels");
        check("guide", samples.len(), width, height, channels);
        check("disparity", map.len(), width, height, 1);
        if let Some(right) = right {
            check_same("right disparity", right.disparity.len(), map.len());
        }
        let left = Map { pixels: map, width, invalid };
        let Some(region) = left.answered_region() else { return };
        let SmootherScratch { affinities, weighted, confidence, spares } = scratch;
        affinities.fill(&self.table, guide, &region, tiles);

        let size = region.width * region.height;
        for plane in [&mut *weighted, &mut *confidence] {
            plane.clear();
            plane.resize(size, 0.0);
        }
        let rows = TILE_ROWS * region.width;
        match right {
            None => {
                let parts = confidence.chunks_mut(rows).collect();
                each(tiles, parts, |tile, part| left.validity(&region, tile * TILE_ROWS, part));
            }
            Some(right) => {
                let mirrored = Map { pixels: right.disparity, width, invalid: right.invalid };
                let mirrored_region = Region { x: width - region.x - region.width, ..region };
                // The other plane is free until the confidences are known.
                let other = &mut *weighted;
                let parts = confidence.chunks_mut(rows).zip(other.chunks_mut(rows)).collect();
                each(tiles, parts, |tile, (of_left, of_right)| {
                    let first = tile * TILE_ROWS;
                    continuity(&left, &region, right.radius, first, of_left);
                    continuity(&mirrored, &mirrored_region, right.radius, first, of_right);
                    consistency(
                        (&left, &region),
                        (&mirrored, &mirrored_region),
                        right.max_difference,
                        first,
                        of_left,
                        of_right,
                    );
                });
            }
        }
        // Where every pixel has confidence 1, so has the smoothed plane: each system's rows sum to 1.
        let certain = right.is_none() && confidence.iter().all(|&share| share == 1.0);
        let parts = confidence.chunks(rows).zip(weighted.chunks_mut(rows)).collect();
        each(tiles, parts, |tile, (confidence, weighted)| left.times(&region, tile * TILE_ROWS, confidence, weighted));

        if certain {
            smooth(level, &self.params, affinities, &region, [weighted], spares, tiles);
        } else {
            smooth(level, &self.params, affinities, &region, [weighted, confidence], spares, tiles);
        }
        let out = map[region.y * width..][..region.height * width].chunks_mut(TILE_ROWS * width);
        let parts = out.zip(weighted.chunks(rows).zip(confidence.chunks(rows))).collect();
        each(tiles, parts, |_, (out, (weighted, confidence))| {
            let lines = weighted.chunks_exact(region.width).zip(confidence.chunks_exact(region.width));
            for (row, (weighted, confidence)) in out.chunks_exact_mut(width).zip(lines) {
                let row = &mut row[region.x..][..region.width];
                quotients(row, weighted, confidence, invalid, fill);
            }
        });
    }
}

/// Smoothed confidences below it are invalid: quotients of numbers so small have lost their bits.
const LEAST_CONFIDENCE: f32 = 1e-30;

/// Disparities from their smoothed products with the confidence, by a reciprocal, as OpenCV has it.
fn quotients(row: &mut [i16], weighted: &[f32], confidence: &[f32], invalid: i16, fill: bool) {
    for ((pixel, &weighted), &confidence) in row.iter_mut().zip(weighted).zip(confidence) {
        if !fill && *pixel == invalid {
            continue;
        }
        *pixel = if confidence < LEAST_CONFIDENCE {
            invalid
        } else {
            let rounded = (weighted * (1.0 / confidence)).round_ties_even() as i16;
            if rounded == invalid { invalid.saturating_add(1) } else { rounded }
        };
    }
}

#[cfg(test)]
mod tests;
