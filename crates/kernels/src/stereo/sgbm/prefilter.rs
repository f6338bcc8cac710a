//! One image row made ready for Birchfield and Tomasi's dissimilarity: x-Sobel and grey values with their half-pixel
//! neighbourhoods.
//!
//! Per channel there are two planes: the x-Sobel response, clipped and shifted to be positive, and the plain value.
//! OpenCV fills the first and last column of *every* plane with the shifted zero of the Sobel plane; that is kept.

use super::search::Search;
use super::view::View;

/// Bytes after the last column, so that vectors may reach past it.
const PADDING: usize = 64;

/// One plane of one row: the value, and the smallest and largest value within half a pixel. Each row is followed by
/// 64 bytes without meaning.
#[derive(Clone, Debug, Default)]
pub(super) struct Plane {
    pub value: Vec<u8>,
    /// Smallest of the value and its two half-way neighbours.
    pub low: Vec<u8>,
    /// Largest of them.
    pub high: Vec<u8>,
}

/// The planes of one row: all Sobel planes first, then all grey planes.
#[derive(Clone, Debug, Default)]
pub(super) struct Planes(Vec<Plane>);

impl Planes {
    pub(super) fn planes(&self) -> &[Plane] {
        &self.0
    }

    #[inline(always)]
    pub(super) fn fill(&mut self, search: &Search, image: &View<'_>, y: usize, reversed: bool) {
        let channels = image.channels;
        self.0.resize_with(2 * channels, Plane::default);
        let above = image.row(y.saturating_sub(1));
        let row = image.row(y);
        let below = image.row((y + 1).min(image.height - 1));
        let (sobel, grey) = self.0.split_at_mut(channels);
        for (channel, (sobel, grey)) in sobel.iter_mut().zip(grey).enumerate() {
            for plane in [&mut *sobel, &mut *grey] {
                for row in [&mut plane.value, &mut plane.low, &mut plane.high] {
                    row.resize(image.width + PADDING, 0);
                }
                plane.value[0] = search.clip as u8;
                plane.value[image.width - 1] = search.clip as u8;
            }
            if image.width > 2 {
                let inner = 1..image.width - 1;
                let (sobel, grey) = (&mut sobel.value[inner.clone()], &mut grey.value[inner.clone()]);
                if channels == 1 {
                    sobel_row::<1>(sobel, above, row, below, search.clip);
                    grey.copy_from_slice(&row[inner]);
                } else {
                    sobel_row::<3>(sobel, &above[channel..], &row[channel..], &below[channel..], search.clip);
                    for (grey, pixel) in grey.iter_mut().zip(row[3..].chunks_exact(3)) {
                        *grey = pixel[channel];
                    }
                }
            }
            for plane in [sobel, grey] {
                if reversed {
                    plane.value[..image.width].reverse();
                }
                plane.fill_neighbourhood(image.width);
            }
        }
    }
}

/// x-Sobel of the inner columns as OpenCV's table has it: clipped to `-clip..=clip`, shifted by `clip`, cut to eight
/// bits.
#[inline(always)]
fn sobel_row<const CHANNELS: usize>(out: &mut [u8], above: &[u8], row: &[u8], below: &[u8], clip: i32) {
    // No response exceeds 1020: 16 bits do, and the compiler makes vectors of them.
    let limit = clip.min(1020) as i16;
    let step = |r: &[u8], x: usize| i16::from(r[x + 2 * CHANNELS]) - i16::from(r[x]);
    let len = out.len();
    let reach = CHANNELS * (len + 1) + 1;
    let (above, row, below) = (&above[..reach], &row[..reach], &below[..reach]);
    for (i, out) in out.iter_mut().enumerate() {
        let x = i * CHANNELS;
        let response = 2 * step(row, x) + step(above, x) + step(below, x);
        *out = (response.clamp(-limit, limit) as u8).wrapping_add(clip as u8);
    }
}

impl Plane {
    #[inline(always)]
    fn fill_neighbourhood(&mut self, width: usize) {
        let value = &self.value[..width];
        let (low, high) = (&mut self.low[..width], &mut self.high[..width]);
        let between = |a: u8, b: u8| ((u16::from(a) + u16::from(b)) / 2) as u8;
        let low_and_high = |left: u8, here: u8, right: u8| {
            let (left, right) = (between(here, left), between(here, right));
            (here.min(left).min(right), here.max(left).max(right))
        };
        let last = width - 1;
        for x in [0, last] {
            (low[x], high[x]) = low_and_high(value[x.saturating_sub(1)], value[x], value[(x + 1).min(last)]);
        }
        if width > 2 {
            for ((v, low), high) in value.windows(3).zip(&mut low[1..last]).zip(&mut high[1..last]) {
                (*low, *high) = low_and_high(v[0], v[1], v[2]);
            }
        }
    }
}
