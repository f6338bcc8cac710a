//! One image row made ready for Birchfield and Tomasi's dissimilarity: x-Sobel and grey values with their half-pixel
//! neighbourhoods.
//!
//! Per channel there are two planes: the x-Sobel response, clipped and shifted to be positive, and the plain value.
//! OpenCV fills the first and last column of *every* plane with the shifted zero of the Sobel plane; that is kept.

use super::search::Search;
use super::view::View;

/// One plane of one row: the value, and the smallest and largest value within half a pixel.
#[derive(Clone, Debug, Default)]
pub(super) struct Plane {
    /// The value at each column.
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
    /// The planes, Sobel first.
    pub fn planes(&self) -> &[Plane] {
        &self.0
    }

    /// Fills the planes from row `y`.
    pub fn fill(&mut self, search: &Search, image: &View<'_>, y: usize, reversed: bool) {
        let channels = image.channels;
        self.0.resize_with(2 * channels, Plane::default);
        let above = image.row(y.saturating_sub(1));
        let row = image.row(y);
        let below = image.row((y + 1).min(image.height - 1));
        let (sobel, grey) = self.0.split_at_mut(channels);
        for (channel, (sobel, grey)) in sobel.iter_mut().zip(grey).enumerate() {
            for plane in [&mut *sobel, &mut *grey] {
                plane.value.clear();
                plane.value.resize(image.width, search.clip as u8);
            }
            if channels == 1 {
                sobel_row(&mut sobel.value, above, row, below, search.clip);
                if image.width > 2 {
                    let inner = 1..image.width - 1;
                    grey.value[inner.clone()].copy_from_slice(&row[inner]);
                }
            } else {
                let at = |r: &[u8], x: usize| i32::from(r[x * channels + channel]);
                for x in 1..image.width.saturating_sub(1) {
                    let step = |r: &[u8]| at(r, x + 1) - at(r, x - 1);
                    sobel.value[x] = clipped(2 * step(row) + step(above) + step(below), search.clip);
                    grey.value[x] = row[x * channels + channel];
                }
            }
            for plane in [sobel, grey] {
                if reversed {
                    plane.value.reverse();
                }
                plane.fill_neighbourhood();
            }
        }
    }
}

/// OpenCV's table: clipped to `-clip..=clip`, shifted by `clip`, cut to eight bits.
fn clipped(response: i32, clip: i32) -> u8 {
    (response.clamp(-clip, clip) + clip) as u8
}

fn sobel_row(out: &mut [u8], above: &[u8], row: &[u8], below: &[u8], clip: i32) {
    let wide = |v: u8| i32::from(v);
    let windows = above.windows(3).zip(row.windows(3)).zip(below.windows(3));
    for (out, ((a, r), b)) in out[1..].iter_mut().zip(windows) {
        *out = clipped(2 * (wide(r[2]) - wide(r[0])) + wide(a[2]) - wide(a[0]) + wide(b[2]) - wide(b[0]), clip);
    }
}

impl Plane {
    fn fill_neighbourhood(&mut self) {
        let value = &self.value;
        let last = value.len() - 1;
        self.low.clone_from(value);
        self.high.clone_from(value);
        for x in 0..=last {
            let here = u16::from(value[x]);
            let left = ((here + u16::from(value[x.saturating_sub(1)])) / 2) as u8;
            let right = ((here + u16::from(value[(x + 1).min(last)])) / 2) as u8;
            self.low[x] = value[x].min(left).min(right);
            self.high[x] = value[x].max(left).max(right);
        }
    }
}
