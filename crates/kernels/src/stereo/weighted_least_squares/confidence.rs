//! How far each disparity is trusted.

use crate::raster::reflect101;

use super::Region;

/// Disparities in 1/16 px with their invalid value.
pub(super) struct Map<'a> {
    pub(super) pixels: &'a [i16],
    pub(super) width: usize,
    pub(super) invalid: i16,
}

impl Map<'_> {
    fn row(&self, region: &Region, y: usize) -> &[i16] {
        &self.pixels[(region.y + y) * self.width + region.x..][..region.width]
    }

    /// The smallest rectangle that contains all valid pixels.
    pub(super) fn answered_region(&self) -> Option<Region> {
        let (mut left, mut right, mut rows) = (self.width, 0, None);
        for (y, row) in self.pixels.chunks_exact(self.width.max(1)).enumerate() {
            let Some(first) = row.iter().position(|&pixel| pixel != self.invalid) else { continue };
            let last = row.iter().rposition(|&pixel| pixel != self.invalid).unwrap_or(first);
            left = left.min(first);
            right = right.max(last + 1);
            rows = Some((rows.map_or(y, |(top, _)| top), y + 1));
        }
        rows.map(|(top, bottom)| Region { x: left, y: top, width: right - left, height: bottom - top })
    }

    /// 1 at valid pixels, 0 elsewhere, for the rows of `out`, the first being the region's row `first`.
    pub(super) fn validity(&self, region: &Region, first: usize, out: &mut [f32]) {
        for (y, out) in out.chunks_exact_mut(region.width).enumerate() {
            for (share, &pixel) in out.iter_mut().zip(self.row(region, first + y)) {
                *share = f32::from(u8::from(pixel != self.invalid));
            }
        }
    }

    pub(super) fn times(&self, region: &Region, first: usize, confidence: &[f32], out: &mut [f32]) {
        let rows = out.chunks_exact_mut(region.width).zip(confidence.chunks_exact(region.width));
        for (y, (out, confidence)) in rows.enumerate() {
            for ((out, &share), &pixel) in out.iter_mut().zip(confidence).zip(self.row(region, first + y)) {
                *out = share * f32::from(pixel);
            }
        }
    }
}

/// OpenCV's `depth_discontinuity_roll_off_factor`: confidence lost per variance, in sixteenths of a pixel squared.
const ROLL_OFF: f32 = 0.001;

/// Sums over the valid pixels of a window, or of a part of one column.
#[derive(Clone, Copy, Default)]
struct Sums {
    count: i64,
    sum: i64,
    squares: i64,
}

impl Sums {
    fn add(&mut self, pixel: i16, invalid: i16, sign: i64) {
        if pixel != invalid {
            let pixel = i64::from(pixel);
            self.count += sign;
            self.sum += sign * pixel;
            self.squares += sign * pixel * pixel;
        }
    }

    fn add_all(&mut self, other: Self, sign: i64) {
        self.count += sign * other.count;
        self.sum += sign * other.sum;
        self.squares += sign * other.squares;
    }

    /// `1 - ROLL_OFF variance`, at least 0, in the steps in which OpenCV rounds.
    fn continuity(self) -> f32 {
        if self.count == 0 {
            return 0.0;
        }
        let share = 1.0 / self.count as f64;
        let (mean, mean_square) = ((self.sum as f64 * share) as f32, (self.squares as f64 * share) as f32);
        (1.0 - ROLL_OFF * (mean_square - mean * mean)).max(0.0)
    }
}

/// How even the disparities around each pixel are, 0 to 1: 1 less a thousandth of the variance (1/16 px squared) of the
/// valid pixels in a window of side `2 radius + 1`, borders reflected. For the rows of `out`, from the region's row
/// `first` on. Sums are exact, so that their order does not matter.
pub(super) fn continuity(map: &Map<'_>, region: &Region, radius: usize, first: usize, out: &mut [f32]) {
    let reach = radius as isize;
    let row_at = |y: isize| map.row(region, reflect101(y, region.height));
    let mut columns = vec![Sums::default(); region.width];
    let change = |columns: &mut [Sums], y: isize, sign: i64| {
        for (sums, &pixel) in columns.iter_mut().zip(row_at(y)) {
            sums.add(pixel, map.invalid, sign);
        }
    };
    let top = first as isize;
    for y in top - reach..=top + reach {
        change(&mut columns, y, 1);
    }
    for (y, out) in out.chunks_exact_mut(region.width).enumerate() {
        if y > 0 {
            let y = top + y as isize;
            change(&mut columns, y - 1 - reach, -1);
            change(&mut columns, y + reach, 1);
        }
        let column_at = |x: isize| columns[reflect101(x, region.width)];
        let mut window = Sums::default();
        for x in -reach..reach {
            window.add_all(column_at(x), 1);
        }
        for (x, out) in out.iter_mut().enumerate() {
            window.add_all(column_at(x as isize + reach), 1);
            *out = window.continuity();
            window.add_all(column_at(x as isize - reach), -1);
        }
    }
}

/// Confidence from continuity, in place, 0 to 255: the lesser of a pixel's and its partner's where the two views'
/// disparities add up to less than `max_difference` (1/16 px), 0 where they do not and where one is invalid. A pixel
/// whose partner lies outside the right map's region keeps its own, as in OpenCV.
pub(super) fn consistency(
    (left, region): (&Map<'_>, &Region),
    (right, right_region): (&Map<'_>, &Region),
    max_difference: i32,
    first: usize,
    of_left: &mut [f32],
    of_right: &[f32],
) {
    let lines = of_left.chunks_exact_mut(region.width).zip(of_right.chunks_exact(region.width));
    for (y, (of_left, of_right)) in lines.enumerate() {
        let (left_row, right_row) = (left.row(region, first + y), right.row(right_region, first + y));
        for (x, (share, &pixel)) in of_left.iter_mut().zip(left_row).enumerate() {
            let pixel_wide = i32::from(pixel);
            let partner = (region.x + x) as i64 - i64::from(pixel_wide >> 4) - right_region.x as i64;
            if pixel == left.invalid {
                *share = 0.0;
            } else if let Some(partner) = usize::try_from(partner).ok().filter(|&x| x < right_row.len()) {
                let other = right_row[partner];
                let agrees = other != right.invalid && (pixel_wide + i32::from(other)).abs() < max_difference;
                *share = if agrees { share.min(of_right[partner]) } else { 0.0 };
            }
            *share *= 255.0;
        }
    }
}
