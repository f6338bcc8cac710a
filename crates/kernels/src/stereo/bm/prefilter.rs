//! The two prefilters: what is matched instead of brightness. Both give `cap` for "nothing", and `0..=2 * cap`.

use std::ops::Range;

use super::{Params, Prefilter};
use crate::raster::{reflect101, replicate};
use crate::simd::{Level, Pass};

pub(super) fn rows(
    level: Level,
    params: &Params,
    image: &[u8],
    (width, height): (usize, usize),
    rows: Range<usize>,
    out: &mut [u8],
) {
    let image = Image { pixels: image, width, height };
    match params.prefilter {
        Prefilter::Xsobel => {
            for (y, out) in rows.zip(out.chunks_exact_mut(width)) {
                x_sobel_row(level, &image, y, params.prefilter_cap as u8, out);
            }
        }
        Prefilter::NormalizedResponse => {
            normalized_response(&image, rows, params.prefilter_size as usize / 2, params.prefilter_cap, out);
        }
    }
}

struct Image<'a> {
    pixels: &'a [u8],
    width: usize,
    height: usize,
}

impl<'a> Image<'a> {
    fn row(&self, y: usize) -> &'a [u8] {
        &self.pixels[y * self.width..][..self.width]
    }

    fn row_replicated(&self, y: isize) -> &'a [u8] {
        self.row(replicate(y, self.height))
    }
}

/// The horizontal 3x3 Sobel derivative. OpenCV filters pairs of rows and leaves the odd one out.
fn x_sobel_row(level: Level, image: &Image<'_>, y: usize, cap: u8, out: &mut [u8]) {
    if y + 1 == image.height && image.height % 2 == 1 {
        out.fill(cap);
        return;
    }
    let [above, here, below] = [-1, 0, 1].map(|dy| image.row(reflect101(y as isize + dy, image.height)));
    level.run(XSobel { above, here, below, cap, out });
}

struct XSobel<'a> {
    above: &'a [u8],
    here: &'a [u8],
    below: &'a [u8],
    cap: u8,
    out: &'a mut [u8],
}

impl Pass for XSobel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { above, here, below, cap, out } = self;
        let (width, limit) = (out.len(), i16::from(cap));
        out[0] = cap;
        out[width - 1] = cap;
        let inner = width - 2;
        let left = [&above[..inner], &here[..inner], &below[..inner]];
        let right = [&above[2..][..inner], &here[2..][..inner], &below[2..][..inner]];
        for (x, out) in out[1..][..inner].iter_mut().enumerate() {
            let difference = |row: usize| i16::from(right[row][x]) - i16::from(left[row][x]);
            let derivative = difference(0) + 2 * difference(1) + difference(2);
            *out = (derivative.clamp(-limit, limit) + limit) as u8;
        }
    }
}

/// A pixel with its four neighbours (weights 4 and 1), against the mean of the window; borders repeat.
///
/// OpenCV clips by a table that ends at 5 times 256; the rounded scales of windows of 51, 53 and 73 to 89 px can leave
/// it.
fn normalized_response(image: &Image<'_>, rows: Range<usize>, radius: usize, cap: i32, out: &mut [u8]) {
    let side = 2 * radius + 1;
    let eighth = (side * side / 8) as i32;
    let window_scale = (1024 + eighth) / (eighth * 2);
    let centre_scale = eighth * window_scale;
    let width = image.width;
    let reach = radius as isize;
    // Sums of the window's columns, `radius` of them repeated on either side.
    let mut column_sums = vec![0_i32; width + 2 * radius];
    for dy in -reach..=reach {
        add(&mut column_sums[radius..][..width], image.row_replicated(rows.start as isize + dy));
    }
    for (y, out) in rows.clone().zip(out.chunks_exact_mut(width)) {
        let at = y as isize;
        if y > rows.start {
            let (entering, leaving) = (image.row_replicated(at + reach), image.row_replicated(at - reach - 1));
            for ((sum, &entering), &leaving) in column_sums[radius..].iter_mut().zip(entering).zip(leaving) {
                *sum += i32::from(entering) - i32::from(leaving);
            }
        }
        let (first, last) = (column_sums[radius], column_sums[radius + width - 1]);
        column_sums[..radius].fill(first);
        column_sums[radius + width..].fill(last);
        let [above, here, below] = [-1, 0, 1].map(|dy| image.row_replicated(at + dy));
        let mut window: i32 = column_sums[..2 * radius].iter().sum();
        for (x, out) in out.iter_mut().enumerate() {
            window += column_sums[x + 2 * radius];
            let [before, after] = [x.saturating_sub(1), (x + 1).min(width - 1)].map(|x| i32::from(here[x]));
            let centre = i32::from(here[x]) * 4 + before + after + i32::from(above[x]) + i32::from(below[x]);
            let response = (centre * centre_scale - window * window_scale) >> 10;
            *out = (response.clamp(-cap, cap) + cap) as u8;
            window -= column_sums[x];
        }
    }
}

fn add(sums: &mut [i32], row: &[u8]) {
    for (sum, &pixel) in sums.iter_mut().zip(row) {
        *sum += i32::from(pixel);
    }
}

#[cfg(test)]
mod tests {
    use super::{Image, normalized_response, rows};
    use crate::simd::every_level;
    use crate::stereo::bm::{Params, Prefilter};

    #[test]
    fn rows_filtered_separately_equal_the_whole() {
        let (width, height) = (37, 21);
        let image: Vec<u8> = (0..width * height).map(|i| (i * i * 31 % 253) as u8).collect();
        for prefilter in [Prefilter::Xsobel, Prefilter::NormalizedResponse] {
            let params = Params { prefilter, prefilter_size: 11, prefilter_cap: 40, ..Params::default() };
            let whole = every_level(|level| {
                let mut out = vec![0; width * height];
                rows(level, &params, &image, (width, height), 0..height, &mut out);
                out
            });
            let mut part = vec![0; width * 5];
            rows(crate::simd::Level::PORTABLE, &params, &image, (width, height), 13..18, &mut part);
            assert_eq!(part, whole[13 * width..18 * width]);
        }
    }

    #[test]
    fn a_step_has_a_derivative_and_the_odd_last_row_has_not() {
        let image = [0, 0, 9, 9, 9, 0, 0, 9, 9, 9, 0, 0, 9, 9, 9];
        let params = Params { prefilter_cap: 63, ..Params::default() };
        let mut out = [0; 15];
        rows(crate::simd::Level::PORTABLE, &params, &image, (5, 3), 0..3, &mut out);
        assert_eq!(out, [63, 99, 99, 63, 63, 63, 99, 99, 63, 63, 63, 63, 63, 63, 63]);
    }

    #[test]
    fn flat_images_have_no_response() {
        let image = Image { pixels: &[200; 12 * 7], width: 12, height: 7 };
        let mut out = [0; 12 * 7];
        normalized_response(&image, 0..7, 2, 30, &mut out);
        // 200 * 8 * 513 against 200 * 25 * 171: the scales are rounded, so "none" is at 200 * (4104 - 4275) / 1024
        assert_eq!(out, [0; 12 * 7]);
    }
}
